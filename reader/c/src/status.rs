//! Statuses, messages, and panics, none of which gets out.

use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Who has to act to make a call succeed.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// All went well.
    Ok = 0,
    /// The bytes could not be read: a disk, a server, a network or the caller's own function failed.
    Source = 1,
    /// The file is damaged, or not a lodpack file.
    Format = 2,
    /// The file is sound but needs a newer lodpack.
    Unsupported = 3,
    /// The query asks for something impossible.
    Query = 4,
    /// The file asks for more than lodpack allows files from untrusted places.
    Limit = 5,
    /// An argument cannot be meant: a null pointer, too little room.
    Argument = 6,
    /// lodpack has a defect. The handles of the call should only be freed.
    Internal = 7,
}

/// Why a call failed.
pub struct Failure {
    status: Status,
    message: String,
}

impl Failure {
    /// A null pointer where there has to be something.
    pub fn null(name: &str) -> Self {
        Self::argument(format!("{name} is a null pointer"))
    }

    /// An argument that cannot be meant.
    pub fn argument(message: String) -> Self {
        Self { status: Status::Argument, message }
    }

    /// A cut of a mesh for a file of heights, or the other way round: what the reader says of cuts of other files.
    pub fn other_cut() -> Self {
        Self { status: Status::Query, message: "this cut is one of another file; select it in this one".into() }
    }

    /// Adds the name of the file.
    pub fn of(self, name: &str) -> Self {
        Self { message: format!("{name}: {}", self.message), ..self }
    }
}

impl From<lodpack::Error> for Failure {
    fn from(error: lodpack::Error) -> Self {
        let status = match error {
            lodpack::Error::Io { .. } => Status::Source,
            lodpack::Error::Format { .. } => Status::Format,
            lodpack::Error::Unsupported { .. } => Status::Unsupported,
            lodpack::Error::Query { .. } => Status::Query,
            lodpack::Error::Limit { .. } => Status::Limit,
            // The others concern writing, and programs that read bytes themselves.
            _ => Status::Internal,
        };
        Self { status, message: error.to_string() }
    }
}

impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        Self { status: Status::Source, message: error.to_string() }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Does the work of a call: whatever happens in it becomes a status and a message.
pub fn guard(work: impl FnOnce() -> Result<(), Failure>) -> Status {
    // What a panic leaves behind is only freed: the status says so.
    let done = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        Err(Failure { status: Status::Internal, message: "a defect of lodpack: please report it with the file".into() })
    });
    let (status, message) = match done {
        Ok(()) => (Status::Ok, String::new()),
        Err(Failure { status, message }) => (status, message),
    };
    LAST.with_borrow_mut(|last| *last = CString::new(message.replace('\0', " ")).unwrap_or_default());
    status
}

/// What went wrong in this thread's last call that returned a status: a text that is valid until the thread's next such
/// call, and empty if nothing went wrong.
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "the name is C's")]
pub extern "C" fn lodpack_last_error() -> *const c_char {
    LAST.with_borrow(|last| last.as_ptr())
}

/// The version of this library, such as "0.1.0".
#[unsafe(no_mangle)]
#[expect(unsafe_code, reason = "the name is C's")]
pub extern "C" fn lodpack_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => c"",
    };
    VERSION.as_ptr()
}
