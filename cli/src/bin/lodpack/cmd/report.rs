//! `lodpack report`

use super::inputs::find_inputs;
use super::open::{self, open};
use super::verify::file_and_meshes;
use super::{print_json, use_threads};
use crate::args::ReportArgs;
use crate::interrupt;
use crate::output::{PendingFile, finish_all, say};
use crate::progress_bar::{self, Terminal};
use anyhow::{Context, Result, bail};
use lodpack_cli::import::import_shape;
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::report::{
    InputFacts, Measurements, Reader, Reference, Report, SurfaceFacts, Trial, VerifyCost, budgets, cuts, page,
    read_peers, settings, sweep, table,
};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::pipeline::ModelOptions;
use lodpack_cli::progress::Progress;
use lodpack_cli::stage::repair::repair;
use lodpack_cli::storage::default_memory;
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// By default, builds of larger inputs run once.
const REPEATED_TRIANGLES: usize = 300_000;
const REPEATS: u32 = 3;
/// The files of a report.
const NAMES: [&str; 3] = ["report.html", "report.csv", "report.json"];
/// The directory for builds, within the report's.
const TRIALS: &str = "trials.tmp";

/// Measures, and writes the report.
pub fn run(args: &mut ReportArgs) -> Result<ExitCode> {
    let (input, against) = file_and_meshes(args.input.as_deref(), &args.against).context(
        "nothing to report on; type lodpack report MESH -o DIR, or lodpack report FILE --against MESH -o DIR",
    )?;
    let (input, against) = (input.to_owned(), against.to_vec());
    args.against = against;
    run_on(&input, args)
}

fn run_on(input: &Path, args: &ReportArgs) -> Result<ExitCode> {
    use_threads(args.run.threads)?;
    if args.trial {
        return run_trial(input, args);
    }
    let is_file = is_lodpack(input)?;
    if !is_file && !args.against.is_empty() {
        bail!("--against needs a .lodpack file; a mesh is always the reference of its own builds");
    }
    let name = input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let peers = args.peers.as_deref().map(|path| read_peers(path, &name)).transpose()?.unwrap_or_default();
    let directory = prepare_directory(args)?;
    let progress = Terminal::new(args.run.progress, progress_bar::REPORT);
    let mesh = read_mesh(input, args, is_file, &progress)?;
    let triangles = mesh.as_ref().map_or(0, |mesh| mesh.triangles.len());
    let runs = args.runs.unwrap_or(if triangles > REPEATED_TRIANGLES || args.quick { 1 } else { REPEATS });

    let mut measured = Measurements { subject: name, peers, ..Measurements::default() };
    let reference = mesh.as_ref().map(|mesh| Reference::new(mesh, args.samples as usize));
    if let Some(mesh) = &mesh {
        let (triangles, vertices) = (mesh.triangles.len() as u64, mesh.positions.len() as u64);
        let (mean_edge_length, surface) = (mesh.mean_edge_length(), SurfaceFacts::new(mesh));
        measured.input = Some(InputFacts { triangles, vertices, mean_edge_length, surface });
    }
    let mut file = vec![];
    if let Some(reference) = reference.as_ref().filter(|_| !is_file) {
        let trial = trial(input, args, &directory.0, runs)?;
        let base = ModelOptions { chart_triangles: args.chart_triangles, ..args.model.options() };
        let all = settings(&base, args.run.threads, triangles as u64, args.quick);
        measured.sweep = sweep::sweep(&trial, &all, reference, &mut file, &progress)?;
    }
    let reader = || match is_file {
        true => open(input).map_err(Into::into),
        false => {
            let source = cuts::Source::new(Box::new(file.clone()));
            Reader::open(source, lodpack::Limits::default()).map_err(Into::into)
        }
    };
    measured.first_picture = cuts::first_picture(&reader)?;
    let repeats = args.runs.unwrap_or(REPEATS);
    measured.cuts = cuts::measure_cuts(&reader, reference.as_ref(), repeats, args.quick, &progress)?;
    measured.budgets = budgets::measure_budgets(&reader)?;
    if let Some(reference) = &reference {
        progress.begin("verification", 0);
        let file = reader().map_err(|error: Box<dyn std::error::Error + Send + Sync>| anyhow::anyhow!(error))?;
        measured.verification = Some(VerifyCost::measure(&file, reference)?);
    }
    progress.complete();
    let report = Report::new(measured);
    write_report(args, &report)?;
    Ok(ExitCode::SUCCESS)
}

/// Builds once; [`sweep::sweep`] starts a process for each build.
fn run_trial(input: &Path, args: &ReportArgs) -> Result<ExitCode> {
    let work = args.output.with_extension("building");
    let base = super::build::options(vec![input.to_owned()], &args.model, &args.run);
    let model = ModelOptions { chart_triangles: args.chart_triangles, ..base.model };
    let options = BuildOptions { model, work, ..base };
    let cannot_write = || format!("cannot write {}", args.output.display());
    let mut out = std::io::BufWriter::new(fs::File::create(&args.output).with_context(cannot_write)?);
    let summary = build(&options, &mut out, &lodpack_cli::progress::Silent)?;
    out.into_inner().map_err(|error| error.into_error()).with_context(cannot_write)?;
    print_json(&summary)?;
    Ok(ExitCode::SUCCESS)
}

