//! glTF 2.0 and GLB: reads every triangle primitive of the default scene, expands instances, and applies node
//! transforms in f64.
//!
//! [`document`] is the part of the JSON that is needed, and [`extensions`] says which others a document may require.
//! Buffers are mapped ([`buffers`]) or decompressed ([`meshopt`], [`draco`]), and every offset and count is checked
//! when an [`accessor`] is read. [`scene`] says where meshes are, [`skin`] where their joints put them, and
//! [`primitive`] hands vertices and triangles on. Images are not opened yet.

mod accessor;
mod arrays;
mod attributes;
mod buffers;
mod document;
mod document_bytes;
mod draco;
mod extensions;
mod fields;
mod material_fields;
mod materials;
mod meshopt;
mod node_list;
mod nodes;
mod primitive;
mod scene;
mod skin;
mod smooth;

use std::borrow::Cow;
use std::path::PathBuf;

use super::beside::Beside;
use super::error::{Location, Parsed};
use super::sink::MeshSink;
use super::source::Source;

use attributes::SceneAttributes;
use buffers::Buffers;
pub use buffers::decode_percent;
use document::{Document, parse_document};
use document_bytes::document_bytes;
use draco::DracoDecoder;
use fields::Weights;
use primitive::PrimitiveReader;

/// Reads a binary container.
pub(super) fn read_glb(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let bytes = source.bytes;
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(source.truncated(Location::Byte(0), "a GLB file has at least 12 bytes"));
    };
    if version != 2 {
        return Err(source.unsupported(format!("glTF version {version}"), "convert it to glTF 2.0"));
    }
    if length as usize > bytes.len() {
        let missing = format!("the header announces {length} bytes, {} are there", bytes.len());
        return Err(source.truncated(Location::Byte(8), missing));
    }
    source.note_skipped((bytes.len() - length as usize) as u64, "bytes after the announced end were ignored");
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at + 8 <= length as usize {
        let (size, kind) = (word(at).unwrap_or(0) as usize, word(at + 4).unwrap_or(0));
        let Some(chunk) = bytes[..length as usize].get(at + 8..at + 8 + size) else {
            return Err(source.truncated(Location::Byte(at as u64), format!("a chunk of {size} bytes does not fit")));
        };
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at += 8 + size;
    }
    let Some(json) = json else {
        return Err(source.syntax(Location::Byte(12), "the file has no JSON chunk; it is damaged"));
    };
    read_document(source, json, binary, sink)
}

/// Reads a JSON file, with its buffers beside it or embedded.
pub(super) fn read_gltf(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let json = source.bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(source.bytes);
    read_document(source, json, None, sink)
}

fn read_document<'a>(source: &Source<'a>, json: &'a [u8], binary: Option<&'a [u8]>, sink: &mut MeshSink) -> Parsed<()> {
    let of_document = document_bytes(json);
    sink.hold(source, of_document)?;
    // The place of the text in the file, which comes first where there is nothing else.
    let start = json.as_ptr() as usize - source.bytes.as_ptr() as usize;
    let mut document = parse_document(source, json, if start > 3 { start } else { 0 })?;
    source.drop_pages();
    extensions::check_required(source, &document)?;
    let uris = document.take_uris();
    let buffers = Buffers::open(source, &document, &uris, binary)?;
    drop(uris);
    let held = of_document.saturating_add(buffers.decompressed_bytes());
    sink.hold_decompressed(source, held)?;
    let decoder = DracoDecoder::new(sink.room().memory);
    let attributes = SceneAttributes::of_document(source, &document, &buffers, &decoder, sink)?;
    let mut reader = PrimitiveReader {
        source,
        document: &document,
        buffers: &buffers,
        attributes,
        decoder,
        sink,
        held,
        skipped_primitive_count: 0,
        placeless_primitive_count: 0,
    };
    scene::read_scene(source, &document, &buffers, &mut reader)?;
    reader.attributes.note(source);
    source.note_skipped(reader.skipped_primitive_count, "point or line primitives were left out");
    source.note_skipped(reader.placeless_primitive_count, "primitives without positions were left out");
    let skins = document.skins.len() as u64;
    source.note_skipped(skins, "skins were read as their joints stand: animations are left out");
    let what = "meshes have morph targets with weights, which were ignored: the mesh is taken in its base shape";
    source.note_skipped(morphed_count(&document), what);
    Ok(())
}

/// The images that a file names.
pub(super) fn files_beside(source: &Source) -> Vec<PathBuf> {
    #[derive(serde::Deserialize)]
    struct Names {
        #[serde(default)]
        images: Vec<Name>,
    }
    #[derive(serde::Deserialize)]
    struct Name {
        uri: Option<String>,
    }
    let bytes = source.bytes;
    // The first chunk of a GLB file is its JSON.
    let json = match bytes.get(12..16).filter(|_| bytes.starts_with(b"glTF")).and_then(|size| size.try_into().ok()) {
        Some(size) => {
            bytes.get(20..).and_then(|rest| rest.get(..u32::from_le_bytes(size) as usize)).unwrap_or_default()
        }
        None => bytes,
    };
    let names = serde_json::from_slice(json).unwrap_or(Names { images: vec![] });
    let uris = names.images.into_iter().filter_map(|image| image.uri).filter(|uri| !buffers::has_scheme(uri));
    uris.filter_map(|uri| {
        let name = decode_percent(&uri).unwrap_or(Cow::Borrowed(&uri));
        Beside::new(source).find("image", name.as_bytes())
    })
    .collect()
}

/// How many meshes are not in their base shape.
fn morphed_count(document: &Document) -> u64 {
    let weights_of = |mesh: usize| document.meshes.get(mesh)?.weights.as_ref();
    let has_targets = |mesh: usize| {
        let primitives = document.meshes.get(mesh).map_or(&[][..], |mesh| &mesh.primitives);
        primitives.iter().any(|primitive| !primitive.targets.is_empty())
    };
    // The weights of a node stand in place of those of its mesh.
    let of_nodes = document.nodes.iter().filter_map(|node| {
        let mesh = usize::from(node.mesh?);
        Some((mesh, node.weights().or(weights_of(mesh))))
    });
    let of_meshes =
        (0..document.meshes.len()).filter(|_| document.nodes.is_empty()).map(|mesh| (mesh, weights_of(mesh)));
    let is_morphed = |weights: Option<&Weights>| weights.is_some_and(|weights| weights.are_set);
    of_nodes.chain(of_meshes).filter(|&(mesh, weights)| is_morphed(weights) && has_targets(mesh)).count() as u64
}

#[cfg(test)]
mod compression_tests;
#[cfg(test)]
mod scene_tests;
#[cfg(test)]
pub(super) mod tests;
#[cfg(test)]
mod texture_tests;
