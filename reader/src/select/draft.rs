//! Cuts that are soon made and counted, to find a threshold.

use std::sync::Arc;

use super::{
    front::{ABSENT, Front},
    hierarchy::{Grade, Hierarchy},
    histogram::{Histogram, Sums},
};

/// Two thresholds, the second at least the first: where nodes are scarce, splits end before refinement does.
#[derive(Clone, Copy)]
pub(super) struct Thresholds {
    pub refine: f64,
    pub split: f64,
}

/// A cut of which little more than the resolutions is known, so that it is soon made.
pub(super) struct Draft<'f> {
    front: &'f mut Front,
    pub hierarchy: Arc<Hierarchy>,
    /// The weights that nodes have in a cut; no number where nobody has asked yet.
    weights: Vec<f64>,
    pub resolutions: Vec<u8>,
    /// As those of a front: the levels of nodes that are drawn.
    levels: Vec<u8>,
    /// Whether nodes are also split where that takes fewer triangles.
    pub saves: bool,
    /// Those are.
    split_saves: Vec<bool>,
}

impl<'f> Draft<'f> {
    pub fn new(front: &'f mut Front) -> Self {
        let hierarchy = Arc::clone(&front.hierarchy);
        let count = hierarchy.node_count() as usize;
        let resolutions = vec![ABSENT; count];
        let (weights, levels) = (vec![f64::NAN; count], resolutions.clone());
        Self { front, hierarchy, weights, resolutions, levels, saves: false, split_saves: Vec::new() }
    }

    fn weight(&mut self, node: u32) -> f64 {
        let known = &mut self.weights[node as usize];
        if known.is_nan() {
            *known = self.front.weight_in_cut(node);
        }
        *known
    }

    /// The coarsest cut in which no error is above the thresholds, if there is one. Returns triangles, nodes, and
    /// bytes if wanted.
    pub fn make(&mut self, thresholds: Thresholds, with_bytes: bool) -> [u64; 3] {
        let hierarchy = Arc::clone(&self.hierarchy);
        self.resolutions.fill(ABSENT);
        self.levels.fill(ABSENT);
        hierarchy.roots().iter().for_each(|&root| self.resolutions[root as usize] = 0);
        if self.saves {
            self.find_savings(thresholds.refine);
        }
        let mut due = Vec::new();
        // A parent comes before its children.
        for node in 0..hierarchy.node_count() {
            if self.resolutions[node as usize] != ABSENT {
                self.refine_from(node, 0, thresholds, &mut due);
            }
        }
        while let Some(node) = due.pop() {
            self.refine_beside_finer(node, thresholds, &mut due);
        }
        self.count(with_bytes)
    }

    /// Finds the nodes whose children take fewer triangles than they themselves at a threshold, which without borders
    /// gives the fewest triangles that a cut can have there.
    fn find_savings(&mut self, threshold: f64) {
        let hierarchy = Arc::clone(&self.hierarchy);
        let count = hierarchy.node_count();
        self.split_saves.clear();
        self.split_saves.resize(count as usize, false);
        let mut least = vec![0_u64; count as usize];
        for node in (0..count).rev() {
            let (at, weight, grades) = (node as usize, self.weight(node), hierarchy.grades(node));
            let fits = |grade: &&Grade| weight * grade.error <= threshold;
            let (own, children) = (grades.iter().find(fits), hierarchy.children(node));
            least[at] = match own.or(grades.last().filter(|_| children.is_empty())) {
                _ if weight == 0.0 && !self.front.draws_outside() => 0,
                _ if weight == 0.0 => hierarchy.grade(node, 0).triangle_count,
                Some(own) => own.triangle_count,
                None => u64::MAX,
            };
            if weight > 0.0 && !children.is_empty() {
                let below = children.iter().fold(0, |sum: u64, &child| sum.saturating_add(least[child as usize]));
                self.split_saves[at] = below < least[at];
                least[at] = least[at].min(below);
            }
        }
    }

