//! Libraries of materials: which of them an OBJ file names, and their text.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::Statements;
use super::mtl::LibraryReader;
use crate::attributes::AttributeSink;
use crate::beside::{Beside, without_remark};
use crate::source::{Source, size_of_file};
use crate::usable_image::NamedImages;
use lodpack_mesh::appearance::Channels;

/// The largest library of materials that is read.
const MAX_LIBRARY_BYTES: u64 = 64 << 20;

/// The libraries that a statement names: one name with spaces, or several names.
pub(super) fn libraries(names: &[u8], source: &Source) -> Vec<PathBuf> {
    let beside = Beside::new(source);
    if let Some(one) = beside.existing(names) {
        return vec![one];
    }
    let bare = without_remark(names);
    let words: Vec<&[u8]> = bare.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
    let there = words.iter().filter(|name| beside.is_there(name)).count();
    if there < words.len()
        && let Some(one) = beside.of_same_name(names)
    {
        return vec![one];
    }
    let names = if there > 0 { words } else { names_by_ending(bare) };
    names.into_iter().filter_map(|name| beside.find("library of materials", name)).collect()
}

/// Names that may contain spaces, each with the ending of libraries; all of it is one name where none has it.
fn names_by_ending(text: &[u8]) -> Vec<&[u8]> {
    let (mut names, mut rest) = (vec![], text);
    while !rest.is_empty() {
        let is_end = |at: &usize| {
            let has_ending = rest[..*at].len() >= 4 && rest[at - 4..*at].eq_ignore_ascii_case(b".mtl");
            has_ending && rest.get(*at).is_none_or(u8::is_ascii_whitespace)
        };
        let (name, others) = rest.split_at((1..=rest.len()).find(is_end).unwrap_or(rest.len()));
        names.push(name);
        rest = others.trim_ascii_start();
    }
    names
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
pub fn files_beside(source: &Source) -> Vec<PathBuf> {
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
