//! A cut while it is adapted: the resolution of each node, and exact counts.

use std::{cell::Cell, sync::Arc};

use super::{
    hierarchy::{Hierarchy, NONE},
    weights::Weights,
};

/// As a resolution: the node is not in the cut. As a level: it is not drawn.
pub(crate) const ABSENT: u8 = u8::MAX;

/// Nodes that cover everything once, each with a resolution. Nodes outside the scope belong to the cut, so that it
/// stays whole, but are drawn only if the query asks for it, and then at their coarsest.
#[derive(Clone, Debug)]
pub(crate) struct Front {
    pub hierarchy: Arc<Hierarchy>,
    pub weights: Weights,
    draws_outside: bool,
    resolutions: Vec<u8>,
    /// Levels of the nodes that are drawn.
    levels: Vec<u8>,
    /// As [`Hierarchy::all_users`], but of each border those come first that are drawn: of a tree's many users hardly
    /// more than two are.
    users: Vec<u32>,
    /// How many these are, by border.
    drawn_users: Vec<u32>,
    page_uses: Vec<u32>,
    pub triangle_count: u64,
    pub node_count: u64,
    pub byte_count: u64,
    /// The resolutions of nodes before each change.
    journal: Vec<(u32, u8)>,
    /// Nodes whose error may have changed, at their resolution or at the next coarser one.
    dirty: Vec<u32>,
    is_dirty: Vec<bool>,
    evaluation_count: Cell<u64>,
}

impl Front {
    /// The coarsest cut.
    pub(crate) fn new(hierarchy: Arc<Hierarchy>, weights: Weights, draws_outside: bool) -> Self {
        let count = hierarchy.node_count() as usize;
        let page_uses = vec![0; hierarchy.page_bytes().len()];
        let mut this = Self {
            weights,
            draws_outside,
            resolutions: vec![ABSENT; count],
            levels: vec![ABSENT; count],
            users: hierarchy.all_users().to_vec(),
            drawn_users: vec![0; hierarchy.border_count()],
            page_uses,
            triangle_count: 0,
            node_count: 0,
            byte_count: 0,
            journal: Vec::new(),
            dirty: Vec::new(),
            is_dirty: vec![false; count],
            evaluation_count: Cell::new(0),
            hierarchy,
        };
        this.reset();
        this
    }

    /// Goes back to the coarsest cut.
    pub(crate) fn reset(&mut self) {
        let mut coarsest = vec![ABSENT; self.resolutions.len()];
        self.hierarchy.roots().iter().for_each(|&root| coarsest[root as usize] = 0);
        self.lay(&coarsest);
    }

    /// Takes the place of the whole cut, and counts everything anew: for many changes faster than one by one.
    pub(crate) fn lay(&mut self, resolutions: &[u8]) {
        let hierarchy = Arc::clone(&self.hierarchy);
        for (node, &resolution) in (0..).zip(resolutions) {
            let before = self.resolution(node);
            if before == resolution {
                continue;
            }
            self.journal.push((node, before));
            if resolution == ABSENT {
                self.weights.forget(node, &hierarchy);
            } else if before == ABSENT {
                self.weights.weigh(&hierarchy, node);
            }
            self.resolutions[node as usize] = resolution;
        }
        (self.triangle_count, self.node_count, self.byte_count) = (0, 0, 0);
        self.page_uses.fill(0);
        for node in 0..hierarchy.node_count() {
            let resolution = self.resolution(node);
            let is_drawn = resolution != ABSENT && (self.draws_outside || self.weights.get(node) > 0.0);
            self.levels[node as usize] = if is_drawn { hierarchy.level(node, resolution) } else { ABSENT };
            self.mark(node);
            if is_drawn {
                self.count(node, resolution);
            }
        }
        for border in 0..hierarchy.border_count() as u32 {
            let users = &mut self.users[hierarchy.users_of(border)];
            let (mut drawn, mut coarsest, mut finest) = (0, ABSENT, 0);
            for at in 0..users.len() {
                let level = self.levels[users[at] as usize];
                if level != ABSENT {
                    users.swap(at, drawn);
                    (drawn, coarsest, finest) = (drawn + 1, coarsest.min(level), finest.max(level));
                }
            }
            self.drawn_users[border as usize] = drawn as u32;
            if coarsest < finest {
                self.triangle_count += self.extra_triangles(border, NONE, ABSENT);
            }
        }
    }

