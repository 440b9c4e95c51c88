//! Stage **choose**: which charts become grids.
//!
//! All charts are first filled irregularly. Then a grid of the same root mean square error, within the same tolerance and certified in
//! the same way, challenges the filling of every disk. The grid wins where it costs fewer bits, including the arc samples that it asks
//! for. That takes three to four times as long, for up to 8 % of the bytes on smooth surfaces and nothing on others: see
//! [`Effort::Best`].

use super::chart_work::Root;
use super::grid::GridFilling;
use super::roots::{ChartState, Choice, RootBuilder, Unfit};
use super::shared_arcs::{SampleWish, SharedArcs};
use super::summary::Fallbacks;
use super::{Effort, Fillings};
use lodpack::SymbolStatistics;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The root mean square error to aim for in a grid, over that of the irregular filling; rounding the grid's vertices adds to it. With
/// 0.9, grids on a scan (dragon, 39 charts) came out at 1.13 to 1.46 times the irregular fillings' error.
const RMS_SHARE: f64 = 0.7;
/// Bounds of the resulting threshold, over the level's own.
const THRESHOLD_RANGE: [f64; 2] = [0.25, 1.5];
/// Bits of an arc sample that a grid asks for, including what it costs the neighbour.
const ARC_SAMPLE_BITS: f64 = 12.0;
/// Bits of the tables that a file with grids needs.
const TABLE_BITS: f64 = 4000.0;
/// A grid is built and compared where its estimated bits are at most this multiple of the irregular filling's.
const PROMISING: f64 = 1.5;

/// Replaces irregular fillings by grids where these are smaller. All `charts` have roots that fit `arcs`, before and after.
pub(super) fn choose_fillings(
    builder: &RootBuilder,
    (fillings, effort): (Fillings, Effort),
    arcs: &mut SharedArcs,
    charts: &mut BTreeMap<u32, ChartState>,
    fallbacks: &mut Fallbacks,
) -> lodpack::Result<()> {
    if fillings == Fillings::IrregularOnly || fillings == Fillings::Auto && effort != Effort::Best {
        return Ok(());
    }
    let statistics = irregular_statistics(charts);
    let candidates = plan_grids(builder, fillings, arcs, charts, &statistics, fallbacks);
    if candidates.is_empty() {
        return Ok(());
    }

    // All candidates are built with everything that they ask of the arcs.
    let mut tried_arcs = arcs.clone();
    let wishes: Vec<SampleWish> = candidates.values().flat_map(|grid| grid.wishes.iter().copied()).collect();
    tried_arcs.fulfil(builder.charted, wishes)?;
    let state = |grid| ChartState { choice: Choice::Grid(Box::new(grid)), ..ChartState::default() };
    let mut grids: BTreeMap<u32, ChartState> =
        candidates.into_iter().map(|(chart, grid)| (chart, state(grid))).collect();
    let pending = grids.keys().copied().collect();
    builder.build(&mut tried_arcs, &mut grids, pending, Unfit::Drop)?;

    let winners = select_winners(fillings, statistics, charts, grids);
    if winners.is_empty() {
        return Ok(());
    }

    // The arcs keep only what the winners asked for. Charts whose arcs change with that are built again.
    let irregular_arcs = arcs.clone();
    let wishes = winners.values().flat_map(wishes_of).collect();
    fallbacks.raised_samples += arcs.fulfil(builder.charted, wishes)?.0;
    let since_irregular = arcs.differing_charts(&irregular_arcs, builder.charted);
    let since_grids = arcs.differing_charts(&tried_arcs, builder.charted);
    let changed = |chart: u32| {
        if winners.contains_key(&chart) { since_grids[chart as usize] } else { since_irregular[chart as usize] }
    };
    let pending: Vec<u32> = charts.keys().copied().filter(|&chart| changed(chart)).collect();
    charts.extend(winners);
    fallbacks.raised_samples += builder.build(arcs, charts, pending, Unfit::FillIrregularly)?;
    Ok(())
}

fn wishes_of(state: &ChartState) -> Vec<SampleWish> {
    match &state.choice {
        Choice::Grid(grid) => grid.wishes.clone(),
        Choice::Irregular => vec![],
    }
}

