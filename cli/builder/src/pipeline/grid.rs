//! A grid filling: embed the chart, choose cells, fit and code their vertices, certify every level; then again with
//! more cells where the bound is above the tolerance.

use super::chart_work::{ALMOST, ChartWork, CodedLevel, Outcome};
use super::fill::{Challenge, ChartFilling, FillingRow};
use super::shared_arcs::{CutChart, SampleWish};
use super::{Fillings, Scale};
use glam::{DVec2, DVec3};
use lodpack::write::grid::{GridCell, GridShape, GridSite, GridState, GridTarget, encode_level};
use lodpack::{
    index::Filling,
    write::{Quantisation, Slide, SymbolBuffer},
};
use lodpack_mesh::exact::power_of_two;
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::certify;
use lodpack_stage::embed::{EmbedError, EmbedOptions, Embedding, MAX_CORNERS, MIN_CORNERS, embed_chart};
use lodpack_stage::sample::{
    CellTree, FitOptions, FittedGrid, GridPlan, NEGLIGIBLE, find_prices, fit_positions, grid_sides, select_at,
};
use std::collections::HashMap;

/// How often cells are added before the chart is no longer tried as a grid.
const MAX_REFINEMENTS: u32 = 3;
/// An attempt whose error is not below this multiple of the one before is the last: the chart does not lack cells.
const HOPELESS: f64 = 0.95;
/// Factor on a cell's squared error where the bound was above the tolerance: one more split leaves a quarter of the
/// distance.
const AMPLIFICATION: f64 = 16.0;
/// A level is left out unless its expected error is below this multiple of the coarser one's.
const WORTHWHILE: f64 = 0.8;
/// A vertex slides along the plane that fits the surface around it, unless that plane is steeper than this in the
/// vertex's local frame (cosine of the angle between the normals).
const STEEPEST: f64 = 0.3;

/// Bits of the tables that a file with grids needs.
const TABLE_BITS: f64 = 4000.0;

/// The filling's row in the table.
pub(super) const ROW: FillingRow = FillingRow {
    filling: Filling::Grid,
    steps: |scale, _| quantisation(scale),
    challenge: Some(Challenge {
        forced_by: Fillings::GridWherePossible,
        may_fill: |work| work.may_be_grid(),
        plan: |work, cut, thresholds| Some(Box::new(work.plan_grid(cut, thresholds).ok()?)),
        table_bits: TABLE_BITS,
    }),
};

/// Steps of the vertices of all grids, at all levels: grids are nested, so no vertex moves from level to level.
fn quantisation(scale: &Scale) -> Quantisation {
    scale.levels[usize::from(scale.finest())].quantisation
}

/// A chart's map to the polygon, and the cells of its levels.
#[derive(Clone, Debug)]
struct GridFilling {
    embedding: Embedding,
    plan: GridPlan,
    /// Root mean square error that each level may have.
    thresholds: Vec<f64>,
    /// Where the earlier attempts were above the tolerance, attempt by attempt.
    exceeded: Vec<Vec<DVec2>>,
    /// Error of the last attempt that was above the tolerance.
    last_error: f64,
    /// Everything that the plans so far have asked of the arcs.
    wishes: Vec<SampleWish>,
}

impl ChartFilling for GridFilling {
    fn filling(&self) -> Filling {
        Filling::Grid
    }

    fn fill(
        &mut self,
        work: &mut ChartWork,
        cut: &CutChart,
        original: &certify::Surface,
        failures: &mut u32,
    ) -> Outcome {
        work.fill_with_grid(cut, original, failures, self)
    }

    fn wishes(&self) -> &[SampleWish] {
        &self.wishes
    }

    fn estimated_bits(&self) -> f64 {
        self.plan.levels.iter().map(|level| level.estimated_bits).sum()
    }
}

