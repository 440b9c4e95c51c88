//! Nested groups of charts: the shape of the tree above them, from places and sizes alone.
//!
//! A set of charts is cut across an axis where few arcs join both sides, into parts of about equal size, and so on:
//! from the top, so that groups are compact however many there are. A group of height h holds about 4^h charts of
//! average size; charts that are smaller, such as the parts of a scene, come in larger numbers.

use glam::DVec3;
use std::cmp::Ordering;

/// How far the share of a half may be from what it should be, over the smaller of both halves' shares.
const SLACK: f64 = 0.3;
/// Parts of a group grow by this factor over their share before there is one more of them.
const GROWTH: f64 = 1.15;
/// Triangles of a group over those of its members, each at its level.
const FANOUT: f64 = 4.0;

/// What is known of charts.
pub struct Charts<'a> {
    /// Their sizes.
    pub weights: &'a [u64],
    /// Their middles.
    pub centres: &'a [DVec3],
    /// Pairs that share an arc, once for each arc.
    pub pairs: &'a [[u32; 2]],
}

/// The number of heights above charts of this weight in all, where one should have `unit`; none above a single chart.
pub fn heights(charts: u64, weight: u64, unit: f64) -> u32 {
    let above = |&height: &u32| weight as f64 <= size(unit, height);
    if charts < 2 { 0 } else { (1..).find(above).unwrap_or(1) }
}

/// The weight of a group of a height, where a chart has the weight `unit`.
pub fn size(unit: f64, height: u32) -> f64 {
    (0..height).fold(unit, |size, _| size * FANOUT)
}

/// The groups of each height, lowest first: for each group its members, which are groups of the height below, or
/// charts.
pub fn group(charts: &Charts, unit: f64) -> Vec<Vec<Vec<u32>>> {
    let count = charts.weights.len();
    let mut halving = Halving::new(charts);
    let total = charts.weights.iter().sum();
    let mut sets = vec![(0..count as u32).collect::<Vec<u32>>()];
    let mut result = vec![];
    for height in (1..=heights(count as u64, total, unit)).rev() {
        if height == 1 {
            result.push(sets);
            break;
        }
        let (mut members, mut parts) = (vec![], vec![]);
        for set in sets {
            let first = parts.len() as u32;
            let share = halving.weight(&set) as f64 / (size(unit, height - 1) * GROWTH);
            halving.divide(set, (share.ceil() as usize).max(1), &mut parts);
            members.push((first..parts.len() as u32).collect());
        }
        result.push(members);
        sets = parts;
    }
    result.reverse();
    result
}

/// Divides charts into the given number of sets of about equal weight, or fewer if there are fewer charts.
pub fn divide(charts: &Charts, sets: usize) -> Vec<Vec<u32>> {
    let mut result = vec![];
    if !charts.weights.is_empty() {
        Halving::new(charts).divide((0..charts.weights.len() as u32).collect(), sets, &mut result);
    }
    result
}

struct Halving<'a> {
    charts: &'a Charts<'a>,
    neighbours: Vec<Vec<u32>>,
    /// Places of the charts of the set that is being cut.
    places: Vec<Option<u32>>,
}

impl<'a> Halving<'a> {
    fn new(charts: &'a Charts) -> Self {
        let count = charts.weights.len();
        let mut this = Self { charts, neighbours: vec![vec![]; count], places: vec![None; count] };
        for &[a, b] in charts.pairs {
            this.neighbours[a as usize].push(b);
            this.neighbours[b as usize].push(a);
        }
        this
    }

    fn weight(&self, set: &[u32]) -> u64 {
        set.iter().map(|&chart| self.charts.weights[chart as usize]).sum()
    }

    /// Divides a set into the given number of parts, or fewer if there are fewer charts.
    fn divide(&mut self, mut set: Vec<u32>, parts: usize, out: &mut Vec<Vec<u32>>) {
        if parts < 2 || set.len() < 2 {
            out.push(set);
            return;
        }
        let lower = parts / 2;
        let (axis, size) = self.fewest_arcs(&mut set, lower as f64 / parts as f64);
        self.sort_along(axis, &mut set);
        let upper = set.split_off(size);
        self.divide(set, lower, out);
        self.divide(upper, parts - lower, out);
    }

