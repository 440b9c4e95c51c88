//! The names in folders, for files that are called almost as they are named.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

/// The names of a folder by their small letters; of several that differ in nothing else, the first.
type Names = BTreeMap<String, OsString>;

/// Folders that have been looked through, each once.
#[derive(Default)]
pub struct Folders(RefCell<BTreeMap<PathBuf, Rc<Names>>>);

impl Folders {
    /// The file at a path within a folder, whose names may be in other letters, large or small.
    pub fn in_any_letters(&self, home: &Path, path: &Path) -> Option<PathBuf> {
        let mut found = home.to_owned();
        for component in path.components() {
            found = match component {
                Component::Normal(name) if !found.join(name).exists() => {
                    found.join(self.names(&found).get(&small(&name.to_string_lossy()))?)
                }
                component => found.join(component),
            };
        }
        found.is_file().then_some(found)
    }

    /// The files in whose names a number of four digits stands where this path has a zero byte, in the order of their
    /// numbers.
    pub fn numbered(&self, path: &Path) -> Vec<(u32, PathBuf)> {
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else { return vec![] };
        let name = small(&name.to_string_lossy());
        let Some((before, after)) = name.split_once('\0') else { return vec![] };
        let names = self.names(folder);
        let begin = names.range(before.to_owned()..).take_while(|(name, _)| name.starts_with(before));
        let numbered = begin.filter_map(|(name, file)| {
            let digits = name.strip_prefix(before)?.strip_suffix(after)?;
            let is_number = digits.len() == 4 && digits.bytes().all(|digit| digit.is_ascii_digit());
            Some((digits.parse().ok().filter(|_| is_number)?, folder.join(file)))
        });
        numbered.filter(|(_, file)| file.is_file()).collect()
    }

    fn names(&self, folder: &Path) -> Rc<Names> {
        let mut folders = self.0.borrow_mut();
        folders.entry(folder.to_owned()).or_insert_with(|| Rc::new(read(folder))).clone()
    }
}

/// The names in a folder; none if it cannot be read.
fn read(folder: &Path) -> Names {
    // The folder of a path without one.
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut all: Vec<OsString> =
        fs::read_dir(folder).into_iter().flatten().flatten().map(|file| file.file_name()).collect();
    all.sort();
    let mut names = Names::new();
    for name in all {
        names.entry(small(&name.to_string_lossy())).or_insert(name);
    }
    names
}

fn small(name: &str) -> String {
    name.to_lowercase()
}
