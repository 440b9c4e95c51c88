//! Plains: neighbouring triangles that lie nearly in one plane, however many they are and whatever their outline, such
//! as the ground around an island.
//!
//! A large triangle over a plain of many small ones would take a cut for nearly each of them. Where no border of the
//! plain passes under it, it is settled as a whole.
//!
//! # Why the bound holds
//!
//! Look at the plain from above. How many of its triangles that face up lie over a point, less those that face down, is
//! how often its border winds around the point: the edges between two of its triangles cancel out. The border is what
//! is left, with direction. So this number is the same for all points of a triangle that no edge of the border comes
//! near. If it is not zero, every point of the triangle has a point of the plain above or below it, at one of the
//! plain's heights. Edges of the border may pass along the sides of the triangle: what is looked at is the triangle
//! made smaller, whose points are near those that are left out.

use glam::{DVec2, DVec3};

use super::bvh::TriangleBvh;
use lodpack_mesh::{Adjacency, NONE};

/// Fewer triangles are no plain.
const FEWEST: usize = 16;
/// The share of the threshold by which heights of a plain differ at most, and by which a triangle is made smaller.
const THICKNESS: f64 = 0.5;
const RIM: f64 = 0.25;
/// Edges of the border are farther away than this share of the coordinates, so that rounding does not matter.
const CLEAR: f64 = 1e-12;
/// Edges in a leaf.
const LEAF: usize = 4;

/// The plains of a surface.
pub(super) struct Plains {
    /// For each slot the number of its plain, [`NONE`] for none.
    of_slot: Vec<u32>,
    plains: Vec<Plain>,
    rim: f64,
}

/// One of them, seen from above: places are relative to a point of it, along two axes.
struct Plain {
    origin: DVec3,
    axes: [DVec3; 3],
    /// The least and the largest height of a vertex.
    heights: [f64; 2],
    border: Border,
    clear: f64,
}

/// Edges with direction in a hierarchy of boxes.
struct Border {
    edges: Vec<[DVec2; 2]>,
    /// A node is followed by its first child, or has edges.
    nodes: Vec<Node>,
}

struct Node {
    bounds: [DVec2; 2],
    /// The number of the node after all that are below.
    next: u32,
    /// The edges of a leaf; empty for others.
    edges: std::ops::Range<u32>,
}

impl Plains {
    /// Finds plains that serve distances up to the threshold. Positions are relative to the origin of the surface.
    pub fn new(surface: &TriangleBvh, threshold: f64) -> Self {
        let count = surface.triangles.len();
        let mut this = Self { of_slot: vec![NONE; count], plains: vec![], rim: RIM * threshold };
        let positions: Vec<DVec3> = surface.positions.iter().map(|&p| p - surface.origin).collect();
        let doubled = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| positions[v as usize]);
            (b - a).cross(c - a)
        };
        let areas: Vec<DVec3> = surface.triangles.iter().map(doubled).collect();
        let positions = &positions;
        let Adjacency { opposite } = Adjacency::new(&surface.triangles, positions.len());
        let (across, _) = opposite.as_chunks::<3>();
        let mut order: Vec<u32> = (0..count as u32).collect();
        let square = |slot: u32| areas[slot as usize].length_squared();
        order.sort_unstable_by(|&a, &b| square(b).total_cmp(&square(a)).then(a.cmp(&b)));
        let mut is_taken = vec![false; count];
        let mut slots: Vec<u32> = vec![];
        for start in order {
            let Some(normal) = areas[start as usize].try_normalize() else { continue };
            if std::mem::replace(&mut is_taken[start as usize], true) {
                continue;
            }
            let base = positions[surface.triangles[start as usize][0] as usize];
            let height = |v: u32| (positions[v as usize] - base).dot(normal);
            slots.clear();
            slots.push(start);
            let mut at = 0;
            while let Some(&slot) = slots.get(at) {
                at += 1;
                for next in across[slot as usize].into_iter().filter(|&next| next != NONE).map(|next| next / 3) {
                    let corners = surface.triangles[next as usize];
                    if !is_taken[next as usize]
                        && areas[next as usize].dot(normal) >= 0.0
                        && corners.iter().all(|&v| height(v).abs() <= 0.5 * THICKNESS * threshold)
                    {
                        is_taken[next as usize] = true;
                        slots.push(next);
                    }
                }
            }
            if slots.len() < FEWEST {
                continue;
            }
            let number = this.plains.len() as u32;
            slots.iter().for_each(|&slot| this.of_slot[slot as usize] = number);
            let of_slot = &this.of_slot;
            let is_inside = |next: u32| next != NONE && of_slot[next as usize / 3] == number;
            let edges = slots.iter().flat_map(|&slot| {
                let (corners, across) = (surface.triangles[slot as usize], across[slot as usize]);
                let outer = (0..3).filter(move |&k| !is_inside(across[k]));
                outer.map(move |k| [corners[k], corners[(k + 1) % 3]].map(|v| positions[v as usize]))
            });
            let vertices = slots.iter().flat_map(|&slot| surface.triangles[slot as usize]);
            let mut heights = [0.0f64; 2];
            vertices.map(height).for_each(|h| heights = [heights[0].min(h), heights[1].max(h)]);
            let plain = Plain::new(base, normal, heights, edges);
            this.plains.push(plain);
        }
        this
    }

    /// Whether a slot is one of a plain.
    pub fn plain(&self, slot: u32) -> Option<u32> {
        Some(self.of_slot[slot as usize]).filter(|&plain| plain != NONE)
    }

    /// Bounds the squared distance of a triangle from a plain, if all of it lies above or below.
    pub fn bound(&self, plain: u32, corners: &[DVec3; 3], threshold: f64) -> Option<f64> {
        let plain = &self.plains[plain as usize];
        let placed = corners.map(|corner| plain.place(corner));
        let above = placed.iter().map(|&(_, h)| (h - plain.heights[0]).max(plain.heights[1] - h)).fold(0.0, f64::max);
        let square = self.rim * self.rim + above * above;
        (square <= threshold && plain.is_under(placed.map(|(place, _)| place), self.rim)).then_some(square)
    }
}

