//! Texels of what lies closest: where a patch is far from its source, a viewer who looks for a point of the source sees the closest
//! point of the patch, and a texel is off least if it is the mean of all points for which it is seen.
//!
//! A projection along the axis of a piece has each point of the source somewhere on the patch, but not there: beside ridges that were cut
//! off, and wherever the patch is inclined to the axis, by as much as the patch is far off.

use glam::DVec3;
use lodpack::decode::texels::Map;
use rayon::prelude::*;

use super::blocks::{Block, Blocks, Rows};
use super::projection::{Projection, projections};
use super::raster::{Drawn, texel_at};
use super::values::{Storage, Sums};
use super::{BakedPatch, Source};
use crate::certify::{Around, Closest, Hint, TriangleBvh};

/// Distance between the points of the source that are looked at, in texels.
pub(super) const SPACING: f64 = 0.7;
/// Triangles of the source that are looked at together: few enough that what is found for them hardly takes memory.
const CHUNK: usize = 1024;
/// About the most points that they have together, for the same reason.
const POINTS_OF_CHUNK: f64 = 4_194_304.0;
/// Blocks of so few points are not divided.
const FEW: usize = 48;
/// What is at most this many texels beyond a plane may be taken to lie in it.
const SAME_PLANE: f64 = 0.25;
/// No texel.
pub(super) const NOWHERE: u32 = u32::MAX;
/// A flag beside the number of a texel: its triangle faces the other way.
pub(super) const OPPOSITE: u32 = 1 << 31;
/// Weight of a point whose closest triangle faces the other way. A viewer of one side of a sheet does not see the other one, but a judge who asks what is
/// shown close to a point does; and where nothing else is closest to a texel, it shows that.
pub(super) const SHARE_OF_OPPOSITE: f32 = 0.3;

/// The weight of a point.
#[derive(Clone, Copy, Default)]
pub(super) struct Weight {
    pub all: f32,
    /// The weight of its directions.
    pub directions: f32,
}

impl Weight {
    /// The same weight for all and for directions.
    pub fn even(weight: f32) -> Self {
        Self { all: weight, directions: weight }
    }

    /// Both, times a factor.
    pub fn times(self, factor: f32) -> Self {
        Self { all: self.all * factor, directions: self.directions * factor }
    }

    /// That of a point whose closest triangle faces the other way, given how its values are stored.
    pub fn of_opposite(storage: &Storage) -> Self {
        // Directions and measured numbers of the other side say nothing.
        Self { all: if storage.is_look() { SHARE_OF_OPPOSITE } else { 0.0 }, directions: 0.0 }
    }
}

/// In what colours are averaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Means {
    /// In linear light, as it adds up for a viewer who is far away.
    Light,
    /// In square roots of light, which are about what screens encode: for a viewer who is close enough to see two colours in a texel, such a mean
    /// is off least from both.
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

/// Where points of a patch lie in images.
pub(super) trait Places: Sync {
    /// The place of a point of a triangle, which is linear in it.
    fn place(&self, triangle: u32, point: DVec3) -> [f64; 2];

    /// The number of what a triangle shows at a place; [`NOWHERE`] if that is nothing.
    fn number(&self, triangle: u32, place: [f64; 2]) -> u32;

    /// Whether a triangle has places for points of the plane that lie in another one.
    fn are_together(&self, triangle: u32, other: u32) -> bool;
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

    /// The texel of a place in the piece of a triangle: what lies beyond it is taken to its edge, since other pieces lie there.
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
        // Also beside the patch: what lies beyond an edge is closest to a point of it, whose texel may have its middle there.
        if self.drawn.is_used[texel] { texel as u32 } else { NOWHERE }
    }

    fn are_together(&self, triangle: u32, other: u32) -> bool {
        self.map.labels[triangle as usize] == self.map.labels[other as usize]
    }
}

/// What is closest to the points of a block.
pub(super) enum Below {
    /// One triangle: straight above or below it they all lie, or above others that lie in its plane and have their places with it.
    One(u32),
    /// One of these, or any at all.
    Any(Option<Around>),
}

/// A patch in which closest points are looked for.
pub(super) struct Finder<'a, P> {
    pub places: P,
    pub bvh: TriangleBvh,
    positions: Vec<DVec3>,
    triangles: &'a [[u32; 3]],
    /// The normal of each triangle.
    normals: Vec<DVec3>,
    /// In the plane of each triangle, at right angles to each side.
    inwards: Vec<[DVec3; 3]>,
    /// The shortest side of what places count.
    pub size: f64,
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

