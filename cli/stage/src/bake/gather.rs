//! Collects for each texel what the input shows there.

use std::ops::Range;

use glam::{DVec3, Vec3A};
use lodpack::decode::texels::Map;

use super::projection::{Projection, projections};
use super::raster::{Drawn, Span, for_each_span, texel_at};
use super::strangers::Strangers;
use super::values::{Sums, Weight};
use super::{BakedPatch, Points, Source};
use crate::certify::{Hint, TriangleBvh};

/// Triangles shorter than this many texels are sampled at four points of each texel.
const SHORT: f64 = 4.0;
/// Covered texels for each that may be missing.
const FEW: usize = 50;

/// Adds to texels what the triangles of a source show there; not to those that are `taken`, of which there may be none.
pub(super) fn gather<'s>(
    patch: &BakedPatch<'_>,
    map: &Map,
    (drawn, taken): (&Drawn, &[bool]),
    source: &mut impl Source,
    mut sums: Sums<'s>,
) -> Sums<'s> {
    let (pieces, strangers) = (projections(patch, map), Strangers::new(patch, map, &source.areas_beyond()));
    let mut samples = Samples::default();
    for triangle in 0..source.triangle_count() {
        let corners = source.corners(triangle).map(|corner| corner - patch.origin());
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let low = corners[0].min(corners[1]).min(corners[2]);
        let high = corners[0].max(corners[1]).max(corners[2]);
        for (piece, projection) in pieces.iter().enumerate() {
            let is_wanted = normal.dot(projection.normal) > 0.0 && projection.touches([low, high]);
            if is_wanted && !strangers.has(piece, source.area(triangle)) {
                samples.find(projection, corners, map, (drawn, taken));
                samples.add_to(&mut sums, triangle, source);
            }
        }
    }
    add_closest(map, drawn, (&pieces, &strangers), patch, source, &mut sums);
    sums
}

/// Points of a triangle, each on a texel.
#[derive(Default)]
struct Samples {
    texels: Vec<u32>,
    points: Vec<Points>,
    /// The weight of each of them.
    weight: f32,
    /// What they stand for, lattice units.
    footprint: f64,
    values: Vec<f32>,
}

impl Samples {
    /// Adds their values, and forgets them.
    fn add_to(&mut self, sums: &mut Sums<'_>, triangle: usize, source: &mut impl Source) {
        if !self.points.is_empty() {
            source.shade(triangle, &self.points, self.footprint as f32, &mut self.values);
            sums.add_all(&self.texels, &self.values, Weight::even(self.weight));
        }
        self.texels.clear();
        self.points.clear();
        self.values.clear();
    }

    /// Adds those points of a span, of texels or their quarters, that lie within a piece and near to the patch.
    fn add_span(&mut self, span: &Span, depths: [f64; 3], fineness: u32, shown: &Shown<'_>) {
        let [[left, top], [right, bottom]] = shown.range;
        let row = span.row >> fineness;
        if row < top || row > bottom {
            return;
        }
        let (depth, first) = (span.values(depths), row as usize * shown.width);
        let columns = span.columns.start.max(left << fineness)..span.columns.end.min((right + 1) << fineness);
        let mut start = columns.start;
        for column in columns.clone() {
            let texel = first + (column >> fineness) as usize;
            if shown.has(texel, depth.at(column)) {
                self.texels.push(texel as u32);
            } else {
                self.add_points(span, start..column);
                start = column + 1;
            }
        }
        self.add_points(span, start..columns.end);
    }

    fn add_points(&mut self, span: &Span, columns: Range<u32>) {
        if !columns.is_empty() {
            self.points.push(span.points(columns));
        }
    }

    /// Finds the texels that a triangle of the source covers.
    fn find(&mut self, projection: &Projection, corners: [DVec3; 3], map: &Map, (drawn, taken): (&Drawn, &[bool])) {
        let mut places = corners.map(|corner| projection.place(corner));
        let mut depths = corners.map(|corner| projection.depth(corner));
        let [low, high] = projection.range;
        let least = [0, 1].map(|k| places[0][k].min(places[1][k]).min(places[2][k]));
        let most = [0, 1].map(|k| places[0][k].max(places[1][k]).max(places[2][k]));
        if (0..2).any(|k| most[k] < low[k] - 0.5 || least[k] > high[k] + 0.5) {
            return;
        }
        for k in 0..3 {
            if (0..2).all(|axis| low[axis] - 0.5 <= places[k][axis] && places[k][axis] < high[axis] + 0.5) {
                let point = Vec3A::new(places[k][0] as f32, places[k][1] as f32, depths[k] as f32);
                let closest =
                    drawn.closest(point, texel_at(places[k], map.size), map.size[0] as usize, projection.reach);
                let step = (closest - point).as_dvec3();
                (places[k], depths[k]) = ([places[k][0] + step.x, places[k][1] + step.y], depths[k] + step.z);
            }
        }
        let (width, range) = (map.size[0] as usize, projection.range.map(|place| place.map(|x| x as u32)));
        let shown = Shown { drawn, taken, width, range, reach: projection.reach };
        let length = (most[0] - least[0]).max(most[1] - least[1]);
        if length < 1.0 {
            let middle = [0, 1].map(|k| (places[0][k] + places[1][k] + places[2][k]) / 3.0);
            let depth = (depths[0] + depths[1] + depths[2]) / 3.0;
            let [a, b, c] = places;
            let area = 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
            if (0..2).all(|k| low[k] - 0.5 <= middle[k] && middle[k] < high[k] + 0.5) && area > 0.0 {
                let [column, row] = texel_at(middle, map.size);
                let texel = row as usize * width + column as usize;
                if shown.has(texel, depth) {
                    self.texels.push(texel as u32);
                    self.points.push(Points::one([1.0 / 3.0; 3]));
                }
            }
            (self.weight, self.footprint) = (area as f32, length * projection.size);
            return;
        }
        let fineness = u32::from(length < SHORT);
        for_each_span(places, map.size, fineness, |span| self.add_span(&span, depths, fineness, &shown));
        (self.weight, self.footprint) = match fineness {
            0 => (1.0, projection.size),
            _ => (0.25, 0.5 * projection.size),
        };
    }
}

