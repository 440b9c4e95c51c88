//! Whole files: made from synthetic atlases, read back, damaged, cut and stitched.

mod cuts;
mod damage;
mod fuzzed;
mod requests;
mod round_trip;
mod synthetic;

#[cfg(feature = "http")]
pub(crate) use synthetic::{Options, cube, file_of};
