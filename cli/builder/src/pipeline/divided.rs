//! Edges that get a vertex in their middle. Where two charts each cut off the same border vertex by an ear, the edge
//! behind it would have four triangles in the mesh; and an ear on a straight border has no area. Whoever builds such a
//! mesh again finds openings in it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;
use lodpack::decode::Patch;
use lodpack_mesh::{NONE, ordered, sides};
use lodpack_stage::nearest::doubled_area;
use lodpack_stage::simplify::{LevelPatch, Quadric};

use super::ChartedMesh;
use super::shared_arcs::{CutChart, SharedArcs};

/// An edge between two vertices, the smaller one first.
pub(super) type Edge = [u32; 2];

/// Divides those of some edges of a patch that lie inside it. `border` are the positions of its border.
pub(super) fn divide(patch: &mut LevelPatch, border: &[DVec3], edges: &[Edge]) {
    let is_known = patch.interior_was.len() == patch.interior.len();
    for &[a, c] in edges {
        let leaving = |from: u32, to: u32| {
            let is_edge = |corners: &[u32; 3]| (0..3).find(|&k| corners[k] == from && corners[(k + 1) % 3] == to);
            patch.triangles.iter().enumerate().find_map(|(t, corners)| is_edge(corners).map(|k| (t, (k + 1) % 3)))
        };
        let (Some(one), Some(other)) = (leaving(a, c), leaving(c, a)) else { continue };
        let middle = (border.len() + patch.interior.len()) as u32;
        for (triangle, end) in [one, other] {
            let mut beyond = patch.triangles[triangle];
            patch.triangles[triangle][end] = middle;
            beyond[(end + 2) % 3] = middle;
            patch.triangles.push(beyond);
            if let Some(&area) = patch.areas.get(triangle) {
                patch.areas.push(area);
            }
        }
        let position =
            |v: u32| border.get(v as usize).copied().unwrap_or_else(|| patch.interior[v as usize - border.len()]);
        let position = position(a).midpoint(position(c));
        patch.interior.push(position);
        patch.interior_quadrics.push(Quadric::default());
        if is_known {
            patch.interior_was.push(NONE);
        }
    }
}

/// The longest edges of triangles between border vertices on one line. `border` are the positions of its border; exact
/// up to 2^26 lattice steps.
pub(super) fn behind_flat_ears(patch: &LevelPatch, border: &[DVec3]) -> Vec<Edge> {
    let longest = |&corners: &[u32; 3]| {
        let at = |v: u32| border.get(v as usize).copied();
        let [p, q, r] = [at(corners[0])?, at(corners[1])?, at(corners[2])?];
        let is_flat = doubled_area([p, q, r]) == DVec3::ZERO && p != q && q != r && r != p;
        let lengths = [p.distance_squared(q), q.distance_squared(r), r.distance_squared(p)];
        let longest = lengths.into_iter().zip(sides(corners)).max_by(|a, b| a.0.total_cmp(&b.0));
        longest.filter(|_| is_flat).map(|(_, edge)| edge)
    };
    patch.triangles.iter().filter_map(longest).collect::<BTreeSet<Edge>>().into_iter().collect()
}

/// The vertices of the mesh that are those of the border of a chart's patch at a level.
pub(super) fn border_vertices(charted: &ChartedMesh, cut: &CutChart, level: u8) -> Vec<u32> {
    let loops = cut.mesh.loops.iter().zip(&cut.origin).zip(&cut.lattice);
    let of_loop = loops.flat_map(|((border, origin), points)| border.iter().zip(origin).zip(points));
    let drawn = of_loop.filter(|((vertex, _), point)| vertex.level <= level && point.is_some());
    drawn.map(|((_, &(arc, index)), _)| charted.atlas.arcs[arc as usize].path[index as usize]).collect()
}

/// The edges inside a patch between vertices of its border, as vertices of the mesh.
pub(super) fn chords(patch: &Patch, border: &[u32]) -> Vec<Edge> {
    let edges = patch.triangles.iter().flat_map(|&corners| sides(corners));
    let mut between: Vec<Edge> = edges.filter(|&[_, b]| b < patch.border_count).collect();
    between.sort_unstable();
    let inside = between.chunk_by(|one, other| one == other).filter(|alike| alike.len() > 1);
    inside.map(|alike| ordered(alike[0].map(|v| border[v as usize]))).collect()
}

