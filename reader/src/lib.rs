//! Streams and draws any part of a huge triangle mesh, at any certified error, from one `.lodpack` file.
//!
//! ```no_run
//! # #[cfg(feature = "file")]
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use lodpack::{File, Limits, Query};
//!
//! // Opening reads 8 kB. What is asked for later is read then.
//! let file = File::open(std::fs::File::open("scan.lodpack")?, Limits::default())?;
//! // Everything that touches a box, at most 2 mm off where the file is in metres.
//! let query = Query { volume: Some([[0.0; 3], [1.0; 3]].into()), tolerance: Some(0.002), ..Query::default() };
//! let cut = file.select(&query)?;
//! let mesh = file.extract(&cut)?;
//! println!("{} triangles, at most {} off the input", mesh.triangles.len(), cut.error);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "file"))]
//! # fn main() {}
//! ```
//!
//! # Overview of types
//!
//! **A file.** [`File`] reads from any [`ReadAt`], within [`Limits`], and fails with an [`Error`] that says who has to
//! act ([`Result`]). Coordinates are [`LatticePoint`]s on the file's [`Lattice`].
//!
//! **What the index says.** A surface consists of *roots*, pieces that are drawn at one level each. [`Index`] knows
//! them without reading; an [`Opener`] makes one from bytes that the caller reads. [`index::LevelSummary`],
//! [`index::SourceInfo`] and [`index::Placement`] (with its
//! [`index::UpAxis`]) describe the whole, [`index::RootContents`] and [`index::BlockContents`] one root and its levels,
//! with its [`index::Filling`] and its loops of
//! [`index::HalfArc`]s. [`index::FileSummary`], [`index::LevelContents`] and [`index::ContextContents`]
//! account for the bytes, and [`index::FillingCounts`] for the roots.
//!
//! **Channels.** What the surface carries besides positions is a list of [`index::ChannelInfo`]s, each of an
//! [`index::ChannelKind`].
//! [`File::texels`] reads the [`index::TexelBytes`] of roots.
//!
//! **A cut.** A [`Query`] asks for a [`Volume`] (its frustum of [`select::Plane`]s, for instance) or a [`View`], with a
//! tolerance and budgets; [`Outside`] says what becomes of the rest. The answer is a [`Cut`]: a level for each root, as
//! [`Node`]s, and a
//! [`Limiter`] that says why it is not finer. [`select::select_cut`], [`select::uniform_cut`] and
//! [`select::boundary_edge_count`] answer from an index alone.
//!
//! **Triangles.** [`decode::extract`] makes the [`Mesh`] of a cut, [`decode::extract_with_borders`] one that is drawn
//! apart, and [`decode::decode_root`] a [`decode::RootPatch`]: the
//! [`decode::Patch`] of one root, whose border is made of [`decode::BorderVertex`] and [`decode::BorderKey`].
//! [`decode::borders`] lists all [`decode::Borders`]: the [`decode::ArcContents`] between corners with their
//! [`decode::ArcPoint`]s, whose parameters run to
//! [`decode::PARAM_END`]. [`decode::overview`] is the [`Overview`], one small mesh of everything. [`decode::own_bytes`]
//! says what a cut has to read.
//!
//! **Objects.** What the input named: [`File::objects`] finds [`objects::ObjectNode`]s by name and id and says which
//! leaves and [`islands`] belong to each ([`FileObjects`]; [`index::Objects`] reads nothing itself).
//! [`File::extract_objects`] has the object of each triangle of a cut, and [`File::pick`] the [`decode::Pick`] of an
//! [`index::Ray`].
//!
//! **Bytes.** [`source::Request`]s go to a [`ReadAt`]: a byte slice, a file, or `Map`, `Http` with its `HttpOptions`,
//! and `Object` of
//! [`source`]; [`source::SourceError`] says what the other side of a network did wrong. [`source::Counting`] and
//! [`source::Recording`] watch another source. Programs that read elsewhere hand bytes over in [`Fetched`].
//!
//! **A moving camera.** A [`select::Hierarchy`], made of [`select::HierarchyNode`]s and their [`select::Resolution`]s,
//! is all that there is to choose from; [`select::select_in`] chooses once. A [`select::Adapter`] changes its cut from
//! frame to frame as little as
//! [`select::Coherence`] allows, and reports each [`select::Change`] in an [`select::AdaptReport`].
//! [`select::PerformanceMode`] holds a [`select::PerformanceGoal`]: [`select::PerformanceTarget`] and
//! [`select::FrameTimes`] go in, [`select::Controls`] come out, by a [`select::FrameModel`]. Tiles of a
//! [`select::TileTree`] adapt side by side as [`select::Tiles`]; [`select::unify_cuts`] joins them by a rule of
//! [`select::Unification`] to [`select::Unified`] cuts. Several devices share a picture by [`select::balanced_cuts`] of
//! [`select::ScreenLoad`]s.
//!
//! **Frames while loading.** [`stream`] draws something complete and watertight in every frame while the rest is
//! loaded; its page places its types.
//!
//! **Heights.** A file may hold a grid of heights instead, and [`Opened`] opens either kind ([`OpenedIndex`] from bytes
//! that the caller reads).
//! [`heights::Heights`] opens it, with a [`heights::HeightsIndex`] that reads nothing itself, chooses a
//! [`heights::HeightsCut`] of tiles for a
//! [`heights::HeightsQuery`], makes a [`heights::HeightsMesh`] of it, and reads windows of samples. The page of
//! [`heights`] places its types. A mesh may stand on heights: [`File::ground`] opens its [`Ground`], whose
//! [`GroundFrame`] takes heights to the mesh's space.
//!
//! **Writing.** With the feature `write`, module `write` turns models into files; its page places its types.
//!
//! # Elsewhere
//!
//! How a cut is drawn without cracks stands with [`Cut`], and what a block's error bounds with
//! [`index::BlockContents`]. The format is specified in `format-spec/SPEC.md`; the program `lodpack` builds files.
//! `reader/README.md` lists features, examples and costs.
#![cfg_attr(not(feature = "mmap"), forbid(unsafe_code))]
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

