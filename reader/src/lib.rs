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

mod adapt;
mod arc;
mod bytes;
mod camera;
mod contents;
mod context;
mod decode;
mod entropy;
mod error;
mod error_code;
mod fetch;
mod fetched;
mod file;
mod frame;
pub mod grid;
mod header;
mod index;
mod irregular;
mod limits;
mod model;
mod opener;
mod overview;
mod patch;
mod performance;
mod resident;
mod sections;
pub mod session;
mod source;
mod stitch;
mod summary;
mod unify;
mod vector;
mod verify;
mod view;
mod write;

/// What the README shows compiles.
#[cfg(all(doctest, feature = "file"))]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
extern crate self as lodpack; // the fuzz targets' checks run as tests too
#[cfg(test)]
pub(crate) mod tests;

pub use adapt::{
    Adapter, Change, Coherence, Cut, Frame, Hierarchy, HierarchyNode, Limiter, Node, Outside, Query, Resolution, select,
};
pub use arc::{ArcSample, ArcTarget, MAX_TANGENT_SHIFT, PARAM_END, WantedSample, quantise_arc, quantise_arcs};
pub use contents::{ArcContents, ArcPoint, BlockContents, Borders, RootContents};
pub use decode::{BorderKey, BorderVertex};
pub use entropy::{SymbolBuffer, SymbolStatistics};
pub use error::{Error, Result};
pub use error_code::{storable_error, stored_error};
pub use fetched::Fetched;
pub use file::File;
pub use irregular::{EncodeError, PatchLimits, PatchTarget, Quantisation, Slide, encode_patch, encode_refined_patch};
pub use limits::Limits;
pub use model::{
    ArcRecord, BlockRecord, Filling, HalfArc, Lattice, LevelInfo, MAX_LEVELS, Model, OverviewRecord, RootRecord,
    SourceInfo,
};
pub use opener::Opener;
pub use overview::Overview;
pub use patch::{LatticePoint, Patch};
pub use performance::{Controls, FrameTimes, PerformanceMode, PerformanceTarget};
pub use resident::{Index, LevelSummary};
#[cfg(feature = "mmap")]
pub use source::Map;
#[cfg(feature = "object-store")]
pub use source::Object;
pub use source::{Counting, ReadAt, Recording, Request, SourceError};
#[cfg(feature = "http")]
pub use source::{Http, HttpOptions};
pub use stitch::{Mesh, RootPatch};
pub use summary::{ContextContents, FileSummary, LevelContents};
pub use unify::{TileTree, Unification, Unified, unify_cuts};
pub use view::{Plane, Region, View};
pub use write::{
    Arranged, Assembly, ClusterSymbols, EncodedCluster, Encoder, Output, Piece, PieceIndex, PieceSymbols, Share,
    Shares, WriteReport, write_file,
};
