//! The stage **cluster vertices**: all vertices of a lattice cell become one (Rossignac and Borrel, "Multi-resolution
//! 3D approximations for rendering complex scenes", 1993; Correa 2004, section 3.3).
//!
//! It takes any surface to any number of triangles, however many parts it has: parts that share a cell grow together,
//! and parts within a cell vanish. No point of a triangle moves farther than the diagonal of a cell. Vertices are
//! placed where the planes of their cell's triangles meet best (Lindstrom, "Out-of-core simplification of large
//! polygonal models", 2000), but not outside of it.
//!
//! Where the input is closed, so is the result: every edge has as many triangles one way as the other. A part that
//! becomes flat keeps its two sides, as a triangle and its back.

use std::collections::HashSet;

use glam::DVec3;

use crate::simplify::Quadric;
use lodpack_mesh::Mesh;

/// How strongly a vertex is drawn to the mean of its cell's vertices, relative to the trace of the quadric.
const DAMPING: f64 = 1e-3;

/// The vertices of one cell.
#[derive(Clone, Default)]
struct Cell {
    quadric: Quadric,
    sum: DVec3,
    count: f64,
}

/// A lattice of cubes with an edge length, from the corner of a box on, so that quadrics of far places lose nothing.
struct Cubes {
    low: DVec3,
    edge: f64,
}

impl Cubes {
    fn cell_of(&self, place: DVec3) -> [i64; 3] {
        ((place - self.low) / self.edge).floor().to_array().map(|x| x as i64)
    }
}

/// Whether clusters on cubes with the given edge length have more than `most` triangles. It is known soon if they have.
pub fn has_more_triangles(mesh: &Mesh, edge: f64, most: usize) -> bool {
    let cubes = Cubes { low: mesh.bounds()[0], edge };
    let mut found: HashSet<[[i64; 3]; 3]> = HashSet::new();
    // What falls together in two windings keeps a triangle or two.
    mesh.triangles.iter().any(|corners| {
        let mut cells = corners.map(|v| cubes.cell_of(mesh.positions[v as usize]));
        cells.sort_unstable();
        cells[0] != cells[1] && cells[1] != cells[2] && found.insert(cells) && found.len() > most
    })
}

/// Merges the vertices of each cell of a lattice of cubes with the given edge length, input units.
pub fn cluster_vertices(mesh: &Mesh, edge: f64) -> Mesh {
    let low = mesh.bounds()[0];
    let cubes = Cubes { low, edge };
    let mut is_used = vec![false; mesh.positions.len()];
    mesh.triangles.as_flattened().iter().for_each(|&v| is_used[v as usize] = true);
    let used = (0..).zip(&mesh.positions).zip(is_used).filter(|(_, is_used)| *is_used);
    let mut order: Vec<([i64; 3], u32)> = used.map(|((v, &p), _)| (cubes.cell_of(p), v)).collect();
    order.sort_unstable();
    let mut number_of = vec![0_u32; mesh.positions.len()];
    let mut corners_of = vec![];
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        run.iter().for_each(|&(_, v)| number_of[v as usize] = corners_of.len() as u32);
        corners_of.push(DVec3::from_array(run[0].0.map(|x| x as f64)) * edge);
    }
    let mut cells = vec![Cell::default(); corners_of.len()];
    for corners in &mesh.triangles {
        let places = corners.map(|v| mesh.positions[v as usize] - low);
        let [a, b, c] = places;
        let area = 0.5 * (b - a).cross(c - a);
        let length = area.length();
        for (p, &v) in places.into_iter().zip(corners) {
            let cell = &mut cells[number_of[v as usize] as usize];
            cell.sum += p;
            cell.count += 1.0;
            if length > 0.0 {
                cell.quadric += Quadric::plane(area / length, (a + b + c) / 3.0, length / 3.0);
            }
        }
    }
    let placed = cells.iter().zip(corners_of).map(|(cell, corner)| {
        let mean = cell.sum / cell.count;
        let best = mean + cell.quadric.step_to_minimum(mean, DAMPING);
        let is_within = (best - corner).min_element() >= 0.0 && (best - corner).max_element() <= edge;
        low + if is_within { best } else { mean }
    });
    let triangles = mesh.triangles.iter().map(|corners| corners.map(|v| number_of[v as usize]));
    Mesh { positions: placed.collect(), triangles: merged(triangles) }
}

/// Triangles without those that have become edges or points; of those between the same vertices the two sides cancel
/// out, but for one of each where nothing else would be left.
fn merged(triangles: impl Iterator<Item = [u32; 3]>) -> Vec<[u32; 3]> {
    // By the vertices from the lowest one on, in one of the two windings.
    let mut found: Vec<([u32; 3], bool)> = vec![];
    for [a, b, c] in triangles {
        if a == b || b == c || c == a {
            continue;
        }
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        found.push((sorted, [a, b, c] == sorted || [b, c, a] == sorted || [c, a, b] == sorted));
    }
    found.sort_unstable();
    let sides = found.chunk_by(|a, b| a.0 == b.0).flat_map(|run| {
        let ([a, b, c], fronts) = (run[0].0, run.iter().filter(|(_, is_front)| *is_front).count());
        let (front, back) = match (fronts, run.len() - fronts) {
            (fronts, backs) if fronts == backs => (1, 1),
            (fronts, backs) => (fronts.saturating_sub(backs), backs.saturating_sub(fronts)),
        };
        std::iter::repeat_n([a, b, c], front).chain(std::iter::repeat_n([a, c, b], back))
    });
    sides.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

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
            let more = |most| has_more_triangles(&row, edge, most);
            // Perhaps it is not noticed, but never said wrongly.
            assert!(!more(coarse.triangles.len()) && more(0) != coarse.triangles.is_empty(), "{edge}");
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
