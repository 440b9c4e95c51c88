//! Finds the files below a folder whose names match patterns.
//!
//! The `glob` crate matches names, but its own walk panics at names that are not Unicode, which any folder may hold.

use std::fs;
use std::path::{Component, Path, PathBuf, is_separator};

use glob::{MatchOptions, Pattern, PatternError};

use super::ImportError;

/// Hidden files are no inputs, and names have no case.
const MATCHING: MatchOptions =
    MatchOptions { case_sensitive: false, require_literal_separator: true, require_literal_leading_dot: true };

/// A pattern like `city/**/*.obj`, part by part.
pub(super) struct Walk {
    /// Where it begins; empty for the current folder.
    start: PathBuf,
    parts: Vec<Part>,
}

/// What a name in a folder has to be.
enum Part {
    /// This name, which the file system looks up.
    Name(PathBuf),
    /// A name that matches.
    Matching(Pattern),
    /// Any name.
    Any,
    /// Any folder, and any below it; or none.
    Folders,
}

impl Walk {
    /// All files below a folder.
    pub fn below(folder: &Path) -> Self {
        let start = folder.components().filter(|part| *part != Component::CurDir).collect();
        Self { start, parts: vec![Part::Folders, Part::Any] }
    }

    /// The files that match a pattern.
    ///
    /// # Errors
    /// If it is none.
    pub fn of(pattern: &str) -> Result<Self, PatternError> {
        Pattern::new(pattern)?;
        let (mut start, mut parts) = (PathBuf::new(), vec![]);
        for component in Path::new(pattern).components() {
            match component {
                Component::CurDir => {}
                Component::Prefix(_) | Component::RootDir => start.push(component),
                // Two such parts mean what one of them does.
                Component::Normal(name) if name == "**" => {
                    parts.pop_if(|last| matches!(last, Part::Folders));
                    parts.push(Part::Folders);
                }
                Component::ParentDir | Component::Normal(_) => parts.push(Part::new(component.as_ref())?),
            }
        }
        // With a separator at its end it asks for folders, which are no files.
        if pattern.ends_with(is_separator) {
            parts.push(Part::Folders);
        }
        Ok(Self { start, parts })
    }

    /// The files, those of each folder in the order of their names.
    ///
    /// # Errors
    /// If a folder cannot be read.
    pub fn files(&self) -> Result<Vec<PathBuf>, ImportError> {
        let mut found = vec![];
        enter(&self.start, &self.parts, &mut found)?;
        Ok(found)
    }
}

impl Part {
    fn new(name: &Path) -> Result<Self, PatternError> {
        match name.to_str() {
            Some(text) if text.contains(['*', '?', '[']) => Ok(Self::Matching(Pattern::new(text)?)),
            _ => Ok(Self::Name(name.to_owned())),
        }
    }

    fn matches(&self, name: &str) -> bool {
        match self {
            Self::Name(own) => own.to_str().is_some_and(|own| own.to_lowercase() == name.to_lowercase()),
            Self::Matching(pattern) => pattern.matches_with(name, MATCHING),
            Self::Any | Self::Folders => true,
        }
    }
}

/// Adds the files in a folder that match all parts.
fn enter(folder: &Path, parts: &[Part], found: &mut Vec<PathBuf>) -> Result<(), ImportError> {
    match parts {
        // Folders alone are no files.
        [] | [Part::Folders] => Ok(()),
        [Part::Name(name), rest @ ..] => visit(folder.join(name), rest, found),
        [Part::Folders, rest @ ..] => {
            for (name, path) in entries(folder)? {
                if rest.first().is_some_and(|part| part.matches(&name)) {
                    visit(path.clone(), &rest[1..], found)?;
                }
                if path.is_dir() {
                    enter(&path, parts, found)?;
                }
            }
            Ok(())
        }
        [part, rest @ ..] => {
            let entries = entries(folder)?.into_iter().filter(|(name, _)| part.matches(name));
            entries.map(|(_, path)| path).try_for_each(|path| visit(path, rest, found))
        }
    }
}

/// Adds a file that has matched, or what is in a folder that has.
fn visit(path: PathBuf, rest: &[Part], found: &mut Vec<PathBuf>) -> Result<(), ImportError> {
    if rest.is_empty() {
        if path.is_file() {
            found.push(path);
        }
        return Ok(());
    }
    if path.is_dir() { enter(&path, rest, found) } else { Ok(()) }
}

/// What is in a folder and not hidden, by name. Letters of names that are not Unicode are replaced in what is matched.
fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>, ImportError> {
    let io = |source| ImportError::Io { path: folder.to_owned(), source };
    // The current folder has no name here, so that its files have none before theirs.
    let listed = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut names = vec![];
    for entry in fs::read_dir(listed).map_err(io)? {
        names.push(entry.map_err(io)?.file_name());
    }
    names.sort();
    let named = names.into_iter().map(|name| (name.to_string_lossy().into_owned(), folder.join(name)));
    Ok(named.filter(|(name, _)| !name.starts_with('.')).collect())
}
