//! One file a command.

pub mod atlas;
pub mod build;
pub mod extract;
pub mod info;
pub mod verify;

use crate::output::say;
use anyhow::{Context, Result, bail};
use std::path::Path;

/// Sizes the pool that all parallel stages use.
fn use_threads(threads: usize) -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start worker threads")
}

/// Opens a lodpack file for reading.
fn open(path: &Path) -> Result<lodpack::File<lodpack::Counting<std::fs::File>>> {
    if path.is_dir() {
        bail!("{} is a directory; name a .lodpack file", path.display());
    }
    let file = std::fs::File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    lodpack::File::open(lodpack::Counting::new(file), lodpack::Limits::default())
        .with_context(|| path.display().to_string())
}

/// Prints a value as JSON on stdout.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    say!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}
