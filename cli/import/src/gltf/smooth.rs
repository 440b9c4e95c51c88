//! Whether normals of vertices say what triangles do not: models of few triangles are shaded as if they were round.

use glam::DVec3;

use super::accessor::{read_normals, read_positions};
use super::arrays::Arrays;
use super::document::Semantic;
use crate::source::Source;

/// From this mean angle on, in degrees, normals are worth their bytes. Scans have a few degrees of noise, and triangles
/// so small that nobody sees it.
const LEAST_ANGLE: f64 = 8.0;
/// Primitives of more vertices are dense. This many are read before anything else is, too.
const MOST_VERTICES: usize = 1 << 16;
const MOST_VERTICES_IN_ALL: usize = 1 << 20;

/// Whether the normals of lit primitives of few vertices are far from those of their triangles, on average over their
/// area. Of each primitive: how many vertices it says to have, and what reads it, which those of too many are not asked
/// for.
pub(super) fn are_smooth<'a, R: FnOnce() -> Option<Arrays<'a>>>(
    source: &Source,
    primitives: impl Iterator<Item = (usize, R)>,
) -> bool {
    let (mut sum, mut area, mut left) = (0.0, 0.0, MOST_VERTICES_IN_ALL);
    for (stated, read) in primitives {
        if stated > MOST_VERTICES.min(left) {
            continue;
        }
        let Some(arrays) = read() else { continue };
        let count = arrays.get(Semantic::Position).map_or(usize::MAX, |array| array.count());
        if count > MOST_VERTICES || count > left {
            continue;
        }
        left -= count;
        if let Some([angles, areas]) = angles_of(source, &arrays) {
            sum += angles;
            area += areas;
        }
    }
    area > 0.0 && sum / area > LEAST_ANGLE.to_radians()
}

/// The angles between the normals of corners and of triangles times the areas of these, and the areas; none where
/// anything cannot be read, which the import itself will say.
fn angles_of(source: &Source, arrays: &Arrays) -> Option<[f64; 2]> {
    let normals = read_normals(source, &arrays.get(Semantic::Normal)?).ok()?;
    let normals: Vec<DVec3> = normals.map(|normal| DVec3::from_array(normal.map(f64::from))).collect();
    let positions: Vec<DVec3> = read_positions(source, &arrays.get(Semantic::Position)?).ok()?.collect();
    let indices = arrays.all_indices(source, positions.len(), 6 * MOST_VERTICES).ok()??;
    let mut sums = [0.0; 2];
    for triangle in indices.as_chunks::<3>().0 {
        let at = |corner: u32| Some((*positions.get(corner as usize)?, *normals.get(corner as usize)?));
        let corners = [at(triangle[0])?, at(triangle[1])?, at(triangle[2])?];
        let face = (corners[1].0 - corners[0].0).cross(corners[2].0 - corners[0].0);
        let area = 0.5 * face.length();
        if !(area > 0.0 && area.is_finite()) {
            continue;
        }
        for (_, normal) in corners {
            let cosine = (face.dot(normal) / (2.0 * area * normal.length())).clamp(-1.0, 1.0);
            if cosine.is_finite() {
                sums[0] += area / 3.0 * libm::acos(cosine);
            }
        }
        sums[1] += area;
    }
    Some(sums)
}
