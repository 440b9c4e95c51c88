//! The verifier's own distance measurement: shares no code with `certify`, on purpose.
//!
//! The largest distance from a set of triangles to a surface is enclosed by branch and bound: corners give lower bounds; a
//! piece whose corners all see one triangle T of the surface within d lies within d (distance to a convex set is convex);
//! what stays open is quartered at its edge midpoints.

use glam::DVec3;
use rayon::prelude::*;

/// A triangle by its corners.
pub type Corners = [DVec3; 3];

/// A bounding-box tree over triangles, by median splits, four triangles a leaf.
#[derive(Debug)]
pub struct BoxTree {
    boxes: Vec<[DVec3; 2]>,
    /// Where the right child is; the left one follows its parent. 0 at leaves.
    right: Vec<u32>,
    /// The range of `order` below each node.
    ranges: Vec<[u32; 2]>,
    triangles: Vec<Corners>,
    order: Vec<u32>,
}

impl BoxTree {
    /// Builds the tree; O(n log n).
    pub fn new(triangles: &[Corners]) -> Self {
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let mut tree = Self { boxes: vec![], right: vec![], ranges: vec![], triangles: vec![], order: vec![] };
        if !order.is_empty() {
            let count = order.len();
            tree.grow(triangles, &mut order, 0, count);
        }
        tree.triangles = order.iter().map(|&t| triangles[t as usize]).collect();
        tree.order = order;
        tree
    }

    fn grow(&mut self, triangles: &[Corners], order: &mut [u32], begin: usize, end: usize) {
        let node = self.boxes.len();
        let mut hull = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let mut centres = hull;
        for &t in &order[begin..end] {
            let corners = triangles[t as usize];
            for p in corners {
                hull = [hull[0].min(p), hull[1].max(p)];
            }
            let c = (corners[0] + corners[1] + corners[2]) / 3.0;
            centres = [centres[0].min(c), centres[1].max(c)];
        }
        self.boxes.push(hull);
        self.right.push(0);
        self.ranges.push([begin as u32, end as u32]);
        if end - begin <= 4 {
            return;
        }
        let extent = centres[1] - centres[0];
        let axis = (0..3).fold(0, |best, k| if extent[k] > extent[best] { k } else { best });
        let middle = (end - begin) / 2;
        let centre = |t: u32| triangles[t as usize].iter().map(|p| p[axis]).sum::<f64>();
        order[begin..end].select_nth_unstable_by(middle, |&a, &b| centre(a).total_cmp(&centre(b)));
        self.grow(triangles, order, begin, begin + middle);
        self.right[node] = self.boxes.len() as u32;
        self.grow(triangles, order, begin + middle, end);
    }

    /// The nearest triangle to a point, as (distance, slot, original index); `None` for an empty tree. `hint` is a slot that
    /// is probably near.
    pub fn nearest(&self, p: DVec3, hint: u32) -> Option<(f64, u32, u32)> {
        let mut slot = (hint as usize).min(self.triangles.len().checked_sub(1)?);
        let mut best = distance_squared(p, &self.triangles[slot]);
        let mut stack = vec![0u32];
        while let Some(node) = stack.pop() {
            let node = node as usize;
            if self.box_distance(node, p) >= best {
                continue;
            }
            if self.right[node] == 0 {
                let [begin, end] = self.ranges[node];
                for candidate in begin as usize..end as usize {
                    let d = distance_squared(p, &self.triangles[candidate]);
                    if d < best {
                        (best, slot) = (d, candidate);
                    }
                }
            } else {
                let (left, right) = (node as u32 + 1, self.right[node]);
                let left_first = self.box_distance(left as usize, p) <= self.box_distance(right as usize, p);
                stack.extend(if left_first { [right, left] } else { [left, right] });
            }
        }
        Some((best.sqrt(), slot as u32, self.order[slot]))
    }

    fn box_distance(&self, node: usize, p: DVec3) -> f64 {
        let [low, high] = self.boxes[node];
        (low - p).max(p - high).max(DVec3::ZERO).length_squared()
    }
}

/// Squared distance from a point to a triangle, degenerate ones included: the plane's foot point where it lies inside,
/// else the nearest edge.
fn distance_squared(p: DVec3, [a, b, c]: &Corners) -> f64 {
    let (a, b, c) = (*a, *b, *c);
    let normal = (b - a).cross(c - a);
    let area = normal.length_squared();
    if area > 0.0 {
        let inside = |u: DVec3, v: DVec3| (v - u).cross(p - u).dot(normal) >= 0.0;
        if inside(a, b) && inside(b, c) && inside(c, a) {
            let height = (p - a).dot(normal);
            return height * height / area;
        }
    }
    let edge = |u: DVec3, v: DVec3| {
        let e = v - u;
        let l = e.length_squared();
        let t = if l > 0.0 { ((p - u).dot(e) / l).clamp(0.0, 1.0) } else { 0.0 };
        (u + e * t).distance_squared(p)
    };
    edge(a, b).min(edge(b, c)).min(edge(c, a))
}

/// Encloses the largest distance from some triangles to a surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Enclosure {
    /// A distance that occurs.
    pub lower: f64,
    /// No larger distance occurs.
    pub upper: f64,
}

