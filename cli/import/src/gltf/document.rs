//! The JSON of a document: what of it is read, with numbers as doubles, as JSON has them.
//!
//! Only what an import needs has a field, so that nothing else can make a document unreadable: custom attributes,
//! animations, cameras and unknown extensions may be whatever they are, and so may `extras`, of which an id is read.
//! [`super::fields`] says how values are read, [`super::node_list`] and [`super::material_fields`] have the types of
//! nodes and of materials.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny};

use super::fields::{Computed, Index, Size, Weights};
use super::material_fields::{Image, Material, Sampler, Texture};
use super::node_list::Nodes;
use crate::error::{Location, Parsed};
use crate::source::Source;

/// A document, as far as it is read (glTF 2.0, chapter 5).
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    asset: Asset,
    pub(super) scene: Option<Index>,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Nodes,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<View>,
    pub(super) buffers: Vec<Buffer>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) images: Vec<Image>,
    pub(super) samplers: Vec<Sampler>,
    pub(super) skins: Vec<Skin>,
    pub(super) extensions_required: Vec<String>,
    pub(super) extensions: Option<DocumentExtensions>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Asset {
    version: Option<String>,
    min_version: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct DocumentExtensions {
    #[serde(rename = "CESIUM_RTC")]
    pub(super) relative_to_centre: Option<RelativeToCentre>,
}

/// `CESIUM_RTC`.
#[derive(Deserialize)]
pub(super) struct RelativeToCentre {
    pub(super) center: [f64; 3],
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Scene {
    pub(super) nodes: Box<[Index]>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Skin {
    pub(super) joints: Box<[Index]>,
    pub(super) inverse_bind_matrices: Option<Index>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Mesh {
    pub(super) primitives: Box<[Primitive]>,
    pub(super) weights: Option<Weights>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: Option<Index>,
    pub(super) material: Option<Index>,
    pub(super) mode: Option<Index>,
    pub(super) targets: Box<[IgnoredAny]>,
    pub(super) extensions: Option<Box<PrimitiveExtensions>>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<Draco>,
}

/// `KHR_draco_mesh_compression`.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Draco {
    pub(super) buffer_view: Index,
    pub(super) attributes: BTreeMap<String, Index>,
}

/// How the indices of a primitive form triangles.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Mode {
    Triangles,
    Strip,
    Fan,
}

impl Primitive {
    /// The accessors that it names.
    pub(super) fn accessors(&self) -> impl Iterator<Item = usize> {
        self.attributes.accessors().chain(self.indices.map(usize::from))
    }

    /// None if it has no triangles.
    pub(super) fn mode(&self) -> Option<Mode> {
        match self.mode.map_or(4, usize::from) {
            4 => Some(Mode::Triangles),
            5 => Some(Mode::Strip),
            6 => Some(Mode::Fan),
            _ => None,
        }
    }
}

/// What an attribute means to an import.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Semantic {
    Position,
    Normal,
    Tangent,
    Colour(u32),
    TexCoord(u32),
    Joints(u32),
    Weights(u32),
}

impl Semantic {
    /// None for custom attributes.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        Some(match name {
            "POSITION" => Self::Position,
            "NORMAL" => Self::Normal,
            "TANGENT" => Self::Tangent,
            _ => match name.split_once('_')? {
                ("COLOR", set) => Self::Colour(set.parse().ok()?),
                ("TEXCOORD", set) => Self::TexCoord(set.parse().ok()?),
                ("JOINTS", set) => Self::Joints(set.parse().ok()?),
                ("WEIGHTS", set) => Self::Weights(set.parse().ok()?),
                _ => return None,
            },
        })
    }
}

/// The accessors of a primitive's attributes.
#[derive(Default)]
pub(super) struct Attributes {
    list: Box<[(Semantic, Index)]>,
    /// Whether there are some of names that begin with an underscore.
    pub(super) has_custom: bool,
}

impl Attributes {
    pub(super) fn get(&self, semantic: Semantic) -> Option<usize> {
        self.list.iter().find(|(known, _)| *known == semantic).map(|(_, accessor)| usize::from(*accessor))
    }

    /// All accessors, for those who look for many.
    pub(super) fn by_semantic(&self) -> BTreeMap<Semantic, usize> {
        // Of two spellings the first one counts, as above.
        self.list.iter().rev().map(|(semantic, accessor)| (*semantic, usize::from(*accessor))).collect()
    }

    pub(super) fn semantics(&self) -> impl Iterator<Item = Semantic> {
        self.list.iter().map(|(semantic, _)| *semantic)
    }

    fn accessors(&self) -> impl Iterator<Item = usize> {
        self.list.iter().map(|(_, accessor)| usize::from(*accessor))
    }
}

