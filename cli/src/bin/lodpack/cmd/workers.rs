//! `lodpack build --workers`

use super::inputs::Notes;
use super::state::naming;
use crate::args::BuildArgs;
use crate::progress_bar::{Terminal, folder_bytes};
use anyhow::{Context, Result, anyhow};
use lodpack_cli::job::{
    BuildOptions, JobStatus, Manifest, PARTS_NAME, PartOptions, Parts, STAGES_NAME, Stage, StagedJob, merge,
};
use lodpack_cli::pipeline::summary::{BuildSummary, StageTime};
use lodpack_cli::progress::{Progress, Silent};
use lodpack_cli::storage::WorkDirectory;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Tasks for each worker, so that none waits long for the last one.
const TASKS_PER_WORKER: u32 = 4;
/// Bytes of input in a task: less than a region has.
const TASK_BYTES: u64 = 16 << 20;
/// The merge's share of the time.
const MERGE_SHARE: f64 = 0.02;
/// How often the progress is looked at.
const INTERVAL: Duration = Duration::from_millis(200);

/// Builds a file with the given number of processes, which share a job in the directory `work`. `finish` gets the
/// written file, and its result is handed on.
pub fn run<T>(
    args: &BuildArgs,
    workers: u32,
    options: &BuildOptions,
    output: &Path,
    file: File,
    finish: impl FnOnce(File) -> Result<T>,
) -> Result<(BuildSummary, T)> {
    let (work, started) = (&options.work, Instant::now());
    let parts = PartOptions {
        count: Some(count_of_tasks(options, workers)),
        range_bytes: Some(TASK_BYTES),
        ..PartOptions::default()
    };
    // It was checked before that an existing state may be continued.
    let begun = BuildOptions { resume: true, ..options.clone() };
    StagedJob::begin(work, parts, &begun, &Notes).map_err(|error| naming(error, work, Some("--temp")))?;
    let job = StagedJob::open(work)?;
    let shares =
        Stage::ALL.into_iter().filter(|&stage| job.tasks(stage) > 0).map(|stage| (stage.name(), stage.share()));
    let progress = Terminal::through(args.run.progress, shares.chain([("pack", MERGE_SHARE)]), work);
    let children = (0..workers).map(|_| start(args, workers, options)).collect::<Result<Vec<_>>>()?;
    let mut shown = Shown::default();
    let notes = wait(children, &job, &mut shown, &progress);
    drop(job);
    let notes = notes
        .context("the build stopped, and what it has done is kept; run the same command with --resume to continue")?;
    notes.iter().for_each(|note| progress.note(note));
    let mut out = BufWriter::new(file);
    let parts = Parts::check(std::slice::from_ref(work), &Silent)?;
    let merged = merge(&parts, work, &mut out, &progress).map_err(|error| naming(error, output, Some("-o")))?;
    let written = out.into_inner().map_err(|error| error.into_error());
    let finished = finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
    progress.complete();
    // Nothing needs the state any more.
    let status = JobStatus::of(work)?;
    WorkDirectory::open(work)?.keep(false);
    let of_tasks = status.stages.iter().map(|stage| StageTime {
        stage: stage.stage.name(),
        wall_seconds: stage.seconds,
        cpu_seconds: stage.cpu_seconds,
    });
    let of_merge = merged.stages.iter().filter(|stage| stage.stage == "pack").cloned();
    let stages: Vec<StageTime> = of_tasks.chain(of_merge).collect();
    let summary = BuildSummary {
        wall_seconds: started.elapsed().as_secs_f64(),
        cpu_seconds: stages.iter().map(|stage| stage.cpu_seconds).sum(),
        peak_memory_bytes: status.stages.iter().map(|stage| stage.peak_memory_bytes).max().unwrap_or(0),
        temporary_bytes: shown.most_bytes,
        stages,
        ..merged
    };
    Ok((summary, finished))
}

