//! A tree of boxes over triangles, with four children per node, and the distance from a point to a triangle. The
//! builder has its own (`stage::certify::bvh`); see [`super`].

use super::nodes::{BoxNode, SLACK, Slabs};
use glam::DVec3;
use std::cmp::Ordering;

/// The most triangles in a leaf.
const LEAF: usize = 4;
/// Ranges of more triangles than this are built in parallel.
const SIDE_BY_SIDE: usize = 1 << 15;
/// Covers the rounding of a squared distance to a box, and that of points farther away.
const BOX_ROUNDING: f64 = 1.0 + 4e-6;
/// Distances below this share of the tree's reach are rounding: no nearer triangle is looked for.
const ROUNDING: f64 = 1e-14;
/// Nodes that can wait: three at each of the 16 depths for 2^32 triangles, and the root.
const STACK: usize = 3 * 16 + 4;

type Hull = [[f32; 3]; 2];
const NOTHING: Hull = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// A box tree over the triangles of a mesh, split at medians. A *slot* is a triangle's index in the order of the tree:
/// neighbouring slots are neighbours in space.
#[derive(Debug)]
pub struct BoxTree<'a> {
    positions: &'a [DVec3],
    triangles: Vec<[u32; 3]>,
    order: Vec<u32>,
    /// For each slot, whether its triangle is a sliver.
    slivers: Vec<bool>,
    nodes: Vec<BoxNode>,
    /// One for each node, or none.
    slabs: Vec<Slabs>,
    origin: DVec3,
    per_reach: f64,
}

impl<'a> BoxTree<'a> {
    /// Builds the tree in O(n log n).
    pub fn new(positions: &'a [DVec3], triangles: &[[u32; 3]]) -> Self {
        let mut hull = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &p in triangles.iter().flatten().map(|&v| &positions[v as usize]) {
            hull = [hull[0].min(p), hull[1].max(p)];
        }
        let origin = (hull[0] + hull[1]) * 0.5;
        let reach = (hull[1] - origin).max_element();
        let per_reach = if reach > 0.0 && reach.is_finite() { reach.recip() } else { 1.0 };
        let mut tree = Self {
            positions,
            triangles: vec![],
            order: vec![],
            slivers: vec![],
            nodes: vec![],
            slabs: vec![],
            origin,
            per_reach,
        };
        let mut order: Vec<u32> = (0..triangles.len() as u32).collect();
        let boxes: Vec<Hull> = triangles.iter().map(|t| tree.hull(t)).collect();
        if !order.is_empty() {
            grow(&boxes, &mut order, 0, &mut tree.nodes);
        }
        tree.triangles = order.iter().map(|&t| triangles[t as usize]).collect();
        tree.order = order;
        tree.slivers = (0..triangles.len() as u32).map(|slot| is_sliver(tree.corners(slot))).collect();
        tree.slabs = Slabs::of(&tree.nodes, &|slot| tree.corners(slot), &|p| tree.scaled(p));
        tree
    }

    fn scaled(&self, p: DVec3) -> [f32; 3] {
        ((p - self.origin) * self.per_reach).as_vec3().to_array()
    }

    fn hull(&self, triangle: &[u32; 3]) -> Hull {
        let mut hull = NOTHING;
        for p in triangle.map(|v| self.scaled(self.positions[v as usize])) {
            hull = join(&hull, &[p.map(|x| x - SLACK), p.map(|x| x + SLACK)]);
        }
        hull
    }

    /// Triangles in the order of the tree.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The number that the triangle in a slot had when the tree was built.
    pub fn original(&self, slot: u32) -> u32 {
        self.order[slot as usize]
    }

    /// Corners of the triangle in a slot.
    pub fn corners(&self, slot: u32) -> [DVec3; 3] {
        self.triangles[slot as usize].map(|v| self.positions[v as usize])
    }

    /// Squared distance to the triangle in a slot.
    pub fn distance_squared(&self, p: DVec3, slot: u32) -> f64 {
        let corners = self.corners(slot);
        if self.slivers[slot as usize] {
            sliver_distance_squared(p, corners)
        } else {
            plain_distance_squared(p, corners)
        }
    }

    /// The square of a distance that is rounding.
    pub(super) fn rounding(&self) -> f64 {
        (ROUNDING / self.per_reach).powi(2)
    }

    /// The triangle nearest to a point, as (distance, slot, original index); `None` for an empty tree. `hint` is a slot
    /// that is probably near.
    pub fn nearest(&self, p: DVec3, hint: u32) -> Option<(f64, u32, u32)> {
        let last = self.triangles.len().checked_sub(1)?;
        let (square, slot) = self.search(p, hint.min(last as u32), 0.0);
        Some((square.sqrt(), slot, self.order[slot as usize]))
    }

