//! The build pipeline of lodpack, a module a stage; the binary `lodpack` is a thin shell around it.

pub mod atlas;
pub mod atlas_build;
pub mod atlas_export;
pub mod build;
pub mod certify;
pub mod chart;
pub mod embed;
pub mod export;
pub mod import;
pub mod job;
pub mod memory;
pub mod mesh;
pub mod mip;
pub mod progress;
pub mod region;
pub mod repair;
pub mod report;
pub mod sample;
pub mod segment;
pub mod selftest;
pub mod simplify;
pub mod summary;

pub mod tolerance;
pub mod verify;
pub mod work;
