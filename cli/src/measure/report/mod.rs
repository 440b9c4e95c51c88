//! `lodpack report`: error against run time, bytes and triangles, measured by code that shares nothing with the
//! builder.
//!
//! For a mesh, it builds at a sweep of tolerances and settings, each in a process of its own so that its memory can be
//! measured ([`sweep`]). For a file, it measures the cost and the result of queries at run time ([`cuts`]), and what
//! budgets of nodes and triangles allow ([`budgets`]). All become tables, plots with log axes (`plot`) and sentences
//! computed from the numbers (`words`).

mod analysis;
pub mod budgets;
pub mod cuts;
pub mod kind;
pub mod measure;
mod page;
mod peers;
mod plot;
mod settings;
pub mod sweep;
mod table;
mod words;

pub use analysis::{DefaultCheck, Order};
pub use budgets::BudgetRow;
pub use cuts::{CutRow, FirstPicture, Reader};
pub use kind::{SurfaceFacts, SurfaceKind};
pub use measure::{Distances, Reference};
pub use page::page;
pub use peers::{PeerRow, read_peers};
pub use settings::{Setting, Varied, settings};
pub use sweep::{BuildRow, Sweep, Trial};
pub use table::table;

use crate::machine::process_cpu_time;
use crate::measure::verify::{VerifyOptions, verify};
use serde::Serialize;
use std::path::PathBuf;

/// Why a report could not be made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file could not be read or written.
    #[error("{what} {path}")]
    Io {
        /// The failed operation.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The build at default settings failed.
    #[error("the build at default settings failed: {what}")]
    Build {
        /// The error of the build.
        what: String,
    },
    /// A build in its own process printed something other than its summary.
    #[error("a build's summary cannot be read; was this program replaced while it ran?")]
    Summary(#[from] serde_json::Error),
    /// The file is damaged or could not be read.
    #[error(transparent)]
    Read(#[from] lodpack::Error),
    /// The file to report on could not be opened.
    #[error(transparent)]
    Open(Box<dyn std::error::Error + Send + Sync>),
    /// A table of peers is malformed.
    #[error(
        "{path}, line {line}: {what}; a table of peers has a line of names, then lines of values, among them name, mesh, cpu_seconds, bytes, triangles, rms and max"
    )]
    Peers {
        /// The table.
        path: PathBuf,
        /// Its line, counted from 1.
        line: usize,
        /// The mistake in that line.
        what: String,
    },
}

/// The machine on which the numbers were measured.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Machine {
    /// Cores that the program may use.
    pub cores: usize,
    /// Name of the processor, if the system tells.
    pub processor: String,
    /// Name and version of the system, if it tells.
    pub system: String,
    /// The program's version.
    pub version: &'static str,
}

impl Machine {
    /// The machine on which this runs.
    pub fn this() -> Self {
        let line_of = |path: &str, name: &str, separator: char| {
            let text = std::fs::read_to_string(path).unwrap_or_default();
            let value = text.lines().find_map(|line| line.strip_prefix(name)?.trim_start().strip_prefix(separator));
            value.map(|value| value.trim().trim_matches('"').to_owned())
        };
        let family = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
        let system = line_of("/etc/os-release", "PRETTY_NAME", '=').map(|name| format!("{name}, {family}"));
        Self {
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            processor: line_of("/proc/cpuinfo", "model name", ':').unwrap_or_else(|| "unknown processor".into()),
            system: system.unwrap_or(family),
            version: env!("CARGO_PKG_VERSION"),
        }
    }
}

/// Processor time of the checks that a user may run after a build.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct VerifyCost {
    /// Time for structure, checksums and random cuts.
    pub file_seconds: f64,
    /// Time for all that, and for every stored error against the input.
    pub against_seconds: f64,
    /// Random cuts checked.
    pub cuts: u32,
    /// Problems found.
    pub problems: usize,
}

