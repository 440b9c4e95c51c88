//! The program `lodpack`: maps results to exit codes.

mod args;
mod cmd;
mod interrupt;
mod output;
mod progress_bar;
mod talk;

use clap::{CommandFactory, FromArgMatches};
use std::ffi::OsString;
use std::process::ExitCode;

/// Exit status where a command could not run.
const COULD_NOT_RUN: u8 = 2;

fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    talk::choose(&words);
    let cli = match parse(&words) {
        Ok(cli) => cli,
        Err(error) if talk::is_json() && error.use_stderr() => {
            talk::tell("error", error.render().to_string().trim_start_matches("error: ").trim_end());
            return ExitCode::from(COULD_NOT_RUN);
        }
        Err(error) => error.exit(),
    };
    let result = match cli.command {
        args::Command::Build(args) => cmd::build::run(&args),
        args::Command::Plan(args) => cmd::plan::run(&args),
        args::Command::Add(args) => cmd::plan::run_add(&args),
        args::Command::Merge(args) => cmd::merge::run(&args),
        args::Command::Status(args) => cmd::status::run(&args),
        args::Command::Submit(args) => cmd::submit::run(&args),
        args::Command::Info(args) => cmd::info::run(&args),
        args::Command::Verify(args) => cmd::verify::run(&args),
        args::Command::Extract(args) => cmd::extract::run(&args),
        args::Command::Atlas(args) => cmd::atlas::run(&args),
        args::Command::Selftest(args) => cmd::selftest::run(&args),
        args::Command::Report(mut args) => cmd::report::run(&mut args),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            interrupt::wait_if_stopping();
            talk::tell("error", &talk::told(&error));
            ExitCode::from(COULD_NOT_RUN)
        }
    }
}

fn parse(words: &[OsString]) -> Result<args::Cli, clap::Error> {
    // A negative number after an option is a wrong value of it, and no other option.
    let takes_number = |arg: clap::Arg| match arg.get_action().takes_values() && !arg.is_positional() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    };
    let mut command = args::Cli::command().mut_subcommands(|command| command.mut_args(takes_number));
    let matches = command.try_get_matches_from_mut(words)?;
    args::Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
}
