//! Files beside a raster that belong to it by their names, in small letters or in capitals.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::beside::folders::Folders;

/// The file of the same name with another extension.
pub(super) fn with_extension(path: &Path, extension: &str) -> Option<PathBuf> {
    spellings(extension).map(|extension| path.with_extension(extension)).into_iter().find(|path| path.is_file())
}

/// The file whose name has one more extension.
pub(super) fn with_suffix(path: &Path, extension: &str) -> Option<PathBuf> {
    let longer = spellings(extension).map(|extension| {
        let mut name = OsString::from(path);
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    });
    longer.into_iter().find(|path| path.is_file())
}

/// How systems write an extension.
fn spellings(extension: &str) -> [String; 3] {
    let (first, rest) = extension.split_at(extension.chars().next().map_or(0, char::len_utf8));
    [extension.to_owned(), extension.to_ascii_uppercase(), format!("{}{rest}", first.to_ascii_uppercase())]
}

/// The file with an extension whose name is the same but for capitals. All names of the folder are looked at: it is for
/// a file without which there is no raster.
pub(super) fn with_extension_in_any_case(path: &Path, extension: &str) -> Option<PathBuf> {
    with_extension(path, extension).or_else(|| {
        let wanted = path.with_extension(extension);
        Folders::default().in_any_letters(path.parent().unwrap_or(Path::new("")), Path::new(wanted.file_name()?))
    })
}
