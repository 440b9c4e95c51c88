//! Extreme topology: handles, holes, components, one-sided surfaces, edges of many triangles.

use super::shapes::{Glue, Random, append, bumpy_sphere, fan, moved, quads, rolling, sheet, tetrahedron, voxels};
use super::{Case, Input};
use crate::mesh::Mesh;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// With more components or holes, distances are sampled.
const MEASURED_COUNT: u32 = 20_000;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "genus",
        meaning: "handles of a plate with square tunnels",
        dials: &[0.0, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0, 300.0, 1000.0],
        refused: &[],
        quick: &[10.0],
        make: genus,
    },
    Case {
        name: "menger",
        meaning: "depth of a Menger sponge",
        dials: &[0.0, 1.0, 2.0, 3.0],
        refused: &[],
        quick: &[2.0],
        make: menger,
    },
    Case {
        name: "sierpinski",
        meaning: "depth of a Sierpinski tetrahedron, whose parts touch at vertices",
        dials: &[0.0, 2.0, 4.0, 6.0, 7.0],
        refused: &[],
        quick: &[0.0],
        make: sierpinski,
    },
    Case {
        name: "components",
        meaning: "number of tetrahedra",
        dials: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e5],
        refused: &[],
        quick: &[1e2],
        make: components,
    },
    Case {
        name: "holes",
        meaning: "holes of a sheet",
        dials: &[1.0, 1e2, 1e3, 1e4, 1e5],
        refused: &[],
        quick: &[1e2],
        make: holes,
    },
    Case {
        name: "moebius",
        meaning: "half twists of a strip",
        dials: &[0.0, 1.0, 2.0, 3.0, 9.0, 99.0],
        refused: &[],
        quick: &[1.0],
        make: moebius,
    },
    Case {
        name: "klein",
        meaning: "cells around a Klein bottle",
        dials: &[4.0, 16.0, 64.0, 128.0],
        refused: &[],
        quick: &[16.0],
        make: klein,
    },
    Case {
        name: "book",
        meaning: "pages at one edge",
        dials: &[2.0, 3.0, 10.0, 1e2, 1e3],
        refused: &[],
        quick: &[1e2],
        make: book,
    },
    Case {
        name: "touching-cones",
        meaning: "cones at one vertex",
        dials: &[2.0, 10.0, 1e2],
        refused: &[],
        quick: &[10.0],
        make: touching_cones,
    },
    Case {
        name: "winding",
        meaning: "share of the triangles that are wound the other way",
        dials: &[0.0, 0.01, 0.1, 0.5, 1.0],
        refused: &[],
        quick: &[0.5],
        make: winding,
    },
    Case {
        name: "copies",
        meaning: "copies of each triangle",
        dials: &[1.0, 2.0, 10.0, 100.0],
        refused: &[],
        quick: &[10.0],
        make: copies,
    },
    Case {
        name: "few",
        meaning: "triangles; with none there is nothing to build",
        dials: &[0.0, 1.0, 2.0, 3.0, 4.0],
        refused: &[0.0],
        quick: &[0.0, 1.0, 4.0],
        make: |count| {
            let mut mesh = tetrahedron(DVec3::ZERO, 1.0);
            mesh.triangles.truncate(count as usize);
            Input::new(mesh)
        },
    },
    Case {
        name: "points",
        meaning: "triangles, all of them without area",
        dials: &[1.0, 1e2, 1e4],
        refused: &[1.0, 1e2, 1e4],
        quick: &[1e2],
        make: points,
    },
];

fn genus(handles: f64) -> Input {
    let handles = handles as i32;
    let side = (1..).find(|side| side * side >= handles).unwrap_or(1);
    let size = [2 * side + 1, 2 * side + 1, 1];
    Input::new(voxels(size, |[x, y, _]| !(x % 2 == 1 && y % 2 == 1 && x / 2 * side + y / 2 < handles)))
}

fn menger(depth: f64) -> Input {
    let size = 3i32.pow(depth as u32);
    let is_filled = |[mut x, mut y, mut z]: [i32; 3]| {
        while x + y + z > 0 {
            if [x % 3, y % 3, z % 3].into_iter().filter(|&digit| digit == 1).count() > 1 {
                return false;
            }
            (x, y, z) = (x / 3, y / 3, z / 3);
        }
        true
    };
    Input::new(voxels([size; 3], is_filled))
}

