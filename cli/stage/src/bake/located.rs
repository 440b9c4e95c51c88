//! Sources whose triangles can be found by place.

use std::cell::OnceCell;

use glam::DVec3;

use super::Source;
use crate::certify::TriangleBvh;

/// A source whose triangles can be found by place; the index for that is made when it is first needed.
pub struct Located<S> {
    /// What is looked at.
    pub source: S,
    bvh: OnceCell<TriangleBvh>,
}

impl<S: Source> Located<S> {
    /// Wraps a source that does not change.
    pub fn new(source: S) -> Self {
        Self { source, bvh: OnceCell::new() }
    }

    /// The source, and what finds its triangles.
    pub(super) fn parts(&mut self) -> (&mut S, &TriangleBvh) {
        let Self { source, bvh } = self;
        let bvh = bvh.get_or_init(|| {
            let count = source.triangle_count() as u32;
            let positions: Vec<DVec3> = (0..count as usize).flat_map(|triangle| source.corners(triangle)).collect();
            let triangles: Vec<[u32; 3]> = (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
            TriangleBvh::new(&positions, &triangles)
        });
        (source, bvh)
    }
}