/// Counts the symbols of all irregular fillings.
fn irregular_statistics(charts: &BTreeMap<u32, ChartState>) -> SymbolStatistics {
    let mut statistics = SymbolStatistics::default();
    charts.values().filter_map(|state| state.root.as_ref()).for_each(|root| count_symbols(&mut statistics, root));
    statistics
}

fn count_symbols(statistics: &mut SymbolStatistics, root: &Root) {
    root.record.blocks.iter().flatten().for_each(|block| statistics.add(&block.symbols));
}

fn bits(statistics: &SymbolStatistics, root: &Root) -> f64 {
    root.record.blocks.iter().flatten().map(|block| statistics.bits(&block.symbols)).sum()
}

/// Plans grids, and keeps those that are worth building.
fn plan_grids(
    builder: &RootBuilder,
    fillings: Fillings,
    arcs: &SharedArcs,
    charts: &BTreeMap<u32, ChartState>,
    statistics: &SymbolStatistics,
    fallbacks: &mut Fallbacks,
) -> BTreeMap<u32, GridFilling> {
    let is_forced = fillings == Fillings::GridWherePossible;
    let disks: Vec<(u32, &Root)> = charts
        .iter()
        .filter(|&(&chart, _)| builder.work(arcs, chart, |work| work.may_be_grid()))
        .filter_map(|(&chart, state)| Some((chart, state.root.as_ref()?)))
        .collect();
    let plan = |&(chart, root): &(u32, &Root)| {
        let grid = builder.work(arcs, chart, |work| {
            let cut = work.cut();
            work.plan_grid(&cut, thresholds(builder, root))
        });
        let is_promising = |grid: &GridFilling| is_forced || grid.estimated_bits() < PROMISING * bits(statistics, root);
        (chart, grid.map(|grid| is_promising(&grid).then_some(grid)))
    };
    let planned: Vec<_> = disks.par_iter().map(plan).collect();
    fallbacks.embedding_failures = planned.iter().filter(|(_, grid)| grid.is_err()).count() as u64;
    planned.into_iter().filter_map(|(chart, grid)| Some((chart, grid.ok()??))).collect()
}

/// The errors that the levels of a chart's grid may have for the same quality as the irregular filling.
fn thresholds(builder: &RootBuilder, irregular: &Root) -> Vec<f64> {
    let scale = builder.charted.scale;
    let finest = scale.levels[usize::from(scale.finest())].threshold;
    let [least, most] = THRESHOLD_RANGE;
    let factor = (RMS_SHARE * irregular.rms / finest).clamp(least, most);
    scale.levels.iter().map(|level| level.threshold * factor).collect()
}

/// The grids that cost less than the irregular fillings of the same charts.
fn select_winners(
    fillings: Fillings,
    mut statistics: SymbolStatistics,
    charts: &BTreeMap<u32, ChartState>,
    mut grids: BTreeMap<u32, ChartState>,
) -> BTreeMap<u32, ChartState> {
    grids.retain(|_, state| state.root.is_some());
    if fillings == Fillings::GridWherePossible {
        return grids;
    }
    grids.values().filter_map(|state| state.root.as_ref()).for_each(|root| count_symbols(&mut statistics, root));
    let mut gain_in_all = 0.0;
    grids.retain(|chart, state| {
        let (Some(grid), Some(irregular)) = (&state.root, charts.get(chart).and_then(|other| other.root.as_ref()))
        else {
            return false;
        };
        let grid_bits = bits(&statistics, grid) + ARC_SAMPLE_BITS * wishes_of(state).len() as f64;
        let irregular_bits = bits(&statistics, irregular);
        // Errors fall in proportion to the number of vertices, so bits times error compares bits at equal error.
        let wins = grid_bits < irregular_bits && grid_bits * grid.rms < irregular_bits * irregular.rms;
        gain_in_all += if wins { irregular_bits - grid_bits } else { 0.0 };
        wins
    });
    if gain_in_all > TABLE_BITS { grids } else { BTreeMap::new() }
}
