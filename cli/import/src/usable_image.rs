//! Whether images that inputs name can be used, before anything depends on it: where they cannot, materials show what
//! they would show without them.

use std::collections::{BTreeMap, BTreeSet};
use std::io::SeekFrom;
use std::path::{Path, PathBuf};

use super::attributes::AttributeSink;
use super::relief::{Relief, relief_of};
use super::source::{Source, size_of_file};
use lodpack_mesh::images::{
    EncodedImage, ImageSource, MAX_IMAGE_TEXELS, decode_image, decoding_bytes, image_size, refuse_cut_jpeg,
    rows_of_png, texels_of, unreadable,
};

/// The images that a file names, each looked at once.
#[derive(Default)]
pub(super) struct NamedImages {
    /// Their numbers in the sink, if they can be used.
    numbers: BTreeMap<PathBuf, Option<u32>>,
    /// What images of relief hold, if they can be used.
    reliefs: BTreeMap<PathBuf, Option<Relief>>,
}

impl NamedImages {
    /// The number of an image; none, with a note, if it cannot be used.
    pub fn number(&mut self, path: PathBuf, source: &Source, sink: &mut AttributeSink) -> Option<u32> {
        if let Some(known) = self.numbers.get(&path) {
            return *known;
        }
        let image = ImageSource::File { path: path.clone(), range: None };
        let number = noted(check(&image), &image, source).map(|()| sink.add_image(image));
        self.numbers.insert(path, number);
        number
    }

    /// What an image of relief holds, as [`relief_of`] says it; none, with a note, if it cannot be used.
    pub fn relief(&mut self, path: &Path, source: &Source, memory: u64) -> Option<Relief> {
        if let Some(known) = self.reliefs.get(path) {
            return *known;
        }
        let image = ImageSource::File { path: path.to_owned(), range: None };
        let relief = noted(check(&image).and_then(|()| relief_of(&image, memory)), &image, source);
        self.reliefs.insert(path.to_owned(), relief);
        relief
    }

    /// All images, whether they can be used or not.
    pub fn into_paths(self) -> BTreeSet<PathBuf> {
        self.numbers.into_keys().chain(self.reliefs.into_keys()).collect()
    }
}

/// What was found out about an image; none, with a note, if it cannot be used.
fn noted<T>(found: Result<T, String>, image: &ImageSource, source: &Source) -> Option<T> {
    let note = |problem: &String| {
        source.note(&format!("the image {} cannot be used: {problem}; its material has no texture", image.name()));
    };
    found.inspect_err(note).ok()
}

/// Says why an image cannot be used. One that is too large is refused later, with an error.
pub(super) fn check(image: &ImageSource) -> Result<(), String> {
    if let ImageSource::File { path, .. } = image {
        size_of_file(path).map_err(|error| unreadable(&error))?;
    }
    let open = || image.open(None).map_err(|error| unreadable(&error));
    if texels_of(image_size(open()?)?) > MAX_IMAGE_TEXELS {
        return Ok(());
    }
    decoding_bytes(open()?)?;
    refuse_cut_jpeg(&mut open()?)?;
    if is_cut_short(open()?).map_err(|error| unreadable(&error))? { decode(&mut || open()) } else { Ok(()) }
}

/// Decodes all of an image, which takes long for a large one.
fn decode<'a>(open: &mut dyn FnMut() -> Result<Box<dyn EncodedImage + 'a>, String>) -> Result<(), String> {
    match rows_of_png(open()?)? {
        Some(mut rows) => {
            let mut row = vec![];
            while rows.next_row(&mut row)? {}
        }
        None => drop(decode_image(open()?)?),
    }
    Ok(())
}

/// Whether the file is a PNG without its last chunk, as a download leaves it that was interrupted. Nearly all files of
/// images are whole, so that they need not be decoded to know that they can be.
fn is_cut_short(mut encoded: impl EncodedImage) -> std::io::Result<bool> {
    const SIGNATURE: &[u8; 8] = b"\x89PNG\r\n\x1a\n";
    let mut start = [0; 8];
    if encoded.read_exact(&mut start).is_err() || start != *SIGNATURE {
        return Ok(false);
    }
    let end = encoded.seek(SeekFrom::End(0))?;
    let mut at = encoded.seek(SeekFrom::Start(8))?;
    // A chunk is its length, its name, as many bytes as its length says, and a checksum.
    while at + 12 <= end {
        encoded.read_exact(&mut start)?;
        let [a, b, c, d, name @ ..] = start;
        let length = u32::from_be_bytes([a, b, c, d]);
        at += 12 + u64::from(length);
        if name == *b"IEND" {
            return Ok(at > end);
        }
        encoded.seek_relative(i64::from(length) + 4)?;
    }
    Ok(true)
}
