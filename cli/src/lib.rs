//! The library behind the program `lodpack`, a room an idea; the program itself is a thin shell around it.
//!
//! Imports go upward in this table, never downward:
//!
//! | room | what it holds |
//! |---|---|
//! | [`progress`], [`text`], [`machine`] | how progress is reported, how messages write numbers and paths, processor time and memory |
//! | [`mesh`] | triangle meshes, tolerances, mesh files out |
//! | [`storage`] | work directories, locks, memory limits |
//! | [`import`] | mesh files in, and rasters of heights |
//! | [`stage`] | one algorithm per module: repair, segment, arcs, embed, sample, simplify, certify |
//! | [`region`] | how an input is divided, and what neighbouring regions share |
//! | [`pipeline`], [`geometry_images`] | the order of the stages; beside it, atlases as images, out and in |
//! | [`heights`] | rasters as grids of heights: samples, tiles, their resolutions and errors, the file |
//! | [`job`] | builds: in memory, or with their state on disk, resumed, in parts, merged, handed to a scheduler |
//! | [`measure`] | verify, compare, report, selftest |
//! | [`tileset`] | files as 3D Tiles, and tilesets as surfaces |
//! | [`serve`] | a web server for files, and what is wrong with others |
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod geometry_images;
pub mod heights;
pub mod import;
pub mod job;
pub mod machine;
pub mod measure;
pub mod mesh;
pub mod pipeline;
pub mod progress;
pub mod region;
pub mod serve;
pub mod stage;
pub mod storage;
pub mod text;
pub mod tileset;
