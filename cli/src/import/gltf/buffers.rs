//! The bytes to which a glTF document refers.

use std::borrow::Cow;
use std::cell::Cell;
use std::path::{Path, PathBuf};

use ::gltf::Document;
use ::gltf::buffer::{Data, Source as BufferSource, View};

use crate::mesh::images::ImageSource;

use super::super::beside::leaves_folder;
use super::super::error::{ImportError, Location, Parsed};
use super::super::source::{DROP_BYTES, FileBytes, Source};

enum Bytes<'a> {
    Inside(&'a [u8]),
    Decoded(Vec<u8>),
    File(FileBytes),
}

/// All buffers of a document, each at least as long as the document says.
pub(super) struct Buffers<'a> {
    source: Source<'a>,
    list: Vec<Bytes<'a>>,
    /// Bytes of pages that may have become resident since all were dropped.
    touched: Cell<usize>,
}

/// The system maps this many bytes around a page that is read (Linux: fault-around), and so makes them resident.
const WINDOW_BYTES: usize = 1 << 16;

impl<'a> Buffers<'a> {
    /// Finds the buffers: the binary chunk, data URIs, and files beside the document, which are mapped.
    pub(super) fn open(source: &Source<'a>, document: &Document, binary: Option<&'a [u8]>) -> Parsed<Self> {
        let mut list = Vec::new();
        for buffer in document.buffers() {
            let location = Location::Item("buffer", buffer.index() as u64);
            let bytes = match buffer.source() {
                BufferSource::Bin => match binary {
                    Some(binary) => Bytes::Inside(binary),
                    None => {
                        return Err(
                            source.syntax(location, "has neither a name nor a binary chunk; export the file again")
                        );
                    }
                },
                BufferSource::Uri(uri) if uri.starts_with("data:") => {
                    let damaged =
                        || source.syntax(location, "has a data URI that is not base64; export the file again");
                    Bytes::Decoded(Data::from_source(buffer.source(), None).map_err(|_| damaged())?.0)
                }
                BufferSource::Uri(uri) if has_scheme(uri) => {
                    return Err(source
                        .unsupported(format!("a buffer at {uri}"), "download it and refer to it by a relative path"));
                }
                BufferSource::Uri(uri) => {
                    let name = decode_percent(uri)
                        .ok_or_else(|| source.syntax(location, format!("has a damaged name {uri}")))?;
                    if leaves_folder(Path::new(name.as_ref())) {
                        return Err(source.unsupported(
                            format!("a buffer outside its folder ({uri})"),
                            "put it beside the file, and refer to it by a relative path",
                        ));
                    }
                    let path: PathBuf =
                        source.path.parent().map_or_else(PathBuf::new, ToOwned::to_owned).join(name.as_ref());
                    Bytes::File(FileBytes::open(&path).map_err(|error| named(source, *error))?)
                }
            };
            if bytes.slice().len() < buffer.length() {
                let missing = format!("{} bytes are announced, {} are there", buffer.length(), bytes.slice().len());
                return Err(source.truncated(location, missing));
            }
            list.push(bytes);
        }
        Ok(Self { source: *source, list, touched: Cell::new(0) })
    }

    /// The bytes of a view from an offset on; `None` if they are outside the buffer.
    pub(super) fn view(&self, view: &View, offset: usize) -> Option<&[u8]> {
        self.touch(WINDOW_BYTES);
        let end = view.offset().checked_add(view.length())?;
        self.list.get(view.buffer().index())?.slice().get(view.offset()..end)?.get(offset..)
    }

    /// Where the bytes of an image are that lies in a view; none if they are outside the buffer. `name` is for messages.
    pub(super) fn image(&self, view: &View, name: &str) -> Option<ImageSource> {
        let bytes = self.view(view, 0)?;
        let range = |start: usize| Some(start as u64..(start + bytes.len()) as u64);
        Some(match self.list.get(view.buffer().index())? {
            Bytes::Inside(inside) => {
                // The chunk is a part of the file's bytes, so the distance is its place in the file.
                let chunk = (inside.as_ptr() as usize).checked_sub(self.source.bytes.as_ptr() as usize)?;
                ImageSource::File { path: self.source.path.to_owned(), range: range(chunk + view.offset()) }
            }
            Bytes::Decoded(_) => ImageSource::Inline { name: name.to_owned(), bytes: bytes.to_vec() },
            Bytes::File(file) => ImageSource::File { path: file.path().to_owned(), range: range(view.offset()) },
        })
    }

    /// Declares that so many more bytes are read. Views lie anywhere in any number of files, so all of their pages are
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
    fn slice(&self) -> &[u8] {
        match self {
            Bytes::Inside(bytes) => bytes,
            Bytes::Decoded(bytes) => bytes,
            Bytes::File(bytes) => bytes,
        }
    }
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
pub(super) fn decode_percent(uri: &str) -> Option<Cow<'_, str>> {
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
}
