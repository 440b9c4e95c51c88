//! The order of a file: roots so that those near each other lie together; arcs and corners as their first root uses them.

use super::CLUSTER_ROOTS;
use crate::{
    error::{Error, Result},
    model::{Model, RootRecord},
    sections::MAX_CLUSTER_ROOTS,
};

const UNSET: u32 = u32::MAX;

/// The order of everything, and the numbers that follow from it.
pub(super) struct Order {
    /// How many roots a cluster has; the last one may have fewer.
    pub cluster_roots: usize,
    /// Model root of each file root.
    pub roots: Vec<u32>,
    /// Model arc of each file arc, and the inverse.
    pub arcs: Vec<u32>,
    pub arc_ids: Vec<u32>,
    /// Model corner of each file corner, and the inverse.
    pub corners: Vec<u32>,
    pub corner_ids: Vec<u32>,
}

impl Order {
    /// Orders a checked model: whatever a cluster of roots is the first to use gets a run of numbers.
    pub(super) fn new(model: &Model) -> Result<Self> {
        let count = model.roots.len();
        let cluster_roots = if count <= MAX_CLUSTER_ROOTS {
            count.max(1)
        } else {
            count.isqrt().clamp(CLUSTER_ROOTS[0], CLUSTER_ROOTS[1])
        };
        let roots = by_halving(model, cluster_roots);
        let (mut arcs, mut arc_ids) = (Vec::new(), vec![UNSET; model.arcs.len()]);
        for &root in &roots {
            for half_arc in model.roots[root as usize].loops.iter().flatten() {
                number(half_arc.arc, &mut arcs, &mut arc_ids);
            }
        }
        let (mut corners, mut corner_ids) = (Vec::new(), vec![UNSET; model.corners.len()]);
        for &arc in &arcs {
            model.arcs[arc as usize].ends.iter().for_each(|&corner| number(corner, &mut corners, &mut corner_ids));
        }
        match corner_ids.iter().position(|&id| id == UNSET) {
            Some(corner) => Err(Error::model(format!("corner {corner} is the end of no arc"))),
            None => Ok(Self { cluster_roots, roots, arcs, arc_ids, corners, corner_ids }),
        }
    }
}

/// Gives a thing the next number if it has none.
fn number(thing: u32, order: &mut Vec<u32>, ids: &mut [u32]) {
    let id = &mut ids[thing as usize];
    if *id == UNSET {
        *id = order.len() as u32;
        order.push(thing);
    }
}

/// Roots in an order in which neighbours in space are mostly near each other: halves of halves, cut where few arcs are.
fn by_halving(model: &Model, cluster_roots: usize) -> Vec<u32> {
    let centre = |root: &RootRecord| [0, 1, 2].map(|axis| root.bounds[0][axis] * 0.5 + root.bounds[1][axis] * 0.5);
    let mut users: Vec<Vec<u32>> = vec![Vec::new(); model.arcs.len()];
    for (number, root) in (0..).zip(&model.roots) {
        root.loops.iter().flatten().for_each(|half_arc| users[half_arc.arc as usize].push(number));
    }
    let mut neighbours = vec![Vec::new(); model.roots.len()];
    for users in &users {
        if let &[a, b] = users.as_slice() {
            neighbours[a as usize].push(b);
            neighbours[b as usize].push(a);
        }
    }
    let mut halving = Halving {
        centres: model.roots.iter().map(centre).collect(),
        neighbours,
        cluster_roots,
        places: vec![UNSET; model.roots.len()],
    };
    let mut roots: Vec<u32> = (0..model.roots.len() as u32).collect();
    halving.sort(&mut roots, None, None);
    roots
}

/// Orders roots by halving sets of them. Halves are made of whole clusters, so that the boxes of clusters are small; cut where
/// the fewest arcs join both sides, since roots that share an arc are read together; and the half nearer to what comes before
/// comes first.
struct Halving {
    /// Centre of each root's box.
    centres: Vec<[f64; 3]>,
    /// Per root the roots beyond its arcs.
    neighbours: Vec<Vec<u32>>,
    cluster_roots: usize,
    /// Places of the roots of the set that is being cut; [`UNSET`] for all others.
    places: Vec<u32>,
}

impl Halving {
    /// Orders a set of roots that lies between two points.
    fn sort(&mut self, roots: &mut [u32], before: Option<[f64; 3]>, after: Option<[f64; 3]>) {
        if roots.len() < 2 {
            return;
        }
        let (axis, size) = self.fewest_arcs(roots);
        self.sort_along(axis, roots);
        let [first, second] = [self.mean(&roots[..size]), self.mean(&roots[size..])];
        let way = |first, second| {
            before.map_or(0.0, |point| distance(point, first)) + after.map_or(0.0, |point| distance(point, second))
        };
        let size = if way(second, first) < way(first, second) {
            roots.reverse();
            roots.len() - size
        } else {
            size
        };
        let (left, right) = roots.split_at_mut(size);
        self.sort(left, before, Some(self.mean(right)));
        let last = left.last().map(|&root| self.centres[root as usize]);
        self.sort(right, last, after);
    }

