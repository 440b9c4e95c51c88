//! Stage **mip**, for arcs: nested dyadic samples of every arc, and the level at which each appears.
//!
//! An arc's parameter is fixed by halving: the vertex nearest to the middle of an interval (by arc length) gets the middle
//! parameter. So every sample is a vertex of the input, needs no resampling, and both neighbours agree on it. A sample
//! belongs to a level when the interval that it halves deviates from its chord by more than that level allows.

use crate::mesh::Mesh;
use crate::stage::arcs::Atlas;
use crate::stage::chart::NEVER;
use glam::DVec3;
use rayon::prelude::*;

/// Parameter units along an arc; the depth of halving is at most its binary logarithm.
pub const ARC_UNITS: u32 = 1 << 16;

/// Parameters and levels of the vertices of one arc's path.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledArc {
    /// Parameter of each path vertex, in units of 1 / [`ARC_UNITS`], strictly growing from 0 to `ARC_UNITS`. Samples have
    /// whole numbers.
    pub params: Vec<f64>,
    /// The coarsest level of each path vertex as a sample; 0 at both ends, [`NEVER`] where it is none.
    pub levels: Vec<u8>,
    /// For an inner path vertex that can be a sample: the path indices of the interval that it halves.
    pub intervals: Vec<Option<[u32; 2]>>,
}

impl SampledArc {
    /// Makes a path vertex a sample at `level` or coarser, and with it whatever nesting requires. Returns whether that changed
    /// anything; a vertex that no halving reached makes the nearest one that was reached a sample instead.
    pub fn raise(&mut self, path_index: usize, level: u8) -> bool {
        let mut changed = false;
        let mut pending = vec![path_index];
        while let Some(index) = pending.pop() {
            let Some(interval) = self.intervals[index] else { continue };
            if self.levels[index] <= level {
                continue;
            }
            self.levels[index] = level;
            changed = true;
            pending.extend(interval.map(|end| end as usize));
        }
        changed
    }
}

/// Samples every arc; `tolerances` holds the largest distance between arc and chord that each level allows, coarsest first.
/// What becomes of a seam depends on its path alone: neither region can ask for more later, so that the finest level has all
/// of its vertices.
pub fn sample_arcs(mesh: &Mesh, atlas: &Atlas, tolerances: &[f64]) -> Vec<SampledArc> {
    // Arcs with the same two ends would collapse onto one segment: their middle is kept at every level.
    let mut by_ends: Vec<([u32; 2], u32)> = atlas
        .arcs
        .iter()
        .enumerate()
        .map(|(i, arc)| ([arc.ends[0].min(arc.ends[1]), arc.ends[0].max(arc.ends[1])], i as u32))
        .collect();
    by_ends.sort_unstable();
    let mut parallel = vec![false; atlas.arcs.len()];
    for run in by_ends.chunk_by(|a, b| a.0 == b.0).filter(|run| run.len() > 1) {
        for &(_, arc) in run {
            parallel[arc as usize] = true;
        }
    }
    atlas
        .arcs
        .par_iter()
        .zip(parallel)
        .map(|(arc, keep_middle)| {
            let points: Vec<DVec3> = arc.path.iter().map(|&v| mesh.positions[v as usize]).collect();
            let mut sampled = sample_arc(&points, tolerances, keep_middle || arc.seam.is_some());
            if arc.seam.is_some() {
                let finest = tolerances.len().saturating_sub(1) as u8;
                for index in 1..points.len() - 1 {
                    sampled.raise(index, finest);
                }
            }
            sampled
        })
        .collect()
}

fn sample_arc(points: &[DVec3], tolerances: &[f64], keep_middle: bool) -> SampledArc {
    let last = points.len() - 1;
    let length = lengths_along(points);
    let mut arc = SampledArc {
        params: vec![0.0; points.len()],
        levels: vec![NEVER; points.len()],
        intervals: vec![None; points.len()],
    };
    arc.params[last] = f64::from(ARC_UNITS);
    (arc.levels[0], arc.levels[last]) = (0, 0);
    // Each entry: path indices and parameters of an interval, and the level of its halving's parent.
    let mut pending = vec![(0, last, 0u32, ARC_UNITS, 0u8)];
    while let Some((i, j, a, b, parent_level)) = pending.pop() {
        if j == i + 1 {
            continue;
        }
        if b - a == 1 {
            // The parameter has no room left; the vertices in between can never be samples.
            for m in i + 1..j {
                arc.params[m] = f64::from(a) + (m - i) as f64 / (j - i) as f64;
            }
            continue;
        }
        let m = middle_vertex(&length, i, j);
        let middle = a + (b - a) / 2;
        let deviation = chord_deviation(&points[i..=j]);
        let own_level = tolerances.iter().position(|&t| deviation > t).map_or(NEVER, |l| l as u8);
        let level = match keep_middle && (i, j) == (0, last) {
            true => 0,
            false => own_level.max(parent_level),
        };
        arc.params[m] = f64::from(middle);
        arc.levels[m] = level;
        arc.intervals[m] = Some([i as u32, j as u32]);
        pending.push((i, m, a, middle, level));
        pending.push((m, j, middle, b, level));
    }
    arc
}

fn lengths_along(points: &[DVec3]) -> Vec<f64> {
    let mut length = vec![0.0; points.len()];
    for i in 1..points.len() {
        length[i] = length[i - 1] + points[i].distance(points[i - 1]);
    }
    length
}

