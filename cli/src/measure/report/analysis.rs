//! Conclusions from the numbers: Pareto fronts, slopes, and whether the default settings are on the front.

use super::{BuildRow, CutRow, InputFacts, Varied};
use serde::Serialize;

/// Differences up to this share count as noise.
pub(crate) const NOISE: f64 = 0.02;
/// Slopes use errors at up to this share of the input's triangles. With more, a drawn surface becomes the input itself,
/// whose facets are not a smooth surface.
const FITTED_SHARE: f64 = 0.25;
/// A slope through fewer points means nothing.
const MIN_FITTED: usize = 3;

/// The slope of an error over a number of triangles or samples.
#[derive(Clone, Debug, Serialize)]
pub struct Order {
    /// `builds`: files, each built to a tolerance. `cuts`: tolerances asked of one file.
    pub of: &'static str,
    /// `rms`, `max` or `certified`.
    pub error: &'static str,
    /// `triangles` or `samples`.
    pub over: &'static str,
    /// Least-squares slope in log-log: -1 for an error that halves when the number doubles.
    pub slope: f64,
    /// The error at number 1 on the fitted line, in input units.
    pub at_one: f64,
    /// Root mean square distance of the points from the line, as a factor minus 1.
    pub scatter: f64,
    /// Number of points.
    pub points: usize,
    /// Smallest and largest number.
    pub range: [f64; 2],
    /// The range of slopes that theory expects for such a surface.
    pub expected: [f64; 2],
}

/// A line through logarithms: slope, value at 1, scatter.
pub(crate) fn fit(points: &[(f64, f64)]) -> Option<(f64, f64, f64)> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(x, y)| *x > 0.0 && *y > 0.0).map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let mean = |pick: fn(&(f64, f64)) -> f64| logs.iter().map(pick).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let spread: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    if logs.len() < MIN_FITTED || spread <= 1e-9 {
        return None;
    }
    let slope = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread;
    let constant = y - slope * x;
    let square = logs.iter().map(|p| (p.1 - constant - slope * p.0).powi(2)).sum::<f64>() / n;
    Some((slope, constant.exp(), square.sqrt().exp() - 1.0))
}

pub(crate) fn orders(builds: &[BuildRow], cuts: &[CutRow], input: &InputFacts) -> Vec<Order> {
    let most = input.triangles as f64 * FITTED_SHARE;
    let mut orders = vec![];
    let mut add = |of, error, over, points: Vec<(f64, f64)>| {
        let Some((slope, at_one, scatter)) = fit(&points) else { return };
        let extreme = |pick: fn(f64, f64) -> f64| points.iter().map(|p| p.0).reduce(pick).unwrap_or(0.0);
        let range = [extreme(f64::min), extreme(f64::max)];
        let expected = input.surface.kind.expected_slope();
        orders.push(Order { of, error, over, slope, at_one, scatter, points: points.len(), range, expected });
    };
    let swept = builds.iter().filter(|row| matches!(row.setting.varied, Varied::Default | Varied::Tolerance));
    let swept: Vec<&BuildRow> = swept.filter(|row| row.triangles as f64 <= most).collect();
    type Pick<T> = fn(&T) -> f64;
    let errors: [(&str, Pick<BuildRow>); 3] =
        [("rms", |row| row.measured.rms()), ("max", |row| row.measured.max()), ("certified", |row| row.certified)];
    for (name, error) in errors {
        add("builds", name, "triangles", swept.iter().map(|row| (row.triangles as f64, error(row))).collect());
    }
    add("builds", "rms", "samples", swept.iter().map(|row| (row.samples as f64, row.measured.rms())).collect());
    let mut drawn: Vec<(f64, f64)> = vec![];
    for row in cuts.iter().filter(|row| row.asked == "tolerance" && row.triangles as f64 <= most) {
        // Several tolerances can give the same cut.
        let Some(measured) = row.measured else { continue };
        let point = (row.triangles as f64, measured.rms());
        if !drawn.contains(&point) {
            drawn.push(point);
        }
    }
    add("cuts", "rms", "triangles", drawn);
    orders
}

/// The points, all of whose coordinates should be small, that no other point beats. A point beats another if it is
/// nowhere worse, and somewhere better by more than noise.
pub(crate) fn front<const N: usize>(points: &[[f64; N]]) -> Vec<bool> {
    points.iter().map(|point| !points.iter().any(|other| beats(other, point, &[NOISE; N]))).collect()
}

