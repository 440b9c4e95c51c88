//! Triangle meshes in memory, shared by all stages.
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod appearance;
pub mod attributes;
pub mod draped;
pub mod encoded;
pub mod exact;
pub mod export;
pub mod glb;
pub mod glb_nodes;
pub mod images;
pub mod layers;
mod layout;
pub mod material;
pub mod objects;
pub mod pages;
pub mod shaded;
pub mod smooth;
pub mod srgb;
pub mod textured;
pub mod tolerance;
pub mod union_find;
pub mod upright;

use glam::DVec3;

/// "No half-edge", "no triangle", "no vertex".
pub const NONE: u32 = u32::MAX;

/// An indexed triangle mesh: positions in input units, triangles counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, finite.
    pub positions: Vec<DVec3>,
    /// Vertex indices of each triangle, all below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The three corner positions of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// The normal of a triangle; its length is twice the area.
    #[inline]
    pub fn doubled_area(&self, triangle: u32) -> DVec3 {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(c - a)
    }

    /// Twice the area of each triangle.
    pub fn doubled_areas(&self) -> Vec<f64> {
        (0..self.triangles.len() as u32).map(|triangle| self.doubled_area(triangle).length()).collect()
    }

    /// Smallest and largest coordinates of the vertices; an inverted box if there are none.
    pub fn bounds(&self) -> [DVec3; 2] {
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &p in &self.positions {
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        bounds
    }

    /// Mean length of the triangles' edges. Each side of each triangle counts once.
    pub fn mean_edge_length(&self) -> f64 {
        self.edge_lengths() / (3 * self.triangles.len()).max(1) as f64
    }

    /// Sum of the lengths of the triangles' edges. Each side of each triangle counts once.
    pub fn edge_lengths(&self) -> f64 {
        let around = |t: u32| {
            let [a, b, c] = self.corners(t);
            a.distance(b) + b.distance(c) + c.distance(a)
        };
        (0..self.triangles.len() as u32).map(around).sum()
    }
}

/// Half-edge neighbours of a manifold mesh. Half-edge `3 t + k` runs from corner `k` of triangle `t` to corner `(k + 1)
/// % 3`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Adjacency {
    /// The half-edge on the other side; [`NONE`] on the mesh boundary.
    pub opposite: Vec<u32>,
}

/// The next half-edge in the same triangle.
#[inline]
pub fn next_half_edge(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 { half_edge - 2 } else { half_edge + 1 }
}

/// An edge with its smaller vertex first, on which both its triangles agree.
#[inline]
pub fn ordered([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// The edges of a triangle, each with its smaller vertex first.
#[inline]
pub fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(ordered)
}

/// The previous half-edge in the same triangle.
#[inline]
pub fn previous_half_edge(half_edge: u32) -> u32 {
    if half_edge.is_multiple_of(3) { half_edge + 2 } else { half_edge - 1 }
}

impl Adjacency {
    /// Pairs the half-edges of a mesh whose edges have at most two triangles, wound consistently. An edge that breaks
    /// this rule stays unpaired; repair leaves none.
    pub fn new(triangles: &[[u32; 3]], vertex_count: usize) -> Self {
        // Counting sort of half-edges by their smaller vertex, then a short scan within each bucket.
        let edge = |h: u32| {
            let t = triangles[h as usize / 3];
            (t[h as usize % 3], t[(h as usize + 1) % 3])
        };
        let half_edge_count = triangles.len() as u32 * 3;
        let mut start = vec![0u32; vertex_count + 1];
        for h in 0..half_edge_count {
            let (a, b) = edge(h);
            start[a.min(b) as usize + 1] += 1;
        }
        for v in 0..vertex_count {
            start[v + 1] += start[v];
        }
        let mut slot = start.clone();
        // Each with its larger vertex before it.
        let mut sorted = vec![0u64; half_edge_count as usize];
        for h in 0..half_edge_count {
            let (a, b) = edge(h);
            let s = &mut slot[a.min(b) as usize];
            sorted[*s as usize] = u64::from(a.max(b)) << 32 | u64::from(h);
            *s += 1;
        }
        let mut opposite = vec![NONE; half_edge_count as usize];
        for v in 0..vertex_count {
            let bucket = &mut sorted[start[v] as usize..start[v + 1] as usize];
            bucket.sort_unstable();
            for run in bucket.chunk_by(|g, h| g >> 32 == h >> 32) {
                if let &[g, h] = run
                    && edge(g as u32).0 != edge(h as u32).0
                {
                    opposite[g as u32 as usize] = h as u32;
                    opposite[h as u32 as usize] = g as u32;
                }
            }
        }
        Self { opposite }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_triangles_share_one_edge() {
        let adjacency = Adjacency::new(&[[0, 1, 2], [2, 1, 3]], 4);
        assert_eq!(adjacency.opposite, [NONE, 3, NONE, 1, NONE, NONE]);
    }
}
