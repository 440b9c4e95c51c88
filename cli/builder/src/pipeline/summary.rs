//! What a build reports, for people and programs.

use lodpack::index::FillingCounts;
use lodpack_runtime::machine::process_cpu_time;
use lodpack_stage::repair::RepairReport;
use serde::{Deserialize, Serialize, Serializer};
use std::time::{Duration, Instant};

/// Seconds that one stage took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageTime {
    /// The stage's name, as in the progress display.
    pub stage: &'static str,
    /// Elapsed time.
    pub wall_seconds: f64,
    /// Processor time of all threads. Stages that process charts side by side report the sum over the charts.
    pub cpu_seconds: f64,
}

/// One level of the file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelSummary {
    /// 0 is the coarsest.
    pub level: u8,
    /// Triangles when every root is drawn at this level.
    pub triangles: u64,
    /// The largest certified error of the level, as the file stores it and `info` prints it: rounded up, and including
    /// what finer neighbours move at the borders of roots that lack the level.
    pub certified_error: f64,
    /// Bytes that this level adds.
    pub bytes: u64,
}

/// How often charts did not take the ordinary way.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fallbacks {
    /// Charts simplified again because a bound was above the tolerance.
    pub retried_charts: u64,
    /// Charts that keep the input's triangles because nothing coarser met the tolerance.
    pub unsimplified_charts: u64,
    /// Arc samples added because a border could not be simplified as planned.
    pub raised_samples: u64,
    /// Charts that were tried as grids and could not be embedded.
    pub embedding_failures: u64,
    /// Charts that have fewer texels than the input's images, because a map holds no more.
    pub coarser_images: u64,
}

impl Fallbacks {
    /// The sum over two regions.
    pub fn plus(self, other: Self) -> Self {
        Self {
            retried_charts: self.retried_charts + other.retried_charts,
            unsimplified_charts: self.unsimplified_charts + other.unsimplified_charts,
            raised_samples: self.raised_samples + other.raised_samples,
            embedding_failures: self.embedding_failures + other.embedding_failures,
            coarser_images: self.coarser_images + other.coarser_images,
        }
    }
}

/// The result of a build. The names are stable: `--json` prints them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BuildSummary {
    /// Triangles of the input, before repair.
    pub input_triangles: u64,
    /// Vertices of the repaired input.
    pub input_vertices: u64,
    /// Triangles of the repaired input.
    pub triangles: u64,
    /// Objects that the input names and the file keeps.
    pub objects: u64,
    /// Assemblies of objects.
    pub assemblies: u64,
    /// Mean edge length of the repaired input.
    pub mean_edge_length: f64,
    /// What repair did.
    pub repairs: RepairReport,
    /// Charts that the surface was cut into.
    pub charts: u64,
    /// Roots by filling: as JSON `irregular_roots`, `grid_roots` and so on.
    #[serde(flatten, serialize_with = "roots_by_name")]
    pub roots: FillingCounts,
    /// Vertices of all levels together, over input vertices.
    pub samples_per_input_vertex: f64,
    /// Size of the file.
    pub bytes: u64,
    /// Size of the file in bits over input vertices.
    pub bits_per_input_vertex: f64,
    /// The tolerance that was asked for, in input units.
    pub tolerance: f64,
    /// The largest certified error of the finest level, in input units, as the file stores it; never above the
    /// tolerance.
    pub certified_error: f64,
    /// The levels, coarsest first.
    pub levels: Vec<LevelSummary>,
    /// How often charts did not take the ordinary way.
    pub fallbacks: Fallbacks,
    /// Time per stage, in order.
    pub stages: Vec<StageTime>,
    /// Elapsed time of the whole build.
    pub wall_seconds: f64,
    /// Processor time of the whole process.
    pub cpu_seconds: f64,
    /// Peak memory of the whole process.
    pub peak_memory_bytes: u64,
    /// The most bytes that temporary files took at a time; 0 where the input fitted in memory.
    pub temporary_bytes: u64,
}

/// Writes the number of roots of each filling as a field of its own: `irregular_roots` and so on.
///
/// # Errors
/// Those of the serializer.
pub fn roots_by_name<S: Serializer>(roots: &FillingCounts, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(roots.iter().map(|(filling, count)| (format!("{}_roots", filling.name()), count)))
}

/// Measures the time of stages, one after the other.
#[derive(Debug)]
pub struct Stopwatch {
    start: (Instant, Duration),
    wall: Instant,
    cpu: Duration,
    /// Finished stages.
    pub stages: Vec<StageTime>,
}

impl Default for Stopwatch {
    fn default() -> Self {
        let start = (Instant::now(), process_cpu_time());
        Self { start, wall: start.0, cpu: start.1, stages: vec![] }
    }
}

impl Stopwatch {
    /// Elapsed and processor time since the first stage began.
    pub fn total(&self) -> (Duration, Duration) {
        (self.start.0.elapsed(), process_cpu_time().saturating_sub(self.start.1))
    }

    /// Ends a stage, which began when the one before it ended.
    pub fn lap(&mut self, stage: &'static str) {
        let (wall, cpu) = (Instant::now(), process_cpu_time());
        self.stages.push(StageTime {
            stage,
            wall_seconds: (wall - self.wall).as_secs_f64(),
            cpu_seconds: cpu.saturating_sub(self.cpu).as_secs_f64(),
        });
        (self.wall, self.cpu) = (wall, cpu);
    }
}

/// Processor time by stage, summed over charts.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Times {
    pub arcs: Duration,
    pub cut: Duration,
    pub embed: Duration,
    pub sample: Duration,
    pub simplify: Duration,
    pub encode: Duration,
    pub certify: Duration,
    pub texels: Duration,
}

impl Times {
    pub fn add(&mut self, other: &Self) {
        self.arcs += other.arcs;
        self.cut += other.cut;
        self.embed += other.embed;
        self.sample += other.sample;
        self.simplify += other.simplify;
        self.encode += other.encode;
        self.certify += other.certify;
        self.texels += other.texels;
    }

    /// The same by name.
    pub fn stages(&self) -> Vec<StageTime> {
        [
            ("arcs", self.arcs),
            ("cut", self.cut),
            ("embed", self.embed),
            ("sample", self.sample),
            ("simplify", self.simplify),
            ("encode", self.encode),
            ("certify", self.certify),
            ("texels", self.texels),
        ]
        .map(|(stage, cpu)| StageTime { stage, wall_seconds: 0.0, cpu_seconds: cpu.as_secs_f64() })
        .to_vec()
    }
}
