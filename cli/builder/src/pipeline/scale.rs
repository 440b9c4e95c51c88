//! The lengths of a build: tolerance, levels and lattice, all derived from the extent of the input and the tolerance
//! asked for.

use glam::DVec3;
use lodpack::{Lattice, write::Quantisation};
use lodpack_mesh::tolerance::Tolerance;
use serde::{Deserialize, Serialize};

use super::{Effort, LevelChoice, ModelOptions, PipelineError};
use crate::region::Extent;
use lodpack_mesh::exact::{floor_log2, power_of_two, power_of_two_near};

/// `auto` in mean edge lengths. At this largest error, scans have an RMS error of about 0.05 mean edge lengths.
const AUTO_EDGES: f64 = 0.5;
/// `auto` is at most this fraction of the diagonal, which limits it for parts of few large triangles.
const AUTO_DIAGONAL: f64 = 0.002;
/// `auto` is at most this share of the thickness below which [`THIN_AREA`] of the surface lies: parts of long triangles
/// would vanish.
const AUTO_THICKNESS: f64 = 0.05;
const THIN_AREA: f64 = 0.05;
/// `auto` for grids of heights is at least this share of the mean edge length, however flat they are.
const FLATTEST: f64 = 1e-4;
/// A grid of heights with this mean bend or less is a plane: what bends is rounding.
const FLAT: f64 = 1e-12;
/// Triangles of the finest level per input triangle at the automatic tolerance, over the mean bend. With charts of
/// 8,192 triangles this was 1.29 on the dragon, 1.34 on 1 M and 1.39 on 8 M generated triangles.
const SHARE_PER_BEND: f64 = 1.35;
/// The fewest input triangles to aim for in a chart: those of a rough surface, which stays fine.
const CHART_TRIANGLES: f64 = 4096.0;
/// Charts grow with the power of 1.5 of the tolerance beyond the automatic one, up to this factor. Coarser charts have
/// fewer triangles, more of which lie at borders, whose vertices are not placed as freely as the others. With charts of
/// the same input triangles at all tolerances, a bunny of 2,000 triangles had an RMS error of 1.36 times
/// meshoptimizer's; with growing charts it has 0.96. On the dragon, at 2.1 mean edge lengths, the power of 1.5 needs
/// 17,390 triangles where 1 needs 18,408, for as many bytes.
const CHART_GROWTH: f64 = 16.0;
/// Charts grow by this factor where the finest level is the only one: nobody reads less than all of such a file.
const FINEST_GROWTH: f64 = 2.0;
/// The simplifier's threshold (an RMS distance) over the tolerance (a maximum).
const THRESHOLD_PER_TOLERANCE: f64 = 0.18;
/// How far an arc may leave its chords, over the threshold.
const ARC_PER_THRESHOLD: f64 = 3.0;
/// Tolerance of a level over that of the next finer one. The error is inversely proportional to the number of
/// triangles, so a factor of four leaves a quarter of the triangles, and all levels together cost a third more than the
/// finest. As a power of two.
const LEVEL_RATIO_LOG2: i32 = 2;
/// The lattice step is at most this multiple of the finest threshold.
const STEP_PER_THRESHOLD: f64 = 1.4;
/// Lattice steps for each texel of the input's images, about, of which not all need be on the surface.
const STEPS_PER_TEXEL: f64 = 64.0;
/// But the lattice's step is halved at most this often for that.
const MOST_FINER: i32 = 3;
/// Sizes of models that can be built, in input units. Solving quadrics takes products of up to six lengths, which have
/// to stay within the range of f64.
const SIZES: std::ops::RangeInclusive<f64> = 1e-40..=1e40;
/// The most lattice steps along the diagonal of a model, as a power of two: the range of the format's coordinates, less
/// some margin.
const MAX_EXTENT_LOG2: i32 = 39;
/// In extensible builds the lattice's origin is a multiple of this many steps, as a power of two: then it seldom moves,
/// and coordinates still fit.
const ORIGIN_STEPS_LOG2: i32 = 30;
/// Threshold of the coarsest level over the size of what it draws: of a chart, or of everything.
const TOP_SHARE: f64 = 0.02;
/// The largest step along the normal in a file with groups, over the diagonal. However far the threshold of a coarse
/// level would let them be, surfaces of a few hundred triangles are .002 of the diagonal off on average.
const LARGEST_STEP: f64 = 0.0032;
/// Where more may be added, the diagonal of a region is taken to have as many edges as the root of its triangles, each
/// this many tolerances long, as at the automatic tolerance. With a finer one, levels above are a little finer than
/// they need to be.
const TOLERANCES_PER_EDGE: f64 = 2.0;
/// The most texels of images in a chart, about: the map of a chart is baked at once, and takes some 100 bytes of memory
/// for each.
const CHART_TEXELS: u64 = 1 << 19;
/// A chart gets no fewer triangles for that.
const FEWEST_TEXTURED: u64 = 512;
/// Levels of charts that are in groups.
const CHART_LEVELS: usize = 1;
/// The most levels: more would only repeat patches that cannot get any coarser.
const MAX_LEVELS: usize = 16;

