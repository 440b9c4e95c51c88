//! Choosing a cut: which node is drawn how finely (SPEC.md, "Cuts"; Niski 2007, chapter 4).
//!
//! Everything here is a pure function of a [`Hierarchy`]: no geometry, no reading, no clock. [`select_in`] makes a cut
//! from scratch; an [`Adapter`] keeps one from frame to frame. [`select_cut`] asks a file's index. Every cut begins
//! with the one of a threshold (`threshold`), which the queues of Niski (2007) then adapt, in each frame again:
//!
//! | module | adapts to |
//! |---|---|
//! | `dual_queue` | tolerance, node budget |
//! | `quad_queue` | triangle, node and byte budgets, and a tolerance |
//!
//! Both have a threshold for hysteresis (section 4.3).

mod adaptation;
mod adapter;
mod camera;
mod cut;
mod draft;
mod dual_queue;
mod error_bound;
mod frame_model;
mod from_index;
mod from_scratch;
mod front;
mod hierarchy;
mod histogram;
mod known;
mod lines;
mod page_bytes;
mod performance;
mod quad_queue;
mod queue;
mod share;
mod shared_budget;
mod split_merge;
mod threshold;
mod unify;
mod view;
mod weights;

#[cfg(test)]
pub(crate) mod tests;

pub use adapter::{AdaptReport, Adapter, Change, Coherence};
pub(crate) use camera::rotated;
pub use cut::{Cut, Limiter, Node, Outside, Query, select_in};
pub use frame_model::{FrameModel, FrameTimes};
pub(crate) use from_index::SMALL_INDEX_BYTES;
pub use from_index::{boundary_edge_count, select_cut, uniform_cut};
pub use hierarchy::{Hierarchy, HierarchyNode, Resolution};
pub use performance::{Controls, PerformanceGoal, PerformanceMode, PerformanceTarget};
pub use share::{Shares, share};
pub use shared_budget::{SharedBudget, Taken};
pub use unify::{ScreenLoad, TileTree, Tiles, TilesReport, Unification, Unified, balanced_cuts, unify_cuts};
pub(crate) use view::{OrientedBox, Projection};
pub use view::{Plane, View, Volume};