/// For each group of `pieces`, encloses the largest distance to the surface in `tree` within `relative_gap`, or down to
/// `floor`, or until many pieces have been split (then `upper` stays sound but loose). Once no distance can be above the
/// group's `claim`, only some more work is spent on how far below it they are: surfaces that lie in each other have
/// distances of rounding errors, whose enclosure would take for ever and tell nothing.
pub fn largest_distances(
    groups: &[Vec<Corners>],
    tree: &BoxTree,
    relative_gap: f64,
    floor: f64,
    claims: &[f64],
) -> Vec<Enclosure> {
    let claims = claims.par_iter().chain(rayon::iter::repeat_n(&0.0, groups.len().saturating_sub(claims.len())));
    let pairs = groups.par_iter().zip(claims);
    pairs.map(|(pieces, &claim)| largest_distance(pieces, tree, relative_gap, floor, claim)).collect()
}

/// Pieces split where a claim is in doubt.
const PIECE_LIMIT: usize = 2_000_000;
/// Pieces split, for each that there was, once the claim is proven.
const PROVEN_PIECE_FACTOR: usize = 8;
const PROVEN_PIECE_LIMIT: usize = 2_000;

fn largest_distance(pieces: &[Corners], tree: &BoxTree, relative_gap: f64, floor: f64, claim: f64) -> Enclosure {
    let proven_limit = PROVEN_PIECE_LIMIT + PROVEN_PIECE_FACTOR * pieces.len();
    let mut hint = 0;
    let mut lower = 0.0f64;
    // (upper bound, piece); first without splitting anything, so that the lower bound is good before it prunes.
    let mut open = std::collections::BinaryHeap::new();
    let bound = |piece: &Corners, hint: &mut u32, lower: &mut f64| -> f64 {
        let mut upper = f64::INFINITY;
        for &p in piece {
            let Some((d, slot, _)) = tree.nearest(p, *hint) else { return f64::INFINITY };
            *hint = slot;
            *lower = lower.max(d);
            let seen = tree.triangles[slot as usize];
            upper = upper.min(piece.iter().map(|&q| distance_squared(q, &seen)).fold(0.0, f64::max).sqrt());
        }
        upper
    };
    for piece in pieces {
        let upper = bound(piece, &mut hint, &mut lower);
        open.push(Open { upper, piece: *piece });
    }
    let mut split = 0;
    while let Some(Open { upper, piece: [a, b, c] }) = open.pop() {
        let limit = if upper <= claim { proven_limit } else { PIECE_LIMIT };
        if upper <= (lower * (1.0 + relative_gap)).max(floor) || split > limit {
            return Enclosure { lower, upper: upper.max(lower) };
        }
        split += 1;
        let (ab, bc, ca) = ((a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5);
        for quarter in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            let quarter_upper = bound(&quarter, &mut hint, &mut lower).min(upper);
            open.push(Open { upper: quarter_upper, piece: quarter });
        }
    }
    Enclosure { lower, upper: lower }
}

/// A piece whose distance is not settled, ordered by its upper bound.
struct Open {
    upper: f64,
    piece: Corners,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Open {}
impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Open {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.upper.total_cmp(&other.upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(n: i32, height: impl Fn(f64, f64) -> f64) -> Vec<Corners> {
        let at = |i: i32, j: i32| {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            DVec3::new(x, y, height(x, y))
        };
        (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
            .collect()
    }

    #[test]
    fn a_lifted_sheet_is_as_far_as_it_was_lifted() {
        let tree = BoxTree::new(&sheet(7, |_, _| 0.0));
        let found = largest_distances(&[sheet(5, |_, _| 0.25), vec![]], &tree, 0.01, 0.0, &[]);
        assert!(found[0].lower <= 0.25 + 1e-12 && found[0].upper >= 0.25 - 1e-12 && found[0].upper <= 0.2526);
        assert_eq!(found[1], Enclosure::default());
    }

    #[test]
    fn a_peak_between_vertices_is_found() {
        // A coarse roof over a plane that has a hole in its middle: the farthest point is inside a triangle.
        let plane: Vec<Corners> = sheet(8, |_, _| 0.0)
            .into_iter()
            .filter(|t| t.iter().any(|p| (*p - DVec3::new(0.5, 0.5, 0.0)).length() > 0.3))
            .collect();
        let tree = BoxTree::new(&plane);
        let whole = [DVec3::new(-1.0, -1.0, 0.0), DVec3::new(3.0, -1.0, 0.0), DVec3::new(-1.0, 3.0, 0.0)];
        let inside = [DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 0.0, 0.0), DVec3::new(0.0, 1.0, 0.0)];
        let found = largest_distances(&[vec![whole], vec![inside]], &tree, 0.01, 0.0, &[]);
        assert!(found[0].lower > 1.9);
        assert!(found[1].lower > 0.15 && found[1].upper < found[1].lower * 1.011);
    }

    #[test]
    fn a_proven_claim_ends_the_search_among_surfaces_that_lie_in_each_other() {
        // Coplanar, but no triangle of one lies in one of the other.
        let tree = BoxTree::new(&sheet(60, |_, _| 0.0));
        let found = largest_distances(&[sheet(1, |_, _| 0.0)], &tree, 0.01, 1e-12, &[0.001]);
        assert!(found[0].lower <= 1e-12 && found[0].upper <= 0.001);
    }
}