/// The most triangles of a chart that the input brings, given the texels of its images for each triangle: twice those
/// of the largest that are made here, as a chart may have that is made here.
pub(super) fn largest_chart(texels_each: u64) -> u32 {
    let [_, most] = Effort::Best.chart_size();
    2 * textured_chart(texels_each).unwrap_or(u64::MAX).min(most as u64) as u32
}

/// The most triangles of a chart, given the texels of its images for each triangle; none without texels.
fn textured_chart(texels_each: u64) -> Option<u64> {
    CHART_TEXELS.checked_div(texels_each).map(|triangles| triangles.max(FEWEST_TEXTURED))
}

impl Effort {
    /// The triangles that the finest level of a chart should have, and the most input triangles that a chart gets to
    /// reach them. With groups above them, charts of 2,800 triangles instead of 1,400 save 6 % of the bytes of the
    /// dragon and of 8 M generated triangles. A smooth surface (32 M generated triangles) takes half the bytes in the
    /// same time with charts that grow up to the most.
    fn chart_size(self) -> [f64; 2] {
        match self {
            Self::Default => [2800.0, 131_072.0],
            Self::Best => [5600.0, 262_144.0],
        }
    }

    /// Input triangles per chart of a surface with this mean bend at the automatic tolerance: a power of two, so that a
    /// slightly different mesh gets charts of the same size.
    fn chart_triangles(self, mean_bend: f64) -> f64 {
        let [finest, most] = self.chart_size();
        // A plane wants infinitely many.
        let wanted = (finest / (SHARE_PER_BEND * mean_bend)).clamp(CHART_TRIANGLES, most);
        power_of_two_near(wanted, CHART_TRIANGLES)
    }
}

/// The lengths of one level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelPlan {
    /// Certified error to aim for; it binds the finest level only.
    pub tolerance: f64,
    /// The threshold of the simplifier and of the choice of grid cells, an RMS distance.
    pub threshold: f64,
    /// Largest distance of an arc from its chords.
    pub arc_tolerance: f64,
    /// Steps of the level's own vertices.
    pub quantisation: Quantisation,
}

/// All lengths of a build.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// Largest certified error of the finest level.
    pub tolerance: f64,
    /// The largest storable error within the tolerance. An error up to here is still within the tolerance when the file
    /// rounds it up.
    pub error_limit: f64,
    /// Mean edge length of the input.
    pub mean_edge_length: f64,
    /// Input triangles per chart to aim for.
    pub chart_triangles: u32,
    /// Maps lattice coordinates to world positions. Its origin is a whole number of steps.
    pub lattice: Lattice,
    /// The number of times that the lattice's step was halved because the input has images.
    pub fineness: u8,
    /// Coarsest first.
    pub levels: Vec<LevelPlan>,
    /// The coarsest level of charts that are in groups.
    pub coarsest_of_charts: u8,
    /// The coarsest level of regions, above which groups stand for several of them; 0 if no group does.
    pub coarsest_of_regions: u8,
    /// The coarsest level that may have samples of arcs, beside those that all levels have.
    pub coarsest_of_samples: u8,
}

