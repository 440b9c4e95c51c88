//! Opening a file of either kind: of a mesh, or of heights.

use std::sync::Arc;

use crate::{
    error::{Error, Result},
    file::File,
    heights::{Heights, HeightsIndex},
    index::{Index, Opener},
    limits::Limits,
    source::{ReadAt, read_ranges},
};

/// An open file of either kind.
#[derive(Debug)]
pub enum Opened<S> {
    /// It holds a mesh.
    Mesh(File<S>),
    /// It holds a grid of heights.
    Heights(Heights<S>),
}

/// The index of a file of either kind.
#[derive(Debug)]
pub enum OpenedIndex {
    /// Of a mesh.
    Mesh(Arc<Index>),
    /// Of a grid of heights.
    Heights(Arc<HeightsIndex>),
}

impl OpenedIndex {
    /// The index of the file that is being opened, or [`Error::Missing`] with the ranges to read first: as
    /// [`Opener::finish`], for either kind.
    ///
    /// # Errors
    /// As [`Opener::finish`], without [`Error::Query`].
    pub fn new(opener: &Opener) -> Result<Self> {
        match HeightsIndex::is_in(opener)? {
            true => HeightsIndex::new(opener).map(|index| Self::Heights(Arc::new(index))),
            false => opener.finish().map(|index| Self::Mesh(Arc::new(index))),
        }
    }
}

/// The size of the first read: a first picture of heights, and what a server sends at once, in ten packets.
const FIRST_READ_BYTES: u64 = 12 << 10;

impl<S: ReadAt> Opened<S> {
    /// Opens a file of either kind. The first request is for 12 KiB and tells the kind; a second one brings what else
    /// opening needs. Of heights the first one holds a first picture, too.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Format`] if the file is damaged or not whole, [`Error::Unsupported`] if it needs a newer
    /// reader,
    /// [`Error::Limit`].
    pub fn open(source: S, limits: Limits) -> Result<Self> {
        let length = FIRST_READ_BYTES;
        let io = |source| Error::Io { offset: 0, length, source };
        let (head, size) = source.read_start(length as usize).map_err(io)?;
        let mut opener = Opener::new(limits);
        opener.start(head, size);
        loop {
            match OpenedIndex::new(&opener) {
                Err(Error::Missing { ranges }) => {
                    read_ranges(&source, &ranges)?.into_iter().for_each(|(at, bytes)| opener.insert(at, bytes));
                }
                Ok(OpenedIndex::Mesh(index)) => return Ok(Self::Mesh(File::of(index, source))),
                Ok(OpenedIndex::Heights(index)) => return Ok(Self::Heights(Heights::of(index, source))),
                Err(error) => return Err(error),
            }
        }
    }
}