fn beats<const N: usize>(a: &[f64; N], b: &[f64; N], noise: &[f64; N]) -> bool {
    let is_better = |((a, b), noise): ((&f64, &f64), &f64)| *a < b * (1.0 - noise);
    a.iter().zip(b).all(|(a, b)| a <= b) && a.iter().zip(b).zip(noise).any(is_better)
}

/// Whether the default settings are on the Pareto front of bytes, an error and processor time.
#[derive(Clone, Debug, Serialize)]
pub struct DefaultCheck {
    /// On the front for every kind of error.
    pub on_front: bool,
    /// On the front for the measured root mean square.
    pub rms: bool,
    /// On the front for the measured maximum.
    pub max: bool,
    /// On the front for the certified error.
    pub certified: bool,
    /// Settings that are not worse in bytes, processor time and the named error, and better by more than 2 % in one of
    /// them. For processor time, also by more than equal builds differ.
    pub beaten_by: Vec<Beaten>,
    /// Spread of the processor time of equal builds: median over least, minus 1. (The largest depends on what else the
    /// machine did.)
    pub time_spread: f64,
}

/// A setting that beats the default, with each figure relative to the default's.
#[derive(Clone, Debug, Serialize)]
pub struct Beaten {
    /// The setting.
    pub setting: String,
    /// The error for which it does.
    pub error: &'static str,
    /// Bytes.
    pub bytes: f64,
    /// Processor time.
    pub cpu_seconds: f64,
    /// Measured root mean square.
    pub rms: f64,
    /// Measured maximum.
    pub max: f64,
    /// Certified error.
    pub certified: f64,
}

/// Whether a build competes with the default: it differs in what ends up in the file or in how that was made, not only
/// in how the work was spread.
pub(crate) fn competes(row: &BuildRow) -> bool {
    !matches!(row.setting.varied, Varied::Threads | Varied::Regions)
}

pub(crate) fn check_default(builds: &[BuildRow]) -> Option<DefaultCheck> {
    let default = builds.first()?;
    let mut beaten_by = vec![];
    let time_spread = default.cpu_seconds / default.cpu_range[0].max(1e-9) - 1.0;
    let noise = [NOISE, NOISE.max(time_spread), NOISE];
    type Pick = fn(&BuildRow) -> f64;
    let errors: [(&'static str, Pick); 3] =
        [("rms", |row| row.measured.rms()), ("max", |row| row.measured.max()), ("certified", |row| row.certified)];
    let holds = errors.map(|(error, pick)| {
        let point = |row: &BuildRow| [row.bytes as f64, row.cpu_seconds, pick(row)];
        let before = beaten_by.len();
        for row in builds.iter().filter(|row| competes(row) && beats(&point(row), &point(default), &noise)) {
            beaten_by.push(Beaten {
                setting: row.setting.name.clone(),
                error,
                bytes: row.bytes as f64 / default.bytes as f64,
                cpu_seconds: row.cpu_seconds / default.cpu_seconds,
                rms: row.measured.rms() / default.measured.rms(),
                max: row.measured.max() / default.measured.max(),
                certified: row.certified / default.certified,
            });
        }
        beaten_by.len() == before
    });
    let [rms, max, certified] = holds;
    Some(DefaultCheck { on_front: rms && max && certified, rms, max, certified, beaten_by, time_spread })
}

/// The middle value; for an even number of values, the upper middle one.
pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_slope_of_a_power_law_is_its_exponent() {
        let points: Vec<(f64, f64)> = (1..9).map(|k| (f64::from(k), 3.0 * f64::from(k).powf(-1.5))).collect();
        let (slope, at_one, scatter) = fit(&points).expect("enough points");
        assert!((slope + 1.5).abs() < 1e-12 && (at_one - 3.0).abs() < 1e-12 && scatter < 1e-12);
        assert_eq!(fit(&points[..2]), None);
        assert_eq!(fit(&[(2.0, 1.0), (2.0, 2.0), (2.0, 3.0)]), None);
        assert_eq!(fit(&[(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)]), None);
    }

    #[test]
    fn a_point_beaten_beyond_noise_is_not_on_the_front() {
        let points = [[1.0, 4.0], [2.0, 2.0], [4.0, 1.0], [4.0, 4.0], [2.01, 2.0], [2.0, 2.2]];
        assert_eq!(front(&points), [true, true, true, false, true, false]);
    }
}
