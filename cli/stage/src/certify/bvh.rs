//! A triangle set in a bounding volume hierarchy, for closest-point queries.
//!
//! A node has four children, with boxes as four lanes of `f32`. The boxes only decide which triangles are examined;
//! every distance is computed in `f64`. Triangles are stored in the order of the leaves, and vertices in the order of
//! their first use, so walking either is spatially coherent.

mod around;
mod together;
pub use around::{AROUND, Around};
pub use together::{Feet, Few, Numbers, Single, TOGETHER};

use glam::{DVec3, Vec4};

use super::closest::PreparedTriangle;
use lodpack_mesh::NONE;

/// Triangles in a leaf.
const LEAF: usize = 4;
/// Boxes are widened by this much in normalised coordinates, in which the set spans -1..1. That is four times the
/// rounding of the box itself and of a query point within twice that range; [`SLACK`] covers points farther out.
const WIDEN: f32 = 5e-7;
/// Relative slack when comparing a squared box distance with the best squared distance so far.
const SLACK: f64 = 1.0 + 1e-5;
/// Entries of the traversal stack: three for each of at most 16 levels, plus one.
const STACK: usize = 64;
/// The radius of a [`Near`] as a share of a difference of distances: a half, less than which rounding errors are far
/// smaller.
const STEADY: f64 = 0.499_999;
/// Larger sets are refused, because the traversal stack is sized for this many.
const MAX_TRIANGLES: usize = 1 << 28;

/// The kinds of child: none, another node, or a leaf with this many triangles.
const EMPTY: u8 = u8::MAX;
const INNER: u8 = 0;

#[derive(Clone, Debug)]
struct BvhNode {
    min: [Vec4; 3],
    max: [Vec4; 3],
    /// Index of the node, or of the first triangle of a leaf.
    child: [u32; 4],
    /// [`EMPTY`], [`INNER`] or the number of triangles of a leaf.
    count: [u8; 4],
}

impl BvhNode {
    /// Squared distances of a point from the boxes, in normalised coordinates.
    #[inline(always)]
    fn squares(&self, point: [Vec4; 3]) -> Vec4 {
        let mut squares = Vec4::ZERO;
        for k in 0..3 {
            let outside = (self.min[k] - point[k]).max(point[k] - self.max[k]).max(Vec4::ZERO);
            squares += outside * outside;
        }
        squares
    }
}

/// Triangles prepared for distance queries. Positions may be far from the origin, and triangles may be degenerate.
#[derive(Clone, Debug)]
pub struct TriangleBvh {
    /// The vertices in use, in the order of their first use by [`Self::triangles`].
    pub(super) positions: Vec<DVec3>,
    /// In the order of the leaves.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Index of each triangle in the caller's list.
    pub(super) original: Vec<u32>,
    /// Index into `positions` of each of the caller's vertices; [`NONE`] if no triangle uses it.
    pub(super) vertex_of: Vec<u32>,
    /// Centre of the bounds. Distances are computed relative to it.
    pub(super) origin: DVec3,
    /// The largest distance of a vertex from `origin` along any axis.
    pub(super) reach: f64,
    /// Scales relative positions to -1..1.
    scale: f64,
    prepared: Vec<PreparedTriangle>,
    nodes: Vec<BvhNode>,
}

/// Where the last query ended. If queries come in a coherent order, the next one begins close by.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hint(u32);

impl Hint {
    /// Begin at a triangle, given by its slot.
    pub(super) fn at(slot: u32) -> Self {
        Self(slot)
    }
}

/// A ball in which one triangle is closest to all points: its radius is half of how much farther its centre is from all
/// others.
#[derive(Clone, Copy, Debug, Default)]
pub struct Near {
    centre: DVec3,
    radius: f64,
    slot: u32,
    /// The triangle that is closest but for this one, when it was last looked for.
    other: u32,
}

/// The answer to a closest-point query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closest {
    /// The closest point of the surface.
    pub point: DVec3,
    /// Its distance.
    pub distance: f64,
    /// A triangle that contains the point, as an index into the caller's list.
    pub triangle: u32,
}

/// A box in normalised coordinates.
type Bounds = [[f32; 3]; 2];

