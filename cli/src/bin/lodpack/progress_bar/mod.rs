//! Progress on stderr: a bar for each stage on terminals, lines elsewhere, or JSON.

mod course;

pub use course::{
    ATLAS, BUILD, BUILD_HEIGHTS, COMPARE, EXPORT, EXPORT_ARCHIVE, EXPORT_LEVELS, MERGE, PLAN, PLAN_HEIGHTS, RASTER,
    REPORT, SELFTEST, Stages, TIN, VERIFY, VERIFY_AGAINST,
};

use crate::args::ProgressStyle;
use crate::messages;
use course::Course;
use indicatif::ProgressBar;
use lodpack_cli::machine::peak_memory_bytes;
use lodpack_cli::progress::Progress;
use std::fs;
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The least time between two lines of JSON within a stage.
const LEAST_INTERVAL: Duration = Duration::from_millis(500);
/// The most time between two lines, as JSON and as text: a stage without news still shows that the command is alive.
const MOST_JSON_INTERVAL: Duration = Duration::from_secs(5);
const MOST_TEXT_INTERVAL: Duration = Duration::from_secs(30);

/// Shows progress on stderr; finishes its last bar when dropped.
pub struct Terminal {
    shared: Arc<Shared>,
    /// Writes a line whenever none has come for some time.
    watch: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    ended: Condvar,
    style: ProgressStyle,
    drawn: bool,
    /// Whether a stage leaves a line with its time.
    leaves_times: bool,
    start: Instant,
    /// The directory whose size is reported as disk space in use.
    work: Option<PathBuf>,
}

struct State {
    course: Course,
    current: Option<Stage>,
    last_line: Instant,
    has_ended: bool,
}

struct Stage {
    bar: ProgressBar,
    name: &'static str,
    start: Instant,
    /// The share of the whole command that the bar shows.
    percent: Option<u32>,
}

impl Terminal {
    /// For a command with these stages.
    pub fn new(style: ProgressStyle, stages: Stages) -> Self {
        Self::with(style, Course::new(stages.iter().copied()), None, true)
    }

    /// For a command that is quick as a rule, of which nobody knows how long it may take: the user sees that it is
    /// alive, and no line stays behind.
    pub fn while_waiting() -> Self {
        Self::with(ProgressStyle::Auto, Course::new([]), None, false)
    }

    /// For a command that repeats a stage, with these amounts of work.
    pub fn repeated(style: ProgressStyle, stage: &'static str, amounts: impl Iterator<Item = u64>) -> Self {
        Self::with(style, Course::new(amounts.map(|amount| (stage, amount as f64))), None, true)
    }

    /// For a command with a work directory, whose stages have these shares of the time.
    pub fn through(style: ProgressStyle, stages: impl Iterator<Item = (&'static str, f64)>, work: &Path) -> Self {
        Self::with(style, Course::new(stages), Some(work), true)
    }

    /// For a command with a work directory.
    pub fn working_in(style: ProgressStyle, stages: Stages, work: &Path) -> Self {
        Self::with(style, Course::new(stages.iter().copied()), Some(work), true)
    }

    fn with(style: ProgressStyle, course: Course, work: Option<&Path>, leaves_times: bool) -> Self {
        let (start, drawn) = (Instant::now(), style == ProgressStyle::Auto && std::io::stderr().is_terminal());
        let state = State { course, current: None, last_line: start, has_ended: false };
        let (state, ended, work) = (Mutex::new(state), Condvar::new(), work.map(Path::to_owned));
        let shared = Arc::new(Shared { state, ended, style, drawn, leaves_times, start, work });
        let interval = match style {
            ProgressStyle::Json => Some(MOST_JSON_INTERVAL),
            ProgressStyle::Auto if !drawn => Some(MOST_TEXT_INTERVAL),
            _ => None,
        };
        let watch = interval.map(|interval| {
            let shared = shared.clone();
            std::thread::spawn(move || shared.watch(interval))
        });
        Self { shared, watch }
    }

    /// Reports that the command is complete.
    pub fn complete(self) {
        if self.shared.style == ProgressStyle::Json {
            let Ok(state) = self.shared.state.lock() else { return };
            let [_, total] = state.course.stage();
            let stage = state.current.as_ref().map_or("done", |stage| stage.name);
            self.shared.json_line(stage, [total, total], Some(1.0), Some(0.0));
        }
    }
}

impl Shared {
    /// Writes a line whenever the last one is older than the interval, until the end.
    fn watch(&self, interval: Duration) {
        let Ok(mut state) = self.state.lock() else { return };
        while !state.has_ended {
            let waited = state.last_line.elapsed();
            if waited >= interval && state.current.is_some() {
                self.line(&mut state);
            }
            let left = interval.saturating_sub(state.last_line.elapsed()).max(LEAST_INTERVAL);
            match self.ended.wait_timeout(state, left) {
                Ok((next, _)) => state = next,
                Err(_) => return,
            }
        }
    }

