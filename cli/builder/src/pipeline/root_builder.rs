//! Charts are filled side by side, and again with their neighbours until their borders are settled.

use super::ChartedMesh;
use super::chart_work::{ChartWork, Outcome, Root};
use super::divided::Edge;
use super::fill::BoxedFilling;
use super::irregular::{IrregularFilling, MAX_FAILURES};
use super::region_progress::RegionProgress;
use super::shared_arcs::SharedArcs;
use super::summary::Times;
use lodpack_runtime::trace;
use lodpack_stage::certify;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Mutex;

/// A chart on its way to a root.
#[derive(Debug)]
pub(super) struct ChartState {
    pub filling: BoxedFilling,
    /// How many attempts were above the tolerance.
    pub failures: u32,
    /// Whether the chart is left without a root: see [`Unfit::Drop`].
    pub is_dropped: bool,
    /// Edges that get a vertex in their middle, because others have them, too.
    pub divided: Vec<Edge>,
    pub root: Option<Root>,
}

impl Default for ChartState {
    fn default() -> Self {
        Self::new(Box::<IrregularFilling>::default())
    }
}

impl ChartState {
    /// A chart that has not been tried yet.
    pub fn new(filling: BoxedFilling) -> Self {
        Self { filling, failures: 0, is_dropped: false, divided: vec![], root: None }
    }
}

/// What to do with a chart whose filling does not meet the tolerance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unfit {
    /// Leave it without a root.
    Drop,
    /// Fill it irregularly.
    FillIrregularly,
}

/// Builds the roots of many charts side by side.
pub(super) struct RootBuilder<'a> {
    pub charted: &'a ChartedMesh<'a>,
    pub progress: &'a RegionProgress<'a>,
    pub times: Mutex<Times>,
}

impl RootBuilder<'_> {
    /// Builds the roots of `pending` charts. A chart that needs more samples on its arcs is built again together with
    /// those of its neighbours that are among `charts`, until no chart does. Returns how many arc samples were added.
    pub fn build(
        &self,
        arcs: &mut SharedArcs,
        charts: &mut BTreeMap<u32, ChartState>,
        mut pending: Vec<u32>,
        unfit: Unfit,
    ) -> lodpack::Result<u64> {
        let mut added_in_all = 0;
        while !pending.is_empty() {
            let started: Vec<(u32, ChartState)> = pending
                .iter()
                .filter_map(|&chart| charts.get_mut(&chart).map(|state| (chart, std::mem::take(state))))
                .collect();
            let of_all = trace::parallel("charts");
            let tried: Vec<(u32, ChartState, Outcome)> = started
                .into_par_iter()
                .map(|(chart, mut state)| {
                    let outcome = self.work(arcs, chart, |work| work.fill(&mut state));
                    (chart, state, outcome)
                })
                .collect();
            drop(of_all);
            let (mut wishes, mut wishing, mut again) = (vec![], vec![], vec![]);
            for (chart, mut state, outcome) in tried {
                match outcome {
                    Outcome::Done(root) => state.root = Some(*root),
                    Outcome::Wishes(list) => {
                        wishes.extend(list);
                        wishing.push(chart);
                    }
                    Outcome::Unfit => {
                        state = ChartState { is_dropped: unfit == Unfit::Drop, ..ChartState::default() };
                        if unfit == Unfit::FillIrregularly {
                            again.push(chart);
                        }
                    }
                }
                charts.insert(chart, state);
            }
            let (added, touched) = arcs.fulfil(self.charted, wishes)?;
            added_in_all += added;
            again.extend(touched.into_iter().filter(|chart| charts.get(chart).is_some_and(|state| !state.is_dropped)));
            again.sort_unstable();
            again.dedup();
            // A chart whose wishes could not be fulfilled is built without them, a few times at most.
            for chart in wishing {
                if let (Err(_), Some(state)) = (again.binary_search(&chart), charts.get_mut(&chart)) {
                    state.failures += 1;
                    if state.failures > MAX_FAILURES + 3 {
                        let what = format!(
                            "the border of chart {chart} cannot be simplified; this is a defect of lodpack, please report it"
                        );
                        return Err(lodpack::Error::Model { what });
                    }
                    again.push(chart);
                }
            }
            again.sort_unstable();
            pending = again;
        }
        Ok(added_in_all)
    }

    /// Runs a task on a chart and adds the time that it takes to the sum.
    pub fn work<T>(&self, arcs: &SharedArcs, chart: u32, task: impl FnOnce(&mut ChartWork) -> T) -> T {
        let _pass = trace::pass("chart");
        let (charted, times) = (self.charted, Times::default());
        let mut work = ChartWork { charted, arcs, chart, divided: vec![], times };
        let result = task(&mut work);
        if let Ok(mut times) = self.times.lock() {
            times.add(&work.times);
        }
        self.progress.tried();
        result
    }

    /// Processor time by stage.
    pub fn times(&self) -> Times {
        self.times.lock().map(|times| *times).unwrap_or_default()
    }
}

impl ChartWork<'_> {
    /// Fills the chart with the filling that is chosen for it.
    fn fill(&mut self, state: &mut ChartState) -> Outcome {
        self.divided.clone_from(&state.divided);
        let cut = self.cut();
        let original = certify::Surface::new(&cut.original, &cut.mesh.triangles);
        state.filling.fill(self, &cut, &original, &mut state.failures)
    }
}
