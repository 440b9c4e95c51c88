//! Which requests bring a set of byte ranges: near ones are joined.
//!
//! A request costs about as much as some kilobytes, but bytes between two ranges are read for nothing. So gaps are closed,
//! the smallest first, as long as each is at most [`MAX_GAP`] and all of them at most half of what is wanted
//! ([`WANTED_PER_WASTE`]).

use std::ops::Range;

/// Ranges that lie further apart are never joined.
const MAX_GAP: u64 = 16 << 10;
/// For each byte that is read for nothing, at least this many are wanted.
const WANTED_PER_WASTE: u64 = 2;
/// A request is not extended beyond this size, so that memory stays bounded.
const MAX_REQUEST: u64 = 16 << 20;

/// Joins ranges to requests, in order of offset. Empty ranges are left out; others may overlap.
pub(crate) fn plan(ranges: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let mut ranges: Vec<Range<u64>> = ranges.into_iter().filter(|range| !range.is_empty()).collect();
    ranges.sort_unstable_by_key(|range| (range.start, range.end));
    // What touches is one range; what overlaps stays apart only in hostile files, where it may be read twice.
    let mut runs: Vec<Range<u64>> = Vec::new();
    for range in ranges {
        match runs.last_mut() {
            Some(last) if range.start <= last.end && range.end.max(last.end) - last.start <= MAX_REQUEST => {
                last.end = last.end.max(range.end);
            }
            _ => runs.push(range),
        }
    }
    let wanted: u64 = runs.iter().fold(0, |sum, run| sum.saturating_add(run.end - run.start));
    let mut left = wanted / WANTED_PER_WASTE;
    // The gap before each run but the first.
    let mut gaps: Vec<(u64, usize)> =
        (1..).zip(runs.windows(2)).map(|(index, pair)| (pair[1].start.saturating_sub(pair[0].end), index)).collect();
    gaps.sort_unstable();
    let mut is_closed = vec![false; runs.len()];
    for (gap, index) in gaps {
        if gap > MAX_GAP || gap > left {
            break;
        }
        left -= gap;
        is_closed[index] = true;
    }
    let mut requests: Vec<Range<u64>> = Vec::new();
    for (run, is_closed) in runs.into_iter().zip(is_closed) {
        match requests.last_mut() {
            Some(last) if is_closed && run.end - last.start <= MAX_REQUEST => last.end = run.end,
            _ => requests.push(run),
        }
    }
    requests
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_ranges_are_joined_up_to_the_stated_waste() {
        assert_eq!(plan([]), []);
        assert_eq!(plan([5..5, 9..9]), []);
        assert_eq!(plan([10..20, 0..10, 15..30, 90..91]), [0..30, 90..91]);
        // 400 bytes wanted: the gaps of 60 and 90 bytes are closed, that of 100 would be too much.
        assert_eq!(plan([0..100, 160..260, 360..460, 550..650]), [0..260, 360..650]);
        // Far apart whatever is wanted.
        assert_eq!(plan([0..1 << 20, (1 << 20) + MAX_GAP + 1..2 << 20]).len(), 2);
        assert_eq!(plan([0..1 << 20, (1 << 20) + MAX_GAP..2 << 20]).len(), 1);
        // Requests stay bounded.
        assert_eq!(plan([0..MAX_REQUEST, MAX_REQUEST..MAX_REQUEST + 9]).len(), 2);
    }

    #[test]
    fn waste_is_at_most_half_of_what_is_wanted_and_everything_wanted_is_there() {
        let mut state = 7_u64;
        let mut below = |end: u64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) % end
        };
        for _ in 0..200 {
            let mut ranges = Vec::new();
            let mut next = 0;
            for _ in 0..below(40) {
                let start = next + 1 + below(3000);
                next = start + 1 + below(2000);
                ranges.push(start..next);
            }
            let requests = plan(ranges.clone());
            let size = |ranges: &[Range<u64>]| ranges.iter().map(|range| range.end - range.start).sum::<u64>();
            assert!(2 * size(&requests) <= 3 * size(&ranges));
            assert!(ranges.iter().all(|r| requests.iter().any(|q| q.start <= r.start && r.end <= q.end)));
        }
    }
}
