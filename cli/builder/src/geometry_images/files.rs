//! The names of an atlas's files.

use std::path::{Path, PathBuf};

use super::MANIFEST_NAME;

/// The start of the names of folders with coarser images.
pub(super) const MIP_NAME: &str = "mip_";

/// The files in a directory that are named as [`super::write_atlas`] names them, `atlas.json` first: an atlas that is
/// removed in this order is never mistaken for a complete one. Those in its folders of coarser images follow.
///
/// # Errors
/// If the directory cannot be read.
pub fn atlas_files(dir: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = files_in(dir)?;
    for folder in mip_folders(dir)? {
        files.extend(files_in(&folder)?);
    }
    Ok(files)
}

/// The folders of coarser images in the directory of an atlas.
///
/// # Errors
/// If the directory cannot be read.
pub fn mip_folders(dir: &Path) -> std::io::Result<Vec<PathBuf>> {
    entries(dir, |name, kind| kind.is_dir() && name.strip_prefix(MIP_NAME).is_some_and(is_number))
}

fn files_in(dir: &Path) -> std::io::Result<Vec<PathBuf>> {
    entries(dir, |name, kind| kind.is_file() && is_atlas_name(name))
}

fn entries(dir: &Path, is_wanted: impl Fn(&str, std::fs::FileType) -> bool) -> std::io::Result<Vec<PathBuf>> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        if is_wanted(&entry.file_name().to_string_lossy(), entry.file_type()?) {
            paths.push(entry.path());
        }
    }
    paths.sort();
    Ok(paths)
}

fn is_number(text: &str) -> bool {
    text.bytes().all(|b| b.is_ascii_digit()) && !text.is_empty()
}

/// Whether a name is one like `atlas.json`, `root_00012_3.exr`, `root_00012_3_colour.png` or `patch_00004.ply`.
fn is_atlas_name(name: &str) -> bool {
    let root = |name: &str| {
        let (stem, extension) = name.strip_prefix("root_")?.split_once('.')?;
        let mut parts = stem.splitn(3, '_');
        let numbers = [parts.next()?, parts.next()?].into_iter().all(is_number);
        let is_image = match parts.next() {
            None => extension == "exr",
            Some(channel) => ["png", "exr"].contains(&extension) && channel.bytes().all(|b| b.is_ascii_alphanumeric()),
        };
        Some(numbers && is_image)
    };
    let patch = |name: &str| {
        let (stem, extension) = name.strip_prefix("patch_")?.split_once('.')?;
        let (number, channel) = stem.split_once('_').map_or((stem, None), |(number, channel)| (number, Some(channel)));
        let is_file = match channel {
            None => extension == "ply",
            Some(channel) => extension == "png" && channel.bytes().all(|b| b.is_ascii_alphanumeric()),
        };
        Some(is_number(number) && is_file)
    };
    name == MANIFEST_NAME || [root(name), patch(name)].contains(&Some(true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_atlas_files_are_taken_for_such() {
        assert!(
            [
                "atlas.json",
                "root_00012_3.exr",
                "root_123456_31.exr",
                "root_00012_3_colour.png",
                "root_00012_3_number0.exr",
                "patch_00000.ply",
                "patch_00000_colour.png"
            ]
            .iter()
            .all(|n| is_atlas_name(n))
        );
        assert!(
            ![
                "root_3.exr",
                "root_a_1.exr",
                "root_1_1.png",
                "root_1_1_my_notes.png",
                "patch_.ply",
                "patch_1.obj",
                "atlas.json.tmp"
            ]
            .iter()
            .any(|n| is_atlas_name(n))
        );
    }
}
