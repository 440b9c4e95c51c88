//! The surface between points inside and outside: six tetrahedra per cell, all along the cell's main diagonal, so that
//! the diagonals of neighbouring cells' faces agree.

use super::inside::Inside;
use lodpack_mesh::NONE;

/// Corners of a cell as bits of their offsets (1: x, 2: y, 4: z). Each tetrahedron walks from corner 0 to corner 7
/// along the axes in one order; the last two are swapped where that makes it right-handed.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [0, 3, 2, 7], [0, 6, 4, 7], [0, 5, 1, 7]];

/// A new vertex: where a lattice edge leaves the solid.
pub(super) struct Crossing {
    /// The points inside and outside.
    pub ends: [u32; 2],
}

/// The new vertices, and the triangles between them, counter-clockwise seen from outside.
pub(super) fn triangulate(inside: &Inside) -> (Vec<Crossing>, Vec<[u32; 3]>) {
    let [x_count, y_count, z_count] = inside.counts();
    let mut mesher =
        Mesher { inside, plane: 8 * y_count * z_count, numbers: vec![], crossings: vec![], triangles: vec![] };
    mesher.numbers.resize(2 * mesher.plane, NONE);
    for i in 0..x_count - 1 {
        mesher.forget_plane(i + 1);
        for j in 0..y_count - 1 {
            for k in 0..z_count - 1 {
                let corners: [u32; 8] =
                    std::array::from_fn(|bits| inside.node([i + (bits & 1), j + (bits >> 1 & 1), k + (bits >> 2)]));
                let count = corners.iter().filter(|&&node| inside.contains(node)).count();
                if count == 0 || count == 8 {
                    continue;
                }
                for tetrahedron in TETRAHEDRA {
                    mesher.visit(tetrahedron.map(|bits| Corner { node: corners[bits], bits }));
                }
            }
        }
    }
    (mesher.crossings, mesher.triangles)
}

/// A corner of a cell.
#[derive(Clone, Copy)]
struct Corner {
    node: u32,
    /// Its offset in the cell.
    bits: usize,
}

struct Mesher<'a> {
    inside: &'a Inside,
    /// Entries of a plane of points with the same x.
    plane: usize,
    /// For two planes in turn, by the lower end of an edge and its direction as bits: the number of the vertex on it,
    /// or [`NONE`].
    numbers: Vec<u32>,
    crossings: Vec<Crossing>,
    triangles: Vec<[u32; 3]>,
}

impl Mesher<'_> {
    /// Makes room for the edges that begin in a plane.
    fn forget_plane(&mut self, i: usize) {
        let first = (i & 1) * self.plane;
        self.numbers[first..first + self.plane].fill(NONE);
    }

    /// Adds what a right-handed tetrahedron has of the surface.
    fn visit(&mut self, corners: [Corner; 4]) {
        let is_inside = corners.map(|corner| self.inside.contains(corner.node));
        match is_inside.iter().filter(|&&is| is).count() {
            1 => {
                let apex = is_inside.iter().position(|&is| is).unwrap_or(0);
                let [p, q, r] = others(corners, apex);
                let triangle = [p, q, r].map(|outer| self.crossing(corners[apex], outer));
                self.triangles.push(triangle);
            }
            3 => {
                let apex = is_inside.iter().position(|&is| !is).unwrap_or(0);
                let [p, q, r] = others(corners, apex);
                let triangle = [p, r, q].map(|inner| self.crossing(inner, corners[apex]));
                self.triangles.push(triangle);
            }
            2 => {
                // An even permutation that brings the two inside to the front.
                let [a, b, c, d] = match is_inside {
                    [true, true, ..] => corners,
                    [true, false, true, _] => pick(corners, [0, 2, 3, 1]),
                    [true, ..] => pick(corners, [0, 3, 1, 2]),
                    [_, true, true, _] => pick(corners, [1, 2, 0, 3]),
                    [_, true, ..] => pick(corners, [1, 3, 2, 0]),
                    _ => pick(corners, [2, 3, 0, 1]),
                };
                let [ac, ad, bc, bd] =
                    [[a, c], [a, d], [b, c], [b, d]].map(|[inner, outer]| self.crossing(inner, outer));
                self.triangles.extend([[ac, ad, bd], [ac, bd, bc]]);
            }
            _ => {}
        }
    }

    fn crossing(&mut self, inner: Corner, outer: Corner) -> u32 {
        // All edges of the tetrahedra go from a corner to one with larger offsets.
        let (low, high) = if inner.bits < outer.bits { (inner, outer) } else { (outer, inner) };
        let slot = (8 * low.node as usize + (high.bits - low.bits)) % (2 * self.plane);
        if self.numbers[slot] == NONE {
            self.numbers[slot] = self.crossings.len() as u32;
            self.crossings.push(Crossing { ends: [inner.node, outer.node] });
        }
        self.numbers[slot]
    }
}

fn pick(corners: [Corner; 4], order: [usize; 4]) -> [Corner; 4] {
    order.map(|k| corners[k])
}

/// The other three corners of a right-handed tetrahedron, counter-clockwise seen from outside of it, opposite the apex.
fn others(corners: [Corner; 4], apex: usize) -> [Corner; 3] {
    let [a, b, c, d] = corners;
    match apex {
        0 => [b, c, d],
        1 => [a, d, c],
        2 => [a, b, d],
        _ => [a, c, b],
    }
}