    /// As (squared distance, slot): any triangle within the squared distance `enough`, or the nearest if there is none.
    /// What is no farther than rounding is near enough.
    /// `hint` must be a slot.
    pub fn search(&self, p: DVec3, hint: u32, enough: f64) -> (f64, u32) {
        let mut slot = hint;
        let mut best = self.distance_squared(p, hint);
        let enough = enough.max(self.rounding());
        if best <= enough {
            return (best, slot);
        }
        let point = self.scaled(p);
        let square = self.per_reach * self.per_reach * BOX_ROUNDING;
        let mut limit = ((best * square) as f32).next_up();
        // (bound, node or first slot, triangles if a leaf)
        let mut stack = [(0.0f32, 0u32, 0u8); STACK];
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (bound, index, count) = stack[height];
            if bound >= limit {
                continue;
            }
            if count > 0 {
                for candidate in index..index + u32::from(count) {
                    let d = self.distance_squared(p, candidate);
                    if d < best {
                        (best, slot) = (d, candidate);
                        if best <= enough {
                            return (best, slot);
                        }
                        limit = ((best * square) as f32).next_up();
                    }
                }
                continue;
            }
            let node = &self.nodes[index as usize];
            let bounds = node.distances(point);
            let begin = height;
            for i in 0..4 {
                if bounds[i] < limit {
                    let across = self.slabs.get(index as usize).map_or(0.0, |slabs| slabs.distance(i, point));
                    if across >= limit {
                        continue;
                    }
                    // Keep the nearest on top.
                    let mut at = height;
                    while at > begin && stack[at - 1].0 < bounds[i] {
                        stack[at] = stack[at - 1];
                        at -= 1;
                    }
                    stack[at] = (bounds[i], node.child[i], node.count[i]);
                    height += 1;
                }
            }
        }
        (best, slot)
    }
}

fn join(a: &Hull, b: &Hull) -> Hull {
    [[0, 1, 2].map(|k| a[0][k].min(b[0][k])), [0, 1, 2].map(|k| a[1][k].max(b[1][k]))]
}

/// Splits a range at the median along the longest axis of its middles.
fn split<'o>(boxes: &[Hull], order: &'o mut [u32]) -> [&'o mut [u32]; 2] {
    let middle = |t: u32, k: usize| boxes[t as usize][0][k] + boxes[t as usize][1][k];
    let mut extent = NOTHING;
    for &t in &*order {
        let p = [0, 1, 2].map(|k| middle(t, k));
        extent = join(&extent, &[p, p]);
    }
    let length = |k: usize| extent[1][k] - extent[0][k];
    let axis = (1..3).fold(0, |best, k| if length(k) > length(best) { k } else { best });
    let half = order.len() / 2;
    order.select_nth_unstable_by(half, |&a, &b| middle(a, axis).total_cmp(&middle(b, axis)).then(a.cmp(&b)));
    order.split_at_mut(half).into()
}

/// Adds the nodes over a range of `order` that begins at slot `first` of the tree. Returns its box.
fn grow(boxes: &[Hull], order: &mut [u32], first: u32, nodes: &mut Vec<BoxNode>) -> Hull {
    let index = nodes.len();
    nodes.push(BoxNode {
        low: [[f32::INFINITY; 4]; 3],
        high: [[f32::NEG_INFINITY; 4]; 3],
        child: [0; 4],
        count: [0; 4],
    });
    let side_by_side = order.len() > SIDE_BY_SIDE;
    let quarters: Vec<&mut [u32]> = if order.len() <= LEAF {
        vec![order]
    } else if side_by_side {
        let [left, right] = split(boxes, order);
        let (left, right) = rayon::join(|| split(boxes, left), || split(boxes, right));
        left.into_iter().chain(right).collect()
    } else {
        split(boxes, order).into_iter().flat_map(|half| split(boxes, half)).collect()
    };
    let mut begin = first;
    let with_begin: Vec<(u32, &mut [u32])> = quarters
        .into_iter()
        .map(|quarter| {
            let range = (begin, quarter);
            begin += range.1.len() as u32;
            range
        })
        .collect();
    let mut hull = NOTHING;
    let mut attach = |nodes: &mut Vec<BoxNode>, i: usize, child: u32, count: u8, below: Hull| {
        for k in 0..3 {
            (nodes[index].low[k][i], nodes[index].high[k][i]) = (below[0][k], below[1][k]);
        }
        (nodes[index].child[i], nodes[index].count[i]) = (child, count);
        hull = join(&hull, &below);
    };
    if side_by_side {
        use rayon::prelude::*;
        let grown: Vec<(Vec<BoxNode>, Hull)> = with_begin
            .into_par_iter()
            .map(|(begin, quarter)| {
                let mut nodes = vec![];
                let hull = grow(boxes, quarter, begin, &mut nodes);
                (nodes, hull)
            })
            .collect();
        for (i, (below, hull)) in grown.into_iter().enumerate() {
            let shift = nodes.len() as u32;
            attach(nodes, i, shift, 0, hull);
            nodes.extend(below.into_iter().map(|mut node| {
                for k in 0..4 {
                    if node.count[k] == 0 {
                        node.child[k] += shift;
                    }
                }
                node
            }));
        }
    } else {
        for (i, (begin, quarter)) in with_begin.into_iter().enumerate() {
            if quarter.len() <= LEAF {
                let below = quarter.iter().fold(NOTHING, |hull, &t| join(&hull, &boxes[t as usize]));
                attach(nodes, i, begin, quarter.len() as u8, below);
            } else {
                let child = nodes.len() as u32;
                let below = grow(boxes, quarter, begin, nodes);
                attach(nodes, i, child, 0, below);
            }
        }
    }
    hull
}

