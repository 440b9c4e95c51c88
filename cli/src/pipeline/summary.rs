//! What a build reports, for people and programs.

use crate::stage::repair::RepairReport;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::{Duration, Instant};

/// Seconds that one stage took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageTime {
    /// The stage's name, as in DESIGN and in the progress display.
    pub stage: &'static str,
    /// Elapsed time.
    pub wall_seconds: f64,
    /// Processor time of all threads. For stages that run chart by chart side by side the sum over the charts.
    pub cpu_seconds: f64,
}

/// One level of the file.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelSummary {
    /// 0 is the coarsest.
    pub level: u8,
    /// Triangles when every root is drawn at this level.
    pub triangles: u64,
    /// The largest certified error of the level, as the file stores and `info` prints it: rounded up, and with what finer
    /// neighbours move at the borders of roots that lack the level.
    pub certified_error: f64,
    /// Bytes that this level adds.
    pub bytes: u64,
}

/// How often a chart took a way out of the ordinary.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Fallbacks {
    /// Charts simplified again because a bound was above the tolerance.
    pub retried_charts: u64,
    /// Charts that keep the triangles of the input (at full resolution) since nothing coarser met the tolerance.
    pub unsimplified_charts: u64,
    /// Arc samples added because a border could not be thinned out as planned.
    pub raised_samples: u64,
    /// Charts that were tried as grids and could not be embedded.
    pub embedding_failures: u64,
}

impl Fallbacks {
    /// What happened in two regions.
    pub fn plus(self, other: Self) -> Self {
        Self {
            retried_charts: self.retried_charts + other.retried_charts,
            unsimplified_charts: self.unsimplified_charts + other.unsimplified_charts,
            raised_samples: self.raised_samples + other.raised_samples,
            embedding_failures: self.embedding_failures + other.embedding_failures,
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
    /// Mean edge length of the repaired input.
    pub mean_edge_length: f64,
    /// What repair did.
    pub repairs: RepairReport,
    /// Charts that the surface was cut into.
    pub charts: u64,
    /// Roots with an irregular filling.
    pub irregular_roots: u64,
    /// Roots with a grid filling.
    pub grid_roots: u64,
    /// Vertices of all levels together, over input vertices.
    pub samples_per_input_vertex: f64,
    /// Size of the file.
    pub bytes: u64,
    /// Size of the file in bits over input vertices.
    pub bits_per_input_vertex: f64,
    /// The tolerance that was asked for, in input units.
    pub tolerance: f64,
    /// The largest certified error of the finest level, in input units, as the file stores it; never above the tolerance.
    pub certified_error: f64,
    /// The levels, coarsest first.
    pub levels: Vec<LevelSummary>,
    /// What went another way.
    pub fallbacks: Fallbacks,
    /// Time per stage, in order.
    pub stages: Vec<StageTime>,
    /// Elapsed time of the whole build.
    pub wall_seconds: f64,
    /// Processor time of the whole process.
    pub cpu_seconds: f64,
    /// Peak memory of the whole process.
    pub peak_memory_bytes: u64,
    /// The most that temporary files took at a time; 0 where the input fit in memory.
    pub temporary_bytes: u64,
}

/// A count with thousands separators.
pub fn count(value: u64) -> String {
    let digits = value.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A path as it can be typed in a shell.
pub fn shell(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%~".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text,
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// Processor time that this process has used so far, all threads together.
pub fn process_cpu_time() -> Duration {
    clock(libc::CLOCK_PROCESS_CPUTIME_ID)
}

/// Processor time that the calling thread has used so far.
pub fn thread_cpu_time() -> Duration {
    clock(libc::CLOCK_THREAD_CPUTIME_ID)
}

#[expect(unsafe_code, reason = "the standard library has no processor clocks")]
fn clock(id: libc::clockid_t) -> Duration {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid, exclusively borrowed timespec for the duration of the call; on failure it stays zero.
    unsafe { libc::clock_gettime(id, &mut time) };
    Duration::new(time.tv_sec.max(0) as u64, time.tv_nsec.clamp(0, 999_999_999) as u32)
}

/// What Linux says of a process's memory ("VmHWM", the most that was resident, or "VmRSS", what is), in bytes.
pub fn status_bytes(process: &str, what: &str) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let value = status.lines().find_map(|line| line.strip_prefix(what)?.strip_prefix(':'))?;
    Some(value.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The largest resident size that this process ever had, in bytes; 0 where the system does not tell.
pub fn peak_memory_bytes() -> u64 {
    // What getrusage says includes, on Linux, the process that started this one, where that is larger.
    status_bytes("self", "VmHWM").unwrap_or_else(resource_peak_bytes)
}

#[expect(unsafe_code, reason = "the standard library does not report memory")]
fn resource_peak_bytes() -> u64 {
    let mut usage = std::mem::MaybeUninit::<libc::rusage>::zeroed();
    // SAFETY: getrusage fills the struct that it is given; zeroed is a valid value of this plain C struct if it fails.
    let usage = unsafe {
        libc::getrusage(libc::RUSAGE_SELF, usage.as_mut_ptr());
        usage.assume_init()
    };
    // Linux reports KiB, macOS bytes.
    usage.ru_maxrss.max(0) as u64 * if cfg!(target_os = "macos") { 1 } else { 1024 }
}

/// Times stages one after the other.
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

    /// Ends a stage that began when the last one ended.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_can_be_pasted_into_a_shell() {
        let of = |text: &str| shell(Path::new(text));
        assert_eq!(of("a/b-1.ply"), "a/b-1.ply");
        assert_eq!(of("my job"), "'my job'");
        assert_eq!(of("it's"), "'it'\\''s'");
    }
}
