//! Colours along the borders of pieces: the texels on both sides are made to show the same there.
//!
//! A reader interpolates between four texels, and on a border some of them lie beside the patch. What these show is seen nowhere but along the
//! border, so they may have any value. They get those with which the border shows what the source has at it, and so do those of the piece beyond
//! it, in this patch or in its neighbour.

use glam::DVec3;
use lodpack::decode::texels::Map;
use lodpack::write::{Seen, SeenPoint};

use super::gather::barycentric;
use super::pieces::neighbours;
use super::projection::{Projection, projections};
use super::strangers::Strangers;
use super::values::Storage;
use super::{BakedPatch, Points, Source};
use crate::mesh::NONE;
use crate::stage::certify::{Near, TriangleBvh};

/// Points for each texel along a border.
const FINENESS: f64 = 2.0;
/// The most points of an edge.
const MOST_POINTS: f64 = 65_536.0;
/// How far inside of its side a point is looked for, in texels: the source may jump at the border, and each side shows its own.
const INWARDS: f64 = 0.05;
/// And at most this share of the triangle.
const MOST_INWARDS: f64 = 0.3;
/// How often each point is made right: points share texels.
const SWEEPS: usize = 5;
/// How much covered texels change, beside those that nothing else is seen of.
const COVERED: f32 = 0.15;

/// The triangles of a source, to find those that are closest to points.
pub struct Nearest(TriangleBvh);

impl Nearest {
    /// Of all triangles.
    pub fn new(source: &impl Source) -> Self {
        let count = source.triangle_count() as u32;
        let positions: Vec<DVec3> = (0..count as usize).flat_map(|triangle| source.corners(triangle)).collect();
        let triangles: Vec<[u32; 3]> = (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        Self(TriangleBvh::new(&positions, &triangles))
    }
}

/// A point of a border, as a piece beside it shows it.
#[derive(Clone, Copy)]
struct Side {
    piece: u16,
    point: DVec3,
    /// A point of the triangle close to it.
    inside: DVec3,
    place: Place,
}

/// A place between four texels.
#[derive(Clone, Copy)]
struct Place {
    /// The first of them; the others are beside and below it.
    texel: u32,
    right: f32,
    down: f32,
}

impl Place {
    fn new(projection: &Projection, point: DVec3, width: usize) -> Self {
        let place = projection.place(point);
        let [low, high] = projection.range;
        let at = [0, 1].map(|k| place[k].clamp(low[k], high[k]) - 0.5);
        // The conversions saturate.
        let first = [0, 1].map(|k| (at[k] as u32).min((high[k] - 1.5).max(0.0) as u32));
        let [right, down] = [0, 1].map(|k| (at[k] - f64::from(first[k])) as f32);
        Self { texel: first[1] * width as u32 + first[0], right, down }
    }

    /// The four texels with their shares.
    #[inline]
    fn texels(&self, width: usize) -> [(usize, f32); 4] {
        let (first, [left, up]) = (self.texel as usize, [1.0 - self.right, 1.0 - self.down]);
        [
            (first, left * up),
            (first + 1, self.right * up),
            (first + width, left * self.down),
            (first + width + 1, self.right * self.down),
        ]
    }
}

/// Calls a function for points along all edges of a patch beyond which there is another piece, or nothing; with what shows it there.
fn for_each_point(patch: &BakedPatch<'_>, map: &Map, mut visit: impl FnMut(Side, Option<Side>)) {
    let (projections, width) = (projections(patch, map), map.size[0] as usize);
    let Some(size) = projections.first().map(|projection| projection.size) else { return };
    let middle = |triangle: u32| {
        patch.triangles[triangle as usize].iter().map(|&corner| patch.position(corner)).sum::<DVec3>() / 3.0
    };
    for ((number, corners), beside) in (0..).zip(patch.triangles).zip(neighbours(patch.triangles)) {
        for (edge, &other) in beside.iter().enumerate() {
            let other = Some(other).filter(|&other| other != NONE);
            let piece = |triangle: u32| map.labels[triangle as usize];
            // Each edge once.
            if other.is_some_and(|other| other < number || piece(other) == piece(number)) {
                continue;
            }
            let ends = [edge, (edge + 1) % 3].map(|k| patch.position(corners[k]));
            let count = (ends[0].distance(ends[1]) / size * FINENESS).ceil().clamp(1.0, MOST_POINTS) as u32;
            let triangles = [Some(number), other].map(|triangle| triangle.map(|t| (piece(t), middle(t))));
            for k in 0..=count {
                let point = ends[0].lerp(ends[1], f64::from(k) / f64::from(count));
                let side = |(piece, middle): (u16, DVec3)| {
                    let share = (INWARDS * size / point.distance(middle)).min(MOST_INWARDS);
                    let place = Place::new(&projections[usize::from(piece)], point, width);
                    Side { piece, point, inside: point.lerp(middle, share), place }
                };
                if let [Some(this), beyond] = triangles.map(|triangle| triangle.map(side)) {
                    visit(this, beyond);
                }
            }
        }
    }
}

/// Notes all texels that borders are seen with, which triangles that are smaller than texels need not cover.
pub(super) fn use_borders(patch: &BakedPatch<'_>, map: &Map, is_used: &mut [bool]) {
    let width = map.size[0] as usize;
    for_each_point(patch, map, |this, beyond| {
        let texels = [Some(this), beyond].into_iter().flatten().flat_map(|side| side.place.texels(width));
        texels.filter(|(_, share)| *share > 0.0).for_each(|(texel, _)| is_used[texel] = true);
    });
}

/// What is seen of the texels of a map: those that its patch covers, and its borders.
pub(super) fn seen<'a>(patch: &BakedPatch<'_>, map: &Map, is_covered: &'a [bool]) -> Seen<'a> {
    let mut points = vec![];
    for_each_point(patch, map, |this, beyond| {
        points.extend([Some(this), beyond].into_iter().flatten().map(|side| SeenPoint {
            texel: [side.place.texel % map.size[0], side.place.texel / map.size[0]],
            share: [side.place.right, side.place.down],
        }));
    });
    Seen::new(is_covered, map.size, points)
}

/// Texels whose colours without opacity are changed.
pub(super) struct Shown<'a> {
    pub storage: &'a Storage,
    pub values: &'a mut [f32],
    pub is_covered: &'a [bool],
    /// Texels in a row.
    pub width: usize,
}

