//! Split gain and merge cost (Niski 2007, section 4.1, figures 4.1 and 4.2), and the phase that uses them.

use super::{adaptation::Adaptation, front::ABSENT};

impl Adaptation {
    /// Triangles saved by drawing a node's children instead, each no finer than its threshold requires.
    pub(crate) fn split_gain(&mut self, node: u32) -> Option<f64> {
        let front = &mut self.front;
        if front.hierarchy.children(node).is_empty() || !front.is_inside(node) {
            return None;
        }
        let hierarchy = std::sync::Arc::clone(&front.hierarchy);
        let own = hierarchy.grade(node, front.resolution(node)).triangle_count;
        let error = front.error(node);
        let threshold = self.threshold(error);
        let mut needed = 0;
        for &child in hierarchy.children(node) {
            needed += self.triangles_at(child, threshold);
        }
        Some(own as f64 - needed as f64)
    }

    /// Additional triangles if a parent replaces its children without a larger error; infinite where it cannot.
    pub(crate) fn merge_cost(&mut self, parent: u32) -> Option<f64> {
        let front = &mut self.front;
        let hierarchy = std::sync::Arc::clone(&front.hierarchy);
        let children = hierarchy.children(parent);
        if front.contains(parent) || children.is_empty() || !children.iter().all(|&child| front.contains(child)) {
            return None;
        }
        let drawn = |child: &&u32| front.is_drawn(**child);
        let of_child = |&child: &u32| hierarchy.grade(child, front.resolution(child)).triangle_count;
        let own: u64 = children.iter().filter(drawn).map(of_child).sum();
        let (threshold, weight) = (self.merge_threshold(parent), self.front.weights.glance(&hierarchy, parent));
        let resolution = self.front.needed_resolution(parent, weight, threshold);
        let grade = hierarchy.grade(parent, resolution);
        if weight > 0.0 && weight * grade.error > threshold {
            return Some(f64::INFINITY);
        }
        let needed = if weight > 0.0 || self.front.draws_outside() { grade.triangle_count } else { 0 };
        Some(needed as f64 - own as f64)
    }

    /// The number of nodes if a drawn node were split.
    pub(crate) fn node_count_if_split(&mut self, node: u32) -> u64 {
        let hierarchy = std::sync::Arc::clone(&self.front.hierarchy);
        let draws_outside = self.front.draws_outside();
        let weights = &mut self.front.weights;
        let mut drawn = |child: &&u32| draws_outside || weights.glance(&hierarchy, **child) > 0.0;
        let child_count = hierarchy.children(node).iter().filter(|child| drawn(child)).count() as u64;
        self.front.node_count + child_count - 1
    }

    /// Triangles that a node outside the cut would have at a threshold.
    fn triangles_at(&mut self, node: u32, threshold: f64) -> u64 {
        let hierarchy = std::sync::Arc::clone(&self.front.hierarchy);
        let weight = self.front.weights.glance(&hierarchy, node);
        if weight == 0.0 && !self.front.draws_outside() {
            return 0;
        }
        hierarchy.grade(node, self.front.needed_resolution(node, weight, threshold)).triangle_count
    }

    fn merge_threshold(&self, parent: u32) -> f64 {
        let children = self.front.hierarchy.children(parent).iter();
        let errors = children.filter(|&&child| self.front.is_inside(child)).map(|&child| self.front.error(child));
        self.threshold(errors.fold(0.0, f64::max))
    }

    /// Weighted error of a parent that replaces its children, once all of these are at their coarsest; only if that
    /// takes no more triangles.
    pub(crate) fn error_if_collapsed(&self, parent: u32) -> Option<f64> {
        let resolution = self.collapsed_resolution(parent)?;
        let front = &self.front;
        let weight = front.weights.scope().factor(front.hierarchy.bounds(parent));
        Some(weight * front.hierarchy.grade(parent, resolution).error)
    }

    /// The finest resolution of a parent with fewer triangles than its children, which are all at their coarsest.
    pub(crate) fn collapsed_resolution(&self, parent: u32) -> Option<u8> {
        let front = &self.front;
        let hierarchy = &front.hierarchy;
        let children = hierarchy.children(parent);
        if front.contains(parent) || children.is_empty() || children.iter().any(|&child| front.resolution(child) != 0) {
            return None;
        }
        let drawn = children.iter().filter(|&&child| front.is_drawn(child));
        let count: u64 = drawn.map(|&child| hierarchy.grade(child, 0).triangle_count).sum();
        let fewer = hierarchy.grades(parent).iter().rposition(|grade| grade.triangle_count < count);
        fewer.map(|resolution| resolution as u8).or((hierarchy.grade(parent, 0).triangle_count <= count).then_some(0))
    }

