//! A part of another source.

use std::{
    io::{self, ErrorKind},
    ops::Range,
};

use super::{ReadAt, Request};

/// A run of the bytes of another source, which begins at offset 0 here.
#[derive(Clone, Debug)]
pub struct Within<S> {
    source: S,
    range: Range<u64>,
}

impl<S> Within<S> {
    /// These bytes of `source`. A range that goes backwards is empty.
    pub fn new(source: S, range: Range<u64>) -> Self {
        Self { source, range: range.start..range.end.max(range.start) }
    }

    /// The source of which it is a part.
    pub fn source(&self) -> &S {
        &self.source
    }

    /// The bytes of the source that it shows.
    pub fn range(&self) -> Range<u64> {
        self.range.clone()
    }

    /// Where bytes are in the source; nothing is read beyond the end of the part.
    fn offset_of(&self, offset: u64, length: usize) -> io::Result<u64> {
        let first = self.range.start.checked_add(offset);
        let end = first.and_then(|first| first.checked_add(length as u64));
        match (first, end) {
            (Some(first), Some(end)) if end <= self.range.end => Ok(first),
            _ => Err(ErrorKind::UnexpectedEof.into()),
        }
    }
}

impl<S: ReadAt> ReadAt for Within<S> {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.source.read_at(self.offset_of(offset, buf.len())?, buf)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.range.end - self.range.start)
    }

    fn read_ranges(&self, requests: &mut [Request<'_>]) -> io::Result<()> {
        let mut moved = Vec::with_capacity(requests.len());
        for Request { offset, buf } in requests {
            moved.push(Request { offset: self.offset_of(*offset, buf.len())?, buf });
        }
        self.source.read_ranges(&mut moved)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_begins_at_zero_and_ends_where_it_ends() {
        let part = Within::new((0..10).collect::<Vec<u8>>(), 3..7);
        assert_eq!(part.read_start(100).unwrap(), (vec![3, 4, 5, 6], 4));
        let (mut one, mut two) = ([0; 1], [0; 2]);
        let requests = &mut [Request { offset: 0, buf: &mut one }, Request { offset: 2, buf: &mut two }];
        part.read_ranges(requests).unwrap();
        assert_eq!((one, two), ([3], [5, 6]));
        assert!(part.read_at(3, &mut two).is_err() && part.read_at(u64::MAX, &mut one).is_err());
        let [first, last] = [2, 1];
        assert!(Within::new(&[1u8, 2][..], first..last).read_at(0, &mut one).is_err());
    }
}
