//! Texels as points of the surface: images of coarser patches are made of them, as they were before they were quantised.

use glam::{DVec3, Vec3};
use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::fill::finished;
use super::lanes::{LANES, OUTSIDE, Row, Window, least, whole};
use super::projection::{Projection, projections};
use super::raster::Drawn;
use super::strangers::Strangers;
use super::values::{Kept, Storage, Sums};

/// Cosine of the angle to an axis beyond which points of finer patches are not shown by a piece.
const STEEP: f64 = 0.1;
/// Texels along each side of a run.
const SIDE: usize = LANES;

/// The covered texels of a patch, in few bytes: the input has billions of them, and those of a group's members wait for one another.
#[derive(Clone, Debug, Default)]
pub struct Surfels {
    runs: Vec<Run>,
    /// Of each texel how deep it is, in steps of its run.
    depths: Vec<u16>,
    /// Of each all values ([`Storage::pack`]).
    values: Vec<u8>,
    /// The areas of runs that have several.
    areas: Vec<u32>,
}

/// Texels of a piece that lie together.
#[derive(Clone, Debug)]
struct Run {
    /// The middle of the first texel where it is least deep, lattice units.
    origin: DVec3,
    /// From a texel to the one beside it, to the one below it, and along the axis by one step of depth.
    steps: [Vec3; 3],
    /// Smallest and largest point.
    bounds: [DVec3; 2],
    /// The axis of the piece.
    normal: DVec3,
    /// The area of a texel.
    size: f32,
    /// For each row a bit for each texel that is covered.
    rows: [u16; SIDE],
    /// The first of its texels.
    first: usize,
    areas: RunAreas,
}

/// In which areas the texels of a run lie.
#[derive(Clone, Copy, Debug)]
enum RunAreas {
    Unknown,
    One(u32),
    /// From here on in [`Surfels::areas`].
    From(usize),
}

impl Surfels {
    /// How many texels.
    pub fn count(&self) -> usize {
        self.depths.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.depths.is_empty()
    }

    /// The covered texels of a patch.
    pub(super) fn new(patch: &BakedPatch<'_>, map: &Map, drawn: &Drawn, values: &[f32], storage: &Storage) -> Self {
        let count = drawn.is_covered.iter().filter(|&&is_covered| is_covered).count();
        let mut this = Self {
            depths: Vec::with_capacity(count),
            values: Vec::with_capacity(count * storage.packed_bytes()),
            ..Self::default()
        };
        for projection in projections(patch, map) {
            let [left, top] = projection.range[0].map(|x| x as usize);
            let [right, bottom] = projection.range[1].map(|x| x as usize);
            for y in (top..=bottom).step_by(SIDE) {
                for x in (left..=right).step_by(SIDE) {
                    let texels = [x, y, (x + SIDE - 1).min(right), (y + SIDE - 1).min(bottom)];
                    this.add(patch, &projection, texels, map.size[0] as usize, drawn, values, storage);
                }
            }
        }
        this.areas.shrink_to_fit();
        this
    }

