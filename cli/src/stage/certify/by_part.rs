//! Surfaces of several parts, such as a chart of small parts of a scene and its drawn level: part by part.
//!
//! A map from the finer surface onto the coarser exists for all of it or not at all, and where parts touch, a vertex is often nearest
//! to the wrong one. Each part on its own is bounded as a chart of its own would be. The largest of the bounds holds for all together:
//! every point of a part has a point of its partner near it.

use glam::DVec3;

use super::bvh::TriangleBvh;
use super::{BorderPairing, Bound, CertifyOptions, PairedVertex, two_sided_along};
use crate::mesh::NONE;
use crate::mesh::union_find::components;

/// A component without a border.
struct Part {
    bounds: [DVec3; 2],
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

/// A surface in parts.
struct Parts {
    closed: Vec<Part>,
    /// All components with a border, in the numbers of the surface.
    bordered: Vec<[u32; 3]>,
}

/// Bounds the Hausdorff distance like [`super::two_sided`]; none unless both surfaces have several parts that correspond.
pub(super) fn two_sided(
    fine: &TriangleBvh,
    coarse: &TriangleBvh,
    pairing: &BorderPairing,
    options: &CertifyOptions,
) -> Option<Bound> {
    let number = |surface: &TriangleBvh, v: u32| surface.vertex_of.get(v as usize).copied().unwrap_or(NONE);
    let paired = |vertex: &PairedVertex| PairedVertex {
        fine: number(fine, vertex.fine),
        coarse: vertex.coarse.map(|v| number(coarse, v)),
    };
    let pairing: BorderPairing = pairing.iter().map(|points| points.iter().map(paired).collect()).collect();
    let border = || pairing.iter().flatten();
    let of_coarse = Parts::new(coarse, border().filter_map(|vertex| vertex.coarse))?;
    let of_fine = Parts::new(fine, border().map(|vertex| vertex.fine))?;
    let has_border = [of_fine.bordered.is_empty(), of_coarse.bordered.is_empty()];
    if has_border[0] != has_border[1] || of_fine.closed.len() != of_coarse.closed.len() {
        return None;
    }
    let pairs = partners(&of_fine.closed, &of_coarse.closed)?;
    let mut options = options.clone();
    let mut worst: Option<Bound> = None;
    let mut add = |bound: Bound| {
        options.lower = options.lower.max(bound.lower);
        worst = Some(worst.map_or(bound, |worst| worst.or_worse(bound)));
        options.clone()
    };
    let mut current = add(Bound { lower: 0.0, upper: 0.0, worst: DVec3::ZERO, work: 0 });
    if !of_fine.bordered.is_empty() {
        let [fine, coarse] = [(fine, &of_fine), (coarse, &of_coarse)]
            .map(|(surface, parts)| TriangleBvh::new(&surface.positions, &parts.bordered));
        current = add(two_sided_along(&fine, &coarse, &pairing, &current));
    }
    for (fine, coarse) in of_fine.closed.iter().zip(pairs) {
        let [fine, coarse] =
            [fine, &of_coarse.closed[coarse]].map(|part| TriangleBvh::new(&part.positions, &part.triangles));
        current = add(two_sided_along(&fine, &coarse, &vec![], &current));
    }
    worst
}

impl Parts {
    /// The parts of a surface with these vertices on its border; none if it is in one part.
    fn new(surface: &TriangleBvh, border: impl Iterator<Item = u32>) -> Option<Self> {
        let component = components(surface.positions.len(), &surface.triangles);
        let mut has_border = vec![false; component.len()];
        border.for_each(|v| {
            if let Some(&component) = component.get(v as usize) {
                has_border[component as usize] = true;
            }
        });
        let mut parts = Self { closed: vec![], bordered: vec![] };
        // The part of each component, and the number of each vertex there.
        let (mut part_of, mut numbers) = (vec![NONE; component.len()], vec![NONE; component.len()]);
        for corners in &surface.triangles {
            let component = component[corners[0] as usize] as usize;
            if has_border[component] {
                parts.bordered.push(*corners);
                continue;
            }
            if part_of[component] == NONE {
                part_of[component] = parts.closed.len() as u32;
                let bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
                parts.closed.push(Part { bounds, positions: vec![], triangles: vec![] });
            }
            let part = &mut parts.closed[part_of[component] as usize];
            let own = corners.map(|v| {
                if numbers[v as usize] == NONE {
                    numbers[v as usize] = part.positions.len() as u32;
                    let position = surface.positions[v as usize];
                    part.bounds = [part.bounds[0].min(position), part.bounds[1].max(position)];
                    part.positions.push(position);
                }
                numbers[v as usize]
            });
            part.triangles.push(own);
        }
        let count = parts.closed.len() + usize::from(!parts.bordered.is_empty());
        (count > 1).then_some(parts)
    }
}

/// For each of some parts the one among as many others whose box is most like its own; none if two have the same.
fn partners(parts: &[Part], others: &[Part]) -> Option<Vec<usize>> {
    let mut sorted: Vec<usize> = (0..others.len()).collect();
    let place = |part: &Part| part.bounds[0].x;
    sorted.sort_by(|&a, &b| place(&others[a]).total_cmp(&place(&others[b])).then(a.cmp(&b)));
    let difference = |a: &Part, b: &Part| {
        let [low, high] = [0, 1].map(|side| (a.bounds[side] - b.bounds[side]).abs().element_sum());
        low + high
    };
    let mut is_taken = vec![false; others.len()];
    let mut result = Vec::with_capacity(parts.len());
    for part in parts {
        let middle = sorted.partition_point(|&other| place(&others[other]) < place(part));
        let mut best: Option<(f64, usize)> = None;
        let mut look = |other: usize| -> bool {
            let reach = best.map_or(f64::INFINITY, |(least, _)| least);
            let off = difference(part, &others[other]);
            if off < reach {
                best = Some((off, other));
            }
            // Farther along, no box is more alike.
            (place(&others[other]) - place(part)).abs() <= reach
        };
        let _ = sorted[middle..].iter().take_while(|&&other| look(other)).count();
        let _ = sorted[..middle].iter().rev().take_while(|&&other| look(other)).count();
        let (_, partner) = best?;
        if std::mem::replace(&mut is_taken[partner], true) {
            return None;
        }
        result.push(partner);
    }
    Some(result)
}

#[cfg(test)]
mod tests {
    use super::super::{TriangleBvh, two_sided as search};
    use super::*;

