//! The state that all algorithms share: a cut, its goal, and the queues.

use super::{Limiter, front::Front, queue::Queue};

/// The tolerance that a cut has to reach, and the budgets that it has to keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goal {
    /// The weighted error that suffices; below zero none does.
    pub tolerance: f64,
    /// Most triangles.
    pub triangles: u64,
    /// Most nodes.
    pub nodes: u64,
    /// Most bytes.
    pub bytes: u64,
    /// A change is not taken back for a gain below this fraction, so that cuts do not flicker (Niski 2007, section 4.3,
    /// "thresholds below which splits and merges are not performed").
    pub hysteresis: f64,
}

impl Goal {
    /// Everything as fine as possible.
    pub(crate) fn none() -> Self {
        Self { tolerance: -1.0, triangles: u64::MAX, nodes: u64::MAX, bytes: u64::MAX, hysteresis: 0.0 }
    }

    /// The same goal, with every budget that even the coarsest cut exceeds raised to what that cut takes.
    pub(crate) fn within_reach(self, coarsest: &Front) -> Self {
        Self {
            triangles: self.triangles.max(coarsest.triangle_count),
            nodes: self.nodes.max(coarsest.node_count),
            bytes: self.bytes.max(coarsest.byte_count),
            ..self
        }
    }

    /// The budget that a cut exceeds.
    pub(crate) fn exceeded(&self, front: &Front) -> Option<Limiter> {
        if front.triangle_count > self.triangles {
            Some(Limiter::Triangles)
        } else if front.node_count > self.nodes {
            Some(Limiter::Nodes)
        } else {
            (front.byte_count > self.bytes).then_some(Limiter::Bytes)
        }
    }
}

/// The queues that an algorithm needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Needed {
    /// Refine, and the largest error.
    pub by_error: bool,
    /// Coarsen.
    pub coarsens: bool,
    /// Split and merge, where there are trees.
    pub by_triangles: bool,
    /// Splits and merges are priced at the nodes' own errors instead of the tolerance.
    pub local_thresholds: bool,
}

/// A cut under way.
#[derive(Clone, Debug)]
pub(crate) struct Adaptation {
    pub front: Front,
    pub goal: Goal,
    needed: Needed,
    /// Nodes with errors that are not above this one are in none of the two queues that follow.
    floor: f64,
    /// All nodes inside, by error. An algorithm without queues by error keeps only those above the tolerance.
    pub worst: Queue,
    /// Nodes above the tolerance that can be refined, by error.
    pub refine: Queue,
    /// Nodes that can be coarser, and parents whose children can collapse, least resulting error first (negated).
    pub coarsen: Queue,
    /// Nodes by the triangles that splitting them saves.
    pub split: Queue,
    /// Parents by the triangles that merging their children costs, least first (negated).
    pub merge: Queue,
    /// The budget that kept something from being refined.
    pub blocked_by: Option<Limiter>,
    /// When each node was last changed.
    pub stamps: Vec<Stamp>,
    pub call: u32,
    /// Counts refine and coarsen passes.
    pub pass: u32,
}

/// The numbers of the calls that last changed a node, so that no call undoes what it has done.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stamp {
    pub refined: u32,
    pub coarsened: u32,
    pub restructured: u32,
    /// The pass that found that it does not fit.
    pub blocked: u32,
}

impl Adaptation {
    /// The queues of a cut. Nodes whose errors are at most `floor`, if that is zero or more, are not in those by error.
    pub(crate) fn new(front: Front, goal: Goal, mut needed: Needed, floor: f64) -> Self {
        let hierarchy = &front.hierarchy;
        needed.by_triangles &= hierarchy.has_children();
        let of = |needed: bool| Queue::new(if needed { hierarchy.node_count() } else { 0 });
        let (refine, coarsen, by_triangles) = (of(needed.by_error), of(needed.coarsens), of(needed.by_triangles));
        let stamps = vec![Stamp::default(); hierarchy.node_count() as usize];
        let mut this = Self {
            goal,
            needed,
            floor,
            worst: Queue::new(hierarchy.node_count()),
            refine,
            coarsen,
            split: by_triangles.clone(),
            merge: by_triangles,
            blocked_by: None,
            stamps,
            call: 0,
            pass: 1,
            front,
        };
        this.front.clear_journal();
        this.refresh();
        this
    }

    /// Starts a new call, which may change every node again.
    pub(crate) fn begin(&mut self) {
        self.call += 1;
        self.pass += 1;
        self.blocked_by = None;
    }

    pub(crate) fn has_tree_queues(&self) -> bool {
        self.needed.by_triangles
    }

    /// Updates the queues after changes.
    pub(crate) fn refresh(&mut self) {
        while let Some(node) = self.front.take_dirty() {
            if self.needed.by_error {
                self.refresh_by_error(node);
            }
            if self.needed.by_triangles {
                self.refresh_by_triangles(node);
            }
        }
    }

    pub(crate) fn refresh_by_error(&mut self, node: u32) {
        let front = &self.front;
        let is_inside = front.is_inside(node);
        let error = if is_inside && front.may_exceed(node, self.floor) { front.error(node) } else { self.floor };
        let is_above = error > self.floor;
        self.worst.set(node, is_above.then_some(error));
        let is_open = is_above
            && error > self.goal.tolerance
            && self.stamps[node as usize].blocked != self.pass
            && front.can_refine(node);
        self.refine.set(node, is_open.then_some(error));
        if self.needed.coarsens {
            let resolution = front.resolution(node);
            let coarser = if is_inside {
                (resolution > 0).then(|| front.error_at(node, resolution - 1))
            } else if front.contains(node) {
                None
            } else {
                self.error_if_collapsed(node)
            };
            self.coarsen.set(node, coarser.map(|error| -error));
        }
    }

    /// Lets nodes with smaller errors into the queues by error. Returns whether there may be any above the tolerance.
    pub(crate) fn lower_floor(&mut self) -> bool {
        if self.floor < 0.0 || self.floor <= self.goal.tolerance {
            return false;
        }
        let worst = self.worst.peek().map_or(0.0, |(error, _)| error);
        self.floor = if worst > 0.0 && self.floor > worst / 1024.0 { self.floor / 16.0 } else { -1.0 };
        self.front.mark_all();
        self.refresh();
        true
    }

    pub(crate) fn refresh_by_triangles(&mut self, node: u32) {
        let gain = self.split_gain(node);
        self.split.set(node, gain);
        let cost = self.merge_cost(node);
        self.merge.set(node, cost.map(|cost| -cost));
    }

    /// The largest weighted error, or where all are below the floor, the floor.
    pub(crate) fn worst_error(&self) -> f64 {
        self.worst.peek().map_or(self.floor, |(error, _)| error).max(0.0)
    }

    /// The threshold for local costs at an error.
    pub(crate) fn threshold(&self, error: f64) -> f64 {
        if self.needed.local_thresholds { error.max(self.goal.tolerance) } else { self.goal.tolerance }
    }

    /// Why the cut is not finer.
    pub(crate) fn limiter(&self) -> Limiter {
        let meets = self.worst.peek().is_none_or(|(error, _)| error <= self.goal.tolerance);
        match self.blocked_by {
            _ if meets && self.goal.tolerance >= 0.0 => Limiter::Tolerance,
            Some(limiter) => limiter,
            None => Limiter::Finest,
        }
    }
}