/// Heights of groups, each of which takes a level.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heights {
    /// Above the charts of a region.
    pub in_regions: u32,
    /// Above regions.
    pub above: u32,
    /// How many of them there are because of texels, of which charts have more than of triangles: their shape need not
    /// be coarser.
    pub of_texels: u32,
    /// The most triangles in a region, if nothing in it may depend on the levels above, whose number and steps may
    /// change when more is added.
    pub may_grow: Option<u64>,
}

impl LevelPlan {
    /// The level that is `steps_up` steps coarser than the finest one.
    fn new(tolerance: f64, steps_up: usize, fineness: u8) -> Self {
        let factor = factor_of(steps_up);
        let quantisation = match (steps_up, fineness) {
            // Patches with lines halve the tangential step three times, and the lattice ends there.
            (0, 1..) => Quantisation { normal_shift: 0, tangent_shift: 3 },
            _ => Quantisation { normal_shift: LEVEL_RATIO_LOG2 as u8 * steps_up as u8 + fineness, tangent_shift: 2 },
        };
        let threshold = tolerance * THRESHOLD_PER_TOLERANCE * factor;
        Self { tolerance: tolerance * factor, threshold, arc_tolerance: threshold * ARC_PER_THRESHOLD, quantisation }
    }
}

/// How often the step of the lattice is halved for images: where colours jump at lines between triangles, lines that
/// are off by a share of a texel show that share of it in the wrong colour.
fn image_fineness(extent: &Extent, texels_each: u64, step: f64) -> u8 {
    let texels = extent.undivided_triangles() as f64 * texels_each as f64;
    let texel = (extent.area / texels).sqrt();
    // Comparisons with NaN are false: without texels nothing is halved.
    (0..MOST_FINER).take_while(|&halved| STEPS_PER_TEXEL * step > texel * power_of_two(halved)).count() as u8
}

/// Tolerance of a level over that of the finest one.
pub(super) fn factor_of(steps_up: usize) -> f64 {
    power_of_two(LEVEL_RATIO_LOG2 * steps_up as i32)
}

impl Scale {
    /// Adds levels for groups, and for the one at the top.
    pub(super) fn with_heights(mut self, heights: Heights, diagonal: f64) -> Self {
        let Heights { in_regions, above, of_texels, may_grow } = heights;
        let coarsest = TOP_SHARE * diagonal / (self.tolerance * THRESHOLD_PER_TOLERANCE);
        let of_top = (0..MAX_LEVELS).find(|&steps_up| coarsest <= factor_of(steps_up)).map_or(MAX_LEVELS, |s| s + 1);
        let count = of_top.max(CHART_LEVELS + (in_regions + above) as usize);
        let level =
            |above: usize| LevelPlan::new(self.tolerance, above.saturating_sub(of_texels as usize), self.fineness);
        self.levels = (0..count).rev().map(level).collect();
        self.coarsest_of_charts = (count - CHART_LEVELS) as u8;
        self.coarsest_of_regions = if above > 0 { self.coarsest_of_charts - in_regions as u8 } else { 0 };
        let step = self.step();
        let most = |diagonal: f64| floor_log2(LARGEST_STEP * diagonal / step).max(0) as u8;
        let of_region =
            may_grow.map(|triangles| most(TOLERANCES_PER_EDGE * self.tolerance * (triangles as f64).sqrt()));
        for (number, level) in (0..).zip(&mut self.levels) {
            let most = of_region.filter(|_| number >= self.coarsest_of_regions).unwrap_or(most(diagonal));
            level.quantisation.normal_shift = level.quantisation.normal_shift.min(most);
        }
        self.coarsest_of_samples = may_grow.map_or(0, |_| self.coarsest_of_regions);
        self
    }

