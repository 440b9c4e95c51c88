//! One budget of triangles for several things in one picture, from frame to frame.

use super::{Limiter, Shares};

/// What one of several things took of its share in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Triangles of the cut that it wants.
    pub triangles: u64,
    /// Whether it would be finer if it had more triangles.
    pub is_limited: bool,
}

/// The least tolerance that a budget raises, pixels.
const LEAST: f64 = 1.0 / 64.0;
/// How much a tolerance rises in a frame in which triangles lack; the power doubles from frame to frame up to the other
/// number.
const RAISE: f64 = 1.05;
const MOST_RAISES: i32 = 16;
/// A tolerance falls where less than this share of the budget is used, towards the other share.
const TOO_FEW: f64 = 0.92;
const ENOUGH: f64 = 0.97;
/// What is left over goes to those that lack triangles: so many times as much as to others of the same size.
const LACKS: u128 = 16;
/// A weight of more would be too large to multiply with.
const MOST_WEIGHT: u128 = 1 << 40;

/// Has several things that are drawn into one picture, such as a mesh, its ground and another mesh, keep one budget of
/// triangles, with about the same error for all: one tolerance, which rises while triangles lack and falls while some
/// are left over, and a budget for each, all of which are together the whole one in every frame.
///
/// In each frame ask for the [`SharedBudget::limits`], adapt each thing to them, and [`SharedBudget::record`] what they
/// took. [`super::share`] finds such budgets at once, but takes many cuts for it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SharedBudget {
    tolerance: f64,
    raises: i32,
    /// Of the last frame; empty before the first.
    taken: Vec<Taken>,
}

impl Taken {
    /// Of a cut with so many triangles that is not finer for this reason.
    pub fn new(triangles: u64, limited_by: Limiter) -> Self {
        Self { triangles, is_limited: limited_by == Limiter::Triangles }
    }
}

impl SharedBudget {
    /// What each of `count` things may take in the next frame, for a budget of all their triangles together and the
    /// tolerance that is worth having, pixels.
    pub fn limits(&mut self, budget: u64, tolerance: f64, count: usize) -> Shares {
        if self.taken.len() != count {
            *self = Self { taken: vec![Taken::default(); count], ..Self::default() };
        }
        let (whole, sum) =
            (u128::from(budget), self.taken.iter().map(|taken| u128::from(taken.triangles)).sum::<u128>());
        let used = sum as f64 / (whole as f64).max(1.0);
        let before = self.tolerance.max(tolerance);
        let lacks = count > 1 && self.taken.iter().any(|taken| taken.is_limited);
        self.raises = if lacks && used > 0.75 { (2 * self.raises).clamp(1, MOST_RAISES) } else { 0 };
        self.tolerance = if self.raises > 0 {
            (0..self.raises).fold(before.max(LEAST), |tolerance, _| tolerance * RAISE)
        } else if !lacks && used < TOO_FEW {
            before * (used / ENOUGH).sqrt().max(0.5)
        } else {
            before
        };
        self.tolerance = self.tolerance.max(tolerance);
        Shares { tolerance: self.tolerance, budgets: self.divided(whole, sum) }
    }

    /// What was taken, and what is left over in parts, or less of everything where nothing is.
    fn divided(&self, whole: u128, sum: u128) -> Vec<u64> {
        let most = self.taken.iter().map(|taken| u128::from(taken.triangles)).max().unwrap_or_default();
        // What is not seen now may come into view.
        let weight = |taken: &Taken| {
            let size = u128::from(taken.triangles).max(most / 8).clamp(1, MOST_WEIGHT);
            if taken.is_limited { size * LACKS } else { size }
        };
        let weights = self.taken.iter().map(weight).sum::<u128>().max(1);
        let mut left = whole;
        let mut next = |taken: &Taken| {
            let own = u128::from(taken.triangles);
            let share = match whole.checked_sub(sum) {
                Some(over) => own + over / weights * weight(taken) + over % weights * weight(taken) / weights,
                None => whole * own / sum,
            };
            left = left.saturating_sub(share);
            share
        };
        let mut budgets: Vec<u128> = self.taken.iter().map(&mut next).collect();
        if let Some(last) = budgets.last_mut() {
            *last += left;
        }
        budgets.into_iter().map(|budget| budget as u64).collect()
    }

