//! Extreme forms: thin, long, rolled up, self-intersecting, noisy.

use super::shapes::{Glue, Random, append, bumpy_sphere, displaced_cube, moved, quads, reversed, rolling, sheet};
use super::{Case, Input};
use crate::mesh::Mesh;
use glam::DVec3;
use std::f64::consts::TAU;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "finger",
        meaning: "length over width of a closed finger",
        dials: &[1.0, 10.0, 100.0, 1000.0, 10_000.0, 1e6],
        refused: &[],
        quick: &[1.0],
        make: finger,
    },
    Case {
        name: "fingers",
        meaning: "length over width of 100 fingers on a sheet",
        dials: &[1.0, 10.0, 100.0, 1000.0],
        refused: &[],
        quick: &[1000.0],
        make: fingers,
    },
    Case {
        name: "comb",
        meaning: "teeth of a flat comb",
        dials: &[10.0, 100.0, 1000.0, 10_000.0],
        refused: &[],
        quick: &[100.0],
        make: comb,
    },
    Case {
        name: "spiral",
        meaning: "turns of a rolled sheet of the same width",
        dials: &[1.0, 3.0, 10.0, 30.0, 100.0],
        refused: &[],
        quick: &[],
        make: spiral,
    },
    Case {
        name: "spheres",
        meaning: "spheres that intersect each other",
        dials: &[2.0, 5.0, 20.0, 50.0],
        refused: &[],
        quick: &[2.0],
        make: spheres,
    },
    Case {
        name: "knotted-tube",
        meaning: "radius of a tube around a knot of size 3; it intersects itself from 0.4 on",
        dials: &[0.1, 0.3, 0.5, 1.0, 2.0],
        refused: &[],
        quick: &[0.1],
        make: knotted_tube,
    },
    Case {
        name: "noise",
        meaning: "noise on a sphere, relative to the length of an edge",
        dials: &[0.0, 0.1, 0.3, 1.0, 3.0, 10.0],
        refused: &[],
        quick: &[1.0],
        make: noise,
    },
    Case {
        name: "zigzag",
        meaning: "height of waves at the sampling rate (every other vertex), relative to the length of an edge",
        dials: &[0.1, 1.0, 10.0, 100.0],
        refused: &[],
        quick: &[100.0],
        make: zigzag,
    },
    Case {
        name: "soup",
        meaning: "random triangles in a cube",
        dials: &[1.0, 10.0, 100.0, 1000.0, 10_000.0],
        refused: &[],
        quick: &[100.0],
        make: soup,
    },
    Case {
        name: "random-vertices",
        meaning: "triangles between 100 random vertices",
        dials: &[10.0, 30.0, 100.0],
        refused: &[],
        quick: &[30.0],
        make: random_vertices,
    },
    Case {
        name: "two-sheets",
        meaning: "distance of two sheets, relative to the length of an edge; at 0 they are one",
        dials: &[1.0, 1e-2, 1e-4, 1e-8, 1e-12, 0.0],
        refused: &[],
        quick: &[0.0],
        make: two_sheets,
    },
    Case {
        name: "plate",
        meaning: "thickness over width of a closed plate; at 0 its faces are the same",
        dials: &[1.0, 1e-1, 1e-2, 1e-4, 1e-8, 1e-12, 1e-16, 0.0],
        refused: &[],
        quick: &[1e-4, 0.0],
        make: plate,
    },
    Case {
        name: "shells",
        meaning: "distance of eight nested spheres, relative to their radius",
        dials: &[1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-9, 1e-12],
        refused: &[],
        quick: &[],
        make: shells,
    },
    Case {
        name: "star",
        meaning: "length of the spikes of a sphere, relative to its radius",
        dials: &[0.1, 1.0, 10.0, 100.0, 1e4, 1e6],
        refused: &[],
        quick: &[0.1],
        make: star,
    },
    Case {
        name: "folded",
        meaning: "folds of a strip, all in one plane",
        dials: &[1.0, 10.0, 100.0],
        refused: &[],
        quick: &[1.0],
        make: folded,
    },
];

/// A tube around the z axis with round ends, `length` times as long as wide.
fn finger_mesh(length: f64, along: u32, around: u32) -> Mesh {
    tube(along, around, |u, angle| {
        let t = u * (length + 1.0) - 0.5;
        let (radius, z) = if t < 0.0 {
            ((0.25 - t * t).max(0.0).sqrt(), t)
        } else if t > length {
            ((0.25 - (t - length) * (t - length)).max(0.0).sqrt(), t)
        } else {
            (0.5, t)
        };
        DVec3::new(radius * angle.cos(), radius * angle.sin(), z)
    })
}

/// A closed tube whose first and last rings are points.
fn tube(along: u32, around: u32, position_at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let mut mesh = quads([along - 2, around], [Glue::Open, Glue::Around], |u, v| {
        let ring = u * f64::from(along - 2) + 1.0;
        position_at(ring / f64::from(along), v * TAU)
    });
    for (ring, end, is_last) in [(0, 0.0, false), (along - 2, 1.0, true)] {
        let tip = mesh.positions.len() as u32;
        mesh.positions.push(position_at(end, 0.0) * DVec3::new(0.0, 0.0, 1.0));
        for i in 0..around {
            let (a, b) = (ring * around + i, ring * around + (i + 1) % around);
            mesh.triangles.push(if is_last { [a, b, tip] } else { [b, a, tip] });
        }
    }
    reversed(mesh)
}