impl<'de> Deserialize<'de> for Attributes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (mut list, mut has_custom) = (vec![], false);
        for (name, accessor) in BTreeMap::<String, Index>::deserialize(deserializer)? {
            has_custom |= name.starts_with('_');
            list.extend(Semantic::of_name(&name).map(|semantic| (semantic, accessor)));
        }
        Ok(Self { list: list.into(), has_custom })
    }
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<Index>,
    pub(super) byte_offset: Size,
    pub(super) component_type: Index,
    pub(super) normalized: bool,
    pub(super) count: Size,
    #[serde(rename = "type")]
    pub(super) dimensions: Dimensions,
    pub(super) sparse: Option<Box<Sparse>>,
    #[serde(rename = "name")]
    pub(super) is_computed: Computed,
}

/// The shape of an accessor's items. Smaller matrices are nowhere read.
#[derive(Clone, Copy, Default, PartialEq, Eq, Deserialize)]
pub(super) enum Dimensions {
    #[serde(rename = "SCALAR")]
    Scalar,
    #[serde(rename = "VEC2")]
    Vec2,
    #[serde(rename = "VEC3")]
    Vec3,
    #[serde(rename = "VEC4")]
    Vec4,
    #[serde(rename = "MAT4")]
    Mat4,
    #[default]
    #[serde(other)]
    Other,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Sparse {
    pub(super) count: Size,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: Index,
    pub(super) byte_offset: Size,
    pub(super) component_type: Index,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: Index,
    pub(super) byte_offset: Size,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct View {
    pub(super) buffer: Index,
    pub(super) byte_offset: Size,
    pub(super) byte_length: Size,
    pub(super) byte_stride: Option<Size>,
    pub(super) extensions: Option<Box<ViewExtensions>>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext_meshopt: Option<Compressed>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr_meshopt: Option<Compressed>,
}

impl View {
    /// How its bytes are compressed, if they are.
    pub(super) fn compressed(&self) -> Option<&Compressed> {
        let extensions = self.extensions.as_deref()?;
        extensions.khr_meshopt.as_ref().or(extensions.ext_meshopt.as_ref())
    }
}

/// `EXT_meshopt_compression` and `KHR_meshopt_compression` of a view.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Compressed {
    pub(super) buffer: Index,
    pub(super) byte_offset: Size,
    pub(super) byte_length: Size,
    pub(super) byte_stride: Size,
    pub(super) count: Size,
    pub(super) mode: String,
    pub(super) filter: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: Size,
    uri: Option<String>,
    pub(super) extensions: Option<Box<BufferExtensions>>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    ext_meshopt: Option<Fallback>,
    #[serde(rename = "KHR_meshopt_compression")]
    khr_meshopt: Option<Fallback>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Fallback {
    fallback: bool,
}

impl Buffer {
    /// Whether its bytes are only for programs that cannot decompress; they may be nowhere.
    pub(super) fn is_fallback(&self) -> bool {
        let of = |extensions: &BufferExtensions| {
            [&extensions.ext_meshopt, &extensions.khr_meshopt].into_iter().flatten().any(|of| of.fallback)
        };
        self.extensions.as_deref().is_some_and(of)
    }
}

impl Document {
    /// Takes the names of all buffers, which hold the bytes themselves where they are embedded.
    pub(super) fn take_uris(&mut self) -> Vec<Option<String>> {
        self.buffers.iter_mut().map(|buffer| buffer.uri.take()).collect()
    }

    /// Whether the bytes of a buffer are only for programs that cannot decompress.
    pub(super) fn is_fallback(&self, buffer: usize) -> bool {
        self.buffers.get(buffer).is_some_and(Buffer::is_fallback)
    }
}

/// Parses the JSON, which begins at a byte of the file.
pub(super) fn parse_document(source: &Source, json: &[u8], start: usize) -> Parsed<Document> {
    let document: Document = serde_json::from_slice(json).map_err(|error| {
        // Binary files have all of it in one line.
        let line_start = json.split_inclusive(|&byte| byte == b'\n').take(error.line().saturating_sub(1));
        let offset = line_start.map(<[u8]>::len).sum::<usize>() + error.column().saturating_sub(1);
        let location = match start {
            0 => Location::Line(error.line() as u64),
            _ => Location::Byte((start + offset) as u64),
        };
        if error.is_eof() {
            return source.truncated(location, "the JSON text has no end");
        }
        source.syntax(location, format!("not valid glTF JSON: {error}; the file is damaged"))
    })?;
    check_version(source, &document.asset)?;
    Ok(document)
}

/// Refuses documents of versions other than 2, which have other fields.
fn check_version(source: &Source, asset: &Asset) -> Parsed<()> {
    let Some(version) = &asset.version else {
        let problem = "has no asset.version, which says how it is to be read; the file is damaged";
        return Err(source.syntax(Location::Byte(0), problem));
    };
    let needs_more = asset.min_version.as_ref().filter(|least| *least != "2.0");
    match needs_more.or(Some(version).filter(|version| version.split('.').next() != Some("2"))) {
        Some(version) => Err(source.unsupported(format!("glTF version {version}"), "convert it to glTF 2.0")),
        None => Ok(()),
    }
}