fn count_of_tasks(options: &BuildOptions, workers: u32) -> u32 {
    // A build that goes on keeps its tasks, with any number of workers.
    if let Ok(Manifest { stages: Some(stages), .. }) = Manifest::read(&options.work) {
        return stages.parts;
    }
    let sizes = options.inputs.iter().filter_map(|input| input.metadata().ok()).map(|metadata| metadata.len());
    let tasks = u32::try_from(sizes.sum::<u64>() / TASK_BYTES).unwrap_or(u32::MAX);
    tasks.max(workers.saturating_mul(TASKS_PER_WORKER))
}

/// Starts a worker, which ends when this process ends.
fn start(args: &BuildArgs, workers: u32, options: &BuildOptions) -> Result<Child> {
    let program = std::env::current_exe().context("cannot find the path of this program")?;
    let threads = match args.run.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    let each = |amount: u64| (amount / u64::from(workers)).max(1);
    let mut command = Command::new(program);
    command.args(["work", "--progress", "none", "--with-parent"]);
    command.args(["--memory", &each(options.memory).to_string(), "--threads", &each(threads as u64).to_string()]);
    command.arg("--").arg(&options.work);
    let child = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    child.context("cannot start a worker")
}

/// Waits for all workers; returns what they had to say.
fn wait(children: Vec<Child>, job: &StagedJob, shown: &mut Shown, progress: &Terminal) -> Result<BTreeSet<String>> {
    let folders = [job.folder().to_owned(), job.folder().join(STAGES_NAME), job.folder().join(PARTS_NAME)];
    let (mut ended, mut notes) = (vec![], BTreeSet::new());
    std::thread::scope(|scope| -> Result<()> {
        let mut waiting: Vec<_> = children
            .into_iter()
            .map(|mut child| {
                // The pipe stays open until the worker has ended.
                let pipe = child.stdin.take();
                scope.spawn(move || {
                    let output = child.wait_with_output();
                    drop(pipe);
                    output
                })
            })
            .collect();
        while !waiting.is_empty() {
            let (done, rest): (Vec<_>, Vec<_>) = waiting.into_iter().partition(|thread| thread.is_finished());
            waiting = rest;
            for thread in done {
                let output = thread.join().map_err(|_| anyhow!("a worker cannot be waited for"))?;
                ended.push(output.context("a worker cannot be waited for")?);
            }
            shown.update(job, progress);
            shown.most_bytes = shown.most_bytes.max(folders.iter().map(|folder| folder_bytes(folder)).sum());
            if !waiting.is_empty() {
                std::thread::sleep(INTERVAL);
            }
        }
        Ok(())
    })?;
    for output in &ended {
        let text = String::from_utf8_lossy(&output.stderr);
        if !output.status.success() {
            let reason = text.lines().last().unwrap_or("it was killed").trim_start_matches("error: ").to_owned();
            return Err(anyhow!("a worker ended early: {reason}"));
        }
        notes.extend(text.lines().filter_map(|line| line.strip_prefix("note: ")).map(str::to_owned));
    }
    Ok(notes)
}

/// How far the progress is shown.
#[derive(Default)]
struct Shown {
    /// The stage, by its place among all.
    stage: usize,
    begun: bool,
    /// Tasks of the stage.
    done: u32,
    /// The most bytes that the job's directory was seen to take.
    most_bytes: u64,
}

impl Shown {
    fn update(&mut self, job: &StagedJob, progress: &Terminal) {
        while let Some(&stage) = Stage::ALL.get(self.stage) {
            let tasks = job.tasks(stage);
            if !self.begun && tasks > 0 {
                progress.begin(stage.name(), tasks.into());
                self.begun = true;
            }
            let done = (0..tasks).filter(|&task| job.is_done(stage, task)).count() as u32;
            progress.advance(done.saturating_sub(self.done).into());
            self.done = self.done.max(done);
            if done < tasks {
                return;
            }
            *self = Self { stage: self.stage + 1, most_bytes: self.most_bytes, ..Self::default() };
        }
    }
}