fn sierpinski(depth: f64) -> Input {
    fn divide(mesh: &mut Mesh, corners: [DVec3; 4], depth: u32) {
        if depth == 0 {
            let first = mesh.positions.len() as u32;
            mesh.positions.extend(corners);
            mesh.triangles.extend([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]].map(|t| t.map(|v: u32| v + first)));
            return;
        }
        for corner in corners {
            divide(mesh, corners.map(|other| corner.midpoint(other)), depth - 1);
        }
    }
    let whole = tetrahedron(DVec3::ZERO, 1.0);
    let mut mesh = Mesh::default();
    divide(&mut mesh, [0, 1, 2, 3].map(|v| whole.positions[v]), depth as u32);
    Input::new(mesh)
}

fn components(count: f64) -> Input {
    let count = count as u32;
    let side = (1..).find(|side| side * side * side >= count).unwrap_or(1);
    let mut mesh = Mesh::default();
    for i in 0..count {
        let cell = [i % side, i / side % side, i / side / side].map(f64::from);
        append(&mut mesh, &tetrahedron(DVec3::from_array(cell), 0.3));
    }
    Input { sampled: count > MEASURED_COUNT, ..Input::new(mesh) }
}

fn holes(count: f64) -> Input {
    let count = count as usize;
    let side = (1..).find(|side| side * side >= count).unwrap_or(1) as u32;
    let n = 2 * side + 1;
    let mut mesh = sheet([n, n], |x, y| DVec3::new(x, y, rolling(x, y)));
    let mut left = count;
    let mut cell = 0;
    mesh.triangles.retain(|_| {
        let (i, j) = (cell / 2 / n, cell / 2 % n);
        let is_first = cell % 2 == 0;
        cell += 1;
        let is_hole = i % 2 == 1 && j % 2 == 1 && left > 0;
        left -= usize::from(is_hole && !is_first);
        !is_hole
    });
    Input { sampled: count > MEASURED_COUNT as usize, ..Input::new(mesh) }
}

fn moebius(half_twists: f64) -> Input {
    let glue = if half_twists % 2.0 == 1.0 { Glue::Mirrored } else { Glue::Around };
    Input::new(quads([256, 8], [glue, Glue::Open], |u, v| {
        let (angle, across, twist) = (u * TAU, (v - 0.5) * 0.6, u * PI * half_twists);
        let radius = 1.0 + across * twist.cos();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), across * twist.sin())
    }))
}

/// The figure-eight immersion.
fn klein(cells: f64) -> Input {
    let n = cells as u32;
    Input::new(quads([n, n], [Glue::Mirrored, Glue::Around], |u, v| {
        let (angle, around) = (u * TAU, v * TAU);
        let (s, c) = (angle / 2.0).sin_cos();
        let radius = 2.0 + c * around.sin() - s * (2.0 * around).sin();
        let height = s * around.sin() + c * (2.0 * around).sin();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), height)
    }))
}

fn book(pages: f64) -> Input {
    let pages = pages as u32;
    let mut mesh = Mesh { positions: vec![DVec3::ZERO, DVec3::Z], triangles: vec![] };
    for i in 0..pages {
        let angle = f64::from(i) / f64::from(pages) * TAU;
        mesh.positions.push(DVec3::new(angle.cos(), angle.sin(), 0.5));
        mesh.triangles.push([0, 1, i + 2]);
    }
    Input::new(mesh)
}

fn touching_cones(count: f64) -> Input {
    let mut random = Random(5);
    let mut mesh = Mesh::default();
    for _ in 0..count as u32 {
        let axis = random.point().normalize_or_zero();
        let side = axis.any_orthonormal_vector();
        let other = axis.cross(side);
        let cone = fan(12, 0.0);
        append(&mut mesh, &moved(cone, |p| (side * p.x + other * p.y) * 0.2 + axis * (p.truncate().length() + p.z)));
    }
    Input::new(mesh)
}

fn winding(share: f64) -> Input {
    let (mut mesh, mut random) = (bumpy_sphere(24), Random(2));
    for t in &mut mesh.triangles {
        if random.unit() < share {
            t.swap(1, 2);
        }
    }
    Input::new(mesh)
}

fn copies(count: f64) -> Input {
    let mut mesh = bumpy_sphere(12);
    let once = mesh.triangles.clone();
    for i in 1..count as usize {
        mesh.triangles.extend(once.iter().map(|&[a, b, c]| if i % 2 == 1 { [b, a, c] } else { [b, c, a] }));
    }
    Input::new(mesh)
}

fn points(count: f64) -> Input {
    let mut mesh = Mesh::default();
    for i in 0..count as u32 {
        let x = f64::from(3 * i);
        mesh.positions.extend([0.0, 1.0, 2.0].map(|k| DVec3::splat(x + k)));
        mesh.triangles.push([3 * i, 3 * i + 1, if i % 2 == 0 { 3 * i + 2 } else { 3 * i }]);
    }
    Input::new(mesh)
}
