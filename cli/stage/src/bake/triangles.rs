//! How the triangles of a patch lie, and which lie beside each.

use std::collections::HashMap;

use glam::DVec3;

use super::BakedPatch;
use crate::nearest::doubled_area;
use lodpack_mesh::{NONE, sides};

/// Cosine of the angle by which a single triangle may be inclined to the axis of the piece to which it goes.
pub(super) const STEEP: f64 = 0.35;

/// Triangles of a patch.
pub(super) struct Triangles {
    /// Twice their areas, as vectors along their normals.
    pub areas: Vec<DVec3>,
    /// Those beside each, [`NONE`] for none.
    pub neighbours: Vec<[u32; 3]>,
}

impl Triangles {
    pub fn new(patch: &BakedPatch<'_>) -> Self {
        let area = |corners: &[u32; 3]| doubled_area(corners.map(|corner| patch.position(corner)));
        Self { areas: patch.triangles.iter().map(area).collect(), neighbours: neighbours(patch.triangles) }
    }

    /// Whether a triangle is inclined to a direction by at most the angle whose cosine is given.
    pub fn leans(&self, triangle: u32, direction: DVec3, cosine: f64) -> bool {
        let area = self.areas[triangle as usize];
        area.dot(direction) >= cosine * area.length()
    }
}

/// The triangles beside each triangle, [`NONE`] for none.
pub(super) fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut open: HashMap<[u32; 2], (u32, usize)> = HashMap::new();
    let mut result = vec![[NONE; 3]; triangles.len()];
    for (number, &corners) in (0..).zip(triangles) {
        for (side, key) in sides(corners).into_iter().enumerate() {
            match open.remove(&key) {
                Some((other, other_side)) => {
                    result[number as usize][side] = other;
                    result[other as usize][other_side] = number;
                }
                None => drop(open.insert(key, (number, side))),
            }
        }
    }
    result
}