    /// Refines a node, from one of its resolutions on, until its own error is within the thresholds. One that has to be
    /// split gives way to its children, which begin with resolution 0. Nodes that have to be refined if a neighbour is
    /// finer are due.
    fn refine_from(&mut self, node: u32, resolution: u8, thresholds: Thresholds, due: &mut Vec<u32>) {
        let hierarchy = Arc::clone(&self.hierarchy);
        let (at, weight) = (node as usize, self.weight(node));
        let grades = hierarchy.grades(node);
        let last = grades.len() - 1;
        let mut now = usize::from(resolution);
        while weight > 0.0 && now < last && weight * grades[now].error > thresholds.refine {
            now += 1;
        }
        if weight > 0.0 {
            self.front.add_evaluations((now - usize::from(resolution)) as u64 + 1);
        }
        let is_split = |error: f64| now == last && weight * error > thresholds.split;
        let saves = resolution == 0 && self.split_saves.get(at).is_some_and(|&saves| saves);
        if weight > 0.0 && (saves || is_split(grades[now].error)) && !hierarchy.children(node).is_empty() {
            self.split(node);
            return;
        }
        self.resolutions[at] = now as u8;
        if weight > 0.0 || self.front.draws_outside() {
            self.levels[at] = grades[now].level;
        }
        let refined = grades[now].refined_error;
        if weight > 0.0 && refined > grades[now].error && weight * refined > thresholds.refine {
            due.push(node);
        }
    }

    /// A node gives way to its children.
    fn split(&mut self, node: u32) {
        (self.resolutions[node as usize], self.levels[node as usize]) = (ABSENT, ABSENT);
        let hierarchy = Arc::clone(&self.hierarchy);
        for &child in hierarchy.children(node) {
            self.resolutions[child as usize] = 0;
        }
    }

    /// Refines a node once more where a finer neighbour raises its error above the thresholds, and then what depends
    /// on it.
    fn refine_beside_finer(&mut self, node: u32, thresholds: Thresholds, due: &mut Vec<u32>) {
        let hierarchy = Arc::clone(&self.hierarchy);
        let (resolution, level) = (self.resolutions[node as usize], self.levels[node as usize]);
        if resolution == ABSENT || level == ABSENT {
            return;
        }
        let grade: Grade = *hierarchy.grade(node, resolution);
        let error = self.weight(node) * grade.refined_error;
        let is_last = usize::from(resolution) + 1 == hierarchy.grades(node).len();
        let can_refine = !is_last || !hierarchy.children(node).is_empty();
        let most = if is_last { thresholds.split } else { thresholds.refine };
        if !(can_refine && error > most && self.has_finer_neighbour(node, level)) {
            return;
        }
        let children = |node: u32| hierarchy.children(node).iter().map(|&child| (child, 0));
        let mut open = vec![(node, resolution + 1)];
        if is_last {
            self.split(node);
            open = children(node).collect();
        }
        while let Some((node, resolution)) = open.pop() {
            self.refine_from(node, resolution, thresholds, due);
            if self.resolutions[node as usize] == ABSENT {
                open.extend(children(node));
            }
        }
        for &border in hierarchy.borders(node) {
            let drawn = hierarchy.users(border).iter().filter(|&&user| self.levels[user as usize] != ABSENT);
            due.extend(drawn);
        }
    }

    /// The largest error of the draft.
    pub fn worst_error(&mut self) -> f64 {
        let hierarchy = Arc::clone(&self.hierarchy);
        let mut worst = 0.0_f64;
        for node in 0..hierarchy.node_count() {
            if self.levels[node as usize] == ABSENT {
                continue;
            }
            let grade = *hierarchy.grade(node, self.resolutions[node as usize]);
            let weight = self.weight(node);
            worst = worst.max(weight * grade.error);
            if weight * grade.refined_error > worst && self.has_finer_neighbour(node, grade.level) {
                worst = weight * grade.refined_error;
            }
        }
        worst
    }

