//! The program `lodpack`: maps results to exit codes.

mod args;
mod cmd;
mod interrupt;
mod messages;
mod output;
mod progress_bar;

use std::ffi::OsString;
use std::process::ExitCode;

/// Exit status of a command that could not run.
const COULD_NOT_RUN: u8 = 2;

fn main() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    messages::choose_style(&words);
    let cli = match args::parse(&words) {
        Ok(cli) => cli,
        Err(error) if messages::is_json() && error.use_stderr() => {
            messages::tell("error", error.render().to_string().trim_start_matches("error: ").trim_end());
            return ExitCode::from(COULD_NOT_RUN);
        }
        Err(error) => error.exit(),
    };
    let result = match cli.command {
        args::Command::Build(args) => cmd::build::run(&args),
        args::Command::View(args) => cmd::view::run(&args),
        args::Command::Serve(args) => cmd::serve::run(&args),
        args::Command::Plan(args) => cmd::plan::run(&args),
        args::Command::Add(args) => cmd::plan::run_add(&args),
        args::Command::Merge(args) => cmd::merge::run(&args),
        args::Command::Status(args) => cmd::status::run(&args),
        args::Command::Work(args) => cmd::work::run(&args),
        args::Command::Submit(args) => cmd::submit::run(&args),
        args::Command::Info(args) => cmd::info::run(&args),
        args::Command::Verify(args) => cmd::verify::run(&args),
        args::Command::Compare(args) => cmd::compare::run(&args),
        args::Command::Extract(args) => cmd::extract::run(&args),
        args::Command::Export(args) => cmd::export::run(&args),
        args::Command::Atlas(args) => cmd::atlas::run(&args),
        args::Command::Selftest(args) => cmd::selftest::run(&args),
        args::Command::Report(mut args) => cmd::report::run(&mut args),
        args::Command::Completions(args) => cmd::completions::run(&args),
        args::Command::Man(args) => cmd::man::run(&args),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            interrupt::wait_if_stopping();
            messages::tell("error", &messages::with_reasons(&error));
            ExitCode::from(COULD_NOT_RUN)
        }
    }
}
