//! Reads (and writes the records of) lodpack files: any part of a huge triangle mesh, at any certified error.
#![forbid(unsafe_code)]

mod arc;
mod context;
mod cut;
mod entropy;
mod error;
mod file;
mod frame;
mod grid;
mod header;
mod index;
mod irregular;
mod limits;
mod page;
mod patch;
mod source;
mod stitch;
mod vector;
mod write;

pub use error::{Error, Result};
pub use patch::{LatticePoint, Patch};