impl Plain {
    fn new(origin: DVec3, normal: DVec3, heights: [f64; 2], edges: impl Iterator<Item = [DVec3; 2]>) -> Self {
        let (right, up) = normal.any_orthonormal_pair();
        let border = Border { edges: vec![], nodes: vec![] };
        let mut this = Self { origin, axes: [right, up, normal], heights, border, clear: 0.0 };
        let edges: Vec<[DVec2; 2]> = edges.map(|edge| edge.map(|p| this.place(p).0)).collect();
        let reach = edges.iter().flatten().map(|p| p.abs().max_element()).fold(origin.abs().max_element(), f64::max);
        this.clear = CLEAR * reach;
        this.border = Border::new(edges);
        this
    }

    /// Where a point is seen from above, and its height.
    fn place(&self, point: DVec3) -> (DVec2, f64) {
        let [x, y, height] = self.axes.map(|axis| (point - self.origin).dot(axis));
        (DVec2::new(x, y), height)
    }

    /// Whether the plain is under all points of a triangle but some within `rim` of others.
    fn is_under(&self, corners: [DVec2; 3], rim: f64) -> bool {
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let most = corners.iter().map(|&corner| corner.distance(middle)).fold(0.0, f64::max);
        // Every point moves towards the middle, at most by the rim.
        let share = 1.0 - (rim / most).min(0.5);
        let corners = corners.map(|corner| middle + (corner - middle) * share);
        !self.border.comes_near(&corners, self.clear) && self.border.winding(middle) != 0
    }
}

impl Border {
    fn new(mut edges: Vec<[DVec2; 2]>) -> Self {
        let mut nodes = vec![];
        add(&mut edges, 0, &mut nodes);
        Self { edges, nodes }
    }

    /// Visits edges in boxes that are wanted, until the visitor ends it.
    fn visit(&self, is_wanted: impl Fn(&[DVec2; 2]) -> bool, mut visit: impl FnMut(&[DVec2; 2]) -> bool) -> bool {
        let mut at = 0;
        while let Some(node) = self.nodes.get(at as usize) {
            if !is_wanted(&node.bounds) {
                at = node.next;
                continue;
            }
            at += 1;
            if self.edges[node.edges.start as usize..node.edges.end as usize].iter().any(&mut visit) {
                return true;
            }
        }
        false
    }

    /// Whether an edge may come nearer to a triangle than this.
    fn comes_near(&self, corners: &[DVec2; 3], clear: f64) -> bool {
        let low = corners[0].min(corners[1]).min(corners[2]) - clear;
        let high = corners[0].max(corners[1]).max(corners[2]) + clear;
        let sides = [0, 1, 2].map(|k| (corners[(k + 1) % 3] - corners[k]).perp().normalize_or_zero());
        let is_wanted = |[min, max]: &[DVec2; 2]| {
            let overlaps = min.cmple(high).all() && max.cmpge(low).all();
            overlaps
                && !sides.iter().any(|&axis| {
                    let (middle, half) = ((*min + *max) * 0.5, (*max - *min) * 0.5);
                    let (at, reach) = (middle.dot(axis), half.dot(axis.abs()) + clear);
                    let [least, most] = along(corners, axis);
                    at - reach > most || at + reach < least
                })
        };
        self.visit(is_wanted, |edge| {
            let own = (edge[1] - edge[0]).perp().normalize_or_zero();
            let apart = [DVec2::X, DVec2::Y, own].iter().chain(&sides).any(|&axis| {
                let ([least, most], [low, high]) = (along(corners, axis), along(edge, axis));
                low > most + clear || high < least - clear
            });
            !apart
        })
    }

