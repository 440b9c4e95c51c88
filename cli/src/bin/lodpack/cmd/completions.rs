//! `lodpack completions`

use crate::args::{self, CompletionsArgs};
use crate::output::say;
use anyhow::Result;
use std::process::ExitCode;

/// Prints the script that makes a shell complete.
pub fn run(args: &CompletionsArgs) -> Result<ExitCode> {
    let mut script = vec![];
    clap_complete::generate(args.shell, &mut args::command(), "lodpack", &mut script);
    say!("{}", String::from_utf8_lossy(&script).trim_end());
    Ok(ExitCode::SUCCESS)
}
