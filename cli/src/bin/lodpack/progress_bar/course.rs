//! How far a command is, computed from its stages.

/// The stages of a command in order, with their shares of the time.
pub type Stages = &'static [(&'static str, f64)];

/// Measured on scans, in memory. On disk, repair takes more and roots take less.
pub const BUILD: Stages = &[("import", 0.06), ("repair", 0.12), ("segment", 0.17), ("roots", 0.62), ("pack", 0.03)];
/// Of files of heights.
pub const BUILD_HEIGHTS: Stages = &[("import", 0.2), ("image", 0.3), ("tiles", 0.45), ("write", 0.05)];
/// Of files of heights, before the parts.
pub const PLAN_HEIGHTS: Stages = &[("import", 1.0)];
/// The stages before the roots, on disk.
pub const PLAN: Stages = &[("import", 0.15), ("repair", 0.37), ("segment", 0.48)];
pub const MERGE: Stages = &[("check", 0.2), ("pack", 0.8)];
pub const ATLAS: Stages = &[("import", 0.05), ("repair", 0.05), ("segment", 0.1), ("embed", 0.7), ("write", 0.1)];
pub const VERIFY: Stages = &[("structure", 0.1), ("cuts", 0.9)];
pub const VERIFY_AGAINST: Stages = &[("import", 0.05), ("structure", 0.01), ("cuts", 0.09), ("errors", 0.85)];
pub const RASTER: Stages = &[("raster", 1.0)];
pub const TIN: Stages = &[("triangulate", 1.0)];
pub const EXPORT: Stages = &[("index", 0.02), ("borders", 0.18), ("tiles", 0.8)];
pub const EXPORT_LEVELS: Stages = &[("levels", 1.0)];
pub const EXPORT_ARCHIVE: Stages = &[("index", 0.02), ("borders", 0.18), ("tiles", 0.7), ("archive", 0.1)];
pub const COMPARE: Stages = &[("import", 0.2), ("compare", 0.8)];
pub const SELFTEST: Stages = &[("selftest", 1.0)];
/// For a mesh, its builds take nearly all the time; for a file there are only queries.
pub const REPORT: Stages = &[("import", 0.01), ("builds", 0.85), ("queries", 0.1), ("verification", 0.04)];

