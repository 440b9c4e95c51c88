//! Nodes of the tree: boxes, and *slabs*. Where the boxes of most triangles overlap, as around the hub of a fan, nodes
//! also know how far their triangles reach across the needles that these are.

use glam::DVec3;
use std::ops::Range;

/// Boxes are in single precision, in units of the tree's reach, and enlarged by this: more than the rounding of a box
/// and of a point within a few reaches.
pub(super) const SLACK: f32 = 1.0 / (1 << 21) as f32;
/// Slabs are made where a point in the box of all lies in the boxes of so many leaves, if these were anywhere. Most
/// surfaces have one or two.
const OVERLAP: f64 = 32.0;
/// Slabs are enlarged by this many times what boxes are: there is more to round.
const ROOM: f32 = 8.0;

/// Four boxes side by side. Missing children have inverted boxes.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoxNode {
    pub low: [[f32; 4]; 3],
    pub high: [[f32; 4]; 3],
    /// A node, or the first slot of a leaf.
    pub child: [u32; 4],
    /// Triangles of a leaf; 0 for a node.
    pub count: [u8; 4],
}

impl BoxNode {
    /// Squared distance of a point from each of the boxes.
    pub fn distances(&self, p: [f32; 3]) -> [f32; 4] {
        let mut sum = [0.0; 4];
        for k in 0..3 {
            for i in 0..4 {
                let outside = (self.low[k][i] - p[k]).max(p[k] - self.high[k][i]).max(0.0);
                sum[i] += outside * outside;
            }
        }
        sum
    }
}

/// The slabs of the four children of a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slabs {
    axes: [[f32; 3]; 4],
    low: [f32; 4],
    high: [f32; 4],
}

/// The corners of the triangle in a slot.
type Place<'a> = dyn Fn(u32) -> [DVec3; 3] + 'a;
/// A point in units of the tree's reach.
type Scale<'a> = dyn Fn(DVec3) -> [f32; 3] + 'a;

impl Slabs {
    /// The squared distance of a point from the slab of a child.
    pub fn distance(&self, child: usize, p: [f32; 3]) -> f32 {
        let at = along(self.axes[child], p);
        let outside = (self.low[child] - at).max(at - self.high[child]).max(0.0);
        outside * outside
    }

    /// The slabs of all nodes; none if boxes are good enough.
    pub fn of(nodes: &[BoxNode], corners: &Place, scaled: &Scale) -> Vec<Self> {
        let Some(root) = nodes.first() else { return vec![] };
        let area = |[x, y, z]: [f32; 3]| f64::from(x * y + y * z + z * x);
        let extent = |node: &BoxNode, i: usize| [0, 1, 2].map(|k| node.high[k][i] - node.low[k][i]);
        let leaves = nodes.iter().flat_map(|node| (0..4).filter(|&i| node.count[i] > 0).map(move |i| (node, i)));
        let sum: f64 = leaves.map(|(node, i)| area(extent(node, i))).sum();
        let fold = |sides: &[f32; 4], f: fn(f32, f32) -> f32| sides.iter().copied().reduce(f).unwrap_or(0.0);
        let whole = area([0, 1, 2].map(|k| fold(&root.high[k], f32::max) - fold(&root.low[k], f32::min)));
        if sum.partial_cmp(&(OVERLAP * whole)).is_none_or(|order| order.is_lt()) {
            return vec![];
        }
        let mut slabs = vec![Self { axes: [[0.0; 3]; 4], low: [0.0; 4], high: [0.0; 4] }; nodes.len()];
        add(nodes, 0, (corners, scaled), &mut slabs);
        slabs
    }
}

fn along(axis: [f32; 3], p: [f32; 3]) -> f32 {
    axis[0] * p[0] + axis[1] * p[1] + axis[2] * p[2]
}

/// Makes the slabs of a node and all below it. Returns its slots and the sum of directions across them.
fn add(nodes: &[BoxNode], index: u32, of: (&Place, &Scale), slabs: &mut [Slabs]) -> (Range<u32>, DVec3) {
    let ((corners, scaled), node) = (of, nodes[index as usize]);
    let (mut all, mut sum): (Option<Range<u32>>, DVec3) = (None, DVec3::ZERO);
    for i in 0..4 {
        // A child that is missing has an inverted box.
        if node.low[0][i] > node.high[0][i] {
            continue;
        }
        let (slots, across) = match u32::from(node.count[i]) {
            0 => add(nodes, node.child[i], of, slabs),
            count => {
                let slots = node.child[i]..node.child[i] + count;
                let across = slots.clone().map(|slot| across(corners(slot))).fold(DVec3::ZERO, joined);
                (slots, across)
            }
        };
        let axis = across.normalize_or_zero().as_vec3().to_array();
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for p in slots.clone().flat_map(corners).map(|p| along(axis, scaled(p))) {
            (low, high) = (low.min(p), high.max(p));
        }
        let slab = &mut slabs[index as usize];
        (slab.axes[i], slab.low[i], slab.high[i]) = (axis, low - ROOM * SLACK, high + ROOM * SLACK);
        all = Some(all.map_or(slots.clone(), |all| all.start.min(slots.start)..all.end.max(slots.end)));
        sum = joined(sum, across);
    }
    (all.unwrap_or_default(), sum)
}

/// The sum of two directions, or of one and the opposite of the other, whichever is longer.
fn joined(sum: DVec3, other: DVec3) -> DVec3 {
    if sum.dot(other) < 0.0 { sum - other } else { sum + other }
}

/// The direction in a triangle's plane across its longest edge.
fn across([a, b, c]: [DVec3; 3]) -> DVec3 {
    let edges = [b - a, c - b, a - c];
    let longest = edges
        .into_iter()
        .fold(DVec3::ZERO, |most, edge| if edge.length_squared() > most.length_squared() { edge } else { most });
    let normal = edges[0].cross(edges[1]).normalize_or_zero();
    normal.cross(longest).normalize_or_zero()
}
