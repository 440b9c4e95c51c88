//! A model: what a builder fills and [`crate::write::write_file`] turns into a file.

use crate::{
    codec::{
        arc::ArcSample,
        entropy::SymbolBuffer,
        filling::{LevelSteps, Quantisation},
    },
    format::{
        channels::ChannelInfo,
        placement::Placement,
        records::{Filling, HalfArc, SourceInfo},
    },
    lattice::{Lattice, LatticePoint},
    objects::ObjectNode,
};

/// A level of detail, coarse to fine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LevelInfo {
    /// The error for which the level was built, world units; at most that of the next coarser level.
    pub tolerance: f64,
    /// The steps of each filling's vertices.
    pub steps: LevelSteps,
}

/// An arc of a model.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArcRecord {
    /// The corners at its ends, which differ.
    pub ends: [u32; 2],
    /// Samples by ascending parameter, as [`crate::write::quantise_arcs`] returned them.
    pub samples: Vec<ArcSample>,
}

/// One level of a root.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BlockRecord {
    /// Certified bound of the two-sided distance to the input where no neighbour is finer, world units.
    pub error: f64,
    /// Added to the error where any neighbour is finer, world units.
    pub border_deviation: f64,
    /// Triangles of the patch that the symbols decode to.
    pub triangle_count: u32,
    /// The symbols that the filling's encoder wrote.
    pub symbols: SymbolBuffer,
    /// Its texel streams: the map, then the image of each channel of the model, any of them perhaps empty. No entries
    /// are as good as only empty ones.
    pub texels: Vec<Vec<u8>>,
    /// For each of the patch's [`crate::islands`] the number of its object among [`Model::nodes`]; empty for groups,
    /// and in models without objects.
    pub owners: Vec<u32>,
}

/// A root of a model.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RootRecord {
    /// Loops of at least two half-arcs, each ending at the corner where the next begins, in the winding of the
    /// triangles; none for a closed surface.
    pub loops: Vec<Vec<HalfArc>>,
    /// Smallest and largest world coordinates of everything drawn at any level, and of the piece of input that the root
    /// stands for.
    pub bounds: [[f64; 3]; 2],
    /// How its blocks are coded.
    pub filling: Filling,
    /// The root that stands for this one and its other children together, by its number in the model.
    pub parent: Option<u32>,
    /// One entry for each level, at least one of them a block. The coarsest block of a child follows its parent's
    /// finest one.
    pub blocks: Vec<Option<BlockRecord>>,
}

/// One small mesh of the whole surface, for the first picture of a large file.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OverviewRecord {
    /// Certified bound of the two-sided distance to the input, world units.
    pub error: f64,
    /// Steps of its vertices; each shift is at most 40.
    pub quantisation: Quantisation,
    /// Its border, whose coordinates are multiples of the normal step.
    pub loops: Vec<Vec<LatticePoint>>,
    /// Triangles of the patch that the symbols decode to.
    pub triangle_count: u32,
    /// The symbols that the irregular filling's encoder wrote.
    pub symbols: SymbolBuffer,
}

/// The content of a file, in any order: the writer sorts roots so that neighbours lie together, and renumbers arcs and
/// corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Model {
    /// The lattice of the coordinates.
    pub lattice: Lattice,
    /// The step along arcs is 2^arc_tangent_shift lattice steps; at most 40.
    pub arc_tangent_shift: u8,
    /// Coarse to fine, at least one, at most [`crate::write::MAX_LEVELS`].
    pub levels: Vec<LevelInfo>,
    /// What the file was made from.
    pub source: SourceInfo,
    /// Where it is in the world, if it is known.
    pub placement: Option<Placement>,
    /// Positions of the corners.
    pub corners: Vec<LatticePoint>,
    /// For each of them the coarsest level at which it is a vertex; empty where all are vertices at every level.
    pub corner_levels: Vec<u8>,
    /// All arcs.
    pub arcs: Vec<ArcRecord>,
    /// All roots.
    pub roots: Vec<RootRecord>,
    /// What the surface carries besides positions, at most 64 channels.
    pub channels: Vec<ChannelInfo>,
    /// The mesh to draw before the index has been read.
    pub overview: Option<OverviewRecord>,
    /// Objects and assemblies, in any order; none in a file without objects. Those that own no island, and are above
    /// none that does, are left out of the file.
    pub nodes: Vec<ObjectNode>,
}
