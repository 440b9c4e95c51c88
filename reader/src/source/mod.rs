//! Sources of a file's bytes: memory, files, web servers, object stores.

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
#[cfg(any(feature = "http", feature = "object-store"))]
mod start;
mod within;

use std::{io, ops::Range};

pub use counting::{Counting, Recording};
pub use fetched::Fetched;
#[cfg(feature = "http")]
pub use http::{Http, HttpOptions};
#[cfg(feature = "mmap")]
pub use map::Map;
#[cfg(feature = "object-store")]
pub use object_store::Object;
pub use within::Within;

use crate::error::{Error, Result};

/// A range to read.
#[derive(Debug)]
pub struct Request<'b> {
    /// Where it begins.
    pub offset: u64,
    /// Takes the bytes; its length is the length of the range.
    pub buf: &'b mut [u8],
}

/// Bytes that can be read at any offset. Where the other side of a network is at fault, the [`io::Error`] holds a
/// [`SourceError`].
pub trait ReadAt {
    /// Fills `buf` with the bytes from `offset` on.
    ///
    /// # Errors
    /// The system's error; [`io::ErrorKind::UnexpectedEof`] if the bytes end too early.
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()>;

    /// The number of bytes.
    ///
    /// # Errors
    /// The system's error.
    fn size(&self) -> io::Result<u64>;

    /// The first `length` bytes, fewer if the source is shorter, and the number of bytes in all. A source whose
    /// requests are slow learns both from one request.
    ///
    /// # Errors
    /// As [`ReadAt::read_at`].
    fn read_start(&self, length: usize) -> io::Result<(Vec<u8>, u64)> {
        let size = self.size()?;
        let mut bytes = vec![0; usize::try_from(size).unwrap_or(length).min(length)];
        self.read_at(0, &mut bytes)?;
        Ok((bytes, size))
    }

    /// Reads several ranges, which do not overlap. A source whose requests are slow sends them all at once.
    ///
    /// # Errors
    /// As [`ReadAt::read_at`], for any of them.
    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        requests.iter_mut().try_for_each(|request| self.read_at(request.offset, request.buf))
    }
}

/// What the other side of a network did wrong. An [`io::Error`] holds it: see [`SourceError::of`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The server sends only whole files.
    #[error("the server ignores range requests; copy the file, or serve it from a server that supports them")]
    RangesIgnored,
    /// The file at this address is no longer the one that was opened.
    #[error("the file changed while it was read ({what}); open it again")]
    Changed {
        /// What differs: ETag, date or size.
        what: String,
    },
    /// The server sent a different range.
    #[error("the server sent a different range than requested: {what}")]
    WrongRange {
        /// The range that it sent.
        what: String,
    },
    /// The server announced a range and sent less.
    #[error("the server ended its answer after {found} of {expected} bytes")]
    Short {
        /// Bytes requested.
        expected: u64,
        /// Bytes received.
        found: u64,
    },
    /// The server sent a web page instead, such as a login, an error or a directory listing.
    #[error(
        "the server answered with a web page ({what}) instead of a file; check the address, and whether it requires a login"
    )]
    WebPage {
        /// The page's content type.
        what: String,
    },
    /// The server sends to another host, which nobody asked for.
    #[error("the server redirects to another host; open {to} instead, if you trust it")]
    Redirected {
        /// The address that it names.
        to: String,
    },
    /// The server refused.
    #[error("the server answered with status {status}{}", advice(*status))]
    Status {
        /// The HTTP status.
        status: u16,
    },
    /// The server cannot be reached, or it closed the connection.
    #[error("cannot connect to the server, or it closed the connection: {what}")]
    Closed {
        /// The system's reason.
        what: String,
    },
    /// The server did not answer in time.
    #[error("the server did not answer in time")]
    TimedOut,
}

/// What to do about an HTTP status.
fn advice(status: u16) -> &'static str {
    match status {
        401 => ": it requires a login; use an address that needs none, such as a signed one",
        403 => ": it does not let you read this; check your rights, or whether a signed address has expired",
        404 | 410 => ": the file does not exist; check the address",
        408 | 429 => ": it is overloaded; try again later",
        500..=599 => ": it failed; try again later, or ask whoever runs it",
        _ => "",
    }
}

impl SourceError {
    /// The source error that a read's error holds, if it holds one.
    pub fn of(error: &io::Error) -> Option<&Self> {
        error.get_ref()?.downcast_ref()
    }

    /// Whether a second attempt may succeed.
    pub fn is_transient(&self) -> bool {
        match self {
            Self::Short { .. } | Self::Closed { .. } | Self::TimedOut => true,
            Self::Status { status } => matches!(status, 408 | 429 | 500 | 502 | 503 | 504),
            Self::RangesIgnored
            | Self::WebPage { .. }
            | Self::Changed { .. }
            | Self::WrongRange { .. }
            | Self::Redirected { .. } => false,
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

/// Reads ranges of a source. Checked records and limits bound their lengths.
pub(crate) fn read_ranges(source: &impl ReadAt, ranges: &[Range<u64>]) -> Result<Vec<(u64, Vec<u8>)>> {
    let (offset, length) =
        (ranges.first().map_or(0, |range| range.start), ranges.iter().map(|r| r.end - r.start).sum());
    let io = |source: io::Error| match source.kind() {
        io::ErrorKind::UnexpectedEof if SourceError::of(&source).is_none() => {
            Error::format("the file is truncated").at(|| format!("{length} bytes at offset {offset}"))
        }
        _ => Error::Io { offset, length, source },
    };
    let mut buffers = Vec::with_capacity(ranges.len());
    for range in ranges {
        let count = usize::try_from(range.end - range.start);
        buffers.push(vec![0; count.map_err(|_| io(io::ErrorKind::OutOfMemory.into()))?]);
    }
    let mut requests: Vec<Request<'_>> =
        ranges.iter().zip(&mut buffers).map(|(range, buf)| Request { offset: range.start, buf }).collect();
    source.read_ranges(&mut requests).map_err(io)?;
    Ok(ranges.iter().map(|range| range.start).zip(buffers).collect())
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
