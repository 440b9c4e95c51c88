//! From charts to roots: all charts are filled, and some then get another filling.

use super::chart_work::Root;
use super::choose::choose_fillings;
use super::irregular::MAX_FAILURES;
use super::root_builder::{ChartState, RootBuilder, Unfit};
use super::shared_arcs::SharedArcs;
use super::summary::{Fallbacks, Times};
use super::{ChartedMesh, Fillings};
use lodpack::index::Filling;
use lodpack_runtime::progress::Progress;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// Builds all roots of a region. Returns them with the number of their interior vertices and the processor time by
/// stage.
pub(super) fn build_roots(
    charted: &ChartedMesh,
    fillings: Fillings,
    arcs: &mut SharedArcs,
    fallbacks: &mut Fallbacks,
    progress: &dyn Progress,
) -> lodpack::Result<(Vec<Root>, u64, Times)> {
    let chart_count = charted.atlas.charts.len() as u32;
    let builder = RootBuilder { charted, progress, times: Mutex::default() };
    let mut charts = (0..chart_count).map(|chart| (chart, ChartState::default())).collect();
    let pending = (0..chart_count).collect();
    fallbacks.raised_samples += builder.build(arcs, &mut charts, pending, Unfit::FillIrregularly)?;
    choose_fillings(&builder, fillings, arcs, &mut charts, fallbacks)?;
    count_failures(&charts, fallbacks);
    let vertices = charts.values().filter_map(|state| state.root.as_ref()).map(|root| root.vertices).sum();
    Ok((charts.into_values().filter_map(|state| state.root).collect(), vertices, builder.times()))
}

/// Counts the charts that needed more than one attempt.
fn count_failures(charts: &BTreeMap<u32, ChartState>, fallbacks: &mut Fallbacks) {
    let irregular = || charts.values().filter(|state| state.filling.filling() == Filling::Irregular);
    fallbacks.retried_charts = irregular().filter(|state| state.failures > 0).count() as u64;
    fallbacks.unsimplified_charts = irregular().filter(|state| state.failures >= MAX_FAILURES).count() as u64;
}
