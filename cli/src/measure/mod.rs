//! What is measured of builds and files: with code of its own, which shares nothing with the builder.
#![allow(clippy::disallowed_methods, reason = "reports and generated shapes: no file that users keep depends on them")]

pub mod report;
pub mod selftest;
pub mod verify;