    /// Counts a node that is drawn from now on, without what stitching adds.
    fn count(&mut self, node: u32, resolution: u8) {
        let Self { hierarchy, page_uses, .. } = self;
        self.triangle_count += hierarchy.grade(node, resolution).triangle_count;
        self.node_count += 1;
        for &page in (0..=resolution).flat_map(|resolution| hierarchy.pages(node, resolution)) {
            let uses = &mut page_uses[page as usize];
            self.byte_count += if *uses == 0 { hierarchy.page_bytes()[page as usize] } else { 0 };
            *uses += 1;
        }
    }

    /// Adds evaluations of errors that others make.
    pub(crate) fn add_evaluations(&self, count: u64) {
        self.evaluation_count.set(self.evaluation_count.get() + count);
    }

    /// The weight of a node of the cut, or the one that a node would enter it with.
    pub(crate) fn weight_in_cut(&mut self, node: u32) -> f64 {
        let hierarchy = Arc::clone(&self.hierarchy);
        if self.contains(node) { self.weights.get(node) } else { self.weights.foresee(&hierarchy, node) }
    }

    pub(crate) fn resolution(&self, node: u32) -> u8 {
        self.resolutions[node as usize]
    }

    pub(crate) fn contains(&self, node: u32) -> bool {
        self.resolutions[node as usize] != ABSENT
    }

    /// Whether a node of the cut lies in the scope, so its error counts.
    pub(crate) fn is_inside(&self, node: u32) -> bool {
        self.contains(node) && self.weights.get(node) > 0.0
    }

    pub(crate) fn is_drawn(&self, node: u32) -> bool {
        self.levels[node as usize] != ABSENT
    }

    /// The level that a node is drawn at, or [`ABSENT`].
    pub(crate) fn level(&self, node: u32) -> u8 {
        self.levels[node as usize]
    }

    pub(crate) fn draws_outside(&self) -> bool {
        self.draws_outside
    }

    /// Whether a finer resolution or children remain.
    pub(crate) fn can_refine(&self, node: u32) -> bool {
        self.has_finer(node) || !self.hierarchy.children(node).is_empty()
    }

    pub(crate) fn has_finer(&self, node: u32) -> bool {
        usize::from(self.resolution(node)) + 1 < self.hierarchy.grades(node).len()
    }

    /// Boxes projected and errors evaluated so far, which measure the work of adapting.
    pub(crate) fn evaluation_count(&self) -> u64 {
        self.evaluation_count.get() + self.weights.look_count()
    }

    /// Weighted bound of the error of a node of the cut at one of its resolutions, with all other nodes unchanged.
    pub(crate) fn error_at(&self, node: u32, resolution: u8) -> f64 {
        self.weights.get(node) * self.world_error(node, resolution)
    }

    /// Weighted bound of a node's error in this cut.
    pub(crate) fn error(&self, node: u32) -> f64 {
        self.error_at(node, self.resolution(node))
    }

    /// Whether a node's error may be above another one, whatever its neighbours are.
    pub(crate) fn may_exceed(&self, node: u32, error: f64) -> bool {
        let grade = self.hierarchy.grade(node, self.resolution(node));
        self.weights.get(node) * grade.refined_error.max(grade.error) > error
    }

    /// Bound of the error in world units.
    pub(crate) fn world_error(&self, node: u32, resolution: u8) -> f64 {
        self.evaluation_count.set(self.evaluation_count.get() + 1);
        let grade = self.hierarchy.grade(node, resolution);
        if grade.refined_error > grade.error && self.has_finer_neighbour(node, grade.level) {
            grade.refined_error
        } else {
            grade.error
        }
    }

    /// Whether a neighbour has more samples than `level` on a border of `node`.
    fn has_finer_neighbour(&self, node: u32, level: u8) -> bool {
        let hierarchy = &*self.hierarchy;
        hierarchy.borders(node).iter().any(|&border| {
            self.drawn_users(border).iter().any(|&user| {
                let other = self.levels[user as usize];
                other > level
                    && user != node
                    && hierarchy.sample_count(border, other) > hierarchy.sample_count(border, level)
            })
        })
    }

    /// The other drawn users of a node's borders, some of them more than once.
    pub(crate) fn neighbours(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let users = self.hierarchy.borders(node).iter().flat_map(|&border| self.drawn_users(border));
        users.copied().filter(move |&user| user != node)
    }

    /// The drawn users of a border.
    fn drawn_users(&self, border: u32) -> &[u32] {
        let all = &self.users[self.hierarchy.users_of(border)];
        &all[..self.drawn_users[border as usize] as usize]
    }

