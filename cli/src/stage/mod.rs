//! The stages, one algorithm a module. None knows of another's internals; `pipeline` calls them in order.

pub mod arc_samples;
pub mod arcs;
pub mod certify;
pub mod chart;
pub mod cluster_vertices;
pub mod embed;
pub mod repair;
pub mod resample;
pub mod sample;
pub mod segment;
pub mod simplify;
