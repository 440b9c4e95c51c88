//! Plans requests by joining byte ranges that lie near each other.
//!
//! A request costs about as much as a few kilobytes, but bytes between two ranges are wasted. So gaps are closed, the
//! smallest first: that wastes least for a given number of requests. Together they waste at most an eighth of the
//! wanted bytes ([`WANTED_PER_SMALL_WASTE`]), or half while a query takes more than [`FEW_REQUESTS`]
//! ([`WANTED_PER_WASTE`]). No gap is larger than [`MAX_GAP`].

use std::ops::Range;

/// Ranges that lie further apart are never joined.
const MAX_GAP: u64 = 16 << 10;
/// At least this many bytes are wanted for each one wasted, however many requests there are.
const WANTED_PER_WASTE: u64 = 2;
/// At least this many once there are few requests.
const WANTED_PER_SMALL_WASTE: u64 = 8;
/// Up to this many requests count as few.
const FEW_REQUESTS: usize = 10;
/// Joining makes no request larger than this, so that memory stays bounded.
const MAX_REQUEST: u64 = 16 << 20;

/// What earlier steps of the same question had to read.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Before {
    /// Size of the parts that were wanted.
    pub bytes: u64,
    /// Number of parts, which bounds the number of requests.
    pub parts: usize,
}

/// Joins ranges to requests, in order of offset. Empty ranges are left out; others may overlap.
pub(crate) fn plan(ranges: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    plan_after(Before::default(), ranges)
}

/// [`plan`] for the last ranges of a question, which may waste what earlier ones did not.
pub(crate) fn plan_after(before: Before, ranges: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let runs = touching(ranges);
    let wanted: u64 = runs.iter().fold(0, |sum, run| sum.saturating_add(run.end - run.start));
    let small_waste = wanted / WANTED_PER_SMALL_WASTE;
    let most_waste =
        (before.bytes.saturating_add(wanted) / WANTED_PER_WASTE).saturating_sub(before.bytes / WANTED_PER_SMALL_WASTE);
    let few = FEW_REQUESTS.saturating_sub(before.parts);
    // The gap before each run but the first.
    let mut gaps: Vec<u128> = (1..)
        .zip(runs.windows(2))
        .map(|(index, pair)| both(pair[1].start.saturating_sub(pair[0].end), index))
        .collect();
    gaps.sort_unstable();
    let mut is_closed = vec![false; runs.len()];
    let (mut waste, mut request_count) = (0_u64, runs.len());
    for [gap, index] in gaps.into_iter().map(apart) {
        let allowed = if request_count > few { most_waste } else { small_waste };
        waste = waste.saturating_add(gap);
        if gap > MAX_GAP || waste > allowed {
            break;
        }
        is_closed[index as usize] = true;
        request_count -= 1;
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

/// [`plan`] for few ranges of which each costs a step that somebody waits for: joins them, the smallest gaps first, as
/// long as all together stay within some bytes.
pub(crate) fn plan_within(bytes: u64, ranges: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let mut runs = plan(ranges);
    let mut sum: u64 = runs.iter().map(|run| run.end - run.start).sum();
    loop {
        let gaps = (1..).zip(runs.windows(2)).map(|(next, pair)| (pair[1].start.saturating_sub(pair[0].end), next));
        let Some((gap, next)) = gaps.min().filter(|(gap, _)| sum.saturating_add(*gap) <= bytes) else { return runs };
        sum += gap;
        let end = runs.remove(next).end;
        runs[next - 1].end = runs[next - 1].end.max(end);
    }
}

/// Ranges by ascending offset; adjacent ones become one. Only hostile files have ranges that overlap: these stay apart,
/// and bytes may be read twice.
fn touching(ranges: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let ranges = ranges.into_iter().filter(|range| !range.is_empty());
    let mut ranges: Vec<u128> = ranges.map(|range| both(range.start, range.end)).collect();
    ranges.sort_unstable();
    let mut runs: Vec<Range<u64>> = Vec::new();
    for [start, end] in ranges.into_iter().map(apart) {
        let range = start..end;
        match runs.last_mut() {
            Some(last) if range.start <= last.end && range.end.max(last.end) - last.start <= MAX_REQUEST => {
                last.end = last.end.max(range.end);
            }
            _ => runs.push(range),
        }
    }
    runs
}

/// Two numbers as one, so that one sort serves all pairs: it takes some kilobytes in a browser.
fn both(first: u64, second: u64) -> u128 {
    u128::from(first) << 64 | u128::from(second)
}

fn apart(both: u128) -> [u64; 2] {
    [(both >> 64) as u64, both as u64]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_ranges_are_joined_up_to_the_stated_waste() {
        assert_eq!(plan([]), []);
        assert_eq!(plan([5..5, 9..9]), []);
        assert_eq!(plan([10..20, 0..10, 15..30, 90..91]), [0..30, 90..91]);
        // 400 bytes wanted: gaps of 20 and 30 bytes are closed, that of 40 would be more than an eighth.
        assert_eq!(plan([0..100, 120..220, 250..350, 390..490]), [0..350, 390..490]);
        // With more requests than a few, up to half: each gap has 30 bytes.
        let many: Vec<Range<u64>> = (0..16).map(|k| k * 130..k * 130 + 100).collect();
        assert_eq!(plan(many.clone()).len(), 10);
        assert_eq!(plan_after(Before { bytes: 0, parts: 3 }, many.clone()).len(), 7);
        assert_eq!(plan_after(Before { bytes: 1000, parts: 99 }, many).len(), 1);
        // Far apart whatever is wanted.
        assert_eq!(plan([0..1 << 20, (1 << 20) + MAX_GAP + 1..2 << 20]).len(), 2);
        assert_eq!(plan([0..1 << 20, (1 << 20) + MAX_GAP..2 << 20]).len(), 1);
        // Requests stay bounded.
        assert_eq!(plan([0..MAX_REQUEST, MAX_REQUEST..MAX_REQUEST + 9]).len(), 2);
    }

    #[test]
    fn a_few_ranges_are_joined_as_long_as_all_are_small() {
        assert_eq!(plan_within(1000, []), []);
        let some = [100_000..100_300, 0..100, 300..400, 100_900..101_000];
        assert_eq!(plan_within(600, some.clone()), [0..100, 300..400, 100_000..100_300, 100_900..101_000]);
        assert_eq!(plan_within(800, some.clone()), [0..400, 100_000..100_300, 100_900..101_000]);
        assert_eq!(plan_within(1400, some.clone()), [0..400, 100_000..101_000]);
        assert_eq!(plan_within(101_000, some).len(), 1);
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
