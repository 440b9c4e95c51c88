//! The stage **cluster vertices**: all vertices of a lattice cell become one (Rossignac and Borrel, "Multi-resolution 3D
//! approximations for rendering complex scenes", 1993; Correa 2004, section 3.3).
//!
//! It takes any surface to any number of triangles, however many parts it has: parts that share a cell grow together, and parts
//! within a cell vanish. No point of a triangle moves farther than the diagonal of a cell. Vertices are placed where the planes of
//! their cell's triangles meet best (Lindstrom, "Out-of-core simplification of large polygonal models", 2000), but not outside of it.
//!
//! Where the input is closed, so is the result: every edge has as many triangles one way as the other. A part that becomes flat
//! keeps its two sides, as a triangle and its back.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::mesh::Mesh;
use crate::stage::simplify::Quadric;

/// How strongly a vertex is drawn to the mean of its cell's vertices, relative to the trace of the quadric.
const DAMPING: f64 = 1e-3;

/// The vertices of one cell.
#[derive(Default)]
struct Cell {
    quadric: Quadric,
    sum: DVec3,
    count: f64,
    number: u32,
}

/// Merges the vertices of each cell of a lattice of cubes with the given edge length, input units.
pub fn cluster_vertices(mesh: &Mesh, edge: f64) -> Mesh {
    let [low, _] = mesh.bounds();
    // From the corner of the box on, so that quadrics of far places lose nothing.
    let place = |v: u32| mesh.positions[v as usize] - low;
    let cell_of = |p: DVec3| (p / edge).floor().to_array().map(|x| x as i64);
    let mut cells: BTreeMap<[i64; 3], Cell> = BTreeMap::new();
    for corners in &mesh.triangles {
        let places = corners.map(place);
        let [a, b, c] = places;
        let area = 0.5 * (b - a).cross(c - a);
        let length = area.length();
        for p in places {
            let cell = cells.entry(cell_of(p)).or_default();
            cell.sum += p;
            cell.count += 1.0;
            if length > 0.0 {
                cell.quadric += Quadric::plane(area / length, (a + b + c) / 3.0, length / 3.0);
            }
        }
    }
    let mut positions = Vec::with_capacity(cells.len());
    for (number, (index, cell)) in (0..).zip(&mut cells) {
        cell.number = number;
        let mean = cell.sum / cell.count;
        let corner = DVec3::from_array(index.map(|x| x as f64)) * edge;
        let best = mean + cell.quadric.step_to_minimum(mean, DAMPING);
        let is_within = (best - corner).min_element() >= 0.0 && (best - corner).max_element() <= edge;
        positions.push(low + if is_within { best } else { mean });
    }
    let number_of = |v: u32| cells.get(&cell_of(place(v))).map_or(0, |cell| cell.number);
    Mesh { triangles: merged(mesh.triangles.iter().map(|corners| corners.map(number_of))), positions }
}

/// Triangles without those that have become edges or points; of those between the same vertices the two sides cancel out, but for one of each
/// where nothing else would be left.
fn merged(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    // By the vertices from the lowest one on, in the two windings: how often one way more than the other.
    let mut turns: BTreeMap<[u32; 3], i64> = BTreeMap::new();
    for [a, b, c] in triangles {
        if a == b || b == c || c == a {
            continue;
        }
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        let is_even = [a, b, c] == sorted || [b, c, a] == sorted || [c, a, b] == sorted;
        *turns.entry(sorted).or_default() += if is_even { 1 } else { -1 };
    }
    let sides = turns.into_iter().flat_map(|([a, b, c], turns)| {
        let (front, back) = match turns {
            0 => (1, 1),
            more @ 1.. => (more, 0),
            fewer => (0, -fewer),
        };
        std::iter::repeat_n([a, b, c], front as usize).chain(std::iter::repeat_n([a, c, b], back as usize))
    });
    sides.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boxes of unit size along x, closed and apart.
    fn boxes(count: u32) -> Mesh {
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut mesh = Mesh::default();
        for i in 0..count {
            let first = mesh.positions.len() as u32;
            let corner = |bits: u32| DVec3::new(f64::from(bits & 1), f64::from(bits >> 1 & 1), f64::from(bits >> 2));
            mesh.positions.extend((0..8).map(|bits| corner(bits) + DVec3::X * f64::from(3 * i)));
            let quads = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            mesh.triangles.extend(quads.map(|corners| corners.map(|v| v + first)));
        }
        mesh
    }

    fn is_balanced(mesh: &Mesh) -> bool {
        let mut edges: BTreeMap<[u32; 2], i64> = BTreeMap::new();
        for &[a, b, c] in &mesh.triangles {
            for (u, v) in [(a, b), (b, c), (c, a)] {
                *edges.entry([u.min(v), u.max(v)]).or_default() += if u < v { 1 } else { -1 };
            }
        }
        edges.values().all(|&turns| turns == 0)
    }

    #[test]
    fn small_cells_change_nothing_and_larger_ones_leave_fewer_triangles_of_a_closed_surface() {
        let row = boxes(40);
        assert_eq!(cluster_vertices(&row, 0.3).triangles.len(), row.triangles.len());
        let mut before = row.triangles.len();
        for edge in [2.5, 6.1, 17.3] {
            let coarse = cluster_vertices(&row, edge);
            assert!(is_balanced(&coarse) && coarse.triangles.len() <= before);
            before = coarse.triangles.len();
        }
    }

    #[test]
    fn vertices_stay_in_their_cells_and_flat_parts_keep_two_sides() {
        let flat = Mesh {
            positions: vec![DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0, DVec3::new(0.1, 0.1, 0.3)],
            triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        };
        let coarse = cluster_vertices(&flat, 1.0);
        assert_eq!(coarse.positions.len(), 3);
        assert_eq!(coarse.triangles.len(), 2);
        assert!(is_balanced(&coarse));
        assert!(coarse.positions.iter().all(|p| p.min_element() >= 0.0 && p.max_element() <= 5.0));
    }
}