    /// These lengths as far as the products of regions depend on them, where more may be added later.
    pub(super) fn of_regions(&self) -> Self {
        let above = self.coarsest_of_regions;
        Self {
            // It only informs people.
            mean_edge_length: 0.0,
            levels: self.levels[usize::from(above)..].to_vec(),
            coarsest_of_charts: self.coarsest_of_charts - above,
            coarsest_of_regions: 0,
            coarsest_of_samples: 0,
            ..self.clone()
        }
    }

    /// How far the boundary of the surface may be from straight lines between corners: what groups of the second height
    /// allow, since samples of arcs take fewer bytes than corners, or where there are no such groups, the coarsest
    /// level. Infinite where there is one level alone.
    pub(super) fn straight_boundary(&self) -> f64 {
        let level = usize::from(self.coarsest_of_charts).saturating_sub(2);
        self.levels[..usize::from(self.finest())].get(level).map_or(f64::INFINITY, |level| level.arc_tolerance)
    }

    /// For each level how far an arc may be from its samples, as far as the level chooses these.
    pub(super) fn arc_tolerances(&self) -> Vec<f64> {
        let levels = (0..).zip(&self.levels);
        let tolerance = |(number, level): (u8, &LevelPlan)| match number < self.coarsest_of_samples {
            true => f64::INFINITY,
            false => level.arc_tolerance,
        };
        levels.map(tolerance).collect()
    }

    /// Checks that the arithmetic has room for the lengths, areas and volumes of the input.
    ///
    /// # Errors
    /// [`PipelineError::Size`] if the input is too large or too small. A single point passes: repair reports it.
    pub fn check_size([low, high]: [DVec3; 2]) -> Result<(), PipelineError> {
        let extent = (high - low).max_element();
        // A model far from the origin needs as much range as a large one.
        let reach = low.abs().max(high.abs()).max_element();
        if reach.is_nan() || reach > *SIZES.end() || extent > 0.0 && extent < *SIZES.start() {
            let (what, limits) = (if extent < 1.0 { extent } else { reach }, (SIZES.start(), SIZES.end()));
            return Err(PipelineError::Size { size: what, smallest: *limits.0, largest: *limits.1 });
        }
        Ok(())
    }

