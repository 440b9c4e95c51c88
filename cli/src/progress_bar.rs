//! Progress on the terminal: a bar per stage, plain lines elsewhere.

use indicatif::{ProgressBar, ProgressStyle};
use lodpack_cli::progress::Progress;
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::Instant;

/// Draws on stderr; finishes its last bar when dropped.
pub struct Terminal {
    state: Mutex<Option<(ProgressBar, &'static str, Instant)>>,
    drawn: bool,
}

impl Terminal {
    /// Bars where stderr is a terminal, lines otherwise.
    pub fn new() -> Self {
        Self { state: Mutex::new(None), drawn: std::io::stderr().is_terminal() }
    }

    fn finish(&self, state: &mut Option<(ProgressBar, &'static str, Instant)>) {
        if let Some((bar, stage, start)) = state.take() {
            bar.finish_and_clear();
            talk(format_args!("{stage:<10} {:>8.2} s", start.elapsed().as_secs_f64()));
        }
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        if let Ok(mut state) = self.state.lock() {
            self.finish(&mut state);
        }
    }
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
        if let Ok(style) = ProgressStyle::with_template("{msg:<10} {bar:40} {percent:>3} %  {elapsed}  remaining {eta}")
        {
            bar.set_style(style);
        }
        bar.set_message(stage);
        *state = Some((bar, stage, Instant::now()));
    }

    fn advance(&self, amount: u64) {
        if let Ok(state) = self.state.lock()
            && let Some((bar, ..)) = &*state
        {
            bar.inc(amount);
        }
    }

    fn note(&self, message: &str) {
        match self.state.lock() {
            Ok(state) if self.drawn && state.is_some() => {
                if let Some((bar, ..)) = &*state {
                    bar.suspend(|| talk(format_args!("note: {message}")));
                }
            }
            _ => talk(format_args!("note: {message}")),
        }
    }
}