/// Index and centroid of a triangle, moved about while the tree is built. Centroids are integers, which compare faster.
#[derive(Clone, Copy)]
struct Item {
    centre: [u32; 3],
    triangle: u32,
}

impl Item {
    /// Sort key along an axis. Equal centroids are sorted by index, so the tree does not depend on how a selection is
    /// implemented.
    fn key(&self, axis: usize) -> u64 {
        u64::from(self.centre[axis]) << 32 | u64::from(self.triangle)
    }
}

impl TriangleBvh {
    /// Builds the hierarchy over the triangles of a mesh with finite positions. Vertices that no triangle uses have no
    /// effect.
    ///
    /// # Panics
    ///
    /// If a triangle names a vertex that does not exist, or if there are more than 2^28 triangles.
    pub fn new(positions: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        assert!(triangles.len() <= MAX_TRIANGLES, "too many triangles for one surface");
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for &v in triangles.iter().flatten() {
            let p = positions[v as usize];
            bounds = [bounds[0].min(p), bounds[1].max(p)];
        }
        let (origin, reach) = if triangles.is_empty() {
            (DVec3::ZERO, 0.0)
        } else {
            let origin = bounds[0] * 0.5 + bounds[1] * 0.5;
            (origin, (bounds[1] - origin).max(origin - bounds[0]).max_element())
        };
        let scale = if (1.0 / reach).is_finite() { 1.0 / reach } else { 1.0 };

        let normalised: Vec<[f32; 3]> =
            positions.iter().map(|&p| ((p - origin) * scale).to_array().map(|x| x as f32)).collect();
        let mut items: Vec<Item> = (0u32..)
            .zip(triangles)
            .map(|(triangle, corners)| {
                let [a, b, c] = corners.map(|v| normalised[v as usize]);
                let centre = [0, 1, 2].map(|k| ((a[k] + b[k] + c[k] + 3.0) * 536_870_912.0) as u32);
                Item { centre, triangle }
            })
            .collect();
        let mut nodes = Vec::with_capacity(items.len() / 8 + 1);
        if !items.is_empty() {
            Builder { normalised: &normalised, triangles, nodes: &mut nodes }.node(&mut items, 0);
        }

        let mut renumbered = vec![NONE; positions.len()];
        let mut used = Vec::with_capacity(positions.len());
        let mut prepared = Vec::with_capacity(items.len());
        let mut reordered = Vec::with_capacity(items.len());
        for item in &items {
            let corners = triangles[item.triangle as usize];
            prepared.push(PreparedTriangle::new(corners.map(|v| positions[v as usize] - origin)));
            reordered.push(corners.map(|v| {
                let slot = &mut renumbered[v as usize];
                if *slot == NONE {
                    *slot = used.len() as u32;
                    used.push(positions[v as usize]);
                }
                *slot
            }));
        }
        let original = items.iter().map(|item| item.triangle).collect();
        Self {
            positions: used,
            triangles: reordered,
            original,
            vertex_of: renumbered,
            origin,
            reach,
            scale,
            prepared,
            nodes,
        }
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// The point of the surface that is closest to `point`; infinitely far if the surface is empty.
    pub fn closest(&self, point: DVec3, hint: &mut Hint) -> Closest {
        let local = point - self.origin;
        let (_, slot) = self.nearest(local, hint.0, 0.0);
        let Some(triangle) = self.prepared.get(slot as usize) else {
            return Closest { point, distance: f64::INFINITY, triangle: NONE };
        };
        hint.0 = slot;
        let closest = triangle.closest_point(local);
        Closest {
            point: closest + self.origin,
            distance: closest.distance(local),
            triangle: self.original[slot as usize],
        }
    }

    /// The triangle closest to `point`, or the one where the last query ended if that is not farther than `enough`;
    /// [`NONE`] if the surface is empty.
    pub fn close(&self, point: DVec3, enough: f64, hint: &mut Hint) -> u32 {
        let local = point - self.origin;
        let is_enough = |triangle: &PreparedTriangle| triangle.distance_squared(local) <= enough * enough;
        if !self.prepared.get(hint.0 as usize).is_some_and(is_enough) {
            hint.0 = self.nearest(local, hint.0, 0.0).1;
        }
        self.original.get(hint.0 as usize).copied().unwrap_or(NONE)
    }

    /// As [`closest`](Self::closest), for queries that lie so close together that many in a row end at one triangle.
    pub fn closest_near(&self, point: DVec3, near: &mut Near) -> Closest {
        let local = point - self.origin;
        if local.distance_squared(near.centre) >= near.radius * near.radius {
            let (square, slot) = self.nearest(local, near.slot, 0.0);
            // At the first query of a triangle another one is about as close.
            let (radius, other) = if slot == near.slot && slot != NONE {
                let (beside, other) = self.nearest_but::<true>(local, near.other, 0.0, slot, &mut 0);
                ((STEADY * (beside.sqrt() - square.sqrt())).max(0.0), other)
            } else {
                (0.0, near.other)
            };
            *near = Near { centre: local, radius, slot, other };
        }
        let Some(triangle) = self.prepared.get(near.slot as usize) else {
            return Closest { point, distance: f64::INFINITY, triangle: NONE };
        };
        let closest = triangle.closest_point(local);
        Closest {
            point: closest + self.origin,
            distance: closest.distance(local),
            triangle: self.original[near.slot as usize],
        }
    }

    /// Squared distance of a point, relative to `origin`, from one triangle.
    #[inline(always)]
    pub(super) fn distance_squared(&self, local: DVec3, slot: u32) -> f64 {
        self.prepared[slot as usize].distance_squared(local)
    }

    /// The point of one triangle that is closest to a point; both are relative to `origin`.
    pub(super) fn closest_in(&self, local: DVec3, slot: u32) -> DVec3 {
        self.prepared[slot as usize].closest_point(local)
    }

    /// Squared distance and slot of the triangle closest to a point relative to `origin`. The search starts with the
    /// triangle in slot `hint` and may stop at any triangle within the squared distance `enough`. For an empty surface
    /// it returns infinity and [`NONE`].
    pub(super) fn nearest(&self, local: DVec3, hint: u32, enough: f64) -> (f64, u32) {
        self.nearest_counted(local, hint, enough).0
    }

    /// As [`nearest`](Self::nearest), and the number of nodes and leaves that it looked into: a few dozen where
    /// triangles lie beside each other, but nearly all where the boxes of all overlap, as around the hub of a fan.
    pub(super) fn nearest_counted(&self, local: DVec3, hint: u32, enough: f64) -> ((f64, u32), u64) {
        let mut visited = 0;
        let found = self.nearest_but::<false>(local, hint, enough, NONE, &mut visited);
        (found, visited)
    }

    /// As [`nearest`](Self::nearest), of all triangles but one if `IS_BUT` is set. Adds to `visited` the number of
    /// nodes and leaves that it looks into.
    #[inline(always)]
    fn nearest_but<const IS_BUT: bool>(
        &self,
        local: DVec3,
        hint: u32,
        enough: f64,
        but: u32,
        visited: &mut u64,
    ) -> (f64, u32) {
        let mut best = (f64::INFINITY, NONE);
        if let Some(triangle) = self.prepared.get(hint as usize)
            && (!IS_BUT || hint != but)
        {
            best = (triangle.distance_squared(local), hint);
        }
        if self.nodes.is_empty() {
            return best;
        }
        let to_limit = |square: f64| (square * self.scale * self.scale * SLACK) as f32;
        let mut limit = to_limit(best.0);
        let q = (local * self.scale).as_vec3();
        let q = [Vec4::splat(q.x), Vec4::splat(q.y), Vec4::splat(q.z)];
        // Entries: squared distance of the box, node or first triangle, count as in [`BvhNode`].
        let mut stack = [(0f32, 0u32, INNER); STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let (square, index, count) = stack[top];
            if square > limit {
                continue;
            }
            *visited += 1;
            if count != INNER {
                for slot in index..index + u32::from(count) {
                    if IS_BUT && slot == but {
                        continue;
                    }
                    let square = self.prepared[slot as usize].distance_squared(local);
                    if square < best.0 {
                        best = (square, slot);
                        limit = to_limit(square);
                    }
                }
                if best.0 <= enough {
                    break;
                }
                continue;
            }
            let node = &self.nodes[index as usize];
            let squares = node.squares(q).to_array();
            let bottom = top;
            for lane in 0..4 {
                if squares[lane] > limit || node.count[lane] == EMPTY {
                    continue;
                }
                // Keep the nearest on top.
                let mut at = top;
                while at > bottom && stack[at - 1].0 < squares[lane] {
                    stack[at] = stack[at - 1];
                    at -= 1;
                }
                stack[at] = (squares[lane], node.child[lane], node.count[lane]);
                top += 1;
            }
        }
        best
    }

    /// The children of a node (0 is the root), each with the centre and radius of a ball around its box, relative to
    /// `origin`.
    pub(super) fn children(&self, node: u32) -> impl Iterator<Item = Child> + '_ {
        let node = &self.nodes[node as usize];
        (0..4).filter(|&lane| node.count[lane] != EMPTY).map(move |lane| {
            let [low, high] = [&node.min, &node.max].map(|b| DVec3::from([0, 1, 2].map(|k| f64::from(b[k][lane]))));
            Child {
                centre: (low + high) * (0.5 / self.scale),
                radius: (high - low).length() * (0.5 / self.scale),
                index: node.child[lane],
                triangle_count: node.count[lane],
            }
        })
    }
}

