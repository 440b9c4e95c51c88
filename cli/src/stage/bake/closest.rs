//! Texels of what lies closest: where a patch is far from its source, who looks for a point of the source sees the point of the patch that is
//! closest to it, and a texel that is the mean of all points for which it is seen is off least.
//!
//! A projection along the axis of a piece has each point of the source somewhere on the patch, but not there: beside ridges that were cut
//! off, and wherever the patch is inclined to the axis, by as much as the patch is far off.

use glam::DVec3;
use lodpack::decode::texels::Map;
use rayon::prelude::*;

use super::projection::projections;
use super::raster::{Drawn, texel_at};
use super::values::Sums;
use super::{BakedPatch, Points, Source};
use crate::stage::certify::{Hint, TriangleBvh};

/// Distance between the points of the source that are looked at, in texels.
const SPACING: f64 = 0.7;
/// No texel.
const NOWHERE: u32 = u32::MAX;

/// Replaces what covered texels show by the mean of the points of the source that lie closest to them and that face the same way; texels to
/// which none is closest stay as they are.
pub(super) fn show_closest(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    source: &mut impl Source,
    sums: &mut Sums<'_>,
) {
    let projections = projections(patch, map);
    let Some(size) = projections.first().map(|projection| projection.size) else { return };
    let positions: Vec<DVec3> = (0..patch.positions.len() as u32).map(|vertex| patch.position(vertex)).collect();
    let normals: Vec<DVec3> = patch
        .triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize]);
            (b - a).cross(c - a)
        })
        .collect();
    let bvh = TriangleBvh::new(&positions, patch.triangles);
    let origin = patch.origin();
    let sources: Vec<[DVec3; 3]> =
        (0..source.triangle_count()).map(|triangle| source.corners(triangle).map(|corner| corner - origin)).collect();
    // Few enough at a time that what is found for them hardly takes memory.
    let mut near = sums.emptied();
    let (mut values, mut known) = (vec![], vec![]);
    for (first, some) in (0..).step_by(CHUNK).zip(sources.chunks(CHUNK)) {
        let find = |corners: &[DVec3; 3]| {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let (rows, area) = rows(*corners, size * SPACING);
            let mut hint = Hint::default();
            let texels: Vec<u32> = rows
                .iter()
                .flat_map(|row| row.weights())
                .map(|weights| {
                    let point: DVec3 = (0..3).map(|k| corners[k] * f64::from(weights[k])).sum();
                    let closest = bvh.closest(point, &mut hint);
                    let is_seen =
                        normals.get(closest.triangle as usize).is_some_and(|of_patch| of_patch.dot(normal) > 0.0);
                    if !is_seen {
                        return NOWHERE;
                    }
                    let projection = &projections[usize::from(map.labels[closest.triangle as usize])];
                    let [column, row] = texel_at(projection.place(closest.point), map.size);
                    let texel = row as usize * map.size[0] as usize + column as usize;
                    if drawn.is_covered[texel] { texel as u32 } else { NOWHERE }
                })
                .collect();
            (rows, texels, area)
        };
        let found: Vec<(Vec<Points>, Vec<u32>, f64)> = some.par_iter().map(find).collect();
        for (triangle, (rows, texels, area)) in (first..).zip(found) {
            if texels.iter().all(|&texel| texel == NOWHERE) {
                continue;
            }
            values.clear();
            source.shade(triangle, &rows, (size * SPACING) as f32, &mut values);
            known.clear();
            let count = values.len() / texels.len().max(1);
            let mut kept = 0;
            for (at, &texel) in texels.iter().enumerate().filter(|(_, texel)| **texel != NOWHERE) {
                known.push(texel);
                values.copy_within(at * count..(at + 1) * count, kept * count);
                kept += 1;
            }
            near.add_all(&known, &values[..kept * count], (area / texels.len() as f64) as f32);
        }
    }
    sums.take_known(&near);
}

/// Triangles of the source that are looked at together.
const CHUNK: usize = 1024;

/// Points of a triangle in rows along its longest side, about as far from one another as asked for, and the area that they stand for.
fn rows(corners: [DVec3; 3], spacing: f64) -> (Vec<Points>, f64) {
    let side = |k: usize| corners[(k + 1) % 3].distance(corners[k]);
    let longest = (0..3).max_by(|&a, &b| side(a).total_cmp(&side(b))).unwrap_or(0);
    let area = 0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
    let length = side(longest);
    if length <= 0.0 || !length.is_finite() {
        return (vec![], 0.0);
    }
    // The conversions saturate.
    let count = (2.0 * area / length / spacing).ceil().max(1.0) as u32;
    let rows = (0..count).map(|row| {
        let up = (f64::from(row) + 0.5) / f64::from(count);
        let columns = (length * (1.0 - up) / spacing).ceil().max(1.0);
        let weights = |along: f64| {
            let mut weights = [0.0; 3];
            weights[longest] = (1.0 - up) * (1.0 - along);
            weights[(longest + 1) % 3] = (1.0 - up) * along;
            weights[(longest + 2) % 3] = up;
            weights
        };
        let (first, second) = (weights(0.5 / columns), weights(1.5 / columns));
        Points { first, growth: [0, 1, 2].map(|k| second[k] - first[k]), count: columns as u32 }
    });
    (rows.collect(), area)
}
