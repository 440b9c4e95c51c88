//! The stages of a job whose planning is divided, too, and the files of their tasks.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::part::part_name;
use super::planned::PARTS_NAME;
use lodpack_import::Ways;
use lodpack_runtime::storage::STAGES_NAME;

/// Parts for each task of [`Stage::Encode`], at least, and the most tasks.
const PARTS_PER_ENCODER: u32 = 4;
const MAX_ENCODERS: u32 = 500;

/// A stage of a job. The tasks of a stage can be done in any order, by any number of processes at the same time, once
/// all tasks of the stages before it are done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Lines of a range of texts are counted.
    Lines,
    /// One process reads inputs that cannot be read in ranges; texts are read in ranges.
    Import,
    /// Ranges of the input are checked and measured.
    Scan,
    /// Triangles of a range are counted by cell.
    Count,
    /// One process cuts space into regions.
    Cut,
    /// Triangles of a range are sent to their regions.
    Divide,
    /// Regions are repaired.
    Repair,
    /// One process finds the edges along which regions meet.
    Match,
    /// Regions are cut into charts.
    Segment,
    /// One process finds the arcs that regions share, and writes the plan.
    Seams,
    /// Parts are built.
    Build,
    /// One process orders the roots of all parts, and makes the groups above regions.
    Arrange,
    /// Parts become pages of the file.
    Encode,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 13] = [
        Self::Lines,
        Self::Import,
        Self::Scan,
        Self::Count,
        Self::Cut,
        Self::Divide,
        Self::Repair,
        Self::Match,
        Self::Segment,
        Self::Seams,
        Self::Build,
        Self::Arrange,
        Self::Encode,
    ];

    /// Its name in commands and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lines => "lines",
            Self::Import => "import",
            Self::Scan => "scan",
            Self::Count => "count",
            Self::Cut => "cut",
            Self::Divide => "divide",
            Self::Repair => "repair",
            Self::Match => "match",
            Self::Segment => "segment",
            Self::Seams => "seams",
            Self::Build => "build",
            Self::Arrange => "arrange",
            Self::Encode => "encode",
        }
    }

    /// Its share of the processor time of a job, as measured on scans (`tests/RESULTS.md`).
    pub fn share(self) -> f64 {
        match self {
            Self::Import | Self::Cut | Self::Match | Self::Seams | Self::Arrange => 0.002,
            Self::Lines | Self::Scan | Self::Encode => 0.005,
            Self::Count => 0.03,
            Self::Divide => 0.04,
            Self::Repair => 0.15,
            Self::Segment => 0.16,
            Self::Build => 0.61,
        }
    }

    /// The stages before it.
    pub fn earlier(self) -> impl DoubleEndedIterator<Item = Self> {
        Self::ALL.into_iter().filter(move |&stage| stage < self)
    }
}

impl std::fmt::Display for Stage {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// How a job is divided into tasks. The file that is built does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stages {
    /// Ranges of the input.
    pub ranges: u32,
    /// Runs of regions, and so parts.
    pub parts: u32,
    /// How the input is read.
    pub ways: Ways,
    /// Bytes of memory that are enough for each task as a rule. Each task says so if it needs more.
    pub memory: u64,
}

impl Stages {
    /// The number of tasks of a stage.
    pub fn tasks(&self, stage: Stage) -> u32 {
        match stage {
            Stage::Lines | Stage::Import if self.ways == Ways::Lines => self.ranges,
            Stage::Import if self.ways == Ways::Whole => 1,
            Stage::Lines | Stage::Import => 0,
            // An import checks and measures everything.
            Stage::Scan if self.ways != Ways::Places => 0,
            Stage::Scan | Stage::Count | Stage::Divide => self.ranges,
            Stage::Cut | Stage::Match | Stage::Seams | Stage::Arrange => 1,
            Stage::Repair | Stage::Segment | Stage::Build => self.parts,
            // Each reads the parts around its own, so more tasks would read more. A merge reads the products of all
            // side by side.
            Stage::Encode => self.parts.div_ceil(self.parts.div_ceil(MAX_ENCODERS).max(PARTS_PER_ENCODER)),
        }
    }

    /// The share of a task in `count` things, of which each range of the input has a share.
    pub fn range(&self, task: u32, count: u64) -> Range<u64> {
        let at = |task: u32| (u128::from(count) * u128::from(task) / u128::from(self.ranges.max(1))) as u64;
        at(task)..at(task + 1)
    }
}

/// The files of a task.
pub(super) struct TaskFiles {
    /// What it hands on; it exists once the task is done.
    pub product: PathBuf,
    pub lock: PathBuf,
    pub report: PathBuf,
    pub failure: PathBuf,
}

impl TaskFiles {
    pub fn new(job: &Path, stage: Stage, task: u32) -> Self {
        let (folder, name) = match stage {
            Stage::Build => (job.join(PARTS_NAME), format!("part-{task}")),
            _ => (job.join(STAGES_NAME), format!("{stage}-{task}")),
        };
        let named = |extension: &str| folder.join(format!("{name}.{extension}"));
        let product = match stage {
            Stage::Build => folder.join(part_name(task)),
            _ => named("done"),
        };
        Self { product, lock: named("lock"), report: named("json"), failure: named("failed") }
    }
}

/// The triangles that a task of [`Stage::Divide`] has sent to the regions.
pub(super) fn run_file(job: &Path, task: u32) -> PathBuf {
    job.join(STAGES_NAME).join(format!("{}-{task}.runs", Stage::Divide))
}

/// What a task of [`Stage::Encode`] has to know, from [`Stage::Arrange`].
pub(super) fn encoder_file(job: &Path, task: u32) -> PathBuf {
    job.join(STAGES_NAME).join(format!("{}-{task}.encoder", Stage::Arrange))
}

/// Divides consecutive things into the given number of runs of about equal size. Some runs are empty where there are
/// fewer things.
pub(super) fn even_runs(sizes: impl Iterator<Item = u64> + Clone, runs: u32) -> Vec<Range<u32>> {
    let total: u64 = sizes.clone().sum();
    let mut ranges = vec![0..0; runs.max(1) as usize];
    let mut before = 0;
    for (number, size) in (0..).zip(sizes) {
        // A thing belongs to the run in which its middle lies.
        let run = u128::from(before + size / 2) * u128::from(runs) / u128::from(total.max(1));
        let last = ranges.len() - 1;
        let range = &mut ranges[last.min(run as usize)];
        *range = if range.start == range.end { number } else { range.start }..number + 1;
        before += size;
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_even_and_hold_everything_once() {
        for runs in [1, 3, 7, 100] {
            let sizes = [5, 0, 9, 1, 1, 90, 2, 2, 7];
            let ranges = even_runs(sizes.into_iter(), runs);
            assert_eq!(ranges.len(), runs as usize);
            let all: Vec<u32> = ranges.into_iter().flatten().collect();
            assert_eq!(all, (0..9).collect::<Vec<u32>>(), "{runs}");
        }
        assert_eq!(even_runs([1, 1, 1, 1].into_iter(), 2), [0..2, 2..4]);
    }

    #[test]
    fn ranges_hold_everything_once() {
        for ranges in [1, 3, 1000] {
            let stages = Stages { ranges, parts: 1, ..Stages::default() };
            let all: Vec<u64> = (0..ranges).flat_map(|task| stages.range(task, 17)).collect();
            assert_eq!(all, (0..17).collect::<Vec<u64>>());
        }
    }
}
