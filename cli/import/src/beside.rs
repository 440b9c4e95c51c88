//! Where the files are that an input names: images, and libraries of materials.

pub(super) mod folders;

use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

use folders::Folders;

use super::source::Source;
use lodpack_mesh::images::shown_name;

/// The folders in which the files are that a file names.
pub(super) struct Beside<'a> {
    source: &'a Source<'a>,
    /// That of the input.
    home: &'a Path,
    /// That of the library that names them, within the input's; it comes first.
    inner: PathBuf,
    /// What is in them, as far as names had to be looked for.
    folders: Folders,
}

impl<'a> Beside<'a> {
    /// Files that the input itself names.
    pub fn new(source: &'a Source) -> Self {
        let home = source.path.parent().unwrap_or(Path::new(""));
        Self { source, home, inner: PathBuf::new(), folders: Folders::default() }
    }

    /// Files that a library names, which itself was found beside the input.
    pub fn library(source: &'a Source, library: &Path) -> Self {
        let beside = Self::new(source);
        let inner = library.strip_prefix(beside.home).ok().and_then(Path::parent).map(Path::to_owned);
        Self { inner: inner.unwrap_or_default(), ..beside }
    }

    /// The path of a file, whether it is there or not; none, with a note, if it would lie outside of the input's
    /// folder.
    pub fn find(&self, what: &str, name: &[u8]) -> Option<PathBuf> {
        let found = self.path(name);
        if found.is_none() {
            self.source.note(&not_beside(what, &shown_name(&String::from_utf8_lossy(name.trim_ascii()))));
        }
        found
    }

    /// The same without a note.
    pub fn path(&self, name: &[u8]) -> Option<PathBuf> {
        self.there(name).or_else(|| {
            let [.., portable] = spellings_of(name.trim_ascii());
            (!self.is_elsewhere(&portable)).then(|| self.home.join(&self.inner).join(portable))
        })
    }

    /// The path of a file that is there under the name as it is written, or as it is meant; in any letters, large or
    /// small.
    pub fn existing(&self, name: &[u8]) -> Option<PathBuf> {
        self.first_of(self.within(&spellings(name)))
    }

    /// Where files of some names may be, relative to the folder of the input.
    fn within(&self, spellings: &[OsString]) -> Vec<PathBuf> {
        let paths = spellings.iter().flat_map(|name| [self.inner.join(name), PathBuf::from(name)]);
        paths.filter(|path| !leaves_folder(path)).collect()
    }

    /// The first of some paths at which there is a file; in any letters where there is none in these.
    fn first_of(&self, paths: Vec<PathBuf>) -> Option<PathBuf> {
        let exact = paths.iter().map(|path| self.home.join(path)).find(|path| path.is_file());
        exact.or_else(|| paths.iter().find_map(|path| self.folders.in_any_letters(self.home, path)))
    }

    /// Whether there is a file of a name, here or where the whole path leads.
    pub fn is_there(&self, name: &[u8]) -> bool {
        self.there(name).is_some()
    }

    fn there(&self, name: &[u8]) -> Option<PathBuf> {
        self.existing(name).or_else(|| self.of_same_name(name))
    }

    /// The files whose names are two parts with a number of four digits between, in its order.
    pub fn numbered(&self, before: &[u8], after: &[u8]) -> Vec<(u32, PathBuf)> {
        // No file has such a byte in its name.
        let spellings = spellings(&[before, b"\0", after].concat());
        let paths = self.within(&spellings).into_iter().chain(self.elsewhere(&spellings));
        paths
            .map(|path| self.home.join(path))
            .find_map(|path| Some(self.folders.numbered(&path)).filter(|found| !found.is_empty()))
            .unwrap_or_default()
    }

    /// The path of a file of the same name, where the whole path leads elsewhere. Exporters write the path that a file
    /// had on their machine. The content of a file must not cause files elsewhere to be read, but one of the same name
    /// here is what is meant.
    pub fn of_same_name(&self, name: &[u8]) -> Option<PathBuf> {
        self.first_of(self.elsewhere(&spellings(name)))
    }

    /// Where files may be here whose whole path leads elsewhere.
    fn elsewhere(&self, spellings: &[OsString]) -> Vec<PathBuf> {
        let elsewhere = spellings.iter().filter(|name| self.is_elsewhere(name));
        let names = elsewhere.filter_map(|name| Path::new(name).file_name());
        names.flat_map(|name| [self.inner.join(name), PathBuf::from(name)]).collect()
    }

    /// Whether a path leads out of the folder of the input, on this system or on Windows.
    fn is_elsewhere(&self, name: &OsString) -> bool {
        let has_drive = matches!(name.as_encoded_bytes(), [letter, b':', ..] if letter.is_ascii_alphabetic());
        has_drive || leaves_folder(&self.inner.join(name))
    }
}