/// Which charts are to divide which chords: those that others have, too, all but one of them; those that are edges of
/// an arc, all. `chords` are those of charts, each with whether this chart can.
pub(super) fn shared_chords(
    charted: &ChartedMesh,
    arcs: &SharedArcs,
    chords: impl Iterator<Item = (Edge, u32, bool)>,
) -> Vec<(u32, Edge)> {
    let mut owners: BTreeMap<Edge, Vec<(u32, bool)>> = BTreeMap::new();
    for (chord, chart, can_divide) in chords {
        owners.entry(chord).or_default().push((chart, can_divide));
    }
    let mut along: BTreeSet<Edge> = BTreeSet::new();
    if !owners.is_empty() {
        along.extend(arcs.edges(charted).filter(|edge| owners.contains_key(edge)));
    }
    let mut found = vec![];
    for (chord, of) in owners {
        let kept = usize::from(!along.contains(&chord));
        let able = of.iter().rev().filter(|(_, can_divide)| *can_divide);
        found.extend(able.take(of.len().saturating_sub(kept)).map(|&(chart, _)| (chart, chord)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square whose corners are its border, with a chord from the first to the third.
    fn square() -> (LevelPatch, Vec<DVec3>) {
        let border = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let patch = LevelPatch { border: vec![7, 8, 9, 5], triangles, areas: vec![1, 2], ..LevelPatch::default() };
        (patch, border.to_vec())
    }

    #[test]
    fn an_edge_inside_is_divided_and_an_edge_of_the_border_stays() {
        let (mut patch, border) = square();
        divide(&mut patch, &border, &[[0, 1], [0, 2], [1, 3]]);
        assert_eq!(patch.interior, [DVec3::new(2.0, 2.0, 0.0)]);
        assert_eq!((patch.interior_was.as_slice(), patch.interior_quadrics.len()), ([NONE].as_slice(), 1));
        let mut sides: Vec<[u32; 2]> = vec![];
        for &[a, b, c] in &patch.triangles {
            let [p, q, r] = [a, b, c].map(|v| border.get(v as usize).copied().unwrap_or(patch.interior[0]));
            assert_eq!((q - p).cross(r - p), DVec3::Z * 8.0);
            sides.extend([[a, b], [b, c], [c, a]]);
        }
        sides.sort_unstable();
        sides.dedup();
        assert_eq!((patch.triangles.len(), sides.len()), (4, 12), "all sides differ");
        assert!(!sides.contains(&[0, 2]) && !sides.contains(&[2, 0]));
        let area = |t: usize| if patch.triangles[t].contains(&1) { 1 } else { 2 };
        assert_eq!(patch.areas, [area(0), area(1), area(2), area(3)]);
    }

    #[test]
    fn ears_on_straight_borders_are_flat() {
        let (patch, _) = square();
        let behind =
            |border: [[i32; 3]; 4]| behind_flat_ears(&patch, &border.map(|point| DVec3::from(point.map(f64::from))));
        assert_eq!(behind([[0, 0, 0], [4, 1, 2], [8, 2, 4], [0, 4, 0]]), [[0, 2]]);
        assert_eq!(behind([[0, 0, 0], [4, 1, 3], [8, 2, 4], [0, 4, 0]]), [[0; 2]; 0]);
        // A point twice is no ear: nothing behind it gives it an area.
        assert_eq!(behind([[0, 0, 0], [0, 0, 0], [8, 2, 4], [0, 4, 0]]), [[0; 2]; 0]);
    }

    #[test]
    fn chords_are_edges_inside_between_border_vertices() {
        let patch = Patch { border_count: 4, interior: vec![], triangles: vec![[0, 1, 2], [0, 2, 3]] };
        assert_eq!(chords(&patch, &[9, 8, 3, 5]), [[3, 9]]);
    }
}
