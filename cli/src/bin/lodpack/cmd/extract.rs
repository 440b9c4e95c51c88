//! `lodpack extract`

use super::open::{in_file, open};
use super::print_json;
use crate::args::{ExtractArgs, OutputFormat};
use crate::interrupt;
use crate::messages;
use crate::output::{PendingFile, bytes, count, length, say};
use anyhow::{Context, Result, bail};
use lodpack::{Cut, Limiter, Outside, Query};
use lodpack_cli::mesh::export::{MeshFormat, rounding, write_mesh};
use lodpack_cli::mesh::tolerance::Tolerance;
use serde::Serialize;
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::process::ExitCode;

/// Rounding by an output format is noted from this share of the certified error on.
const NOTABLE_ROUNDING: f64 = 0.1;

#[derive(Serialize)]
struct ExtractSummary {
    triangles: u64,
    vertices: u64,
    /// Roots, each at one level.
    nodes: u64,
    /// Of everything written.
    certified_error: f64,
    /// Of what lies in the box, if there is one: the tolerance concerns this.
    certified_error_in_box: Option<f64>,
    /// The tolerance asked for, in input units.
    tolerance: Option<f64>,
    /// What keeps the mesh from being finer: "tolerance" (it is as fine as was asked for), "finest" (the file has nothing finer),
    /// "triangles" or "nodes" (a budget).
    limited_by: &'static str,
    bytes_read: u64,
    requests: u64,
}

/// Selects a cut and writes it as a mesh.
pub fn run(args: &ExtractArgs) -> Result<ExitCode> {
    let format = format_of(args)?;
    interrupt::on_stop_leave_nothing();
    // An unsuitable output is refused before anything is read.
    let output = Output::create(args)?;
    let file = open(&args.file)?;
    let tolerance = match args.tolerance {
        None => None,
        Some(Tolerance::InputUnits(length)) => Some(length),
        Some(Tolerance::OfDiagonal(fraction)) => Some(fraction * file.bounds().map_or(0.0, diagonal)),
        Some(Tolerance::OfMeanEdge(factor)) => {
            Some(factor * file.source_info().map_or(0.0, |source| source.mean_edge_length))
        }
        Some(Tolerance::Auto | Tolerance::Metres(_)) => {
            bail!(
                "a file does not record the unit of its coordinates; give --tolerance in input units (0.05), as a share of the \
                 diagonal (0.1%) or in mean edges (0.4edge)"
            );
        }
    };
    let query = Query {
        volume: args.bbox.map(|bbox| bbox.0.into()),
        outside: if args.context { Outside::Coarsest } else { Outside::Drop },
        tolerance,
        max_triangles: args.triangles,
        max_nodes: args.nodes,
        ..Query::default()
    };
    let cut = in_file(&args.file, file.select(&query))?;
    if cut.nodes.is_empty() {
        let [low, high] = file.bounds().unwrap_or_default();
        let file = args.file.display();
        bail!("{file}: nothing touches the box; the model reaches from {low:?} to {high:?}");
    }
    let mesh = in_file(&args.file, file.extract(&cut))?;
    let everywhere = cut.node_errors.iter().copied().fold(cut.error, f64::max);
    if let Some(what) = shortfall(&cut, tolerance, args) {
        messages::tell("note", &what);
    }
    let moved = rounding(format, &mesh.positions);
    if moved > cut.error * NOTABLE_ROUNDING {
        let output = args.output.display();
        let moved = length(moved);
        messages::tell(
            "note",
            &format!("{output}: single precision moves coordinates by up to {moved}; write PLY or OBJ to keep them"),
        );
    }
    output.write(args, format, &mesh)?;
    let summary = ExtractSummary {
        triangles: mesh.triangles.len() as u64,
        vertices: mesh.positions.len() as u64,
        nodes: cut.nodes.len() as u64,
        certified_error: everywhere,
        certified_error_in_box: args.bbox.map(|_| cut.error),
        tolerance,
        limited_by: name_of(cut.limited_by),
        bytes_read: file.source().byte_count(),
        requests: file.source().read_count(),
    };
    print(&summary, args)?;
    Ok(ExitCode::SUCCESS)
}

