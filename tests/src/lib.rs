//! Integration tests, benchmark and peer drivers of lodpack.

pub mod dump;
pub mod generate;
pub mod handmade;
pub mod raster;
