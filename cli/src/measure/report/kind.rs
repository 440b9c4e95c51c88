//! Classifies a surface, because the order of convergence depends on its kind.

use crate::mesh::{Adjacency, Mesh, NONE, next_half_edge};
use glam::DVec3;
use serde::Serialize;

/// Edges with at least this angle, in degrees, count as creases.
const CREASE_DEGREES: f64 = 40.0;
/// A surface counts as creased from this share of its edges' length in creases, if it is flat or round elsewhere.
const CREASED_SHARE: f64 = 0.005;
/// A surface counts as noisy if the angles between neighbouring triangles, relative to those between averaged normals,
/// exceed this. Averaging keeps curvature and removes noise: the ratio is 0.9 to 1.5 on clean scans and generated
/// surfaces, 2.0 on a noisy scan.
const NOISY_RATIO: f64 = 1.75;
/// Below this mean angle, a surface has no significant noise.
const FLAT_RADIANS: f64 = 1e-3;
/// How often normals are averaged with those of the three neighbours.
const AVERAGING_ROUNDS: usize = 4;

/// Kinds of surfaces, by how an error changes when the number of triangles grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceKind {
    /// The input resolves the curvature.
    #[default]
    Smooth,
    /// Smooth between sharp edges.
    Creased,
    /// Neighbouring triangles differ by more than curvature explains.
    Noisy,
}

impl SurfaceKind {
    /// The kind in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Creased => "creased",
            Self::Noisy => "noisy",
        }
    }

    /// The range of slopes of error over triangles, in log-log, that theory expects.
    pub fn expected_slope(self) -> [f64; 2] {
        match self {
            Self::Smooth => [-1.0, -1.0],
            Self::Creased => [-2.0, -1.0],
            Self::Noisy => [-1.0, 0.0],
        }
    }

    /// Why theory expects that.
    pub fn expected_words(self) -> &'static str {
        match self {
            Self::Smooth => "-1: flat triangles of size h leave an error of h², and there are 1/h² of them",
            Self::Creased => {
                "-1 where it curves both ways, -2 where it curves one way only (n strips on a cylinder leave an error of 1/n²); \
                 -1/2 would mean triangles that cross the creases"
            }
            Self::Noisy => {
                "-1 above the noise, flatter towards it: noise has no derivative that finer triangles could use"
            }
        }
    }
}

/// The kind of a surface, and the numbers from which it follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceFacts {
    /// The kind.
    pub kind: SurfaceKind,
    /// Share of the length of inner edges that are creases.
    pub crease_share: f64,
    /// Mean angle at the other edges, relative to that of averaged normals: about 1 for smooth surfaces.
    pub roughness: f64,
}

impl SurfaceFacts {
    /// Classifies a repaired mesh by all of its edges.
    pub fn new(mesh: &Mesh) -> Self {
        let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
        let areas: Vec<DVec3> = (0..mesh.triangles.len() as u32).map(|t| mesh.doubled_area(t)).collect();
        let unit = |normals: &[DVec3]| -> Vec<DVec3> { normals.iter().map(|n| n.normalize_or_zero()).collect() };
        let raw = unit(&areas);
        let crease = CREASE_DEGREES.to_radians();
        let across = |half_edge: u32| match adjacency.opposite.get(half_edge as usize) {
            Some(&other) if other != NONE => Some((half_edge as usize / 3, other as usize / 3)),
            _ => None,
        };
        // Averages do not cross creases.
        let mut normals = areas.clone();
        for _ in 0..AVERAGING_ROUNDS {
            let previous = normals.clone();
            for half_edge in 0..adjacency.opposite.len() as u32 {
                if let Some((t, other)) = across(half_edge)
                    && raw[t].angle_between(raw[other]) < crease
                {
                    normals[t] += previous[other];
                }
            }
        }
        let averaged = unit(&normals);
        let (mut length, mut creased, mut angles, mut averaged_angles) = (0.0, 0.0, 0.0, 0.0);
        for half_edge in 0..adjacency.opposite.len() as u32 {
            let Some((t, other)) = across(half_edge) else { continue };
            let end = |half_edge: u32| {
                mesh.positions[mesh.triangles[half_edge as usize / 3][half_edge as usize % 3] as usize]
            };
            let edge = end(half_edge).distance(end(next_half_edge(half_edge)));
            let angle = raw[t].angle_between(raw[other]);
            if !angle.is_finite() {
                continue;
            }
            length += edge;
            if angle >= crease {
                creased += edge;
            } else {
                angles += edge * angle;
                averaged_angles += edge * averaged[t].angle_between(averaged[other]);
            }
        }
        let crease_share = if length > 0.0 { creased / length } else { 0.0 };
        // On a flat surface, angles are rounding errors.
        let is_flat = angles <= length * FLAT_RADIANS;
        let roughness = if is_flat || averaged_angles <= 0.0 { 1.0 } else { angles / averaged_angles };
        let kind = match () {
            () if roughness >= NOISY_RATIO => SurfaceKind::Noisy,
            () if crease_share >= CREASED_SHARE => SurfaceKind::Creased,
            () => SurfaceKind::Smooth,
        };
        Self { kind, crease_share, roughness }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet over the unit square.
    fn sheet(height: impl Fn(u32, u32) -> f64) -> Mesh {
        const N: u32 = 40;
        let at = |i: u32, j: u32| i * (N + 1) + j;
        let point = |i: u32, j: u32| DVec3::new(f64::from(i) / f64::from(N), f64::from(j) / f64::from(N), height(i, j));
        let cells = (0..N).flat_map(|i| (0..N).map(move |j| (i, j)));
        Mesh {
            positions: (0..=N).flat_map(|i| (0..=N).map(move |j| (i, j))).map(|(i, j)| point(i, j)).collect(),
            triangles: cells
                .flat_map(|(i, j)| {
                    let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                    [[a, b, c], [a, c, d]]
                })
                .collect(),
        }
    }

    #[test]
    fn bowls_are_smooth_roofs_creased_and_jittered_sheets_noisy() {
        let kind = |mesh: &Mesh| SurfaceFacts::new(mesh).kind;
        let bowl = |i: u32, j: u32| (f64::from(i) / 40.0 - 0.5).powi(2) + (f64::from(j) / 40.0 - 0.5).powi(2);
        assert_eq!(kind(&sheet(bowl)), SurfaceKind::Smooth);
        assert_eq!(kind(&sheet(|i, _| f64::from((i % 20).abs_diff(10)) / 20.0)), SurfaceKind::Creased);
        let jitter =
            |i: u32, j: u32| f64::from((i * 7919 + j * 104_729).wrapping_mul(2_654_435_761) >> 16) / 65536.0 * 0.01;
        assert_eq!(kind(&sheet(jitter)), SurfaceKind::Noisy);
    }
}
