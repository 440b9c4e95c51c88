//! Looks for the closest points of a patch, for blocks of points at once.

use glam::DVec3;

use super::rows::{Block, Blocks, Rows, doubled_area};
use crate::certify::{Around, Closest, Hint, TriangleBvh};

/// Blocks of so few points are not divided.
const FEW: usize = 48;
/// What is at most this many texels beyond a plane may be taken to lie in it.
const SAME_PLANE: f64 = 0.25;
/// No texel.
pub const NOWHERE: u32 = u32::MAX;
/// A flag beside the number of a texel: its triangle faces the other way.
pub const OPPOSITE: u32 = 1 << 31;
/// Weight of a point whose closest triangle faces the other way. A viewer of one side of a sheet does not see the other
/// one, but a judge who asks what is shown close to a point does; and where nothing else is closest to a texel, it
/// shows that.
pub const SHARE_OF_OPPOSITE: f32 = 0.3;

/// Where points of a patch lie in images.
pub trait Places: Sync {
    /// The place of a point of a triangle, which is linear in it.
    fn place(&self, triangle: u32, point: DVec3) -> [f64; 2];

    /// The number of what a triangle shows at a place; [`NOWHERE`] if that is nothing.
    fn number(&self, triangle: u32, place: [f64; 2]) -> u32;

    /// Whether a triangle has places for points of the plane that lie in another one.
    fn are_together(&self, triangle: u32, other: u32) -> bool;
}

/// What is closest to the points of a block.
pub enum Below {
    /// One triangle: straight above or below it they all lie, or above others that lie in its plane and have their
    /// places with it.
    One(u32),
    /// One of these, or any at all.
    Any(Option<Around>),
}

/// A patch in which closest points are looked for.
pub struct Finder<'a, P> {
    /// Where on images its points are.
    pub places: P,
    /// Its triangles.
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

impl<'a, P: Places> Finder<'a, P> {
    /// `size` is the shortest side of what places count.
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

    /// What is closest to each of the points of a triangle, [`OPPOSITE`] if it faces the other way, and the sum of
    /// squares of distances.
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

    /// Of some triangles the one that is closest to all points within corners, as far as that is easily seen: they lie
    /// straight above it or below it, and the others lie on the other side of its plane. Where several lie in one plane
    /// and have their places together, any of them does.
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

    /// Whether a triangle is farther than another one from points straight above that or below it, since it lies on the
    /// other side of its plane.
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

    /// Notes the texels of a block of points to all of which one triangle is closest ([`Below::One`]): points of a row
    /// are evenly spaced. Returns the sum of squares of their distances.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_of_a_row_are_those_of_its_numbers() {
        for (first, growth, count) in [(3.0, -0.7, 9), (-2.0, 0.0, 4), (5.0, 1.0, 1)] {
            let each = (0..count).map(|k| first + growth * f64::from(k));
            let wanted: f64 = each.map(|number| number * number).sum();
            assert!((squares_of_row(first, growth, f64::from(count)) - wanted).abs() < 1e-9);
        }
    }
}
