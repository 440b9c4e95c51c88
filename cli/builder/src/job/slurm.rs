//! Handing a planned job to Slurm: its scripts, and their submission.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde::{Deserialize, Serialize};

use super::stage::TaskFiles;
use super::{JobError, JobStatus, Manifest, PartState, Stage, Stages};
use lodpack_runtime::storage::WorkError;
use lodpack_runtime::text::shell_quoted;

const STAGE_SCRIPT: &str = include_str!("slurm/stage.sh");
const PARTS_SCRIPT: &str = include_str!("slurm/parts.sh");
const MERGE_SCRIPT: &str = include_str!("slurm/merge.sh");
/// The folder of scripts and logs within a job's directory.
pub const SLURM_NAME: &str = "slurm";
/// The most tasks in an array, by Slurm's default.
const MAX_TASKS: u32 = 1000;
/// Memory of a task over what its largest part takes.
const MEMORY_FACTOR: f64 = 1.25;

/// The scripts for Slurm.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SlurmScripts {
    /// The folder for all scripts and for logs.
    pub folder: PathBuf,
    /// Scripts by the name of their stage, for the stages of planning that are not done yet. Each waits for the one
    /// before it.
    pub stages: Vec<(String, String)>,
    /// Builds the parts that are not done yet; none if all are.
    pub parts: Option<String>,
    /// Scripts of the stages after the parts, likewise.
    pub after_parts: Vec<(String, String)>,
    /// Merges.
    pub merge: String,
}

/// The numbers that Slurm gave to the submitted jobs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Submitted {
    /// The arrays of the stages of planning, by name.
    #[serde(default)]
    pub stages: Vec<(String, String)>,
    /// The array of parts.
    pub parts: Option<String>,
    /// The arrays of the stages after the parts, by name.
    #[serde(default)]
    pub after_parts: Vec<(String, String)>,
    /// The merge, which waits for them.
    pub merge: String,
}

impl SlurmScripts {
    /// Scripts for the rest of a job, with the given number of threads for each task.
    ///
    /// # Errors
    /// If the job is not planned, or a path cannot be written in a shell script.
    pub fn new(job: &Path, output: &Path, lodpack: &Path, threads: u32) -> Result<Self, JobError> {
        let absolute = |path: &Path| std::path::absolute(path).map_err(|source| WorkError::new(path, "read", source));
        let (job, output) = (absolute(job)?, absolute(output)?);
        let (status, manifest) = (JobStatus::of(&job)?, Manifest::read(&job)?);
        let stages = match (status.planned, manifest.stages) {
            (_, Some(stages)) => stages,
            (true, None) => Stages { parts: status.parts.len() as u32, ..Stages::default() },
            (false, None) => return Err(JobError::NotPlanned { path: job }),
        };
        let memory = status.parts.iter().map(|part| part.memory).max().unwrap_or(stages.memory).div_ceil(1 << 20);
        let done = |part: u32| {
            status
                .parts
                .get(part as usize)
                .is_some_and(|part| matches!(part.state, PartState::Done { .. } | PartState::Empty))
        };
        let fill = |script: &str, stage: Stage, count: u32, tasks: &[u32]| -> Result<String, JobError> {
            let values = [
                ("@STAGE@", stage.to_string()),
                ("@ARRAY@", ranges(tasks)),
                ("@CPUS@", threads.max(1).to_string()),
                ("@MEMORY@", memory.to_string()),
                ("@MEBIBYTES@", ((memory as f64 * MEMORY_FACTOR) as u64 + 64).to_string()),
                ("@PER_TASK@", per_task(count).to_string()),
                ("@LAST_PART@", count.saturating_sub(1).to_string()),
                ("@LODPACK@", quoted(lodpack)?),
                ("@OUTPUT@", quoted(&output)?),
            ];
            // Slurm takes paths in its own lines without quotes.
            let lines = script.lines().map(|line| match line.starts_with("#SBATCH") {
                true => Ok(line.replace("@JOB@", &plain(&job)?)),
                false => Ok(line.replace("@JOB@", &quoted(&job)?)),
            });
            let text = lines.collect::<Result<Vec<String>, JobError>>()?.join("\n") + "\n";
            Ok(values.iter().fold(text, |text, (name, value)| text.replace(name, value)))
        };
        let of_stage = |stage: Stage, done: &dyn Fn(u32) -> bool, script: &str| {
            let count = stages.tasks(stage);
            let mut tasks: Vec<u32> =
                (0..count).filter(|&task| !done(task)).map(|task| task / per_task(count)).collect();
            tasks.dedup();
            if tasks.is_empty() { Ok(None) } else { fill(script, stage, count, &tasks).map(Some) }
        };
        let scripts = |of_job: &mut dyn Iterator<Item = Stage>| -> Result<Vec<_>, JobError> {
            let mut scripts = vec![];
            for stage in of_job {
                let is_done = |task: u32| TaskFiles::new(&job, stage, task).product.exists();
                scripts.extend(of_stage(stage, &is_done, STAGE_SCRIPT)?.map(|script| (stage.to_string(), script)));
            }
            Ok(scripts)
        };
        let after = [Stage::Arrange, Stage::Encode].into_iter().filter(|_| manifest.stages.is_some());
        Ok(Self {
            folder: job.join(SLURM_NAME),
            stages: scripts(&mut Stage::Build.earlier().filter(|_| !status.planned))?,
            parts: of_stage(Stage::Build, &done, PARTS_SCRIPT)?,
            after_parts: scripts(&mut after.into_iter())?,
            merge: fill(MERGE_SCRIPT, Stage::Build, 0, &[])?,
        })
    }