    /// Derives everything from the repaired input and the texels of its images for each triangle.
    ///
    /// # Errors
    /// [`PipelineError::Tolerance`] if a metric tolerance meets an input of unknown unit, or the tolerance is too fine
    /// for the lattice.
    pub fn new(extent: &Extent, texels_each: u64, options: &ModelOptions) -> Result<Self, PipelineError> {
        let &ModelOptions { tolerance, unit, effort, levels, chart_triangles, extensible, .. } = options;
        let [low, high] = extent.bounds;
        let diagonal = low.distance(high);
        let mean_edge_length = extent.mean_edge_length();
        let chosen_here = matches!(tolerance, Tolerance::Auto | Tolerance::OfBend(_));
        // When something is added to the input, its diagonal changes most.
        let thin = AUTO_THICKNESS * extent.thickness.quantile(THIN_AREA, extent.area);
        let most = if extensible { f64::INFINITY } else { thin.min(AUTO_DIAGONAL * diagonal) };
        let automatic = (AUTO_EDGES * mean_edge_length).min(most);
        let tolerance = match tolerance {
            Tolerance::Auto => automatic,
            Tolerance::InputUnits(length) => length,
            Tolerance::OfDiagonal(fraction) => fraction * diagonal,
            Tolerance::OfMeanEdge(factor) => factor * mean_edge_length,
            // A plane bends nowhere, and has no detail that a finer tolerance would keep: only edges that zigzag.
            Tolerance::OfBend(_) if extent.mean_bend() <= FLAT => automatic,
            Tolerance::OfBend(factor) => {
                (factor * mean_edge_length * extent.mean_bend()).max(FLATTEST * mean_edge_length).min(automatic)
            }
            Tolerance::Metres(metres) => match unit {
                Some(unit) => metres / unit.metres,
                None => return Err(PipelineError::unit_missing()),
            },
        };
        // A larger tolerance than the model itself allows no more, and the lattice should still fit the model.
        let tolerance = tolerance.min(diagonal);
        let too_fine = || {
            let which = if chosen_here { "the automatic tolerance" } else { "the tolerance" };
            let finest = diagonal * power_of_two(1 - MAX_EXTENT_LOG2) / (THRESHOLD_PER_TOLERANCE * STEP_PER_THRESHOLD);
            PipelineError::Tolerance {
                what: format!(
                    "{which} of {tolerance:.3e} is too fine for a model of size {diagonal:.3e}; the finest possible is \
                     {finest:.3e}: pass a larger --tolerance, or look for parts of the model that lie far off"
                ),
            }
        };
        if !(tolerance > 0.0 && tolerance.is_finite()) {
            return Err(too_fine());
        }
        let finest = tolerance * THRESHOLD_PER_TOLERANCE;
        let usual_log2 = floor_log2(finest * STEP_PER_THRESHOLD);
        let has_room = |step_log2: i32| {
            (-200..=200).contains(&step_log2) && diagonal / power_of_two(step_log2) <= power_of_two(MAX_EXTENT_LOG2)
        };
        if !has_room(usual_log2) {
            return Err(too_fine());
        }
        // Lattice points must be world positions that f64 represents exactly: rounding would add an error that no
        // certificate covers.
        let reach = low.abs().max(high.abs()).max_element();
        let spacing = reach.next_up() - reach;
        let wanted = image_fineness(extent, texels_each, power_of_two(usual_log2));
        let is_possible = |&finer: &u8| {
            has_room(usual_log2 - i32::from(finer)) && power_of_two(usual_log2 - i32::from(finer)) >= spacing
        };
        let fineness = (1..=wanted).rev().find(is_possible).unwrap_or(0);
        let step_log2 = usual_log2 - i32::from(fineness);
        let step = power_of_two(step_log2);
        if step < spacing {
            return Err(PipelineError::Tolerance {
                what: format!(
                    "a tolerance of {tolerance:.3e} is too fine for coordinates of {reach:.3e}, which lie {spacing:.3e} apart in \
                     double precision: move the model towards the origin, or pass a larger --tolerance"
                ),
            });
        }
        let spacing = if extensible { step * power_of_two(ORIGIN_STEPS_LOG2) } else { step };
        let origin = ((low + high) * 0.5 / spacing).round() * spacing;
        let coarser = tolerance / automatic;
        let alone = if levels == LevelChoice::Finest { FINEST_GROWTH } else { 1.0 };
        let growth = (alone * coarser * coarser.sqrt()).clamp(1.0, CHART_GROWTH);
        // The finer the tolerance, the more triangles stay. Grids of heights are often built much finer than half an
        // edge.
        let finer = if options.raster.is_used { (automatic / tolerance).max(1.0) } else { 1.0 };
        let by_bend = || effort.chart_triangles(extent.mean_bend() * finer);
        let at_automatic = chart_triangles.map_or_else(by_bend, f64::from);
        let [_, most] = Effort::Best.chart_size();
        // The conversion saturates.
        let mut wanted = (at_automatic * growth).min(most.max(at_automatic));
        if let (None, Some(textured)) = (chart_triangles, textured_chart(texels_each)) {
            wanted = wanted.min(textured as f64);
        }
        let chart_triangles = if extensible { power_of_two_near(wanted, 1.0) } else { wanted } as u32;
        // The coarsest level leaves a few triangles of a chart of average size.
        let chart_size = mean_edge_length * f64::from(chart_triangles).sqrt();
        let coarsest = (TOP_SHARE * chart_size.min(diagonal)).max(finest);
        let reaches = |&steps_up: &usize| coarsest / finest <= factor_of(steps_up);
        let level_count = match levels {
            LevelChoice::All => (0..MAX_LEVELS).find(reaches).map_or(MAX_LEVELS, |steps_up| steps_up + 1),
            LevelChoice::Finest => 1,
        };
        let levels = (0..level_count).rev().map(|steps_up| LevelPlan::new(tolerance, steps_up, fineness)).collect();
        let lattice = Lattice { origin: origin.to_array(), step_log2 };
        // Every tolerance that gets here has a storable error below it.
        let error_limit = lodpack::write::storable_error(tolerance, &lattice).unwrap_or(tolerance);
        Ok(Self {
            tolerance,
            error_limit,
            mean_edge_length,
            chart_triangles,
            lattice,
            fineness,
            levels,
            coarsest_of_charts: 0,
            coarsest_of_regions: 0,
            coarsest_of_samples: 0,
        })
    }

