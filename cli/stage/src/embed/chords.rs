//! A virtual vertex in the middle of every chord, that is, of every inner edge with both ends on the border.
//!
//! In a polygon that is convex but not strictly convex, Tutte's embedding of a disk is a bijection only if no chord has
//! both ends on the same straight side (Floater, "One-to-one piecewise linear mappings over triangulations", 2003): the
//! ear that such a chord cuts off would collapse. A movable midpoint on the chord removes the condition. Chords between
//! different sides get a midpoint too; without it, the map would have to cross the polygon straight along them.

use glam::DVec3;

use crate::chart::ChartMesh;
use lodpack_mesh::{Adjacency, NONE};

/// A chart's triangles, with chords halved.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Refined {
    /// Positions: the chart's vertices, then the midpoint of each chord.
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub adjacency: Adjacency,
    /// The ends of each chord; the midpoint of chord k is the chart's vertex count + k.
    pub chords: Vec<[u32; 2]>,
    /// For each triangle beyond the number of the chart's own: the chart's triangle that it is part of. A triangle
    /// below that number is the chart's triangle of the same index, or the first part of it.
    pub source: Vec<u32>,
    /// Whether a vertex is fixed on the border.
    pub on_border: Vec<bool>,
}

impl Refined {
    pub fn vertex_count(&self) -> usize {
        self.positions.len()
    }
}

/// Halves the chords of a disk.
pub(super) fn split_chords(chart: &ChartMesh, adjacency: Adjacency) -> Refined {
    let mut positions = chart.positions.clone();
    let mut on_border = vec![false; positions.len()];
    for v in chart.loops.iter().flatten() {
        on_border[v.vertex as usize] = true;
    }
    let mut chords = Vec::new();
    let mut midpoint: Vec<(u32, u32)> = Vec::new();
    for (h, &opposite) in adjacency.opposite.iter().enumerate() {
        let t = chart.triangles[h / 3];
        let (a, b) = (t[h % 3], t[(h + 1) % 3]);
        if opposite == NONE || (opposite as usize) < h || !on_border[a as usize] || !on_border[b as usize] {
            continue;
        }
        let id = positions.len() as u32;
        midpoint.extend([(h as u32, id), (opposite, id)]);
        chords.push([a, b]);
        positions.push(positions[a as usize].midpoint(positions[b as usize]));
    }
    if chords.is_empty() {
        let triangles = chart.triangles.clone();
        return Refined { positions, triangles, adjacency, chords, source: Vec::new(), on_border };
    }
    on_border.resize(positions.len(), false);

    // The first part of a halved triangle takes its index and the other parts go to the end, so all other triangles
    // keep their half-edges.
    midpoint.sort_unstable();
    let mut triangles = chart.triangles.clone();
    let mut source = Vec::new();
    let mut halved = Vec::new();
    for edges in midpoint.chunk_by(|a, b| a.0 / 3 == b.0 / 3) {
        let triangle = edges[0].0 / 3;
        let mut middle = [NONE; 3];
        for &(h, id) in edges {
            middle[h as usize % 3] = id;
        }
        halved.push(triangle);
        let mut parts = split_triangle(chart.triangles[triangle as usize], middle).into_iter().flatten();
        triangles[triangle as usize] = parts.next().unwrap_or_default();
        triangles.extend(parts);
        source.resize(triangles.len() - chart.triangles.len(), triangle);
    }
    let adjacency = update_adjacency(adjacency, &triangles, &halved);
    Refined { positions, triangles, adjacency, chords, source, on_border }
}

/// Pairs the half-edges of the parts of `halved` triangles with each other and with their neighbours.
fn update_adjacency(mut adjacency: Adjacency, triangles: &[[u32; 3]], halved: &[u32]) -> Adjacency {
    let old_count = adjacency.opposite.len() as u32;
    let opposite = &mut adjacency.opposite;
    let parts = halved.iter().flat_map(|&t| 3 * t..3 * t + 3).chain(old_count..3 * triangles.len() as u32);
    let mut open: Vec<u32> = parts.collect();
    for i in 0..3 * halved.len() {
        // A neighbour that is not halved itself appears only here; a halved one appears twice, and sorting brings the
        // copies together.
        open.extend(Some(opposite[open[i] as usize]).filter(|&o| o != NONE));
    }
    opposite.resize(3 * triangles.len(), NONE);
    let edge = |h: u32| {
        let t = triangles[h as usize / 3];
        let (a, b) = (t[h as usize % 3], t[(h as usize + 1) % 3]);
        (a.min(b), a.max(b), h)
    };
    let mut open: Vec<(u32, u32, u32)> = open.into_iter().map(edge).collect();
    open.sort_unstable();
    open.dedup();
    for &(_, _, h) in &open {
        opposite[h as usize] = NONE;
    }
    for pair in open.windows(2) {
        let [(a, b, g), (c, d, h)] = [pair[0], pair[1]];
        if (a, b) == (c, d) {
            opposite[g as usize] = h;
            opposite[h as usize] = g;
        }
    }
    adjacency
}

/// The parts of a triangle; `middle[k]` is the midpoint of the edge from corner k to corner k + 1, if it has one.
fn split_triangle(t: [u32; 3], middle: [u32; 3]) -> [Option<[u32; 3]>; 4] {
    let halved_count = middle.iter().filter(|&&m| m != NONE).count();
    // Turn the triangle so that the odd edge out comes first.
    let first = middle.iter().position(|&m| (m != NONE) == (halved_count == 1)).unwrap_or(0);
    let at = |k: usize| (first + k) % 3;
    let [a, b, c] = [t[at(0)], t[at(1)], t[at(2)]];
    let [ab, bc, ca] = [middle[at(0)], middle[at(1)], middle[at(2)]];
    match halved_count {
        0 => [Some(t), None, None, None],
        1 => [Some([a, ab, c]), Some([ab, b, c]), None, None],
        2 => [Some([c, ca, bc]), Some([a, b, bc]), Some([a, bc, ca]), None],
        _ => [Some([a, ab, ca]), Some([ab, b, bc]), Some([ca, bc, c]), Some([ab, bc, ca])],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::embed::tests::{chord_rich_strip, grid};

    #[test]
    fn updated_adjacency_equals_adjacency_built_anew() {
        for chart in [chord_rich_strip(12), grid(3, 4), grid(1, 1), grid(9, 1)] {
            let refined = split_chords(&chart, Adjacency::new(&chart.triangles, chart.positions.len()));
            assert!(!refined.chords.is_empty());
            assert_eq!(refined.adjacency, Adjacency::new(&refined.triangles, refined.positions.len()));
            assert_eq!(refined.source.len(), refined.triangles.len() - chart.triangles.len());
        }
    }

    #[test]
    fn parts_of_a_triangle_keep_its_winding_and_cover_it() {
        let point = [[0, 0], [4, 0], [0, 4], [2, 0], [2, 2], [0, 2]];
        for mask in 0..8 {
            let middle = [0, 1, 2].map(|k| if mask >> k & 1 == 1 { 3 + k as u32 } else { NONE });
            let area: i32 = split_triangle([0, 1, 2], middle)
                .into_iter()
                .flatten()
                .map(|t| {
                    let [a, b, c] = t.map(|v| point[v as usize]);
                    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
                    assert!(area > 0, "{mask}");
                    area
                })
                .sum();
            assert_eq!(area, 16);
        }
    }
}