fn finger(length: f64) -> Input {
    Input::new(finger_mesh(length, ((length * 8.0) as u32).clamp(24, 2000), 16))
}

fn fingers(length: f64) -> Input {
    let (n, per_finger) = (100, 10);
    Input::new(sheet([n, n], |x, y| {
        let middle = |t: f64| (t * f64::from(n)).round() as u32 % per_finger == per_finger / 2;
        let is_tip = middle(x) && middle(y);
        DVec3::new(x, y, if is_tip { length / f64::from(n) } else { 0.0 })
    }))
}

fn comb(teeth: f64) -> Input {
    let teeth = teeth as u32;
    let mut mesh = sheet([2 * teeth, 1], |x, y| DVec3::new(x, y * 0.1, 0.01 * (20.0 * x).sin()));
    for tooth in 0..teeth {
        let (a, b) = (4 * tooth + 1, 4 * tooth + 3);
        let first = mesh.positions.len() as u32;
        let [p, q] = [a, b].map(|v| mesh.positions[v as usize] + DVec3::Y * 0.9);
        mesh.positions.extend([p, q]);
        mesh.triangles.extend([[a, b, first + 1], [a, first + 1, first]]);
    }
    Input::new(mesh)
}

fn spiral(turns: f64) -> Input {
    Input::new(sheet([1200, 8], |u, v| {
        let (angle, radius) = (u * turns * TAU, 0.1 + 0.9 * u);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.4 * v)
    }))
}

fn spheres(count: f64) -> Input {
    let (mut mesh, mut random) = (Mesh::default(), Random(9));
    for _ in 0..count as u32 {
        let centre = random.point() * 0.8;
        append(&mut mesh, &moved(bumpy_sphere(10), |p| p + centre));
    }
    Input::new(mesh)
}

fn knotted_tube(radius: f64) -> Input {
    let knot = |t: f64| {
        let a = t * TAU;
        DVec3::new(
            (2.0 + (3.0 * a).cos()) * (2.0 * a).cos(),
            (2.0 + (3.0 * a).cos()) * (2.0 * a).sin(),
            (3.0 * a).sin(),
        )
    };
    Input::new(quads([400, 16], [Glue::Around; 2], |u, v| {
        let tangent = (knot(u + 1e-4) - knot(u - 1e-4)).normalize();
        let side = tangent.cross(DVec3::Z).normalize();
        let (s, c) = (v * TAU).sin_cos();
        knot(u) + (side * c + tangent.cross(side) * s) * radius
    }))
}

fn noise(amount: f64) -> Input {
    let (mut mesh, mut random) = (bumpy_sphere(16), Random(4));
    let length = amount * mesh.mean_edge_length();
    for p in &mut mesh.positions {
        *p += random.point() * length;
    }
    Input::new(mesh)
}

fn zigzag(height: f64) -> Input {
    let n = 64;
    let side = |t: f64| (t * f64::from(n)).round() as u32;
    Input::new(sheet([n, n], |x, y| {
        let up = if (side(x) + side(y)).is_multiple_of(2) { 0.5 } else { -0.5 };
        DVec3::new(x, y, up * height / f64::from(n))
    }))
}

fn soup(count: f64) -> Input {
    let (mut mesh, mut random) = (Mesh::default(), Random(6));
    for i in 0..count as u32 {
        let centre = random.point();
        mesh.positions.extend([(); 3].map(|()| centre + random.point() * 0.2));
        mesh.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    Input::new(mesh)
}

fn random_vertices(count: f64) -> Input {
    let mut random = Random(8);
    let positions = (0..100).map(|_| random.point()).collect();
    // Of three different vertices each: repair drops the others and reports it.
    let mut triangle = || {
        let [a, b, c] = [100, 99, 98].map(|left| (random.unit() * f64::from(left)) as u32);
        let b = (a + 1 + b) % 100;
        let c = (0..100).filter(|&c| c != a && c != b).nth(c as usize).unwrap_or(0);
        [a, b, c]
    };
    let triangles = (0..count as u32).map(|_| triangle()).collect();
    Input::new(Mesh { positions, triangles })
}

fn two_sheets(distance: f64) -> Input {
    let n = 48;
    let one = sheet([n, n], |x, y| DVec3::new(x, y, rolling(x, y)));
    let mut mesh = one.clone();
    append(&mut mesh, &reversed(moved(one, |p| p + DVec3::Z * (distance / f64::from(n)))));
    Input::new(mesh)
}

fn plate(thickness: f64) -> Input {
    Input::new(displaced_cube(24, |p| DVec3::new(p.x, p.y, p.z * thickness)))
}

fn shells_mesh(distance: f64) -> Mesh {
    let mut mesh = Mesh::default();
    for shell in 0..8 {
        append(&mut mesh, &moved(bumpy_sphere(12), |p| p * (1.0 + f64::from(shell) * distance)));
    }
    mesh
}

fn shells(distance: f64) -> Input {
    Input::new(shells_mesh(distance))
}

fn star(length: f64) -> Input {
    let mut mesh = bumpy_sphere(24);
    for p in mesh.positions.iter_mut().step_by(7) {
        *p *= 1.0 + length;
    }
    Input::new(mesh)
}

fn folded(folds: f64) -> Input {
    let n = 20 * folds as u32;
    Input::new(sheet([n, 10], |u, v| {
        let t = u * folds;
        let x = if (t.floor() as u32).is_multiple_of(2) { t.fract() } else { 1.0 - t.fract() };
        DVec3::new(x, v, 0.0)
    }))
}