    /// How often the border winds around a point that is not near it.
    fn winding(&self, point: DVec2) -> i32 {
        let mut winding = 0;
        // Edges that a ray to the right may meet.
        let is_wanted = |[min, max]: &[DVec2; 2]| min.y <= point.y && max.y >= point.y && max.x >= point.x;
        self.visit(is_wanted, |&[from, to]| {
            let (was, is) = (from.y > point.y, to.y > point.y);
            if was != is && ((from - point).perp_dot(to - point) > 0.0) == is {
                winding += if is { 1 } else { -1 };
            }
            false
        });
        winding
    }
}

/// From where to where some points reach along an axis.
fn along(points: &[DVec2], axis: DVec2) -> [f64; 2] {
    points
        .iter()
        .map(|p| p.dot(axis))
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)])
}

/// Appends the node of some edges and all below it; `first` is the number of the first edge.
fn add(edges: &mut [[DVec2; 2]], first: u32, nodes: &mut Vec<Node>) {
    let ends = || edges.iter().flatten().copied();
    let bounds = [ends().fold(DVec2::INFINITY, DVec2::min), ends().fold(DVec2::NEG_INFINITY, DVec2::max)];
    let at = nodes.len();
    let own = if edges.len() <= LEAF { first..first + edges.len() as u32 } else { 0..0 };
    nodes.push(Node { bounds, next: 0, edges: own });
    if edges.len() > LEAF {
        let extent = bounds[1] - bounds[0];
        let place = |[a, b]: &[DVec2; 2]| if extent.x >= extent.y { a.x + b.x } else { a.y + b.y };
        let half = edges.len() / 2;
        edges.sort_by(|a, b| place(a).total_cmp(&place(b)));
        let (left, right) = edges.split_at_mut(half);
        add(left, first, nodes);
        add(right, first + half as u32, nodes);
    }
    nodes[at].next = nodes.len() as u32;
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Random, height_field, surface};
    use super::super::{CertifyOptions, Hint, two_sided};
    use super::*;

    /// Ground with a few holes, and a hill.
    fn island(count: u32) -> lodpack_mesh::Mesh {
        let hill = |x: f64, y: f64| (0.01 - (x - 0.3).powi(2) - (y - 0.4).powi(2)).max(0.0) * 20.0;
        let mut mesh = height_field(count, hill);
        mesh.triangles = mesh.triangles.into_iter().enumerate().filter(|(t, _)| t % 997 != 5).map(|(_, t)| t).collect();
        mesh
    }

    #[test]
    fn plains_are_never_nearer_than_they_are() {
        let (surface, mut random, mut settled) = (surface(&island(60)), Random(17), 0);
        let threshold = 0.02;
        let plains = Plains::new(&surface, threshold);
        assert_eq!(plains.plains.len(), 1);
        for _ in 0..5_000 {
            let (at, size) = (random.point() * DVec3::new(0.6, 0.6, 0.02), random.unit().powi(3));
            let at = at - DVec3::Z * surface.origin.z;
            let corners = [(); 3].map(|()| at + random.point() * DVec3::new(size, size, 0.01));
            let Some(bound) = plains.bound(0, &corners, threshold * threshold) else { continue };
            settled += 1;
            for _ in 0..20 {
                let [u, v] = [random.unit(), random.unit()];
                let point = corners[0].lerp(corners[1], u).lerp(corners[2], v) + surface.origin;
                let distance = surface.closest(point, &mut Hint::default()).distance;
                assert!(distance <= bound.sqrt() + 1e-12, "{distance} {bound} {corners:?}");
            }
        }
        assert!(settled > 500, "{settled}");
    }

    #[test]
    fn large_triangles_on_a_plain_take_work_at_its_border_only() {
        let square = |z: f64| [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, z));
        let large = TriangleBvh::new(&square(1e-4), &[[0, 1, 2], [0, 2, 3]]);
        let options = CertifyOptions { relative_gap: 1e-3, floor: 2e-4, ..CertifyOptions::default() };
        for count in [100, 200] {
            let ground = surface(&height_field(count, |_, _| 0.0));
            let bound = two_sided(&large, &ground, &options);
            assert!((1e-4..=2e-4).contains(&bound.upper), "{bound:?}");
            // The search begins as any other.
            assert!(bound.work < 10_000 + 12 * u64::from(count * count), "{count}: {bound:?}");
        }
    }
}