/// The course of a command through its stages.
#[derive(Debug)]
pub struct Course {
    /// Shares add up to one.
    stages: Vec<(&'static str, f64)>,
    /// Index of the current stage.
    current: Option<usize>,
    /// Work done in the current stage, and all of its work; 0 if that is unknown.
    done: u64,
    total: u64,
    /// The part of `done` that an earlier process did.
    skipped: u64,
    /// The pace of the last stage that takes much of the time.
    pace: Pace,
    /// The least time left that was said.
    said: f64,
}

/// How fast the stages of a name go.
#[derive(Debug, Default)]
struct Pace {
    /// When the first of them began, in seconds, and the share of the whole that they have done since.
    since: f64,
    before: f64,
    /// Whether they take enough of the time to tell that of others.
    tells: bool,
    seconds_per_share: Option<f64>,
}

/// Stages with this share of the time tell how long the others take.
const MUCH: f64 = 0.4;
/// And once this share of the whole is done of them.
const ENOUGH: f64 = 0.08;
/// The time left is not said where it is more than this many times what was said before.
const BELIEVED: f64 = 1.2;

impl Course {
    /// A course through stages with times in any unit. A name may occur more than once.
    pub fn new(stages: impl IntoIterator<Item = (&'static str, f64)>) -> Self {
        let stages: Vec<(&str, f64)> = stages.into_iter().collect();
        let sum: f64 = stages.iter().map(|(_, share)| share).sum();
        let of_all = |share: f64| if sum > 0.0 { share / sum } else { 0.0 };
        let stages = stages.into_iter().map(|(name, share)| (name, of_all(share))).collect();
        Self { stages, current: None, done: 0, total: 0, skipped: 0, pace: Pace::default(), said: f64::INFINITY }
    }

    /// Begins a stage, some seconds after the command. Stages that are skipped were done by an earlier process. A stage
    /// that begins again continues.
    pub fn begin(&mut self, name: &str, total: u64, elapsed: f64) {
        let before = self.pace.before + self.own_share();
        let next = self.current.map_or(0, |current| current + 1);
        if let Some(stage) = (next..self.stages.len()).find(|&stage| self.stages[stage].0 == name) {
            let is_same = self.current.is_some_and(|current| self.stages[current].0 == name);
            self.current = Some(stage);
            let share = |name: &str| self.stages.iter().filter(|of| of.0 == name).map(|(_, share)| share).sum::<f64>();
            let most = self.stages.iter().map(|(name, _)| share(name)).fold(0.0, f64::max);
            let tells = share(name) >= MUCH.min(most);
            if is_same {
                self.pace.before = before;
            } else if tells || self.pace.tells {
                // What was found stays, and what comes behind it says nothing of its own.
                let seconds_per_share = self.pace.seconds_per_share;
                self.pace = Pace { since: elapsed, before: 0.0, tells, seconds_per_share };
            }
        }
        (self.done, self.total, self.skipped) = (0, total, 0);
    }

    pub fn advance(&mut self, amount: u64) {
        self.done += amount;
    }

    pub fn skip(&mut self, amount: u64) {
        self.done += amount;
        self.skipped += amount;
    }

    /// Work done in the current stage, and all of its work; 0 if that is unknown.
    pub fn stage(&self) -> [u64; 2] {
        [self.done, self.total]
    }

    fn share(&self, amount: u64) -> f64 {
        let own = self.current.map_or(0.0, |current| self.stages[current].1);
        if self.total > 0 { (amount as f64 / self.total as f64).min(1.0) * own } else { 0.0 }
    }

    /// The share that this process has done of the current stage.
    fn own_share(&self) -> f64 {
        self.share(self.done.saturating_sub(self.skipped))
    }

    /// The share of the whole that is done, 0 to 1; none for commands without stages.
    pub fn overall(&self) -> Option<f64> {
        let current = self.current?;
        let before: f64 = self.stages[..current].iter().map(|(_, share)| share).sum();
        Some((before + self.share(self.done)).min(1.0))
    }

    /// Seconds left after `elapsed` seconds, once enough is done to tell. It never is much more than what was said
    /// before.
    pub fn remaining(&mut self, elapsed: f64) -> Option<f64> {
        let left = 1.0 - self.overall()?;
        let done = self.pace.before + self.own_share();
        if self.pace.tells && done > 0.0 && done >= ENOUGH {
            self.pace.seconds_per_share = Some((elapsed - self.pace.since).max(0.0) / done);
        }
        let remaining = self.pace.seconds_per_share? * left;
        if remaining > BELIEVED * self.said {
            return None;
        }
        self.said = self.said.min(remaining);
        Some(remaining)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const THREE: Stages = &[("a", 1.0), ("b", 2.0), ("c", 1.0)];

    #[test]
    fn a_command_goes_from_nothing_to_all() {
        let mut course = Course::new(THREE.iter().copied());
        assert_eq!((course.overall(), course.remaining(1.0)), (None, None));
        course.begin("a", 0, 0.0);
        // Begun again, now that the amount of work is known.
        course.begin("a", 10, 0.0);
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.0), None));
        course.advance(5);
        // It takes too little of the time to say anything of the others.
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.125), None));
        course.begin("b", 4, 2.0);
        assert_eq!((course.overall(), course.remaining(2.0)), (Some(0.25), None));
        course.advance(2);
        // A quarter took three seconds.
        assert_eq!((course.overall(), course.remaining(5.0)), (Some(0.5), Some(6.0)));
        course.begin("c", 1, 8.0);
        assert_eq!((course.overall(), course.remaining(8.0)), (Some(0.75), Some(3.0)));
        course.advance(1);
        assert_eq!((course.overall(), course.remaining(9.0)), (Some(1.0), Some(0.0)));
    }

    #[test]
    fn the_time_left_never_grows_by_more_than_a_fifth() {
        let mut course = Course::new(THREE.iter().copied());
        course.begin("b", 100, 0.0);
        let (mut least, mut said) = (f64::INFINITY, 0);
        for step in 0..100 {
            course.advance(1);
            // Ever slower, then fast.
            let slow = f64::from(step.min(60));
            let elapsed = slow * slow + 0.1 * f64::from(step);
            if let Some(left) = course.remaining(elapsed) {
                assert!(left <= 1.2 * least, "{left} after {least}");
                (least, said) = (left.min(least), said + 1);
            }
        }
        assert!((10..80).contains(&said), "{said}");
    }

    #[test]
    fn the_work_of_an_earlier_process_does_not_count_for_the_time_left() {
        let mut course = Course::new(THREE.iter().copied());
        course.begin("b", 4, 0.0);
        course.skip(2);
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.5), None));
        course.advance(1);
        // An eighth took three seconds; three eighths are left.
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(0.625), Some(9.0)));
        course.begin("c", 2, 6.0);
        course.advance(1);
        assert_eq!((course.overall(), course.remaining(9.0)), (Some(0.875), Some(3.0)));
    }

    #[test]
    fn several_parts_are_one_course() {
        // The second has nothing to do, the third is already built.
        let mut course = Course::new([20.0, 0.0, 40.0, 20.0].map(|triangles| ("roots", triangles)));
        for (part, before) in [0.0, 0.25, 0.25, 0.75].into_iter().enumerate() {
            course.begin("roots", if part == 1 { 0 } else { 8 }, part as f64);
            assert_eq!(course.overall(), Some(before));
            match part {
                1 => {}
                2 => course.skip(8),
                _ => course.advance(8),
            }
        }
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(1.0), Some(0.0)));
        course = Course::new([("roots", 0.0)]);
        course.begin("roots", 0, 0.0);
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(0.0), None));
    }

    #[test]
    fn the_shares_of_every_command_add_up() {
        for stages in [BUILD, PLAN, MERGE, ATLAS, VERIFY, VERIFY_AGAINST, SELFTEST, REPORT] {
            assert!((stages.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-9, "{stages:?}");
        }
        let mut course = Course::new([]);
        course.begin("anything", 3, 0.0);
        assert_eq!((course.overall(), course.remaining(3.0)), (None, None));
    }
}