impl<'a, P: Places> Finder<'a, P> {
    pub fn new(positions: Vec<DVec3>, triangles: &'a [[u32; 3]], places: P, size: f64) -> Self {
        let corners = |corners: &[u32; 3]| corners.map(|corner| positions[corner as usize]);
        let normals: Vec<DVec3> = triangles.iter().map(|triangle| doubled_area(corners(triangle))).collect();
        let inwards = |(triangle, normal): (&[u32; 3], &DVec3)| {
            let corners = corners(triangle);
            [0, 1, 2].map(|k| normal.cross(corners[(k + 1) % 3] - corners[k]))
        };
        Self {
            inwards: triangles.iter().zip(&normals).map(inwards).collect(),
            normals,
            bvh: TriangleBvh::new(&positions, triangles),
            triangles,
            positions,
            places,
            size,
        }
    }

    /// Divides points into blocks until one triangle is closest to all points of a block, or until there are few.
    pub fn divide<B: Blocks>(&self, points: &B, hint: &mut Hint, mut visit: impl FnMut(&B::Block, Below)) {
        let mut open = vec![(points.whole(), None)];
        while let Some((block, known)) = open.pop() {
            let (count, corners) = points.bounds(&block);
            if count == 0 {
                continue;
            }
            let corners = corners.as_ref();
            // What held for more points holds for these.
            if let Some(triangle) = known.as_ref().and_then(|known| self.below(known, corners)) {
                visit(&block, Below::One(triangle));
                continue;
            }
            let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
            let radius = corners.iter().map(|corner| corner.distance_squared(middle)).fold(0.0, f64::max).sqrt();
            let before = known.as_ref().map(Around::count);
            let around = match known {
                Some(around) => Some(self.bvh.narrowed(&around, middle, radius)),
                None => self.bvh.around(middle, radius, hint),
            };
            // The same ones are no closer than they were.
            let is_new = around.as_ref().map(Around::count) != before;
            match around.as_ref().filter(|_| is_new).and_then(|around| self.below(around, corners)) {
                Some(triangle) => visit(&block, Below::One(triangle)),
                None if count > FEW => open.extend(points.halves(block).map(|half| (half, around))),
                None => visit(&block, Below::Any(around)),
            }
        }
    }

    /// The closest point, of some triangles where these are known.
    pub fn closest(&self, around: Option<&Around>, point: DVec3, hint: &mut Hint) -> Closest {
        match around {
            Some(around) => self.bvh.closest_of(around, point),
            None => self.bvh.closest(point, hint),
        }
    }

    /// What is closest to each of the points of a triangle, [`OPPOSITE`] if it faces the other way, and the sum of squares of distances.
    pub fn find(&self, corners: [DVec3; 3], rows: &Rows) -> (Vec<u32>, f64) {
        let (mut texels, mut squares) = (vec![NOWHERE; rows.count()], 0.0);
        let normal = doubled_area(corners);
        let mut hint = Hint::default();
        self.divide(rows, &mut Hint::default(), |block, below| match below {
            Below::One(triangle) => squares += self.add_block(rows, block, triangle, normal, &mut texels),
            Below::Any(around) => {
                for (at, point) in rows.points(block) {
                    let closest = self.closest(around.as_ref(), point, &mut hint);
                    squares += closest.distance * closest.distance;
                    texels[at] = self.texel(closest, normal);
                }
            }
        });
        (texels, squares)
    }

    /// Whether a triangle faces the same way as a normal.
    pub fn faces(&self, triangle: u32, normal: DVec3) -> bool {
        self.normals[triangle as usize].dot(normal) > 0.0
    }

    /// Which side of a triangle faces the same way.
    fn side(&self, triangle: u32, normal: DVec3) -> u32 {
        if self.faces(triangle, normal) { 0 } else { OPPOSITE }
    }

    /// The texel of the point that is closest to a point of a triangle with the given normal.
    fn texel(&self, Closest { point, triangle, .. }: Closest, normal: DVec3) -> u32 {
        match self.triangles.get(triangle as usize) {
            Some(_) => self.number(triangle, self.places.place(triangle, point), self.side(triangle, normal)),
            None => NOWHERE,
        }
    }

    fn number(&self, triangle: u32, place: [f64; 2], side: u32) -> u32 {
        match self.places.number(triangle, place) {
            NOWHERE => NOWHERE,
            number => number | side,
        }
    }

