//! The cut of a threshold: each node as coarse as it can be while no error is above it.
//!
//! Errors hardly grow from a node to what is finer. So whoever refines what has the largest error until a budget is
//! used up comes through the cuts of ever smaller thresholds. The last of them is found without walking: a histogram
//! over the errors before each refinement holds what the refinements add, its sums from the largest error on say which
//! threshold uses a budget up, and the cut of that threshold is counted exactly. The histogram knows nothing of the
//! triangles and errors that neighbours add along borders, so it is asked again, corrected by what was counted. Two or
//! three drafts come within a few hundredths of a budget; the rest is up to the queues.

use super::{
    adaptation::Goal,
    draft::{Draft, Thresholds},
    front::Front,
    histogram::{BUCKETS, Histogram, Sums},
};

/// Most drafts for a threshold.
const DRAFTS: usize = 16;

/// A draft that uses this share of a budget is near enough.
const NEAR: f64 = 0.97;

/// Changes a coarsest cut to that of the smallest threshold, but no smaller one than the tolerance, whose cut keeps the
/// budgets. Returns the threshold.
pub(crate) fn cut_at_threshold(front: &mut Front, goal: &Goal) -> f64 {
    let mut draft = Draft::new(front);
    draft.saves =
        draft.hierarchy.has_children() && [goal.nodes, goal.bytes] == [u64::MAX; 2] && goal.triangles < u64::MAX;
    let mut search = Search { draft, goal, histogram: None, best: None, least_worst: f64::INFINITY };
    let (mut bucket, over) = search.last_bucket(0, None);
    if over.is_some_and(|[triangles, nodes, bytes]| {
        nodes > goal.nodes as f64 && triangles <= goal.triangles as f64 && bytes <= goal.bytes as f64
    }) {
        bucket = search.last_bucket(bucket, Some(bucket)).0;
    }
    let (threshold, best) = (search.threshold(bucket), search.best.take());
    if let Some(resolutions) = best {
        front.lay(&resolutions);
    }
    threshold
}

/// What is known while a threshold is looked for.
struct Search<'f, 'g> {
    draft: Draft<'f>,
    goal: &'g Goal,
    histogram: Option<Histogram>,
    /// The finest draft that keeps the budgets.
    best: Option<Vec<u8>>,
    /// The least largest error of a cut so far.
    least_worst: f64,
}

impl Search<'_, '_> {
    /// The last bucket from `low` on whose cut keeps the budgets, and what one that does not would take. Splits end
    /// with bucket `split` where there is one.
    fn last_bucket(&mut self, mut low: usize, split: Option<usize>) -> (usize, Option<Sums>) {
        let (mut high, mut guess, mut over) = (BUCKETS + 1, BUCKETS, None);
        let budgets = [self.goal.triangles, self.goal.nodes, self.goal.bytes];
        for draft in 0..DRAFTS {
            let refine = self.threshold(guess);
            let split = split.map_or(refine, |split| self.threshold(split));
            let used = self.draft.make(Thresholds { refine, split }, self.goal.bytes < u64::MAX);
            let fits = (0..3).all(|k| used[k] <= budgets[k]);
            // Where something finer has larger errors, a smaller threshold may be no gain.
            let worst = if fits && self.histogram.is_some() { self.draft.worst_error() } else { 0.0 };
            if fits && worst <= self.least_worst.max(if split.is_finite() { split } else { refine }) {
                low = guess;
                self.least_worst = self.least_worst.min(worst);
                self.best = Some(self.draft.resolutions.clone());
                let is_near = |k: usize| budgets[k] < u64::MAX && used[k] as f64 >= budgets[k] as f64 * NEAR;
                if is_near(0) || is_near(2) {
                    break;
                }
            } else {
                (high, over) = (guess, Some(used.map(|sum| sum as f64)));
            }
            if high - low <= 1 || guess == low && guess == BUCKETS {
                break;
            }
            if self.histogram.is_none() {
                self.draft.make(Thresholds { refine: f64::INFINITY, split: f64::INFINITY }, false);
                self.least_worst = self.draft.worst_error();
            }
            let histogram = self.histogram.get_or_insert_with(|| self.draft.histogram(self.goal.tolerance));
            guess = match draft {
                0..5 => histogram.guess(budgets, guess, used).clamp(low + 1, high - 1),
                _ => low.midpoint(high),
            };
        }
        (low, over)
    }

    /// The threshold at which all refinements in the first `bucket` buckets are made.
    fn threshold(&self, bucket: usize) -> f64 {
        match &self.histogram {
            _ if bucket == 0 => f64::INFINITY,
            Some(histogram) if bucket < BUCKETS => histogram.end(bucket).max(self.goal.tolerance),
            _ => self.goal.tolerance,
        }
    }
}
