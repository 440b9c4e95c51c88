//! Samples every arc: nested dyadic samples, and the coarsest level that has each.
//!
//! Halving fixes the parameters: the vertex nearest to the middle of an interval (by arc length) gets the middle
//! parameter. So every sample is a vertex of the input, nothing is resampled, and both neighbours agree on it. A sample
//! belongs to a level if the interval that it halves deviates from its chord by more than that level allows.
//!
//! Later stages may assume that samples are nested (both ends of the interval that a sample halves are at least as
//! coarse as the sample), and that of several arcs between the same corners, those with inner vertices keep a middle
//! sample at every level.

use crate::arcs::{ARC_UNITS, Atlas, closest_on_segment, halving};
use crate::chart::NEVER;
use glam::DVec3;
use lodpack_mesh::Mesh;
use rayon::prelude::*;

/// Parameters and levels of the vertices of one arc's path.
#[derive(Clone, Debug, PartialEq)]
pub struct SampledArc {
    /// Parameter of each path vertex in units of 1 / [`ARC_UNITS`]: strictly growing from 0 to `ARC_UNITS`. Samples
    /// have whole numbers.
    pub params: Vec<f64>,
    /// The coarsest level at which each path vertex is a sample: 0 at both ends, [`NEVER`] for a vertex that is no
    /// sample.
    pub levels: Vec<u8>,
    /// For each inner path vertex that can be a sample, the path indices of the interval that it halves.
    pub intervals: Vec<Option<[u32; 2]>>,
}

impl SampledArc {
    /// Makes a path vertex a sample at `level` or coarser, together with the samples that nesting requires. Returns
    /// whether anything changed. A vertex that halving did not reach cannot be a sample, so it changes nothing.
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

/// Samples every arc. `tolerances` holds, for each level, coarsest first, the largest distance between arc and chord
/// that the level allows.
///
/// The samples of a seam depend on its path alone: neither region can ask for more later, so the finest level has all
/// of its vertices.
pub fn sample_arcs(mesh: &Mesh, atlas: &Atlas, tolerances: &[f64]) -> Vec<SampledArc> {
    // Arcs that share both ends would collapse onto one segment, so their middle is kept at every level.
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
    let length = halving::lengths_along(points);
    let mut arc = SampledArc {
        params: vec![0.0; points.len()],
        levels: vec![NEVER; points.len()],
        intervals: vec![None; points.len()],
    };
    arc.params[last] = f64::from(ARC_UNITS);
    (arc.levels[0], arc.levels[last]) = (0, 0);
    // Each entry: path indices and parameters of an interval, and the level of the sample that bounds it.
    let mut pending = vec![(0, last, 0u32, ARC_UNITS, 0u8)];
    while let Some((i, j, a, b, parent_level)) = pending.pop() {
        if j == i + 1 {
            continue;
        }
        if b - a == 1 {
            // The parameter cannot be halved any more, so the vertices in between can never be samples.
            for m in i + 1..j {
                arc.params[m] = f64::from(a) + (m - i) as f64 / (j - i) as f64;
            }
            continue;
        }
        let m = halving::middle_vertex(&length, i, j);
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

/// The largest distance of the inner points from the segment between the first and the last.
fn chord_deviation(points: &[DVec3]) -> f64 {
    let (a, b) = (points[0], points[points.len() - 1]);
    let squared = points.iter().map(|&p| p.distance_squared(closest_on_segment(p, a, b).0)).fold(0.0, f64::max);
    squared.sqrt()
}

/// How far the surface beside an arc can move when the arc is drawn with more samples than level `level` has. `samples`
/// are (level, position) in order along the arc, both ends (level 0) included.
///
/// The extra samples are matched, in monotone order, with points of the coarser chords. The matching is linear on each
/// fan triangle, so a fan triangle moves by at most as much as its samples do.
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