    /// Counts a node among the drawn users of its borders, or no longer.
    fn set_drawn(&mut self, node: u32, is_drawn: bool) {
        let Self { hierarchy, users, drawn_users, .. } = self;
        for &border in hierarchy.borders(node) {
            let (all, drawn) = (&mut users[hierarchy.users_of(border)], &mut drawn_users[border as usize]);
            // A border may have a node on both sides.
            if is_drawn {
                for at in *drawn as usize..all.len() {
                    if all[at] == node {
                        all.swap(at, *drawn as usize);
                        *drawn += 1;
                    }
                }
            } else {
                for at in (0..*drawn as usize).rev() {
                    if all[at] == node {
                        *drawn -= 1;
                        all.swap(at, *drawn as usize);
                    }
                }
            }
        }
    }

    /// Triangles that stitching adds along a border: one for each sample that a user lacks. `node`, if it is drawn,
    /// counts as drawn at `level`.
    fn extra_triangles(&self, border: u32, node: u32, level: u8) -> u64 {
        let hierarchy = &*self.hierarchy;
        let level_of = |&user: &u32| if user == node { level } else { self.levels[user as usize] };
        let drawn = || self.drawn_users(border).iter().map(level_of);
        let Some(finest) = drawn().max() else { return 0 };
        let most = u64::from(hierarchy.sample_count(border, finest));
        drawn().map(|level| most - u64::from(hierarchy.sample_count(border, level))).sum()
    }

    fn extra_of_node(&self, node: u32, level: u8) -> u64 {
        self.hierarchy.borders(node).iter().map(|&border| self.extra_triangles(border, node, level)).sum()
    }

    /// The number of triangles if a drawn node had another resolution.
    pub(crate) fn triangles_with(&self, node: u32, resolution: u8) -> u64 {
        let grades = self.hierarchy.grades(node);
        let (now, then) = (grades[usize::from(self.resolution(node))], grades[usize::from(resolution)]);
        let without = self.triangle_count - now.triangle_count - self.extra_of_node(node, now.level);
        without + then.triangle_count + self.extra_of_node(node, then.level)
    }

    /// The number of bytes if a drawn node had its next finer resolution.
    pub(crate) fn bytes_with_finer(&self, node: u32) -> u64 {
        let pages = self.hierarchy.pages(node, self.resolution(node) + 1);
        let new = pages.iter().filter(|&&page| self.page_uses[page as usize] == 0);
        self.byte_count + new.map(|&page| self.hierarchy.page_bytes()[page as usize]).sum::<u64>()
    }

    /// Gives a node a resolution, or takes it out of the cut.
    pub(crate) fn place(&mut self, node: u32, resolution: u8) {
        let before = self.resolution(node);
        if before == ABSENT && resolution != ABSENT {
            let hierarchy = Arc::clone(&self.hierarchy);
            self.weights.weigh(&hierarchy, node);
        }
        self.place_weighed(node, resolution);
    }

    /// The same with a weight that is known.
    fn place_weighed(&mut self, node: u32, resolution: u8) {
        let before = self.resolution(node);
        if before == resolution {
            return;
        }
        self.journal.push((node, before));
        if resolution == ABSENT {
            self.weights.forget(node, &self.hierarchy);
        }
        self.redraw(node, resolution);
    }

    /// Weighs a node of the cut again.
    pub(crate) fn weigh_again(&mut self, node: u32) {
        let before = self.weights.get(node);
        let hierarchy = Arc::clone(&self.hierarchy);
        let now = self.weights.weigh(&hierarchy, node);
        if now == 0.0 && before > 0.0 && self.resolution(node) > 0 {
            // This goes through the journal: nodes outside are drawn at their coarsest.
            self.place(node, 0);
        }
        if now != before {
            self.redraw(node, self.resolution(node));
            self.mark(node);
        }
    }

