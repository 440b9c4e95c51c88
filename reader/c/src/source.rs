//! Files that the caller reads.
#![expect(unsafe_code, reason = "C hands over a function")]

use lodpack::ReadAt;
use std::ffi::{c_int, c_void};
use std::io;

/// A file that the caller reads, such as one in an archive of assets.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct Source {
    /// What `read` is called with. It has to stay valid until the file is closed.
    pub context: *mut c_void,
    /// Fills `buffer` with `length` bytes from `offset` on, and returns 0, or anything else if it cannot. It is called
    /// in the threads that call functions with the file, so by several at once if these do; it must not unwind.
    pub read: Option<unsafe extern "C" fn(context: *mut c_void, offset: u64, buffer: *mut u8, length: usize) -> c_int>,
    /// Number of bytes of the file.
    pub size: u64,
}

// SAFETY: `context` is only handed to `read`, which the header asks to work in several threads.
unsafe impl Send for Source {}
// SAFETY: as above.
unsafe impl Sync for Source {}

impl ReadAt for Source {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        if offset.checked_add(buf.len() as u64).is_none_or(|end| end > self.size) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let read = self.read.ok_or_else(|| io::Error::other("the source has no function that reads"))?;
        // SAFETY: the header asks for a function that fills what it is given, and `buf` has the length that it is told.
        match unsafe { read(self.context, offset, buf.as_mut_ptr(), buf.len()) } {
            0 => Ok(()),
            status => Err(io::Error::other(format!("the program's own function returned {status}"))),
        }
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.size)
    }
}
