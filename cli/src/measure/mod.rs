//! What is measured of builds and files: with code of its own, which shares nothing with the builder.

pub mod report;
pub mod selftest;
pub mod verify;