    /// Of some triangles the one that is closest to all points within corners, as far as that is easily seen: they lie straight above it or below it, and
    /// the others lie on the other side of its plane. Where several lie in one plane and have their places together, any of them does.
    fn below(&self, around: &Around, corners: &[DVec3]) -> Option<u32> {
        let numbers = || self.bvh.numbers(around);
        let first = numbers().next()?;
        if around.count() > 1 && numbers().all(|other| self.is_one_sheet(first, other)) {
            return Some(first);
        }
        let is_closest =
            |triangle: u32| numbers().all(|other| other == triangle || self.is_beyond(other, triangle, corners));
        numbers().find(|&triangle| self.is_below(triangle, corners) && is_closest(triangle))
    }

    /// Whether triangles lie in one plane, face the same way, and have their places together.
    fn is_one_sheet(&self, triangle: u32, other: u32) -> bool {
        let normal = self.normals[triangle as usize];
        let [least, most] = self.heights(triangle, &self.corners(other));
        let margin = self.margin(triangle);
        normal != DVec3::ZERO
            && self.places.are_together(triangle, other)
            && self.faces(other, normal)
            && least >= -margin
            && most <= margin
    }

    /// Whether points lie straight above a triangle, or below it.
    fn is_below(&self, triangle: u32, points: &[DVec3]) -> bool {
        let (corners, inwards) = (self.corners(triangle), &self.inwards[triangle as usize]);
        let is_inside = |k: usize| points.iter().all(|&point| (point - corners[k]).dot(inwards[k]) >= 0.0);
        self.normals[triangle as usize] != DVec3::ZERO && (0..3).all(is_inside)
    }

    /// Whether a triangle is farther than another one from points straight above that or below it, since it lies on the other side of its plane.
    fn is_beyond(&self, other: u32, triangle: u32, points: &[DVec3]) -> bool {
        let ([low, high], [least, most]) =
            (self.heights(triangle, points), self.heights(triangle, &self.corners(other)));
        let margin = self.margin(triangle);
        (high <= 0.0 || most <= margin) && (low >= 0.0 || least >= -margin)
    }

    /// The least and the largest height of points over the plane of a triangle, times twice its area.
    fn heights(&self, triangle: u32, points: &[DVec3]) -> [f64; 2] {
        let (corner, normal) = (self.corners(triangle)[0], self.normals[triangle as usize]);
        let heights = points.iter().map(|&point| (point - corner).dot(normal));
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
    }

    /// How high points may be that are taken to lie in the plane of a triangle, times twice its area.
    fn margin(&self, triangle: u32) -> f64 {
        SAME_PLANE * self.size * self.normals[triangle as usize].length()
    }

    /// Where the point of a triangle's plane lies that is closest to a point.
    pub fn foot(&self, triangle: u32, point: DVec3) -> [f64; 2] {
        let (normal, corner) = (self.normals[triangle as usize], self.corners(triangle)[0]);
        self.places.place(triangle, point - normal * (normal.dot(point - corner) / normal.length_squared()))
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|corner| self.positions[corner as usize])
    }

    /// Notes the texels of a block of points to all of which one triangle is closest ([`Below::One`]): points of a row are evenly spaced.
    /// Returns the sum of squares of their distances.
    fn add_block(&self, rows: &Rows, block: &Block, triangle: u32, of_source: DVec3, texels: &mut [u32]) -> f64 {
        let side = self.side(triangle, of_source);
        let (corner, up) = (self.corners(triangle)[0], self.normals[triangle as usize].normalize_or_zero());
        let mut squares = 0.0;
        for (first, points, count) in rows.in_rows(block) {
            let [height, next] = points.map(|point| (point - corner).dot(up));
            squares += squares_of_row(height, next - height, count as f64);
            let [start, next] = points.map(|point| self.foot(triangle, point));
            for (k, texel) in texels[first..first + count].iter_mut().enumerate() {
                let place = [0, 1].map(|axis| start[axis] + k as f64 * (next[axis] - start[axis]));
                *texel = self.number(triangle, place, side);
            }
        }
        squares
    }
}

/// The sum of squares of `count` numbers, each of which is larger than the one before by the same step.
fn squares_of_row(first: f64, growth: f64, count: f64) -> f64 {
    let last = count - 1.0;
    count * (first * first + first * growth * last + growth * growth * last * (2.0 * last + 1.0) / 6.0)
}

/// Twice the area of a triangle, as a vector along its normal.
pub(super) fn doubled_area([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
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

    #[test]
    fn squares_of_a_row_are_those_of_its_numbers() {
        for (first, growth, count) in [(3.0, -0.7, 9), (-2.0, 0.0, 4), (5.0, 1.0, 1)] {
            let each = (0..count).map(|k| first + growth * f64::from(k));
            let wanted: f64 = each.map(|number| number * number).sum();
            assert!((squares_of_row(first, growth, f64::from(count)) - wanted).abs() < 1e-9);
        }
    }
}
