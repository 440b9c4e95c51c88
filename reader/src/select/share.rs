//! One budget for several things that are drawn together.

/// Most halvings of a tolerance: what is left is below the precision of coordinates.
const HALVINGS: usize = 48;

/// Steps between the last tolerance that keeps a budget and half of it; they come within a hundredth.
const STEPS: usize = 6;

/// What each of several things gets of one budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Shares {
    /// The tolerance of all: the least found at which all together keep the budget, or the largest one if none does.
    pub tolerance: f64,
    /// Triangles for each; together they are the budget.
    pub budgets: Vec<u64>,
}

/// Divides a budget of triangles over several things, such as meshes and the ground that they stand on, so that all
/// have about the same error: each gets what it takes at the least tolerance at which all together keep the budget, and
/// the last one also what is left over. Where even the coarsest of all take more, each gets its part of the budget.
///
/// `counts_at` says how many triangles each of them takes at a tolerance; these grow as it becomes smaller. The
/// `tolerances` are the least that is worth having, zero or more, and one at which everything is at its coarsest.
/// Tolerances become smaller step by step, so that not much more of an index has to be read than is drawn then.
///
/// # Errors
/// Those of `counts_at`.
pub fn share<E>(
    budget: u64,
    [least, largest]: [f64; 2],
    mut counts_at: impl FnMut(f64) -> Result<Vec<u64>, E>,
) -> Result<Shares, E> {
    let sum = |counts: &[u64]| counts.iter().fold(0_u128, |sum, &count| sum + u128::from(count));
    let keeps = |counts: &[u64]| sum(counts) <= u128::from(budget);
    let (mut tolerance, mut counts, mut finer) = (largest, counts_at(largest)?, None);
    for _ in 0..HALVINGS {
        let next = (tolerance * 0.5).max(least);
        if !keeps(&counts) || next >= tolerance {
            break;
        }
        let more = counts_at(next)?;
        if !keeps(&more) {
            finer = Some(next);
            break;
        }
        (tolerance, counts) = (next, more);
    }
    for _ in 0..STEPS {
        let Some(too_fine) = finer else { break };
        let middle = (tolerance * too_fine).sqrt();
        let more = counts_at(middle)?;
        if keeps(&more) {
            (tolerance, counts) = (middle, more);
        } else {
            finer = Some(middle);
        }
    }
    let all = sum(&counts);
    if all > u128::from(budget) {
        let part = |count: u64| u128::from(budget) * u128::from(count) / all;
        counts.iter_mut().for_each(|count| *count = part(*count) as u64);
    }
    let left = u128::from(budget) - sum(&counts);
    if let Some(last) = counts.last_mut() {
        *last += left as u64;
    }
    Ok(Shares { tolerance, budgets: counts })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Things that need `k` triangles for an error of 1 and four times as many for half of it, and no fewer than 2.
    fn shares(budget: u64, least: f64, needs: &[f64]) -> (Shares, u32) {
        let mut asked = 0;
        let shares = share(budget, [least, 1e3], |tolerance| {
            asked += 1;
            Ok::<_, ()>(needs.iter().map(|k| (k / (tolerance * tolerance)) as u64 + 2).collect())
        });
        (shares.unwrap(), asked)
    }

    #[test]
    fn all_have_the_same_error_and_together_the_budget() {
        for budget in [1000, 123_456, 1 << 40] {
            let (shares, asked) = shares(budget, 0.0, &[1.0, 10.0, 100.0]);
            assert_eq!(shares.budgets.iter().sum::<u64>(), budget);
            assert!(asked < 64);
            let [small, middle, large] = *shares.budgets else { panic!() };
            assert!(small as f64 * 9.0 < middle as f64 * 1.2 && middle as f64 * 9.0 < large as f64 * 1.2);
            // Within a fiftieth of the tolerance that uses all.
            let used = 111.0 / (shares.tolerance * shares.tolerance);
            assert!(used <= budget as f64 && used > 0.95 * budget as f64 - 10.0, "{used} of {budget}");
        }
    }

    #[test]
    fn budgets_of_nothing_too_little_and_too_much_are_shared_to_the_last_triangle() {
        for budget in [0, 1, 5, 1 << 63, u64::MAX] {
            for needs in [&[1.0, 3.0][..], &[0.0], &[]] {
                let (shares, _) = shares(budget, 0.5, needs);
                assert_eq!(shares.budgets.iter().sum::<u64>(), if needs.is_empty() { 0 } else { budget });
                assert!(shares.tolerance >= 0.5);
            }
        }
    }
}
