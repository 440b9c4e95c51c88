//! Libraries of materials: which of them an OBJ file names, and their text.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::Statements;
use super::mtl::LibraryReader;
use crate::import::attributes::AttributeSink;
use crate::import::beside::Beside;
use crate::import::source::{Source, size_of_file};
use crate::import::usable_image::NamedImages;
use crate::mesh::appearance::Channels;

/// The largest library of materials that is read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// The libraries that a statement names: one name with spaces, or several names.
pub(super) fn libraries(names: &[u8], source: &Source) -> Vec<PathBuf> {
    let beside = Beside::new(source);
    if let Some(one) = beside.existing(names) {
        return vec![one];
    }
    let words = || names.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let there = |name| beside.existing(name).or_else(|| beside.of_same_name(name));
    if !words().all(|name| there(name).is_some())
        && let Some(one) = beside.of_same_name(names)
    {
        return vec![one];
    }
    words().filter_map(|name| beside.find("library of materials", name)).collect()
}

/// The libraries that statements name from an offset on.
pub(super) fn libraries_from(source: &Source, at: usize) -> Vec<PathBuf> {
    let mut statements = Statements::new(*source);
    statements.at = statements.at.max(at);
    let mut found = vec![];
    while let Some((_, mut words)) = statements.next() {
        if words.word() == b"mtllib" {
            found.extend(libraries(&words.bytes[words.at..], source));
        }
    }
    found
}

/// The text of a library.
pub(super) fn read_library(path: &Path) -> io::Result<Vec<u8>> {
    match size_of_file(path)? {
        bytes if bytes > MAX_LIBRARY_BYTES => {
            Err(io::Error::other(format!("it has {bytes} bytes, more than {MAX_LIBRARY_BYTES}")))
        }
        _ => fs::read(path),
    }
}

/// The libraries of materials that a file names, and their images.
pub(in crate::import) fn files_beside(source: &Source) -> Vec<PathBuf> {
    let mut known = HashSet::new();
    let mut files = libraries_from(source, 0);
    files.retain(|library| known.insert(library.clone()));
    let (mut images, mut sink) = (NamedImages::default(), AttributeSink::new(&Channels::Auto));
    for library in &files {
        let beside = Beside::library(source, library);
        // Nothing has to be decoded to know which images there are.
        let mut reader = LibraryReader { source, images: &mut images, sink: &mut sink, beside, memory: 0 };
        reader.read(&read_library(library).unwrap_or_default());
    }
    files.extend(images.into_paths());
    files
}