/// What is said about a file that is not in the folder of the input.
pub(super) fn not_beside(what: &str, name: &str) -> String {
    format!("the {what} {name} is not in the folder of the file: put it there; it was left out")
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

/// The names that may be meant, most likely first: files may be called `a "b" # c.png`, but some programs quote names
/// and write comments behind them.
fn spellings(name: &[u8]) -> Vec<OsString> {
    let name = name.trim_ascii();
    let mut meant = vec![name, unquoted(name)];
    let bare = without_remark(name);
    if bare.len() < name.len() {
        meant.extend([bare, unquoted(bare)]);
    }
    meant.into_iter().filter(|name| !name.is_empty()).flat_map(spellings_of).collect()
}

/// A name without the comment behind it, which a blank precedes.
pub(super) fn without_remark(name: &[u8]) -> &[u8] {
    let begins = |at: usize| name[at] == b'#' && at.checked_sub(1).is_none_or(|before| name[before] <= b' ');
    name[..(0..name.len()).find(|&at| begins(at)).unwrap_or(name.len())].trim_ascii()
}

fn unquoted(name: &[u8]) -> &[u8] {
    name.strip_prefix(b"\"").and_then(|name| name.strip_suffix(b"\"")).map_or(name, <[u8]>::trim_ascii)
}

/// A name as it is, as that of a file whose name is Unicode where the text is not, and as Windows writes it.
fn spellings_of(name: &[u8]) -> [OsString; 4] {
    // Files come from all systems.
    let portable: Vec<u8> = name.iter().map(|&byte| if byte == b'\\' { b'/' } else { byte }).collect();
    [os_string(name), unicode(name).into(), unicode(&portable).into(), os_string(&portable)]
}

/// Text that is not UTF-8 is read as Latin-1, whose numbers are those of Unicode.
fn unicode(name: &[u8]) -> String {
    String::from_utf8(name.to_vec()).unwrap_or_else(|_| name.iter().copied().map(char::from).collect())
}

#[cfg(unix)]
fn os_string(name: &[u8]) -> OsString {
    use std::os::unix::ffi::OsStrExt;
    std::ffi::OsStr::from_bytes(name).to_owned()
}

#[cfg(not(unix))]
fn os_string(name: &[u8]) -> OsString {
    unicode(name).into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack_runtime::progress::Silent;
    use std::fs;

    /// A folder with an image `g.png` and others, and the path of the file that is found in it for a name.
    fn found(inner: &str, name: &[u8]) -> Option<String> {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir_all(dir.path().join("tex/deep")).unwrap();
        for file in ["g.png", "a # b.png", "tex/g.png", "tex/w.png", "h\u{e9}.png", "tex/Big.PNG", "big.Jpg"] {
            fs::write(dir.path().join(file), "x").unwrap();
        }
        let input = dir.path().join("a.obj");
        let source = Source::new(&input, b"", &Silent);
        let library = dir.path().join(inner).join("a.mtl");
        let found = Beside::library(&source, &library).find("image", name)?;
        Some(found.strip_prefix(dir.path()).unwrap().to_str().unwrap().to_owned())
    }

    #[test]
    fn files_lie_in_the_folder_of_their_document_or_below() {
        for inside in ["a.bin", "./a.bin", "b/a.bin", "b/../a.bin"] {
            assert!(!leaves_folder(Path::new(inside)), "{inside}");
        }
        for outside in ["../a.bin", "b/../../a.bin", "/etc/passwd", "./../a.bin"] {
            assert!(leaves_folder(Path::new(outside)), "{outside}");
        }
    }

    #[test]
    fn files_are_found_under_the_name_that_is_meant() {
        for (name, expected) in [
            (&b"g.png"[..], "g.png"),
            (b" \"g.png\" ", "g.png"),
            (b"g.png # the colour", "g.png"),
            (b"\"g.png\"\t# the colour", "g.png"),
            // A file of the whole name comes first.
            (b"a # b.png", "a # b.png"),
            (b"tex\\w.png", "tex/w.png"),
            (b"h\xe9.png", "h\u{e9}.png"),
            (b"C:\\x\\g.png", "g.png"),
            (b"d:/x/g.png # there", "g.png"),
            (b"\\\\server\\x\\g.png", "g.png"),
            (b"/abs/g.png", "g.png"),
            (b"../g.png", "g.png"),
            // In other letters.
            (b"G.PNG", "g.png"),
            (b"TEX/big.png", "tex/Big.PNG"),
            (b"Tex\\BIG.PNG # there", "tex/Big.PNG"),
            (b"H\xc9.png", "h\u{e9}.png"),
            (b"d:/X/BIG.JPG", "big.Jpg"),
            // What is missing is named as it is.
            (b"tex\\none.png", "tex/none.png"),
        ] {
            assert_eq!(found("", name).as_deref(), Some(expected), "{}", name.escape_ascii());
        }
        assert_eq!(found("", b"C:\\x\\none.png"), None);
        assert_eq!(found("", b"../none.png"), None);
    }

    #[test]
    fn files_are_found_by_number() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("tex")).unwrap();
        for file in ["a.1011.png", "a.1001.png", "A.1002.PNG", "a.101.png", "a.10011.png", "ab.1001.png", "tex/b1001"] {
            fs::write(dir.path().join(file), "x").unwrap();
        }
        let input = dir.path().join("a.obj");
        let source = Source::new(&input, b"", &Silent);
        let beside = Beside::new(&source);
        let numbers = |before: &[u8], after: &[u8]| -> Vec<u32> {
            beside.numbered(before, after).into_iter().map(|(number, _)| number).collect()
        };
        assert_eq!(numbers(b"a.", b".png"), [1001, 1002, 1011]);
        assert_eq!(numbers(b"C:\\x\\a.", b".png"), [1001, 1002, 1011]);
        assert_eq!(numbers(b"tex/b", b""), [1001]);
        assert_eq!((numbers(b"../a.", b".png"), numbers(b"none/b", b"")), (vec![1001, 1002, 1011], vec![]));
    }

    #[test]
    fn files_of_a_library_are_beside_it_before_they_are_beside_the_input() {
        assert_eq!(found("tex", b"g.png").as_deref(), Some("tex/g.png"));
        assert_eq!(found("tex/deep", b"g.png").as_deref(), Some("g.png"));
        assert_eq!(found("tex/deep", b"../w.png").as_deref(), Some("tex/deep/../w.png"));
        assert_eq!(found("tex/deep", b"/x/y/g.png").as_deref(), Some("g.png"));
        assert_eq!(found("tex", b"../../g.png").as_deref(), Some("tex/g.png"));
    }
}
