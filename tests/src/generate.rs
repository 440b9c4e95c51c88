//! Generates meshes for tests and benchmarks.

use glam::DVec3;
use lodpack_cli::measure::selftest::shapes::Random;
pub use lodpack_cli::measure::selftest::shapes::{bumpy_sphere, displaced_cube};
use lodpack_cli::mesh::Mesh;
use std::f64::consts::TAU;

/// A closed cube-sphere of 12 n^2 triangles, with detail at all scales down to a few triangles, like a scan: eleven
/// octaves of sums of five bent waves in random directions, every other one folded to ridges.
pub fn rough_sphere(n: u32) -> Mesh {
    const WAVES: usize = 5;
    let mut random = Random(7);
    let mut octaves = vec![];
    let (mut height, mut frequency) = (0.18, 2.2);
    for octave in 0..11 {
        if frequency > f64::from(n) * 0.9 {
            break;
        }
        let waves = [(); WAVES].map(|()| {
            let direction = random.point().normalize();
            (direction, random.unit() * TAU, random.point() * 1.7)
        });
        octaves.push((octave, height, frequency, waves));
        (height, frequency) = (height * 0.52, frequency * 2.03);
    }
    displaced_cube(n, |p| {
        let d = DVec3::from_array(p.to_array().map(|x| (x * std::f64::consts::FRAC_PI_4).tan())).normalize();
        let displaced = octaves.iter().map(|(octave, height, frequency, waves)| {
            let wave = |(direction, phase, bend): &(DVec3, f64, DVec3)| {
                (frequency * d.dot(*direction) + phase + 1.3 * (0.5 * frequency * d.dot(*bend)).sin()).sin()
            };
            let sum = waves.iter().map(wave).sum::<f64>() / (WAVES as f64 / 2.0);
            height * if octave % 2 == 1 { 1.0 - sum.abs() } else { sum }
        });
        d * (1.0 + 0.35 * displaced.sum::<f64>())
    })
}

/// A torus around the z axis, radii 1 and 0.35, with n by n/2 quads of two triangles each.
pub fn torus(n: u32) -> Mesh {
    let m = (n / 2).max(3);
    let positions = (0..n)
        .flat_map(|i| (0..m).map(move |j| (f64::from(i) / f64::from(n) * TAU, f64::from(j) / f64::from(m) * TAU)))
        .map(|(u, v)| {
            let r = 1.0 + 0.35 * v.cos();
            DVec3::new(r * u.cos(), r * u.sin(), 0.35 * v.sin())
        })
        .collect();
    let at = |i: u32, j: u32| (i % n) * m + j % m;
    let triangles = (0..n)
        .flat_map(|i| (0..m).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles }
}

/// A rolling height field over the unit square with square holes: an outer boundary and inner loops.
pub fn punched_sheet(n: u32) -> Mesh {
    let at = |i: u32, j: u32| i * (n + 1) + j;
    let positions = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n))))
        .map(|(x, y)| DVec3::new(x, y, 0.08 * (9.0 * x).sin() * (7.0 * y).cos()))
        .collect();
    let hole = |i: u32, j: u32| {
        let period = (n / 4).max(4);
        let (a, b) = (i % period, j % period);
        a * 3 > period && a * 3 < 2 * period && b * 3 > period && b * 3 < 2 * period
    };
    let triangles = (0..n)
        .flat_map(|i| (0..n).map(move |j| (i, j)))
        .filter(|&(i, j)| !hole(i, j))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles }.without_unused_vertices()
}

/// A CAD-like part with sharp creases, cylinders and planes, similar to the well-known fan disk: 12 n^2 triangles,
/// where n is a multiple of 8.
pub fn fan_part(n: u32) -> Mesh {
    displaced_cube(n, |p| {
        // The faces of a cube become a drum with a groove around it, a stepped top, and a bored, bevelled bottom. Steps
        // follow grid lines, so that creases are edges of the mesh as in an exported part.
        let (x, y, z) = (p.x, p.y, p.z);
        let square = x.abs().max(y.abs());
        let radius = (x * x + y * y).sqrt();
        let round = if radius > 0.0 { DVec3::new(x, y, 0.0) * (square / radius) } else { DVec3::ZERO };
        let mut q = DVec3::new(round.x, round.y, z);
        let on_side = square > 1.0 - 1e-9;
        if on_side && z.abs() < 0.5 {
            q.x *= 0.8;
            q.y *= 0.8;
        } else if on_side && z.abs() < 0.75 {
            // The conical flanks of the groove.
            let s = 0.8 + 0.2 * (z.abs() - 0.5) / 0.25;
            q.x *= s;
            q.y *= s;
        }
        if z > 1.0 - 1e-9 {
            q.z += if square < 0.5 { 0.4 } else { 0.4 * (1.0 - (square - 0.5) / 0.25).max(0.0) };
            if x > 0.0 && square < 0.5 {
                q.z += 0.2 * x * 2.0;
            }
        }
        if z < -1.0 + 1e-9 && square < 0.5 {
            q.z += 0.6 * ((0.5 - square) / 0.25).min(1.0);
        }
        q
    })
}

trait WithoutUnusedVertices {
    fn without_unused_vertices(self) -> Self;
}

impl WithoutUnusedVertices for Mesh {
    fn without_unused_vertices(self) -> Self {
        let mut new_index = vec![u32::MAX; self.positions.len()];
        let mut positions = vec![];
        let triangles = self
            .triangles
            .iter()
            .map(|t| {
                t.map(|v| {
                    let slot = &mut new_index[v as usize];
                    if *slot == u32::MAX {
                        *slot = positions.len() as u32;
                        positions.push(self.positions[v as usize]);
                    }
                    *slot
                })
            })
            .collect();
        Self { positions, triangles }
    }
}

/// Writes a mesh as binary PLY with double coordinates.
///
/// # Errors
///
/// Any error of the file system.
pub fn save_ply(mesh: &Mesh, path: &std::path::Path) -> std::io::Result<()> {
    let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    let file = std::fs::File::create(path)?;
    lodpack_cli::mesh::export::write_mesh(file, lodpack_cli::mesh::export::MeshFormat::Ply, &positions, &mesh.triangles)
}

/// Writes a mesh as binary PLY with single-precision coordinates, as scanners do.
///
/// # Errors
///
/// Any error of the file system.
pub fn save_single_ply(mesh: &Mesh, path: &std::path::Path) -> std::io::Result<()> {
    use std::io::Write;
    let mut out = std::io::BufWriter::new(std::fs::File::create(path)?);
    let (vertices, faces) = (mesh.positions.len(), mesh.triangles.len());
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )?;
    for position in &mesh.positions {
        position.as_vec3().to_array().iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
    }
    for triangle in &mesh.triangles {
        out.write_all(&[3])?;
        triangle.iter().try_for_each(|v| out.write_all(&v.to_le_bytes()))?;
    }
    out.flush()
}
