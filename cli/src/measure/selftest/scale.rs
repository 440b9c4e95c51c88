//! Extreme scales: sizes, offsets, and small things beside large ones.

use super::shapes::{append, bumpy_sphere, displaced_cube, moved, sheet};
use super::{Case, Input};
use crate::mesh::tolerance::Tolerance;
use glam::DVec3;

pub(super) const CASES: &[Case] = &[
    Case {
        name: "size",
        meaning: "size of a model, as a power of ten",
        dials: &[
            -320.0, -300.0, -100.0, -45.0, -38.0, -30.0, -15.0, 0.0, 15.0, 30.0, 38.0, 45.0, 100.0, 160.0, 300.0, 308.0,
        ],
        refused: &[-320.0, -300.0, -100.0, -45.0, 45.0, 100.0, 160.0, 300.0, 308.0],
        quick: &[-320.0, -30.0, 30.0, 308.0],
        make: |power| Input::new(moved(bumpy_sphere(24), |p| p * 10f64.powf(power * 0.5) * 10f64.powf(power * 0.5))),
    },
    Case {
        name: "offset",
        meaning: "distance of a model of size 2 from the origin, as a power of ten",
        dials: &[0.0, 3.0, 6.0, 9.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 30.0],
        refused: &[13.0, 14.0, 15.0, 16.0, 17.0, 30.0],
        quick: &[15.0, 9.0],
        make: |power| Input::new(moved(bumpy_sphere(24), |p| p + DVec3::new(1.0, -0.6, 0.3) * 10f64.powf(power))),
    },
    Case {
        name: "millimetres",
        meaning: "the same, in metres with a tolerance of a millimetre",
        dials: &[0.0, 3.0, 6.0, 9.0, 10.0, 11.0, 12.0, 13.0],
        refused: &[13.0],
        quick: &[13.0],
        make: millimetres,
    },
    Case {
        name: "bolt",
        meaning: "radius of a planet on which a bolt of 1 cm lies, as a power of ten, with a tolerance of a millimetre",
        dials: &[-2.0, 0.0, 2.0, 4.0, 6.8, 7.5, 9.0, 12.0],
        refused: &[9.0, 12.0],
        quick: &[9.0],
        make: |power| Input { tolerance: Tolerance::InputUnits(1e-3), ..bolt(power) },
    },
    Case {
        name: "bolt-auto",
        meaning: "the same, with the automatic tolerance",
        dials: &[-2.0, 0.0, 2.0, 4.0, 6.8, 9.0, 12.0, 15.0],
        refused: &[],
        quick: &[6.8],
        make: bolt,
    },
    Case {
        name: "denormal",
        meaning: "height of the waves of a sheet of size 1, as a power of ten",
        dials: &[-10.0, -20.0, -100.0, -200.0, -300.0, -308.0, -315.0, -323.0],
        refused: &[],
        quick: &[-315.0],
        make: denormal,
    },
    Case {
        name: "spike",
        meaning: "distance of one vertex of a model of size 2, as a power of ten",
        dials: &[1.0, 3.0, 6.0, 9.0, 12.0, 20.0, 38.0, 45.0, 300.0],
        refused: &[45.0, 300.0],
        quick: &[6.0, 300.0],
        make: spike,
    },
    Case {
        name: "spike-fine",
        meaning: "the same, with a tolerance of 0.01",
        dials: &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 12.0, 20.0, 38.0],
        refused: &[12.0, 20.0, 38.0],
        quick: &[20.0, 3.0],
        make: |power| Input { tolerance: Tolerance::InputUnits(0.01), ..spike(power) },
    },
    Case {
        name: "tolerance",
        meaning: "tolerance relative to the size of a model, as a power of ten",
        dials: &[6.0, 0.0, -1.0, -2.0, -3.0, -4.0, -6.0, -8.0, -10.0, -11.0, -12.0, -16.0, -300.0],
        refused: &[-11.0, -12.0, -16.0, -300.0],
        quick: &[0.0, -16.0],
        make: |power| Input {
            tolerance: Tolerance::InputUnits(2.0 * 10f64.powf(power)),
            ..Input::new(bumpy_sphere(24))
        },
    },
];

fn millimetres(power: f64) -> Input {
    let offset = DVec3::new(1.0, -0.6, 0.3) * 10f64.powf(power);
    Input { tolerance: Tolerance::InputUnits(1e-3), ..Input::new(moved(bumpy_sphere(24), |p| p + offset)) }
}

fn bolt(power: f64) -> Input {
    let radius = 10f64.powf(power);
    let mut mesh = displaced_cube(16, |p| p.normalize() * radius);
    // A drum of 1 cm with a thinner shaft.
    let bolt = displaced_cube(8, |p| {
        let square = p.x.abs().max(p.y.abs());
        let round = DVec3::new(p.x, p.y, 0.0).normalize_or_zero() * square;
        let width = if p.z > 0.4 { 0.005 } else { 0.002 };
        DVec3::new(round.x * width, round.y * width, p.z * 0.005)
    });
    append(&mut mesh, &moved(bolt, |p| p + DVec3::Z * (radius + 0.005)));
    Input::new(mesh)
}

fn denormal(power: f64) -> Input {
    let height = 10f64.powf(power * 0.5) * 10f64.powf(power * 0.5);
    Input::new(sheet([32, 32], |x, y| DVec3::new(x, y, (9.0 * x).sin() * (7.0 * y).cos() * height)))
}

fn spike(power: f64) -> Input {
    let mut mesh = bumpy_sphere(20);
    let direction = mesh.positions[100].normalize();
    mesh.positions[100] = direction * 10f64.powf(power);
    Input::new(mesh)
}
