//! What a file may ask of the machine that reads it.

use crate::error::{Error, Result};

/// Upper limits on what is allocated for a file; the defaults suit files from anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Roots of the file.
    pub root_count: u64,
    /// Vertices of one root at one level.
    pub root_vertex_count: u64,
    /// Arcs, corners, loops and half-arcs in the index block of one cluster, together; and samples on its arcs.
    pub cluster_record_count: u64,
    /// Bytes of one section but the index and the pages, one index block or one page part.
    pub part_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { root_count: 1 << 28, root_vertex_count: 1 << 22, cluster_record_count: 1 << 22, part_bytes: 1 << 30 }
    }
}

/// Checks a quantity against its limit.
pub(crate) fn within(limit: u64, found: u64, what: &'static str) -> Result<()> {
    if found <= limit { Ok(()) } else { Err(Error::Limit { what, found, limit }) }
}
