//! Meshes that are extreme in one way, for measuring how the time of a build grows: each has about as many triangles as
//! it is asked for.

use glam::DVec3;
use lodpack_cli::measure::selftest::shapes::{Random, displaced_cube};
use lodpack_cli::mesh::Mesh;
use std::f64::consts::TAU;

/// The kinds that [`extreme`] knows.
pub const EXTREMES: [&str; 13] = [
    "fan", "cone", "star", "comb", "needles", "flat", "stairs", "spiral", "screw", "shells", "sheets", "stack", "soup",
];

/// The mesh of a kind with about `count` triangles; `None` if there is no such kind.
pub fn extreme(kind: &str, count: u32) -> Option<Mesh> {
    let side = (f64::from(count) / 2.0).sqrt().round().max(1.0) as u32;
    Some(match kind {
        "fan" => around(count, |_| (1.0, 0.0)),
        "cone" => around(count, |_| (1.0, -0.7)),
        "star" => around(count, |i| if i % 2 == 0 { (1.0, 0.1) } else { (0.4, -0.1) }),
        "comb" => comb(count),
        // Strips as long as the whole and as narrow as their number makes them, over a wave.
        "needles" => strip(count / 2, |along, across| DVec3::new(along, across, 0.05 * (along * 3.0 * TAU).sin())),
        "flat" => grid(side, |x, y| DVec3::new(x, y, 0.0)),
        "stairs" => stairs(side),
        "spiral" => {
            let turns = f64::from(count).sqrt() / 8.0;
            strip(count / 2, |along, across| {
                let (angle, radius) = (along * turns * TAU, 0.2 + 0.8 * along);
                DVec3::new(angle.cos() * radius, angle.sin() * radius, across / turns)
            })
        }
        "screw" => {
            let turns = f64::from(count).sqrt() / 8.0;
            strip(count / 2, |along, across| {
                let (angle, radius) = (along * turns * TAU, 0.2 + 0.8 * across);
                DVec3::new(angle.cos() * radius, angle.sin() * radius, along)
            })
        }
        "shells" => shells(count),
        "sheets" => copies(count, |_| 0.0),
        "stack" => copies(count, |i| f64::from(i) / f64::from(count)),
        "soup" => soup(count),
        _ => return None,
    })
}

/// A star polygon of `count` corners, or one more: nearly every edge crosses nearly every other one.
pub fn crossing_polygon(count: u32) -> Vec<DVec3> {
    let odd = count | 1;
    (0..odd)
        .map(|i| {
            let angle = f64::from(i) * f64::from(odd / 2) / f64::from(odd) * TAU;
            DVec3::new(angle.cos(), angle.sin(), 0.0)
        })
        .collect()
}

/// A polygon of `count` corners on a path that wanders at random: it crosses itself everywhere, most of all nearby.
pub fn wandering_polygon(count: u32) -> Vec<DVec3> {
    let mut random = Random(11);
    let mut at = DVec3::ZERO;
    (0..count)
        .map(|_| {
            at += random.point() * DVec3::new(1.0, 1.0, 0.0);
            at
        })
        .collect()
}

/// A vertex with `count` triangles around it, whose other corners have the given radii and heights.
fn around(count: u32, corner: impl Fn(u32) -> (f64, f64)) -> Mesh {
    let rim = (0..count).map(|i| {
        let angle = f64::from(i) / f64::from(count) * TAU;
        let (radius, height) = corner(i);
        DVec3::new(angle.cos() * radius, angle.sin() * radius, height)
    });
    let positions = std::iter::once(DVec3::ZERO).chain(rim).collect();
    Mesh { positions, triangles: (0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]).collect() }
}

