//! What a filling of a chart is, and what the table of fillings says of each ([`super::fillings`]).

use std::fmt::Debug;

use super::chart_work::{ChartWork, Outcome};
use super::scale::LevelPlan;
use super::shared_arcs::{CutChart, SampleWish};
use super::{Fillings, Scale};
use lodpack::index::Filling;
use lodpack::write::Quantisation;
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
    /// Plans the filling for a chart, where each level may have this root mean square error. None if the chart has no
    /// map that the filling needs: the summary counts that as an embedding failure. [`Self::may_fill`] leaves out all
    /// other charts.
    pub plan: fn(&mut ChartWork, &CutChart, Vec<f64>) -> Option<BoxedFilling>,
    /// Bits of the tables that a file needs for it.
    pub table_bits: f64,
}
