//! The inputs that were typed, as files.

use crate::args::ModelArgs;
use crate::messages;
use anyhow::{Result, bail};
use lodpack_cli::geometry_images::MANIFEST_NAME;
use lodpack_cli::import;
use lodpack_cli::import::raster::{RasterForm, is_raster};
use lodpack_cli::progress::Progress;
use std::path::PathBuf;

/// The files that inputs stand for; atlases stay directories.
pub fn find_inputs(typed: &[PathBuf]) -> Result<Vec<PathBuf>> {
    Ok(import::find_inputs(typed, MANIFEST_NAME, &Notes)?)
}

/// Whether inputs become a file of heights. `others` are options of the command that only meshes have, and whether they
/// were typed.
pub fn become_heights(inputs: &[PathBuf], model: &ModelArgs, others: &[(bool, &'static str)]) -> Result<bool> {
    let of_meshes = others.iter().find_map(|&(is_typed, name)| is_typed.then_some(name));
    match (model.form(), of_meshes.or_else(|| model.of_meshes_alone())) {
        (RasterForm::Mesh, _) => Ok(false),
        (RasterForm::Heights, Some(option)) => bail!("{option} is for meshes: omit it, or take --as mesh"),
        (RasterForm::Heights, None) => Ok(true),
        (RasterForm::Auto, option) => {
            // Rasters beside meshes are refused where meshes are read.
            let are_rasters = !inputs.is_empty() && inputs.iter().all(|path| is_raster(path));
            if let (true, Some(option)) = (are_rasters, option) {
                let what = "is for meshes, so the raster becomes triangles; without it, its grid would stay";
                messages::tell("note", &format!("{option} {what}"));
            }
            Ok(are_rasters && option.is_none())
        }
    }
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
