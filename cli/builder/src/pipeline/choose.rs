//! Stage **choose**: which charts get another filling than the irregular one.
//!
//! All charts are first filled irregularly. Then the other fillings of the table challenge what a chart has: each is
//! planned for the same root mean square error, built within the same tolerance and certified in the same way. A
//! challenger wins where it costs fewer bits, including the arc samples that it asks for. With grids that takes three
//! to four times as long, for up to 8 % of the bytes on smooth surfaces and nothing on others: see
//! [`Fillings::Smaller`].

use super::Fillings;
use super::chart_work::Root;
use super::fill::{BoxedFilling, Challenge};
use super::fillings::FILLINGS;
use super::root_builder::{ChartState, RootBuilder, Unfit};
use super::shared_arcs::SharedArcs;
use super::summary::Fallbacks;
use lodpack::write::SymbolStatistics;
use lodpack_runtime::trace;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// The root mean square error to aim for, over that of the present filling; rounding the vertices adds to it. With
/// 0.9, grids on a scan (dragon, 39 charts) came out at 1.13 to 1.46 times the irregular fillings' error.
const RMS_SHARE: f64 = 0.7;
/// Bounds of the resulting threshold, over the level's own.
const THRESHOLD_RANGE: [f64; 2] = [0.25, 1.5];
/// Bits of an arc sample that a challenger asks for, including what it costs the neighbour.
const ARC_SAMPLE_BITS: f64 = 12.0;
/// A challenger is built and compared where its estimated bits are at most this multiple of the present filling's.
const PROMISING: f64 = 1.5;

/// Replaces fillings by others that are smaller. All `charts` have roots that fit `arcs`, before and after.
pub(super) fn choose_fillings(
    builder: &RootBuilder,
    fillings: Fillings,
    arcs: &mut SharedArcs,
    charts: &mut BTreeMap<u32, ChartState>,
    fallbacks: &mut Fallbacks,
) -> lodpack::Result<()> {
    for challenge in FILLINGS.iter().filter_map(|row| row.challenge.as_ref()) {
        let is_forced = fillings == challenge.forced_by;
        if is_forced || fillings == Fillings::Smaller {
            Tournament { builder, challenge, is_forced }.run(arcs, charts, fallbacks)?;
        }
    }
    Ok(())
}

/// One filling against what the charts have.
struct Tournament<'a> {
    builder: &'a RootBuilder<'a>,
    challenge: &'a Challenge,
    /// Whether the challenger wins wherever it meets the tolerance.
    is_forced: bool,
}