    /// Updates all counts for a node's resolution and weight.
    fn redraw(&mut self, node: u32, resolution: u8) {
        let hierarchy = Arc::clone(&self.hierarchy);
        let at = node as usize;
        let (old_level, old_resolution) = (self.levels[at], self.resolutions[at]);
        let is_drawn = resolution != ABSENT && (self.draws_outside || self.weights.get(node) > 0.0);
        let new_level = if is_drawn { hierarchy.grade(node, resolution).level } else { ABSENT };
        self.resolutions[at] = resolution;
        self.mark(node);
        if let Some(parent) = hierarchy.parent(node) {
            self.mark(parent);
        }
        if (old_level, old_resolution) == (new_level, resolution) {
            return;
        }
        let extra_before = self.extra_of_node(node, old_level);
        self.levels[at] = new_level;
        if (old_level == ABSENT) != (new_level == ABSENT) {
            self.set_drawn(node, new_level != ABSENT);
        }
        let extra_after = self.extra_of_node(node, new_level);
        self.triangle_count = self.triangle_count + extra_after - extra_before;
        // New pages come first, so that pages that stay are never uncounted.
        if is_drawn {
            self.count(node, resolution);
        }
        if old_level != ABSENT {
            self.triangle_count -= hierarchy.grade(node, old_resolution).triangle_count;
            self.node_count -= 1;
            for page in (0..=old_resolution).flat_map(|resolution| hierarchy.pages(node, resolution)) {
                let uses = &mut self.page_uses[*page as usize];
                *uses -= 1;
                self.byte_count -= if *uses == 0 { hierarchy.page_bytes()[*page as usize] } else { 0 };
            }
        }
        if old_level != new_level {
            self.mark_neighbours(node, old_level, new_level);
        }
    }

    /// Marks the neighbours whose errors may change because `node` has gone from one level to another.
    fn mark_neighbours(&mut self, node: u32, old_level: u8, new_level: u8) {
        let hierarchy = Arc::clone(&self.hierarchy);
        for &border in hierarchy.borders(node) {
            for at in hierarchy.users_of(border).take(self.drawn_users[border as usize] as usize) {
                let user = self.users[at];
                let level = self.levels[user as usize];
                if user == node || self.is_dirty[user as usize] {
                    continue;
                }
                let differs = |level: u8| {
                    let more = |other: u8| {
                        other != ABSENT
                            && other > level
                            && hierarchy.sample_count(border, other) > hierarchy.sample_count(border, level)
                    };
                    more(old_level) != more(new_level)
                };
                let resolution = self.resolution(user);
                if differs(level) || resolution > 0 && differs(hierarchy.grade(user, resolution - 1).level) {
                    self.mark(user);
                }
            }
        }
    }

    fn mark(&mut self, node: u32) {
        if !std::mem::replace(&mut self.is_dirty[node as usize], true) {
            self.dirty.push(node);
        }
    }

    /// Marks everything in the cut.
    pub(crate) fn mark_all(&mut self) {
        for node in 0..self.hierarchy.node_count() {
            if self.contains(node) {
                self.mark(node);
            }
        }
    }

    /// A node whose errors may have changed.
    pub(crate) fn take_dirty(&mut self) -> Option<u32> {
        let node = self.dirty.pop()?;
        self.is_dirty[node as usize] = false;
        Some(node)
    }

    /// Takes the place of a node's children.
    pub(crate) fn merge(&mut self, parent: u32, resolution: u8) {
        let hierarchy = Arc::clone(&self.hierarchy);
        for &child in hierarchy.children(parent) {
            self.place(child, ABSENT);
        }
        self.place(parent, resolution);
    }

    /// Replaces a node by its children, each at the coarsest resolution whose own error is at most `threshold`.
    pub(crate) fn split(&mut self, node: u32, threshold: f64) {
        let hierarchy = Arc::clone(&self.hierarchy);
        self.place(node, ABSENT);
        for &child in hierarchy.children(node) {
            if !self.contains(child) {
                let weight = self.weights.weigh(&hierarchy, child);
                self.place_weighed(child, self.needed_resolution(child, weight, threshold));
            }
        }
    }

    /// The coarsest resolution whose own error is at most `threshold` under a weight, or else the finest.
    pub(crate) fn needed_resolution(&self, node: u32, weight: f64, threshold: f64) -> u8 {
        if weight == 0.0 {
            return 0;
        }
        let grades = self.hierarchy.grades(node);
        let found = grades.iter().position(|grade| weight * grade.error <= threshold);
        found.unwrap_or(grades.len() - 1) as u8
    }

    /// A mark to which [`Front::undo_to`] can return.
    pub(crate) fn mark_of_journal(&self) -> usize {
        self.journal.len()
    }

    /// Nodes that were changed since a mark, some more than once.
    pub(crate) fn changed_since(&self, mark: usize) -> &[(u32, u8)] {
        &self.journal[mark..]
    }

    /// Takes back everything since a mark.
    pub(crate) fn undo_to(&mut self, mark: usize) {
        while self.journal.len() > mark {
            let Some((node, resolution)) = self.journal.pop() else { return };
            let length = self.journal.len();
            self.place(node, resolution);
            self.journal.truncate(length);
        }
    }

    pub(crate) fn clear_journal(&mut self) {
        self.journal.clear();
    }
}
