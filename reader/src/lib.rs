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

// An encoder stands beside its decoder, and what writes a record beside what parses it. Without the writer nothing calls these
// halves, and none of them is compiled into a program.
#[cfg_attr(not(feature = "write"), expect(dead_code, unused_imports, reason = "only the writer calls encoders"))]
mod codec;
pub mod decode;
mod error;
mod file;
#[cfg_attr(not(feature = "write"), expect(dead_code, reason = "only the writer calls what writes records"))]
mod format;
pub mod index;
mod lattice;
mod limits;
pub mod select;
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
pub use file::File;
pub use index::{Index, Opener};
pub use lattice::{Lattice, LatticePoint};
pub use limits::Limits;
pub use select::{Cut, Limiter, Node, Outside, Query, View, Volume};
pub use source::{Fetched, ReadAt};
