//! Texels of what lies closest: where a patch is far from its source, who looks for a point of the source sees the point of the patch that is
//! closest to it, and a texel that is the mean of all points for which it is seen is off least.
//!
//! A projection along the axis of a piece has each point of the source somewhere on the patch, but not there: beside ridges that were cut
//! off, and wherever the patch is inclined to the axis, by as much as the patch is far off.

use glam::DVec3;
use lodpack::decode::texels::Map;
use rayon::prelude::*;

use super::projection::{Projection, projections};
use super::raster::{Drawn, texel_at};
use super::values::Sums;
use super::{BakedPatch, Points, Source};
use crate::stage::certify::{Closest, Near, TriangleBvh};

/// Distance between the points of the source that are looked at, in texels.
const SPACING: f64 = 0.7;
/// Triangles of the source that are looked at together: few enough that what is found for them hardly takes memory.
const CHUNK: usize = 1024;
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
    let mut near = sums.emptied();
    let finder = Finder::new(patch, map, drawn);
    let origin = patch.origin();
    let sources: Vec<[DVec3; 3]> =
        (0..source.triangle_count()).map(|triangle| source.corners(triangle).map(|corner| corner - origin)).collect();
    let mut values = vec![];
    for (first, some) in (0..).step_by(CHUNK).zip(sources.chunks(CHUNK)) {
        let found: Vec<Found> = some.par_iter().map(|&corners| finder.find(corners)).collect();
        for (triangle, Found { rows, mut texels, area }) in (first..).zip(found) {
            if texels.iter().all(|&texel| texel == NOWHERE) {
                continue;
            }
            let weight = (area / texels.len() as f64) as f32;
            values.clear();
            source.shade(triangle, &rows, (finder.size * SPACING) as f32, &mut values);
            keep_found(&mut texels, &mut values, sums.storage.count());
            near.add_all(&texels, &values, weight);
        }
    }
    sums.take_known(&near);
}

/// Drops the values of points that are nowhere.
fn keep_found(texels: &mut Vec<u32>, values: &mut Vec<f32>, count: usize) {
    let mut kept = 0;
    for at in 0..texels.len() {
        if texels[at] != NOWHERE {
            texels[kept] = texels[at];
            values.copy_within(at * count..(at + 1) * count, kept * count);
            kept += 1;
        }
    }
    texels.truncate(kept);
    values.truncate(kept * count);
}

/// The points of a triangle of the source, and the texels of the patch that are closest to them.
struct Found {
    rows: Vec<Points>,
    texels: Vec<u32>,
    /// What all points stand for.
    area: f64,
}

/// A patch in which closest points are looked for.
struct Finder<'a> {
    map: &'a Map,
    drawn: &'a Drawn,
    projections: Vec<Projection>,
    bvh: TriangleBvh,
    /// Of each triangle.
    normals: Vec<DVec3>,
    /// The size of a texel.
    size: f64,
}

impl<'a> Finder<'a> {
    fn new(patch: &BakedPatch<'_>, map: &'a Map, drawn: &'a Drawn) -> Self {
        let projections = projections(patch, map);
        let positions: Vec<DVec3> = (0..patch.positions.len() as u32).map(|vertex| patch.position(vertex)).collect();
        let normal = |corners: &[u32; 3]| doubled_area(corners.map(|corner| positions[corner as usize]));
        Self {
            normals: patch.triangles.iter().map(normal).collect(),
            bvh: TriangleBvh::new(&positions, patch.triangles),
            size: projections.first().map_or(1.0, |projection| projection.size),
            projections,
            map,
            drawn,
        }
    }

    fn find(&self, corners: [DVec3; 3]) -> Found {
        let normal = doubled_area(corners);
        let (rows, area) = rows(corners, self.size * SPACING);
        let mut near = Near::default();
        let texel = |weights: [f32; 3]| {
            let point: DVec3 = (0..3).map(|k| corners[k] * f64::from(weights[k])).sum();
            let Closest { point, triangle, .. } = self.bvh.closest_near(point, &mut near);
            // Nobody looks at both sides of a sheet at once.
            if self.normals.get(triangle as usize).is_none_or(|of_patch| of_patch.dot(normal) <= 0.0) {
                return NOWHERE;
            }
            let projection = &self.projections[usize::from(self.map.labels[triangle as usize])];
            let [column, row] = texel_at(projection.place(point), self.map.size);
            let texel = row as usize * self.map.size[0] as usize + column as usize;
            if self.drawn.is_covered[texel] { texel as u32 } else { NOWHERE }
        };
        let texels = rows.iter().flat_map(|row| row.weights()).map(texel).collect();
        Found { rows, texels, area }
    }
}

/// Twice the area of a triangle, as a vector along its normal.
fn doubled_area([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Points of a triangle in rows along its longest side, about as far from one another as asked for, and the area that they stand for.
fn rows(corners: [DVec3; 3], spacing: f64) -> (Vec<Points>, f64) {
    let side = |k: usize| corners[(k + 1) % 3].distance(corners[k]);
    let longest = (0..3).max_by(|&a, &b| side(a).total_cmp(&side(b))).unwrap_or(0);
    let area = 0.5 * doubled_area(corners).length();
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
