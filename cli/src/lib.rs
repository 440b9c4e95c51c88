//! The build pipeline of lodpack, a room an idea; the binary `lodpack` is a thin shell around it.
//!
//! Imports go one way, upward in this list:
//!
//! | room | what it holds |
//! |---|---|
//! | [`mesh`] | triangle meshes, tolerances, mesh files out |
//! | [`storage`] | work directories, locks, memory |
//! | [`import`] | mesh files in |
//! | [`stage`] | one algorithm a module: repair, segment, arcs, embed, sample, simplify, certify |
//! | [`region`] | dividing an input, and what regions share |
//! | [`pipeline`] | the order of the stages, for a region and for all of them |
//! | [`geometry_images`] | atlases as images, out and in |
//! | [`job`] | builds in parts: plan, parts, merge, resume, engines |
//! | [`measure`] | verify, report, selftest |

pub mod geometry_images;
pub mod import;
pub mod job;
pub mod measure;
pub mod mesh;
pub mod pipeline;
pub mod progress;
pub mod region;
pub mod stage;
pub mod storage;
