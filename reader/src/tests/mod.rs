//! Whole files: made from synthetic atlases, read back, damaged, cut and stitched.

pub(crate) mod cuts;
mod damage;
mod round_trip;
pub(crate) mod synthetic;
