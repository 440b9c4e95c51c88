//! Which files the inputs are that somebody typed: files, folders, and patterns that no shell has expanded.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::ImportError;
use super::walk::Walk;
use lodpack_runtime::progress::Progress;

/// Kinds of files that a folder may hold; the first kind that it has counts. Images beside meshes are their textures.
const KINDS: [&[&str]; 3] = [
    &["glb", "gltf", "obj", "off", "ply", "stl"],
    &["asc", "bil", "dem", "flt", "hgt", "png", "tif", "tiff"],
    &["lodpack"],
];

/// The files of inputs as they were typed. A folder stands for all meshes below it, in the order of their names; where
/// there are none, for all rasters; and where there are none of these either, for all lodpack files. A pattern like
/// `tiles/*.ply` or `city/**/*.obj` stands for all files that match it. Folders in which there is a file `marker` stay
/// what they are.
///
/// A note says what a folder or a pattern stands for.
///
/// # Errors
/// If a folder has no such files, or nothing matches a pattern. Files are not looked at.
pub fn find_inputs(typed: &[PathBuf], marker: &str, progress: &dyn Progress) -> Result<Vec<PathBuf>, ImportError> {
    let mut found = vec![];
    for path in typed {
        let files = if path.is_dir() && !path.join(marker).exists() {
            files_in(path, marker)?
        } else if !path.exists() && is_pattern(path) {
            matching(path)?
        } else {
            found.push(path.clone());
            continue;
        };
        progress.note(&format!("{}: {}", path.display(), counted(&files)));
        found.extend(files);
    }
    Ok(found)
}

fn is_pattern(path: &Path) -> bool {
    path.to_str().is_some_and(|text| text.contains(['*', '?', '[']))
}

fn matching(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let wrong = |problem: String| ImportError::Pattern { pattern: path.to_owned(), problem };
    let text = path.to_str().unwrap_or_default();
    let files = Walk::of(text).map_err(|error| wrong(error.msg.to_owned()))?.files()?;
    if files.is_empty() { Err(wrong("no file matches".into())) } else { Ok(files) }
}

fn files_in(folder: &Path, marker: &str) -> Result<Vec<PathBuf>, ImportError> {
    let mut by_kind = KINDS.map(|_| vec![]);
    for file in Walk::below(folder).files()? {
        if is_image_of_positions(&file) && file.parent().is_none_or(|folder| !folder.join(marker).exists()) {
            return Err(ImportError::AtlasWithoutManifest { path: file, manifest: marker.to_owned() });
        }
        let extension = extension_of(&file);
        if let Some(kind) = KINDS.iter().position(|kind| kind.contains(&extension.as_str())) {
            by_kind[kind].push(file);
        }
    }
    let files = by_kind.into_iter().find(|files| !files.is_empty());
    files.ok_or_else(|| ImportError::EmptyFolder { path: folder.to_owned() })
}

/// Whether a file has the name of an image of positions of an atlas. Of an atlas whose list is lost, only patches would
/// be read.
fn is_image_of_positions(file: &Path) -> bool {
    let number = file.file_name().and_then(|name| name.to_str()?.strip_prefix("root_")?.strip_suffix(".exr"));
    number.is_some_and(|number| !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit() || byte == b'_'))
}