    /// Writes and submits all scripts. Each waits until all tasks of the one before it have succeeded. What still waits
    /// of an earlier submission is cancelled; what runs is left alone, and new tasks wait for it.
    ///
    /// # Errors
    /// If the scripts cannot be written, or Slurm refuses them.
    pub fn submit(&self) -> Result<Submitted, JobError> {
        let in_folder = |name: &str| self.folder.join(name);
        let write = |name: &str, text: &str| {
            fs::write(in_folder(name), text).map_err(|source| WorkError::new(&in_folder(name), "written", source))
        };
        fs::create_dir_all(&self.folder).map_err(|source| WorkError::new(&self.folder, "made", source))?;
        let before = fs::read(in_folder(SUBMITTED_NAME)).ok();
        if let Some(before) = before.and_then(|text| serde_json::from_slice::<Submitted>(&text).ok()) {
            // They may have ended long ago, or would wait for ever.
            let stages = before.stages.iter().chain(&before.after_parts).map(|(_, id)| id);
            let waiting = stages.chain(before.parts.iter().filter(|_| !before.stages.is_empty()));
            let _ = Command::new("scancel").arg("--state=PENDING").args(waiting).arg(&before.merge).output();
        }
        let mut last: Option<String> = None;
        let mut submit = |name: &str, script: &str| {
            write(name, script)?;
            let wait: Vec<String> = last.iter().map(|id| format!("--dependency=afterok:{id}")).collect();
            let id = sbatch(&wait, &in_folder(name))?;
            last = Some(id.clone());
            Ok::<String, JobError>(id)
        };
        let mut submit_all = |scripts: &[(String, String)]| -> Result<Vec<_>, JobError> {
            let submitted =
                scripts.iter().map(|(stage, script)| Ok((stage.clone(), submit(&format!("{stage}.sh"), script)?)));
            submitted.collect()
        };
        let stages = submit_all(&self.stages)?;
        let parts = self.parts.iter().map(|script| ("parts".to_owned(), script.clone())).collect::<Vec<_>>();
        let parts = submit_all(&parts)?.pop().map(|(_, id)| id);
        let after_parts = submit_all(&self.after_parts)?;
        let submitted = Submitted { stages, parts, after_parts, merge: submit("merge.sh", &self.merge)? };
        let text = serde_json::to_string_pretty(&submitted).map_err(io::Error::other);
        let text = text.map_err(|source| WorkError::new(&in_folder(SUBMITTED_NAME), "written", source))?;
        write(SUBMITTED_NAME, &text)?;
        Ok(submitted)
    }
}

const SUBMITTED_NAME: &str = "submitted.json";

/// Submits a script; returns the number that Slurm gives it.
fn sbatch(options: &[String], script: &Path) -> Result<String, JobError> {
    let output = Command::new("sbatch").arg("--parsable").args(options).arg(script).output();
    let output = output.map_err(|source| JobError::Engine {
        what: format!(
            "sbatch cannot be started ({source}); is Slurm installed here? --dry-run prints what would be submitted"
        ),
    })?;
    if !output.status.success() {
        let what = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        return Err(JobError::Engine { what: format!("sbatch refused {}: {what}", script.display()) });
    }
    // Where there are several clusters, the name of one follows the number.
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.trim().split(';').next().unwrap_or_default().to_owned())
}

/// How many tasks of a stage are one task of an array.
fn per_task(count: u32) -> u32 {
    count.div_ceil(MAX_TASKS).max(1)
}

/// Ascending numbers in the form 1,3-5.
fn ranges(numbers: &[u32]) -> String {
    let runs = numbers.chunk_by(|a, b| a + 1 == *b).map(|run| match run {
        [one] => one.to_string(),
        [first, .., last] => format!("{first}-{last}"),
        [] => String::new(),
    });
    runs.collect::<Vec<_>>().join(",")
}

/// A path for a shell.
fn quoted(path: &Path) -> Result<String, JobError> {
    Ok(shell_quoted(text_of(path)?))
}

/// A path for one of Slurm's option lines, which know no quotes.
fn plain(path: &Path) -> Result<String, JobError> {
    let text = text_of(path)?;
    match text.contains(char::is_whitespace) {
        true => Err(JobError::Engine {
            what: format!("{text}: Slurm's options cannot name a path with spaces; use a directory without"),
        }),
        // Slurm replaces percent signs in names of logs.
        false => Ok(text.replace('%', "%%")),
    }
}

fn text_of(path: &Path) -> Result<&str, JobError> {
    match path.to_str().filter(|text| !text.contains('\n')) {
        Some(text) => Ok(text),
        None => {
            Err(JobError::Engine { what: format!("{} cannot be written in a shell script; rename it", path.display()) })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_ranges() {
        assert_eq!(ranges(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
        assert_eq!(ranges(&[]), "");
    }

    #[test]
    fn paths_are_quoted() {
        assert_eq!(quoted(Path::new("/a b/it's")).unwrap(), "'/a b/it'\\''s'");
        assert!(plain(Path::new("/a b")).is_err());
    }
}
