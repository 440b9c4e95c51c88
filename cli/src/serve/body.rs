//! What follows the head of an answer.

use super::clients::Busy;
use hyper::body::{Body, Bytes, Frame, SizeHint};
use std::io::{self, Seek, SeekFrom};
use std::ops::Range;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use tokio::io::{AsyncRead, ReadBuf};

/// Bytes that are read of a file at once.
const CHUNK: usize = 64 << 10;

/// What is sent.
#[derive(Debug)]
pub(super) enum Content {
    Bytes(Bytes),
    /// A part of a file, from where it stands on.
    File(std::fs::File, u64),
}

impl Content {
    /// A range of a file.
    pub fn of_file(mut file: std::fs::File, range: Range<u64>) -> io::Result<Self> {
        file.seek(SeekFrom::Start(range.start))?;
        Ok(Self::File(file, range.end - range.start))
    }

    /// In bytes.
    pub fn length(&self) -> u64 {
        match self {
            Self::Bytes(bytes) => bytes.len() as u64,
            Self::File(_, length) => *length,
        }
    }
}

/// Content while it is being sent.
#[derive(Debug)]
pub(super) struct Sent {
    source: Source,
    left: u64,
    _busy: Busy,
}

#[derive(Debug)]
enum Source {
    Bytes(Bytes),
    File(tokio::fs::File, Vec<u8>),
}

impl Sent {
    pub fn new(content: Content, busy: Busy) -> Self {
        let left = content.length();
        let source = match content {
            Content::Bytes(bytes) => Source::Bytes(bytes),
            Content::File(file, _) => Source::File(tokio::fs::File::from_std(file), vec![0; CHUNK]),
        };
        Self { source, left, _busy: busy }
    }
}

impl Body for Sent {
    type Data = Bytes;
    type Error = io::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<io::Result<Frame<Bytes>>>> {
        let this = &mut *self;
        if this.left == 0 {
            return Poll::Ready(None);
        }
        let bytes = match &mut this.source {
            Source::Bytes(bytes) => std::mem::take(bytes),
            Source::File(file, buffer) => {
                let most = usize::try_from(this.left).unwrap_or(usize::MAX).min(buffer.len());
                let mut read = ReadBuf::new(&mut buffer[..most]);
                ready!(Pin::new(file).poll_read(cx, &mut read))?;
                Bytes::copy_from_slice(read.filled())
            }
        };
        if bytes.is_empty() {
            // The file has become shorter: the client has to notice.
            return Poll::Ready(Some(Err(io::ErrorKind::UnexpectedEof.into())));
        }
        this.left = this.left.saturating_sub(bytes.len() as u64);
        Poll::Ready(Some(Ok(Frame::data(bytes))))
    }

    fn is_end_stream(&self) -> bool {
        self.left == 0
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.left)
    }
}