/// The texels of a piece, and how far from the patch the source may be there.
struct Shown<'a> {
    drawn: &'a Drawn,
    /// Texels that have values already.
    taken: &'a [bool],
    /// Texels in a row of the image.
    width: usize,
    /// First and last column and row.
    range: [[u32; 2]; 2],
    reach: f32,
}

impl Shown<'_> {
    /// Whether a texel shows a source at this depth.
    #[inline]
    fn has(&self, texel: usize, depth: f64) -> bool {
        // Comparisons with NaN are false.
        (self.drawn.depth[texel] - depth as f32).abs() <= self.reach
            && !self.taken.get(texel).is_some_and(|&taken| taken)
    }
}

/// Gives texels to which nothing was projected the values of the input's closest point: see [`open_texels`].
fn add_closest(
    map: &Map,
    drawn: &Drawn,
    (pieces, strangers): (&[Projection], &Strangers),
    patch: &BakedPatch<'_>,
    source: &mut impl Source,
    sums: &mut Sums<'_>,
) {
    let open = open_texels(map, drawn, pieces, sums);
    if open.is_empty() || source.triangle_count() == 0 {
        return;
    }
    let width = map.size[0] as usize;
    let positions: Vec<DVec3> = (0..source.triangle_count()).flat_map(|triangle| source.corners(triangle)).collect();
    let triangles: Vec<[u32; 3]> = (0..source.triangle_count() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let bvh = TriangleBvh::new(&positions, &triangles);
    let (mut hint, mut values) = (Hint::default(), vec![]);
    for (piece, texel) in open {
        let (projection, place) = (&pieces[piece], [texel % width, texel / width].map(|x| x as f64 + 0.5));
        let point = patch.origin() + projection.point(place, f64::from(drawn.depth[texel]));
        let closest = bvh.closest(point, &mut hint);
        if strangers.has(piece, source.area(closest.triangle as usize)) {
            continue;
        }
        let weights = barycentric(source.corners(closest.triangle as usize), closest.point);
        values.clear();
        source.shade(closest.triangle as usize, &[Points::one(weights)], projection.size as f32, &mut values);
        sums.add_all(&[texel as u32], &values, Weight::even(1.0));
    }
}

/// Texels that need a value, each with its piece: those that are covered, unless they are few, and all of pieces to
/// which nothing was projected, as happens where a sliver covers no texel's middle or faces the other way. What lies
/// around such a piece may be far away.
fn open_texels(map: &Map, drawn: &Drawn, pieces: &[Projection], sums: &Sums<'_>) -> Vec<(usize, usize)> {
    let is_bare = |texel: usize| drawn.is_covered[texel] && !sums.has(texel);
    let covered = drawn.is_covered.iter().filter(|&&covered| covered).count();
    let bare = (0..drawn.depth.len()).filter(|&texel| is_bare(texel)).count();
    // Neighbours serve where few are missing.
    let are_many = bare > covered / FEW;
    let width = map.size[0] as usize;
    let mut open = vec![];
    for (piece, projection) in pieces.iter().enumerate() {
        let texels = || projection.texels(width);
        if !texels().any(|texel| sums.has(texel)) {
            let has_place = |texel: &usize| drawn.is_used[*texel] && drawn.depth[*texel].is_finite();
            open.extend(texels().filter(has_place).map(|texel| (piece, texel)));
        } else if are_many {
            open.extend(texels().filter(|&texel| is_bare(texel)).map(|texel| (piece, texel)));
        }
    }
    open
}

/// The weights of the corners of a triangle at a point of it.
pub fn barycentric([a, b, c]: [DVec3; 3], point: DVec3) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let squared = normal.length_squared();
    if squared <= 0.0 || squared.is_nan() {
        return [1.0, 0.0, 0.0];
    }
    let of_b = (point - a).cross(c - a).dot(normal) / squared;
    let of_c = (b - a).cross(point - a).dot(normal) / squared;
    let [of_b, of_c] = [of_b.clamp(0.0, 1.0), of_c.clamp(0.0, 1.0)];
    [(1.0 - of_b - of_c).max(0.0), of_b, of_c]
}