impl Tournament<'_> {
    /// Replaces the fillings of those charts where the challenger wins.
    fn run(
        &self,
        arcs: &mut SharedArcs,
        charts: &mut BTreeMap<u32, ChartState>,
        fallbacks: &mut Fallbacks,
    ) -> lodpack::Result<()> {
        let builder = self.builder;
        let statistics = symbol_statistics(charts);
        let candidates = self.plan(arcs, charts, &statistics, fallbacks);
        if candidates.is_empty() {
            return Ok(());
        }

        // All candidates are built with everything that they ask of the arcs.
        let mut tried_arcs = arcs.clone();
        let wishes = candidates.values().flat_map(|filling| filling.wishes().iter().copied()).collect();
        tried_arcs.fulfil(builder.charted, wishes)?;
        let mut challengers: BTreeMap<u32, ChartState> =
            candidates.into_iter().map(|(chart, filling)| (chart, ChartState::new(filling))).collect();
        let pending = challengers.keys().copied().collect();
        builder.build(&mut tried_arcs, &mut challengers, pending, Unfit::Drop)?;

        let winners = self.select_winners(statistics, charts, challengers);
        if winners.is_empty() {
            return Ok(());
        }

        // The arcs keep only what the winners asked for. Charts whose arcs change with that are built again.
        let former_arcs = arcs.clone();
        let wishes = winners.values().flat_map(|state| state.filling.wishes().iter().copied()).collect();
        fallbacks.raised_samples += arcs.fulfil(builder.charted, wishes)?.0;
        let since_before = arcs.differing_charts(&former_arcs, builder.charted);
        let since_tried = arcs.differing_charts(&tried_arcs, builder.charted);
        let changed = |chart: u32| {
            if winners.contains_key(&chart) { since_tried[chart as usize] } else { since_before[chart as usize] }
        };
        let pending: Vec<u32> = charts.keys().copied().filter(|&chart| changed(chart)).collect();
        charts.extend(winners);
        fallbacks.raised_samples += builder.build(arcs, charts, pending, Unfit::FillIrregularly)?;
        Ok(())
    }

    /// Plans the challenger for all charts that are candidates, and keeps the plans that are worth building.
    fn plan(
        &self,
        arcs: &SharedArcs,
        charts: &BTreeMap<u32, ChartState>,
        statistics: &SymbolStatistics,
        fallbacks: &mut Fallbacks,
    ) -> BTreeMap<u32, BoxedFilling> {
        let &Self { builder, challenge, is_forced } = self;
        let candidates: Vec<(u32, &Root)> = charts
            .iter()
            .filter(|&(&chart, _)| builder.work(arcs, chart, |work| (challenge.may_fill)(work)))
            .filter_map(|(&chart, state)| Some((chart, state.root.as_ref()?)))
            .collect();
        let plan = |&(chart, root): &(u32, &Root)| {
            let filling = builder.work(arcs, chart, |work| {
                let cut = work.cut();
                (challenge.plan)(work, &cut, thresholds(builder, root))
            });
            let is_promising = |bits_expected: f64| is_forced || bits_expected < PROMISING * bits(statistics, root);
            (chart, filling.map(|filling| is_promising(filling.estimated_bits()).then_some(filling)))
        };
        let of_all = trace::parallel("grids");
        let planned: Vec<_> = candidates.par_iter().map(plan).collect();
        drop(of_all);
        fallbacks.embedding_failures += planned.iter().filter(|(_, filling)| filling.is_none()).count() as u64;
        planned.into_iter().filter_map(|(chart, filling)| Some((chart, filling??))).collect()
    }

    /// The challengers that cost less than what the same charts have.
    fn select_winners(
        &self,
        mut statistics: SymbolStatistics,
        charts: &BTreeMap<u32, ChartState>,
        mut challengers: BTreeMap<u32, ChartState>,
    ) -> BTreeMap<u32, ChartState> {
        challengers.retain(|_, state| state.root.is_some());
        if self.is_forced {
            return challengers;
        }
        let roots = challengers.values().filter_map(|state| state.root.as_ref());
        roots.for_each(|root| count_symbols(&mut statistics, root));
        let mut gain_in_all = 0.0;
        challengers.retain(|chart, state| {
            let (Some(root), Some(present)) = (&state.root, charts.get(chart).and_then(|other| other.root.as_ref()))
            else {
                return false;
            };
            let root_bits = bits(&statistics, root) + ARC_SAMPLE_BITS * state.filling.wishes().len() as f64;
            let present_bits = bits(&statistics, present);
            // Errors fall in proportion to the number of vertices, so bits times error compares bits at equal error.
            let wins = root_bits < present_bits && root_bits * root.rms < present_bits * present.rms;
            gain_in_all += if wins { present_bits - root_bits } else { 0.0 };
            wins
        });
        if gain_in_all > self.challenge.table_bits { challengers } else { BTreeMap::new() }
    }
}

/// The errors that the levels of a chart may have for the same quality as its present root.
fn thresholds(builder: &RootBuilder, present: &Root) -> Vec<f64> {
    let scale = builder.charted.scale;
    let finest = scale.levels[usize::from(scale.finest())].threshold;
    let [least, most] = THRESHOLD_RANGE;
    let factor = (RMS_SHARE * present.rms / finest).clamp(least, most);
    scale.levels.iter().map(|level| level.threshold * factor).collect()
}

/// Counts the symbols of all roots.
fn symbol_statistics(charts: &BTreeMap<u32, ChartState>) -> SymbolStatistics {
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
