//! Limits on what a file may ask of the machine that reads it.

use crate::error::{Error, Result};

/// Upper limits on what is allocated for a file. The defaults suit files from untrusted places.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Roots in the file.
    pub root_count: u64,
    /// Vertices of one root at one level.
    pub root_vertex_count: u64,
    /// Arcs, corners, loops and half-arcs in the index block of one cluster, and the samples on its arcs, all together;
    /// and the objects and islands of its leaves.
    pub cluster_record_count: u64,
    /// Bytes of one index block, of one stream in pages, of one texel directory or texel stream, of one index page or
    /// block of heights, of one page of objects and of the names in it, or of any section other than INDEX,
    /// HEIGHT_INDEX, TEXELS, OBJECT_PAGES and PAGES.
    pub part_bytes: u64,
    /// Texels of each image.
    pub texel_count: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            root_count: 1 << 28,
            root_vertex_count: 1 << 22,
            cluster_record_count: 1 << 22,
            part_bytes: 1 << 30,
            texel_count: 1 << 24,
        }
    }
}

/// Checks a quantity against its limit.
pub(crate) fn within(limit: u64, found: u64, what: &'static str) -> Result<()> {
    if found <= limit { Ok(()) } else { Err(Error::Limit { what, found, limit }) }
}