    /// As that of a front.
    fn has_finer_neighbour(&self, node: u32, level: u8) -> bool {
        let hierarchy = &*self.hierarchy;
        hierarchy.borders(node).iter().any(|&border| {
            let own = hierarchy.sample_count(border, level);
            hierarchy.users(border).iter().any(|&user| {
                let other = self.levels[user as usize];
                other != ABSENT && other > level && user != node && hierarchy.sample_count(border, other) > own
            })
        })
    }

    /// Exact numbers of triangles and nodes, and of bytes if they are wanted.
    fn count(&self, with_bytes: bool) -> [u64; 3] {
        let hierarchy = &*self.hierarchy;
        let (mut triangles, mut nodes, mut bytes) = (0, 0, 0);
        let mut is_counted = vec![false; if with_bytes { hierarchy.page_bytes().len() } else { 0 }];
        for node in (0..hierarchy.node_count()).filter(|&node| self.levels[node as usize] != ABSENT) {
            let resolution = self.resolutions[node as usize];
            triangles += hierarchy.grade(node, resolution).triangle_count;
            nodes += 1;
            for &page in
                (0..=resolution).filter(|_| with_bytes).flat_map(|resolution| hierarchy.pages(node, resolution))
            {
                if !std::mem::replace(&mut is_counted[page as usize], true) {
                    bytes += hierarchy.page_bytes()[page as usize];
                }
            }
        }
        for border in 0..hierarchy.border_count() as u32 {
            let (users, mut coarsest, mut finest) = (hierarchy.users(border), ABSENT, 0);
            for &user in users {
                let level = self.levels[user as usize];
                if level != ABSENT {
                    (coarsest, finest) = (coarsest.min(level), finest.max(level));
                }
            }
            if coarsest < finest {
                let most = u64::from(hierarchy.sample_count(border, finest));
                let drawn = users.iter().map(|&user| self.levels[user as usize]).filter(|&level| level != ABSENT);
                triangles += drawn.map(|level| most - u64::from(hierarchy.sample_count(border, level))).sum::<u64>();
            }
        }
        [triangles, nodes, bytes]
    }

    /// The histogram of all refinements of nodes above the tolerance, each counted at its own error or, where that is
    /// less, at that of a refinement which has to come before.
    pub fn histogram(&mut self, tolerance: f64) -> Histogram {
        let hierarchy = Arc::clone(&self.hierarchy);
        let largest = hierarchy.roots().iter().map(|&root| {
            let errors = hierarchy.grades(root).iter().map(|grade| grade.error);
            self.weight(root) * errors.fold(0.0, f64::max)
        });
        let mut histogram = Histogram::new(largest.fold(0.0, f64::max));
        // For each node the error at which its parent is split; below zero where it is not.
        let mut begins = vec![-1.0_f64; hierarchy.node_count() as usize];
        hierarchy.roots().iter().for_each(|&root| begins[root as usize] = f64::INFINITY);
        for node in 0..hierarchy.node_count() {
            let mut begin = begins[node as usize];
            let weight = if begin < 0.0 { 0.0 } else { self.weight(node) };
            if begin < 0.0 || weight == 0.0 && !self.front.draws_outside() {
                continue;
            }
            let mut before = Sums::default();
            for (resolution, grade) in (0..).zip(hierarchy.grades(node)) {
                let pages = hierarchy.pages(node, resolution).iter();
                let bytes: f64 = pages.map(|&page| hierarchy.page_bytes()[page as usize] as f64).sum();
                let now = [grade.triangle_count as f64, 1.0, before[2] + bytes];
                histogram.add(begin, now, before);
                begin = begin.min(weight * grade.error);
                before = now;
                if weight == 0.0 || begin <= tolerance {
                    begin = -1.0;
                    break;
                }
            }
            if begin >= 0.0 && !hierarchy.children(node).is_empty() {
                histogram.add(begin, Sums::default(), before);
                hierarchy.children(node).iter().for_each(|&child| begins[child as usize] = begin);
            }
        }
        histogram.sum_up()
    }
}
