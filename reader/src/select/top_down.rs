//! The top-down error bound with a node budget (Niski 2007, section 4.1.1, first part: the knapsack algorithm).
//!
//! Every root starts at its coarsest resolution and is refined until it is within the tolerance. The result is the
//! coarsest such cut: a node is refined only when it must be, and no change of its neighbours could replace that. Then
//! nodes are split, those that save most triangles first, as long as the node budget lasts.

use super::adaptation::{Adaptation, Needed};

/// The queues that the algorithm needs.
pub(crate) const NEEDED: Needed = Needed { by_error: false, by_triangles: true, local_thresholds: false };

impl Adaptation {
    /// Adapts the coarsest cut.
    pub(crate) fn adapt_top_down(&mut self) {
        self.begin();
        self.front.mark_all();
        self.settle_dirty(false);
        self.split_and_merge(usize::MAX, true);
    }
}
