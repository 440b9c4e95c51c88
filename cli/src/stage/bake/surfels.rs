//! Texels as points of the surface: images of coarser patches are made of them, as they were before they were quantised.

use glam::{DVec3, Vec3};
use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::fill::finished;
use super::projection::{Projection, projections};
use super::raster::Drawn;
use super::strangers::Strangers;
use super::values::{Storage, Sums};

/// Cosine of the angle to an axis beyond which points of finer patches are not shown by a piece.
const STEEP: f64 = 0.1;
/// Texels along each side of a run.
const SIDE: usize = 16;

/// Texels of a piece that lie together.
#[derive(Clone, Debug, Default)]
pub struct Surfels {
    /// To which points are relative, lattice units.
    origin: DVec3,
    /// Smallest and largest point.
    bounds: [DVec3; 2],
    /// The axis of the piece.
    normal: DVec3,
    /// The area of a texel.
    area: f32,
    points: Vec<Vec3>,
    /// Of each point all values.
    values: Vec<f32>,
    /// Of each point its area; empty if colours jump nowhere.
    areas: Vec<u32>,
}

/// The covered texels of a patch.
pub(super) fn surfels(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    values: &[f32],
    storage: &Storage,
) -> Vec<Surfels> {
    let mut all = vec![];
    for projection in projections(patch, map) {
        let [left, top] = projection.range[0].map(|x| x as usize);
        let [right, bottom] = projection.range[1].map(|x| x as usize);
        for y in (top..=bottom).step_by(SIDE) {
            for x in (left..=right).step_by(SIDE) {
                let texels = [x, y, (x + SIDE - 1).min(right), (y + SIDE - 1).min(bottom)];
                let run = run(&projection, texels, map.size[0] as usize, drawn, values, storage.count());
                all.extend(run.map(|run| Surfels {
                    origin: run.origin + patch.origin(),
                    bounds: run.bounds.map(|corner| corner + patch.origin()),
                    ..run
                }));
            }
        }
    }
    all
}

/// The covered texels of a rectangle, relative to the origin of the projection. None without any.
fn run(
    projection: &Projection,
    [left, top, right, bottom]: [usize; 4],
    width: usize,
    drawn: &Drawn,
    values: &[f32],
    count: usize,
) -> Option<Surfels> {
    let area = (projection.size * projection.size) as f32;
    let mut run = Surfels { normal: projection.normal, area, ..Surfels::default() };
    run.bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for y in top..=bottom {
        for x in left..=right {
            let texel = y * width + x;
            if !drawn.is_covered[texel] {
                continue;
            }
            let point = projection.point([x as f64 + 0.5, y as f64 + 0.5], f64::from(drawn.depth[texel]));
            if run.points.is_empty() {
                run.points.reserve_exact(SIDE * SIDE);
                run.values.reserve_exact(SIDE * SIDE * count);
                run.origin = point;
            }
            run.bounds = [run.bounds[0].min(point), run.bounds[1].max(point)];
            run.points.push((point - run.origin).as_vec3());
            run.values.extend(&values[texel * count..][..count]);
            run.areas.extend(drawn.areas.get(texel));
        }
    }
    (!run.points.is_empty()).then_some(run)
}

/// How deep a patch lies in each tile of its map, so that points which lie elsewhere are passed over together: of all points that are near a
/// piece, most belong to another one.
struct Tiles {
    columns: usize,
    /// Smallest and largest depth, as far as the triangle of a texel reaches in it; the larger one first where there is none.
    depths: Vec<[f32; 2]>,
}

impl Tiles {
    /// Texels along each side of a tile.
    const SIDE: usize = 8;
    /// More than single precision is wrong, in texels.
    const MARGIN: f64 = 0.5;

