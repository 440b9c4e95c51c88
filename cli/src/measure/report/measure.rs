//! Measures how far a drawn surface and the input are apart, in both directions, with the verifier's distances.

use crate::measure::two_sided::{FLOOR, RELATIVE_GAP, Side};
use crate::mesh::Mesh;
use glam::DVec3;
use serde::Serialize;

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
        let found =
            pairs.map(|(from, to)| from.measured(to, self.samples, (RELATIVE_GAP, FLOOR * from.mean_edge), &|| {}));
        Distances { rms: found.map(|one| one.rms), max: found.map(|one| one.lower) }
    }
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
