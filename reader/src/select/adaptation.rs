//! What all algorithms share: a cut, what it has to reach, and the queues.

use super::{Limiter, front::Front, queue::Queue};

/// What a cut has to reach and keep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Goal {
    /// Weighted error that is good enough; below zero: none is.
    pub tolerance: f64,
    /// Most triangles.
    pub triangles: u64,
    /// Most nodes.
    pub nodes: u64,
    /// Most bytes.
    pub bytes: u64,
    /// Nothing is taken back for a gain below this part: what keeps cuts from flickering (Niski 2007, section 4.3,
    /// "thresholds below which splits and merges are not performed").
    pub hysteresis: f64,
}

impl Goal {
    /// Without wishes: everything as fine as possible.
    pub(crate) fn none() -> Self {
        Self { tolerance: -1.0, triangles: u64::MAX, nodes: u64::MAX, bytes: u64::MAX, hysteresis: 0.0 }
    }

    /// The same without budgets that even the coarsest cut exceeds: these become what that takes.
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

/// Which queues an algorithm needs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Needed {
    /// Refine and coarsen, and the largest error.
    pub by_error: bool,
    /// Split and merge, where there are trees.
    pub by_triangles: bool,
    /// Costs of splits and merges are for the nodes' own errors, not for the tolerance.
    pub local_thresholds: bool,
}

/// A cut under way.
#[derive(Clone, Debug)]
pub(crate) struct Adaptation {
    pub front: Front,
    pub goal: Goal,
    needed: Needed,
    /// All nodes inside, by error; without queues by error only those above the tolerance.
    pub worst: Queue,
    /// Nodes above the tolerance that can be refined, by error.
    pub refine: Queue,
    /// Nodes that can be coarser, and parents whose children can go, least resulting error first (negated).
    pub coarsen: Queue,
    /// Nodes by the triangles that splitting them saves.
    pub split: Queue,
    /// Parents by the triangles that merging their children costs, least first (negated).
    pub merge: Queue,
    /// The budget that has kept something from being refined.
    pub blocked_by: Option<Limiter>,
    /// In which call a node was last coarsened to make room, or refined; or split or merged.
    pub stamps: Vec<Stamp>,
    pub call: u32,
    /// Counts refine and coarsen passes.
    pub pass: u32,
}

/// What was done to a node last, by number of the call; so that no call does and undoes the same.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stamp {
    pub refined: u32,
    pub coarsened: u32,
    pub restructured: u32,
    /// In which pass it was found not to fit.
    pub blocked: u32,
}

impl Adaptation {
    pub(crate) fn new(front: Front, goal: Goal, mut needed: Needed) -> Self {
        let hierarchy = &front.hierarchy;
        needed.by_triangles &= hierarchy.has_children();
        let of = |needed: bool| Queue::new(if needed { hierarchy.node_count() } else { 0 });
        let (by_error, by_triangles) = (of(needed.by_error), of(needed.by_triangles));
        let stamps = vec![Stamp::default(); hierarchy.node_count() as usize];
        let mut this = Self {
            goal,
            needed,
            worst: Queue::new(hierarchy.node_count()),
            refine: by_error.clone(),
            coarsen: by_error,
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

    /// Starts a new call: everything may be done again.
    pub(crate) fn begin(&mut self) {
        self.call += 1;
        self.pass += 1;
        self.blocked_by = None;
    }

    pub(crate) fn has_tree_queues(&self) -> bool {
        self.needed.by_triangles
    }

    /// Brings the queues in line with what has changed.
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
        if !front.is_inside(node) {
            self.worst.set(node, None);
            self.refine.set(node, None);
            let collapsed = if front.contains(node) { None } else { self.error_if_collapsed(node) };
            self.coarsen.set(node, collapsed.map(|error| -error));
            return;
        }
        let (error, resolution) = (front.error(node), front.resolution(node));
        self.worst.set(node, Some(error));
        let is_open =
            error > self.goal.tolerance && self.stamps[node as usize].blocked != self.pass && front.can_refine(node);
        self.refine.set(node, is_open.then_some(error));
        self.coarsen.set(node, (resolution > 0).then(|| -front.error_at(node, resolution - 1)));
    }

    pub(crate) fn refresh_by_triangles(&mut self, node: u32) {
        let gain = self.split_gain(node);
        self.split.set(node, gain);
        let cost = self.merge_cost(node);
        self.merge.set(node, cost.map(|cost| -cost));
    }

    /// The largest weighted error.
    pub(crate) fn worst_error(&self) -> f64 {
        self.worst.peek().map_or(0.0, |(error, _)| error.max(0.0))
    }

    /// What local costs are measured against.
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
