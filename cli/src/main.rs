//! The program `lodpack`: maps results to exit codes.

mod args;
mod cmd;
mod interrupt;
mod output;
mod progress_bar;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = args::Cli::parse();
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
        args::Command::Report(args) => cmd::report::run(&args),
    };
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}
