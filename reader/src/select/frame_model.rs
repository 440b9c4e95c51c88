//! What a frame takes, as a sum of costs (Peng 2013, equation 4.9): least squares over the frames so far, of which old
//! ones count less.

/// What was drawn in a frame, and how long that took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameTimes {
    /// Time of the frame, in any unit: where processor and device work side by side, that of the slower one.
    pub frame: f64,
    /// Of which for adapting.
    pub adapt: f64,
    /// Nodes that were drawn.
    pub node_count: u64,
    /// Triangles that were drawn.
    pub triangle_count: u64,
    /// Bytes that were uploaded to be drawn.
    pub upload_bytes: u64,
}

/// How many costs there are.
const COUNT: usize = 4;
/// What a frame counts after the next one.
const MEMORY: f64 = 0.95;
/// How strongly costs stay what they were, as if they had been seen in so many frames: triangles least, so that what is
/// not known to be something else counts as theirs.
const STAYS: [f64; COUNT] = [0.02, 0.02, 0.0005, 0.02];
/// Errors of more than this many usual ones count as if they were that large: a frame in which something else ran.
const OUTLIER: f64 = 3.0;
/// The machine has another speed if this many frames in a row take less or more than expected by this factor.
const CHANGED: (usize, f64) = (3, 1.4);

/// Predicts the time of a frame:
///
/// > time = fixed + a nodes + b triangles + c bytes
///
/// in the unit of the times that were recorded. No cost is negative.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameModel {
    /// Weighted sums over the frames: of the products of their amounts, and of amounts with times.
    products: [[f64; COUNT]; COUNT],
    moments: [f64; COUNT],
    costs: [f64; COUNT],
    /// Times over predictions of the last frames, as far as all are too large or all too small.
    ratios: Vec<f64>,
    /// Weighted sums over the frames that were predicted: their number, times, squares of times, squares of errors.
    judged: [f64; 4],
}

/// The amounts that have costs.
fn amounts(times: &FrameTimes) -> [f64; COUNT] {
    [1.0, times.node_count as f64, times.triangle_count as f64, times.upload_bytes as f64]
}

impl FrameModel {
    /// Records a frame. Ignores one whose time is not a number above zero.
    pub fn record(&mut self, times: &FrameTimes) {
        let time = times.frame;
        if !(time > 0.0 && time.is_finite()) {
            return;
        }
        let is_known = self.products[0][0] > 0.0;
        let (amounts, predicted) = (amounts(times), self.predict(times));
        let mut weight = 1.0;
        if is_known {
            let error = (time - predicted).abs();
            let usual = (self.judged[3] / self.judged[0].max(1.0)).sqrt();
            if self.judged[0] > 4.0 && error > OUTLIER * usual {
                weight = OUTLIER * usual / error;
            }
            for (sum, term) in self.judged.iter_mut().zip([1.0, time, time * time, error * error]) {
                *sum = *sum * MEMORY + term;
            }
            self.follow_speed(time / predicted);
        }
        for (k, row) in self.products.iter_mut().enumerate() {
            for (product, other) in row.iter_mut().zip(amounts) {
                *product = *product * MEMORY + weight * amounts[k] * other;
            }
            self.moments[k] = self.moments[k] * MEMORY + weight * amounts[k] * time;
        }
        self.solve();
    }

    /// The time of a frame with these amounts; 0 before anything was recorded. Times are not looked at.
    pub fn predict(&self, times: &FrameTimes) -> f64 {
        self.costs.iter().zip(amounts(times)).map(|(cost, amount)| cost * amount).sum()
    }

    /// The costs: of a frame, a node, a triangle, and a byte.
    pub fn costs(&self) -> [f64; 4] {
        self.costs
    }

    /// The share of the variance of times that predictions have explained, each made before its frame: at most 1,
    /// below 0 where the mean would have been better. None before there were enough frames.
    pub fn r_squared(&self) -> Option<f64> {
        let [count, sum, squares, errors] = self.judged;
        let variance = squares - sum * sum / count;
        (count > 4.0 && variance > 0.0).then(|| 1.0 - errors / variance)
    }

    /// Where all costs have changed alike, since something else runs on the machine or no longer does, earlier frames
    /// count as if they had had the new speed.
    fn follow_speed(&mut self, ratio: f64) {
        let (enough, factor) = CHANGED;
        let is_slower = ratio > factor;
        let goes_on = self.ratios.last().is_none_or(|&last| (last > 1.0) == is_slower);
        if !(goes_on && ratio.is_finite() && (is_slower || ratio * factor < 1.0)) {
            self.ratios.clear();
            return;
        }
        self.ratios.push(ratio);
        if self.ratios.len() == enough {
            self.ratios.sort_by(f64::total_cmp);
            let median = self.ratios[enough / 2];
            self.ratios.clear();
            self.moments.iter_mut().chain(&mut self.costs).for_each(|number| *number *= median);
        }
    }

