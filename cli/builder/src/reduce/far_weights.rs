//! Weights for another collapse of a surface: more where the last one was farthest off.
//!
//! Quadrics keep the mean low. The largest distance is often in one place, such as a hole that is drawn too large, and
//! a few triangles more there cost the others next to nothing.

use std::collections::BTreeSet;
use std::sync::{Arc, OnceLock};

use lodpack_mesh::Mesh;
use lodpack_stage::certify::{Hint, TriangleBvh, exceeding};
use lodpack_stage::chart::ChartMesh;

/// Places beyond this share of the largest distance are far.
const FAR: f64 = 0.7;
/// Factor on a vertex's quadric, with every round, in a far place.
const STEP: f32 = 3.0;
/// Where more vertices than these are far, as on large rough surfaces, weights would only say that everything matters.
const MANY: usize = 2000;
/// The largest weight: beyond it nothing is collapsed there any more.
const MOST: f32 = 1e6;
/// Closest-point queries and cuts that finding them may take in each direction, after one pass over all triangles.
const WORK: u64 = 30_000;
/// Points along each side of a drawn triangle whose closest input triangles are far with it.
const POINTS: u32 = 8;

/// Weights of the vertices of a chart. Copies share what is looked up.
#[derive(Clone)]
pub(super) struct FarWeights<'a> {
    chart: &'a ChartMesh,
    /// Made when it is needed.
    surface: Arc<OnceLock<TriangleBvh>>,
    weights: Vec<f32>,
}

impl<'a> FarWeights<'a> {
    pub fn new(chart: &'a ChartMesh) -> Self {
        Self { chart, surface: Arc::default(), weights: vec![] }
    }

    pub fn chart(&self) -> &'a ChartMesh {
        self.chart
    }

    /// As [`SimplifyOptions::importance`](lodpack_stage::simplify::SimplifyOptions::importance).
    pub fn of_vertices(&self) -> Option<&[f32]> {
        (!self.weights.is_empty()).then_some(&self.weights)
    }

    /// Raises the weights where a drawn surface, which is at most `bound` off, is farthest. Returns false if that is in
    /// too many places.
    pub fn raise(&mut self, drawn: &Mesh, bound: f64) -> bool {
        let Self { chart, surface, weights } = self;
        let surface = surface.get_or_init(|| TriangleBvh::new(&chart.positions, &chart.triangles));
        let of_drawn = TriangleBvh::new(&drawn.positions, &drawn.triangles);
        let far = FAR * bound;
        let mut triangles: BTreeSet<u32> = exceeding(surface, &of_drawn, far, WORK).into_iter().collect();
        let mut hint = Hint::default();
        for triangle in exceeding(&of_drawn, surface, far, WORK) {
            let [a, b, c] = drawn.corners(triangle);
            for (i, j) in (0..=POINTS).flat_map(|i| (0..=POINTS - i).map(move |j| (i, j))) {
                let [u, v] = [i, j].map(|k| f64::from(k) / f64::from(POINTS));
                let closest = surface.closest(a + (b - a) * u + (c - a) * v, &mut hint);
                if closest.distance > far {
                    triangles.insert(closest.triangle);
                }
            }
        }
        weights.resize(chart.positions.len(), 1.0);
        let vertices: BTreeSet<u32> = triangles.into_iter().flat_map(|t| chart.triangles[t as usize]).collect();
        raise(weights, &vertices, STEP);
        vertices.len() <= MANY
    }
}

/// Raises the weights of some vertices.
pub(super) fn raise(weights: &mut [f32], vertices: &BTreeSet<u32>, step: f32) {
    for &v in vertices {
        weights[v as usize] = (weights[v as usize] * step).min(MOST);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    /// A square of unit cells, one inner vertex of which is raised.
    fn spike(height: f64) -> Mesh {
        let side = 21;
        let raised = |x: u32, y: u32| if [x, y] == [10, 10] { height } else { 0.0 };
        let vertices = (0..side * side).map(|v| [v % side, v / side]);
        let positions = vertices.map(|[x, y]| DVec3::new(f64::from(x), f64::from(y), raised(x, y))).collect();
        let cells = (0..side * (side - 1)).filter(|v| v % side + 1 < side);
        let triangles = cells.flat_map(|v| [[v, v + 1, v + side], [v + 1, v + side + 1, v + side]]).collect();
        Mesh { positions, triangles }
    }

    #[test]
    fn places_that_are_far_in_either_direction_weigh_more_with_every_round() {
        for [whole, drawn] in [[5.0, 0.0], [0.0, 5.0]] {
            let Mesh { positions, triangles } = spike(whole);
            let chart = ChartMesh { positions, triangles, loops: vec![] };
            let new = FarWeights::new(&chart);
            let mut weights = new.clone();
            assert!(weights.of_vertices().is_none());
            for weight in [3.0, 9.0] {
                assert!(weights.raise(&spike(drawn), 5.0));
                let of_vertices = weights.of_vertices().expect("raised");
                assert_eq!([of_vertices[10 * 21 + 10], of_vertices[0]], [weight, 1.0], "{whole} {drawn}");
            }
            assert!(new.of_vertices().is_none());
        }
    }
}