/// The inner vertex of an interval that is nearest to its middle by arc length.
fn middle_vertex(length: &[f64], i: usize, j: usize) -> usize {
    let half = 0.5 * (length[i] + length[j]);
    let after = i + 1 + length[i + 1..j].partition_point(|&s| s < half);
    if after == j || after > i + 1 && half - length[after - 1] < length[after] - half { after - 1 } else { after }
}

/// Where a path has to be divided into arcs, so that halving reaches all of its vertices: the ends, ascending, of the intervals
/// that have vertices in them when parameters have no room left. None for a path whose edges are of similar lengths.
pub(crate) fn intervals_too_deep(points: &[DVec3]) -> Vec<usize> {
    let last = points.len() - 1;
    let length = lengths_along(points);
    let mut ends = vec![];
    let mut pending = vec![(0, last, ARC_UNITS)];
    while let Some((i, j, units)) = pending.pop() {
        if j == i + 1 {
            continue;
        }
        if units == 1 {
            ends.extend([i, j]);
            continue;
        }
        let m = middle_vertex(&length, i, j);
        pending.extend([(i, m, units / 2), (m, j, units / 2)]);
    }
    ends.retain(|&end| end != 0 && end != last);
    ends.sort_unstable();
    ends.dedup();
    ends
}

/// Largest distance of the inner points from the segment between the first and the last.
fn chord_deviation(points: &[DVec3]) -> f64 {
    let (a, b) = (points[0], points[points.len() - 1]);
    let squared = points.iter().map(|&p| p.distance_squared(closest_on_segment(p, a, b).0)).fold(0.0, f64::max);
    squared.sqrt()
}

/// The closest point of segment `ab` to `p`, and its parameter in 0..=1.
pub(crate) fn closest_on_segment(p: DVec3, a: DVec3, b: DVec3) -> (DVec3, f64) {
    let direction = b - a;
    let squared = direction.length_squared();
    let t = if squared > 0.0 { ((p - a).dot(direction) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + direction * t, t)
}

/// How far the surface beside an arc can move when the arc is drawn with more samples than level `level` has.
///
/// The extra samples are matched with points of the coarser chords in monotone order; a fan triangle then moves by at most
/// what its samples move, because the matching is linear on each triangle. `samples` are (level, position) in order along the
/// arc, both ends (level 0) included.
pub fn border_deviation(samples: &[(u8, DVec3)], level: u8) -> f64 {
    let mut worst = 0.0f64;
    let mut start = 0;
    for end in 1..samples.len() {
        if samples[end].0 > level {
            continue;
        }
        let (a, b) = (samples[start].1, samples[end].1);
        let mut reached = 0.0f64;
        for &(_, p) in &samples[start + 1..end] {
            reached = reached.max(closest_on_segment(p, a, b).1);
            worst = worst.max(p.distance(a + (b - a) * reached));
        }
        start = end;
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_over_many_decades_are_divided_where_halving_ends() {
        let even: Vec<DVec3> = (0..1000).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(intervals_too_deep(&even).is_empty());
        let decades: Vec<DVec3> = (0..=48).map(|i| DVec3::X * 10f64.powf(f64::from(i) / 4.0 - 12.0)).collect();
        let cuts = intervals_too_deep(&decades);
        assert!(!cuts.is_empty() && cuts.iter().all(|&cut| 0 < cut && cut < 48), "{cuts:?}");
    }

    fn bend(n: usize) -> Vec<DVec3> {
        (0..=n).map(|i| i as f64 / n as f64 * 3.0).map(|x| DVec3::new(x, x.sin(), 0.0)).collect()
    }

    #[test]
    fn samples_are_nested_and_params_grow() {
        let arc = sample_arc(&bend(37), &[0.5, 0.1, 0.02, 0.001], false);
        assert!(arc.params.windows(2).all(|w| w[0] < w[1]));
        for (m, interval) in arc.intervals.iter().enumerate() {
            if let Some([i, j]) = *interval {
                assert!(arc.levels[m] >= arc.levels[i as usize].max(arc.levels[j as usize]));
                assert_eq!(arc.params[m], 0.5 * (arc.params[i as usize] + arc.params[j as usize]));
            }
        }
        assert!(arc.levels.contains(&2) && arc.levels.contains(&3));
    }

    #[test]
    fn a_straight_arc_needs_no_samples() {
        let line: Vec<DVec3> = (0..20).map(|i| DVec3::new(f64::from(i * i), 0.0, 0.0)).collect();
        let arc = sample_arc(&line, &[0.1, 0.01], false);
        assert!(arc.levels[1..19].iter().all(|&l| l == NEVER));
        assert_eq!(sample_arc(&line, &[0.1], true).levels.iter().filter(|&&l| l == 0).count(), 3);
    }

    #[test]
    fn raising_a_sample_raises_its_ancestors() {
        let mut arc = sample_arc(&bend(64), &[10.0, 10.0], false);
        assert!(arc.raise(5, 1));
        assert!(!arc.raise(5, 1));
        let mut pending = vec![5usize];
        while let Some(index) = pending.pop() {
            assert!(arc.levels[index] <= 1);
            pending.extend(arc.intervals[index].into_iter().flatten().map(|end| end as usize));
        }
    }

    #[test]
    fn border_deviation_vanishes_at_the_finest_level() {
        let points = bend(16);
        let samples: Vec<(u8, DVec3)> =
            points.iter().enumerate().map(|(i, &p)| (if i % 16 == 0 { 0 } else { 1 }, p)).collect();
        assert_eq!(border_deviation(&samples, 1), 0.0);
        assert!(border_deviation(&samples, 0) > 0.5);
    }
}
