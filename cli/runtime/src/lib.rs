//! What surrounds the algorithms of a build: where its files lie while it runs, how much memory it may take, who hears
//! how far it is, and how its messages write numbers and paths.
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod machine;
pub mod progress;
pub mod storage;
pub mod text;
pub mod trace;
