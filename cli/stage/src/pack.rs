//! The stage **pack**: small parts of a scene share charts.
//!
//! A part that is whole in one chart, and smaller than a chart should be, would cost an entry of the index and a patch
//! of its own, however few triangles it has. Such parts are put together with others nearby until they are as large as
//! a chart. They stay parts: nothing is joined but the list of triangles. A reader gets them together, as it gets the
//! triangles of any chart.

use glam::DVec3;

use super::group::{Charts, divide};
use super::segment::compact_labels;
use lodpack_mesh::{Adjacency, Mesh, NONE};

/// The largest share of a chart's size at which a part is put together with others.
const SMALL: f64 = 0.5;

/// What each chart weighs where parts are put together, or charts become groups: its triangles, or, if that is more, as
/// many as a chart of `target` triangles has for what it carries. `shares` are those of triangles in the most that a
/// chart should carry; empty where they carry nothing.
pub fn chart_weights(labels: &[u32], target: u32, shares: &[f64]) -> Vec<u64> {
    let count = labels.iter().max().map_or(0, |&last| last as usize + 1);
    let (mut weights, mut carried) = (vec![0_u64; count], vec![0.0; count]);
    labels.iter().for_each(|&label| weights[label as usize] += 1);
    labels.iter().zip(shares).for_each(|(&label, share)| carried[label as usize] += share);
    // The conversion saturates.
    weights
        .iter_mut()
        .zip(carried)
        .for_each(|(weight, share)| *weight = (*weight).max((share * f64::from(target)) as u64));
    weights
}

/// Gives parts that are whole in one chart of `labels`, and small compared with charts of `target` triangles, charts in
/// common. A part with open edges stays alone unless `may_be_open`: such edges may belong to other regions. `shares`
/// are as in
/// [`chart_weights`].
pub fn pack_parts(
    mesh: &Mesh,
    adjacency: &Adjacency,
    mut labels: Vec<u32>,
    target: u32,
    may_be_open: bool,
    shares: &[f64],
) -> Vec<u32> {
    let all_weights = chart_weights(&labels, target, shares);
    let count = all_weights.len();
    let (mut sizes, mut sums, mut is_whole) = (vec![0_u64; count], vec![DVec3::ZERO; count], vec![true; count]);
    for (t, &label) in (0..).zip(&labels) {
        let label = label as usize;
        sizes[label] += 1;
        let [a, b, c] = mesh.corners(t);
        sums[label] += (a + b + c) / 3.0;
        for &opposite in &adjacency.opposite[3 * t as usize..3 * t as usize + 3] {
            let stays = if opposite == NONE { may_be_open } else { labels[opposite as usize / 3] as usize == label };
            is_whole[label] &= stays;
        }
    }
    let weight = |label: u32| all_weights[label as usize];
    let is_small = |label: u32| weight(label) as f64 <= SMALL * f64::from(target);
    let parts: Vec<u32> = (0..count as u32).filter(|&label| is_whole[label as usize] && is_small(label)).collect();
    let weights: Vec<u64> = parts.iter().map(|&label| weight(label)).collect();
    let centres: Vec<DVec3> =
        parts.iter().map(|&label| sums[label as usize] / sizes[label as usize].max(1) as f64).collect();
    let charts = weights.iter().sum::<u64>().div_ceil(u64::from(target.max(1)));
    let mut chart_of: Vec<u32> = (0..count as u32).collect();
    for set in divide(&Charts { weights: &weights, centres: &centres, pairs: &[] }, charts as usize) {
        let first = set.iter().map(|&part| parts[part as usize]).min().unwrap_or_default();
        set.iter().for_each(|&part| chart_of[parts[part as usize] as usize] = first);
    }
    labels.iter_mut().for_each(|label| *label = chart_of[*label as usize]);
    compact_labels(&mut labels);
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tetrahedra in a row along x; the last triangle of the last one is missing.
    fn tetrahedra(count: u32) -> Mesh {
        let mut mesh = Mesh::default();
        for i in 0..count {
            let first = mesh.positions.len() as u32;
            let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
            mesh.positions.extend(corners.map(|p| p + DVec3::X * f64::from(2 * i)));
            let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
            mesh.triangles.extend(faces.map(|corners| corners.map(|v| v + first)));
        }
        mesh.triangles.pop();
        mesh
    }

    #[test]
    fn neighbours_share_charts_and_what_may_go_on_elsewhere_stays_alone() {
        let (mesh, adjacency) = crate::repair::sew(tetrahedra(9));
        let own: Vec<u32> = (0..mesh.triangles.len() as u32).map(|t| t / 4).collect();
        let packed = |target, may_be_open| pack_parts(&mesh, &adjacency, own.clone(), target, may_be_open, &[]);
        // Eight closed ones of four triangles in two charts of sixteen.
        let closed: Vec<u32> = (0..35).map(|t| t / 16).collect();
        assert_eq!(packed(16, false), closed);
        assert!(packed(1000, true).iter().all(|&label| label == 0));
        // Too large to share.
        assert_eq!(packed(7, true), own);
        // Those of the first four carry a third of what a chart may.
        let shares: Vec<f64> = (0..35).map(|t| if t < 16 { 1.0 / 12.0 } else { 0.0 }).collect();
        let labels = pack_parts(&mesh, &adjacency, own.clone(), 100, true, &shares);
        let carried =
            |label: u32| labels.iter().zip(&shares).filter(|(l, _)| **l == label).map(|(_, s)| s).sum::<f64>();
        assert!((0..=labels[34]).all(|label| carried(label) < 1.01), "{labels:?}");
        assert!(labels[34] > 0);
    }
}
