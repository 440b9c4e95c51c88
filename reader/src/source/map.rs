//! Memory maps.

use std::{fs::File, io, path::Path};

use super::ReadAt;

/// A file that the operating system maps into memory. Reads copy from its cache, without a system call each.
///
/// The file must not get shorter while it is mapped: reading beyond its new end kills the process. Use
/// [`std::fs::File`] for files that others may write to.
#[derive(Debug)]
pub struct Map {
    bytes: memmap2::Mmap,
}

impl Map {
    /// Maps a file.
    ///
    /// # Errors
    /// The system's error.
    pub fn open(path: impl AsRef<Path>) -> io::Result<Self> {
        Self::new(&File::open(path)?)
    }

    /// Maps an open file.
    ///
    /// # Errors
    /// The system's error.
    pub fn new(file: &File) -> io::Result<Self> {
        // SAFETY: The map is read only and its bytes are only ever copied out, so a change by another process can at
        // worst give wrong bytes, which checksums find. The type's documentation forbids that the file gets shorter.
        #[expect(unsafe_code, reason = "a map of a file cannot be proven to stay as it is")]
        let bytes = unsafe { memmap2::Mmap::map(file)? };
        Ok(Self { bytes })
    }
}

impl ReadAt for Map {
    fn read_at(&self, offset: u64, buf: &mut [u8]) -> io::Result<()> {
        self.bytes[..].read_at(offset, buf)
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn maps_read_what_is_in_the_file() {
        let path = std::env::temp_dir().join(format!("lodpack-map-{}", std::process::id()));
        File::create(&path).unwrap().write_all(&[1, 2, 3, 4, 5]).unwrap();
        let map = Map::open(&path).unwrap();
        std::fs::remove_file(&path).unwrap();
        let mut buf = [0; 3];
        map.read_at(1, &mut buf).unwrap();
        assert_eq!((buf, map.size().unwrap()), ([2, 3, 4], 5));
        assert_eq!(map.read_at(3, &mut buf).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
    }
}
