//! A surface that is made from cuts or becomes one: triangles, and how far they lie from the input.

use super::manifold::{boundary_loops, manifold, open_edges};
use glam::DVec3;
use lodpack_mesh::NONE;
use lodpack_stage::arcs::closest_on_segment;
use lodpack_stage::certify::{self, CertifyOptions, two_sided};
use lodpack_stage::chart::ChartMesh;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The most edges of a hole that may be a crack between two levels.
const MAX_CRACK_EDGES: usize = 64;

/// A coarse surface, and how far it lies from the input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct CoarseSurface {
    /// Relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Bound of the two-sided distance to the input.
    pub error: f64,
}

impl CoarseSurface {
    /// The surface as a manifold with its boundary, which stays whole. None if the boundary touches itself.
    pub fn chart(&self) -> Option<ChartMesh> {
        let (positions, triangles) = manifold(self.positions.clone(), self.triangles.clone())?;
        let loops = boundary_loops(&triangles, positions.len())?;
        Some(ChartMesh { positions, triangles, loops })
    }

    /// Bounds the distance of a simplified surface from the input. `whole` is this surface as a manifold.
    pub fn error_of(
        &self,
        whole: &[DVec3],
        whole_triangles: &[[u32; 3]],
        positions: &[DVec3],
        triangles: &[[u32; 3]],
    ) -> f64 {
        let whole = certify::TriangleBvh::new(whole, whole_triangles);
        let drawn = certify::TriangleBvh::new(positions, triangles);
        self.error_at(two_sided(&whole, &drawn, &CertifyOptions::default()).upper)
    }

    /// Bounds the distance from the input of what is no farther than `distance` from this surface, and it from that.
    pub fn error_at(&self, distance: f64) -> f64 {
        error_sum(self.error, distance)
    }

    /// Joins surfaces that share parts of their boundaries.
    pub fn joined(surfaces: Vec<Self>) -> Self {
        let is_several = surfaces.len() > 1;
        let mut surfaces = surfaces.into_iter();
        let mut all = surfaces.next().unwrap_or_default();
        // Only boundary vertices are joined: inside, two vertices at one position need not be the same.
        let mut shared: BTreeMap<[u64; 3], u32> = BTreeMap::new();
        if is_several {
            shared.extend(all.boundary_vertices().map(|v| (key(all.positions[v as usize]), v)));
        }
        for surface in surfaces {
            let mut numbers = vec![NONE; surface.positions.len()];
            for v in surface.boundary_vertices() {
                let position = surface.positions[v as usize];
                numbers[v as usize] = *shared.entry(key(position)).or_insert_with(|| all.add(position));
            }
            for (number, &position) in numbers.iter_mut().zip(&surface.positions) {
                if *number == NONE {
                    *number = all.add(position);
                }
            }
            all.triangles.extend(surface.triangles.iter().map(|corners| corners.map(|v| numbers[v as usize])));
            all.error = all.error.max(surface.error);
        }
        if is_several {
            all.close_cracks();
        }
        all
    }

    /// Closes holes that are no wider than the error. Seams have such holes where the roots on both sides are drawn at
    /// different levels, because the regions do not know of each other's levels.
    fn close_cracks(&mut self) {
        if open_edges(&self.triangles).is_empty() {
            return;
        }
        // Touching loops can be told apart once every vertex has one fan.
        let Some(manifold) = manifold(self.positions.clone(), self.triangles.clone()) else { return };
        (self.positions, self.triangles) = manifold;
        let Some(loops) = boundary_loops(&self.triangles, self.positions.len()) else { return };
        let mut widest = 0.0f64;
        for border in loops.iter().filter(|border| border.len() <= MAX_CRACK_EDGES) {
            let vertices: Vec<u32> = border.iter().map(|b| b.vertex).collect();
            let (triangles, width) = filled(&vertices, &self.positions);
            if width <= self.error {
                widest = widest.max(width);
                self.triangles.extend(triangles);
            }
        }
        if widest > 0.0 {
            // Rounded up, by more than the error of the addition.
            self.error = (self.error + widest) * (1.0 + 1e-12);
        }
    }

    /// Adds a vertex; returns its number.
    pub fn add(&mut self, position: DVec3) -> u32 {
        self.positions.push(position);
        self.positions.len() as u32 - 1
    }

    /// The vertices of open edges.
    pub fn boundary_vertices(&self) -> impl Iterator<Item = u32> + use<> {
        open_edges(&self.triangles).into_iter().map(|[first, _]| first)
    }
}

/// The sum of two bounds, rounded up, since adding may round down.
pub(crate) fn error_sum(error: f64, distance: f64) -> f64 {
    (error + distance) * (1.0 + 2.0 * f64::EPSILON)
}

/// Triangles that close a loop of edges, wound to match its outside, and how far they reach from it. The three
/// consecutive vertices whose triangle stays nearest to one of its edges are cut off first.
pub(crate) fn filled(border: &[u32], positions: &[DVec3]) -> (Vec<[u32; 3]>, f64) {
    let distance = |p: u32, a: u32, b: u32| {
        // Differences between points of the lattice are exact.
        let [p, b] = [p, b].map(|v| positions[v as usize] - positions[a as usize]);
        closest_on_segment(p, DVec3::ZERO, b).0.distance(p)
    };
    // Each vertex, and how far the edge to the next one may lie from the loop.
    let mut left: Vec<(u32, f64)> = border.iter().map(|&v| (v, 0.0)).collect();
    let (mut triangles, mut width) = (vec![], 0.0f64);
    while left.len() > 2 {
        let reach = |i: usize| {
            let [(p, before), (q, after), (r, _)] = [i, i + 1, i + 2].map(|k| left[k % left.len()]);
            (before + distance(r, p, q)).min(after + distance(p, q, r))
        };
        let nearest = (0..left.len()).map(|i| (reach(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((reach, i)) = nearest else { break };
        let [p, q, r] = [i, i + 1, i + 2].map(|k| left[k % left.len()].0);
        triangles.push([p, r, q]);
        left[i].1 = reach;
        left.remove((i + 1) % left.len());
        width = width.max(reach);
    }
    (triangles, width)
}

/// A position as its bits. Equal positions have equal bits, because both sides take them from the lattice.
fn key(position: DVec3) -> [u64; 3] {
    position.to_array().map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cracks_are_filled_along_their_edges() {
        // A long edge, and four short ones back.
        let places = [[0., 0.], [4., 0.], [3., 0.1], [2., 0.2], [1., 0.1]];
        let positions: Vec<DVec3> = places.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
        for turn in 0..5 {
            let mut border = [0, 1, 2, 3, 4];
            border.rotate_left(turn);
            let (triangles, width) = filled(&border, &positions);
            assert!(triangles.len() == 3 && (0.2..0.45).contains(&width), "{triangles:?} {width}");
            let mut around: Vec<[u32; 2]> = (0..5).map(|i| [(i + 1) % 5, i]).collect();
            around.sort_unstable();
            assert_eq!(open_edges(&triangles), around);
        }
    }
}