fn trial(input: &Path, args: &ReportArgs, trials: &Path, runs: u32) -> Result<Trial> {
    let file = trials.join("trial.lodpack");
    let text = |path: &Path| {
        path.to_str()
            .map(str::to_owned)
            .with_context(|| format!("{}: the name is not UTF-8; rename the file", path.display()))
    };
    let mut arguments = vec!["report".into(), text(input)?, "-o".into(), text(&file)?, "--trial".into()];
    if let Some(unit) = args.model.unit {
        let known = ["um", "mm", "cm", "dm", "m", "km", "in", "ft", "yd"];
        let name = known.into_iter().find(|name| name.parse() == Ok(unit)).context("the unit has no name")?;
        arguments.extend(["--unit".to_string(), name.to_string()]);
    }
    Ok(Trial {
        program: std::env::current_exe().context("cannot find the path of this program")?,
        arguments,
        default_tolerance: vec!["--tolerance".into(), spelled(args.model.tolerance)],
        file,
        runs,
        memory: args.run.memory.unwrap_or_else(default_memory),
    })
}

/// A tolerance as people type it.
fn spelled(tolerance: Tolerance) -> String {
    match tolerance {
        Tolerance::Auto | Tolerance::OfBend(_) => "auto".into(),
        Tolerance::InputUnits(length) => format!("{length:e}"),
        Tolerance::OfDiagonal(share) => format!("{:e}%", share * 100.0),
        Tolerance::OfMeanEdge(factor) => format!("{factor:e}edge"),
        Tolerance::Metres(metres) => format!("{metres:e}m"),
    }
}

/// Whether a path or address names a lodpack file.
fn is_lodpack(path: &Path) -> Result<bool> {
    if path.to_str().is_some_and(|text| text.contains("://")) {
        return Ok(true);
    }
    if path.is_dir() {
        bail!("{} is a directory; name a mesh or a .lodpack file", path.display());
    }
    let cannot_read = || format!("cannot read {}", path.display());
    let mut head = vec![];
    fs::File::open(path).with_context(cannot_read)?.take(4).read_to_end(&mut head).with_context(cannot_read)?;
    Ok(head == open::BEGINNING || path.extension().is_some_and(|extension| extension == "lodpack"))
}

/// The repaired mesh that errors are measured against.
fn read_mesh(input: &Path, args: &ReportArgs, is_file: bool, progress: &Terminal) -> Result<Option<Mesh>> {
    let inputs = if is_file { find_inputs(&args.against)? } else { vec![input.to_owned()] };
    if inputs.is_empty() {
        return Ok(None);
    }
    progress.begin("import", 0);
    let mesh = repair(import_shape(&inputs, &args.model.raster.options(), progress)?).0;
    if mesh.triangles.is_empty() {
        bail!("{}: after repair, no triangle has an area; check the mesh", inputs[0].display());
    }
    Ok(Some(mesh))
}

/// A directory for builds, removed when dropped.
struct Trials(PathBuf);

impl Drop for Trials {
    fn drop(&mut self) {
        // If this fails, the name still shows that it is temporary.
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn prepare_directory(args: &ReportArgs) -> Result<Trials> {
    let output = &args.output;
    if output.exists() && !output.is_dir() {
        bail!("{} is a file; name a directory", output.display());
    }
    if let Some(name) = NAMES.iter().find(|name| output.join(name).exists())
        && !args.force
    {
        bail!(
            "{} exists; pass --force to overwrite the report, or name another directory with -o",
            output.join(name).display()
        );
    }
    let trials = Trials(output.join(TRIALS));
    fs::create_dir_all(&trials.0).with_context(|| format!("cannot make {}", trials.0.display()))?;
    interrupt::on_stop(&trials.0, "no report was written; start again with the same command");
    Ok(trials)
}

fn write_report(args: &ReportArgs, report: &Report) -> Result<()> {
    let texts = [page(report), table(report), serde_json::to_string_pretty(report)? + "\n"];
    let mut files = vec![];
    for (name, text) in NAMES.into_iter().zip(&texts) {
        let path = args.output.join(name);
        let (pending, mut file) = PendingFile::create(&path, args.force, [])?;
        file.write_all(text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
        files.push((pending, file));
    }
    finish_all(files)?;
    if args.json {
        return print_json(report);
    }
    report.words.iter().try_for_each(|sentence| {
        say!("{sentence}");
        Ok::<_, anyhow::Error>(())
    })?;
    say!("{}", args.output.join(NAMES[0]).display());
    Ok(())
}
