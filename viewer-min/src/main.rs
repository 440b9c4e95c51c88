//! `lodpack-view`: exits with 0 on success, 1 if a check found errors, 2 if the request could not be carried out.

use std::process::ExitCode;

use clap::Parser;
use lodpack_view::{args::Args, check::check_file, control_wall, draw_picture, draw_tiles, join_wall, show_window};

fn main() -> ExitCode {
    let args = Args::parse();
    let is_right = if args.check {
        check_file(&args)
    } else if let Some(counts) = args.tiles.filter(|&counts| counts != [1, 1]) {
        draw_tiles(&args, counts)
    } else if let (Some(counts), Some(address), Some(_)) = (args.wall, &args.listen, &args.path) {
        control_wall(&args, counts, address).map(|()| true)
    } else if let (Some(address), Some(_)) = (&args.join, &args.screenshot) {
        join_wall(&args, address).map(|()| true)
    } else if args.screenshot.is_some() || args.csv.is_some() {
        draw_picture(&args).map(|()| true)
    } else {
        show_window(&args).map(|()| true)
    };
    match is_right {
        Ok(is_right) => ExitCode::from(u8::from(!is_right)),
        Err(error) => {
            eprintln!("lodpack-view: {}", told(&error));
            ExitCode::from(2)
        }
    }
}

/// An error with all its causes, each shown once: some errors already include their cause.
fn told(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for reason in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&reason) {
            text += &format!(": {reason}");
        }
    }
    text
}