// An encoder stands beside its decoder, and what writes a record beside what parses it. Without the writer nothing
// calls these halves, and none of them is compiled into a program.
#[cfg_attr(not(feature = "write"), expect(dead_code, unused_imports, reason = "only the writer calls encoders"))]
mod codec;
pub mod decode;
mod error;
mod file;
#[cfg_attr(not(feature = "write"), expect(dead_code, reason = "only the writer calls what writes records"))]
mod format;
mod ground;
#[cfg_attr(not(feature = "write"), expect(dead_code, unused_imports, reason = "only the writer calls encoders"))]
pub mod heights;
pub mod index;
mod islands;
mod lattice;
mod limits;
pub mod objects;
mod open;
pub mod select;
mod sorted;
pub mod source;
pub mod stream;
mod verify;
#[cfg(feature = "write")]
pub mod write;

/// The examples of the README compile.
#[cfg(all(doctest, feature = "file"))]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
extern crate self as lodpack; // the fuzz targets' checks run as tests too
#[cfg(test)]
pub(crate) mod tests;

pub use decode::{Mesh, Overview};
pub use error::{Error, Result};
pub use file::{File, FileObjects};
#[cfg(feature = "write")]
pub use ground::join_ground;
pub use ground::{Ground, GroundFrame};
pub use index::{Index, Opener};
pub use islands::islands;
pub use lattice::{Lattice, LatticePoint};
pub use limits::Limits;
pub use open::{Opened, OpenedIndex};
pub use select::{Cut, Limiter, Node, Outside, Query, View, Volume};
pub use source::{Fetched, ReadAt};
