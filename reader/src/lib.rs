//! Reads (and writes the records of) lodpack files: any part of a huge triangle mesh, at any certified error.
//!
//! A [`File`] is opened over any [`ReadAt`]; [`File::select`] chooses levels for a [`Query`] from the index alone, an
//! [`Adapter`] keeps a cut from frame to frame;
//! [`File::extract`] reads, decodes and joins the triangles of that [`Cut`]. A builder fills a [`Model`] and calls
//! [`write_file`].
//!
//! ```no_run
//! # #[cfg(feature = "file")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use lodpack::{File, Limits, Query};
//!
//! let file = File::open(std::fs::File::open("scan.lodpack")?, Limits::default())?;
//! let cut = file.select(&Query { tolerance: Some(0.002), ..Query::default() })?;
//! let mesh = file.extract(&cut)?;
//! println!("{} triangles, at most {} off", mesh.triangles.len(), cut.error);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "file"))]
//! # fn main() {}
//! ```
//!
//! A surface consists of *roots*, pieces that are drawn at one level each; a [`Node`] is a root at a level. What a cut's error is
//! outside of a query's region, [`Cut::node_errors`] says.
#![cfg_attr(not(feature = "mmap"), forbid(unsafe_code))]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

mod codec;
mod decode;
mod error;
mod file;
mod format;
mod index;
mod limits;
mod select;
mod source;
pub mod stream;
mod verify;
mod write;

/// What the README shows compiles.
#[cfg(all(doctest, feature = "file"))]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
extern crate self as lodpack; // the fuzz targets' checks run as tests too
#[cfg(test)]
pub(crate) mod tests;

pub use codec::arc::{ArcSample, ArcTarget, MAX_TANGENT_SHIFT, PARAM_END, WantedSample, quantise_arc, quantise_arcs};
pub use codec::entropy::{SymbolBuffer, SymbolStatistics};
pub use codec::filling::grid;
pub use codec::filling::irregular::{
    EncodeError, PatchLimits, PatchTarget, Quantisation, Slide, encode_patch, encode_refined_patch,
};
pub use codec::patch::{LatticePoint, Patch};
pub use decode::contents::{ArcContents, ArcPoint, BlockContents, Borders, RootContents};
pub use decode::overview::Overview;
pub use decode::stitch::{Mesh, RootPatch};
pub use decode::{BorderKey, BorderVertex};
pub use error::{Error, Result};
pub use file::File;
pub use format::error_code::{storable_error, stored_error};
pub use format::model::{
    ArcRecord, BlockRecord, Filling, HalfArc, Lattice, LevelInfo, MAX_LEVELS, Model, OverviewRecord, RootRecord,
    SourceInfo,
};
pub use index::opener::Opener;
pub use index::resident::{Index, LevelSummary};
pub use index::summary::{ContextContents, FileSummary, LevelContents};
pub use limits::Limits;
pub use select::performance::{Controls, FrameTimes, PerformanceMode, PerformanceTarget};
pub use select::unify::{TileTree, Unification, Unified, unify_cuts};
pub use select::view::{Plane, Region, View};
pub use select::{
    Adapter, Change, Coherence, Cut, Frame, Hierarchy, HierarchyNode, Limiter, Node, Outside, Query, Resolution, select,
};
#[cfg(feature = "mmap")]
pub use source::Map;
#[cfg(feature = "object-store")]
pub use source::Object;
pub use source::fetched::Fetched;
pub use source::{Counting, ReadAt, Recording, Request, SourceError};
#[cfg(feature = "http")]
pub use source::{Http, HttpOptions};
pub use write::{
    Arranged, Assembly, ClusterSymbols, EncodedCluster, Encoder, Output, Piece, PieceIndex, PieceSymbols, Share,
    Shares, WriteReport, write_file,
};
