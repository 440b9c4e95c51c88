//! Progress on stderr: a bar per stage on terminals, lines elsewhere, or JSON.

use crate::args::ProgressStyle;
use indicatif::ProgressBar;
use lodpack_cli::progress::Progress;
use lodpack_cli::summary::peak_memory_bytes;
use std::fs;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// The stages of builds and their shares of the time, as measured on scans.
const BUILD_STAGES: [(&str, f64); 5] =
    [("import", 0.05), ("repair", 0.10), ("segment", 0.22), ("roots", 0.58), ("pack", 0.05)];
/// Between two lines of JSON of one stage.
const INTERVAL: Duration = Duration::from_millis(500);

/// Draws on stderr; finishes its last bar when dropped.
pub struct Terminal {
    state: Mutex<State>,
    style: ProgressStyle,
    drawn: bool,
    start: Instant,
    /// Whose size is the disk space in use.
    work: Option<PathBuf>,
}

#[derive(Default)]
struct State {
    current: Option<Stage>,
    last_line: Option<Instant>,
}

struct Stage {
    bar: ProgressBar,
    name: &'static str,
    start: Instant,
    done: u64,
    total: u64,
}

impl Stage {
    /// How much of the whole build is done, if this is a stage of one.
    fn overall(&self) -> Option<f64> {
        let place = BUILD_STAGES.iter().position(|(name, _)| *name == self.name)?;
        let before: f64 = BUILD_STAGES[..place].iter().map(|(_, share)| share).sum();
        let within = if self.total > 0 { (self.done as f64 / self.total as f64).min(1.0) } else { 0.0 };
        Some(before + within * BUILD_STAGES[place].1)
    }
}

impl Terminal {
    /// `work` is a build's work directory, if it has one.
    pub fn new(style: ProgressStyle, work: Option<&Path>) -> Self {
        Self {
            state: Mutex::default(),
            style,
            drawn: style == ProgressStyle::Auto && std::io::stderr().is_terminal(),
            start: Instant::now(),
            work: work.map(Path::to_owned),
        }
    }

    fn finish(&self, state: &mut State) {
        if let Some(stage) = state.current.take() {
            stage.bar.finish_and_clear();
            if self.style == ProgressStyle::Auto {
                talk(format_args!("{:<10} {:>8.2} s", stage.name, stage.start.elapsed().as_secs_f64()));
            }
        }
    }

    fn json_line(&self, stage: &Stage) {
        let elapsed = self.start.elapsed().as_secs_f64();
        let overall = stage.overall();
        // From a few percent there is nothing to tell.
        let remaining = overall.filter(|&done| done > 0.1).map(|done| elapsed * (1.0 - done) / done);
        let line = serde_json::json!({
            "stage": stage.name,
            "done": stage.done,
            "total": stage.total,
            "percent": overall.map(|done| (done * 1000.0).round() / 10.0),
            "elapsed_seconds": elapsed,
            "remaining_seconds": remaining,
            "memory_bytes": peak_memory_bytes(),
            "disk_bytes": self.work.as_deref().map_or(0, folder_bytes),
        });
        talk(format_args!("{line}"));
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Ok(mut state) = self.state.lock() {
            self.finish(&mut state);
        }
    }
}

fn folder_bytes(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).filter(|metadata| metadata.is_file()).map(|m| m.len()).sum()
}

/// A line on stderr. Where nobody listens any more there is nobody to tell.
fn talk(text: std::fmt::Arguments) {
    let _ = writeln!(std::io::stderr().lock(), "{text}");
}

impl Progress for Terminal {
    fn begin(&self, stage: &'static str, total: u64) {
        let Ok(mut state) = self.state.lock() else { return };
        self.finish(&mut state);
        let bar = if self.drawn { ProgressBar::new(total) } else { ProgressBar::hidden() };
        let mut stage = Stage { bar, name: stage, start: Instant::now(), done: 0, total };
        let template = "{msg:<16} {bar:40} {percent:>3} %  {elapsed}  remaining {eta}";
        if let Ok(style) = indicatif::ProgressStyle::with_template(template) {
            stage.bar.set_style(style);
        }
        let overall = stage.overall().map_or(String::new(), |done| format!("{:.0} %: ", done * 100.0));
        stage.bar.set_message(format!("{overall}{}", stage.name));
        stage.done = 0;
        if self.style == ProgressStyle::Json {
            self.json_line(&stage);
            state.last_line = Some(Instant::now());
        }
        state.current = Some(stage);
    }

    fn advance(&self, amount: u64) {
        let Ok(mut state) = self.state.lock() else { return };
        let State { current: Some(stage), last_line } = &mut *state else { return };
        stage.done += amount;
        stage.bar.inc(amount);
        if self.style == ProgressStyle::Json && last_line.is_none_or(|last| last.elapsed() > INTERVAL) {
            self.json_line(stage);
            *last_line = Some(Instant::now());
        }
    }

    fn note(&self, message: &str) {
        match self.state.lock() {
            Ok(state) if self.drawn && state.current.is_some() => {
                if let Some(stage) = &state.current {
                    stage.bar.suspend(|| talk(format_args!("note: {message}")));
                }
            }
            _ if self.style == ProgressStyle::Json => talk(format_args!("{}", serde_json::json!({ "note": message }))),
            _ => talk(format_args!("note: {message}")),
        }
    }
}