fn format_of(args: &ExtractArgs) -> Result<MeshFormat> {
    let named = args.format.map(|format| match format {
        OutputFormat::Ply => MeshFormat::Ply,
        OutputFormat::Obj => MeshFormat::Obj,
        OutputFormat::Stl => MeshFormat::Stl,
        OutputFormat::Glb => MeshFormat::Glb,
    });
    match named.or_else(|| MeshFormat::from_path(&args.output)) {
        Some(format) => Ok(format),
        None if is_stdout(&args.output) => bail!("-o - needs --format: ply, obj, stl or glb"),
        None => bail!(
            "{}: the extension tells no format; use .ply, .obj, .stl or .glb, or pass --format",
            args.output.display()
        ),
    }
}

fn is_stdout(output: &Path) -> bool {
    output.as_os_str() == "-"
}

/// The destination of the mesh.
enum Output {
    Stdout,
    File(PendingFile, File),
}

impl Output {
    fn create(args: &ExtractArgs) -> Result<Self> {
        if !is_stdout(&args.output) {
            let (pending, file) = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
            return Ok(Self::File(pending, file));
        }
        if args.json {
            bail!("the mesh and the JSON summary would both go to stdout; name a file with -o, or omit --json");
        }
        Ok(Self::Stdout)
    }

    fn write(self, args: &ExtractArgs, format: MeshFormat, mesh: &lodpack::Mesh) -> Result<()> {
        let cannot_write = || format!("cannot write {}", args.output.display());
        match self {
            Self::Stdout => match write_mesh(io::stdout().lock(), format, &mesh.positions, &mesh.triangles) {
                // A closed pipe is no error: its reader, such as `head`, has seen enough.
                Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
                written => written.context("cannot write to stdout"),
            },
            Self::File(pending, out) => {
                write_mesh(&out, format, &mesh.positions, &mesh.triangles).with_context(cannot_write)?;
                pending.finish(out)
            }
        }
    }
}

/// Why a cut misses the tolerance that was asked for, if it does.
fn shortfall(cut: &Cut, tolerance: Option<f64>, args: &ExtractArgs) -> Option<String> {
    let tolerance = tolerance.filter(|&tolerance| cut.error > tolerance)?;
    let budget = |name: &str, most: Option<u64>| {
        format!("the budget of {} {name} allows only {}", count(most.unwrap_or_default()), length(cut.error))
    };
    let why = match cut.limited_by {
        Limiter::Triangles => budget("triangles", args.triangles),
        Limiter::Nodes => budget("nodes", args.nodes),
        _ => format!("the finest level has {}; build the file with a finer --tolerance", length(cut.error)),
    };
    Some(format!("the tolerance of {} is not reached: {why}", length(tolerance)))
}

fn name_of(limiter: Limiter) -> &'static str {
    match limiter {
        Limiter::Tolerance => "tolerance",
        Limiter::Finest => "finest",
        Limiter::Triangles => "triangles",
        Limiter::Nodes => "nodes",
        _ => "bytes",
    }
}

fn print(summary: &ExtractSummary, args: &ExtractArgs) -> Result<()> {
    if args.json {
        return print_json(summary);
    }
    let error = match summary.certified_error_in_box {
        Some(inside) if inside < summary.certified_error => {
            format!("{} in the box, {} everywhere", length(inside), length(summary.certified_error))
        }
        _ => length(summary.certified_error),
    };
    let text = format!(
        "{}: {} triangles of {} roots, certified error {error}; {} read in {} requests",
        args.output.display(),
        count(summary.triangles),
        count(summary.nodes),
        bytes(summary.bytes_read),
        summary.requests
    );
    match is_stdout(&args.output) {
        true => messages::line(format_args!("{text}")),
        false => say!("{text}"),
    }
    Ok(())
}

fn diagonal([low, high]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|k| (high[k] - low[k]) * (high[k] - low[k])).sum::<f64>().sqrt()
}