    fn new(drawn: &Drawn, width: usize) -> Self {
        let columns = width.div_ceil(Self::SIDE);
        let rows = (drawn.depth.len() / width.max(1)).div_ceil(Self::SIDE);
        let mut depths = vec![[f32::INFINITY, f32::NEG_INFINITY]; columns * rows];
        let texels = drawn.depth.chunks(width.max(1)).zip(drawn.slope.chunks(width.max(1)));
        for (y, (row, slopes)) in texels.enumerate() {
            let tiles = &mut depths[y / Self::SIDE * columns..][..columns];
            for (tile, (row, slopes)) in tiles.iter_mut().zip(row.chunks(Self::SIDE).zip(slopes.chunks(Self::SIDE))) {
                for (depth, [along, down]) in row.iter().zip(slopes).filter(|(depth, _)| !depth.is_nan()) {
                    let reach = 0.5 * (along.abs() + down.abs());
                    *tile = [tile[0].min(depth - reach), tile[1].max(depth + reach)];
                }
            }
        }
        Self { columns, depths }
    }

    /// Whether a piece may show a point within bounds.
    fn touch(&self, projection: &Projection, bounds: [DVec3; 2]) -> bool {
        let [across, down, depth] = projection.extent(bounds).map(|[middle, half]| {
            let half = half + Self::MARGIN;
            [middle - half, middle + half]
        });
        let [low, high] = projection.range;
        let tiles = |[first, last]: [f64; 2], axis: usize| {
            // The conversions saturate.
            let [first, last] = [first.max(low[axis]), last.min(high[axis])].map(|x| x as usize / Self::SIDE);
            first..last + 1
        };
        let is_beside = |[first, last]: [f64; 2], axis: usize| last < low[axis] - 0.5 || first > high[axis] + 0.5;
        if is_beside(across, 0) || is_beside(down, 1) {
            return false;
        }
        let reach = f64::from(projection.reach);
        let is_near =
            |&[least, most]: &[f32; 2]| f64::from(least) - reach <= depth[1] && depth[0] <= f64::from(most) + reach;
        let columns = tiles(across, 0);
        tiles(down, 1).any(|row| self.depths[row * self.columns..][columns.clone()].iter().any(is_near))
    }
}

/// The values of all texels that are used, from the texels of finer patches.
pub(super) fn gather_surfels<'a>(
    patch: &BakedPatch<'_>,
    map: &Map,
    drawn: &Drawn,
    surfels: impl Iterator<Item = &'a Surfels> + Clone,
    storage: &Storage,
) -> Vec<f32> {
    let mut sums = Sums::new(drawn.depth.len(), storage);
    let width = map.size[0] as usize;
    let tiles = Tiles::new(drawn, width);
    let strangers = Strangers::new(patch, map, &[]);
    for (piece, projection) in projections(patch, map).into_iter().enumerate() {
        let low = projection.range[0].map(|x| x as f32 - 0.5);
        let high = projection.range[1].map(|x| x as f32 + 0.5);
        for run in surfels.clone().filter(|run| run.normal.dot(projection.normal) > STEEP) {
            let bounds = run.bounds.map(|corner| corner - patch.origin());
            if !projection.touches(bounds) || !tiles.touch(&projection, bounds) {
                continue;
            }
            let (first, [by_x, by_y, by_z]) = projection.around(run.origin - patch.origin());
            // Known only where something may be strange.
            let areas = if strangers.of(piece).is_empty() { &[] } else { run.areas.as_slice() };
            let points = run.points.iter().zip(run.values.chunks_exact(storage.count()));
            for (number, (point, values)) in points.enumerate() {
                if areas.get(number).is_some_and(|&area| strangers.has(piece, area)) {
                    continue;
                }
                let at = first + by_x * point.x + by_y * point.y + by_z * point.z;
                let is_beside = |at: Vec3| at.x < low[0] || at.y < low[1] || at.x >= high[0] || at.y >= high[1];
                if is_beside(at) {
                    continue;
                }
                let texel = at.y as usize * width + at.x as usize;
                let at = drawn.closest(at, texel, map.size, projection.reach);
                if is_beside(at) {
                    continue;
                }
                let texel = at.y as usize * width + at.x as usize;
                // Comparisons with NaN are false.
                if (drawn.depth[texel] - at.z).abs() <= projection.reach {
                    sums.add(texel, values, run.area);
                }
            }
        }
    }
    finished(sums, patch, map, drawn)
}
