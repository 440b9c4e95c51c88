//! Stiff meshes: triangles and edges of very different shapes and lengths side by side.

use super::shapes::{Glue, append, fan, moved, quads, reversed, rolling, sheet};
use super::{Case, Input};
use crate::mesh::Mesh;
use crate::mesh::tolerance::Tolerance;
use glam::DVec3;
use std::f64::consts::TAU;

/// For fans with more needles, distances are sampled.
const MEASURED_VALENCE: f64 = 2e4;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "aspect",
        meaning: "length over height of the triangles of a sheet",
        dials: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8, 1e10, 1e12],
        refused: &[],
        quick: &[10.0, 1e12],
        make: aspect,
    },
    Case {
        name: "aspect-fine",
        meaning: "the same, with a tolerance of half the shorter edge",
        dials: &[1.0, 10.0, 1e2, 1e3, 1e4, 1e6, 1e8, 1e10, 1e12],
        refused: &[1e10, 1e12],
        quick: &[1e12],
        make: aspect_fine,
    },
    Case {
        name: "decades",
        meaning: "decades of edge lengths in one sheet",
        dials: &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0],
        refused: &[],
        quick: &[12.0],
        make: decades,
    },
    Case {
        name: "decades-fine",
        meaning: "the same, with a tolerance of half the shortest edge",
        dials: &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0],
        refused: &[10.0, 12.0],
        quick: &[12.0, 4.0],
        make: decades_fine,
    },
    Case {
        name: "horn",
        meaning: "decades by which a closed horn narrows, and its edges with it",
        dials: &[1.0, 3.0, 6.0, 9.0, 12.0],
        refused: &[],
        quick: &[6.0],
        make: horn,
    },
    Case {
        name: "polar",
        meaning: "decades of the radii of a polar grid",
        dials: &[1.0, 3.0, 6.0, 9.0, 12.0, 15.0],
        refused: &[],
        quick: &[12.0],
        make: polar,
    },
    Case {
        name: "weights",
        meaning: "decades over which the weights of the embedding's linear systems are spread",
        dials: &[0.0, 3.0, 6.0, 9.0, 12.0, 15.0],
        refused: &[],
        quick: &[9.0],
        make: weights,
    },
    Case {
        name: "anisotropic",
        meaning: "cells along one side of a square, relative to cells along the other",
        dials: &[1.0, 16.0, 256.0, 4096.0, 16384.0],
        refused: &[],
        quick: &[],
        make: anisotropic,
    },
    Case {
        name: "fan",
        meaning: "needles around the tip of a cone",
        dials: &[3.0, 1e2, 1e3, 1e4, 1e5],
        refused: &[],
        quick: &[1e3],
        make: |valence| Input { sampled: valence > MEASURED_VALENCE, ..Input::new(fan(valence as u32, 0.5)) },
    },
    Case {
        name: "two-fans",
        meaning: "needles around each tip of a closed double cone",
        dials: &[3.0, 1e2, 1e3, 1e4, 1e5],
        refused: &[],
        quick: &[3.0],
        make: two_fans,
    },
    Case {
        name: "caps",
        meaning: "height over length of flat triangles, as a power of ten",
        dials: &[-1.0, -2.0, -4.0, -6.0, -8.0, -12.0, -15.0],
        refused: &[],
        quick: &[-1.0],
        make: caps,
    },
];

fn aspect_mesh(aspect: f64) -> Mesh {
    sheet([48, 48], |x, y| DVec3::new(x, y / aspect, rolling(x, y)))
}

fn aspect(aspect: f64) -> Input {
    Input::new(aspect_mesh(aspect))
}

fn aspect_fine(aspect: f64) -> Input {
    Input { tolerance: Tolerance::InputUnits(0.5 / 48.0 / aspect), ..Input::new(aspect_mesh(aspect)) }
}

fn decades_mesh(decades: f64) -> Mesh {
    let coordinate = |t: f64| if decades == 0.0 { t } else { 10f64.powf(-decades * (1.0 - t)) };
    sheet([48, 48], |u, v| {
        let (x, y) = (coordinate(u), coordinate(v));
        DVec3::new(x, y, 0.05 * (x * y).sqrt() * (9.0 * u).sin() * (7.0 * v).cos())
    })
}

fn decades(decades: f64) -> Input {
    Input::new(decades_mesh(decades))
}

fn decades_fine(decades: f64) -> Input {
    Input { tolerance: Tolerance::InputUnits(0.01 * 10f64.powf(-decades)), ..Input::new(decades_mesh(decades)) }
}

fn horn(decades: f64) -> Input {
    let (along, around) = (96, 24);
    let mut mesh = quads([along, around], [Glue::Open, Glue::Around], |u, v| {
        let (radius, angle) = (10f64.powf(-decades * u), v * TAU);
        DVec3::new(0.4 * radius * angle.cos(), 0.4 * radius * angle.sin(), 1.0 - radius)
    });
    for (ring, is_last) in [(0, false), (along, true)] {
        let first = ring * around;
        let tip = mesh.positions[first as usize];
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(DVec3::new(0.0, 0.0, tip.z));
        for i in 0..around {
            let (a, b) = (first + i, first + (i + 1) % around);
            mesh.triangles.push(if is_last { [a, b, middle] } else { [b, a, middle] });
        }
    }
    // Outward.
    Input::new(reversed(mesh))
}

fn polar_mesh(decades: f64) -> Mesh {
    let around = 48;
    let mut mesh = quads([96, around], [Glue::Open, Glue::Around], |u, v| {
        let (radius, angle) = (10f64.powf(-decades * u), v * TAU);
        DVec3::new(radius * angle.cos(), radius * angle.sin(), 0.1 * radius * (5.0 * angle).sin())
    });
    let middle = mesh.positions.len() as u32;
    mesh.positions.push(DVec3::ZERO);
    mesh.triangles.extend((0..around).map(|i| [96 * around + i, 96 * around + (i + 1) % around, middle]));
    mesh
}

fn polar(decades: f64) -> Input {
    Input::new(polar_mesh(decades))
}

fn weights(decades: f64) -> Input {
    Input { weight_decades: decades, ..Input::new(sheet([64, 64], |x, y| DVec3::new(x, y, rolling(x, y)))) }
}

fn anisotropic(ratio: f64) -> Input {
    let across = (16384.0 / ratio).sqrt();
    Input::new(sheet([(across * ratio) as u32, across as u32], |x, y| DVec3::new(x, y, rolling(x, y))))
}

fn two_fans(valence: f64) -> Input {
    let mut mesh = fan(valence as u32, 0.5);
    append(&mut mesh, &reversed(fan(valence as u32, -0.5)));
    Input { sampled: valence > MEASURED_VALENCE, ..Input::new(mesh) }
}

/// Rows of vertices with every other one pushed almost onto the straight line between its neighbours.
fn caps(power: f64) -> Input {
    let height = 10f64.powf(power);
    let n = 40;
    let base = sheet([n, n], |x, y| DVec3::new(x, y, rolling(x, y)));
    let mut mesh = Mesh { positions: base.positions.clone(), triangles: vec![] };
    for &[a, b, c] in &base.triangles {
        let [p, q, r] = [a, b, c].map(|v| base.positions[v as usize]);
        let middle = mesh.positions.len() as u32;
        mesh.positions.push(p.midpoint(q).lerp(r, height));
        mesh.triangles.extend([[a, b, middle], [b, c, middle], [c, a, middle]]);
    }
    Input::new(moved(mesh, |p| p))
}
