//! Pieces of a map as projections of space.

use glam::DVec3;
use lodpack::decode::texels::{Map, Piece};

use super::BakedPatch;

/// The input is looked for within this multiple of the patch's reach along the axis of a piece, which is inclined to
/// the surface.
const REACH: f64 = 3.0;
/// And within this many texels more.
const REACH_TEXELS: f64 = 1.5;

/// A piece, and what its projection needs. Points are lattice units relative to the patch's first vertex.
pub(super) struct Projection {
    /// Where the origin lies in the image.
    offset: [f64; 2],
    /// With what points are multiplied: for each coordinate in the image, and for the depth along the axis in texels.
    rows: [DVec3; 3],
    /// The axis.
    pub normal: DVec3,
    /// Size of a texel, lattice units: the side of a square of its area.
    pub size: f64,
    /// Its shorter side.
    pub shorter: f64,
    /// The squares of the length and the width of a texel, and of that of a step of depth.
    squares: [f64; 3],
    /// Smallest and largest place that it shows.
    pub range: [[f64; 2]; 2],
    /// Around what may be shown.
    pub bounds: [DVec3; 2],
    /// How far the input is looked for along the axis, in texels.
    pub reach: f32,
}

/// All pieces of a map.
pub(super) fn projections(patch: &BakedPatch<'_>, map: &Map) -> Vec<Projection> {
    let mut all: Vec<Projection> = map.pieces.iter().map(|piece| Projection::new(patch, piece)).collect();
    for (corners, &label) in patch.triangles.iter().zip(&map.labels) {
        let [low, high] = &mut all[usize::from(label)].bounds;
        for &corner in corners {
            let point = patch.position(corner);
            (*low, *high) = (low.min(point), high.max(point));
        }
    }
    for projection in &mut all {
        let margin = DVec3::splat(f64::from(projection.reach) * projection.size);
        projection.bounds = [projection.bounds[0] - margin, projection.bounds[1] + margin];
    }
    all
}

impl Projection {
    fn new(patch: &BakedPatch<'_>, piece: &Piece) -> Self {
        let ([.., normal], size, [length, width]) = (piece.frame(), piece.texel_size(), piece.texel());
        let normal = DVec3::from(normal);
        let [across, down] = piece.across().map(DVec3::from);
        Self {
            offset: piece.unbounded(patch.origin().to_array()),
            rows: [across, down, normal / size],
            normal,
            size,
            shorter: length.min(width),
            squares: [length, width, size].map(|side| side * side),
            range: piece.range(),
            bounds: [DVec3::INFINITY, DVec3::NEG_INFINITY],
            reach: (patch.reach * REACH / size + REACH_TEXELS) as f32,
        }
    }

    /// Whether something within bounds may be shown.
    pub fn touches(&self, [low, high]: [DVec3; 2]) -> bool {
        low.cmple(self.bounds[1]).all() && high.cmpge(self.bounds[0]).all()
    }

    /// The texels of the piece's rectangle, in an image of `width` columns.
    pub fn texels(&self, width: usize) -> impl Iterator<Item = usize> + use<> {
        let [[left, top], [right, bottom]] = self.range.map(|place| place.map(|x| x as usize));
        (top..=bottom).flat_map(move |row| row * width + left..=row * width + right)
    }

    /// Where a point lies in the image.
    #[inline]
    pub fn place(&self, point: DVec3) -> [f64; 2] {
        [0, 1].map(|k| self.rows[k].dot(point) + self.offset[k])
    }

    /// How far a point is along the axis, in texels.
    #[inline]
    pub fn depth(&self, point: DVec3) -> f64 {
        self.rows[2].dot(point)
    }

    /// The point of the patch at a place.
    pub fn point(&self, place: [f64; 2], depth: f64) -> DVec3 {
        self.step([place[0] - self.offset[0], place[1] - self.offset[1]], depth)
    }

    /// The difference of two points, given those of their places and depths.
    pub fn step(&self, place: [f64; 2], depth: f64) -> DVec3 {
        // The rows are at right angles, and as long as the inverses of a texel's sides.
        let steps = [place[0], place[1], depth];
        (0..3).map(|k| self.rows[k] * (steps[k] * self.squares[k])).sum()
    }
}
