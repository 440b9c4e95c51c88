//! Several devices draw one picture, each a part of it from left to right (Peng 2013, section 5.5).

/// What lies between two places of a picture, and what it takes to draw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreenLoad {
    /// Left and right end, 0 to 1 across the picture.
    pub interval: [f64; 2],
    /// Triangles, or a time; zero or more.
    pub cost: f64,
}

/// Where to cut a picture from left to right into parts that take equally long: one place less than parts, ascending.
/// What a cut crosses is drawn on both of its sides. The costliest of two parts costs as little as it can; more parts
/// come from halving.
///
/// The seed's algorithm 6 counts the loads on both sides eight times, each time nearer to the median. Here costs to the
/// left and to the right of every end of a load are sums over sorted ends, so one pass finds the best of all places.
pub fn balanced_cuts(loads: &[ScreenLoad], parts: usize) -> Vec<f64> {
    let is_sound = |load: &&ScreenLoad| {
        load.cost > 0.0 && load.cost.is_finite() && load.interval.iter().all(|place| place.is_finite())
    };
    let sound: Vec<ScreenLoad> = loads.iter().filter(is_sound).copied().collect();
    let mut cuts = Vec::new();
    cut(&sound, [0.0, 1.0], parts.min(MOST_PARTS), &mut cuts);
    cuts
}

/// As many devices as anybody has.
const MOST_PARTS: usize = 1024;

fn cut(loads: &[ScreenLoad], [from, to]: [f64; 2], parts: usize, cuts: &mut Vec<f64>) {
    if parts < 2 {
        return;
    }
    let left_parts = parts / 2;
    let shares = [left_parts, parts - left_parts].map(|parts| parts as f64);
    let at = best_cut(loads, [from, to], shares);
    let side =
        |keeps: &dyn Fn(&ScreenLoad) -> bool| loads.iter().filter(|load| keeps(load)).copied().collect::<Vec<_>>();
    cut(&side(&|load| load.interval[0] < at), [from, at], left_parts, cuts);
    cuts.push(at);
    cut(&side(&|load| load.interval[1] > at), [at, to], parts - left_parts, cuts);
}

/// The place at which the costlier side, each divided by its share, costs least. Without loads the middle.
fn best_cut(loads: &[ScreenLoad], [from, to]: [f64; 2], shares: [f64; 2]) -> f64 {
    let ends = |side: usize| {
        let mut ends: Vec<(f64, f64)> =
            loads.iter().map(|load| (load.interval[side].clamp(from, to), load.cost)).collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        ends
    };
    let (begins, ends) = (ends(0), ends(1));
    let mut places: Vec<f64> = begins.iter().chain(&ends).map(|&(place, _)| place).collect();
    places.sort_by(f64::total_cmp);
    places.dedup();
    let total: f64 = loads.iter().map(|load| load.cost).sum();
    let (mut begun, mut ended) = (begins.iter().peekable(), ends.iter().peekable());
    let (mut left, mut right) = (0.0, total);
    let mut best = (f64::INFINITY, from + (to - from) * shares[0] / (shares[0] + shares[1]));
    for place in places {
        while let Some((_, cost)) = begun.next_if(|(begin, _)| *begin < place) {
            left += cost;
        }
        while let Some((_, cost)) = ended.next_if(|(end, _)| *end <= place) {
            right -= cost;
        }
        let worst = (left / shares[0]).max(right / shares[1]);
        if worst < best.0 {
            best = (worst, place);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Costs of the parts between cuts.
    fn costs(loads: &[ScreenLoad], cuts: &[f64]) -> Vec<f64> {
        let borders: Vec<f64> = [&[f64::NEG_INFINITY][..], cuts, &[f64::INFINITY]].concat();
        let part = |ends: &[f64]| {
            let meets = |load: &&ScreenLoad| load.interval[0] < ends[1] && load.interval[1] > ends[0];
            loads.iter().filter(meets).map(|load| load.cost).sum()
        };
        borders.windows(2).map(part).collect()
    }

    proptest! {
        #[test]
        fn no_cut_is_better(ends in proptest::collection::vec((0_u8..40, 1_u8..=20, 1_u8..50), 1..40)) {
            let load = |&(begin, length, cost): &(u8, u8, u8)| {
                let begin = f64::from(begin) / 40.0;
                ScreenLoad { interval: [begin, (begin + f64::from(length) / 40.0).min(1.0)], cost: cost.into() }
            };
            let loads: Vec<ScreenLoad> = ends.iter().map(load).collect();
            let worst = |cuts: &[f64]| costs(&loads, cuts).into_iter().fold(0.0, f64::max);
            let found = worst(&balanced_cuts(&loads, 2));
            let best = (0..=1640).map(|k| worst(&[f64::from(k) / 1640.0])).fold(f64::INFINITY, f64::min);
            prop_assert!(found <= best, "{found} {best}");
        }
    }

    #[test]
    fn three_parts_share_what_is_spread_evenly_and_nonsense_is_left_out() {
        let load = |k: u32| ScreenLoad { interval: [k, k + 1].map(|k| f64::from(k) / 300.0), cost: 2.0 };
        let mut loads: Vec<ScreenLoad> = (0..300).map(load).collect();
        loads.push(ScreenLoad { interval: [f64::NAN, 1.0], cost: 1.0 });
        loads.push(ScreenLoad { interval: [0.0, 1.0], cost: f64::INFINITY });
        let cuts = balanced_cuts(&loads, 3);
        assert!(
            cuts.len() == 2 && (cuts[0] - 1.0 / 3.0).abs() < 0.01 && (cuts[1] - 2.0 / 3.0).abs() < 0.01,
            "{cuts:?}"
        );
        assert_eq!(balanced_cuts(&[], 2), [0.5]);
        assert!(balanced_cuts(&loads, 1).is_empty() && balanced_cuts(&loads, 0).is_empty());
        assert!(balanced_cuts(&loads, usize::MAX).is_sorted());
    }
}
