//! Components of the coarser surface without a border: proof that the image covers them.
//!
//! The image is a chain without a boundary there, so it contains all tiles of such a component or none (counted modulo
//! two). One point tells which: it lies in an odd number of images of parts, or in an even one. The point is chosen on
//! one tile, the *anchor*, so far from the edges of all images that rounding them cannot change the count, and so that
//! no triangle that is not mapped needs to have an image there.

use std::collections::BTreeSet;

use glam::{DVec2, DVec3};

use super::Drape;
use super::parts::Parts;

/// Points of an anchor that are tried, as weights of its corners: in no regular place, since images have edges at
/// regular places.
const POINTS: [[f64; 3]; 6] = [
    [0.357, 0.329, 0.314],
    [0.521, 0.262, 0.217],
    [0.193, 0.544, 0.263],
    [0.241, 0.178, 0.581],
    [0.713, 0.148, 0.139],
    [0.127, 0.152, 0.721],
];
/// Distance of a point from all edges of images, as a share of the anchor's extent and of the surface's.
const CLEAR_OF_TILE: f64 = 1e-6;
const CLEAR_OF_SURFACE: f64 = 1e-10;

impl Drape {
    /// For each component without a border, a tile that is all covered. None unless the image covers all of them.
    /// `moves` are the squares of the most that the points of each triangle of the finer surface move. Those that are
    /// not mapped need no image in these tiles.
    pub(super) fn find_anchors(&mut self, moves: &[f64]) -> Option<()> {
        if self.tiles.closed.is_empty() {
            return Some(());
        }
        let unmapped = (0..).zip(moves).filter(|(_, square)| square.is_infinite()).map(|(slot, _)| slot);
        let mut lost: BTreeSet<u32> = BTreeSet::new();
        self.visit_ways(unmapped, |way| {
            lost.extend(way);
            Some(())
        })?;
        let area = |tile: u32| {
            let [a, b, c] = self.coarse.triangles[tile as usize].map(|v| self.corners[v as usize]);
            (b - a).cross(c - a).length_squared()
        };
        let mut anchors = vec![];
        let mut parts = Parts::default();
        for component in &self.tiles.closed {
            let candidates = component.iter().copied().filter(|tile| !lost.contains(tile));
            let anchor = candidates.max_by(|&a, &b| area(a).total_cmp(&area(b)))?;
            let counted = POINTS.into_iter().find_map(|point| self.is_covered_oddly(anchor, point, moves, &mut parts));
            if counted != Some(true) {
                return None;
            }
            anchors.push(anchor);
        }
        self.anchors = anchors;
        Some(())
    }

    /// Whether a point of a tile, given by the weights of the corners, lies in an odd number of images; none where that
    /// is in doubt.
    fn is_covered_oddly(&self, anchor: u32, [u, v, w]: [f64; 3], moves: &[f64], parts: &mut Parts) -> Option<bool> {
        let corners = self.coarse.triangles[anchor as usize].map(|v| self.corners[v as usize]);
        let [a, b, c] = corners;
        let extent = (b - a).length().max((c - a).length());
        let reach = corners.iter().map(|p| p.length()).fold(0.0, f64::max);
        let clear = CLEAR_OF_TILE * extent + CLEAR_OF_SURFACE * reach;
        // Without the axis that the tile faces most.
        let normal = (b - a).cross(c - a).abs();
        let flat = |p: DVec3| match normal.max_position() {
            0 => DVec2::new(p.y, p.z),
            1 => DVec2::new(p.z, p.x),
            _ => DVec2::new(p.x, p.y),
        };
        let point = a * u + b * v + c * w;
        let centre = flat(point);
        let from_fine = point + (self.coarse.origin - self.fine.origin);
        let (mut is_odd, mut is_clear) = (false, true);
        for (slot, &square) in (0..).zip(moves) {
            // A triangle covers no point that is farther from it than it moves.
            let distance = self.fine.distance_squared(from_fine, slot).sqrt() - clear;
            if square.is_infinite() || distance > 0.0 && distance * distance > square {
                continue;
            }
            let mut count = |tile: u32, image: [DVec3; 3]| {
                if tile != anchor {
                    return;
                }
                let corners = image.map(|p| flat(p) - centre);
                for [from, to] in [0, 1, 2].map(|k| [corners[k], corners[(k + 1) % 3]]) {
                    is_clear &= distance_from_origin(from, to) > clear;
                    // A ray meets the edges around the point an odd number of times. An image may be a mere line.
                    is_odd ^= meets_ray(from, to);
                }
            };
            self.lay(slot, parts, Some(&mut count))?;
        }
        is_clear.then_some(is_odd)
    }
}

/// Whether the ray from the origin along the first axis meets a segment that does not come near the origin.
fn meets_ray(from: DVec2, to: DVec2) -> bool {
    (from.y > 0.0) != (to.y > 0.0) && (from.perp_dot(to) > 0.0) == (to.y > from.y)
}

/// The distance of a segment from the origin; not above any number where the segment is not finite.
fn distance_from_origin(from: DVec2, to: DVec2) -> f64 {
    let along = to - from;
    let share = -from.dot(along) / along.length_squared();
    // Not a number if the segment is a point.
    let nearest = if share > 0.0 { from + along * share.min(1.0) } else { from };
    nearest.length()
}