fn extension_of(file: &Path) -> String {
    file.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// How many files there are of each extension.
fn counted(files: &[PathBuf]) -> String {
    let mut counts = BTreeMap::new();
    files.iter().for_each(|file| *counts.entry(extension_of(file)).or_insert(0) += 1);
    let parts: Vec<String> = counts
        .into_iter()
        .map(|(extension, count)| match (count, extension.as_str()) {
            (1, "") => "1 file".into(),
            (_, "") => format!("{count} files"),
            (1, _) => format!("1 .{extension} file"),
            _ => format!("{count} .{extension} files"),
        })
        .collect();
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_runtime::progress::Silent;
    use std::fs;

    fn found(typed: &[PathBuf]) -> Result<Vec<String>, ImportError> {
        let files = find_inputs(typed, "atlas.json", &Silent)?;
        Ok(files.iter().map(|file| file.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect())
    }

    #[test]
    fn folders_and_patterns_stand_for_their_files() {
        let dir = tempfile::tempdir().unwrap();
        // Letters of patterns in a folder's name are no pattern.
        let folder = dir.path().join("a [b]*");
        fs::create_dir_all(folder.join("x/y")).unwrap();
        for name in ["b.obj", "b.mtl", "b.png", "x/a.PLY", "x/y/c.glb", ".hidden.ply", "old.lodpack"] {
            fs::write(folder.join(name), "x").unwrap();
        }
        assert_eq!(found(std::slice::from_ref(&folder)).unwrap(), ["b.obj", "a.PLY", "c.glb"]);
        assert_eq!(found(&[folder.join("x")]).unwrap(), ["a.PLY", "c.glb"]);
        fs::create_dir(dir.path().join("tiles")).unwrap();
        let tiles = |name: &str| dir.path().join("tiles").join(name);
        let empty = found(&[tiles("")]);
        assert!(matches!(empty, Err(ImportError::EmptyFolder { .. })), "{empty:?}");
        ["n10.tif", "n11.TIF", "x.lodpack"].iter().for_each(|name| fs::write(tiles(name), "x").unwrap());
        assert_eq!(found(&[tiles("")]).unwrap(), ["n10.tif", "n11.TIF"]);
        assert_eq!(found(&[tiles("*.tif"), tiles("x.lodpack")]).unwrap(), ["n10.tif", "n11.TIF", "x.lodpack"]);
        assert_eq!(found(&[dir.path().join("**/n1?.tif")]).unwrap(), ["n10.tif", "n11.TIF"]);
        for wrong in ["*.ply", "a***b"] {
            let error = found(&[tiles(wrong)]).unwrap_err();
            assert!(matches!(error, ImportError::Pattern { .. }), "{error}");
        }
        // What is no pattern and does not exist is for the import to refuse, and an atlas is one input.
        assert_eq!(found(&[tiles("none.ply")]).unwrap(), ["none.ply"]);
        fs::write(tiles("root_00007_6.exr"), "x").unwrap();
        let lost = found(&[tiles("")]);
        assert!(matches!(lost, Err(ImportError::AtlasWithoutManifest { .. })), "{lost:?}");
        fs::write(tiles("atlas.json"), "{}").unwrap();
        assert_eq!(found(&[dir.path().join("tiles")]).unwrap(), ["tiles"]);
    }

    #[test]
    #[cfg(unix)]
    fn names_that_are_not_unicode_match_like_others() {
        use std::os::unix::ffi::OsStrExt;
        let dir = tempfile::tempdir().unwrap();
        let odd = dir.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9"));
        fs::create_dir(&odd).unwrap();
        for name in [&b"a.obj"[..], b"\xff.obj", b"\xff.txt", b".\xff.obj"] {
            fs::write(dir.path().join(std::ffi::OsStr::from_bytes(name)), "x").unwrap();
        }
        fs::write(odd.join("b.obj"), "x").unwrap();
        let odd_name = "\u{fffd}.obj";
        assert_eq!(found(&[dir.path().join("*.obj")]).unwrap(), ["a.obj", odd_name]);
        assert_eq!(found(&[dir.path().to_owned()]).unwrap(), ["a.obj", "b.obj", odd_name]);
        assert_eq!(found(&[dir.path().join("**/*.obj")]).unwrap(), ["a.obj", "b.obj", odd_name]);
        assert_eq!(found(&[odd]).unwrap(), ["b.obj"]);
    }

    #[test]
    fn patterns_of_folders_match_as_a_shell_would() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(dir.path().join("a/b/c")).unwrap();
        fs::create_dir_all(dir.path().join("B/.hidden")).unwrap();
        for name in ["x.ply", "a/x.ply", "a/b/x.ply", "a/b/c/y.ply", "B/z.PLY", "B/.hidden/x.ply"] {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        let found = |pattern: &str| {
            let files = find_inputs(&[dir.path().join(pattern)], "atlas.json", &Silent)?;
            let name = |file: &PathBuf| file.strip_prefix(dir.path()).unwrap().to_str().unwrap().replace('\\', "/");
            Ok::<_, ImportError>(files.iter().map(name).collect::<Vec<_>>())
        };
        assert_eq!(found("**/*.ply").unwrap(), ["B/z.PLY", "a/b/c/y.ply", "a/b/x.ply", "a/x.ply", "x.ply"]);
        assert_eq!(found("*/*.ply").unwrap(), ["B/z.PLY", "a/x.ply"]);
        assert_eq!(found("**/b/**/*.ply").unwrap(), ["B/z.PLY", "a/b/c/y.ply", "a/b/x.ply"]);
        assert_eq!(found("a/../a/./?.ply").unwrap(), ["a/../a/x.ply"]);
        assert_eq!(found("B/.hidden/*").unwrap(), ["B/.hidden/x.ply"]);
        for none in ["*/", "**", "x.ply/*", "B/.h*/x.ply", "no/*"] {
            assert!(matches!(found(none), Err(ImportError::Pattern { .. })), "{none}");
        }
    }
}
