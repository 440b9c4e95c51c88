//! The commands, one file each.

pub mod atlas;
pub mod build;
pub mod compare;
pub mod completions;
pub mod export;
pub mod extract;
mod ground;
mod heights;
mod images;
pub mod info;
mod inputs;
mod levels;
pub mod man;
pub mod merge;
mod objects;
mod open;
pub mod plan;
pub mod report;
pub mod selftest;
pub mod serve;
mod slow_server;
mod state;
pub mod status;
pub mod submit;
mod summary;
pub mod verify;
pub mod view;
mod why;
pub mod work;
mod workers;

use crate::output::say;
use anyhow::{Context, Result};

/// Sets the number of threads that all parallel stages share.
fn use_threads(threads: usize) -> Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start worker threads")
}

/// Prints a value as JSON.
fn print_json(value: &impl serde::Serialize) -> Result<()> {
    say!("{}", serde_json::to_string_pretty(value)?);
    Ok(())
}
