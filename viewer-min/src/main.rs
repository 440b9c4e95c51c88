//! `lodpack-view`: 0 where all went well, 1 where a check found something wrong, 2 where something could not be done.

use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use lodpack_view::{args::Args, check, headless, window};

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            eprintln!("lodpack-view: {error:#}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> Result<bool> {
    if args.check {
        let file = args.file.as_deref().context("--check needs a file")?;
        let outcome = check::check_file(file, args.against.as_deref(), &check::Options::from(args))?;
        outcome.lines.iter().for_each(|line| println!("{line}"));
        return Ok(outcome.is_right());
    }
    if let Some(counts) = args.tiles.filter(|&counts| counts != [1, 1]) {
        headless::draw_tiles(args, counts)
    } else if args.screenshot.is_some() || args.csv.is_some() {
        headless::draw(args).map(|()| true)
    } else {
        window::run(args).map(|()| true)
    }
}
