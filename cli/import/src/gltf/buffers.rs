//! The bytes to which a glTF document refers.

use std::borrow::Cow;
use std::cell::{Cell, OnceCell};
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};

use super::document::{Compressed, Document, View};
use super::document_bytes::unless_negligible;
use super::fields::Index;
use super::meshopt;
use crate::beside::leaves_folder;
use crate::error::{ImportError, Location, Parsed};
use crate::source::{DROP_BYTES, FileBytes, Source};
use lodpack_mesh::images::ImageSource;

enum Bytes<'a> {
    Inside(&'a [u8]),
    Decoded(Vec<u8>),
    File(FileBytes),
    /// The document does not say where, as of buffers that only programs without decompression would need.
    Nowhere,
}

/// All buffers of a document, each at least as long as the document says.
pub(super) struct Buffers<'a> {
    source: Source<'a>,
    views: &'a [View],
    list: Vec<Bytes<'a>>,
    /// The bytes of compressed views, once they are read.
    decompressed: Vec<OnceCell<Vec<u8>>>,
    /// Bytes of pages that may have become resident since all were dropped.
    touched: Cell<usize>,
}

/// The system maps this many bytes around a page that is read (Linux: fault-around), and so makes them resident.
const WINDOW_BYTES: usize = 1 << 16;

impl<'a> Buffers<'a> {
    /// Finds the buffers: the binary chunk, data URIs, and files beside the document, which are mapped.
    pub(super) fn open(
        source: &Source<'a>,
        document: &'a Document,
        uris: &[Option<String>],
        binary: Option<&'a [u8]>,
    ) -> Parsed<Self> {
        let views = &document.buffer_views;
        let mut are_read = vec![false; document.buffers.len()];
        let mut read = |buffer: Index| {
            if let Some(is_read) = are_read.get_mut(usize::from(buffer)) {
                *is_read = true;
            }
        };
        for view in views {
            let compressed = view.compressed();
            if let Some(compressed) = compressed {
                read(compressed.buffer);
            }
            // Fallbacks may be left out where files are copied.
            if compressed.is_none() || !document.is_fallback(view.buffer.into()) {
                read(view.buffer);
            }
        }
        let mut list = Vec::new();
        for (number, (buffer, uri)) in document.buffers.iter().zip(uris).enumerate() {
            // Only the first buffer can be the binary chunk.
            let binary = binary.filter(|_| number == 0 && uri.is_none() && !buffer.is_fallback());
            let bytes = match (binary, uri) {
                (Some(binary), _) => Bytes::Inside(binary),
                (None, Some(uri)) if are_read[number] => open_uri(source, number, uri)?,
                _ => Bytes::Nowhere,
            };
            let (announced, found) = (usize::from(buffer.byte_length), bytes.slice().map(<[u8]>::len));
            if let Some(found) = found.filter(|found| *found < announced) {
                let missing = format!("{announced} bytes are announced, {found} are there");
                return Err(source.truncated(Location::Item("buffer", number as u64), missing));
            }
            list.push(bytes);
        }
        let decompressed = views.iter().map(|_| OnceCell::new()).collect();
        Ok(Self { source: *source, views, list, decompressed, touched: Cell::new(0) })
    }

    /// How many bytes compressed views have once they are decompressed; none if they are negligible.
    pub(super) fn decompressed_bytes(&self) -> u64 {
        let compressed = self.views.iter().filter_map(|view| self.to_decompress(view));
        unless_negligible(compressed.map(meshopt::decompressed_bytes).fold(0, u64::saturating_add))
    }

