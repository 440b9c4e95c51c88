//! Measures builds and files with code of its own, which shares nothing with the builder's: a bug in the builder cannot
//! hide itself here.

pub mod report;
pub mod selftest;
pub mod verify;
