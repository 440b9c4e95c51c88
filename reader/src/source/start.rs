//! The beginning of a file that is far away, which opening has brought already: a first picture lies there.

use std::{
    ops::Range,
    sync::{Mutex, PoisonError},
};

/// More is not kept.
const MOST_BYTES: usize = 64 << 10;
/// After this many reads the beginning is forgotten.
const MOST_READS: usize = 64;

/// The bytes of the first read. Each is handed out once: what is asked for again was damaged on the way, and has to be
/// fetched anew.
#[derive(Debug, Default)]
pub(super) struct Start(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    bytes: Vec<u8>,
    given: Vec<Range<usize>>,
}

impl Start {
    /// Keeps the first bytes of the file.
    pub fn keep(&self, bytes: &[u8]) {
        if bytes.len() <= MOST_BYTES {
            *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Kept { bytes: bytes.to_vec(), given: Vec::new() };
        }
    }

    /// Fills `buf` with the bytes from `offset` on, if all of them are here and none was handed out before.
    pub fn fill(&self, offset: u64, buf: &mut [u8]) -> bool {
        let kept = &mut *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(range) = usize::try_from(offset).ok().and_then(|first| Some(first..first.checked_add(buf.len())?))
        else {
            return false;
        };
        let Some(bytes) = kept.bytes.get(range.clone()) else { return false };
        if buf.is_empty() || kept.given.iter().any(|given| given.start < range.end && range.start < given.end) {
            return false;
        }
        buf.copy_from_slice(bytes);
        kept.given.push(range);
        if kept.given.len() == MOST_READS {
            *kept = Kept::default();
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_byte_is_handed_out_once() {
        let start = Start::default();
        let mut buf = [0; 3];
        assert!(!start.fill(0, &mut buf));
        start.keep(&[1, 2, 3, 4, 5, 6, 7]);
        assert!(!start.fill(5, &mut buf) && !start.fill(u64::MAX, &mut buf) && !start.fill(0, &mut []));
        assert!(start.fill(2, &mut buf));
        assert_eq!(buf, [3, 4, 5]);
        assert!(!start.fill(2, &mut buf) && !start.fill(4, &mut buf) && !start.fill(0, &mut buf));
        assert!(start.fill(0, &mut buf[..2]) && start.fill(5, &mut buf[..2]));
        assert_eq!(buf, [6, 7, 5]);
        start.keep(&vec![1; MOST_BYTES]);
        assert_eq!((0..100).filter(|&at| start.fill(at, &mut [0])).count(), MOST_READS);
    }
}
