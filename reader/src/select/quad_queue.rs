//! The quad-queue: a triangle budget and a node budget at once (Niski 2007, section 4.1.2), and one of bytes.
//!
//! Two phases alternate. The first refines what has the largest error and coarsens what would have the least, until the
//! budget is used up and the two queues are balanced. The second proposes splits and merges as if each node's own error
//! were its tolerance. What such a proposal is worth is only known after the first phase has run again: if the largest
//! error has grown, the proposal is undone, and that ends it (here: after the best quarter of it, and so on, was tried
//! too).

use super::{
    Limiter,
    adaptation::{Adaptation, Needed},
};

/// The queues that the algorithm needs.
pub(crate) const NEEDED: Needed = Needed { by_error: true, coarsens: true, by_triangles: true, local_thresholds: true };

/// How thorough a call has to be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort {
    /// Refinement ends after this many nodes that do not fit.
    pub max_misfits: usize,
    /// Whether the rest of the budget is spent where it does not lower the largest error.
    pub fills_up: bool,
    /// Most splits and merges of a proposal.
    pub changes: usize,
    /// Most proposals.
    pub rounds: usize,
}

impl Effort {
    /// For a cut that nothing has adapted yet but its threshold.
    pub(crate) const FULL: Self = Self { max_misfits: usize::MAX, fills_up: true, changes: usize::MAX, rounds: 64 };
    /// For one frame of many.
    pub(crate) const FRAME: Self = Self { max_misfits: 16, fills_up: false, changes: 64, rounds: 2 };
}

impl Adaptation {
    /// Adapts the cut as it is. Returns whether the last proposal was kept.
    pub(crate) fn adapt_quad_queue(&mut self, effort: Effort) -> bool {
        self.begin();
        self.refresh();
        self.keep_budgets();
        self.balance(effort);
        let (mut kept, mut most) = (true, effort.changes);
        for _ in 0..effort.rounds {
            let (mark, error) = (self.front.mark_of_journal(), self.worst_error());
            let limiter = self.blocked_by;
            let triangle_count = self.front.triangle_count;
            self.call += 1;
            let change_count = self.split_and_merge(most, false);
            if change_count == 0 {
                break;
            }
            self.keep_budgets();
            self.balance(effort);
            let now = self.worst_error();
            kept = now < error || now == error && self.front.triangle_count < triangle_count;
            if !kept {
                self.front.undo_to(mark);
                self.blocked_by = limiter;
                self.refresh();
            }
            if now >= error {
                // A part of the proposal may still be good.
                most = change_count.min(most) / 4;
            }
        }
        kept
    }

    /// Coarsens until all budgets are kept, or nothing can be coarser.
    fn keep_budgets(&mut self) {
        while self.front.node_count > self.goal.nodes && self.merge_one(false) {}
        while let Some(limiter) = self.goal.exceeded(&self.front) {
            self.blocked_by = Some(limiter);
            match self.coarsen.peek() {
                Some((_, node)) if limiter != Limiter::Nodes => self.coarsen_once(node),
                _ => {
                    self.front.reset();
                    self.refresh();
                    return;
                }
            }
            self.refresh();
        }
        // Where the tolerance is more than met: as far as hysteresis leaves it.
        let enough = self.goal.tolerance * (1.0 - self.goal.hysteresis);
        while let Some((priority, node)) = self.coarsen.peek().filter(|_| self.goal.tolerance >= 0.0) {
            if -priority > enough || !self.front.contains(node) {
                break;
            }
            self.coarsen_once(node);
            self.refresh();
        }
    }

