//! Every node as coarse as the tolerance allows (Niski 2007, section 4.1.1, "adapted to the error budget").

use super::{Limiter, adaptation::Adaptation, front::ABSENT};

impl Adaptation {
    /// Refines the nodes among `nodes` that are above the tolerance, and neighbours whose errors rise above it by that.
    /// Then, if `coarsens`, coarsens nodes that are far enough below. Refining a node can raise its neighbours' errors,
    /// and coarsening never does. So refining ends, and coarsening keeps what it has reached.
    pub(crate) fn settle(&mut self, mut nodes: Vec<u32>, coarsens: bool) {
        let mut next = 0;
        while let Some(&node) = nodes.get(next) {
            next += 1;
            self.refine_to_tolerance(node);
            while let Some(node) = self.front.take_dirty() {
                nodes.push(node);
            }
        }
        if coarsens {
            let mut next = 0;
            while let Some(&node) = nodes.get(next) {
                next += 1;
                self.coarsen_to_tolerance(node);
                while let Some(node) = self.front.take_dirty() {
                    nodes.push(node);
                }
            }
        }
        nodes.sort_unstable();
        nodes.dedup();
        for node in nodes {
            let error = self.is_above_tolerance(node).then(|| self.front.error(node));
            self.worst.set(node, error);
            if self.has_tree_queues() {
                self.refresh_by_triangles(node);
            }
        }
    }

    /// Settles all that has changed.
    pub(crate) fn settle_dirty(&mut self, coarsens: bool) {
        let mut nodes = Vec::new();
        while let Some(node) = self.front.take_dirty() {
            nodes.push(node);
        }
        self.settle(nodes, coarsens);
    }

    fn is_above_tolerance(&self, node: u32) -> bool {
        let (front, tolerance) = (&self.front, self.goal.tolerance);
        front.is_inside(node) && front.may_exceed(node, tolerance) && front.error(node) > tolerance
    }

    fn refine_to_tolerance(&mut self, node: u32) {
        while self.is_above_tolerance(node) {
            if self.front.has_finer(node) {
                self.front.place(node, self.front.resolution(node) + 1);
            } else if self.front.hierarchy.children(node).is_empty() {
                return;
            } else {
                // Nothing finer without children: this split is not for triangles.
                if self.node_count_if_split(node) > self.goal.nodes {
                    self.blocked_by = Some(Limiter::Nodes);
                } else {
                    self.front.split(node, self.goal.tolerance);
                }
                return;
            }
        }
    }

    fn coarsen_to_tolerance(&mut self, node: u32) {
        let enough = self.goal.tolerance * (1.0 - self.goal.hysteresis);
        loop {
            let resolution = self.front.resolution(node);
            if resolution == ABSENT || resolution == 0 || !self.front.is_inside(node) {
                return;
            }
            if self.front.error_at(node, resolution - 1) > enough {
                return;
            }
            self.front.place(node, resolution - 1);
        }
    }
}
