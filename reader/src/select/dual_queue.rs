//! The dual-queue error bound, coherent from frame to frame (Niski 2007, section 4.1.1, second part).
//!
//! The cut of the last frame is refined and coarsened where something has changed; then the split and the merge queue are
//! balanced: no split saves more triangles than the next merge costs. Work grows with what has changed, not with the cut.

use super::adaptation::{Adaptation, Needed};

/// The queues that the algorithm needs.
pub(crate) const NEEDED: Needed = Needed { by_error: false, by_triangles: true, local_thresholds: false };

/// Most splits and merges of one frame, so that no frame takes long; the next goes on.
const CHANGES_A_FRAME: usize = 256;

impl Adaptation {
    /// Adapts what has changed since the last call. The node budget may come first and break the tolerance.
    pub(crate) fn adapt_dual_queue(&mut self) {
        self.begin();
        self.settle_dirty(true);
        while self.front.node_count > self.goal.nodes && self.merge_one(true) {}
        self.split_and_merge(CHANGES_A_FRAME, true);
        if self.goal.exceeded(&self.front).is_some() {
            self.front.reset();
            self.adapt_top_down();
        }
    }
}
