//! Where inputs are opened: mesh files, rasters, or one atlas directory.

use std::path::PathBuf;

use super::BuildError;
use crate::geometry_images::import_atlas;
use crate::pipeline::{ModelOptions, PipelineError};
use lodpack_import::{ImportOptions, Imported, Room, import_large_meshes, is_gltf};
use lodpack_mesh::tolerance::Unit;
use lodpack_runtime::progress::Progress;

/// Reads meshes or rasters, or the one atlas directory that is named.
///
/// # Errors
/// [`BuildError`], which names the file.
pub(super) fn read_input(
    inputs: &[PathBuf],
    room: &Room,
    model: &ModelOptions,
    progress: &dyn Progress,
) -> Result<Imported, BuildError> {
    let (channels, raster) = (model.channels.clone(), model.raster.clone());
    let options = ImportOptions { channels, raster, new_charts: model.new_charts, objects: model.kept_objects() };
    match inputs {
        [dir] if dir.is_dir() => Ok(import_atlas(dir, room, &options, progress)?),
        _ => Ok(import_large_meshes(inputs, room, &options, progress)?),
    }
}

/// The unit of inputs whose format fixes it: glTF is in metres. None if there are no inputs.
pub(super) fn unit_of_inputs(inputs: &[PathBuf]) -> Result<Option<Unit>, BuildError> {
    let mut others = vec![];
    for input in inputs {
        // Atlases have no unit.
        if input.is_dir() || !is_gltf(input)? {
            others.push(input);
        }
    }
    match others.first() {
        None if inputs.is_empty() => Ok(None),
        None => Ok(Some(Unit { metres: 1.0 })),
        Some(_) if others.len() == inputs.len() => Err(PipelineError::unit_missing().into()),
        Some(other) => {
            let what = format!(
                "the tolerance has a unit, and glTF is in metres, but {} does not say what it is in; pass --unit m if it is in metres \
                 too, or give the tolerance without a unit",
                other.display()
            );
            Err(PipelineError::Tolerance { what }.into())
        }
    }
}
