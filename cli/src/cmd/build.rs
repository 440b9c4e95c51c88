//! `lodpack build`

use super::{print_json, use_threads};
use crate::args::{self, BuildArgs};
use crate::output::{PendingFile, bytes, count, length, say};
use crate::progress_bar::Terminal;
use anyhow::{Context, Result};
use lodpack_cli::build::{BuildOptions, Effort, Fillings, build};
use lodpack_cli::memory::machine_bytes;
use lodpack_cli::summary::BuildSummary;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Builds a file and reports what was done.
pub fn run(args: &BuildArgs) -> Result<ExitCode> {
    use_threads(args.threads)?;
    let options = BuildOptions {
        inputs: args.inputs.clone(),
        tolerance: args.tolerance,
        unit: args.unit,
        effort: match args.effort {
            args::Effort::Fast => Effort::Fast,
            args::Effort::Default => Effort::Default,
            args::Effort::Best => Effort::Best,
        },
        fillings: match args.fillings {
            args::Fillings::Auto => Fillings::Auto,
            args::Fillings::IrregularOnly => Fillings::IrregularOnly,
            args::Fillings::GridWherePossible => Fillings::GridWherePossible,
        },
        memory: args.memory.unwrap_or_else(|| machine_bytes() / 2),
        // Beside the output, which will need space there, too.
        temporary: args.temp.clone().unwrap_or_else(|| folder_of(&args.output)),
        region_triangles: args.region_triangles,
        ..BuildOptions::default()
    };
    let (pending, file) = PendingFile::create(&args.output, args.force, args.inputs.iter().map(|p| p.as_path()))?;
    let mut out = BufWriter::new(file);
    let summary = {
        let progress = Terminal::new();
        build(&options, &mut out, &progress)?
    };
    let written = out.into_inner().map_err(|error| error.into_error());
    pending.finish(written.with_context(|| format!("cannot write {}", args.output.display()))?)?;
    if args.json {
        print_json(&summary)?;
    } else {
        print(&summary, args)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Where a regular output is. What is written to a device has no place for other files beside it.
fn folder_of(output: &Path) -> PathBuf {
    match output.parent() {
        _ if output.exists() && !output.is_file() => std::env::temp_dir(),
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

fn print(s: &BuildSummary, args: &BuildArgs) -> Result<()> {
    let r = &s.repairs;
    say!("{}", args.output.display());
    say!("  input      {} triangles, {} vertices", count(s.input_triangles), count(s.input_vertices));
    say!(
        "  repairs    {} vertices welded, {} degenerate and {} duplicate faces dropped, {} edges and {} vertices cut, {} faces flipped",
        count(r.welded_vertices),
        count(r.degenerate_faces),
        count(r.duplicate_faces),
        count(r.nonmanifold_edges_cut),
        count(r.nonmanifold_vertices_split),
        count(r.flipped_faces)
    );
    say!(
        "  roots      {} irregular, {} grid; {:.3} samples per input vertex",
        count(s.irregular_roots),
        count(s.grid_roots),
        s.samples_per_input_vertex
    );
    say!("  size       {}, {:.2} bits per input vertex", bytes(s.bytes), s.bits_per_input_vertex);
    say!(
        "  error      {} certified, tolerance {} ({:.2} mean edge lengths)",
        length(s.certified_error),
        length(s.tolerance),
        s.tolerance / s.mean_edge_length
    );
    for level in &s.levels {
        say!(
            "  level {:<4} {:>12} triangles   error {:>10}   {:>10}",
            level.level,
            count(level.triangles),
            length(level.certified_error),
            bytes(level.bytes)
        );
    }
    let f = &s.fallbacks;
    say!(
        "  fallbacks  {} charts tried again, {} kept as they are, {} arc samples added, {} not embeddable",
        f.retried_charts,
        f.unsimplified_charts,
        f.raised_samples,
        f.embedding_failures
    );
    let stages: Vec<String> = s.stages.iter().map(|t| format!("{} {:.2}", t.stage, t.cpu_seconds)).collect();
    say!("  CPU        {:.2} s ({})", s.cpu_seconds, stages.join(", "));
    let disk = match s.temporary_bytes {
        0 => String::new(),
        size => format!(", temporary files {}", bytes(size)),
    };
    say!("  elapsed    {:.2} s, peak memory {}{disk}", s.wall_seconds, bytes(s.peak_memory_bytes));
    Ok(())
}
