//! Whole files: made from synthetic atlases, read back, damaged, cut and stitched.

mod channels;
pub(crate) mod cuts;
mod damage;
mod drape;
mod fuzzed;
mod heights;
mod heights_dump;
mod lists;
mod mixed_cuts;
pub(crate) mod objects;
pub(crate) mod painted;
mod pieces;
mod queries;
mod requests;
mod round_trip;
mod shown;
pub(crate) mod synthetic;
pub(crate) mod terrain;
mod trees;

#[cfg(feature = "http")]
pub(crate) use synthetic::{Options, cube, file_of};