/// Triangles whose doubled area, squared, is below this share of the fourth power of their longest edge are slivers:
/// computed from two of their edges, neither the foot point in their plane nor the side of an edge on which it lies is
/// reliable.
const SLIVER: f64 = 1e-4;

fn is_sliver([a, b, c]: [DVec3; 3]) -> bool {
    let longest = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    // Also true if that is not a number.
    (b - a).cross(c - a).length_squared().partial_cmp(&(SLIVER * longest * longest)) != Some(Ordering::Greater)
}

/// Squared distance from a point to a triangle, degenerate ones included. It is the distance to some point of the
/// triangle, so it is never too small.
#[cfg(test)]
fn distance_squared(p: DVec3, corners: [DVec3; 3]) -> f64 {
    if is_sliver(corners) { sliver_distance_squared(p, corners) } else { plain_distance_squared(p, corners) }
}

/// Uses a plane basis that begins with the longest edge, so that the height keeps its digits however small it is.
fn sliver_distance_squared(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let edge = |u: DVec3, v: DVec3| {
        let e = v - u;
        let l = e.length_squared();
        let t = if l > 0.0 { ((p - u).dot(e) / l).clamp(0.0, 1.0) } else { 0.0 };
        (u + e * t).distance_squared(p)
    };
    let at_edges = edge(a, b).min(edge(b, c)).min(edge(c, a));
    let turns = [(a, b, c), (b, c, a), (c, a, b)];
    let longest = turns.into_iter().max_by(|s, t| s.0.distance_squared(s.1).total_cmp(&t.0.distance_squared(t.1)));
    let Some((u, v, w)) = longest else { return at_edges };
    let length = u.distance(v);
    let along = (v - u) / length;
    let apex = (w - u).dot(along);
    let height = (w - u) - along * apex;
    let height = height - along * height.dot(along);
    let (high, q) = (height.length(), p - u);
    let across = height / high;
    let (x, y) = (q.dot(along), q.dot(across));
    // No comparison holds if a side is a point.
    let is_above = y > 0.0 && high * x >= apex * y && high * (length - x) >= (length - apex) * y;
    if is_above { at_edges.min((q - along * x - across * y).length_squared()) } else { at_edges }
}

