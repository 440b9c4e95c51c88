//! Measures builds and files with code of its own, which shares nothing with the builder's: a bug in the builder cannot
//! hide itself here.
#![allow(clippy::disallowed_methods, reason = "reports and generated shapes: no file that users keep depends on them")]

mod closed;
pub mod heights;
pub mod random;
pub mod report;
pub mod selftest;
pub mod two_sided;
pub mod verify;
