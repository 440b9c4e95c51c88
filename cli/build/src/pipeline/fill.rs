//! The fillings that a chart can get, in one table.
//!
//! Every chart is filled irregularly first, which always succeeds. The other fillings of the table then challenge what a chart has, one
//! after the other ([`super::choose`]). A further filling needs a file with a row and a [`ChartFilling`], and a place in the table.

use std::fmt::Debug;

use super::chart_work::{ChartWork, Outcome};
use super::scale::LevelPlan;
use super::shared_arcs::{CutChart, SampleWish};
use super::{Fillings, Scale, grid, irregular};
use lodpack::{
    index::Filling,
    write::{LevelSteps, Quantisation},
};
use lodpack_stage::certify::Surface;

/// A filling on its way into a chart: what is planned, and what earlier attempts have taught.
pub(super) trait ChartFilling: Debug + Send + Sync {
    /// Which filling the root gets.
    fn filling(&self) -> Filling;

    /// Fills the chart. `failures` counts the attempts above the tolerance, those of earlier calls included.
    fn fill(&mut self, work: &mut ChartWork, cut: &CutChart, original: &Surface, failures: &mut u32) -> Outcome;

    /// Everything that the plans so far have asked of the arcs.
    fn wishes(&self) -> &[SampleWish] {
        &[]
    }

    /// Expected bits of all levels; 0 where only a try can tell.
    fn estimated_bits(&self) -> f64 {
        0.0
    }
}

/// Any filling on its way into a chart.
pub(super) type BoxedFilling = Box<dyn ChartFilling>;

/// A row of the table.
pub(super) struct FillingRow {
    pub filling: Filling,
    /// The steps of its vertices at a level.
    pub steps: fn(&Scale, &LevelPlan) -> Quantisation,
    /// How it challenges what a chart has; none for the irregular filling, which every chart has at first.
    pub challenge: Option<Challenge>,
}

/// How a filling is tried on a chart that has another one.
pub(super) struct Challenge {
    /// With this choice the filling is used wherever it is possible, and no other one is tried.
    pub forced_by: Fillings,
    /// Whether a chart is a candidate at all.
    pub may_fill: fn(&ChartWork) -> bool,
    /// Plans the filling for a chart, where each level may have this root mean square error. None if the chart has no map that
    /// the filling needs: the summary counts that as an embedding failure. [`Self::may_fill`] leaves out all other charts.
    pub plan: fn(&mut ChartWork, &CutChart, Vec<f64>) -> Option<BoxedFilling>,
    /// Bits of the tables that a file needs for it.
    pub table_bits: f64,
}

/// All fillings of the format.
pub(super) static FILLINGS: [FillingRow; 2] = [irregular::ROW, grid::ROW];

/// The steps of each filling at a level.
pub(super) fn level_steps(scale: &Scale, level: &LevelPlan) -> LevelSteps {
    LevelSteps::new(|filling| {
        let row = FILLINGS.iter().find(|row| row.filling == filling);
        row.map_or_else(Quantisation::default, |row| (row.steps)(scale, level))
    })
}