/// By Voronoi regions (Ericson, "Real-Time Collision Detection", section 5.1.5), for triangles that are not slivers.
fn plain_distance_squared(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return (ap - ab * (d1 / (d1 - d3))).length_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return (ap - ac * (d2 / (d2 - d6))).length_squared();
    }
    let va = d3 * d6 - d5 * d4;
    let (e, f) = (d4 - d3, d5 - d6);
    if va <= 0.0 && e >= 0.0 && f >= 0.0 && e + f > 0.0 {
        return (bp - (c - b) * (e / (e + f))).length_squared();
    }
    let area = va + vb + vc;
    (ap - ab * (vb / area) - ac * (vc / area)).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fixed sequence in [-1, 1).
    fn noise(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn point(state: &mut u64) -> DVec3 {
        DVec3::new(noise(state), noise(state), noise(state))
    }

    #[test]
    fn the_tree_finds_what_a_search_of_every_triangle_finds() {
        let mut state = 3;
        let positions: Vec<DVec3> = (0..3000).map(|_| point(&mut state) + DVec3::splat(1e4)).collect();
        for count in [1, 4, 5, 17, 700] {
            let triangles: Vec<[u32; 3]> = (0..count).map(|t| [t, t + 1, (t * 7 + 5) % 3000]).collect();
            let tree = BoxTree::new(&positions, &triangles);
            for i in 0..200 {
                let p = point(&mut state) * if i % 2 == 0 { 1.2 } else { 40.0 } + DVec3::splat(1e4);
                let brute = triangles
                    .iter()
                    .map(|t| distance_squared(p, t.map(|v| positions[v as usize])))
                    .fold(f64::INFINITY, f64::min);
                let (d, slot, original) = tree.nearest(p, i).expect("not empty");
                assert_eq!(d, brute.sqrt());
                assert_eq!(tree.triangles()[slot as usize], triangles[original as usize]);
                let enough = brute * 2.0;
                assert!(tree.search(p, 0, enough).0 <= enough);
            }
        }
        assert_eq!(BoxTree::new(&positions, &[]).nearest(DVec3::ZERO, 0), None);
    }

    #[test]
    fn many_triangles_are_built_in_parallel_into_one_tree() {
        let side = 200u32;
        let positions: Vec<DVec3> =
            (0..side * side).map(|i| DVec3::new(f64::from(i % side), f64::from(i / side), 0.0)).collect();
        let triangles: Vec<[u32; 3]> = (0..side * (side - 1))
            .filter(|i| i % side != side - 1)
            .flat_map(|i| [[i, i + 1, i + side], [i + 1, i + side + 1, i + side]])
            .collect();
        assert!(triangles.len() > SIDE_BY_SIDE * 2);
        let tree = BoxTree::new(&positions, &triangles);
        for i in 0..500 {
            let p = DVec3::new(f64::from(i) * 0.39, f64::from(i % 37) * 5.3, 3.0);
            let (d, ..) = tree.nearest(p, 0).expect("not empty");
            assert!((d - 3.0).abs() < 1e-12);
        }
    }

    #[test]
    fn points_of_slivers_are_at_distance_zero_however_thin_the_slivers_are() {
        let mut state = 11;
        for power in 0..15 {
            let height = 10f64.powi(-power);
            for shape in 0..40 {
                let [a, direction, other] = [(); 3].map(|()| point(&mut state));
                let b = a + direction;
                // Caps, needles, and shapes in between.
                let foot = [0.5, 0.0, 1.0, 0.2][shape % 4];
                let normal = direction.cross(other).normalize();
                let c = a.lerp(b, foot) + normal * height;
                for turned in [[a, b, c], [b, c, a], [c, a, b], [a, c, b]] {
                    let [u, v] = [0.3, 0.5].map(|share| share * (1.0 + noise(&mut state)) * 0.5);
                    let inside = turned[0] + (turned[1] - turned[0]) * u + (turned[2] - turned[0]) * v;
                    let off = direction.cross(normal).normalize() * 0.1;
                    let found = distance_squared(inside, turned).sqrt();
                    assert!(found < 1e-11, "{found} from {turned:?}");
                    assert!((distance_squared(inside + off, turned).sqrt() - 0.1).abs() < 1e-11);
                }
            }
        }
    }

    #[test]
    fn distances_to_degenerate_triangles_equal_those_to_their_edges() {
        let (a, b) = (DVec3::ZERO, DVec3::X);
        for (p, square) in
            [(DVec3::new(0.5, 2.0, 0.0), 4.0), (DVec3::new(3.0, 0.0, 0.0), 4.0), (DVec3::new(-1.0, 0.0, 0.0), 1.0)]
        {
            for triangle in [[a, b, b], [a, a, b], [a, b, a], [a, b, DVec3::new(0.25, 0.0, 0.0)]] {
                assert!((distance_squared(p, triangle) - square).abs() < 1e-12, "{p} {triangle:?}");
            }
        }
        assert_eq!(distance_squared(DVec3::Y, [a, a, a]), 1.0);
    }

    /// A cone of `count` triangles around its tip.
    fn cone(count: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let rim = (0..count).map(|i| {
            let angle = f64::from(i) / f64::from(count) * std::f64::consts::TAU;
            DVec3::new(angle.cos(), angle.sin(), -0.7)
        });
        let positions = std::iter::once(DVec3::ZERO).chain(rim).collect();
        (positions, (0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]).collect())
    }

    #[test]
    fn with_slabs_the_nearest_triangle_is_found_all_the_same() {
        let (positions, triangles) = cone(3_000);
        let tree = BoxTree::new(&positions, &triangles);
        assert!(!tree.slabs.is_empty());
        for k in 0..300u32 {
            let [x, y, z] = [7, 11, 13].map(|step| f64::from(k * step % 31) / 15.5 - 1.0);
            let p = DVec3::new(1.3 * x, 1.3 * y, z);
            let (found, ..) = tree.nearest(p, k).expect("triangles");
            let all = (0..triangles.len() as u32).map(|slot| tree.distance_squared(p, slot));
            assert!((found - all.fold(f64::INFINITY, f64::min).sqrt()).abs() < 1e-12, "{p}");
        }
    }
}
