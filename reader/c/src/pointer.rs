//! The only place that follows a caller's pointers. Null is refused; that all others are valid is the caller's promise,
//! in the header.
//!
//! These functions are not marked unsafe, although they trust their arguments: all of these come from C, unchanged,
//! through functions that no Rust program can name, since all modules of this crate are private.
#![expect(unsafe_code, reason = "C hands over pointers")]

use crate::status::Failure;
use std::ffi::{CStr, c_char};

/// What a pointer points to, for as long as a call lasts.
pub fn borrow<'a, T>(pointer: *const T, name: &str) -> Result<&'a T, Failure> {
    // SAFETY: the header asks for null or a valid pointer to what nobody changes or frees during the call.
    unsafe { pointer.as_ref() }.ok_or_else(|| Failure::null(name))
}

/// Writes a result to where the caller wants it.
pub fn write<T>(out: *mut T, value: T, name: &str) -> Result<(), Failure> {
    if out.is_null() {
        return Err(Failure::null(name));
    }
    // SAFETY: the header asks for null or a pointer to memory of this type, which need not be initialised.
    unsafe { out.write(value) };
    Ok(())
}

/// Hands the caller something to keep, which [`release`] takes back.
pub fn give<T>(out: *mut *mut T, value: T) -> Result<(), Failure> {
    write(out, Box::into_raw(Box::new(value)), "the pointer to the result")
}

/// Takes back and drops what [`give`] has handed over; null is nothing.
pub fn release<T>(pointer: *mut T) {
    if !pointer.is_null() {
        // SAFETY: the header asks for null or a pointer from `give` that is freed once.
        drop(unsafe { Box::from_raw(pointer) });
    }
}

/// The text of a C string.
pub fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Failure> {
    if pointer.is_null() {
        return Err(Failure::null(name));
    }
    // SAFETY: the header asks for null or a string that ends with a zero.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Failure::argument(format!("{name} is not UTF-8")))
}

/// Numbers of the caller, for as long as a call lasts.
pub fn slice<'a, T: Copy>(pointer: *const T, length: usize, name: &str) -> Result<&'a [T], Failure> {
    if pointer.is_null() {
        return if length == 0 { Ok(&[]) } else { Err(Failure::null(name)) };
    }
    if length.checked_mul(size_of::<T>()).is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return Err(Failure::argument(format!("the length of {name} is larger than any memory")));
    }
    // SAFETY: the header asks for null or a pointer to `length` numbers, and half the address space at most was
    // checked.
    Ok(unsafe { std::slice::from_raw_parts(pointer, length) })
}

/// What a pointer points to, to change it, for as long as a call lasts.
pub fn borrow_mut<'a, T>(pointer: *mut T, name: &str) -> Result<&'a mut T, Failure> {
    // SAFETY: the header asks for null or a valid pointer to what nobody else uses during the call.
    unsafe { pointer.as_mut() }.ok_or_else(|| Failure::null(name))
}

/// Copies rows of N numbers into the caller's memory, `stride` bytes from row to row, 0 for no gaps. The caller's rows
/// need no alignment. The bytes between them stay as they are.
pub fn copy_rows<T: Copy, const N: usize>(
    rows: impl ExactSizeIterator<Item = [T; N]>,
    out: *mut T,
    capacity: usize,
    stride: usize,
) -> Result<(), Failure> {
    let row_bytes = size_of::<[T; N]>();
    let stride = if stride == 0 { row_bytes } else { stride };
    if stride < row_bytes {
        return Err(Failure::argument(format!("a stride of {stride} bytes is shorter than a row of {row_bytes}")));
    }
    if rows.len() > capacity {
        return Err(Failure::argument(format!("there is room for {capacity} rows, and there are {}", rows.len())));
    }
    let last = rows.len().saturating_sub(1).checked_mul(stride).and_then(|begin| begin.checked_add(row_bytes));
    if last.is_none_or(|bytes| isize::try_from(bytes).is_err()) {
        return Err(Failure::argument(format!("{} rows of {stride} bytes are larger than any memory", rows.len())));
    }
    if out.is_null() && rows.len() > 0 {
        return Err(Failure::null("out"));
    }
    for (number, row) in rows.enumerate() {
        // SAFETY: the header asks for room for `capacity` rows, `stride` bytes from one to the next, `number` is below
        // it, and half the address space at most was checked.
        unsafe { out.cast::<u8>().add(number * stride).cast::<[T; N]>().write_unaligned(row) };
    }
    Ok(())
}

/// As [`copy_rows`], of each row the first 1 to 4 numbers.
pub fn copy_some<T: Copy>(
    rows: impl ExactSizeIterator<Item = [T; 4]>,
    count: usize,
    out: *mut T,
    capacity: usize,
    stride: usize,
) -> Result<(), Failure> {
    match count {
        1 => copy_rows(rows.map(|[a, ..]| [a]), out, capacity, stride),
        2 => copy_rows(rows.map(|[a, b, ..]| [a, b]), out, capacity, stride),
        3 => copy_rows(rows.map(|[a, b, c, _]| [a, b, c]), out, capacity, stride),
        _ => copy_rows(rows, out, capacity, stride),
    }
}
