//! Small records that a file stores in several places.

use crate::codec::arc::PARAM_END;

/// Most levels that a file may have.
pub const MAX_LEVELS: usize = 24;

/// What the file was made from.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SourceInfo {
    /// Triangles of the input after repair.
    pub triangle_count: u64,
    /// Vertices of the input after repair.
    pub vertex_count: u64,
    /// Mean edge length of the input, world units.
    pub mean_edge_length: f64,
    /// Area of the input, square world units.
    pub area: f64,
    /// Program and version that wrote the file.
    pub generator: String,
}

/// An arc in the direction in which one root's loop runs along it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HalfArc {
    /// The arc's number.
    pub arc: u32,
    /// Whether the loop runs from the arc's second corner to its first.
    pub reversed: bool,
}

impl HalfArc {
    /// What belongs to the arc's first and second corner, in the direction of the half-arc.
    pub(crate) fn directed<T>(self, [first, second]: [T; 2]) -> [T; 2] {
        if self.reversed { [second, first] } else { [first, second] }
    }

    /// A parameter of the arc, measured from where the half-arc begins.
    pub(crate) fn along(self, param: u32) -> u32 {
        if self.reversed { PARAM_END - param } else { param }
    }
}

/// Whether half-arcs make up a loop: each, given by the corners at its beginning and end, ends where the next one
/// begins.
pub(crate) fn is_loop(ends: &[[u32; 2]]) -> bool {
    let next = ends.iter().cycle().skip(1);
    ends.iter().zip(next).all(|(here, next)| here[1] == next[0])
}

pub use crate::codec::filling::{Filling, FillingCounts};
