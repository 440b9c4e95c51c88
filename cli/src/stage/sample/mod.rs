//! Stage **sample**: the cells and vertices of grid fillings.
//!
//! 1. [`select_cells`]: which cells are split at which level, by optimal pruning of full quadtrees; says which samples the
//!    cells need on the arcs.
//! 2. The arcs take these up; [`demand_samples`] notes them in the chart.
//! 3. [`fit_positions`]: one position for every vertex, shared by all levels: evaluated through the embedding, fitted by least
//!    squares, then by point-to-plane rounds in which vertices slide along the surface onto its creases.
//!
//! Never one resolution per chart: uniform grids have three to five times a simplifier's error at equal triangles.

mod border;
mod correspond;
mod fit;
mod layout;
mod select;
mod system;
#[cfg(test)]
mod tests;
mod tree;
mod triangle;

pub use border::demand_samples;
pub use fit::{FitOptions, FittedGrid, fit_positions, level_errors};
pub use layout::{grid_sides, grid_states};
pub use select::{GridLevel, GridPlan, NEGLIGIBLE, SelectOptions, find_prices, select_at, select_cells};
pub use tree::CellTree;
