//! `lodpack extract`

use super::{open, print_json};
use crate::args::{ExtractArgs, ProgressStyle};
use crate::output::{PendingFile, bytes, count, length, say};
use crate::progress_bar::Terminal;
use anyhow::{Context, Result, bail};
use lodpack::{Outside, Query};
use lodpack_cli::export::{MeshFormat, rounding, write_mesh};
use lodpack_cli::progress::Progress;
use lodpack_cli::tolerance::Tolerance;
use serde::Serialize;
use std::process::ExitCode;

/// Rounding of coordinates by an output format that a user should hear of, as a share of the certified error.
const NOTABLE_ROUNDING: f64 = 0.1;

#[derive(Serialize)]
struct ExtractSummary {
    triangles: u64,
    vertices: u64,
    nodes: u64,
    certified_error: f64,
    bytes_read: u64,
    requests: u64,
}

/// Writes one cut as a mesh.
pub fn run(args: &ExtractArgs) -> Result<ExitCode> {
    let Some(format) = MeshFormat::from_path(&args.output) else {
        bail!("{}: name the output .ply, .obj, .stl or .glb", args.output.display());
    };
    let file = open(&args.file)?;
    let place = || args.file.display().to_string();
    let tolerance = match args.tolerance {
        None => None,
        Some(Tolerance::InputUnits(length)) => Some(length),
        Some(Tolerance::OfDiagonal(fraction)) => Some(fraction * file.bounds().map_or(0.0, diagonal)),
        Some(Tolerance::OfMeanEdge(factor)) => {
            Some(factor * file.source_info().map_or(0.0, |source| source.mean_edge_length))
        }
        Some(Tolerance::Auto | Tolerance::Metres(_)) => {
            bail!("give --tolerance in input units, as % of the diagonal or as a multiple like 0.4edge");
        }
    };
    let query = Query {
        region: args.bbox.map(|bbox| bbox.0.into()),
        outside: if args.context { Outside::Coarsest } else { Outside::Drop },
        tolerance,
        max_triangles: args.triangles,
        max_nodes: args.nodes,
        ..Query::default()
    };
    let cut = file.select(&query).with_context(place)?;
    if cut.nodes.is_empty() {
        let [low, high] = file.bounds().unwrap_or_default();
        bail!("{}: nothing lies in the box; the model reaches from {low:?} to {high:?}", place());
    }
    let mesh = file.extract(&cut).with_context(place)?;
    let moved = rounding(format, &mesh.positions);
    if moved > cut.error * NOTABLE_ROUNDING {
        Terminal::new(ProgressStyle::Auto, None).note(&format!(
            "{}: single precision moves coordinates by up to {}; PLY and OBJ keep them",
            args.output.display(),
            length(moved)
        ));
    }
    let (pending, out) = PendingFile::create(&args.output, args.force, [args.file.as_path()])?;
    write_mesh(&out, format, &mesh.positions, &mesh.triangles)
        .with_context(|| format!("cannot write {}", args.output.display()))?;
    pending.finish(out)?;
    let summary = ExtractSummary {
        triangles: mesh.triangles.len() as u64,
        vertices: mesh.positions.len() as u64,
        nodes: cut.nodes.len() as u64,
        certified_error: cut.error,
        bytes_read: file.source().byte_count(),
        requests: file.source().read_count(),
    };
    if args.json {
        print_json(&summary)?;
    } else {
        say!(
            "{}: {} triangles in {} nodes, certified error {}; {} read in {} requests",
            args.output.display(),
            count(summary.triangles),
            count(summary.nodes),
            length(summary.certified_error),
            bytes(summary.bytes_read),
            summary.requests
        );
    }
    Ok(ExitCode::SUCCESS)
}

fn diagonal([low, high]: [[f64; 3]; 2]) -> f64 {
    (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f64>().sqrt()
}
