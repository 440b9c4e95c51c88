//! The library behind the program `lodpack`, a room an idea; the program itself is a thin shell around it.
//!
//! Imports go upward in this table, never downward. All rooms but the last three are crates of their own, or lie in
//! one, so that the compiler keeps their order and compiles again only what has changed; this crate shows them all.
//!
//! | room | what it holds | crate |
//! |---|---|---|
//! | [`storage`], [`progress`], [`machine`], [`text`], [`trace`] | work directories, locks, memory limits; how progress is reported; processor time and memory; how messages write numbers and paths; what a build does when | `lodpack-runtime` |
//! | [`mesh`] | triangle meshes, tolerances, mesh files out | `lodpack-mesh` |
//! | [`import`] | mesh files in, and rasters of heights | `lodpack-import` |
//! | [`stage`] | one algorithm per module: repair, segment, arcs, embed, sample, simplify, certify | `lodpack-stage` |
//! | [`reduce`] | one surface with a stated number of triangles, made from a finer one, with what it looks like | `lodpack-builder` |
//! | [`region`] | how an input is divided, and what neighbouring regions share | |
//! | [`pipeline`], [`geometry_images`] | the order of the stages; beside it, atlases as images, out and in | |
//! | [`heights`] | rasters as grids of heights: samples, tiles, their resolutions and errors, the file | |
//! | [`job`] | builds: in memory, or with their state on disk, resumed, in parts, merged, handed to a scheduler | |
//! | [`measure`] | verify, compare, report, selftest | this one |
//! | [`tileset`] | files as 3D Tiles, and tilesets as surfaces | |
//! | [`serve`] | a web server for files, and what is wrong with others | |
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod measure;
pub mod serve;
pub mod tileset;

pub use lodpack_builder::{geometry_images, heights, job, pipeline, reduce, region};
pub use lodpack_import as import;
pub use lodpack_mesh as mesh;
pub use lodpack_runtime::{machine, progress, storage, text, trace};
pub use lodpack_stage as stage;
