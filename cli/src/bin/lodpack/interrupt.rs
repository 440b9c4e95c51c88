//! Ctrl-C and SIGTERM: nothing unfinished keeps its name, and the user hears how to go on.
//!
//! All that lasts is written under another name first, so that stopping at any moment is as good as any other.

use crate::talk;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Files to remove when the program is stopped, and directories with all that is in them.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(vec![]);

/// Whether the program is being stopped.
static IS_STOPPING: AtomicBool = AtomicBool::new(false);

/// Waits for the end if the program is being stopped: what fails then fails because of that.
pub fn wait_if_stopping() {
    while IS_STOPPING.load(Ordering::SeqCst) {
        std::thread::park();
    }
}

/// Exit status after Ctrl-C, as shells have it.
const STOPPED: i32 = 130;

/// Says what happens when the program is stopped from now on; `advice` is given where `state` exists.
pub fn on_stop(state: &Path, advice: &'static str) {
    on_stop_after(|| (), state, advice);
}

/// As [`on_stop`], for a command that leaves nothing.
pub fn on_stop_leave_nothing() {
    on_stop(Path::new(""), "");
}

/// As [`on_stop`]; something is done before all else.
pub fn on_stop_after(mut first: impl FnMut() + Send + 'static, state: &Path, advice: &'static str) {
    let state = state.to_owned();
    // Where handlers cannot be set the system's own remains, which leaves files with names of unfinished ones.
    let _ = ctrlc::set_handler(move || {
        IS_STOPPING.store(true, Ordering::SeqCst);
        first();
        if let Ok(unfinished) = UNFINISHED.lock() {
            unfinished.iter().for_each(|path| match path.is_dir() {
                true => drop(fs::remove_dir_all(path)),
                false => drop(fs::remove_file(path)),
            });
        }
        talk::tell("stopped", if state.exists() { advice } else { "nothing is left of it" });
        std::process::exit(STOPPED);
    });
}

/// Notes a file, or a directory, that is not finished yet.
pub fn unfinished(path: &Path) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        unfinished.push(path.to_owned());
    }
}

/// Notes that a file is finished, or gone.
pub fn finished(path: &Path) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        unfinished.retain(|other| other != path);
    }
}
