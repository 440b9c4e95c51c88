//! Reads (and writes the records of) lodpack files: any part of a huge triangle mesh, at any certified error.
//!
//! A [`File`] is opened over any [`ReadAt`]; [`File::cut`] chooses levels for a [`Query`] from the index alone;
//! [`File::extract`] reads, decodes and joins the triangles of that [`Cut`]. A builder fills a [`Model`] and calls
//! [`write_file`].
#![forbid(unsafe_code)]

mod arc;
mod bytes;
mod contents;
mod context;
mod cut;
mod decode;
mod entropy;
mod error;
mod error_code;
mod fetch;
mod file;
mod frame;
pub mod grid;
mod header;
mod index;
mod irregular;
mod limits;
mod model;
mod patch;
mod sections;
mod source;
mod stitch;
mod summary;
mod vector;
mod verify;
mod write;

#[cfg(test)]
mod tests;

pub use arc::{ArcSample, ArcTarget, MAX_TANGENT_SHIFT, PARAM_END, WantedSample, quantise_arc, quantise_arcs};
pub use contents::{ArcContents, ArcPoint, BlockContents, Borders, RootContents};
pub use cut::{Cut, Limiter, Node, Outside, Query};
pub use decode::{BorderKey, BorderVertex};
pub use entropy::{SymbolBuffer, SymbolStatistics};
pub use error::{Error, Result};
pub use file::{File, LevelSummary};
pub use irregular::{EncodeError, PatchLimits, PatchTarget, Quantisation, Slide, encode_patch, encode_refined_patch};
pub use limits::Limits;
pub use model::{
    ArcRecord, BlockRecord, Filling, HalfArc, Lattice, LevelInfo, MAX_LEVELS, Model, RootRecord, SourceInfo,
};
pub use patch::{LatticePoint, Patch};
pub use source::{Counting, ReadAt};
pub use stitch::{Mesh, RootPatch};
pub use summary::{FileSummary, LevelContents};
pub use write::{WriteReport, write_file};
