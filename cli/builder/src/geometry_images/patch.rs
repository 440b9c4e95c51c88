//! Patches: their borders get the samples of the images beside them.

use super::border_edges::BorderEdges;
use super::manifest::{Border, ImageEdge};
use super::product::{ArcKnot, AtlasPatch};
use super::sides::SideId;
use glam::{DVec3, Vec3};

/// The charts around the patches, and their arcs.
pub(super) struct Surroundings<'a> {
    pub arcs: &'a [Vec<ArcKnot>],
    pub arc_samples: &'a [Vec<[f32; 3]>],
    pub sides_of: &'a [Vec<SideId>],
    /// Index of each chart's first root.
    pub first_root: &'a [u32],
    /// Corners of each chart.
    pub corner_count: &'a [u32],
}

/// A vertex that a patch gets on an edge of its border.
pub(super) struct Between {
    /// Vertices of the patch.
    pub ends: [u32; 2],
    /// How far it is from the first to the second, 0 to 1.
    pub share: f64,
}

/// A patch with all samples of its borders as vertices, which follow its own.
pub(super) struct SampledPatch {
    pub patch: AtlasPatch,
    /// The vertices that were added.
    pub added: Vec<Between>,
    /// For each triangle the one of the patch that it is a part of.
    pub parents: Vec<u32>,
    /// One border for each edge of an image beside it.
    pub borders: Vec<Border>,
}

/// Adds the samples of its borders to a patch. Its own vertices stay: the reader inserts them into the images'
/// triangles.
pub(super) fn sampled_patch(patch: &AtlasPatch, around: &Surroundings) -> SampledPatch {
    let mut patch = patch.clone();
    let mut is_border = vec![false; patch.positions.len()];
    for &v in patch.borders.iter().flat_map(|border| &border.vertices) {
        is_border[v as usize] = true;
    }
    let mut edges = BorderEdges::new(&patch.triangles, &is_border, |v| v);
    let mut parents: Vec<u32> = (0..patch.triangles.len() as u32).collect();
    let (mut added, mut borders) = (Vec::new(), Vec::new());
    for border in std::mem::take(&mut patch.borders) {
        let arc = border.arc as usize;
        let samples = &around.arc_samples[arc];
        let (mut chain, mut middle) = insert_samples(
            (&mut patch, &mut parents, &mut added),
            &mut edges,
            &border.vertices,
            &around.arcs[arc],
            samples,
        );
        let Some(side) = around.sides_of[arc].first() else { continue };
        if side.reversed {
            chain.reverse();
            middle = chain.len() - 1 - middle;
        }
        // Like all outer edges of images, both halves run from the middle of the side to a corner.
        let (first, count) = (around.first_root[side.chart as usize], around.corner_count[side.chart as usize]);
        let to_start = chain[..=middle].iter().rev().copied().collect();
        borders.push(Border { root: first + side.side, edge: ImageEdge::Bottom, vertices: to_start });
        let to_end = chain[middle..].to_vec();
        borders.push(Border { root: first + (side.side + 1) % count, edge: ImageEdge::Right, vertices: to_end });
    }
    SampledPatch { patch, added, parents, borders }
}

/// The vertices of one border, knots and samples together, in the arc's direction, and the index of the middle one.
fn insert_samples(
    (patch, parents, added): (&mut AtlasPatch, &mut Vec<u32>, &mut Vec<Between>),
    edges: &mut BorderEdges<impl Fn(u32) -> u32>,
    vertices: &[u32],
    knots: &[ArcKnot],
    samples: &[[f32; 3]],
) -> (Vec<u32>, usize) {
    let step_count = samples.len() - 1;
    let (mut chain, mut middle) = (Vec::with_capacity(vertices.len() + samples.len()), 0);
    let mut next_sample = 0;
    for (i, (&vertex, knot)) in vertices.iter().zip(knots).enumerate() {
        let mut between = Vec::new();
        while next_sample <= step_count && next_sample as f64 / step_count as f64 <= knot.param {
            let position = position_of(samples[next_sample]);
            let is_knot = next_sample as f64 / step_count as f64 == knot.param;
            if next_sample * 2 == step_count {
                middle = chain.len() + between.len();
            }
            if is_knot {
                patch.positions[vertex as usize] = position;
            } else {
                between.push(patch.positions.len() as u32);
                patch.positions.push(position);
                // The first sample is the first knot.
                let (before, start) = (i.saturating_sub(1), knots[i.saturating_sub(1)].param);
                let param = next_sample as f64 / step_count as f64;
                added.push(Between {
                    ends: [vertices[before], vertex],
                    share: (param - start) / (knot.param - start).max(f64::MIN_POSITIVE),
                });
            }
            next_sample += 1;
        }
        if i > 0
            && !between.is_empty()
            && let Some(split) = edges.insert(&mut patch.triangles, vertices[i - 1], vertex, &between)
        {
            parents.resize(patch.triangles.len(), parents[split as usize]);
        }
        chain.extend(between);
        chain.push(vertex);
    }
    (chain, middle)
}

fn position_of(sample: [f32; 3]) -> DVec3 {
    Vec3::from_array(sample).as_dvec3()
}