    /// How a view is compressed whose bytes are nowhere else.
    fn to_decompress<'v>(&self, view: &'v View) -> Option<&'v Compressed> {
        view.compressed().filter(|_| matches!(self.list.get(usize::from(view.buffer)), None | Some(Bytes::Nowhere)))
    }

    /// The bytes of a view, and the distance of its items, if it says so; none if they are outside the buffer.
    pub(super) fn view(&self, number: usize) -> Parsed<Option<(&[u8], Option<usize>)>> {
        let location = Location::Item("buffer view", number as u64);
        let Some(view) = self.views.get(number) else {
            let problem = format!("is not there: the document has {}; export the file again", self.views.len());
            return Err(self.source.syntax(location, problem));
        };
        let stride = view.byte_stride.map(usize::from);
        if let (Some(compressed), Some(cell)) = (self.to_decompress(view), self.decompressed.get(number)) {
            let bytes = match cell.get() {
                Some(bytes) => bytes,
                None => {
                    let range = [compressed.byte_offset, compressed.byte_length].map(usize::from);
                    let Some(encoded) = self.range(compressed.buffer.into(), range)? else { return Ok(None) };
                    let decoded = meshopt::decompress(encoded, compressed);
                    let decoded = decoded.map_err(|problem| self.source.syntax(location, problem))?;
                    cell.get_or_init(|| decoded)
                }
            };
            return Ok(Some((bytes, stride)));
        }
        let range = [view.byte_offset, view.byte_length].map(usize::from);
        Ok(self.range(view.buffer.into(), range)?.map(|bytes| (bytes, stride)))
    }

    /// Bytes of a buffer from an offset on; none if they are outside of it.
    fn range(&self, buffer: usize, [offset, length]: [usize; 2]) -> Parsed<Option<&[u8]>> {
        self.touch(WINDOW_BYTES);
        let location = Location::Item("buffer", buffer as u64);
        match self.list.get(buffer).map(Bytes::slice) {
            Some(Some(bytes)) => Ok(offset.checked_add(length).and_then(|end| bytes.get(offset..end))),
            Some(None) => {
                Err(self.source.syntax(location, "has neither a name nor a binary chunk; export the file again"))
            }
            None => {
                let problem = format!("is not there: the document has {}; export the file again", self.list.len());
                Err(self.source.syntax(location, problem))
            }
        }
    }

    /// Where the bytes of an image are that lies in a view; none if they are outside the buffer. `name` is for
    /// messages.
    pub(super) fn image(&self, number: usize, name: &str) -> Option<ImageSource> {
        let view = self.views.get(number)?;
        let (bytes, _) = self.view(number).ok()??;
        let inline = || ImageSource::Inline { name: name.to_owned(), bytes: bytes.to_vec() };
        if self.to_decompress(view).is_some() {
            return Some(inline());
        }
        let range = |start: usize| Some(start as u64..(start + bytes.len()) as u64);
        Some(match self.list.get(usize::from(view.buffer))? {
            Bytes::Inside(inside) => {
                // The chunk is a part of the file's bytes, so the distance is its place in the file.
                let chunk = (inside.as_ptr() as usize).checked_sub(self.source.bytes.as_ptr() as usize)?;
                let range = range(chunk + usize::from(view.byte_offset));
                ImageSource::File { path: self.source.path.to_owned(), range }
            }
            Bytes::File(file) => {
                ImageSource::File { path: file.path().to_owned(), range: range(view.byte_offset.into()) }
            }
            Bytes::Decoded(_) | Bytes::Nowhere => inline(),
        })
    }

    /// Declares how many more bytes are read. Views lie anywhere in any number of files, so all of their pages are
    /// dropped once enough of them may be resident.
    #[inline]
    pub(super) fn touch(&self, bytes: usize) {
        let touched = self.touched.get() + bytes.min(WINDOW_BYTES);
        self.touched.set(touched);
        if touched >= DROP_BYTES {
            self.drop_pages();
        }
    }

    #[cold]
    fn drop_pages(&self) {
        self.touched.set(0);
        self.source.drop_pages();
        for bytes in &self.list {
            if let Bytes::File(file) = bytes {
                file.drop_pages();
            }
        }
    }
}

impl Bytes<'_> {
    fn slice(&self) -> Option<&[u8]> {
        match self {
            Bytes::Inside(bytes) => Some(bytes),
            Bytes::Decoded(bytes) => Some(bytes),
            Bytes::File(bytes) => Some(bytes),
            Bytes::Nowhere => None,
        }
    }
}

