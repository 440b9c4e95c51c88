//! A worker: a process that does the tasks of a job, one after the other, beside any number of others.

use std::cmp::Reverse;
use std::path::Path;
use std::time::Duration;

use super::{BuildError, Outcome, Stage, StagedJob};
use lodpack_runtime::progress::Progress;

/// How long a worker waits before it looks again for a task that another process has not finished: at least, and at
/// most.
const WAIT: [Duration; 2] = [Duration::from_millis(10), Duration::from_secs(2)];
/// In between, so large a part of the time that it has waited already: short stages follow each other fast, and long
/// ones cause few looks.
const WAITED_PART: u32 = 16;

/// Which tasks a worker does.
#[derive(Clone, Copy, Debug, Default)]
pub struct Share {
    /// Those of this stage; by default all stages, one after the other.
    pub stage: Option<Stage>,
    /// The first and the last of the stage; by default all.
    pub tasks: Option<[u32; 2]>,
}

/// Does all tasks that nobody else does, waits until those of the others are done, and goes on with the next stage.
/// When it returns, all tasks of its share are done. `done` hears of each task that this process does.
///
/// # Errors
/// The first that a task ends with, which the job's directory keeps, too.
pub fn work(
    path: &Path,
    share: Share,
    memory: u64,
    progress: &dyn Progress,
    done: &mut dyn FnMut(Stage, u32, &Outcome),
) -> Result<(), BuildError> {
    let job = StagedJob::open(path)?;
    for stage in Stage::ALL.into_iter().filter(|stage| share.stage.is_none_or(|only| only == *stage)) {
        let count = job.tasks(stage);
        let [first, last] = share.tasks.unwrap_or([0, count.saturating_sub(1)]);
        if share.tasks.is_some() {
            job.check_task(stage, last)?;
        }
        let mut left: Vec<u32> = (first..=last).filter(|&task| task < count).collect();
        // Workers that begin at different tasks seldom meet at a lock.
        let own = (u64::from(std::process::id().wrapping_mul(0x9E37_79B9)) * left.len() as u64) >> 32;
        left.rotate_left(own as usize);
        // The longest first, so that no worker begins one when the others are about to end.
        let weights = job.weights(stage);
        left.sort_by_key(|&task| Reverse(weights.get(task as usize)));
        let (mut waited, mut is_waiting) = (Duration::ZERO, false);
        while !left.is_empty() {
            let (mut failure, mut did, mut stops) = (None, false, false);
            left.retain(|&task| {
                if failure.is_some() || stops {
                    return true;
                }
                match job.run(stage, task, memory, progress) {
                    // A worker that waits asks for one task only: one that others end last or leave behind. A thousand
                    // workers that asked for a thousand tasks would keep the file system busy.
                    Ok(Outcome::Taken) => {
                        stops = is_waiting;
                        true
                    }
                    Ok(outcome) => {
                        did |= matches!(outcome, Outcome::Done(_));
                        done(stage, task, &outcome);
                        false
                    }
                    Err(error) => {
                        failure = Some(error);
                        true
                    }
                }
            });
            if let Some(error) = failure {
                return Err(error);
            }
            is_waiting = !did;
            if !left.is_empty() && is_waiting {
                let wait = (waited / WAITED_PART).clamp(WAIT[0], WAIT[1]);
                std::thread::sleep(wait);
                waited += wait;
            } else {
                waited = Duration::ZERO;
            }
        }
    }
    Ok(())
}
