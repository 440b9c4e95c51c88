//! Runs builds, each in a process of its own.

use super::analysis::median;
use super::measure::{Distances, Reference};
use super::{Reader, ReportError, Setting, Varied};
use crate::progress::Progress;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// How to run builds.
#[derive(Clone, Debug)]
pub struct Trial {
    /// This program.
    pub program: PathBuf,
    /// Its arguments before those of a setting. They make it build once and print the summary.
    pub arguments: Vec<String>,
    /// Arguments for the default tolerance.
    pub default_tolerance: Vec<String>,
    /// The file that builds write.
    pub file: PathBuf,
    /// How often each setting is built.
    pub runs: u32,
    /// Memory that a build may use, in bytes.
    pub memory: u64,
}

/// A measured build.
#[derive(Clone, Debug, Serialize)]
pub struct BuildRow {
    /// The setting.
    #[serde(flatten)]
    pub setting: Setting,
    /// Tolerance in input units.
    pub tolerance: f64,
    /// Number of builds; times are medians over them.
    pub runs: u32,
    /// Processor time, median.
    pub cpu_seconds: f64,
    /// Smallest and largest processor time.
    pub cpu_range: [f64; 2],
    /// Elapsed time, median. It depends on what else runs.
    pub wall_seconds: f64,
    /// Peak memory, median.
    pub peak_memory_bytes: u64,
    /// Size of the file.
    pub bytes: u64,
    /// Whether the file equals that of the default settings, byte for byte.
    pub is_default_file: bool,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Vertices of the finest level.
    pub samples: u64,
    /// Roots, and how many of them are grids.
    pub roots: [u64; 2],
    /// Certified error of the finest level, in input units.
    pub certified: f64,
    /// Measured errors of the finest level, in input units.
    pub measured: Distances,
    /// Processor time by stage in the median build, in order. The stages within `roots` follow it.
    pub stages: Vec<(String, f64)>,
}

impl BuildRow {
    /// Processor time of a stage.
    pub fn stage(&self, name: &str) -> f64 {
        self.stages.iter().find(|(stage, _)| stage == name).map_or(0.0, |(_, seconds)| *seconds)
    }
}

/// All builds.
#[derive(Clone, Debug, Default)]
pub struct Sweep {
    /// The default first.
    pub rows: Vec<BuildRow>,
    /// Settings at which no build succeeded, and why.
    pub failures: Vec<(String, String)>,
}

/// The fields used of a build's summary.
#[derive(Clone, Deserialize)]
struct Summary {
    tolerance: f64,
    certified_error: f64,
    bytes: u64,
    charts: u64,
    grid_roots: u64,
    stages: Vec<Stage>,
    wall_seconds: f64,
    cpu_seconds: f64,
    peak_memory_bytes: u64,
}

#[derive(Clone, Deserialize)]
struct Stage {
    stage: String,
    cpu_seconds: f64,
}

/// What all builds of a setting share, and the cost of each.
struct Built {
    setting: Setting,
    summaries: Vec<Summary>,
    hash: u64,
    shape: Shape,
}

#[derive(Clone)]
struct Shape {
    triangles: u64,
    samples: u64,
    measured: Distances,
}

