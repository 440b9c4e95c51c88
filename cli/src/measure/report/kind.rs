//! What a surface is like, since the order of convergence depends on it.

use crate::mesh::{Adjacency, Mesh, NONE, next_half_edge};
use glam::DVec3;
use serde::Serialize;

/// Edges of this angle or more count as creases, in degrees.
const CREASE_DEGREES: f64 = 40.0;
/// With this share of the edges' length in creases, of surfaces that are flat or round elsewhere, a surface counts as creased.
const CREASED_SHARE: f64 = 0.005;
/// Angles of neighbouring triangles, over those of normals that are averaged over some triangles around. Curvature stays what
/// it is when normals are averaged, noise goes away: 0.9 to 1.5 on clean scans and generated surfaces, 2.0 on a noisy scan.
const NOISY_RATIO: f64 = 1.75;
/// A mean angle below which there is no noise to speak of.
const FLAT_RADIANS: f64 = 1e-3;
/// How often normals are averaged with those of the three neighbours.
const AVERAGING_ROUNDS: usize = 4;

/// Kinds of surfaces, by what an error does when the number of triangles grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SurfaceKind {
    /// Curvature is resolved by the input.
    #[default]
    Smooth,
    /// Smooth between sharp edges.
    Creased,
    /// Neighbouring triangles differ by more than curvature explains.
    Noisy,
}

impl SurfaceKind {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smooth => "smooth",
            Self::Creased => "creased",
            Self::Noisy => "noisy",
        }
    }

    /// The slope of error over triangles, in log-log, that theory expects: from and to.
    pub fn expected_slope(self) -> [f64; 2] {
        match self {
            Self::Smooth => [-1.0, -1.0],
            Self::Creased => [-2.0, -1.0],
            Self::Noisy => [-1.0, 0.0],
        }
    }

    /// Why.
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

/// A surface's kind, and the numbers that say so.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SurfaceFacts {
    /// The kind.
    pub kind: SurfaceKind,
    /// Share of the inner edges' length whose angle is that of a crease.
    pub crease_share: f64,
    /// Mean angle at the other edges over that of averaged normals: about 1 for smooth surfaces.
    pub roughness: f64,
}

impl SurfaceFacts {
    /// Looks at all edges of a repaired mesh.
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
        // Averages do not reach over creases.
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
        // Where all is flat angles are rounding errors.
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