impl Shown<'_> {
    /// Makes each side of each border show what a source does, of which values are means over a footprint.
    pub fn as_source(
        &mut self,
        patch: &BakedPatch<'_>,
        map: &Map,
        (source, nearest): (&mut impl Source, &Nearest),
        footprint: f64,
    ) {
        let colours = self.storage.opaque_colours();
        if colours.is_empty() || nearest.0.is_empty() {
            return;
        }
        let strangers = Strangers::new(patch, map, &source.areas_beyond());
        let (mut near, mut values) = ([Near::default(); 2], vec![]);
        // Of each colour what each place should show.
        let mut wanted: Vec<Vec<(Place, [f32; 3])>> = vec![vec![]; colours.len()];
        for_each_point(patch, map, |this, beyond| {
            for (side, near) in [Some(this), beyond].into_iter().flatten().zip(&mut near) {
                let triangle = nearest.0.closest_near(side.inside + patch.origin(), near).triangle as usize;
                if strangers.has(usize::from(side.piece), source.area(triangle)) {
                    continue;
                }
                let weights = barycentric(source.corners(triangle), side.point + patch.origin());
                let sum: f64 = weights.iter().sum();
                values.clear();
                source.shade(
                    triangle,
                    &[Points::one(weights.map(|weight| weight / sum))],
                    footprint as f32,
                    &mut values,
                );
                for (wanted, &first) in wanted.iter_mut().zip(&colours) {
                    wanted.push((side.place, [values[first], values[first + 1], values[first + 2]]));
                }
            }
        });
        for (wanted, &first) in wanted.iter().zip(&colours) {
            for _ in 0..SWEEPS {
                wanted.iter().for_each(|&(place, colour)| self.show(place, colour, first));
            }
        }
    }

    /// The colour at a place.
    fn shown(&self, place: Place, first: usize) -> [f32; 3] {
        let stride = self.storage.stride();
        let mut sums = [0.0; 3];
        for (texel, share) in place.texels(self.width) {
            let colour = &self.values[texel * stride + first..][..3];
            (0..3).for_each(|k| sums[k] += share * colour[k]);
        }
        sums
    }

    /// Changes texels so that a place shows a colour, as far as they stay between 0 and 1.
    fn show(&mut self, place: Place, wanted: [f32; 3], first: usize) {
        let (stride, texels) = (self.storage.stride(), place.texels(self.width));
        let shown = self.shown(place, first);
        let gains = texels.map(|(texel, share)| if self.is_covered[texel] { COVERED * share } else { share });
        let sum: f32 = gains.iter().zip(texels).map(|(gain, (_, share))| gain * share).sum();
        let steps: [f32; 3] = std::array::from_fn(|k| (wanted[k] - shown[k]) / sum);
        for ((texel, _), gain) in texels.into_iter().zip(gains).filter(|(_, gain)| *gain > 0.0) {
            let colour = &mut self.values[texel * stride + first..][..3];
            (0..3).for_each(|k| colour[k] = (colour[k] + gain * steps[k]).clamp(0.0, 1.0));
        }
    }
}
