//! What a file says: written by [`crate::write_file`], made by a builder.

use crate::{
    codec::{
        arc::ArcSample,
        entropy::SymbolBuffer,
        filling::{LevelSteps, Quantisation},
        patch::LatticePoint,
    },
    error::{Error, Result},
};

/// Most levels that a file may have.
pub const MAX_LEVELS: usize = 24;

/// Where the integer coordinates of a file lie in the world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Lattice {
    /// World position of lattice point (0, 0, 0).
    pub origin: [f64; 3],
    /// The lattice step is 2^step_log2 world units; -256 to 256.
    pub step_log2: i32,
}

impl Lattice {
    /// The lattice step in world units.
    pub fn step(&self) -> f64 {
        power_of_two(self.step_log2)
    }

    /// World position of a lattice point: origin + coordinate * step.
    pub fn world(&self, point: LatticePoint) -> [f64; 3] {
        let step = self.step();
        [0, 1, 2].map(|axis| self.origin[axis] + point[axis] as f64 * step)
    }

    /// A world position in lattice units.
    pub fn units(&self, world: [f64; 3]) -> [f64; 3] {
        let step = self.step();
        [0, 1, 2].map(|axis| (world[axis] - self.origin[axis]) / step)
    }

    /// Checks the ranges.
    pub(crate) fn check(&self) -> Result<()> {
        if self.origin.iter().all(|x| x.is_finite()) && self.step_log2.unsigned_abs() <= 256 {
            Ok(())
        } else {
            Err(Error::format("the lattice is not finite or its step not within 2^-256 to 2^256"))
        }
    }
}

/// 2^exponent, exactly, for |exponent| below 1000.
pub(crate) fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// A level of detail, coarse to fine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LevelInfo {
    /// The error that the level was built for, in world units; at most the coarser level's.
    pub tolerance: f64,
    /// The steps of each filling's vertices.
    pub steps: LevelSteps,
}

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

/// An arc as one root sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HalfArc {
    /// Which arc.
    pub arc: u32,
    /// True when the loop runs from the arc's second corner to its first.
    pub reversed: bool,
}

pub use crate::codec::filling::Filling;

/// An arc of a model.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArcRecord {
    /// Corners at both ends, which differ.
    pub ends: [u32; 2],
    /// Samples by ascending parameter, as [`crate::quantise_arcs`] returned them.
    pub samples: Vec<ArcSample>,
}

/// One level of a root.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BlockRecord {
    /// Certified bound of the two-sided distance to the input while no neighbour is finer, in world units.
    pub error: f64,
    /// What is to be added to it when any neighbour is finer.
    pub border_deviation: f64,
    /// Triangles of the patch that the symbols decode to.
    pub triangle_count: u32,
    /// What the filling's encoder wrote.
    pub symbols: SymbolBuffer,
}

/// A root of a model.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RootRecord {
    /// Loops of at least two half-arcs, each ending at the corner where the next begins, in the winding of the triangles;
    /// none for a closed surface.
    pub loops: Vec<Vec<HalfArc>>,
    /// Smallest and largest world coordinates of everything drawn at any level and of the piece of input it stands for.
    pub bounds: [[f64; 3]; 2],
    /// How the blocks are coded.
    pub filling: Filling,
    /// One entry a level; level 0 is always there, an absent one means "as the next coarser".
    pub blocks: Vec<Option<BlockRecord>>,
}

/// One small mesh of the whole surface, for the first picture of a large file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OverviewRecord {
    /// Certified bound of the two-sided distance to the input, world units.
    pub error: f64,
    /// Steps of its vertices; each shift is at most 40.
    pub quantisation: Quantisation,
    /// Its border, whose coordinates are multiples of the normal step.
    pub loops: Vec<Vec<LatticePoint>>,
    /// Triangles of the patch that the symbols decode to.
    pub triangle_count: u32,
    /// What the irregular filling's encoder wrote.
    pub symbols: SymbolBuffer,
}

/// Everything that becomes a file. Any order: the writer sorts roots so that neighbours lie together, and numbers arcs and
/// corners anew.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// Where the coordinates lie.
    pub lattice: Lattice,
    /// The step along arcs is 2^arc_tangent_shift lattice steps; at most 40.
    pub arc_tangent_shift: u8,
    /// Coarse to fine, at least one, at most [`MAX_LEVELS`].
    pub levels: Vec<LevelInfo>,
    /// What the file was made from.
    pub source: SourceInfo,
    /// Positions of the corners.
    pub corners: Vec<LatticePoint>,
    /// All arcs.
    pub arcs: Vec<ArcRecord>,
    /// All roots.
    pub roots: Vec<RootRecord>,
    /// What is drawn before there is an index.
    pub overview: Option<OverviewRecord>,
}
