//! Choosing a cut: which node is drawn how finely (SPEC.md, "Cuts"; Niski 2007, chapter 4).
//!
//! Everything here is a pure function of a [`Hierarchy`]: no geometry, no reading, no clock. [`select`] makes a cut from
//! scratch, an [`Adapter`] keeps one from frame to frame. The algorithms have the seeds' names:
//!
//! | module | adapts to | from |
//! |---|---|---|
//! | `top_down` | tolerance, node budget | scratch |
//! | `dual_queue` | tolerance, node budget | the last frame's cut |
//! | `quad_queue` | triangle, node and byte budgets, and a tolerance | either |
//!
//! Hysteresis (section 4.3) is a threshold that the coherent ones share.

mod adaptation;
mod adapter;
pub(crate) mod camera;
mod cut;
mod dual_queue;
mod error_bound;
mod from_file;
mod front;
mod hierarchy;
pub(crate) mod performance;
mod pieces;
mod quad_queue;
mod queue;
mod split_merge;
mod top_down;
pub(crate) mod unify;
pub(crate) mod view;
mod weights;

#[cfg(test)]
pub(crate) mod tests;

pub use adapter::{Adapter, Change, Coherence, Frame};
pub use cut::{Cut, Limiter, Node, Outside, Query, select};
pub use hierarchy::{Hierarchy, HierarchyNode, Resolution};
