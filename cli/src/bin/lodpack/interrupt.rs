//! Ctrl-C and SIGTERM: unfinished files are removed, and a message says how to continue.
//!
//! Every lasting file is written under a temporary name first, so the program can be stopped at any moment.

use crate::messages;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Files and directories to remove when the program is stopped.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(vec![]);

/// Whether the program is being stopped.
static IS_STOPPING: AtomicBool = AtomicBool::new(false);

/// Blocks for ever if the program is being stopped: an error at that time is only a consequence, and not worth a
/// message.
pub fn wait_if_stopping() {
    while IS_STOPPING.load(Ordering::SeqCst) {
        std::thread::park();
    }
}

/// Exit status after Ctrl-C: 128 + SIGINT, as shells report it.
pub const STOPPED: i32 = 130;

/// Sets what happens when the program is stopped from now on: unfinished files go, and `advice` is shown if `state`
/// exists.
pub fn on_stop(state: &Path, advice: &'static str) {
    on_stop_after(|| (), state, advice);
}

/// [`on_stop`] for a command that leaves no state behind.
pub fn on_stop_leave_nothing() {
    on_stop(Path::new(""), "");
}

/// Ends the program without a word: being stopped is how a server ends.
pub fn on_stop_end() {
    // If no handler can be set, the system's own stays, which ends the program, too.
    let _ = ctrlc::set_handler(|| std::process::exit(0));
}

/// [`on_stop`] with an action that comes first.
pub fn on_stop_after(mut first: impl FnMut() + Send + 'static, state: &Path, advice: &'static str) {
    let state = state.to_owned();
    // If no handler can be set, the system's own stays, which leaves temporary files behind.
    let _ = ctrlc::set_handler(move || {
        IS_STOPPING.store(true, Ordering::SeqCst);
        first();
        if let Ok(unfinished) = UNFINISHED.lock() {
            unfinished.iter().for_each(|path| match path.is_dir() {
                true => remove_folder(path),
                false => drop(fs::remove_file(path)),
            });
        }
        messages::tell("stopped", if state.exists() { advice } else { "no unfinished files were left behind" });
        std::process::exit(STOPPED);
    });
}

/// Removes a folder. Renamed first, it is out of reach of threads that still write to it, but for those that have just
/// opened a file there.
pub fn remove_folder(path: &Path) {
    let mut name = path.as_os_str().to_owned();
    name.push("x");
    let name = PathBuf::from(name);
    for _ in 0..ATTEMPTS {
        let folder = if fs::rename(path, &name).is_ok() { &name } else { path };
        let _ = fs::remove_dir_all(folder);
        if !path.exists() && !name.exists() {
            return;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// How often a folder is removed into which threads still write.
const ATTEMPTS: u32 = 10;

/// Registers a file or directory that is unfinished.
pub fn unfinished(path: &Path) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        unfinished.push(path.to_owned());
    }
}

/// Removes a file from the register: it is finished, or gone.
pub fn finished(path: &Path) {
    if let Ok(mut unfinished) = UNFINISHED.lock() {
        unfinished.retain(|other| other != path);
    }
}
