//! Measures how far a drawn surface and the input are apart, in both directions, with the verifier's distances.

use crate::measure::verify::distance::{BoxTree, Goal, largest_distance};
use crate::mesh::Mesh;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

/// Upper over lower bound of the largest distance, minus 1.
const RELATIVE_GAP: f64 = 0.02;
/// Runs of triangles searched in parallel.
const RUNS: usize = 64;
/// Points that share a hint.
const CHUNK: usize = 4096;

/// Measured errors in input units: from the input to the drawn surface, then back.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distances {
    /// Root mean square over points spread evenly over the area.
    pub rms: [f64; 2],
    /// Largest distance: one that occurs, at most 2 % below the true maximum.
    pub max: [f64; 2],
}

impl Distances {
    /// The larger of both directions.
    pub fn rms(&self) -> f64 {
        self.rms[0].max(self.rms[1])
    }

    /// The larger of both directions.
    pub fn max(&self) -> f64 {
        self.max[0].max(self.max[1])
    }
}

/// The input, prepared for measuring against it.
pub struct Reference<'a> {
    side: Side<'a>,
    mesh: &'a Mesh,
    samples: usize,
}

/// A surface, and the accumulated area up to each triangle of its tree.
struct Side<'a> {
    positions: &'a [DVec3],
    tree: BoxTree<'a>,
    running: Vec<f64>,
    mean_edge: f64,
}

impl<'a> Side<'a> {
    fn new(positions: &'a [DVec3], triangles: &[[u32; 3]]) -> Self {
        let tree = BoxTree::new(positions, triangles);
        let (mut running, mut area, mut edges) = (Vec::with_capacity(triangles.len()), 0.0, 0.0);
        for triangle in tree.triangles() {
            let [a, b, c] = triangle.map(|v| positions[v as usize]);
            area += (b - a).cross(c - a).length() * 0.5;
            edges += a.distance(b) + b.distance(c) + c.distance(a);
            running.push(area);
        }
        let mean_edge = edges / (3 * triangles.len()).max(1) as f64;
        Self { positions, tree, running, mean_edge }
    }

    /// Root mean square and largest distance of points of this side from the other. Point i lies where the accumulated
    /// area passes (i + 1/2) / n of the total, so points are spread evenly.
    fn sampled(&self, other: &Side, samples: usize) -> (f64, f64) {
        let Some(&total) = self.running.last() else { return (0.0, 0.0) };
        let chunk_of = |first: usize| {
            let (mut hint, mut sum, mut most) = (0, 0.0, 0.0f64);
            for i in first..(first + CHUNK).min(samples) {
                let at = total * (i as f64 + 0.5) / samples as f64;
                let slot = self.running.partition_point(|&r| r < at).min(self.running.len() - 1);
                let p = point_in(self.tree.triangles()[slot].map(|v| self.positions[v as usize]), i as u64);
                let Some((distance, near, _)) = other.tree.nearest(p, hint) else {
                    return (f64::INFINITY, f64::INFINITY);
                };
                hint = near;
                sum += distance * distance;
                most = most.max(distance);
            }
            (sum, most)
        };
        let firsts: Vec<usize> = (0..samples).step_by(CHUNK).collect();
        let chunks: Vec<(f64, f64)> = firsts.into_par_iter().map(chunk_of).collect();
        let (sum, most) = chunks.iter().fold((0.0, 0.0f64), |(sum, most), c| (sum + c.0, most.max(c.1)));
        ((sum / samples.max(1) as f64).sqrt(), most)
    }

    /// A distance that occurs and is within the gap of the largest. `known` is a distance that occurs.
    fn largest(&self, other: &Side, known: f64) -> f64 {
        let triangles = self.tree.triangles();
        // With no claim, every run is searched to the end.
        let floor = known.max(self.mean_edge * 1e-6);
        let goal = Goal { relative_gap: RELATIVE_GAP, floor, claim: 0.0 };
        let runs: Vec<&[[u32; 3]]> = triangles.chunks(triangles.len().div_ceil(RUNS).max(1)).collect();
        let found: Vec<f64> =
            runs.par_iter().map(|run| largest_distance(self.positions, run, &other.tree, &goal).lower).collect();
        found.into_iter().fold(known, f64::max)
    }
}

impl<'a> Reference<'a> {
    /// `mesh` is the repaired input, `samples` the number of points for root mean squares.
    pub fn new(mesh: &'a Mesh, samples: usize) -> Self {
        Self { side: Side::new(&mesh.positions, &mesh.triangles), mesh, samples }
    }

    /// The repaired input.
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// Measures a drawn mesh in both directions.
    pub fn distances(&self, drawn: &lodpack::Mesh) -> Distances {
        let positions: Vec<DVec3> = drawn.positions.iter().copied().map(DVec3::from_array).collect();
        let drawn = Side::new(&positions, &drawn.triangles);
        let pairs = [(&self.side, &drawn), (&drawn, &self.side)];
        let sampled = pairs.map(|(from, to)| from.sampled(to, self.samples));
        let mut distances = Distances { rms: sampled.map(|(rms, _)| rms), max: [0.0; 2] };
        for (k, (from, to)) in pairs.into_iter().enumerate() {
            distances.max[k] = from.largest(to, sampled[k].1);
        }
        distances
    }
}

/// The i-th point of a low-discrepancy sequence, folded into the triangle.
fn point_in([a, b, c]: [DVec3; 3], i: u64) -> DVec3 {
    let fraction = |step: u64| (i.wrapping_mul(step) >> 11) as f64 / (1u64 << 53) as f64;
    let (mut u, mut v) = (fraction(0xC13F_A9A9_02A6_328F), fraction(0x91E1_0DA5_C79E_7B1D));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    a + (b - a) * u + (c - a) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_is_as_far_as_it_was_lifted_or_as_the_mean_square_of_its_tilt() {
        let square = |height: fn(f64) -> f64| {
            let corner = |x: f64, y: f64| [x, y, height(x)];
            lodpack::Mesh {
                positions: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)],
                triangles: vec![[0, 1, 2], [0, 2, 3]],
                triangle_nodes: vec![0, 0],
            }
        };
        let flat = square(|_| 0.0);
        let positions = flat.positions.iter().copied().map(DVec3::from_array).collect();
        let mesh = Mesh { positions, triangles: flat.triangles };
        let reference = Reference::new(&mesh, 20_000);
        let lifted = reference.distances(&square(|_| 0.25));
        for value in lifted.rms.into_iter().chain(lifted.max) {
            assert!((value - 0.25).abs() < 1e-9, "{lifted:?}");
        }
        // The mean of (0.1 x)^2 over the square is 0.01 / 3.
        let tilted = reference.distances(&square(|x| 0.1 * x));
        assert!((tilted.rms[1] / (0.1 / 3f64.sqrt()) - 1.0).abs() < 0.01, "{tilted:?}");
        assert!((tilted.max() / 0.1 - 1.0).abs() < 0.02);
    }
}
