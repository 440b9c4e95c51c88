//! The JSON of a document: its size in memory, its version, and extensions without which there is no surface.

use ::gltf::Document;
use ::gltf::json::Root;
use ::gltf::json::mesh::Primitive;

use super::extras::without_extras;
use super::materials::UNREAD_IMAGES;
use crate::import::error::{ImportError, Location, Parsed};
use crate::import::source::Source;

/// Extensions that change the surface itself: a file that requires one cannot be read.
pub(super) const SURFACE_EXTENSIONS: [&str; 4] = [DRACO, MESHOPT[0], MESHOPT[1], INSTANCES];

const DRACO: &str = "KHR_draco_mesh_compression";
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
const INSTANCES: &str = "EXT_mesh_gpu_instancing";

/// Required extensions that need nothing from the validator: quantised positions are read by their component type. Images that are not
/// read are noted where a material names them.
const HARMLESS_EXTENSIONS: [&str; 1] = ["KHR_mesh_quantization"];

/// Refuses documents that do not require an extension of the surface but have nothing without it. `has_binary` says that there is a binary
/// chunk.
pub(super) fn check_surface_extensions(source: &Source, document: &Document, has_binary: bool) -> Parsed<()> {
    for view in document.views() {
        let Some(extension) = MESHOPT.iter().find(|name| view.extension_value(name).is_some()) else { continue };
        // Only the first buffer can be the binary chunk.
        let buffer = view.buffer();
        let is_named = document.as_json().buffers.get(buffer.index()).is_some_and(|buffer| buffer.uri.is_some());
        let is_chunk = buffer.index() == 0 && has_binary && buffer.extension_value(extension).is_none();
        if !is_named && !is_chunk {
            return Err(missing_surface(source, extension));
        }
    }
    // A node that is drawn once where it should be drawn many times is no fallback.
    match document.nodes().any(|node| node.extension_value(INSTANCES).is_some()) {
        true => Err(missing_surface(source, INSTANCES)),
        false => Ok(()),
    }
}

/// Whether accessors of a primitive have data only in a compressed form.
fn is_compressed_alone(root: &Root, primitive: &Primitive) -> bool {
    let is_compressed = primitive.extensions.as_ref().is_some_and(|extensions| extensions.others.contains_key(DRACO));
    let mut accessors = primitive.attributes.values().chain(&primitive.indices);
    is_compressed
        && accessors.any(|accessor| {
            let accessor = root.accessors.get(accessor.value());
            accessor.is_some_and(|accessor| accessor.buffer_view.is_none() && accessor.sparse.is_none())
        })
}

fn missing_surface(source: &Source, extension: &str) -> Box<ImportError> {
    source.unsupported(format!("the extension {extension}"), "export it without compression and instancing extensions")
}

/// An upper bound on the memory for the document and its embedded buffers; none if it is negligible.
pub(super) fn document_bytes(json: &[u8]) -> u64 {
    // The text itself, its strings (once more if they have escapes), and the buffers decoded from them.
    const PER_BYTE: u64 = 4;
    // The largest objects are nodes, with their entry in the list of open ones; the largest list items are bounds.
    const PER_OBJECT: u64 = 384;
    const PER_COMMA: u64 = 64;
    const NOTHING: u64 = 4 << 20;
    let count = |letter: u8| json.iter().filter(|&&b| b == letter).count() as u64;
    let bytes = PER_BYTE * json.len() as u64 + PER_OBJECT * count(b'{') + PER_COMMA * count(b',');
    if bytes > NOTHING { bytes } else { 0 }
}

/// Parses and validates the JSON.
pub(super) fn parse_document(source: &Source, json: &[u8]) -> Parsed<Document> {
    check_version(source, json)?;
    let mut root = Root::from_slice(&without_extras(json)).map_err(|error| {
        if error.is_eof() {
            return source.truncated(Location::Line(error.line() as u64), "the JSON text has no end");
        }
        source.syntax(Location::Line(error.line() as u64), format!("not valid glTF JSON: {error}; the file is damaged"))
    })?;
    if let Some(extension) = root.extensions_required.iter().find(|e| SURFACE_EXTENSIONS.contains(&e.as_str())) {
        return Err(missing_surface(source, extension));
    }
    // The validator calls such a document damaged.
    if root.meshes.iter().flat_map(|mesh| &mesh.primitives).any(|primitive| is_compressed_alone(&root, primitive)) {
        return Err(missing_surface(source, DRACO));
    }
    root.extensions_required.retain(|e| {
        let is_harmless = HARMLESS_EXTENSIONS.contains(&e.as_str()) || UNREAD_IMAGES.contains(&e.as_str());
        !is_harmless
    });
    // The validator looks up positions without checking their accessor, and insists on bounds that nothing here needs.
    for (number, mesh) in root.meshes.iter().enumerate() {
        for (_, accessor) in mesh.primitives.iter().flat_map(|p| &p.attributes) {
            let Some(accessor) = root.accessors.get_mut(accessor.value()) else {
                let problem = format!(
                    "uses accessor {}, but there are {}; export the file again",
                    accessor.value(),
                    root.accessors.len()
                );
                return Err(source.syntax(Location::Item("mesh", number as u64), problem));
            };
            let zeros = || Some(vec![0.0f32; 3].into());
            accessor.min = accessor.min.take().or_else(zeros);
            accessor.max = accessor.max.take().or_else(zeros);
        }
    }
    Document::from_json(root).map_err(|error| {
        let problem = match error {
            ::gltf::Error::Validation(problems) => {
                let (path, problem) =
                    problems.into_iter().next().map_or_else(Default::default, |(p, e)| (p.to_string(), e.to_string()));
                format!("not valid glTF: {path}: {problem}; export the file again")
            }
            other => format!("not valid glTF: {other}; export the file again"),
        };
        source.syntax(Location::Byte(0), problem)
    })
}

/// Refuses documents of versions other than 2, which have other fields. Text that is not JSON is left to the parser.
fn check_version(source: &Source, json: &[u8]) -> Parsed<()> {
    #[derive(serde::Deserialize)]
    struct Head {
        asset: Asset,
    }
    #[derive(serde::Deserialize)]
    #[serde(rename_all = "camelCase")]
    struct Asset {
        version: Option<String>,
        min_version: Option<String>,
    }
    let Ok(Head { asset }) = serde_json::from_slice(json) else { return Ok(()) };
    let is_known = |version: &String| version.split('.').next() == Some("2");
    let needs_more = asset.min_version.filter(|least| least != "2.0");
    match needs_more.or(asset.version.filter(|version| !is_known(version))) {
        Some(version) => Err(source.unsupported(format!("glTF version {version}"), "convert it to glTF 2.0")),
        None => Ok(()),
    }
}
