//! Stage **choose**: which charts become grids.
//!
//! All charts are filled irregularly first. Then disks are challenged by grids of the same root mean square error, at equal
//! tolerance and certified in the same way; a grid that costs fewer bits, the arc samples that it asks for included, wins. That
//! takes three to four times as long, for up to 8 % of the bytes of smooth surfaces and nothing of others: see [`Effort::Best`].

use super::borders::{Borders, Raise};
use super::grid::GridFilling;
use super::root::{ChartState, Choice, Root, RootBuilder, Unfit};
use super::{Effort, Fillings};
use crate::pipeline::summary::Fallbacks;
use lodpack::write::SymbolStatistics;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A grid's root mean square error aimed at over the irregular filling's: rounding its vertices adds to it. With 0.9, grids
/// on a scan (dragon, 39 charts) came out at 1.13 to 1.46 times the irregular fillings' error.
const RMS_SHARE: f64 = 0.7;
/// Bounds of the threshold that this gives, over the level's own.
const THRESHOLD_RANGE: [f64; 2] = [0.25, 1.5];
/// Bits of an arc sample that a grid asks for, with what it costs the neighbour.
const ARC_SAMPLE_BITS: f64 = 12.0;
/// Bits of a file's tables for grids.
const TABLE_BITS: f64 = 4000.0;
/// Estimated bits of a grid over those of the irregular filling up to which the grid is built and compared.
const PROMISING: f64 = 1.5;

/// Replaces irregular fillings by grids where these are smaller. `charts` have their roots for `borders`, and again on return.
pub(super) fn choose_fillings(
    builder: &RootBuilder,
    (fillings, effort): (Fillings, Effort),
    borders: &mut Borders,
    charts: &mut BTreeMap<u32, ChartState>,
    fallbacks: &mut Fallbacks,
) -> lodpack::Result<()> {
    if fillings == Fillings::IrregularOnly || fillings == Fillings::Auto && effort != Effort::Best {
        return Ok(());
    }
    let statistics = irregular_statistics(charts);
    let candidates = plan_grids(builder, fillings, borders, charts, &statistics, fallbacks);
    if candidates.is_empty() {
        return Ok(());
    }

    // All candidates are built with all that they ask of the arcs.
    let mut tried_borders = borders.clone();
    let wishes: Vec<Raise> = candidates.values().flat_map(|grid| grid.wishes.iter().copied()).collect();
    tried_borders.raise(builder.surface, wishes)?;
    let state = |grid| ChartState { choice: Choice::Grid(Box::new(grid)), ..ChartState::default() };
    let mut grids: BTreeMap<u32, ChartState> =
        candidates.into_iter().map(|(chart, grid)| (chart, state(grid))).collect();
    let pending = grids.keys().copied().collect();
    builder.build(&mut tried_borders, &mut grids, pending, Unfit::Drop)?;

    let winners = select_winners(fillings, statistics, charts, grids);
    if winners.is_empty() {
        return Ok(());
    }

    // The arcs keep only what the winners asked for; whatever changed with that is built again.
    let irregular_borders = borders.clone();
    let wishes = winners.values().flat_map(wishes_of).collect();
    fallbacks.raised_samples += borders.raise(builder.surface, wishes)?.0;
    let since_irregular = borders.differing_charts(&irregular_borders, builder.surface);
    let since_grids = borders.differing_charts(&tried_borders, builder.surface);
    let changed = |chart: u32| {
        if winners.contains_key(&chart) { since_grids[chart as usize] } else { since_irregular[chart as usize] }
    };
    let pending: Vec<u32> = charts.keys().copied().filter(|&chart| changed(chart)).collect();
    charts.extend(winners);
    fallbacks.raised_samples += builder.build(borders, charts, pending, Unfit::FillIrregularly)?;
    Ok(())
}

fn wishes_of(state: &ChartState) -> Vec<Raise> {
    match &state.choice {
        Choice::Grid(grid) => grid.wishes.clone(),
        Choice::Irregular => vec![],
    }
}

/// Statistics of the symbols of all irregular fillings.
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

/// Plans of the grids that are worth building.
fn plan_grids(
    builder: &RootBuilder,
    fillings: Fillings,
    borders: &Borders,
    charts: &BTreeMap<u32, ChartState>,
    statistics: &SymbolStatistics,
    fallbacks: &mut Fallbacks,
) -> BTreeMap<u32, GridFilling> {
    let is_forced = fillings == Fillings::GridWherePossible;
    let disks: Vec<(u32, &Root)> = charts
        .iter()
        .filter(|&(&chart, _)| builder.work(borders, chart, |work| work.may_be_grid()))
        .filter_map(|(&chart, state)| Some((chart, state.root.as_ref()?)))
        .collect();
    let plan = |&(chart, root): &(u32, &Root)| {
        let grid = builder.work(borders, chart, |work| {
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

/// Errors that the levels of a chart's grid may have, for the same quality as its irregular filling has.
fn thresholds(builder: &RootBuilder, irregular: &Root) -> Vec<f64> {
    let scale = builder.surface.scale;
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
        // Errors fall with the number of vertices: bits at equal error go with bits times error.
        let wins = grid_bits < irregular_bits && grid_bits * grid.rms < irregular_bits * irregular.rms;
        gain_in_all += if wins { irregular_bits - grid_bits } else { 0.0 };
        wins
    });
    if gain_in_all > TABLE_BITS { grids } else { BTreeMap::new() }
}