    /// What each of them took of the last limits. Has no effect if it is not as many.
    pub fn record(&mut self, taken: &[Taken]) {
        if taken.len() == self.taken.len() {
            self.taken.copy_from_slice(taken);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Things that take `k / tolerance ^ p` triangles, and never fewer than 2.
    fn take(limits: &Shares, things: &[[f64; 2]]) -> Vec<Taken> {
        let of = |(&[k, p], &budget): (&[f64; 2], &u64)| {
            let wanted = (k / limits.tolerance.powf(p)) as u64 + 2;
            // As trees are, refined in steps.
            Taken {
                triangles: if wanted > budget { budget.saturating_sub(budget / 50).max(2) } else { wanted },
                is_limited: wanted > budget,
            }
        };
        things.iter().zip(&limits.budgets).map(of).collect()
    }

    #[test]
    fn the_budget_is_kept_in_every_frame_and_all_have_the_same_error_after_a_few() {
        for p in [[1.0, 1.0, 1.0], [2.0, 1.0, 0.7], [0.5, 2.0, 1.0]] {
            for budget in [10_000, 1_000_000, 1 << 40] {
                let mut shared = SharedBudget::default();
                let mut things = [[3e6, p[0]], [4e5, p[1]], [2e4, p[2]]];
                for frame in 0..300 {
                    if frame % 100 == 60 {
                        // Another is near, and the first out of sight.
                        things = [things[1], things[2], things[0]];
                        things[0][0] *= f64::from(frame < 200) * 2.0;
                    }
                    let limits = shared.limits(budget, 0.5, 3);
                    assert!(limits.budgets.iter().sum::<u64>() == budget && limits.tolerance >= 0.5);
                    let taken = take(&limits, &things);
                    let sum = taken.iter().map(|taken| taken.triangles).sum::<u64>();
                    assert!(sum <= budget + 6, "{budget} {frame}: {limits:?} {taken:?}");
                    if frame % 100 > 90 || frame % 100 == 59 {
                        let is_settled = limits.tolerance == 0.5 || sum as f64 > 0.85 * budget as f64;
                        assert!(
                            is_settled && taken.iter().all(|taken| !taken.is_limited),
                            "{p:?} {budget} {frame}: {limits:?} {taken:?}"
                        );
                    }
                    shared.record(&taken);
                }
            }
        }
    }

    /// The same run is in the tests of the JavaScript package, which has these rules in JavaScript.
    #[test]
    fn a_run_of_frames_has_these_limits() {
        let run: [[i64; 4]; 9] = [
            [1000, -330, -200, 300],
            [1000, -500, -250, 240],
            [1000, -600, -150, 200],
            [1000, 300, 400, 200],
            [1000, 100, 50, 0],
            [400, 300, 200, 100],
            [400, 200, -150, 20],
            [400, 150, -230, 18],
            [400, 150, 200, 18],
        ];
        let limits = [
            (0.5, [333, 333, 334]),
            (0.525, [432, 261, 307]),
            (0.578813, [506, 253, 241]),
            (0.70355, [639, 159, 202]),
            (0.677689, [333, 444, 223]),
            (0.5, [254, 127, 19]),
            (0.5, [200, 133, 67]),
            (0.525, [202, 177, 21]),
            (0.578813, [150, 231, 19]),
        ];
        let mut shared = SharedBudget::default();
        for ([budget, taken @ ..], (tolerance, budgets)) in run.into_iter().zip(limits) {
            let found = shared.limits(budget as u64, 0.5, 3);
            assert!((found.tolerance - tolerance).abs() < 1e-6 && found.budgets == budgets, "{found:?}");
            shared.record(&taken.map(|n: i64| Taken { triangles: n.unsigned_abs(), is_limited: n < 0 }));
        }
    }

    #[test]
    fn one_thing_gets_all_and_budgets_of_nothing_and_of_everything_are_divided() {
        let mut shared = SharedBudget::default();
        for budget in [0, 1, 5, 1 << 63, u64::MAX] {
            for count in [1, 3, 0, 2] {
                let taken = vec![Taken { triangles: u64::MAX / 2, is_limited: true }; count];
                for _ in 0..3 {
                    let limits = shared.limits(budget, 1.0, count);
                    assert_eq!(limits.budgets.iter().sum::<u64>(), if count == 0 { 0 } else { budget });
                    assert!(count != 1 || limits.tolerance == 1.0);
                    shared.record(&taken);
                }
            }
        }
    }
}