    /// Coarsens a node, or collapses the children of a parent.
    pub(crate) fn coarsen_once(&mut self, node: u32) {
        let resolution = self.front.resolution(node);
        if resolution != ABSENT {
            self.front.place(node, resolution.saturating_sub(1));
        } else if let Some(resolution) = self.collapsed_resolution(node) {
            self.front.merge(node, resolution);
        }
    }

    /// Merges nodes where that costs nothing or the node budget requires it, splits nodes where that saves triangles,
    /// best first, and merges where the best split lacks room and saves more than the merge costs. Makes at most `most`
    /// changes and never splits and merges the same node. Settles errors after each change if `settles`. Returns the
    /// number of changes.
    pub(crate) fn split_and_merge(&mut self, most: usize, settles: bool) -> usize {
        if !self.has_tree_queues() {
            return 0;
        }
        let mut change_count = 0;
        while change_count < most {
            if !(self.merge_one(settles) || self.split_one(settles)) {
                break;
            }
            change_count += 1;
        }
        change_count
    }

    /// Makes the next merge, if it pays.
    pub(crate) fn merge_one(&mut self, settles: bool) -> bool {
        while let Some((cost, parent)) = self.merge.peek().map(|(priority, parent)| (-priority, parent)) {
            let needed = self.front.node_count > self.goal.nodes;
            // Room is made for the best split alone, and only where it lacks.
            let best_split = self.split.peek();
            let gain = best_split.map_or(0.0, |(gain, _)| gain);
            let is_full = best_split.is_some_and(|(_, node)| self.node_count_if_split(node) > self.goal.nodes);
            let pays = cost <= 0.0 || is_full && cost < gain * (1.0 - self.goal.hysteresis);
            if !needed && !pays {
                return false;
            }
            if !needed && self.stamps[parent as usize].restructured == self.call {
                // It was split in this call: not to be merged for a gain that the split did not bring.
                self.merge.set(parent, None);
                continue;
            }
            let hierarchy = std::sync::Arc::clone(&self.front.hierarchy);
            let (threshold, weight) = (self.merge_threshold(parent), self.front.weights.glance(&hierarchy, parent));
            let resolution = self.front.needed_resolution(parent, weight, threshold);
            let before = (self.front.mark_of_journal(), self.front.triangle_count);
            self.front.merge(parent, resolution);
            self.after_change(settles);
            self.stamps[parent as usize].restructured = self.call;
            if !needed && cost <= 0.0 && self.front.triangle_count > before.1 {
                // Borders have cost more than the merge has saved.
                self.front.undo_to(before.0);
                self.after_change(settles);
                self.merge.set(parent, None);
                continue;
            }
            return true;
        }
        false
    }

    /// Makes the next split, if it saves triangles and the node budget allows it.
    fn split_one(&mut self, settles: bool) -> bool {
        let mut skipped = Vec::new();
        let found = loop {
            let Some((gain, node)) = self.split.peek() else { break false };
            let own = self.front.hierarchy.grade(node, self.front.resolution(node)).triangle_count;
            if gain <= 0.0 || gain < self.goal.hysteresis * own as f64 {
                break false;
            }
            if self.stamps[node as usize].restructured == self.call || self.node_count_if_split(node) > self.goal.nodes
            {
                self.split.set(node, None);
                skipped.push(node);
                continue;
            }
            let before = (self.front.mark_of_journal(), self.front.triangle_count);
            let error = self.front.error(node);
            let threshold = self.threshold(error);
            self.front.split(node, threshold);
            self.after_change(settles);
            self.stamps[node as usize].restructured = self.call;
            if self.front.triangle_count >= before.1 {
                self.front.undo_to(before.0);
                self.after_change(settles);
                continue;
            }
            break true;
        };
        for node in skipped {
            self.refresh_by_triangles(node);
        }
        found
    }

    fn after_change(&mut self, settles: bool) {
        if settles {
            self.settle_dirty(false);
        } else {
            self.refresh();
        }
    }
}
