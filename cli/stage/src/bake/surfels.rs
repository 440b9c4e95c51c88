//! Texels as points of the surface: images of coarser patches are made of them, as they were before they were
//! quantised.

use glam::{DVec3, Vec3};
use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::lanes::{LANES, least, whole};
use super::projection::{Projection, projections};
use super::raster::Drawn;
use super::rim::Rim;
use super::storage::Storage;

/// Texels along each side of a run.
pub(super) const SIDE: usize = LANES;

/// The covered texels of a patch, in few bytes: the input has billions of them, and those of a group's members wait for
/// one another.
#[derive(Clone, Debug, Default)]
pub struct Surfels {
    pub(super) runs: Vec<Run>,
    /// Of each texel how deep it is, in steps of its run.
    pub(super) depths: Vec<u16>,
    /// Of each all values ([`Storage::pack`]).
    values: Vec<u8>,
    /// The areas of runs that have several.
    areas: Vec<u32>,
    /// What the patch shows along its border.
    pub(super) rim: Rim,
}

/// Texels of a piece that lie together.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// The middle of the first texel where it is least deep, lattice units.
    pub origin: DVec3,
    /// From a texel to the one beside it, to the one below it, and along the axis by one step of depth.
    pub steps: [Vec3; 3],
    /// The axis of the piece.
    pub normal: DVec3,
    /// The area of a texel.
    pub size: f32,
    /// That of a texel which is not longer than wide where it lies.
    pub usual: f32,
    /// For each row a bit for each texel that is covered.
    pub rows: [u16; SIDE],
    /// The first of its texels.
    pub first: usize,
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

    /// The area of a texel of a run, if it is known.
    pub(super) fn area(&self, run: &Run, number: usize) -> Option<u32> {
        match run.areas {
            RunAreas::Unknown => None,
            RunAreas::One(area) => Some(area),
            RunAreas::From(first) => Some(self.areas[first + number - run.first]),
        }
    }

    /// The values of a texel, which has `bytes` bytes.
    #[inline]
    pub(super) fn packed(&self, number: usize, bytes: usize) -> &[u8] {
        &self.values[number * bytes..][..bytes]
    }

    /// How many texels there would be if none were longer than wide.
    pub fn usual_count(&self) -> f64 {
        self.runs.iter().map(|run| run.covered() * f64::from(run.size / run.usual)).sum()
    }

    /// The covered texels of a patch. `usual` is of each piece the area of texels that are not longer than wide.
    pub(super) fn new(
        patch: &BakedPatch<'_>,
        (map, usual): (&Map, &[f64]),
        drawn: &Drawn,
        values: &[f32],
        storage: &Storage,
    ) -> Self {
        let count = drawn.is_covered.iter().filter(|&&is_covered| is_covered).count();
        let mut this = Self {
            depths: Vec::with_capacity(count),
            values: Vec::with_capacity(count * storage.packed_bytes()),
            ..Self::default()
        };
        for (projection, &usual) in projections(patch, map).iter().zip(usual) {
            let [left, top] = projection.range[0].map(|x| x as usize);
            let [right, bottom] = projection.range[1].map(|x| x as usize);
            for y in (top..=bottom).step_by(SIDE) {
                for x in (left..=right).step_by(SIDE) {
                    let texels = [x, y, (x + SIDE - 1).min(right), (y + SIDE - 1).min(bottom)];
                    this.add(patch, (projection, usual), texels, map.size[0] as usize, drawn, values, storage);
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
        (projection, usual): (&Projection, f64),
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
            normal: projection.normal,
            size: (projection.size * projection.size) as f32,
            usual: usual as f32,
            rows,
            first,
            areas,
        });
    }
}
