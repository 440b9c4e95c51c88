//! Cuts that no frame came before.

use super::{
    adaptation::{Adaptation, Goal, Needed, Stamp},
    dual_queue,
    front::Front,
    quad_queue::{self, Effort},
    threshold::cut_at_threshold,
};

/// What becomes of a cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Later {
    /// It is what was wanted.
    Done,
    /// It follows the camera, so all queues have to be whole.
    Frames,
}

impl Adaptation {
    /// The cut for a goal that the coarsest cut, that of `front`, can keep: that of the smallest threshold, and then
    /// what the queues make of it, by error where there is a budget ([`super::Query::has_budget`]).
    pub(crate) fn from_scratch(mut front: Front, goal: Goal, has_budget: bool, later: Later) -> Self {
        let threshold = cut_at_threshold(&mut front, &goal);
        if !has_budget {
            let mut adaptation = Self::new(front, goal, dual_queue::NEEDED, -1.0);
            adaptation.save_triangles();
            return adaptation;
        }
        let is_whole = later == Later::Frames || front.hierarchy.has_children();
        // Without a tree nothing becomes coarser again, and what is far below the threshold has time.
        let needed = Needed { coarsens: is_whole, ..quad_queue::NEEDED };
        let has_time = !is_whole && threshold.is_finite() && threshold > 0.0;
        let floor = if has_time { goal.tolerance.max(threshold / 4.0) } else { -1.0 };
        let mut adaptation = Self::new(front, goal, needed, floor);
        // As if the first call had come to the threshold by itself.
        adaptation.stamps.fill(Stamp { refined: 1, ..Stamp::default() });
        adaptation.adapt_quad_queue(Effort::FULL);
        adaptation
    }
}
