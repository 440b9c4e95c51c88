//! Bytes that have been read, by their offset in the file.

use std::ops::Range;

use crate::sorted::SortedMap;

/// Runs of a file's bytes, which a caller has read because they were [missing](crate::Error::Missing).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Fetched {
    /// By offset. No run lies within another or begins where another ends, so ends ascend too.
    runs: SortedMap<u64, Vec<u8>>,
}

impl Fetched {
    /// Adds the bytes from `offset` on.
    pub fn insert(&mut self, offset: u64, bytes: Vec<u8>) {
        let end = offset.saturating_add(bytes.len() as u64);
        if bytes.is_empty() || self.get(offset..end).is_some() {
            return;
        }
        let covered = |(&start, run): (&u64, &Vec<u8>)| (start + run.len() as u64 <= end).then_some(start);
        let within: Vec<u64> = self.runs.range(offset..end).filter_map(covered).collect();
        within.iter().for_each(|start| {
            self.runs.remove(start);
        });
        match offset.checked_sub(1).and_then(|before| self.runs.last_up_to_mut(&before)) {
            Some((start, before)) if start + before.len() as u64 == offset => before.extend(bytes),
            _ => {
                self.runs.insert(offset, bytes);
            }
        }
    }

    /// The bytes of a range, if all of them have been fetched.
    pub fn get(&self, range: Range<u64>) -> Option<&[u8]> {
        if range.is_empty() {
            return Some(&[]);
        }
        // Ends ascend, so no earlier run reaches further.
        let (start, run) = self.runs.last_up_to(&range.start)?;
        run.get(usize::try_from(range.start - start).ok()?..usize::try_from(range.end - start).ok()?)
    }

    /// The rest of a range that has not been fetched. Only its beginning may have been.
    pub(crate) fn rest_of(&self, range: Range<u64>) -> Range<u64> {
        let before = self.runs.last_up_to(&range.start);
        let known = before.map_or(0, |(start, run)| start + run.len() as u64);
        known.clamp(range.start, range.end)..range.end
    }

    /// The ranges that have been fetched, ascending.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = Range<u64>> + '_ {
        self.runs.iter().map(|(&start, run)| start..start + run.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back_and_neighbouring_runs_are_one() {
        let bytes: Vec<u8> = (0..100).collect();
        let mut fetched = Fetched::default();
        for range in [10..20_usize, 20..25, 12..15, 40..50, 38..60, 0..5, 60..70] {
            fetched.insert(range.start as u64, bytes[range].to_vec());
        }
        assert_eq!(fetched.ranges().collect::<Vec<_>>(), [0..5, 10..25, 38..70]);
        for start in 0..80_usize {
            for end in start..80 {
                let all = start == end || [0..5, 10..25, 38..70].iter().any(|run| run.start <= start && end <= run.end);
                let found = fetched.get(start as u64..end as u64);
                assert_eq!(found, all.then_some(&bytes[start..end]));
            }
        }
        assert_eq!(fetched.rest_of(20..30), 25..30);
        assert_eq!(fetched.rest_of(25..30), 25..30);
        assert_eq!(fetched.rest_of(12..20), 20..20);
        assert_eq!(Fetched::default().rest_of(3..9), 3..9);
    }
}
