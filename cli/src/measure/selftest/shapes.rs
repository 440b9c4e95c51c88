//! The building blocks of the generators: sheets, tubes, cubes, voxels, random numbers.

use crate::mesh::Mesh;
use glam::DVec3;
use std::collections::HashMap;
use std::f64::consts::TAU;

pub use crate::measure::random::Random;

/// How the edges of a parameter rectangle are glued.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Glue {
    /// The edges stay open.
    Open,
    /// The end continues at the beginning.
    Around,
    /// The end continues at the beginning, mirrored in the other parameter.
    Mirrored,
}

/// `n[0]` by `n[1]` quads of two triangles over the unit square, with both parameters glued as asked. Only the first
/// may be mirrored.
pub fn quads(n: [u32; 2], glue: [Glue; 2], position_at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let points = [0, 1].map(|k| if glue[k] == Glue::Open { n[k] + 1 } else { n[k] });
    let positions = (0..points[0])
        .flat_map(|i| (0..points[1]).map(move |j| (f64::from(i) / f64::from(n[0]), f64::from(j) / f64::from(n[1]))))
        .map(|(u, v)| position_at(u, v))
        .collect();
    let at = |i: u32, j: u32| {
        let j = if i == n[0] && glue[0] == Glue::Mirrored { n[1] - j } else { j };
        (i % points[0].max(1)) * points[1] + j % points[1].max(1)
    };
    let triangles = (0..n[0])
        .flat_map(|i| (0..n[1]).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles }
}

/// An open sheet.
pub fn sheet(n: [u32; 2], position_at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    quads(n, [Glue::Open; 2], position_at)
}

/// A rolling height over the unit square.
pub fn rolling(x: f64, y: f64) -> f64 {
    0.08 * (9.0 * x).sin() * (7.0 * y).cos()
}

/// A closed unit cube-sphere with smooth bumps: 12 n^2 triangles.
pub fn bumpy_sphere(n: u32) -> Mesh {
    displaced_cube(n, |p| {
        let d = p.normalize();
        let h = (3.0 * d.x + 1.0).sin() * (4.0 * d.y).cos() + 0.4 * (9.0 * d.z + 5.0 * d.x).sin();
        d * (1.0 + 0.12 * h)
    })
}

/// The surface of the cube [-1, 1]^3, with n by n quads per face, welded, and moved by a function.
pub fn displaced_cube(n: u32, position_at: impl Fn(DVec3) -> DVec3) -> Mesh {
    let mut index: HashMap<[u32; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    for axis in 0..3 {
        for side in [0, n] {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let mut corner = |u: u32, v: u32| {
                    let mut key = [0; 3];
                    (key[axis], key[(axis + 1) % 3], key[(axis + 2) % 3]) = (side, u, v);
                    *index.entry(key).or_insert_with(|| {
                        let p = key.map(|k| f64::from(k) / f64::from(n) * 2.0 - 1.0);
                        mesh.positions.push(position_at(DVec3::from_array(p)));
                        mesh.positions.len() as u32 - 1
                    })
                };
                let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                mesh.triangles.extend(if side == n { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
            }
        }
    }
    mesh
}

/// The surface between the filled and the empty unit cells of a box with a corner at the origin, welded.
pub fn voxels(size: [i32; 3], is_filled: impl Fn([i32; 3]) -> bool) -> Mesh {
    let filled = |cell: [i32; 3]| (0..3).all(|k| (0..size[k]).contains(&cell[k])) && is_filled(cell);
    let mut index: HashMap<[i32; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    for x in 0..size[0] {
        for y in 0..size[1] {
            for z in 0..size[2] {
                let cell = [x, y, z];
                if !filled(cell) {
                    continue;
                }
                for (axis, side) in (0..3).flat_map(|axis| [(axis, 0), (axis, 1)]) {
                    let mut beside = cell;
                    beside[axis] += 2 * side - 1;
                    if filled(beside) {
                        continue;
                    }
                    let mut corner = |u: i32, v: i32| {
                        let mut key = cell;
                        key[axis] += side;
                        key[(axis + 1) % 3] += u;
                        key[(axis + 2) % 3] += v;
                        *index.entry(key).or_insert_with(|| {
                            mesh.positions.push(DVec3::from_array(key.map(f64::from)));
                            mesh.positions.len() as u32 - 1
                        })
                    };
                    let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                    mesh.triangles.extend(if side == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
                }
            }
        }
    }
    mesh
}

/// A fan of needles around a tip above or below the origin, `height` high. Its rim about the unit circle is wavy, so no
/// two needles are alike.
pub fn fan(valence: u32, height: f64) -> Mesh {
    let rim = |i: u32| {
        let angle = f64::from(i) / f64::from(valence) * TAU;
        DVec3::new(angle.cos(), angle.sin(), 0.0) * (1.0 + 0.2 * (3.0 * angle).sin())
            + DVec3::Z * 0.1 * (5.0 * angle).sin()
    };
    let positions = std::iter::once(DVec3::Z * height).chain((0..valence).map(rim)).collect();
    let triangles = (0..valence).map(|i| [0, 1 + i, 1 + (i + 1) % valence]).collect();
    Mesh { positions, triangles }
}

/// Appends a mesh to another.
pub fn append(mesh: &mut Mesh, other: &Mesh) {
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(&other.positions);
    mesh.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first)));
}

/// The mesh with its vertices moved.
pub fn moved(mut mesh: Mesh, position_at: impl Fn(DVec3) -> DVec3) -> Mesh {
    for p in &mut mesh.positions {
        *p = position_at(*p);
    }
    mesh
}

/// The mesh with reversed winding.
pub fn reversed(mut mesh: Mesh) -> Mesh {
    for t in &mut mesh.triangles {
        t.swap(1, 2);
    }
    mesh
}

/// A regular tetrahedron around a point.
pub fn tetrahedron(centre: DVec3, size: f64) -> Mesh {
    let corners = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    Mesh {
        positions: corners.map(|c| centre + DVec3::from_array(c) * size).to_vec(),
        triangles: vec![[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stage::repair::repair;

    #[test]
    fn closed_shapes_need_no_repair() {
        let around = quads([8, 6], [Glue::Around; 2], |u, v| {
            let (u, v) = (u * TAU, v * TAU);
            DVec3::new((2.0 + v.cos()) * u.cos(), (2.0 + v.cos()) * u.sin(), v.sin())
        });
        let ring = voxels([3, 3, 1], |cell| cell != [1, 1, 0]);
        for (mesh, characteristic) in [(bumpy_sphere(3), 2), (around, 0), (ring, 0), (tetrahedron(DVec3::X, 2.0), 2)] {
            let (vertices, triangles) = (mesh.positions.len() as i64, mesh.triangles.len() as i64);
            assert_eq!(vertices - triangles / 2, characteristic);
            let (_, _, report) = repair(mesh);
            assert_eq!((report.boundary_edges, report.flipped_faces, report.components), (0, 0, 1));
            assert_eq!(report.degenerate_faces + report.welded_vertices + report.nonmanifold_edges_cut, 0);
        }
    }

    #[test]
    fn a_mirrored_strip_has_one_side() {
        let strip = quads([9, 2], [Glue::Mirrored, Glue::Open], |u, v| {
            let (angle, across) = (u * TAU, v - 0.5);
            let radius = 1.0 + across * (angle / 2.0).cos();
            DVec3::new(radius * angle.cos(), radius * angle.sin(), across * (angle / 2.0).sin())
        });
        assert!(repair(strip).2.unorientable_edges_cut > 0);
    }
}