/// A child of a node of a [`TriangleBvh`].
pub(super) struct Child {
    pub(super) centre: DVec3,
    pub(super) radius: f64,
    /// Index of the node, or of the first triangle of a leaf.
    pub(super) index: u32,
    /// Zero for an inner node.
    pub(super) triangle_count: u8,
}

struct Builder<'a> {
    normalised: &'a [[f32; 3]],
    triangles: &'a [[u32; 3]],
    nodes: &'a mut Vec<BvhNode>,
}

impl Builder<'_> {
    /// Builds the node over `items`, the first of which gets slot `first`.
    fn node(&mut self, items: &mut [Item], first: u32) -> (u32, Bounds) {
        let index = self.nodes.len() as u32;
        self.nodes.push(BvhNode {
            min: [Vec4::INFINITY; 3],
            max: [Vec4::NEG_INFINITY; 3],
            child: [0; 4],
            count: [EMPTY; 4],
        });
        let mut total: Bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        let (left, right) = halve(items);
        let quarters = [left, right].map(halve);
        let mut first = first;
        for (lane, part) in quarters.into_iter().flat_map(|(a, b)| [a, b]).enumerate() {
            if part.is_empty() {
                continue;
            }
            let (child, count, bounds) = if part.len() <= LEAF {
                (first, part.len() as u8, self.leaf_bounds(part))
            } else {
                let (child, bounds) = self.node(part, first);
                (child, INNER, bounds)
            };
            first += part.len() as u32;
            let node = &mut self.nodes[index as usize];
            node.child[lane] = child;
            node.count[lane] = count;
            for k in 0..3 {
                node.min[k][lane] = bounds[0][k] - WIDEN;
                node.max[k][lane] = bounds[1][k] + WIDEN;
                total[0][k] = total[0][k].min(bounds[0][k]);
                total[1][k] = total[1][k].max(bounds[1][k]);
            }
        }
        (index, total)
    }

    fn leaf_bounds(&self, items: &[Item]) -> Bounds {
        let mut bounds: Bounds = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
        for item in items {
            for v in self.triangles[item.triangle as usize] {
                let p = self.normalised[v as usize];
                for k in 0..3 {
                    bounds[0][k] = bounds[0][k].min(p[k]);
                    bounds[1][k] = bounds[1][k].max(p[k]);
                }
            }
        }
        bounds
    }
}