    /// Adds the covered texels of a rectangle.
    #[expect(clippy::too_many_arguments, reason = "a map, and what is known of its texels")]
    fn add(
        &mut self,
        patch: &BakedPatch<'_>,
        projection: &Projection,
        [left, top, right, bottom]: [usize; 4],
        width: usize,
        drawn: &Drawn,
        values: &[f32],
        storage: &Storage,
    ) {
        let texels = |y: usize| y * width + left..y * width + right + 1;
        let point = |x: usize, y: usize, depth: f32| {
            patch.origin() + projection.point([x as f64 + 0.5, y as f64 + 0.5], f64::from(depth))
        };
        let (mut range, mut rows) = ([f32::INFINITY, f32::NEG_INFINITY], [0_u16; SIDE]);
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for (row, y) in rows.iter_mut().zip(top..=bottom) {
            let mut lanes = [[f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]];
            let [low, high] = &mut lanes;
            let of_texels = drawn.depth[texels(y)].iter().zip(&drawn.is_covered[texels(y)]);
            for (x, ((low, high), (&depth, &is_covered))) in low.iter_mut().zip(high).zip(of_texels).enumerate() {
                (*low, *high) = if is_covered { (depth, depth) } else { (*low, *high) };
                *row |= u16::from(is_covered) << x;
            }
            if *row != 0 {
                let of_row = [least(lanes[0]), -least(lanes[1].map(|depth| -depth))];
                // No point of the row is beyond these four.
                let ends = [row.trailing_zeros(), row.ilog2()].map(|x| left + x as usize);
                for point in ends.into_iter().flat_map(|x| of_row.map(|depth| point(x, y, depth))) {
                    bounds = [bounds[0].min(point), bounds[1].max(point)];
                }
                range = [range[0].min(of_row[0]), range[1].max(of_row[1])];
            }
        }
        if rows == [0; SIDE] {
            return;
        }
        let step = (range[1] - range[0]) / f32::from(u16::MAX);
        // No depths differ by so little but those that are alike.
        let inverse = if step > 1e-30 { 1.0 / step } else { 0.0 };
        let (first, first_area) = (self.depths.len(), self.areas.len());
        for (&row, y) in rows.iter().zip(top..=bottom) {
            let (mut rest, mut at) = (u32::from(row), texels(y).start);
            while rest != 0 {
                let gap = rest.trailing_zeros();
                let count = (rest >> gap).trailing_ones();
                (rest, at) = (rest >> (gap + count), at + gap as usize);
                let covered = at..at + count as usize;
                at = covered.end;
                let steps = drawn.depth[covered.clone()].iter().map(|depth| (depth - range[0]) * inverse + 0.5);
                self.depths.extend(steps.map(|steps| whole(steps).min(u32::from(u16::MAX)) as u16));
                self.areas.extend(drawn.areas.get(covered.clone()).into_iter().flatten());
                let stride = storage.stride();
                storage.pack_all(&values[covered.start * stride..covered.end * stride], &mut self.values);
            }
        }
        let areas = match &self.areas[first_area..] {
            [] => RunAreas::Unknown,
            &[one, ref others @ ..] if others.iter().all(|&other| other == one) => {
                self.areas.truncate(first_area);
                RunAreas::One(one)
            }
            _ => RunAreas::From(first_area),
        };
        let [beside, below] = [[1.0, 0.0], [0.0, 1.0]].map(|step| projection.step(step, 0.0).as_vec3());
        self.runs.push(Run {
            origin: point(left, top, range[0]),
            steps: [beside, below, projection.step([0.0; 2], f64::from(step)).as_vec3()],
            bounds,
            normal: projection.normal,
            size: (projection.size * projection.size) as f32,
            rows,
            first,
            areas,
        });
    }
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
    mut sums: Sums<'_>,
) -> Kept {
    let storage = sums.storage;
    let width = map.size[0] as usize;
    let tiles = Tiles::new(drawn, width);
    let strangers = Strangers::new(patch, map, &[]);
    let (size, mut values) = (storage.packed_bytes(), Vec::with_capacity(storage.count()));
    for (piece, projection) in projections(patch, map).into_iter().enumerate() {
        let window = Window::new(drawn, width, &projection);
        let has_strangers = !strangers.of(piece).is_empty();
        let runs = surfels.clone().flat_map(|surfels| surfels.runs.iter().map(move |run| (surfels, run)));
        for (surfels, run) in runs.filter(|(_, run)| run.normal.dot(projection.normal) > STEEP) {
            let bounds = run.bounds.map(|corner| corner - patch.origin());
            if !projection.touches(bounds) || !tiles.touch(&projection, bounds) {
                continue;
            }
            let is_strange = |number: usize| match run.areas {
                RunAreas::Unknown => false,
                RunAreas::One(area) => strangers.has(piece, area),
                RunAreas::From(first) => strangers.has(piece, surfels.areas[first + number]),
            };
            let (first, [by_x, by_y, by_z]) = projection.around(run.origin - patch.origin());
            let of_step = |step: Vec3| by_x * step.x + by_y * step.y + by_z * step.z;
            let [beside, below, deeper] = run.steps.map(of_step);
            let mut own = run.first;
            for (y, bits) in run.rows.into_iter().enumerate().filter(|(_, bits)| *bits != 0) {
                let (mut columns, mut depths, mut count) = ([0.0; LANES], [0.0; LANES], 0);
                let mut rest = bits;
                while rest != 0 {
                    columns[count] = rest.trailing_zeros() as f32;
                    (rest, count) = (rest & (rest - 1), count + 1);
                }
                let of_row = own..own + count;
                own += count;
                depths.iter_mut().zip(&surfels.depths[of_row.clone()]).for_each(|(to, &depth)| *to = f32::from(depth));
                let start = (first + below * y as f32).to_array();
                let row = Row { start, beside: beside.to_array(), deeper: deeper.to_array() };
                let texels = window.texels(&row, &columns, &depths);
                let packed = surfels.values[of_row.start * size..of_row.end * size].chunks_exact(size);
                for (number, (&texel, packed)) in (of_row.start - run.first..).zip(texels.iter().zip(packed)) {
                    if texel != OUTSIDE && !(has_strangers && is_strange(number)) {
                        sums.add_packed(texel as usize, packed, run.size, &mut values);
                    }
                }
            }
        }
    }
    finished(sums, patch, map, drawn)
}
