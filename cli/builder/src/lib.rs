//! Builds `.lodpack` files: the rooms between the algorithms, which they put in order, and the program.
//!
//! Imports go upward in this table, never downward:
//!
//! | room | what it holds |
//! |---|---|
//! | [`reduce`] | one surface with a stated number of triangles, made from a finer one, with what it looks like |
//! | [`region`] | how an input is divided, and what neighbouring regions share |
//! | [`pipeline`], [`geometry_images`] | the order of the stages; beside it, atlases as images, out and in |
//! | [`heights`] | rasters as grids of heights: samples, tiles, their resolutions and errors, the file |
//! | [`job`] | builds: in memory, or with their state on disk, resumed, in parts, merged, handed to a scheduler |
#![cfg_attr(test, allow(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter"))]

pub mod geometry_images;
pub mod heights;
pub mod job;
pub mod pipeline;
pub mod reduce;
pub mod region;
