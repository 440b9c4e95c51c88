//! The names of an atlas's files.

use std::path::{Path, PathBuf};

use super::MANIFEST_NAME;

/// The files in a directory that are named as [`super::write_atlas`] names them, `atlas.json` first: an atlas that is removed in this
/// order is never mistaken for a complete one.
///
/// # Errors
/// If the directory cannot be read.
pub fn atlas_files(dir: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        if is_atlas_name(&entry.file_name().to_string_lossy()) && entry.file_type()?.is_file() {
            files.push(entry.path());
        }
    }
    files.sort();
    Ok(files)
}

/// Whether a name is one like `atlas.json`, `root_00012_3.exr` or `patch_00004.ply`.
fn is_atlas_name(name: &str) -> bool {
    let number = |text: &str| text.bytes().all(|b| b.is_ascii_digit()) && !text.is_empty();
    let root = |name: &str| {
        let (chart, corner) = name.strip_prefix("root_")?.strip_suffix(".exr")?.split_once('_')?;
        Some(number(chart) && number(corner))
    };
    let patch = |name: &str| Some(number(name.strip_prefix("patch_")?.strip_suffix(".ply")?));
    name == MANIFEST_NAME || root(name) == Some(true) || patch(name) == Some(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_atlas_files_are_taken_for_such() {
        assert!(
            ["atlas.json", "root_00012_3.exr", "root_123456_31.exr", "patch_00000.ply"]
                .iter()
                .all(|n| is_atlas_name(n))
        );
        assert!(
            !["root_3.exr", "root_a_1.exr", "patch_.ply", "patch_1.obj", "atlas.json.tmp"]
                .iter()
                .any(|n| is_atlas_name(n))
        );
    }
}
