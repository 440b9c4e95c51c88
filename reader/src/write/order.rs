//! The order of a file: roots so that those near each other lie together; arcs and corners as their first root uses them.

use std::collections::BTreeMap;

use super::{Share, Shares};
use crate::{
    error::{Error, Result},
    model::{Model, RootRecord},
    sections::MAX_CLUSTER_ROOTS,
};

/// Fewest and most roots of a cluster where there are several clusters; in between it is the root of the number of roots. More
/// would make a region read more of the index for other roots; fewer would cost more in CLUSTERS, which everybody reads.
const CLUSTER_ROOTS: [usize; 2] = [12, 24];
const _: () = assert!(CLUSTER_ROOTS[1] <= MAX_CLUSTER_ROOTS);

const UNSET: u32 = u32::MAX;

/// Which arc or corner of a file: 2 n for number n of the same piece, 2 n + 1 for number n of those that are shared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Place(pub u32);

impl Place {
    const UNSET: Self = Self(UNSET);

    /// The number within the piece.
    pub fn own(self) -> Option<u32> {
        (self.0.is_multiple_of(2)).then_some(self.0 / 2)
    }

    /// The number among all that are shared.
    pub fn shared(self) -> Option<u32> {
        (!self.0.is_multiple_of(2)).then_some(self.0 / 2)
    }

    /// What has this number among all that are shared.
    pub fn of_shared(number: u32) -> Self {
        Self(number << 1 | 1)
    }
}

/// The order of a piece, and the numbers that follow from it.
pub(super) struct Order {
    /// How many roots a cluster has; the last one may have fewer.
    pub cluster_roots: usize,
    /// Model roots in the order of the piece.
    pub roots: Vec<u32>,
    pub arcs: Numbers,
    pub corners: Numbers,
}

/// Arcs or corners by number.
pub(super) struct Numbers {
    /// Those of the model that the piece is the first to have, in their order.
    pub things: Vec<u32>,
    /// Of each of the model.
    pub places: Vec<Place>,
    shares: Vec<Option<Share>>,
    /// Of what is shared and comes first: several of a model's may be one.
    shared: BTreeMap<u32, Place>,
}

impl Numbers {
    fn new(count: usize, shares: &[Option<Share>]) -> Self {
        let of = |thing: usize| shares.get(thing).copied().flatten();
        let shares: Vec<Option<Share>> = (0..count).map(of).collect();
        let elsewhere =
            |share: &Option<Share>| share.filter(|share| !share.is_first).map(|share| Place::of_shared(share.number));
        let places = shares.iter().map(|share| elsewhere(share).unwrap_or(Place::UNSET)).collect();
        Self { things: Vec::new(), places, shares, shared: BTreeMap::new() }
    }

    /// Gives a thing the next number if it has none.
    fn number(&mut self, thing: u32) {
        if self.places[thing as usize] != Place::UNSET {
            return;
        }
        let next = Place(2 * self.things.len() as u32);
        let place = match self.shares[thing as usize] {
            Some(share) => *self.shared.entry(share.number).or_insert(next),
            None => next,
        };
        if place == next {
            self.things.push(thing);
        }
        self.places[thing as usize] = place;
    }

    /// Number among all that are shared, and own number, of what the piece is the first to have.
    pub fn firsts(&self) -> Vec<[u32; 2]> {
        let shares = (0..).zip(&self.things).map(|(own, &thing)| (own, self.shares[thing as usize]));
        shares.filter_map(|(own, share)| Some([share?.number, own])).collect()
    }
}

impl Order {
    /// Orders a checked model: whatever a cluster of roots is the first to use gets a run of numbers.
    pub(super) fn new(model: &Model, shares: &Shares, root_count: u64) -> Result<Self> {
        let most_roots = cluster_roots(root_count);
        // In a piece of several, clusters of about the same size: the last ones of all pieces would be many small ones.
        let clusters = model.roots.len().div_ceil(most_roots).max(1);
        let is_alone = model.roots.len() as u64 == root_count;
        let cluster_roots = if is_alone { most_roots } else { model.roots.len().div_ceil(clusters).max(1) };
        let roots = by_halving(model, cluster_roots);
        let mut arcs = Numbers::new(model.arcs.len(), &shares.arcs);
        for &root in &roots {
            model.roots[root as usize].loops.iter().flatten().for_each(|half_arc| arcs.number(half_arc.arc));
        }
        let mut corners = Numbers::new(model.corners.len(), &shares.corners);
        for &arc in &arcs.things {
            model.arcs[arc as usize].ends.iter().for_each(|&corner| corners.number(corner));
        }
        match corners.places.iter().position(|&place| place == Place::UNSET) {
            Some(corner) => Err(Error::model(format!("corner {corner} is the end of no arc"))),
            None => Ok(Self { cluster_roots, roots, arcs, corners }),
        }
    }
}

/// How many roots a cluster of a file has at most that has so many roots.
fn cluster_roots(root_count: u64) -> usize {
    let root_count = usize::try_from(root_count).unwrap_or(usize::MAX);
    if root_count <= MAX_CLUSTER_ROOTS {
        root_count.max(1)
    } else {
        root_count.isqrt().clamp(CLUSTER_ROOTS[0], CLUSTER_ROOTS[1])
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
