//! `lodpack atlas`

use crate::args::AtlasArgs;
use anyhow::{Result, bail};
use std::process::ExitCode;

/// Writes geometry images.
pub fn run(args: &AtlasArgs) -> Result<ExitCode> {
    bail!("{}: not available yet", args.output.display());
}