/// Builds at all settings, the first of which is the default. Repetitions go around all settings in turn, so that a
/// machine that is busy for a while slows all settings alike. The default build's file goes to `keep`.
///
/// # Errors
///
/// [`ReportError`] if the default build fails or files cannot be used. Failures of other settings are part of the
/// result.
pub fn sweep(
    trial: &Trial,
    settings: &[Setting],
    reference: &Reference,
    keep: &mut Vec<u8>,
    progress: &dyn Progress,
) -> Result<Sweep, ReportError> {
    progress.begin("builds", u64::from(trial.runs) * settings.len() as u64);
    let mut builds: Vec<Built> = vec![];
    let mut failures: Vec<(String, String)> = vec![];
    // Many settings give the same file, which is measured once.
    let mut shapes: HashMap<u64, Shape> = HashMap::new();
    let mut default_tolerance = None;
    for round in 0..trial.runs {
        for setting in settings {
            let name = &setting.name;
            if failures.iter().any(|(failed, _)| failed == name) {
                continue;
            }
            let tolerance = match setting.tolerance_factor {
                1.0 => None,
                factor => default_tolerance.map(|tolerance: f64| tolerance * factor),
            };
            let summary = match trial.run(setting, tolerance)? {
                Ok(summary) => summary,
                Err(what) if setting.varied == Varied::Default => return Err(ReportError::Build { what }),
                Err(what) => {
                    failures.push((name.clone(), what));
                    continue;
                }
            };
            default_tolerance.get_or_insert(summary.tolerance);
            if round > 0 {
                builds
                    .iter_mut()
                    .filter(|build| build.setting == *setting)
                    .for_each(|b| b.summaries.push(summary.clone()));
            } else {
                let bytes = trial.read()?;
                let hash = xxhash_rust::xxh3::xxh3_64(&bytes);
                let shape = match shapes.get(&hash) {
                    Some(shape) => shape.clone(),
                    None => Shape::new(&bytes, reference)?,
                };
                shapes.insert(hash, shape.clone());
                if builds.is_empty() {
                    *keep = bytes;
                }
                builds.push(Built { setting: setting.clone(), summaries: vec![summary], hash, shape });
            }
            progress.advance(1);
        }
    }
    let default_hash = builds.first().map_or(0, |build| build.hash);
    Ok(Sweep { rows: builds.into_iter().map(|build| build.row(default_hash)).collect(), failures })
}

impl Trial {
    /// Builds once. The inner error is the message of the build.
    fn run(&self, setting: &Setting, tolerance: Option<f64>) -> Result<Result<Summary, String>, ReportError> {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).args(setting.arguments(tolerance)).arg("--memory").arg(self.memory.to_string());
        if tolerance.is_none() {
            command.args(&self.default_tolerance);
        }
        let output = command.stdin(Stdio::null()).output();
        let output =
            output.map_err(|source| ReportError::Io { what: "cannot run", path: self.program.clone(), source })?;
        if !output.status.success() {
            let text = String::from_utf8_lossy(&output.stderr);
            let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it ended without a word");
            return Ok(Err(last.strip_prefix("error: ").unwrap_or(last).to_owned()));
        }
        Ok(Ok(serde_json::from_slice(&output.stdout)?))
    }

    fn read(&self) -> Result<Vec<u8>, ReportError> {
        std::fs::read(&self.file).map_err(|source| ReportError::Io {
            what: "cannot read",
            path: Path::new(&self.file).to_owned(),
            source,
        })
    }
}

impl Shape {
    fn new(bytes: &[u8], reference: &Reference) -> Result<Self, ReportError> {
        let file = Reader::open(super::cuts::Source::new(Box::new(bytes.to_vec())), lodpack::Limits::default())?;
        let drawn = file.extract(&file.select(&lodpack::Query::default())?)?;
        Ok(Self {
            triangles: drawn.triangles.len() as u64,
            samples: drawn.positions.len() as u64,
            measured: reference.distances(&drawn),
        })
    }
}

impl Built {
    fn row(self, default_hash: u64) -> BuildRow {
        let Self { setting, mut summaries, hash, shape } = self;
        summaries.sort_by(|a, b| a.cpu_seconds.total_cmp(&b.cpu_seconds));
        let (first, last) = (summaries[0].cpu_seconds, summaries[summaries.len() - 1].cpu_seconds);
        let middle = &summaries[summaries.len() / 2];
        BuildRow {
            setting,
            tolerance: middle.tolerance,
            runs: summaries.len() as u32,
            cpu_seconds: middle.cpu_seconds,
            cpu_range: [first, last],
            wall_seconds: median(summaries.iter().map(|s| s.wall_seconds)),
            peak_memory_bytes: median(summaries.iter().map(|s| s.peak_memory_bytes as f64)) as u64,
            bytes: middle.bytes,
            is_default_file: hash == default_hash,
            triangles: shape.triangles,
            samples: shape.samples,
            // Every chart becomes a root, whatever fills it.
            roots: [middle.charts, middle.grid_roots],
            certified: middle.certified_error,
            measured: shape.measured,
            stages: middle.stages.iter().map(|s| (s.stage.clone(), s.cpu_seconds)).collect(),
        }
    }
}
