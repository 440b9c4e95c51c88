//! The window.
use anyhow::Result;
use crate::args::Args;
/// Opens it.
pub fn run(_args: &Args) -> Result<()> { Ok(()) }