    /// Least squares, in which each cost tends to what it was; costs that would be negative are 0.
    fn solve(&mut self) {
        let weight = self.products[0][0];
        let scale = |k: usize| self.products[k][k].sqrt();
        let mut is_free = [0, 1, 2, 3].map(|k| scale(k) > 0.0);
        let before = self.costs;
        for _ in 0..COUNT {
            // Amounts are scaled, so that all have the same size.
            let mut rows = [[0.0; COUNT + 1]; COUNT];
            for (k, row) in rows.iter_mut().enumerate() {
                if !is_free[k] {
                    row[k] = 1.0;
                    continue;
                }
                for (other, entry) in row[..COUNT].iter_mut().enumerate().filter(|(other, _)| is_free[*other]) {
                    *entry = self.products[k][other] / (scale(k) * scale(other));
                }
                row[COUNT] = self.moments[k] / scale(k) + STAYS[k] / weight.max(1.0) * before[k] * scale(k);
                row[k] += STAYS[k] / weight.max(1.0);
            }
            let solved = eliminate(rows);
            let negative = (0..COUNT).filter(|&k| is_free[k]).find(|&k| solved[k] < 0.0);
            self.costs = [0, 1, 2, 3].map(|k| if is_free[k] { solved[k].max(0.0) / scale(k) } else { 0.0 });
            match negative {
                Some(k) => is_free[k] = false,
                None => break,
            }
        }
    }
}

/// Solves a positive definite system, whose last column is the right side.
fn eliminate(mut rows: [[f64; COUNT + 1]; COUNT]) -> [f64; COUNT] {
    for k in 0..COUNT {
        let pivot = rows[k];
        for row in &mut rows[k + 1..] {
            let factor = row[k] / pivot[k];
            row.iter_mut().zip(pivot).for_each(|(entry, above)| *entry -= factor * above);
        }
    }
    let mut solved = [0.0; COUNT];
    for k in (0..COUNT).rev() {
        let known: f64 = (k + 1..COUNT).map(|other| rows[k][other] * solved[other]).sum();
        solved[k] = (rows[k][COUNT] - known) / rows[k][k];
    }
    solved
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of some machine: 2 for each, .01 a node, .00002 a triangle, .000001 a byte, times noise of a share.
    fn frame(number: u64, noise: f64) -> FrameTimes {
        let random =
            |salt: u64| (number.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(salt as u32 * 13) >> 40) as f64;
        let random = |salt| random(salt) / f64::from(1 << 24);
        let node_count = (100.0 + 400.0 * random(1)) as u64;
        let triangle_count = (2e5 + 8e5 * random(2)) as u64;
        let upload_bytes = (2e6 * random(3)) as u64;
        let frame = 2.0 + node_count as f64 * 0.01 + triangle_count as f64 * 2e-5 + upload_bytes as f64 * 1e-6;
        let frame = frame * (1.0 + noise * (2.0 * random(4) - 1.0));
        FrameTimes { frame, adapt: 0.0, node_count, triangle_count, upload_bytes }
    }

    #[test]
    fn finds_the_costs_and_says_how_well_they_explain_the_times() {
        let mut model = FrameModel::default();
        (0..200).for_each(|number| model.record(&frame(number, 0.0)));
        for (found, real) in model.costs().into_iter().zip([2.0, 0.01, 2e-5, 1e-6]) {
            assert!((found / real - 1.0).abs() < 0.02, "{:?}", model.costs());
        }
        assert!(model.r_squared().unwrap() > 0.99);
        let mut noisy = FrameModel::default();
        (0..200).for_each(|number| noisy.record(&frame(number, 0.1)));
        assert!((0.8..0.99).contains(&noisy.r_squared().unwrap()), "{:?}", noisy.r_squared());
    }

    #[test]
    fn a_pause_changes_little_and_another_speed_everything() {
        let mut model = FrameModel::default();
        (0..100).for_each(|number| model.record(&frame(number, 0.02)));
        let probe = frame(7, 0.0);
        model.record(&FrameTimes { frame: 500.0, ..frame(100, 0.0) });
        assert!((model.predict(&probe) / probe.frame - 1.0).abs() < 0.1);
        for number in 101..105 {
            let times = frame(number, 0.0);
            model.record(&FrameTimes { frame: 3.0 * times.frame, ..times });
        }
        assert!((model.predict(&probe) / probe.frame / 3.0 - 1.0).abs() < 0.1, "{}", model.predict(&probe));
    }

    #[test]
    fn frames_that_are_all_alike_and_nonsense_do_no_harm() {
        let mut model = FrameModel::default();
        assert_eq!((model.predict(&frame(1, 0.0)), model.r_squared()), (0.0, None));
        for time in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            model.record(&FrameTimes { frame: time, ..frame(1, 0.0) });
        }
        assert_eq!(model, FrameModel::default());
        let times = frame(1, 0.0);
        for _ in 0..100_000 {
            model.record(&times);
        }
        assert!((model.predict(&times) / times.frame - 1.0).abs() < 0.01);
        assert!(model.costs().iter().all(|cost| cost.is_finite() && *cost >= 0.0));
        let nothing = FrameTimes { frame: 1.0, ..FrameTimes::default() };
        model.record(&nothing);
        let most = FrameTimes { node_count: u64::MAX, triangle_count: u64::MAX, upload_bytes: u64::MAX, ..nothing };
        model.record(&most);
        assert!(model.costs().iter().all(|cost| cost.is_finite() && *cost >= 0.0), "{:?}", model.costs());
    }
}
