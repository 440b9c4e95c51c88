//! The files of a tileset: in its folder, or in an archive.

use std::borrow::Cow;
use std::cell::RefCell;
use std::fs::{self, File};
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use zip::ZipArchive;

use super::ReadError;
use crate::import::decode_percent;
use crate::tileset::{ARCHIVE_EXTENSION, ENTRY};

/// Characters of a name in a message.
const SHOWN: usize = 80;

/// Where files are, which have names from the folder of the tileset, with slashes.
pub enum Files {
    Folder(PathBuf),
    Archive(PathBuf, RefCell<ZipArchive<BufReader<File>>>),
}

/// Whether a file is an archive of 3D Tiles.
pub fn is_archive(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ARCHIVE_EXTENSION)) && path.is_file()
}

/// The extension of a name, in lower case.
pub fn extension_of(name: &str) -> Option<String> {
    Some(Path::new(name).extension()?.to_str()?.to_ascii_lowercase())
}

impl Files {
    /// The files beside a tileset or in an archive, and the name of the first one.
    pub fn open(path: &Path) -> Result<(Self, String), ReadError> {
        let io = |source| ReadError::Io { path: path.to_owned(), source };
        if is_archive(path) {
            let file = BufReader::new(File::open(path).map_err(io)?);
            let zip = ZipArchive::new(file).map_err(|error| ReadError::Damaged {
                path: path.to_owned(),
                problem: format!("is no archive of 3D Tiles: {error}"),
            })?;
            return Ok((Self::Archive(path.to_owned(), RefCell::new(zip)), ENTRY.to_owned()));
        }
        let name = path.file_name().and_then(|name| name.to_str());
        let name = name.ok_or_else(|| io(io::Error::other("its name is not UTF-8")))?.to_owned();
        Ok((Self::Folder(path.parent().map(Path::to_owned).unwrap_or_default()), name))
    }

    /// The path of a file, for messages and for what it names itself.
    pub fn path(&self, name: &str) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.join(name),
            Self::Archive(archive, _) => archive.join(name),
        }
    }

    /// All of a file.
    pub fn read(&self, name: &str) -> Result<Vec<u8>, ReadError> {
        let io = |source| ReadError::Io { path: self.path(name), source };
        match self {
            Self::Folder(folder) => {
                let path = folder.join(name);
                if !fs::metadata(&path).map_err(io)?.is_file() {
                    return Err(io(io::Error::other("it is not a file")));
                }
                fs::read(path).map_err(io)
            }
            Self::Archive(_, zip) => {
                let mut zip = zip.borrow_mut();
                let file = zip.by_name(name).map_err(|error| io(io::Error::other(error)))?;
                let mut bytes = vec![];
                // What its header says of its size is not trusted with memory.
                file.take(u64::from(u32::MAX)).read_to_end(&mut bytes).map_err(io)?;
                Ok(bytes)
            }
        }
    }

    /// The name of a file that another one names.
    pub fn resolve(&self, from: &str, uri: &str) -> Result<String, ReadError> {
        let elsewhere = || ReadError::Elsewhere { path: self.path(from), uri: uri.chars().take(SHOWN).collect() };
        let plain = uri.split(['?', '#']).next().unwrap_or_default();
        if plain.is_empty() || plain.contains(':') || plain.starts_with(['/', '\\']) {
            return Err(elsewhere());
        }
        let mut parts: Vec<String> = from.split('/').map(str::to_owned).collect();
        parts.pop();
        let decoded = decode_percent(plain).unwrap_or(Cow::Borrowed(plain));
        for part in decoded.split(['/', '\\']) {
            match part {
                "" | "." => {}
                ".." => drop(parts.pop().ok_or_else(elsewhere)?),
                _ if part.contains(':') => return Err(elsewhere()),
                part => parts.push(part.to_owned()),
            }
        }
        Ok(parts.join("/"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_the_folder_of_the_tileset() {
        let files = Files::Folder(PathBuf::from("here"));
        let find = |uri: &str| files.resolve("a/b.json", uri).ok();
        assert_eq!(find("c.glb").as_deref(), Some("a/c.glb"));
        assert_eq!(find("./x/../c%20d.glb?v=1#part").as_deref(), Some("a/c d.glb"));
        assert_eq!(find("../c.glb").as_deref(), Some("c.glb"));
        for uri in [
            "../../c.glb",
            "%2e%2e/../c.glb",
            "/etc/c",
            "\\\\host\\c",
            "http://host/c.glb",
            "//host/c",
            "data:,x",
            "C:\\c",
            "x/C:/d",
            "",
        ] {
            assert_eq!(find(uri), None, "{uri}");
        }
    }
}
