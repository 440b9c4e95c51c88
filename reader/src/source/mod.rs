//! Where the bytes of a file are.

mod counting;
mod fetched;
#[cfg(feature = "file")]
mod file;
#[cfg(feature = "http")]
mod http;
#[cfg(feature = "mmap")]
mod map;
#[cfg(feature = "object-store")]
mod object_store;
pub(crate) mod requests;

use std::io;

pub use counting::{Counting, Recording};
pub use fetched::Fetched;
#[cfg(feature = "http")]
pub use http::{Http, HttpOptions};
#[cfg(feature = "mmap")]
pub use map::Map;
#[cfg(feature = "object-store")]
pub use object_store::Object;

/// A range to be read.
#[derive(Debug)]
pub struct Request<'b> {
    /// Where it begins.
    pub offset: u64,
    /// What becomes of its bytes; says how many there are.
    pub buf: &'b mut [u8],
}

/// Bytes that can be read at any place. Sources over a network answer with a [`SourceError`] within the [`io::Error`] where
/// the other side is at fault.
pub trait ReadAt {
    /// Fills `buf` with the bytes from `offset` on.
    ///
    /// # Errors
    /// What the system says; [`io::ErrorKind::UnexpectedEof`] where the bytes end before.
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()>;

    /// How many bytes there are.
    ///
    /// # Errors
    /// What the system says.
    fn size(&self) -> io::Result<u64>;

    /// The first `length` bytes, or fewer if there are not so many, and how many there are in all. A source for which
    /// asking is expensive learns both from one request.
    ///
    /// # Errors
    /// As [`ReadAt::read_at`].
    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let size = self.size()?;
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(length).min(length)];
        self.read_at(0, &mut bytes)?;
        Ok((bytes, size))
    }

    /// Reads several ranges; they do not overlap. A source for which waiting is expensive asks for all at once.
    ///
    /// # Errors
    /// As [`ReadAt::read_at`], of any of them.
    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        requests.iter_mut().try_for_each(|request| self.read_at(request.offset, request.buf))
    }
}

/// What the other side of a network did wrong. It comes within an [`io::Error`]: see [`SourceError::of`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// It sends whole files only.
    #[error("the server ignores range requests; copy the file, or serve it from a server that knows them")]
    RangesIgnored,
    /// What lies there now is another file than the one that was opened.
    #[error("the file changed while it was read ({what}); open it again")]
    Changed {
        /// What differs: ETag, date or size.
        what: String,
    },
    /// It sent other bytes than those that were asked for.
    #[error("the server answered with other bytes than it was asked for: {what}")]
    WrongRange {
        /// What it said.
        what: String,
    },
    /// It announced a range and sent less.
    #[error("the server ended its answer after {found} of {expected} bytes")]
    Short {
        /// Bytes that were asked for.
        expected: u64,
        /// Bytes that came.
        found: u64,
    },
    /// What lies there is a page for people, such as a login, an error or the list of a folder.
    #[error(
        "the server answered with a web page ({what}) instead of a file; check the address, and whether it asks for a login"
    )]
    WebPage {
        /// The type that it names.
        what: String,
    },
    /// It refused.
    #[error("the server answered with status {status}{}", advice(*status))]
    Status {
        /// The HTTP status.
        status: u16,
    },
    /// It cannot be reached, or closed the connection.
    #[error("no connection to the server, or it was closed: {what}")]
    Closed {
        /// What the system said.
        what: String,
    },
    /// It did not answer in time.
    #[error("the server did not answer in time")]
    TimedOut,
}

/// What to do about an HTTP status.
fn advice(status: u16) -> &'static str {
    match status {
        401 => ": it asks for a login; use an address that needs none, as a signed one",
        403 => ": it does not let you read this; check your rights, or whether a signed address has expired",
        404 | 410 => ": there is no such file; check the address",
        408 | 429 => ": it is asked too much; try again later",
        500..=599 => ": it is in trouble; try again later, or ask whoever runs it",
        _ => "",
    }
}

impl SourceError {
    /// The source's own error within that of a read, if that is one.
    pub fn of(error: &io::Error) -> Option<&Self> {
        error.get_ref()?.downcast_ref()
    }

    /// Whether asking again may help.
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Short { .. } | Self::Closed { .. } | Self::TimedOut => true,
            Self::Status { status } => matches!(status, 408 | 429 | 500 | 502 | 503 | 504),
            Self::RangesIgnored | Self::WebPage { .. } | Self::Changed { .. } | Self::WrongRange { .. } => false,
        }
    }
}

impl From<SourceError> for io::Error {
    fn from(error: SourceError) -> Self {
        let kind = match &error {
            SourceError::Short { .. } => io::ErrorKind::UnexpectedEof,
            SourceError::Status { status: 404 } => io::ErrorKind::NotFound,
            SourceError::Status { status: 401 | 403 } => io::ErrorKind::PermissionDenied,
            SourceError::Closed { .. } => io::ErrorKind::ConnectionAborted,
            SourceError::TimedOut => io::ErrorKind::TimedOut,
            _ => io::ErrorKind::Other,
        };
        Self::new(kind, error)
    }
}

macro_rules! forward {
    ($($type:ty),*) => {$(
        impl<T: ReadAt + ?Sized> ReadAt for $type {
            fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
                (**self).read_at(offset, buf)
            }

            fn size(&self) -> io::Result<u64> {
                (**self).size()
            }

            fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
                (**self).read_start(length)
            }

            fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
                (**self).read_ranges(requests)
            }
        }
    )*};
}

forward!(&T, Box<T>, std::sync::Arc<T>);

impl ReadAt for [u8] {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(offset).map_err(|_| io::ErrorKind::UnexpectedEof)?;
        let bytes = start.checked_add(buf.len()).and_then(|end| self.get(start..end));
        buf.copy_from_slice(bytes.ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }
}

impl ReadAt for Vec<u8> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.as_slice().read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.len() as u64)
    }
}