    /// The axis across which to cut a set, and how many charts to leave on the lower side, which should have this share
    /// of the weight.
    fn fewest_arcs(&mut self, set: &mut [u32], share: f64) -> (usize, usize) {
        let total = self.weight(set) as f64;
        let slack = SLACK * share.min(1.0 - share);
        // Cut arcs count as long as the share is near; else the nearest share does. Where no arc would be cut, the set
        // is halved across its longest side.
        let mut best = ((f64::INFINITY, i64::MAX, f64::INFINITY), 0, 1);
        let extent = self.extent(set);
        for axis in 0..3 {
            self.sort_along(axis, set);
            (0..).zip(set.iter()).for_each(|(place, &chart)| self.places[chart as usize] = Some(place));
            let (mut cut, mut below) = (0, 0);
            for (place, &chart) in (0..).zip(set.iter().take(set.len() - 1)) {
                for &neighbour in &self.neighbours[chart as usize] {
                    cut += match self.places[neighbour as usize] {
                        Some(other) if other > place => 1,
                        Some(other) if other < place => -1,
                        _ => 0,
                    };
                }
                below += self.charts.weights[chart as usize];
                let off = (below as f64 / total.max(1.0) - share).abs();
                let longer = (0..3).filter(|&other| extent[other] > extent[axis]).count();
                let rank =
                    (if off <= slack { 0.0 } else { off }, cut, if cut == 0 { longer as f64 + off } else { 0.0 });
                if rank.partial_cmp(&best.0).is_some_and(Ordering::is_lt) {
                    best = (rank, axis, place as usize + 1);
                }
            }
        }
        set.iter().for_each(|&chart| self.places[chart as usize] = None);
        (best.1, best.2)
    }

    /// The size of the box around the middles of a set.
    fn extent(&self, set: &[u32]) -> DVec3 {
        let middles = || set.iter().map(|&chart| self.charts.centres[chart as usize]);
        let low = middles().reduce(DVec3::min).unwrap_or_default();
        middles().reduce(DVec3::max).unwrap_or_default() - low
    }

    fn sort_along(&self, axis: usize, set: &mut [u32]) {
        let at = |chart: u32| self.charts.centres[chart as usize][axis];
        set.sort_unstable_by(|&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_of_charts_is_grouped_by_fours() {
        // A sheet of 16 by 16 charts, in a scattered order.
        let place = |chart: u32| [chart * 7 % 256 % 16, chart * 7 % 256 / 16];
        let chart_at = |x: u32, y: u32| (0..256).find(|&chart| place(chart) == [x, y]);
        let mut pairs = vec![];
        for chart in 0..256 {
            let [x, y] = place(chart);
            pairs.extend([(x + 1, y), (x, y + 1)].into_iter().filter_map(|(x, y)| Some([chart, chart_at(x, y)?])));
        }
        let centres: Vec<DVec3> =
            (0..256).map(|chart| DVec3::new(f64::from(place(chart)[0]), f64::from(place(chart)[1]), 0.0)).collect();
        let groups = group(&Charts { weights: &[100; 256], centres: &centres, pairs: &pairs }, 100.0);
        let counts: Vec<usize> = groups.iter().map(Vec::len).collect();
        assert!((56..=64).contains(&counts[0]) && counts[1..] == [16, 4, 1], "{counts:?}");
        assert!(groups.iter().flatten().all(|members| (2..=6).contains(&members.len())));
        // Squares of charts have the shortest outlines.
        for members in &groups[0] {
            let inside = pairs.iter().filter(|pair| pair.iter().all(|chart| members.contains(chart)));
            assert!(inside.count() >= members.len() - 1);
        }
        for (members, below) in groups.iter().skip(1).zip([counts[0] as u32, 16, 4]) {
            let mut all: Vec<u32> = members.concat();
            all.sort_unstable();
            assert!(all.into_iter().eq(0..below));
        }
    }

    #[test]
    fn many_small_charts_make_few_groups_and_one_makes_none() {
        let centres: Vec<DVec3> = (0..1000).map(|i| DVec3::splat(f64::from(i))).collect();
        let weights = vec![1; 1000];
        let groups = group(&Charts { weights: &weights, centres: &centres, pairs: &[] }, 100.0);
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [3, 1]);
        assert!(groups[0].iter().all(|members| (200..500).contains(&members.len())));
        assert!(group(&Charts { weights: &[5], centres: &centres[..1], pairs: &[] }, 1.0).is_empty());
        assert_eq!(group(&Charts { weights: &[5, 900], centres: &centres[..2], pairs: &[] }, 1.0).len(), 5);
    }
}
