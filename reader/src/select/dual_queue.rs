//! The dual-queue error bound, coherent from frame to frame (Niski 2007, section 4.1.1, second part).
//!
//! The cut of the last frame is refined and coarsened where something has changed. Then the split and merge queues are
//! balanced: no split saves more triangles than the next merge costs. The work grows with the changes, not with the
//! cut.

use super::{
    adaptation::{Adaptation, Needed},
    threshold::cut_at_threshold,
};

/// The queues that the algorithm needs.
pub(crate) const NEEDED: Needed =
    Needed { by_error: false, coarsens: false, by_triangles: true, local_thresholds: false };

/// Most splits and merges in one frame, so that no frame takes long; the next frame continues.
const CHANGES_A_FRAME: usize = 256;

impl Adaptation {
    /// Adapts to the changes since the last call. The node budget takes precedence over the tolerance.
    pub(crate) fn adapt_dual_queue(&mut self) {
        self.begin();
        self.settle_dirty(true);
        while self.front.node_count > self.goal.nodes && self.merge_one(true) {}
        self.split_and_merge(CHANGES_A_FRAME, true);
        if self.goal.exceeded(&self.front).is_some() {
            self.front.reset();
            cut_at_threshold(&mut self.front, &self.goal);
            self.save_triangles();
        }
    }

    /// Adapts the cut of a threshold: refines what the node budget still lets be refined, and splits nodes where that
    /// saves triangles, those that save most first, as long as the node budget lasts (the knapsack algorithm, section
    /// 4.1.1, first part).
    pub(crate) fn save_triangles(&mut self) {
        self.begin();
        self.front.mark_all();
        self.settle_dirty(false);
        self.split_and_merge(usize::MAX, true);
    }
}
