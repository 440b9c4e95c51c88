//! Texels of what lies closest: where a patch is far from its source, a viewer who looks for a point of the source sees
//! the closest point of the patch, and a texel is off least if it is the mean of all points for which it is seen.
//!
//! A projection along the axis of a piece has each point of the source somewhere on the patch, but not there: beside
//! ridges that were cut off, and wherever the patch is inclined to the axis, by as much as the patch is far off.

use glam::DVec3;
use lodpack::decode::texels::Map;
use rayon::prelude::*;

use super::projection::{Projection, projections};
use super::raster::{Drawn, texel_at};
use super::values::{Sums, Weight};
use super::{BakedPatch, Source};
use crate::nearest::{Finder, NOWHERE, OPPOSITE, Places, Rows, SPACING, doubled_area};

/// Triangles of the source that are looked at together: few enough that what is found for them hardly takes memory.
const CHUNK: usize = 1024;
/// About the most points that they have together, for the same reason.
const POINTS_OF_CHUNK: f64 = 4_194_304.0;

/// In what colours are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Means {
    /// In linear light, as it adds up for a viewer who is far away.
    Light,
    /// In square roots of light, which are about what screens encode: for a viewer who is close enough to see two
    /// colours in a texel, such a mean is off least from both.
    Roots,
}

/// Adds points of the source to the texels that are closest to them. Says of each texel whether it got any.
pub(super) fn show_closest(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    source: &mut impl Source,
    sums: &mut Sums<'_>,
    means: Means,
) -> Vec<bool> {
    let finder = Finder::on_map(patch, map, drawn);
    let size = finder.size;
    let mut is_seen = vec![false; drawn.depth.len()];
    let sides = [(0, Weight::even(1.0)), (OPPOSITE, Weight::of_opposite(sums.storage))];
    let (mut of_side, mut values_of_side) = (vec![], vec![]);
    let origin = patch.origin();
    let sources: Vec<[DVec3; 3]> =
        (0..source.triangle_count()).map(|triangle| source.corners(triangle).map(|corner| corner - origin)).collect();
    let mut values = vec![];
    let mut next = 0;
    while next < sources.len() {
        let first = next;
        next += chunk(&sources[first..], size * SPACING);
        let find = |&corners: &[DVec3; 3]| {
            let rows = Rows::new(corners, size * SPACING);
            let (texels, _) = finder.find(corners, &rows);
            (rows, texels)
        };
        let found: Vec<(Rows, Vec<u32>)> = sources[first..next].par_iter().map(find).collect();
        for (triangle, (Rows { rows, area, .. }, texels)) in (first..).zip(found) {
            if texels.iter().all(|&texel| texel == NOWHERE) {
                continue;
            }
            // In texels, as what is projected.
            let weight = (area / texels.len() as f64 / (size * size)) as f32;
            values.clear();
            source.shade(triangle, &rows, (size * SPACING) as f32, &mut values);
            if means == Means::Roots {
                sums.storage.take_roots(&mut values);
            }
            for (side, share) in sides.into_iter().filter(|(_, share)| share.all > 0.0) {
                of_side.clear();
                values_of_side.clear();
                for (&texel, values) in texels.iter().zip(values.chunks_exact(sums.storage.count())) {
                    if texel != NOWHERE && texel & OPPOSITE == side {
                        of_side.push(texel & !OPPOSITE);
                        values_of_side.extend_from_slice(values);
                    }
                }
                sums.add_all(&of_side, &values_of_side, share.times(weight));
                of_side.iter().for_each(|&texel| is_seen[texel as usize] = true);
            }
        }
    }
    if means == Means::Roots {
        sums.square_means();
    }
    is_seen
}

/// How many of some triangles are looked at together, given the spacing of their points.
fn chunk(triangles: &[[DVec3; 3]], spacing: f64) -> usize {
    let mut points = 0.0;
    let has_room = |corners: &&[DVec3; 3]| {
        points += 0.5 * doubled_area(**corners).length() / (spacing * spacing);
        points <= POINTS_OF_CHUNK
    };
    triangles.iter().take(CHUNK).take_while(has_room).count().max(1)
}

/// The texels of a map.
pub(super) struct OnMap<'a> {
    pub map: &'a Map,
    pub drawn: &'a Drawn,
    projections: Vec<Projection>,
}

impl OnMap<'_> {
    /// The size of the smallest texels.
    pub fn least_size(&self) -> f64 {
        self.projections.iter().map(|projection| projection.size).fold(f64::INFINITY, f64::min)
    }

    /// The least and the greatest place that the piece of a triangle shows.
    pub fn range(&self, triangle: u32) -> [[f64; 2]; 2] {
        self.projections[usize::from(self.map.labels[triangle as usize])].range
    }

    /// The texel of a place in the piece of a triangle: what lies beyond it is taken to its edge, since other pieces
    /// lie there.
    fn texel(&self, triangle: u32, place: [f64; 2]) -> usize {
        let [low, high] = self.range(triangle);
        let [column, row] = texel_at([0, 1].map(|k| place[k].clamp(low[k], high[k])), self.map.size);
        row as usize * self.map.size[0] as usize + column as usize
    }
}

impl Places for OnMap<'_> {
    fn place(&self, triangle: u32, point: DVec3) -> [f64; 2] {
        self.projections[usize::from(self.map.labels[triangle as usize])].place(point)
    }

    fn number(&self, triangle: u32, place: [f64; 2]) -> u32 {
        let texel = self.texel(triangle, place);
        // Also beside the patch: what lies beyond an edge is closest to a point of it, whose texel may have its middle
        // there.
        if self.drawn.is_used[texel] { texel as u32 } else { NOWHERE }
    }

    fn are_together(&self, triangle: u32, other: u32) -> bool {
        self.map.labels[triangle as usize] == self.map.labels[other as usize]
    }
}

impl<'a> Finder<'a, OnMap<'a>> {
    /// The texels of a map.
    pub fn on_map(patch: &BakedPatch<'a>, map: &'a Map, drawn: &'a Drawn) -> Self {
        let positions = (0..patch.positions.len() as u32).map(|vertex| patch.position(vertex)).collect();
        let places = OnMap { map, drawn, projections: projections(patch, map) };
        let size = places.projections.iter().map(|projection| projection.shorter).fold(f64::INFINITY, f64::min);
        Self::new(positions, patch.triangles, places, size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_points_are_looked_at_together_and_every_triangle_is() {
        let of_side = |side: f64| [DVec3::ZERO, DVec3::X * side, DVec3::Y * side];
        // Half a million points each.
        let many = vec![of_side(1000.0); 20];
        assert_eq!(chunk(&many, 1.0), 8);
        assert_eq!(chunk(&many, 0.5), 2);
        // More than there may be, none, and no number at all.
        assert_eq!(chunk(&many, 0.1), 1);
        assert_eq!(chunk(&[of_side(0.0); 3], 1.0), 3);
        assert_eq!(chunk(&[of_side(f64::NAN); 3], 1.0), 1);
        assert_eq!(chunk(&vec![of_side(1.0); 2000], 1.0), CHUNK);
    }
}