    /// The lattice's step, a power of two, in input units.
    pub fn step(&self) -> f64 {
        self.lattice.step()
    }

    /// A world position, relative to the lattice's origin.
    pub fn local(&self, world: DVec3) -> DVec3 {
        world - DVec3::from_array(self.lattice.origin)
    }

    /// The position of a lattice point relative to the lattice's origin; exact.
    pub fn local_from_lattice(&self, point: lodpack::LatticePoint) -> DVec3 {
        DVec3::from_array(point.map(|c| c as f64)) * self.step()
    }

    /// The finest level.
    pub fn finest(&self) -> u8 {
        (self.levels.len() - 1) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::Thickness;

    #[test]
    fn charts_grow_with_smoothness_and_effort_by_powers_of_two() {
        let sizes = |bend| [Effort::Default, Effort::Best].map(|effort| effort.chart_triangles(bend));
        assert_eq!(sizes(0.0), [131_072.0, 262_144.0]);
        // The dragon, and a scan with noise.
        assert_eq!(sizes(0.0708), [32768.0, 65536.0]);
        assert_eq!(sizes(0.19), [8192.0, 16384.0]);
        assert_eq!(sizes(2.0), [4096.0; 2]);
        for k in 1..100 {
            let size = Effort::Default.chart_triangles(f64::from(k) * 0.003);
            assert_eq!(size.log2().fract(), 0.0);
        }
    }

    #[test]
    fn images_make_the_lattice_finer_only_where_coordinates_leave_room() {
        let far = |metres: f64| {
            let bounds = [DVec3::splat(metres), DVec3::splat(metres + 1.0)];
            let (vertices, inner_edges, edge_lengths, bends) = (500, 1500, 150.0, 100.0);
            let thickness = Thickness::default();
            let extent = Extent {
                bounds,
                triangles: 1000,
                vertices,
                added_triangles: 0,
                added_vertices: 0,
                texels: 0.0,
                edge_lengths,
                area: 1.0,
                inner_edges,
                bends,
                thickness,
            };
            let options = ModelOptions { tolerance: Tolerance::InputUnits(0.001), ..ModelOptions::default() };
            let scale = |texels_each| Scale::new(&extent, texels_each, &options).expect("it has room");
            let usual = scale(0).lattice.step_log2;
            [0, 1, 10_000].map(|texels_each| {
                let Scale { fineness, lattice, .. } = scale(texels_each);
                assert_eq!(lattice.step_log2, usual - i32::from(fineness));
                fineness
            })
        };
        assert_eq!(far(0.0), [0, 0, 3]);
        // Doubles lie 2^-14 apart there, and steps without images are 2^-12.
        assert_eq!(far(5e11), [0, 0, 2]);
    }
}