    /// The axis across which to cut a set, and how many roots to leave on the lower side.
    fn fewest_arcs(&mut self, roots: &mut [u32]) -> (usize, usize) {
        let sizes = half_sizes(roots.len(), self.cluster_roots);
        let mut best = (i64::MAX, 0, sizes.start);
        for axis in 0..3 {
            self.sort_along(axis, roots);
            (0..).zip(roots.iter()).for_each(|(place, &root)| self.places[root as usize] = place);
            let mut cut = 0;
            for (place, &root) in (0..).zip(roots.iter()) {
                for &neighbour in &self.neighbours[root as usize] {
                    let other = self.places[neighbour as usize];
                    cut += if other == UNSET || other == place {
                        0
                    } else if other > place {
                        1
                    } else {
                        -1
                    };
                }
                let size = place as usize + 1;
                if sizes.contains(size) && cut < best.0 {
                    best = (cut, axis, size);
                }
            }
        }
        roots.iter().for_each(|&root| self.places[root as usize] = UNSET);
        (best.1, best.2)
    }

    fn sort_along(&self, axis: usize, roots: &mut [u32]) {
        let at = |root: u32| self.centres[root as usize][axis];
        roots.sort_unstable_by(|&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
    }

    fn mean(&self, roots: &[u32]) -> [f64; 3] {
        let sum = roots.iter().fold([0.0; 3], |sum: [f64; 3], &root| {
            let centre = self.centres[root as usize];
            [0, 1, 2].map(|axis| sum[axis] + centre[axis])
        });
        sum.map(|x| x / roots.len() as f64)
    }
}

/// How many of `count` roots, at least two, the lower half may have: whole clusters, 35 to 65 percent if there are such
/// numbers; half of them within a cluster.
fn half_sizes(count: usize, cluster_roots: usize) -> Sizes {
    if count <= cluster_roots {
        return Sizes { start: count / 2, last: count / 2, step: 1 };
    }
    let (step, largest) = (cluster_roots, (count - 1) / cluster_roots * cluster_roots);
    let (start, last) = ((count * 7).div_ceil(20 * step) * step, count * 13 / (20 * step) * step);
    if start <= last && last <= largest {
        return Sizes { start, last, step };
    }
    let middle = (count / 2).next_multiple_of(step).min(largest);
    Sizes { start: middle, last: middle, step }
}

/// The numbers from `start` to `last` by `step`.
struct Sizes {
    start: usize,
    last: usize,
    step: usize,
}

impl Sizes {
    fn contains(&self, size: usize) -> bool {
        (self.start..=self.last).contains(&size) && (size - self.start).is_multiple_of(self.step)
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|axis| (a[axis] - b[axis]) * (a[axis] - b[axis])).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_whole_clusters_and_never_empty() {
        for count in 2..2000 {
            let sizes = half_sizes(count, 24);
            assert!(0 < sizes.start && sizes.start <= sizes.last && sizes.last < count, "{count}");
            assert!(count <= 24 || sizes.start.is_multiple_of(24));
        }
    }

    #[test]
    fn clusters_are_cut_from_a_grid_without_gaps_along_few_arcs() {
        // A sheet of 48 x 36 roots, in a scattered order.
        let place = |root: u32| [root * 7 % 1728 % 48, root * 7 % 1728 / 48];
        let root_at = |x: u32, y: u32| (0..1728).find(|&root| place(root) == [x, y]);
        let mut neighbours = vec![Vec::new(); 1728];
        for root in 0..1728 {
            let [x, y] = place(root);
            let beside = [(x + 1, y), (x.wrapping_sub(1), y), (x, y + 1), (x, y.wrapping_sub(1))];
            neighbours[root as usize].extend(beside.into_iter().filter_map(|(x, y)| root_at(x, y)));
        }
        let centres = (0..1728).map(|root| [f64::from(place(root)[0]), f64::from(place(root)[1]), 0.0]).collect();
        let mut halving = Halving { centres, neighbours, cluster_roots: 24, places: vec![UNSET; 1728] };
        let mut roots: Vec<u32> = (0..1728).collect();
        halving.sort(&mut roots, None, None);
        let mut outlines = 0;
        for cluster in roots.chunks(24) {
            let beside = cluster.iter().flat_map(|&root| &halving.neighbours[root as usize]);
            outlines += beside.filter(|root| !cluster.contains(root)).count();
        }
        // A cluster of 24 roots as 4 x 6 has an outline of 20.
        assert!(outlines <= 72 * 20, "{outlines}");
        roots.sort_unstable();
        assert!(roots.into_iter().eq(0..1728));
    }
}
