//! How large the texels of each triangle are: where the input has fewer texels, so have its images.

use glam::DVec3;
use lodpack::write::texel_size;

use super::located::Located;
use super::long::Growth;
use super::surfels::{Run, SIDE, Surfels};
use super::{BakedPatch, MAX_EXPONENT, Source};
use crate::certify::{Hint, TriangleBvh};

/// The factor by which texels may be larger than wanted, because their size is a power of the root of two.
const LARGER: f64 = 1.1;
/// The most that texels are larger than others of their map.
const MOST_LARGER: u8 = 30;
/// What differs by less from a power of two is one.
const ROUNDED: f64 = 1.01;

/// What texels each triangle of a patch has.
#[derive(Clone, Debug, Default)]
pub(super) struct Sizes {
    /// How much larger they are than the smallest, as a power of the root of two; empty if all are alike. Sizes differ
    /// by powers of two: pieces of images end where sizes do.
    pub larger: Vec<u8>,
    /// How fast what they show grows in each direction, per texel that is not longer than wide; empty if none is.
    pub growths: Vec<Growth>,
}

impl Sizes {
    /// Those of a source that is close.
    pub fn of_source(patch: &BakedPatch<'_>, source: &mut Located<impl Source>) -> Self {
        let (has_sizes, has_long) = (source.source.has_sizes(), source.source.has_long());
        if !(has_sizes || has_long) || source.source.triangle_count() == 0 {
            return Self::default();
        }
        let (source, bvh) = source.parts();
        let mut hint = Hint::default();
        Self::of(patch, has_long, |point| {
            let triangle = bvh.close(point, 0.0, &mut hint) as usize;
            let growth = if has_long { source.growth(triangle) } else { None };
            (source.larger(triangle), growth.map_or(Growth::default(), Growth::of_image))
        })
    }

    /// Those of finer patches.
    pub fn of_surfels<'a>(patch: &BakedPatch<'_>, finer: impl Iterator<Item = &'a Surfels>) -> Self {
        let runs: Vec<&Run> = finer.flat_map(|surfels| &surfels.runs).collect();
        let least = runs.iter().map(|run| run.usual).fold(f32::INFINITY, f32::min);
        let larger: Vec<u8> = runs.iter().map(|run| larger(f64::from(run.usual / least).sqrt() * ROUNDED)).collect();
        let has_long = runs.iter().any(|run| run.is_long());
        if !has_long && larger.iter().all(|&larger| larger == 0) {
            return Self::default();
        }
        let positions: Vec<DVec3> = runs.iter().flat_map(|run| run.corners()).collect();
        let triangles: Vec<[u32; 3]> =
            (0..runs.len() as u32).flat_map(|run| [[0, 1, 2], [1, 3, 2]].map(|one| one.map(|k| 4 * run + k))).collect();
        let bvh = TriangleBvh::new(&positions, &triangles);
        let mut hint = Hint::default();
        Self::of(patch, has_long, |point| {
            let run = bvh.close(point, 0.0, &mut hint) as usize / 2;
            (larger[run], if has_long { Growth::of(runs[run].growth()) } else { Growth::default() })
        })
    }

    /// Asks at points of each triangle. The smallest size decides.
    fn of(patch: &BakedPatch<'_>, has_long: bool, mut at: impl FnMut(DVec3) -> (u8, Growth)) -> Self {
        let mut of_triangle = |corners: &[u32; 3]| {
            let corners = corners.map(|corner| patch.origin() + patch.position(corner));
            let middle = corners.iter().sum::<DVec3>() / 3.0;
            let inner = corners.map(|corner| at(corner.lerp(middle, 0.5)));
            let all = [at(middle), inner[0], inner[1], inner[2]];
            (all.iter().map(|one| one.0).fold(u8::MAX, u8::min), Growth::mean(all.map(|one| one.1)))
        };
        let (mut larger, mut growths): (Vec<u8>, Vec<Growth>) = patch.triangles.iter().map(&mut of_triangle).unzip();
        let least = larger.iter().copied().min().unwrap_or(0);
        larger.iter_mut().for_each(|larger| *larger -= least);
        if larger.iter().all(|&larger| larger == 0) {
            larger.clear();
        }
        if !has_long {
            growths.clear();
        }
        Self { larger, growths }
    }

    /// How large the smallest texels must be, as a power of the root of two, so that the patch has about as many as are
    /// `wanted`; `before` if all are alike, when their number is not asked for.
    pub fn exponent(&self, patch: &BakedPatch<'_>, before: u32, wanted: impl FnOnce() -> f64) -> u32 {
        if self.larger.is_empty() {
            return before;
        }
        let wanted = wanted();
        if wanted <= 0.0 {
            return before;
        }
        let triangles = patch.triangles.iter().zip(&self.larger);
        let area: f64 =
            triangles.map(|(&corners, &larger)| patch.area(corners) / area_of_texel(u32::from(larger))).sum();
        let is_small = |&exponent: &u32| area_of_texel(exponent) <= area / wanted * std::f64::consts::SQRT_2;
        (0..=MAX_EXPONENT).take_while(is_small).last().unwrap_or(0)
    }
}

/// What finer texels cover, square lattice units.
pub(super) fn covered_area<'a>(finer: impl Iterator<Item = &'a Surfels>) -> f64 {
    finer.flat_map(|surfels| &surfels.runs).map(|run| f64::from(run.size) * run.covered()).sum()
}

/// The largest exponent of texels that are hardly larger than this, in lattice units.
pub fn exponent_of(size: f64) -> u32 {
    (1..=MAX_EXPONENT).take_while(|&exponent| texel_size(exponent) <= size * LARGER).last().unwrap_or(0)
}

/// The area of a texel of 2^(exponent / 2) lattice units.
pub fn area_of_texel(exponent: u32) -> f64 {
    let size = texel_size(exponent);
    size * size
}

/// By how much texels are larger that may be `times` times as large, as a power of the root of two: sizes differ by
/// powers of two, so that pieces are few.
pub fn larger(times: f64) -> u8 {
    let mut larger = 0;
    while larger < MOST_LARGER && texel_size(u32::from(larger) + 2) <= times {
        larger += 2;
    }
    larger
}

impl Run {
    /// How many texels are covered.
    pub fn covered(&self) -> f64 {
        self.rows.iter().map(|row| row.count_ones()).sum::<u32>().into()
    }

    /// Whether texels are longer than wide.
    fn is_long(&self) -> bool {
        let [length, width, _] = self.steps.map(|step| f64::from(step.length()));
        length.max(width) > f64::from(self.size).sqrt() * ROUNDED
    }

    /// How fast their coordinates grow, per size of a texel that is not.
    fn growth(&self) -> [DVec3; 2] {
        let usual = f64::from(self.usual).sqrt();
        [0, 1].map(|k| self.steps[k].as_dvec3()).map(|step| step * (usual / step.length_squared()))
    }

    /// Around its texels, in the middle of its depth.
    fn corners(&self) -> [DVec3; 4] {
        let [beside, below, deeper] = self.steps.map(|step| step.as_dvec3());
        let middle = self.origin + deeper * f64::from(u16::MAX / 2);
        let most = SIDE as f64 - 0.5;
        [[-0.5, -0.5], [most, -0.5], [-0.5, most], [most, most]].map(|[x, y]| middle + beside * x + below * y)
    }
}
