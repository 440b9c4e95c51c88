//! A surface that is going to be compared: its hierarchy is made when it is first needed.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::bvh::TriangleBvh;

/// Triangles with finite positions.
pub struct Surface<'a> {
    pub(super) positions: &'a [DVec3],
    pub(super) triangles: &'a [[u32; 3]],
    bvh: OnceLock<Arc<TriangleBvh>>,
}

impl<'a> Surface<'a> {
    /// The triangles of a mesh with finite positions.
    pub fn new(positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        Self { positions, triangles, bvh: OnceLock::new() }
    }

    /// All of them in one hierarchy.
    pub fn bvh(&self) -> &Arc<TriangleBvh> {
        self.bvh.get_or_init(|| Arc::new(TriangleBvh::new(self.positions, self.triangles)))
    }
}
