//! How far a command is, by the stages that it goes through.

/// Stages of a command in their order, and their shares of the time.
pub type Stages = &'static [(&'static str, f64)];

/// As measured on scans, in memory. On disk repair takes more of it, and roots less.
pub const BUILD: Stages = &[("import", 0.06), ("repair", 0.12), ("segment", 0.17), ("roots", 0.62), ("pack", 0.03)];
/// What comes before the roots, on disk.
pub const PLAN: Stages = &[("import", 0.15), ("repair", 0.37), ("segment", 0.48)];
pub const MERGE: Stages = &[("check", 0.2), ("pack", 0.8)];
pub const ATLAS: Stages = &[("import", 0.05), ("repair", 0.05), ("segment", 0.1), ("embed", 0.7), ("write", 0.1)];
pub const VERIFY: Stages = &[("structure", 0.1), ("cuts", 0.9)];
pub const VERIFY_AGAINST: Stages = &[("import", 0.05), ("structure", 0.01), ("cuts", 0.09), ("errors", 0.85)];
pub const SELFTEST: Stages = &[("selftest", 1.0)];
/// Builds of a mesh are nearly all of it; of a file there are only the queries.
pub const REPORT: Stages = &[("import", 0.01), ("builds", 0.85), ("queries", 0.1), ("verification", 0.04)];

/// Where a command is.
#[derive(Debug)]
pub struct Course {
    /// Shares add up to one.
    stages: Vec<(&'static str, f64)>,
    place: Option<usize>,
    /// Of the current stage.
    done: u64,
    total: u64,
    /// Of `done` what an earlier process had done.
    skipped: u64,
    /// Share of all that an earlier process had done, but for the current stage.
    passed_over: f64,
}

impl Course {
    /// Stages in their order, and how long they take in any unit. A name may be there more than once.
    pub fn new(stages: impl IntoIterator<Item = (&'static str, f64)>) -> Self {
        let stages: Vec<(&str, f64)> = stages.into_iter().collect();
        let sum: f64 = stages.iter().map(|(_, share)| share).sum();
        let of_all = |share: f64| if sum > 0.0 { share / sum } else { 0.0 };
        let stages = stages.into_iter().map(|(name, share)| (name, of_all(share))).collect();
        Self { stages, place: None, done: 0, total: 0, skipped: 0, passed_over: 0.0 }
    }

    /// A stage begins. Those before it that have not been were done by an earlier process. One that begins again goes on.
    pub fn begin(&mut self, name: &str, total: u64) {
        let next = self.place.map_or(0, |place| place + 1);
        if let Some(place) = (next..self.stages.len()).find(|&place| self.stages[place].0 == name) {
            self.passed_over += self.skipped_share();
            self.passed_over += self.stages[next..place].iter().map(|(_, share)| share).sum::<f64>();
            self.place = Some(place);
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

    /// Done of the current stage, and all there is; 0 where that is unknown.
    pub fn stage(&self) -> [u64; 2] {
        [self.done, self.total]
    }

    fn share(&self, amount: u64) -> f64 {
        let own = self.place.map_or(0.0, |place| self.stages[place].1);
        if self.total > 0 { (amount as f64 / self.total as f64).min(1.0) * own } else { 0.0 }
    }

    fn skipped_share(&self) -> f64 {
        self.share(self.skipped)
    }

    /// How much of everything is done, 0 to 1; none for commands without stages.
    pub fn overall(&self) -> Option<f64> {
        let place = self.place?;
        let before: f64 = self.stages[..place].iter().map(|(_, share)| share).sum();
        Some((before + self.share(self.done)).min(1.0))
    }

    /// Seconds that are left, when so many have gone by, once enough is done to tell.
    pub fn remaining(&self, elapsed: f64) -> Option<f64> {
        const ENOUGH: f64 = 0.1;
        let overall = self.overall()?;
        let own = overall - self.passed_over - self.skipped_share();
        let to_do = own + (1.0 - overall);
        (own >= ENOUGH * to_do && own > 0.0).then(|| elapsed * (1.0 - overall) / own)
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
        course.begin("a", 0);
        // Begun again, now that it is known how much there is.
        course.begin("a", 10);
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.0), None));
        course.advance(5);
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.125), Some(7.0)));
        course.begin("b", 4);
        course.advance(2);
        assert_eq!((course.overall(), course.remaining(5.0)), (Some(0.5), Some(5.0)));
        course.begin("c", 1);
        course.advance(1);
        assert_eq!((course.overall(), course.remaining(5.0)), (Some(1.0), Some(0.0)));
    }

    #[test]
    fn what_an_earlier_process_did_says_nothing_of_the_time_that_is_left() {
        let mut course = Course::new(THREE.iter().copied());
        course.begin("b", 4);
        course.skip(2);
        assert_eq!((course.overall(), course.remaining(1.0)), (Some(0.5), None));
        course.advance(1);
        // A quarter of all took three seconds, and a quarter is left but for the last stage.
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(0.625), Some(9.0)));
        course.begin("c", 2);
        course.advance(1);
        assert_eq!((course.overall(), course.remaining(9.0)), (Some(0.875), Some(3.0)));
    }

    #[test]
    fn several_parts_are_one_course() {
        // The second has nothing to do, the third is there already.
        let mut course = Course::new([20.0, 0.0, 40.0, 20.0].map(|triangles| ("roots", triangles)));
        for (part, before) in [0.0, 0.25, 0.25, 0.75].into_iter().enumerate() {
            course.begin("roots", if part == 1 { 0 } else { 8 });
            assert_eq!(course.overall(), Some(before));
            match part {
                1 => {}
                2 => course.skip(8),
                _ => course.advance(8),
            }
        }
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(1.0), Some(0.0)));
        course = Course::new([("roots", 0.0)]);
        course.begin("roots", 0);
        assert_eq!((course.overall(), course.remaining(3.0)), (Some(0.0), None));
    }

    #[test]
    fn the_shares_of_every_command_add_up() {
        for stages in [BUILD, PLAN, MERGE, ATLAS, VERIFY, VERIFY_AGAINST, SELFTEST, REPORT] {
            assert!((stages.iter().map(|(_, share)| share).sum::<f64>() - 1.0).abs() < 1e-9, "{stages:?}");
        }
        let mut course = Course::new([]);
        course.begin("anything", 3);
        assert_eq!((course.overall(), course.remaining(3.0)), (None, None));
    }
}