impl VerifyCost {
    /// Verifies a file twice, without and with the input.
    ///
    /// # Errors
    /// [`ReportError::Read`].
    pub fn measure(file: &Reader, reference: &Reference) -> Result<Self, ReportError> {
        let options = VerifyOptions { cuts: 100, seed: 1 };
        let start = process_cpu_time();
        verify(file, None, &options, &crate::progress::Silent)?;
        let between = process_cpu_time();
        let report = verify(file, Some(reference.mesh()), &options, &crate::progress::Silent)?;
        Ok(Self {
            file_seconds: (between - start).as_secs_f64(),
            against_seconds: (process_cpu_time() - between).as_secs_f64(),
            cuts: options.cuts,
            problems: report.problems.len(),
        })
    }
}

/// The mesh against which errors are measured.
#[derive(Clone, Debug, Serialize)]
pub struct InputFacts {
    /// Triangles after repair.
    pub triangles: u64,
    /// Vertices after repair.
    pub vertices: u64,
    /// Mean edge length, in input units.
    pub mean_edge_length: f64,
    /// The kind of its surface.
    pub surface: SurfaceFacts,
}

/// Everything that was measured, and the conclusions.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The name of the mesh or file.
    pub subject: String,
    /// The machine.
    pub machine: Machine,
    /// The input; none if errors are not measured.
    pub input: Option<InputFacts>,
    /// Builds, the default first; none in reports on files.
    pub builds: Vec<BuildRow>,
    /// Settings at which no build succeeded, and why.
    pub failures: Vec<(String, String)>,
    /// Queries at run time.
    pub cuts: Vec<CutRow>,
    /// What budgets of nodes and triangles allow.
    pub budgets: Vec<BudgetRow>,
    /// The cost of showing anything at all.
    pub first_picture: FirstPicture,
    /// The cost of verification; only with an input.
    pub verification: Option<VerifyCost>,
    /// Slopes of errors over triangles and samples.
    pub orders: Vec<Order>,
    /// Whether the default settings are on the Pareto front of the sweep.
    pub default_check: Option<DefaultCheck>,
    /// What each setting buys, in sentences.
    pub words: Vec<String>,
    /// Results of other programs.
    pub peers: Vec<PeerRow>,
}

/// The parts from which [`Report::new`] makes a report.
#[derive(Debug, Default)]
pub struct Measurements {
    /// See [`Report::subject`].
    pub subject: String,
    /// See [`Report::input`].
    pub input: Option<InputFacts>,
    /// See [`Report::builds`].
    pub sweep: Sweep,
    /// See [`Report::cuts`].
    pub cuts: Vec<CutRow>,
    /// See [`Report::budgets`].
    pub budgets: Vec<BudgetRow>,
    /// See [`Report::first_picture`].
    pub first_picture: FirstPicture,
    /// See [`Report::verification`].
    pub verification: Option<VerifyCost>,
    /// See [`Report::peers`].
    pub peers: Vec<PeerRow>,
}

impl Report {
    /// Draws the conclusions.
    pub fn new(measurements: Measurements) -> Self {
        let Measurements { subject, input, sweep, cuts, budgets, first_picture, verification, peers } = measurements;
        let Sweep { rows: builds, failures } = sweep;
        let orders = input.as_ref().map_or(vec![], |input| analysis::orders(&builds, &cuts, input));
        let default_check = analysis::check_default(&builds);
        let mut report = Self {
            subject,
            machine: Machine::this(),
            input,
            builds,
            failures,
            cuts,
            budgets,
            first_picture,
            verification,
            orders,
            default_check,
            words: vec![],
            peers,
        };
        report.words = words::words(&report);
        report
    }

    /// The unit of lengths in reports: the input's mean edge, or 1 without an input.
    pub(crate) fn unit(&self) -> f64 {
        self.input.as_ref().map(|input| input.mean_edge_length).filter(|&edge| edge > 0.0).unwrap_or(1.0)
    }
}
