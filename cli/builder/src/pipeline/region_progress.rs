//! How far a region is, in charts: what comes behind their filling counts, too.

use std::sync::{Mutex, PoisonError};

use lodpack_runtime::progress::Progress;

/// Shares of the time that filling, groups and texels take, measured on scans, with and without texels.
const SHARES: [f64; 3] = [0.65, 0.35, 0.0];
const SHARES_WITH_TEXELS: [f64; 3] = [0.1, 0.05, 0.85];

/// Reports the progress of a region, whose work is as much as it has charts.
pub(super) struct RegionProgress<'a> {
    progress: &'a dyn Progress,
    charts: u64,
    /// Where filling, groups and texels end.
    ends: [f64; 3],
    done: Mutex<Done>,
}

#[derive(Default)]
struct Done {
    share: f64,
    /// The charts that were reported.
    reported: u64,
}

impl<'a> RegionProgress<'a> {
    pub fn new(progress: &'a dyn Progress, charts: u64, has_groups: bool, has_texels: bool) -> Self {
        let [fill, groups, texels] = if has_texels { SHARES_WITH_TEXELS } else { SHARES };
        let groups = if has_groups { groups } else { 0.0 };
        let all = fill + groups + texels;
        let ends = [fill / all, (fill + groups) / all, 1.0];
        Self { progress, charts, ends, done: Mutex::default() }
    }

    /// A chart was tried. Those that are tried again are none that are new.
    pub fn tried(&self) {
        self.add(self.ends[0] / self.charts.max(1) as f64, self.ends[0]);
    }

    /// All charts are filled.
    pub fn filled(&self) {
        self.add(1.0, self.ends[0]);
    }

    /// All groups are made.
    pub fn grouped(&self) {
        self.add(1.0, self.ends[1]);
    }

    /// A chart has got its texels.
    pub fn painted(&self) {
        self.add((1.0 - self.ends[1]) / self.charts.max(1) as f64, 1.0);
    }

    /// The region is done.
    pub fn finish(&self) {
        self.add(1.0, 1.0);
    }

    fn add(&self, share: f64, most: f64) {
        let mut done = self.done.lock().unwrap_or_else(PoisonError::into_inner);
        done.share = (done.share + share).min(most).max(done.share);
        let charts = if done.share >= 1.0 { self.charts } else { (done.share * self.charts as f64) as u64 };
        if charts > done.reported {
            self.progress.advance(charts - done.reported);
            done.reported = charts;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[derive(Default)]
    struct Sum(AtomicU64);

    impl Progress for Sum {
        fn begin(&self, _stage: &'static str, _total: u64) {}
        fn advance(&self, amount: u64) {
            self.0.fetch_add(amount, Ordering::Relaxed);
        }
        fn note(&self, _message: &str) {}
    }

    #[test]
    fn all_of_a_region_is_as_much_as_its_charts_however_often_they_are_tried() {
        for (charts, has_groups, has_texels) in [(1, true, true), (28, true, false), (1000, false, false)] {
            let sum = Sum::default();
            let region = RegionProgress::new(&sum, charts, has_groups, has_texels);
            (0..3 * charts).for_each(|_| region.tried());
            let filled = sum.0.load(Ordering::Relaxed);
            assert!(has_groups == (filled < charts) && filled as f64 <= region.ends[0] * charts as f64 + 1e-6);
            region.filled();
            region.grouped();
            (0..charts).for_each(|_| region.painted());
            region.finish();
            assert_eq!(sum.0.into_inner(), charts);
        }
    }
}
