//! Whole files: made from synthetic atlases, read back, damaged, cut and stitched.

mod cuts;
mod damage;
mod round_trip;
mod synthetic;
