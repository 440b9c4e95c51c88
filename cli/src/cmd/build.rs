//! `lodpack build`

use super::{print_json, use_threads};
use crate::args::{self, BuildArgs, ModelArgs, PartRange, RunArgs};
use crate::interrupt;
use crate::output::{PendingFile, bytes, count, length, say};
use crate::progress_bar::Terminal;
use anyhow::{Context, Result, bail};
use lodpack_cli::build::{BuildError, BuildOptions, Effort, Fillings, build};
use lodpack_cli::job::{BuiltPart, MANIFEST_NAME, PARTS_NAME, PlannedJob, SLURM_NAME};
use lodpack_cli::memory::machine_bytes;
use lodpack_cli::summary::BuildSummary;
use std::fs;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Builds a file, or a part of a job, and reports what was done.
pub fn run(args: &BuildArgs) -> Result<ExitCode> {
    use_threads(args.run.threads)?;
    if let (Some(job), Some(parts)) = (&args.job, args.part) {
        return run_parts(args, job, parts);
    }
    let Some(output) = &args.output else { bail!("-o is missing: name the file to write") };
    let work = work_directory(output, args.temp.as_deref());
    begin_in(&work, args)?;
    let options =
        BuildOptions { work: work.clone(), resume: args.resume, ..options(&args.inputs, &args.model, &args.run) };
    // A build that was killed in its last moment has left the file and its state.
    let overwrite = args.force || args.resume && work.exists();
    let (pending, file) = PendingFile::create(output, overwrite, args.inputs.iter().map(|p| p.as_path()))?;
    interrupt::on_stop(&work, "run the same command with --resume to go on");
    let mut out = BufWriter::new(file);
    let built = {
        let progress = Terminal::new(args.run.progress, Some(&work));
        build(&options, &mut out, &progress)
    };
    let summary = built.map_err(|error| with_advice(error, &work))?;
    let written = out.into_inner().map_err(|error| error.into_error());
    pending.finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
    if args.json {
        print_json(&summary)?;
    } else {
        print(&summary, output)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn run_parts(args: &BuildArgs, path: &Path, PartRange { first, last }: PartRange) -> Result<ExitCode> {
    if first < last && args.output.is_some() {
        bail!("several parts do not go into one file; leave -o away, and they go into the job's directory");
    }
    interrupt::on_stop(path, "run the same command again; what is done stays done");
    let memory = args.run.memory.unwrap_or_else(|| machine_bytes() / 2);
    let job = PlannedJob::open(path)?;
    let mut built = vec![];
    for part in first..=last {
        let progress = Terminal::new(args.run.progress, None);
        let part = job.build(part, memory, args.output.as_deref(), &progress)?;
        drop(progress);
        if args.json { built.push(part) } else { print_part(&part)? }
    }
    if args.json {
        print_json(&built)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print_part(BuiltPart { path, report }: &BuiltPart) -> Result<()> {
    match report {
        None => say!("{} is there already", path.display()),
        Some(report) => say!(
            "{}   {}, {:.2} s, CPU {:.2} s, peak memory {}",
            path.display(),
            bytes(report.bytes),
            report.seconds,
            report.cpu_seconds,
            bytes(report.peak_memory_bytes)
        ),
    }
    Ok(())
}

/// What to build, and with what.
pub fn options(inputs: &[PathBuf], model: &ModelArgs, run: &RunArgs) -> BuildOptions {
    BuildOptions {
        inputs: inputs.to_vec(),
        tolerance: model.tolerance,
        unit: model.unit,
        effort: match model.effort {
            args::Effort::Fast => Effort::Fast,
            args::Effort::Default => Effort::Default,
            args::Effort::Best => Effort::Best,
        },
        fillings: match model.fillings {
            args::Fillings::Auto => Fillings::Auto,
            args::Fillings::IrregularOnly => Fillings::IrregularOnly,
            args::Fillings::GridWherePossible => Fillings::GridWherePossible,
        },
        memory: run.memory.unwrap_or_else(|| machine_bytes() / 2),
        region_triangles: model.region_triangles,
        ..BuildOptions::default()
    }
}

/// Where a build of a file works if memory does not do: always the same place, so that it can be gone on with.
fn work_directory(output: &Path, temp: Option<&Path>) -> PathBuf {
    // What is written to a device has no place for other files beside it.
    let is_device = output.exists() && !output.is_file();
    let folder = match (temp, output.parent()) {
        (Some(temp), _) => temp.to_owned(),
        _ if is_device => std::env::temp_dir(),
        (None, Some(folder)) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    };
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    match is_device {
        true => folder.join(format!("{name}.{}.building", std::process::id())),
        false => folder.join(format!("{name}.building")),
    }
}

/// Sees to it that what is left of an earlier build is neither lost nor in the way.
fn begin_in(work: &Path, args: &BuildArgs) -> Result<()> {
    if !work.exists() || args.resume {
        return Ok(());
    }
    if args.force {
        return remove_job(work);
    }
    bail!(
        "a build of this file has begun before and is not finished: its state is in {}; go on with --resume, or begin again with \
         --force",
        work.display()
    )
}

/// Removes a directory, if it is one of ours and nobody is at work in it.
pub fn remove_job(directory: &Path) -> Result<()> {
    let is_ours = |name: &str| {
        ["lock", "plan", "divided", "vertices", "triangles", PARTS_NAME, SLURM_NAME, MANIFEST_NAME].contains(&name)
            || ["region-", "part-", MANIFEST_NAME].iter().any(|prefix| name.starts_with(prefix))
            || name.ends_with(".tmp")
    };
    let cannot_remove = || format!("cannot remove {}", directory.display());
    for entry in fs::read_dir(directory).with_context(cannot_remove)? {
        let name = entry.with_context(cannot_remove)?.file_name();
        if !name.to_str().is_some_and(is_ours) {
            bail!(
                "{} is not removed: it holds {}, which is none of a job's files",
                directory.display(),
                name.display()
            );
        }
    }
    // Refused where a process is at work; removed with the lock's value.
    lodpack_cli::work::WorkDirectory::open(directory)?.keep(false);
    Ok(())
}

/// Says how to go on where there is something to go on with.
fn with_advice(error: BuildError, work: &Path) -> anyhow::Error {
    let error = anyhow::Error::from(error);
    match work.exists() {
        true => {
            error.context("the build stopped; what it has done is kept: run the same command with --resume to go on")
        }
        false => error,
    }
}

/// The summary, for people.
pub fn print(s: &BuildSummary, output: &Path) -> Result<()> {
    let r = &s.repairs;
    say!("{}", output.display());
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