    /// Writes how far the command is.
    fn line(&self, state: &mut State) {
        state.last_line = Instant::now();
        let Some(Stage { name, start, .. }) = &state.current else { return };
        let elapsed = self.start.elapsed().as_secs_f64();
        let (overall, remaining) = (state.course.overall(), state.course.remaining(elapsed));
        let [done, total] = state.course.stage();
        if self.style == ProgressStyle::Json {
            return self.json_line(name, [done, total], overall, remaining);
        }
        let mut text = format!("{name:<10} {:>8.0} s so far", start.elapsed().as_secs_f64());
        if total > 0 {
            text += &format!(", {:.0} % done", 100.0 * (done as f64 / total as f64).min(1.0));
        }
        if let Some(overall) = overall {
            text += &format!("; {:.0} % in all", 100.0 * overall);
        }
        if let Some(remaining) = remaining {
            text += &format!(", about {remaining:.0} s left");
        }
        messages::line(format_args!("{text}"));
    }

    fn json_line(&self, stage: &str, [done, total]: [u64; 2], overall: Option<f64>, remaining: Option<f64>) {
        let line = serde_json::json!({
            "stage": stage,
            "done": done,
            "total": total,
            "percent": overall.map(|done| (done * 1000.0).round() / 10.0),
            "elapsed_seconds": self.start.elapsed().as_secs_f64(),
            "remaining_seconds": remaining,
            "memory_bytes": peak_memory_bytes(),
            "disk_bytes": self.work.as_deref().map_or(0, folder_bytes),
        });
        messages::line(format_args!("{line}"));
    }

    fn finish(&self, state: &mut State) {
        if let Some(stage) = state.current.take() {
            stage.bar.finish_and_clear();
            if self.style == ProgressStyle::Auto && self.leaves_times {
                messages::line(format_args!("{:<10} {:>8.2} s", stage.name, stage.start.elapsed().as_secs_f64()));
                state.last_line = Instant::now();
            }
        }
    }

    fn step(&self, amount: u64, step: impl Fn(&mut Course)) {
        let Ok(mut state) = self.state.lock() else { return };
        step(&mut state.course);
        let overall = state.course.overall();
        if let Some(stage) = &mut state.current {
            stage.bar.inc(amount);
            stage.show(overall);
        }
        if self.style == ProgressStyle::Json && state.last_line.elapsed() > LEAST_INTERVAL {
            self.line(&mut state);
        }
    }
}

impl Stage {
    /// Puts the share of the whole command before the stage's name.
    fn show(&mut self, overall: Option<f64>) {
        let percent = overall.map(|done| (done * 100.0) as u32);
        if percent != self.percent || percent.is_none() && self.bar.message().is_empty() {
            let before = percent.map_or(String::new(), |percent| format!("{percent} %: "));
            self.bar.set_message(format!("{before}{}", self.name));
            self.percent = percent;
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Ok(mut state) = self.shared.state.lock() {
            self.shared.finish(&mut state);
            state.has_ended = true;
        }
        self.shared.ended.notify_all();
        if let Some(watch) = self.watch.take() {
            let _ = watch.join();
        }
    }
}

/// Bytes of the files in a folder, without those in folders within.
pub fn folder_bytes(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).filter(|metadata| metadata.is_file()).map(|m| m.len()).sum()
}

impl Progress for Terminal {
    fn begin(&self, stage: &'static str, total: u64) {
        let Ok(mut state) = self.shared.state.lock() else { return };
        // A stage may begin again once its amount of work is known.
        let has_no_amount = state.course.stage()[1] == 0;
        let since = state.current.take_if(|current| current.name == stage && has_no_amount);
        let start = since.map_or_else(Instant::now, |earlier| {
            earlier.bar.finish_and_clear();
            earlier.start
        });
        self.shared.finish(&mut state);
        state.course.begin(stage, total, self.shared.start.elapsed().as_secs_f64());
        let bar = if self.shared.drawn { ProgressBar::new(total) } else { ProgressBar::hidden() };
        let template = match total {
            0 => "{msg:<16} {elapsed}",
            _ => "{msg:<16} {bar:40} {percent:>3} %  {elapsed}  remaining {eta}",
        };
        if let Ok(style) = indicatif::ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        if self.shared.drawn {
            // The clock runs even while nothing else changes.
            bar.enable_steady_tick(Duration::from_secs(1));
        }
        let mut stage = Stage { bar, name: stage, start, percent: None };
        stage.show(state.course.overall());
        state.current = Some(stage);
        if self.shared.style == ProgressStyle::Json {
            self.shared.line(&mut state);
        }
    }

    fn advance(&self, amount: u64) {
        self.shared.step(amount, |course| course.advance(amount));
    }

    fn skip(&self, amount: u64) {
        self.shared.step(amount, |course| course.skip(amount));
    }

    fn note(&self, message: &str) {
        match self.shared.state.lock() {
            Ok(state) if self.shared.drawn && state.current.is_some() => {
                if let Some(stage) = &state.current {
                    stage.bar.suspend(|| messages::tell("note", message));
                }
            }
            _ => messages::tell("note", message),
        }
    }
}
