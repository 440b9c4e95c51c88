//! Tilesets as one file: `.3tz`, the archive format of 3D Tiles (version 1.3). It is a ZIP whose files are stored as
//! they are, so that a range request fetches one, with an index behind them that leads from the hash of a path to its
//! place.

use std::fs::{self, File};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};

use md5::{Digest, Md5};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipArchive, ZipWriter};

use super::ENTRY;
use crate::progress::Progress;

/// The name of the index, which is the last file.
const INDEX: &str = "@3dtilesIndex1@";
/// The extension of archives.
pub const ARCHIVE_EXTENSION: &str = "3tz";

/// Packs the files of a folder into an archive, and returns its bytes. Equal folders give equal archives.
///
/// # Errors
/// Those of the file system.
pub fn write_archive(folder: &Path, out: File, progress: &dyn Progress) -> io::Result<u64> {
    let mut names = vec![];
    collect(folder, "", &mut names)?;
    // What is read first comes first.
    names.sort_by_key(|(name, _)| (name != ENTRY, name.clone()));
    progress.begin("archive", names.len() as u64);
    let mut zip = ZipWriter::new(out);
    for (name, path) in &names {
        let size = fs::metadata(path)?.len();
        zip.start_file(name, plain(size)).map_err(reason)?;
        io::copy(&mut File::open(path)?, &mut zip)?;
        progress.advance(1);
    }
    let mut file = zip.finish().map_err(reason)?;
    let index = index_of(&mut file)?;
    let mut zip = ZipWriter::new_append(file).map_err(reason)?;
    zip.start_file(INDEX, plain(index.len() as u64)).map_err(reason)?;
    zip.write_all(&index)?;
    zip.finish().map_err(reason)?.stream_position()
}

/// Stored, of no time and no user.
fn plain(size: u64) -> SimpleFileOptions {
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    options.last_modified_time(DateTime::default()).unix_permissions(0o644).large_file(size >= u64::from(u32::MAX))
}

/// All files below a folder: their names from there, with slashes.
fn collect(folder: &Path, above: &str, names: &mut Vec<(String, PathBuf)>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = format!("{above}{}", entry.file_name().to_string_lossy());
        match entry.file_type()?.is_dir() {
            true => collect(&entry.path(), &format!("{name}/"), names)?,
            false => names.push((name, entry.path())),
        }
    }
    Ok(())
}

/// For each file the MD5 of its name and where its header begins, ordered by the hash as two numbers of 64 bits, the
/// first one first.
fn index_of(file: &mut (impl Read + Seek)) -> io::Result<Vec<u8>> {
    let mut zip = ZipArchive::new(file).map_err(reason)?;
    let mut entries = Vec::with_capacity(zip.len());
    for number in 0..zip.len() {
        let entry = zip.by_index_raw(number).map_err(reason)?;
        let hash: [u8; 16] = Md5::digest(entry.name().map_err(reason)?.as_bytes()).into();
        entries.push((hash, entry.header_start()));
    }
    entries.sort_by_key(|(hash, _)| {
        let number = u128::from_le_bytes(*hash);
        (number as u64, (number >> 64) as u64)
    });
    Ok(entries.iter().flat_map(|(hash, start)| hash.iter().copied().chain(start.to_le_bytes())).collect())
}

fn reason(error: ZipError) -> io::Error {
    match error {
        ZipError::Io(error) => error,
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Silent;

    fn archive_of(files: &[(&str, &[u8])]) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("tiles");
        for (name, bytes) in files {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let path = dir.path().join("x.3tz");
        let out = File::options().create(true).read(true).write(true).truncate(true).open(&path).unwrap();
        let size = write_archive(&folder, out, &Silent).unwrap();
        let bytes = fs::read(&path).unwrap();
        assert_eq!(size, bytes.len() as u64);
        bytes
    }

    #[test]
    fn the_index_leads_to_every_file() {
        let files: [(&str, &[u8]); 4] =
            [("0/2.glb", b"two"), ("tileset.json", b"{}"), ("0/1.glb", b"one"), ("1/0.json", b"[]")];
        let bytes = archive_of(&files);
        let mut zip = ZipArchive::new(io::Cursor::new(&bytes)).unwrap();
        let names: Vec<String> = zip.file_names().map(|name| name.unwrap().into_owned()).collect();
        assert_eq!(names, ["tileset.json", "0/1.glb", "0/2.glb", "1/0.json", INDEX]);
        let mut index = vec![];
        zip.by_name(INDEX).unwrap().read_to_end(&mut index).unwrap();
        assert_eq!(index.len(), 24 * files.len());
        // As a reader does it: by the hash of the name, and what a local header of ZIP says.
        let keys: Vec<[u64; 2]> =
            index.chunks(24).map(|e| [0, 8].map(|at| u64::from_le_bytes(e[at..at + 8].try_into().unwrap()))).collect();
        assert!(keys.is_sorted());
        for (name, content) in files {
            let hash: [u8; 16] = Md5::digest(name.as_bytes()).into();
            let entry = index.chunks(24).find(|entry| entry[..16] == hash).unwrap();
            let at = u64::from_le_bytes(entry[16..].try_into().unwrap()) as usize;
            let header = &bytes[at..];
            assert_eq!(&header[..4], b"PK\x03\x04", "{name}");
            assert_eq!(header[8..10], [0, 0], "{name} is not stored as it is");
            let length = |at: usize| usize::from(u16::from_le_bytes([header[at], header[at + 1]]));
            assert_eq!(&header[30..30 + length(26)], name.as_bytes());
            assert_eq!(&header[30 + length(26) + length(28)..][..content.len()], content);
        }
        assert_eq!(bytes, archive_of(&files), "equal folders give equal archives");
    }
}
