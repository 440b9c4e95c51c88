//! Keeps the charts that the input has, as far as later stages can have them.

use super::components::connected_components;
use super::{SegmentOptions, compact_labels, label_sizes, segment_charts};
use lodpack_mesh::{Adjacency, Mesh, NONE};

/// Labels each triangle with its chart, as [`segment_charts`] does, where the input says which one it is in. Two kinds
/// of charts are divided: those that are not connected over edges, into their components, and those of more than
/// `largest` triangles, which is at least twice the target of `options`, by [`segment_charts`].
pub fn keep_charts(
    mesh: &Mesh,
    adjacency: &Adjacency,
    charts: &[u32],
    largest: u32,
    options: &SegmentOptions,
) -> Vec<u32> {
    let (mut labels, count) = connected_components(adjacency, charts);
    let sizes = label_sizes(&labels, count);
    let is_large = |label: u32| sizes[label as usize] > largest;
    let large: Vec<u32> = (0..).zip(&labels).filter(|&(_, &label)| is_large(label)).map(|(t, _)| t).collect();
    if large.is_empty() {
        return labels;
    }
    let (mesh, adjacency) = apart(mesh, adjacency, &labels, &large);
    let parts = segment_charts(&mesh, &adjacency, options);
    for (&triangle, part) in large.iter().zip(parts) {
        labels[triangle as usize] = count + part;
    }
    compact_labels(&mut labels);
    labels
}

/// The mesh of some triangles, of which those with different labels are no neighbours.
fn apart(mesh: &Mesh, adjacency: &Adjacency, labels: &[u32], triangles: &[u32]) -> (Mesh, Adjacency) {
    let mut number = vec![NONE; labels.len()];
    (0..).zip(triangles).for_each(|(own, &triangle)| number[triangle as usize] = own);
    let opposite_of = |half_edge: u32| match adjacency.opposite[half_edge as usize] {
        opposite if opposite != NONE && labels[opposite as usize / 3] == labels[half_edge as usize / 3] => {
            3 * number[opposite as usize / 3] + opposite % 3
        }
        _ => NONE,
    };
    let opposite = triangles.iter().flat_map(|&t| [0, 1, 2].map(|k| opposite_of(3 * t + k))).collect();
    let triangles = triangles.iter().map(|&t| mesh.triangles[t as usize]).collect();
    (Mesh { positions: mesh.positions.clone(), triangles }, Adjacency { opposite })
}
