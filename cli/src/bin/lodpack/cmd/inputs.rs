//! The inputs that were typed, as files.

use crate::messages;
use anyhow::Result;
use lodpack_cli::geometry_images::MANIFEST_NAME;
use lodpack_cli::import;
use lodpack_cli::progress::Progress;
use std::path::PathBuf;

/// The files that inputs stand for; atlases stay directories.
pub fn find_inputs(typed: &[PathBuf]) -> Result<Vec<PathBuf>> {
    Ok(import::find_inputs(typed, MANIFEST_NAME, &Notes)?)
}

/// Shows notes alone.
pub struct Notes;

impl Progress for Notes {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, text: &str) {
        messages::tell("note", text);
    }
}