/// Splits at the median along the longest axis of the centroids. Items that fit a leaf stay together.
fn halve(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
    if items.len() <= LEAF {
        return items.split_at_mut(items.len());
    }
    let mut low = [u32::MAX; 3];
    let mut high = [0; 3];
    for item in items.iter() {
        for k in 0..3 {
            low[k] = low[k].min(item.centre[k]);
            high[k] = high[k].max(item.centre[k]);
        }
    }
    let extent = [0, 1, 2].map(|k| high[k] - low[k]);
    let axis = if extent[0] >= extent[1] && extent[0] >= extent[2] {
        0
    } else if extent[1] >= extent[2] {
        1
    } else {
        2
    };
    // Fill whole leaves on the left.
    let middle = (items.len() / 2).next_multiple_of(LEAF).min(items.len() - 1);
    items.select_nth_unstable_by_key(middle, |item| item.key(axis));
    items.split_at_mut(middle)
}

#[cfg(test)]
mod tests {
    use super::super::tests::Random;
    use super::*;

    pub(super) fn soup(count: u32, random: &mut Random, size: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let positions = (0..count)
            .flat_map(|_| {
                let centre = random.point();
                [(); 3].map(|()| centre + random.point() * size)
            })
            .collect();
        (positions, (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
    }

    #[test]
    fn closest_agrees_with_a_search_of_every_triangle() {
        let mut random = Random(3);
        for count in [1, 2, 5, 17, 300] {
            for (offset, unit) in [(DVec3::ZERO, 1.0), (DVec3::new(5e6, -3e6, 1e6), 1.0), (DVec3::ZERO, 1e-20)] {
                let (mut positions, triangles) = soup(count, &mut random, 0.2);
                positions.iter_mut().for_each(|p| *p = *p * unit + offset);
                let surface = TriangleBvh::new(&positions, &triangles);
                let mut hint = Hint::default();
                for k in 0..100 {
                    let point = random.point() * unit * if k % 10 == 0 { 1e4 } else { 1.5 } + offset;
                    let found = surface.closest(point, &mut hint);
                    let best = triangles
                        .iter()
                        .map(|t| {
                            let prepared = PreparedTriangle::new(t.map(|v| positions[v as usize] - offset));
                            prepared.distance_squared(point - offset).sqrt()
                        })
                        .fold(f64::INFINITY, f64::min);
                    assert!((found.distance - best).abs() <= best * 1e-9 + unit * 1e-12, "{} {best}", found.distance);
                    assert!(
                        (found.point.distance(point) - found.distance).abs() <= best * 1e-9 + offset.length() * 1e-15
                    );
                }
            }
        }
    }

    #[test]
    fn queries_close_to_one_another_end_where_each_alone_does() {
        let mut random = Random(5);
        for count in [1, 2, 40] {
            let (positions, triangles) = soup(count, &mut random, 1.0);
            let surface = TriangleBvh::new(&positions, &triangles);
            let (mut near, mut repeated) = (Near::default(), 0);
            for _ in 0..50 {
                let [from, to] = [random.point(), random.point()];
                for k in 0..100 {
                    let point = from + (to - from) * (f64::from(k) / 400.0);
                    let before = near.centre;
                    let found = surface.closest_near(point, &mut near);
                    let alone = surface.closest(point, &mut Hint::default());
                    assert!((found.distance - alone.distance).abs() < 1e-12, "{} {}", found.distance, alone.distance);
                    repeated += u32::from(near.centre == before);
                }
            }
            assert!(repeated > 2_000, "{repeated} of 5,000 took no search");
        }
        let nowhere = TriangleBvh::new(&[], &[]).closest_near(DVec3::ONE, &mut Near::default());
        assert_eq!((nowhere.triangle, nowhere.distance), (NONE, f64::INFINITY));
    }

    #[test]
    fn equal_triangles_still_make_a_tree() {
        let surface = TriangleBvh::new(&[DVec3::ONE; 3], &[[0, 1, 2]; 1000]);
        let found = surface.closest(DVec3::ZERO, &mut Hint::default());
        assert_eq!(found.point, DVec3::ONE);
        assert_eq!(surface.triangle_count(), 1000);
    }

    #[test]
    fn every_triangle_is_kept_once() {
        let (positions, triangles) = soup(501, &mut Random(4), 0.1);
        let surface = TriangleBvh::new(&positions, &triangles);
        let mut original = surface.original.clone();
        original.sort_unstable();
        assert!(original.into_iter().eq(0..501));
        for (slot, &t) in surface.original.iter().enumerate() {
            let corners = surface.triangles[slot].map(|v| surface.positions[v as usize]);
            assert_eq!(corners, triangles[t as usize].map(|v| positions[v as usize]));
        }
    }

    #[test]
    fn an_empty_surface_is_infinitely_far() {
        let surface = TriangleBvh::new(&[], &[]);
        assert_eq!(surface.closest(DVec3::ONE, &mut Hint::default()).distance, f64::INFINITY);
    }
}