impl ChartWork<'_> {
    /// Whether the chart is a disk with a number of sides that a grid can have, and no colours jump inside, since cells
    /// lie across everything.
    fn may_be_grid(&self) -> bool {
        if self.charted.jumps_inside(self.chart) {
            return false;
        }
        match self.charted.atlas.charts[self.chart as usize].loops.as_slice() {
            [border] => (MIN_CORNERS..=MAX_CORNERS).contains(&border.len()),
            _ => false,
        }
    }

    /// Embeds the chart and chooses its cells.
    ///
    /// # Errors
    /// If the chart has no sufficiently even map.
    fn plan_grid(&mut self, cut: &CutChart, thresholds: Vec<f64>) -> Result<GridFilling, EmbedError> {
        let start = thread_cpu_time();
        let embedding = embed_chart(&cut.mesh, &EmbedOptions::default());
        self.times.embed += thread_cpu_time() - start;
        let plan = GridPlan::default();
        let (exceeded, wishes) = (vec![], vec![]);
        let last_error = f64::INFINITY;
        let mut filling = GridFilling { embedding: embedding?, plan, thresholds, exceeded, last_error, wishes };
        self.choose_cells(cut, &mut filling);
        Ok(filling)
    }

    /// Chooses the cells for the present arcs, and returns the samples that these lack.
    fn choose_cells(&mut self, cut: &CutChart, filling: &mut GridFilling) -> Vec<SampleWish> {
        let start = thread_cpu_time();
        let GridFilling { embedding, thresholds, exceeded, .. } = filling;
        let finest = thresholds.last().copied().unwrap_or(0.0);
        let mut tree = CellTree::new(&cut.mesh, &embedding.uv, NEGLIGIBLE * finest);
        let prices = find_prices(&tree, thresholds);
        for places in exceeded {
            tree.amplify(places, AMPLIFICATION);
        }
        filling.plan = select_at(&cut.mesh, &tree, &prices, thresholds);
        let mut wishes = vec![];
        for (border, origin) in cut.mesh.loops.iter().zip(&cut.origin) {
            for (vertex, &(arc, path_index)) in border.iter().zip(origin) {
                let param = vertex.param * 65536.0;
                let found = filling
                    .plan
                    .demanded
                    .binary_search_by(|d| d.0.cmp(&vertex.side).then_with(|| f64::from(d.1).total_cmp(&param)));
                if let Ok(index) = found {
                    wishes.push(SampleWish { arc, path_index, level: filling.plan.demanded[index].2 });
                }
            }
        }
        filling.wishes.extend(&wishes);
        self.times.sample += thread_cpu_time() - start;
        wishes
    }

    /// See [`GridFilling::fill`].
    fn fill_with_grid(
        &mut self,
        cut: &CutChart,
        original: &certify::Surface,
        failures: &mut u32,
        filling: &mut GridFilling,
    ) -> Outcome {
        loop {
            // The codec refuses positions beyond the lattice and sides that lack a sample: such a chart cannot be a
            // grid.
            let Some(coded) = self.encode_grid(cut, filling) else { return Outcome::Unfit };
            let Some(finest) = coded.iter().rposition(Option::is_some) else { return Outcome::Unfit };
            let Some(finest_level) = &coded[finest] else { return Outcome::Unfit };
            let mut compared = self.compared(original, cut, finest as u8, finest_level);
            let error = self.certify(&mut compared);
            // Where the grid lacks the finest levels, its neighbours may be finer.
            let is_coarser = finest < usize::from(self.charted.scale.finest());
            let deviation = if is_coarser { self.arcs.deviations(self.charted, self.chart)[finest] } else { 0.0 };
            let stored = lodpack::write::stored_error(error, deviation, &self.charted.scale.lattice);
            if stored.is_ok_and(|stored| stored <= self.charted.scale.tolerance) {
                let rms = self.rms(cut, &compared);
                return Outcome::Done(Box::new(self.root(cut, original, Filling::Grid, coded, [error, rms])));
            }
            *failures += 1;
            let last = std::mem::replace(&mut filling.last_error, error);
            if *failures > MAX_REFINEMENTS || error > HOPELESS * last {
                return Outcome::Unfit;
            }
            let triangles = self.exceeding(&mut compared, ALMOST);
            let centre = |&t: &u32| {
                cut.mesh.triangles[t as usize].map(|v| filling.embedding.uv[v as usize]).iter().sum::<DVec2>() / 3.0
            };
            filling.exceeded.push(triangles.iter().map(centre).collect());
            let wishes = self.choose_cells(cut, filling);
            if !wishes.is_empty() {
                return Outcome::Wishes(wishes);
            }
        }
    }

    /// Codes all levels that improve on the coarser one, each on top of it.
    fn encode_grid(&mut self, cut: &CutChart, filling: &GridFilling) -> Option<Vec<Option<CodedLevel>>> {
        let start = thread_cpu_time();
        let plan = &filling.plan;
        let fitted = fit_positions(&cut.mesh, &filling.embedding, plan, &FitOptions::default()).ok()?;
        self.times.sample += thread_cpu_time() - start;

        let start = thread_cpu_time();
        let step = self.charted.scale.step();
        let quantisation = quantisation(self.charted.scale);
        let shift = i32::from(quantisation.normal_shift) + i32::from(quantisation.tangent_shift);
        let mut target = FittedTarget {
            shape: GridShape::Polygon,
            level: 0,
            split_levels: (0..)
                .zip(&plan.levels)
                .flat_map(|(number, level)| level.splits.iter().map(move |&cell| (cell, number)))
                .collect(),
            vertices: (0..).zip(&fitted.sites).map(|(index, &site)| (site, index)).collect(),
            fitted: &fitted,
            step,
            bound: power_of_two(shift),
        };
        let mut coded = vec![];
        let mut previous: Option<GridState> = None;
        let (mut expected, mut border_count) = (f64::INFINITY, 0);
        for (number, level) in (0u8..).zip(&plan.levels) {
            let is_finest = usize::from(number) + 1 == plan.levels.len();
            if previous.is_some() && !is_finest && level.estimated_error > expected * WORTHWHILE {
                coded.push(None);
                continue;
            }
            // Border positions are lattice points, so the division is exact.
            let sides = grid_sides(&cut.mesh, number, |p| (p / step).to_array().map(|c| c.round() as i64));
            (target.shape, target.level) = (level.shape, number);
            let mut symbols = SymbolBuffer::default();
            let state = encode_level(&target, previous.clone(), &sides, quantisation, &mut symbols).ok()?;
            let patch = state.patch(&sides).ok()?;
            let is_same = previous.as_ref().is_some_and(|coarser| {
                coarser.shape() == state.shape() && coarser.positions().len() == state.positions().len()
            });
            if is_same && border_count == patch.border_count {
                coded.push(None);
                continue;
            }
            (expected, border_count) = (level.estimated_error, patch.border_count);
            previous = Some(state);
            coded.push(Some(self.coded_level(cut, number, patch, symbols)));
        }
        self.times.encode += thread_cpu_time() - start;
        Some(coded)
    }
}