/// A narrow spine with a long tooth of one triangle at each of its quads.
fn comb(count: u32) -> Mesh {
    let teeth = (count / 3).max(1);
    let x = |i: u32| f64::from(i) / f64::from(teeth);
    let spine = (0..=teeth).flat_map(|i| [0.0, 0.02].map(|y| DVec3::new(x(i), y, 0.0)));
    let tips = (0..teeth).map(|i| DVec3::new(x(i) + 0.5 / f64::from(teeth), 1.0, 0.02 * f64::from(i % 7)));
    let triangles = (0..teeth)
        .flat_map(|i| {
            let [a, b, c, d] = [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1];
            [[a, b, c], [a, c, d], [d, c, 2 * (teeth + 1) + i]]
        })
        .collect();
    Mesh { positions: spine.chain(tips).collect(), triangles }
}

/// A row of `quads` quads; both coordinates, along and across it, go from 0 to 1.
fn strip(quads: u32, at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let positions = (0..=quads).flat_map(|i| [0.0, 1.0].map(|across| at(f64::from(i) / f64::from(quads), across)));
    let triangles = (0..quads).map(|i| 2 * i).flat_map(|a| [[a, a + 2, a + 3], [a, a + 3, a + 1]]).collect();
    Mesh { positions: positions.collect(), triangles }
}

/// A grid of `side` by `side` quads; both coordinates go from 0 to 1.
fn grid(side: u32, at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let place = |i: u32| f64::from(i) / f64::from(side);
    let positions = (0..=side).flat_map(|j| (0..=side).map(move |i| (i, j))).map(|(i, j)| at(place(i), place(j)));
    let triangles = (0..side)
        .flat_map(|j| (0..side).map(move |i| j * (side + 1) + i))
        .flat_map(|a| [[a, a + 1, a + side + 2], [a, a + side + 2, a + side + 1]])
        .collect();
    Mesh { positions: positions.collect(), triangles }
}

/// Steps with two columns of quads on each tread and two on each riser, which is upright: every edge of them is sharp.
fn stairs(side: u32) -> Mesh {
    let steps = f64::from(side) / 4.0;
    grid(side, |x, y| {
        let at = (x * f64::from(side)).round() / 4.0;
        let (index, within) = (at.floor(), at.fract());
        let (run, rise) = (index + (2.0 * within).min(1.0), index + (2.0 * within - 1.0).max(0.0));
        DVec3::new(run / steps, y, rise / steps)
    })
}

/// Spheres of 768 triangles each around one centre, as close together as their number makes them.
fn shells(count: u32) -> Mesh {
    let shell = displaced_cube(8, DVec3::normalize);
    let shells = (count / shell.triangles.len() as u32).max(1);
    let mut mesh = Mesh { positions: vec![], triangles: vec![] };
    for i in 0..shells {
        let (first, radius) = (mesh.positions.len() as u32, 1.0 - 0.8 * f64::from(i) / f64::from(shells));
        mesh.positions.extend(shell.positions.iter().map(|&p| p * radius));
        mesh.triangles.extend(shell.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    mesh
}

/// Squares of two triangles, one above the other at the given heights.
fn copies(count: u32, height: impl Fn(u32) -> f64) -> Mesh {
    let squares = (count / 2).max(1);
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions = (0..squares).flat_map(|i| corners.map(|[x, y]| DVec3::new(x, y, height(2 * i)))).collect();
    let triangles = (0..squares).map(|i| 4 * i).flat_map(|a| [[a, a + 1, a + 2], [a, a + 2, a + 3]]).collect();
    Mesh { positions, triangles }
}

/// Single triangles anywhere in a cube, of a tenth of its size.
fn soup(count: u32) -> Mesh {
    let mut random = Random(5);
    let positions = (0..count)
        .flat_map(|_| {
            let centre = random.point();
            [(); 3].map(|()| centre + 0.1 * random.point())
        })
        .collect();
    Mesh { positions, triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect() }
}

/// Writes one polygon as OBJ.
///
/// # Errors
///
/// Any error of the file system.
pub fn save_polygon(corners: &[DVec3], path: &std::path::Path) -> std::io::Result<()> {
    use std::io::Write;
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    corners.iter().try_for_each(|p| writeln!(out, "v {} {} {}", p.x, p.y, p.z))?;
    write!(out, "f")?;
    (1..=corners.len()).try_for_each(|i| write!(out, " {i}"))?;
    writeln!(out)?;
    out.flush()
}
