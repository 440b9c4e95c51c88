//! From charts to roots: all charts are filled, and some then get another filling.

use super::chart_work::Root;
use super::choose::choose_fillings;
use super::divided::shared_chords;
use super::irregular::MAX_FAILURES;
use super::region_progress::RegionProgress;
use super::root_builder::{ChartState, RootBuilder, Unfit};
use super::shared_arcs::SharedArcs;
use super::summary::{Fallbacks, Times};
use super::{ChartedMesh, Fillings};
use lodpack::index::Filling;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// How often charts are built again because they have edges in common.
const MAX_DIVISIONS: usize = 3;

/// Builds all roots of a region. Returns them with the number of their interior vertices and the processor time by
/// stage.
pub(super) fn build_roots(
    charted: &ChartedMesh,
    fillings: Fillings,
    arcs: &mut SharedArcs,
    fallbacks: &mut Fallbacks,
    progress: &RegionProgress<'_>,
) -> lodpack::Result<(Vec<Root>, u64, Times)> {
    let chart_count = charted.atlas.charts.len() as u32;
    let builder = RootBuilder { charted, progress, times: Mutex::default() };
    let mut charts = (0..chart_count).map(|chart| (chart, ChartState::default())).collect();
    let pending = (0..chart_count).collect();
    fallbacks.raised_samples += builder.build(arcs, &mut charts, pending, Unfit::FillIrregularly)?;
    choose_fillings(&builder, fillings, arcs, &mut charts, fallbacks)?;
    for _ in 0..MAX_DIVISIONS {
        let pending = divide_shared_chords(charted, arcs, &mut charts);
        if pending.is_empty() {
            break;
        }
        fallbacks.raised_samples += builder.build(arcs, &mut charts, pending, Unfit::FillIrregularly)?;
    }
    progress.filled();
    count_failures(&charts, fallbacks);
    let vertices = charts.values().filter_map(|state| state.root.as_ref()).map(|root| root.vertices).sum();
    Ok((charts.into_values().filter_map(|state| state.root).collect(), vertices, builder.times()))
}

/// Tells charts which of their chords to divide. Returns those that have to be built again for it, ascending.
fn divide_shared_chords(charted: &ChartedMesh, arcs: &SharedArcs, charts: &mut BTreeMap<u32, ChartState>) -> Vec<u32> {
    let chords = charts.iter().flat_map(|(&chart, state)| {
        let can_divide = state.filling.filling() == Filling::Irregular;
        state.root.iter().flat_map(|root| &root.chords).map(move |&chord| (chord, chart, can_divide))
    });
    let mut again = vec![];
    for (chart, chord) in shared_chords(charted, arcs, chords) {
        let Some(state) = charts.get_mut(&chart) else { continue };
        // What has not helped once does not help again.
        if !state.divided.contains(&chord) {
            state.divided.push(chord);
            again.push(chart);
        }
    }
    again.sort_unstable();
    again.dedup();
    again
}

/// Counts the charts that needed more than one attempt.
fn count_failures(charts: &BTreeMap<u32, ChartState>, fallbacks: &mut Fallbacks) {
    let irregular = || charts.values().filter(|state| state.filling.filling() == Filling::Irregular);
    fallbacks.retried_charts = irregular().filter(|state| state.failures > 0).count() as u64;
    fallbacks.unsimplified_charts = irregular().filter(|state| state.failures >= MAX_FAILURES).count() as u64;
}
