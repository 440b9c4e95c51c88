//! The files that inputs name beside themselves.

use std::fs;
use std::io::Cursor;
use std::path::{Component, Path, PathBuf};

use xxhash_rust::xxh3::xxh3_64;

use super::ImportError;
use super::source::Source;
use crate::mesh::appearance::{Appearance, ImageSource, MAX_IMAGE_TEXELS, image_size};
use crate::progress::Progress;
use crate::storage::{WorkDirectory, WorkError};

/// The path of a file that an input names, which lies in the input's folder or below; otherwise none, with a note.
pub(super) fn file_beside(source: &Source, name: &str) -> Option<PathBuf> {
    let name = name.trim();
    let folder = source.path.parent().map_or_else(PathBuf::new, ToOwned::to_owned);
    // Files come from all systems.
    let portable = name.replace('\\', "/");
    let named = if folder.join(name).is_file() { name } else { portable.as_str() };
    let path = Path::new(named);
    if !leaves_folder(path) {
        return Some(folder.join(path));
    }
    // Exporters write the path that the image had on their machine. The content of a file must not cause files elsewhere to be read,
    // but one of the same name here is what is meant.
    let beside = portable.rsplit('/').next().map(|last| folder.join(last)).filter(|beside| beside.is_file());
    if beside.is_none() {
        source.note(&format!("the image {name} is not in the folder of the file: put it there; it was left out"));
    }
    beside
}

/// Whether a path leads out of the folder in which it begins: the content of a file must not cause other files to be
/// read.
pub(super) fn leaves_folder(path: &Path) -> bool {
    let mut depth = 0;
    path.components().any(|component| {
        match component {
            Component::Normal(_) => depth += 1,
            Component::ParentDir => depth -= 1,
            Component::CurDir => {}
            Component::RootDir | Component::Prefix(_) => return true,
        }
        depth < 0
    })
}

/// Looks at all images that materials use. One that cannot be read is noted, and its materials keep their factor alone; the image that is
/// too large is an error.
pub(super) fn check_images(appearance: &mut Appearance, progress: &dyn Progress) -> Result<(), ImportError> {
    appearance.texels = 0;
    for number in 0..appearance.images.len() {
        let image = &appearance.images[number];
        let name = image.name();
        match image.open(None).map_err(|error| error.to_string()).and_then(image_size) {
            Ok([width, height]) => {
                let texels = u64::from(width) * u64::from(height);
                if texels > MAX_IMAGE_TEXELS {
                    return Err(ImportError::Image { name, width, height, limit: MAX_IMAGE_TEXELS });
                }
                appearance.texels += texels;
            }
            Err(problem) => {
                progress.note(&format!("the image {name} cannot be used: {problem}; its material has no texture"));
                appearance.materials.iter_mut().for_each(|material| {
                    material.base_texture.take_if(|texture| texture.image as usize == number);
                });
            }
        }
    }
    Ok(())
}

/// Copies all images that can be used to a work directory, so that the rest of the build needs nothing else.
pub(super) fn keep_images(appearance: &mut Appearance, directory: &WorkDirectory) -> Result<(), WorkError> {
    for (number, image) in appearance.images.iter_mut().enumerate() {
        let kept = match image.read(None) {
            Ok(bytes) if image_size(Cursor::new(&bytes)).is_ok() => keep(directory, number, image.name(), &bytes)?,
            _ => continue,
        };
        *image = kept;
    }
    Ok(())
}

fn keep(directory: &WorkDirectory, number: usize, name: String, bytes: &[u8]) -> Result<ImageSource, WorkError> {
    let file = format!("image-{number}");
    let path = directory.path(&file);
    fs::write(&path, bytes).map_err(|source| WorkError::new(&path, "written", source))?;
    directory.count(bytes.len() as u64);
    Ok(ImageSource::Kept { file, name, bytes: bytes.len() as u64, xxh3: xxh3_64(bytes) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_lie_in_the_folder_of_their_document_or_below() {
        for inside in ["a.bin", "./a.bin", "b/a.bin", "b/../a.bin"] {
            assert!(!leaves_folder(Path::new(inside)), "{inside}");
        }
        for outside in ["../a.bin", "b/../../a.bin", "/etc/passwd", "./../a.bin"] {
            assert!(leaves_folder(Path::new(outside)), "{outside}");
        }
    }
}
