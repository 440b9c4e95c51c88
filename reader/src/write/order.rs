//! The order of roots in a file: neighbours in space lie together, whatever pieces they come from.

use super::piece::NO_ROOT;
use crate::format::clusters::MAX_CLUSTER_ROOTS;

/// The fewest and most roots of a cluster in files of several clusters; in between, the square root of the number of
/// roots. With more, a query for a small volume would read more of the index for other roots; fewer would make CLUSTERS
/// longer, which everybody reads.
const CLUSTER_ROOTS: [usize; 2] = [12, 24];
const _: () = assert!(CLUSTER_ROOTS[1] <= MAX_CLUSTER_ROOTS);

/// No root, no number.
pub(super) const UNSET: u32 = u32::MAX;

/// The most roots in a cluster, given the number of roots in the file.
pub(super) fn cluster_roots(root_count: usize) -> usize {
    if root_count <= MAX_CLUSTER_ROOTS {
        root_count.max(1)
    } else {
        root_count.isqrt().clamp(CLUSTER_ROOTS[0], CLUSTER_ROOTS[1])
    }
}

/// Orders roots from the top: first those without a parent, then the children of the first one, those of the second
/// one, and so on. Siblings are ordered by recursive halving, so that neighbours in space are mostly near each other.
/// `centres` are those of the roots' boxes; `neighbours` are pairs of siblings that share an arc.
pub(super) fn from_the_top(
    centres: Vec<[f64; 3]>,
    pairs: &[[u32; 2]],
    parents: &[u32],
    cluster_roots: usize,
) -> Vec<u32> {
    let count = centres.len();
    let mut neighbours = vec![Vec::new(); count];
    for &[a, b] in pairs {
        neighbours[a as usize].push(b);
        neighbours[b as usize].push(a);
    }
    let mut children = vec![Vec::new(); count];
    let mut order = Vec::with_capacity(count);
    for (root, &parent) in (0..).zip(parents) {
        if parent == NO_ROOT { order.push(root) } else { children[parent as usize].push(root) }
    }
    let mut halving = Halving { centres, neighbours, cluster_roots, places: vec![UNSET; count] };
    halving.sort(&mut order, None, None);
    let mut next = 0;
    while next < order.len() {
        let mut siblings = std::mem::take(&mut children[order[next] as usize]);
        let before = order.last().map(|&root| halving.centres[root as usize]);
        halving.sort(&mut siblings, before, None);
        order.extend(siblings);
        next += 1;
    }
    order
}

/// Orders roots by halving sets of them. Halves consist of whole clusters, so that the boxes of clusters are small. A
/// set is cut where the fewest arcs join both sides, because roots that share an arc are read together. The half nearer
/// to what precedes the set comes first.
struct Halving {
    /// Centre of each root's box.
    centres: Vec<[f64; 3]>,
    /// For each root the roots on the other sides of its arcs.
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

/// The sizes that the lower half of `count` roots, at least two, may have: whole clusters, 35 to 65 percent if
/// possible; within a cluster half of the roots.
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