/// The bytes that a buffer names.
fn open_uri<'a>(source: &Source, number: usize, uri: &str) -> Parsed<Bytes<'a>> {
    let location = Location::Item("buffer", number as u64);
    if uri.starts_with("data:") {
        let problem = "has a data URI that is not base64; export the file again";
        return Ok(Bytes::Decoded(decode_data_uri(uri).ok_or_else(|| source.syntax(location, problem))?));
    }
    if has_scheme(uri) {
        let remedy = "download it and refer to it by a relative path";
        return Err(source.unsupported(format!("a buffer at {uri}"), remedy));
    }
    let name = decode_percent(uri).ok_or_else(|| source.syntax(location, format!("has a damaged name {uri}")))?;
    if leaves_folder(Path::new(name.as_ref())) {
        return Err(source.unsupported(
            format!("a buffer outside its folder ({uri})"),
            "put it beside the file, and refer to it by a relative path",
        ));
    }
    let path: PathBuf = source.path.parent().map_or_else(PathBuf::new, ToOwned::to_owned).join(name.as_ref());
    Ok(Bytes::File(FileBytes::open(&path).map_err(|error| named(source, *error))?))
}

/// The bytes of a data URI in base64, padded or not; none if it is none.
pub(super) fn decode_data_uri(uri: &str) -> Option<Vec<u8>> {
    const LENIENT: GeneralPurposeConfig = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    let (head, text) = uri.split_once(',')?;
    let is_base64 = head.starts_with("data:") && head.ends_with(";base64");
    GeneralPurpose::new(&STANDARD, LENIENT).decode(text).ok().filter(|_| is_base64)
}

/// Whether a URI starts like "https:". A single letter is a drive of Windows.
pub(super) fn has_scheme(uri: &str) -> bool {
    uri.split_once(':')
        .is_some_and(|(scheme, _)| scheme.len() > 1 && scheme.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'+'))
}

/// Names the document whose buffer cannot be read.
fn named(document: &Source, error: ImportError) -> ImportError {
    match error {
        ImportError::Io { path: buffer, source } => {
            ImportError::Buffer { path: document.path.to_owned(), buffer, source }
        }
        other => other,
    }
}

/// Decodes %20 and the like; `None` if the result is not text.
pub fn decode_percent(uri: &str) -> Option<Cow<'_, str>> {
    if !uri.contains('%') {
        return Some(uri.into());
    }
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, others @ ..] = rest {
        let hex = others.get(..2).filter(|_| *first == b'%').and_then(|h| std::str::from_utf8(h).ok());
        match hex.and_then(|h| u8::from_str_radix(h, 16).ok()) {
            Some(byte) => {
                bytes.push(byte);
                rest = &others[2..];
            }
            None => {
                bytes.push(*first);
                rest = others;
            }
        }
    }
    String::from_utf8(bytes).ok().map(Cow::Owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs_are_decoded_or_kept() {
        assert_eq!(decode_percent("a%20b%C3%A9.bin").as_deref(), Some("a b\u{e9}.bin"));
        assert_eq!(decode_percent("100%.bin").as_deref(), Some("100%.bin"));
        assert_eq!(decode_percent("%ff"), None);
    }

    #[test]
    fn data_uris_of_any_type_are_decoded_with_and_without_padding() {
        let expected = Some(b"\0\x01\x02\x03".to_vec());
        for uri in
            ["data:;base64,AAECAw==", "data:application/octet-stream;base64,AAECAw", "data:a/b;c=d;base64,AAECAw=="]
        {
            assert_eq!(decode_data_uri(uri), expected, "{uri}");
        }
        for uri in ["data:;base64,AAE*Aw==", "data:,AAECAw==", "data:;base64", "a;base64,AAECAw=="] {
            assert_eq!(decode_data_uri(uri), None, "{uri}");
        }
    }
}
