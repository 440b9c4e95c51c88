//! Sample: chooses the cells and fits the vertices of grid fillings.
//!
//! 1. [`select_cells`] decides which cells are split at which level, by optimal pruning of full quadtrees (Breiman et
//!    al., "Classification and Regression Trees", 1984), and which samples the cells need on the arcs.
//! 2. The arcs take these samples up, and [`demand_samples`] records them in the chart.
//! 3. [`fit_positions`] finds one position for every vertex, shared by all levels: first evaluated through the
//!    embedding, then fitted by least squares, then by point-to-plane rounds in which vertices slide along the surface
//!    onto its creases.
//!
//! Later stages may assume that a finer level only splits cells of the coarser one, and that border samples are exactly
//! those of the arcs.
//!
//! A chart never has one uniform resolution: uniform grids have three to five times the error of a simplifier at equal
//! triangles.

mod border;
mod correspond;
mod fit;
mod layout;
mod select;
#[cfg(test)]
mod tests;
mod tree;
mod triangle;

pub use border::demand_samples;
pub use fit::{FitOptions, FittedGrid, fit_positions, level_errors};
pub use layout::{grid_sides, grid_states};
pub use select::{GridLevel, GridPlan, NEGLIGIBLE, SelectOptions, find_prices, select_at, select_cells};
pub use tree::CellTree;