    /// The refine and coarsen phase. Where a budget ends it, the largest error may have been smaller before: refining a
    /// node also raises the errors of coarser neighbours, whose borders then differ. So the best state is taken.
    fn balance(&mut self, effort: Effort) {
        let mut blocked = Vec::new();
        let mut best = (self.worst_error(), self.front.mark_of_journal());
        while let Some((error, node)) = self.most_urgent() {
            match self.refine_once(node, f64::INFINITY) {
                Ok(()) => {
                    let now = self.worst_error();
                    if now <= best.0 {
                        best = (now, self.front.mark_of_journal());
                    }
                }
                Err(_) if blocked.len() >= effort.max_misfits => break,
                Err(_) if effort.fills_up && !blocked.is_empty() && self.is_used_up() => break,
                Err(limiter) => {
                    if self.make_room(error, node) {
                        continue;
                    }
                    self.blocked_by = Some(limiter);
                    self.block(node);
                    blocked.push(node);
                }
            }
        }
        if !blocked.is_empty() {
            self.front.undo_to(best.1);
            self.refresh();
        }
        if effort.fills_up && !blocked.is_empty() {
            self.unblock(&blocked);
            while let Some((_, node)) = if self.is_used_up() { None } else { self.most_urgent() } {
                if self.refine_once(node, best.0).is_err() {
                    self.block(node);
                    blocked.push(node);
                }
            }
        }
        self.unblock(&blocked);
    }

    /// The node with the largest error of those that can be refined.
    fn most_urgent(&mut self) -> Option<(f64, u32)> {
        loop {
            match self.refine.peek() {
                None if self.lower_floor() => {}
                node => return node,
            }
        }
    }

    /// Whether less than a thousandth of a budget is left.
    fn is_used_up(&self) -> bool {
        let left = |most: u64, used: u64| most < u64::MAX && most.saturating_sub(used) < most >> 10;
        left(self.goal.triangles, self.front.triangle_count) || left(self.goal.bytes, self.front.byte_count)
    }

    /// A node does not fit: it is not tried again in this pass, whatever happens around it.
    fn block(&mut self, node: u32) {
        self.stamps[node as usize].blocked = self.pass;
        self.refine.set(node, None);
    }

    /// Begins a new pass, in which these may be tried again.
    fn unblock(&mut self, nodes: &[u32]) {
        self.pass += 1;
        for &node in nodes {
            self.refresh_by_error(node);
        }
    }

    /// Coarsens the node that suffers least, if that leaves it with less error than `error`, that of a node that does
    /// not fit: the queues are not balanced.
    fn make_room(&mut self, error: f64, node: u32) -> bool {
        let Some((priority, other)) = self.coarsen.peek() else { return false };
        let stamp = self.stamps[other as usize];
        let pays = -priority < error * (1.0 - self.goal.hysteresis);
        if !pays || other == node || stamp.refined == self.call || self.stamps[node as usize].coarsened == self.call {
            return false;
        }
        self.stamps[other as usize].coarsened = self.call;
        self.coarsen_once(other);
        self.refresh();
        true
    }

    /// Refines a node by one resolution, or splits it at its finest, if the budgets allow it and no error gets above
    /// `ceiling` by that.
    fn refine_once(&mut self, node: u32, ceiling: f64) -> Result<(), Limiter> {
        if self.stamps[node as usize].coarsened == self.call {
            return Err(Limiter::Triangles);
        }
        let front = &mut self.front;
        let mark = front.mark_of_journal();
        if front.has_finer(node) {
            let resolution = front.resolution(node) + 1;
            if front.triangles_with(node, resolution) > self.goal.triangles {
                return Err(Limiter::Triangles);
            }
            if self.goal.bytes < u64::MAX && front.bytes_with_finer(node) > self.goal.bytes {
                return Err(Limiter::Bytes);
            }
            front.place(node, resolution);
        } else {
            front.split(node, front.error(node));
        }
        let exceeded = self.goal.exceeded(front);
        let stays_below = || {
            let all = std::iter::once(node).chain(front.neighbours(node));
            all.filter(|&near| front.is_inside(near)).all(|near| front.error(near) <= ceiling)
        };
        let refused = exceeded.or_else(|| (ceiling.is_finite() && !stays_below()).then_some(Limiter::Triangles));
        match refused {
            Some(limiter) => {
                front.undo_to(mark);
                self.refresh();
                Err(limiter)
            }
            None => {
                self.stamps[node as usize].refined = self.call;
                self.refresh();
                Ok(())
            }
        }
    }
}