/// The codec's target: the fitted vertices, which may slide along the surface.
struct FittedTarget<'a> {
    shape: GridShape,
    level: u8,
    /// The coarsest level at which a cell is split.
    split_levels: HashMap<GridCell, u8>,
    /// Index of each site's vertex.
    vertices: HashMap<GridSite, u32>,
    fitted: &'a FittedGrid,
    /// Lattice step.
    step: f64,
    /// How far a vertex may slide from its projection, in lattice steps: one tangential step.
    bound: f64,
}

impl FittedTarget<'_> {
    /// Position and normal of the vertex at a site.
    fn vertex(&self, site: GridSite) -> [DVec3; 2] {
        // The plan's cells have all the sites that the codec asks for.
        let index = self.vertices.get(&site).map_or(usize::MAX, |&index| index as usize);
        [&self.fitted.positions, &self.fitted.normals].map(|list| list.get(index).copied().unwrap_or_default())
    }
}

impl GridTarget for FittedTarget<'_> {
    fn shape(&self) -> GridShape {
        self.shape
    }

    fn is_split(&self, cell: GridCell) -> bool {
        self.split_levels.get(&cell).is_some_and(|&level| level <= self.level)
    }

    fn position(&self, site: GridSite) -> [f64; 3] {
        (self.vertex(site)[0] / self.step).to_array()
    }
}

impl Slide<GridSite> for FittedTarget<'_> {
    fn offset(&self, site: GridSite, point: [f64; 3], direction: [f64; 3]) -> f64 {
        let [wanted, normal] = self.vertex(site);
        let (direction, away) = (DVec3::from_array(direction), wanted / self.step - DVec3::from_array(point));
        let plain = away.dot(direction);
        let cosine = normal.dot(direction);
        if cosine.abs() < STEEPEST {
            return plain;
        }
        (away.dot(normal) / cosine).clamp(plain - self.bound, plain + self.bound)
    }
}