    /// Boxes in a row that touch, each moved by what `moved` says.
    fn boxes(count: usize, moved: impl Fn(usize) -> f64) -> TriangleBvh {
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let (mut positions, mut triangles) = (vec![], vec![]);
        for i in 0..count {
            let first = positions.len() as u32;
            let corner = |bits: u32| DVec3::new(f64::from(bits & 1), f64::from(bits >> 1 & 1), f64::from(bits >> 2));
            positions.extend((0..8).map(|bits| corner(bits) + DVec3::X * (i as f64 + moved(i))));
            let quads = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            triangles.extend(quads.map(|corners: [u32; 3]| corners.map(|v| v + first)));
        }
        TriangleBvh::new(&positions, &triangles)
    }

    #[test]
    fn parts_are_compared_with_their_partners_and_never_bounded_too_low() {
        let options = CertifyOptions { relative_gap: 1e-3, ..CertifyOptions::default() };
        let (still, moved) = (boxes(40, |_| 0.0), boxes(40, |i| if i == 17 { 0.125 } else { 0.0 }));
        let bound = two_sided(&still, &moved, &vec![], &options).unwrap();
        assert!(bound.upper >= 0.125 && bound.upper <= 0.126, "{bound:?}");
        assert!(bound.upper >= search(&still, &moved, &options).lower);
        // Others, or one part: left to the search over all.
        assert!(two_sided(&still, &boxes(39, |_| 0.0), &vec![], &options).is_none());
        assert!(two_sided(&boxes(1, |_| 0.0), &boxes(1, |_| 0.1), &vec![], &options).is_none());
    }
}
