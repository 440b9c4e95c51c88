//! `lodpack merge`

use super::print_json;
use super::summary::print;
use super::work::{folder_beside, naming};
use crate::args::MergeArgs;
use crate::interrupt;
use crate::output::PendingFile;
use crate::progress_bar::Terminal;
use anyhow::{Context, Result};
use lodpack_cli::job::{Parts, merge};
use lodpack_cli::progress::Progress;
use std::io::BufWriter;
use std::path::Path;
use std::process::ExitCode;

/// Checks parts, joins them and reports what came out.
pub fn run(args: &MergeArgs) -> Result<ExitCode> {
    let output = &args.output;
    interrupt::on_stop(Path::new(""), "");
    let summary = {
        let progress = Terminal::new(args.progress, None);
        let parts = Parts::check(&args.parts, &progress)?;
        for input in &parts.changed_inputs {
            let input = input.display();
            progress.note(&format!("{input} has changed since the job was planned; the file shows it as it was then"));
        }
        let scratch = folder_beside(output);
        let (pending, file) = PendingFile::create(output, args.force, args.parts.iter().map(|p| p.as_path()))?;
        let mut out = BufWriter::new(file);
        let summary = merge(&parts, &scratch, &mut out, &progress).map_err(|error| naming(error, output))?;
        let written = out.into_inner().map_err(|error| error.into_error());
        pending.finish(written.with_context(|| format!("cannot write {}", output.display()))?)?;
        summary
    };
    if args.json {
        print_json(&summary)?
    } else {
        print(&summary, output)?
    }
    Ok(ExitCode::SUCCESS)
}
