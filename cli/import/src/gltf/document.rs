//! The JSON of a document: what of it is read, with numbers as doubles, as JSON has them.
//!
//! Only what an import needs has a field, so that nothing else can make a document unreadable: custom attributes,
//! animations, cameras and unknown extensions may be whatever they are, and so may `extras`, of which an id is read. It
//! is long because every object of the format has its type here, with what it is where it is not stated.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};

use crate::error::{Location, Parsed};
use crate::source::Source;
use lodpack_mesh::smooth::COMPUTED;

/// The extension of images that are WebP.
pub(super) const WEBP: &str = "EXT_texture_webp";

/// Extensions that give a texture an image of a format that is not read.
pub(super) const UNREAD_IMAGES: [&str; 3] = ["KHR_texture_basisu", "MSFT_texture_dds", "EXT_texture_avif"];

/// A document, as far as it is read (glTF 2.0, chapter 5).
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Document {
    asset: Asset,
    pub(super) scene: Option<Index>,
    pub(super) scenes: Vec<Scene>,
    pub(super) nodes: Vec<Node>,
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

/// A node. Documents can have a million of them, so lists and what is rare are boxed.
#[derive(Deserialize)]
#[serde(default)]
pub(super) struct Node {
    pub(super) children: Box<[Index]>,
    pub(super) mesh: Option<Index>,
    pub(super) skin: Option<Index>,
    pub(super) weights: Option<Weights>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: [f64; 3],
    pub(super) rotation: [f64; 4],
    pub(super) scale: [f64; 3],
    pub(super) name: Name,
    #[serde(rename = "extras")]
    pub(super) id: Id,
    pub(super) extensions: Option<Box<NodeExtensions>>,
}

impl Default for Node {
    fn default() -> Self {
        Self {
            children: Box::default(),
            mesh: None,
            skin: None,
            weights: None,
            matrix: None,
            translation: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
            scale: [1.0; 3],
            name: Name(None),
            id: Id(None),
            extensions: None,
        }
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instances: Option<Instances>,
    #[serde(rename = "KHR_node_visibility")]
    pub(super) visibility: Option<Visibility>,
}

/// `EXT_mesh_gpu_instancing`: accessors by name.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Instances {
    pub(super) attributes: BTreeMap<String, Index>,
}

/// `KHR_node_visibility`.
#[derive(Deserialize)]
#[serde(default)]
pub(super) struct Visibility {
    pub(super) visible: bool,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { visible: true }
    }
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

#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) name: Option<String>,
    pub(super) pbr_metallic_roughness: MetallicRoughness,
    pub(super) normal_texture: Option<TextureInfo>,
    pub(super) occlusion_texture: Option<TextureInfo>,
    pub(super) emissive_texture: Option<TextureInfo>,
    pub(super) emissive_factor: [f64; 3],
    pub(super) alpha_mode: Option<String>,
    pub(super) alpha_cutoff: f64,
    pub(super) double_sided: bool,
    pub(super) extensions: MaterialExtensions,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            name: None,
            pbr_metallic_roughness: MetallicRoughness::default(),
            normal_texture: None,
            occlusion_texture: None,
            emissive_texture: None,
            emissive_factor: [0.0; 3],
            alpha_mode: None,
            alpha_cutoff: 0.5,
            double_sided: false,
            extensions: MaterialExtensions::default(),
        }
    }
}

#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct MetallicRoughness {
    pub(super) base_color_factor: [f64; 4],
    pub(super) base_color_texture: Option<TextureInfo>,
    pub(super) metallic_factor: f64,
    pub(super) roughness_factor: f64,
    pub(super) metallic_roughness_texture: Option<TextureInfo>,
}

impl Default for MetallicRoughness {
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            base_color_texture: None,
            metallic_factor: 1.0,
            roughness_factor: 1.0,
            metallic_roughness_texture: None,
        }
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    pub(super) unlit: Option<IgnoredAny>,
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub(super) specular_glossiness: Option<SpecularGlossiness>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub(super) emissive_strength: Option<EmissiveStrength>,
}

/// `KHR_materials_pbrSpecularGlossiness`: its diffuse colour alone.
#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SpecularGlossiness {
    pub(super) diffuse_factor: [f64; 4],
    pub(super) diffuse_texture: Option<TextureInfo>,
}

impl Default for SpecularGlossiness {
    fn default() -> Self {
        Self { diffuse_factor: [1.0; 4], diffuse_texture: None }
    }
}

/// `KHR_materials_emissive_strength`.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct EmissiveStrength {
    pub(super) emissive_strength: Option<f64>,
}

/// How a material uses a texture.
#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub(super) index: Index,
    tex_coord: Index,
    /// Of normals.
    pub(super) scale: f64,
    /// Of occlusion.
    pub(super) strength: f64,
    extensions: TextureInfoExtensions,
}

impl Default for TextureInfo {
    fn default() -> Self {
        let (scale, strength) = (1.0, 1.0);
        Self { index: Whole(0), tex_coord: Whole(0), scale, strength, extensions: TextureInfoExtensions::default() }
    }
}

impl TextureInfo {
    /// The set of texture coordinates: that of the transform where it names one, whichever map it is.
    pub(super) fn uv_set(&self) -> u32 {
        self.transform().and_then(|transform| transform.tex_coord).unwrap_or(self.tex_coord).0
    }

    pub(super) fn transform(&self) -> Option<&TextureTransform> {
        self.extensions.transform.as_ref()
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    transform: Option<TextureTransform>,
}

/// `KHR_texture_transform`.
#[derive(Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub(super) offset: [f64; 2],
    pub(super) rotation: f64,
    pub(super) scale: [f64; 2],
    tex_coord: Option<Index>,
}

impl Default for TextureTransform {
    fn default() -> Self {
        Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2], tex_coord: None }
    }
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Texture {
    pub(super) name: Option<String>,
    pub(super) sampler: Option<Index>,
    pub(super) source: Option<Index>,
    /// Images of other formats, by the extension that has them.
    #[serde(deserialize_with = "image_sources")]
    pub(super) extensions: BTreeMap<String, Option<Index>>,
}

/// Which image each extension names; none where it names none.
fn image_sources<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, Option<Index>>, D::Error> {
    struct Of;
    impl<'de> Visitor<'de> for Of {
        type Value = BTreeMap<String, Option<Index>>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("an object of extensions")
        }

        fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
            Ok(BTreeMap::new())
        }

        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            #[derive(Deserialize)]
            struct Extension {
                source: Option<Index>,
            }
            let mut sources = BTreeMap::new();
            while let Some(name) = map.next_key::<String>()? {
                if name == WEBP || UNREAD_IMAGES.contains(&name.as_str()) {
                    sources.insert(name, map.next_value::<Extension>()?.source);
                } else {
                    map.next_value::<IgnoredAny>()?;
                }
            }
            Ok(sources)
        }
    }
    deserializer.deserialize_any(Of)
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<Index>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sampler {
    pub(super) mag_filter: Option<Index>,
    pub(super) wrap_s: Option<Index>,
    pub(super) wrap_t: Option<Index>,
}

/// The number of an item of a list.
pub(super) type Index = Whole<u32>;
/// A count, or a number of bytes.
pub(super) type Size = Whole<u64>;

/// A whole number, which JSON may write as 2.0 or 2e0 (glTF 2.0, section 2.7).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Whole<T>(pub(super) T);

impl From<Index> for usize {
    fn from(Whole(number): Index) -> usize {
        number as usize
    }
}

impl From<Size> for usize {
    /// What does not fit lies beyond every buffer, and so does the largest number.
    fn from(Whole(number): Size) -> usize {
        usize::try_from(number).unwrap_or(usize::MAX)
    }
}

impl<'de, T: TryFrom<u64>> Deserialize<'de> for Whole<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Of<T>(PhantomData<T>);
        impl<T: TryFrom<u64>> Visitor<'_> for Of<T> {
            type Value = Whole<T>;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a whole number from 0 on")
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Whole<T>, E> {
                T::try_from(number).map(Whole).map_err(|_| E::invalid_value(Unexpected::Unsigned(number), &self))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Whole<T>, E> {
                const MOST: f64 = (1u64 << 53) as f64;
                if (0.0..=MOST).contains(&number) && number.fract() == 0.0 {
                    return self.visit_u64(number as u64);
                }
                Err(E::invalid_value(Unexpected::Float(number), &self))
            }
        }
        deserializer.deserialize_any(Of(PhantomData))
    }
}

/// A name that is not empty, if there is one.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Name(pub(super) Option<Box<str>>);

/// What `extras` say by which other programs know a node: the text or the number of [`ID_KEYS`].
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Id(pub(super) Option<Box<str>>);

/// Keys of ids in `extras`, in any case; the first one that is there counts.
const ID_KEYS: [&str; 3] = ["id", "GlobalId", "guid"];

/// Whether a name says that the values were computed.
#[derive(Clone, Copy, Default)]
pub(super) struct Computed(pub(super) bool);

/// What a name says.
struct Names<F>(F);

impl<'de, T, F: FnOnce(&str) -> T> Visitor<'de> for Names<F> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a name")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<T, E> {
        Ok((self.0)(name))
    }

    fn visit_unit<E: Error>(self) -> Result<T, E> {
        Ok((self.0)(""))
    }
}

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Names(|name: &str| Name(not_empty(name))))
    }
}

fn not_empty(text: &str) -> Option<Box<str>> {
    (!text.is_empty()).then(|| text.into())
}

impl<'de> Deserialize<'de> for Id {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Extras;
        impl<'de> Visitor<'de> for Extras {
            type Value = Id;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("anything")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Id, A::Error> {
                let mut found: Option<(usize, Box<str>)> = None;
                while let Some(key) = map.next_key::<String>()? {
                    let Some(place) = ID_KEYS.iter().position(|known| known.eq_ignore_ascii_case(&key)) else {
                        map.next_value::<IgnoredAny>()?;
                        continue;
                    };
                    let text = map.next_value::<Text>()?.0;
                    if found.as_ref().is_none_or(|(before, _)| place < *before) {
                        found = text.map(|text| (place, text)).or(found);
                    }
                }
                Ok(Id(found.map(|(_, text)| text)))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Id, A::Error> {
                while list.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Id(None))
            }

            fn visit_bool<E: Error>(self, _: bool) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_i64<E: Error>(self, _: i64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_u64<E: Error>(self, _: u64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_f64<E: Error>(self, _: f64) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_str<E: Error>(self, _: &str) -> Result<Id, E> {
                Ok(Id(None))
            }

            fn visit_unit<E: Error>(self) -> Result<Id, E> {
                Ok(Id(None))
            }
        }
        deserializer.deserialize_any(Extras)
    }
}

/// A text that is not empty, or a number as text; nothing for all else.
struct Text(Option<Box<str>>);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Any;
        impl<'de> Visitor<'de> for Any {
            type Value = Text;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("anything")
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Text, E> {
                Ok(Text(not_empty(text)))
            }

            fn visit_i64<E: Error>(self, number: i64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_u64<E: Error>(self, number: u64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_f64<E: Error>(self, number: f64) -> Result<Text, E> {
                Ok(Text(Some(number.to_string().into())))
            }

            fn visit_bool<E: Error>(self, _: bool) -> Result<Text, E> {
                Ok(Text(None))
            }

            fn visit_unit<E: Error>(self) -> Result<Text, E> {
                Ok(Text(None))
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Text, A::Error> {
                while list.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Text(None))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Text, A::Error> {
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(Text(None))
            }
        }
        deserializer.deserialize_any(Any)
    }
}

impl<'de> Deserialize<'de> for Computed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Names(|name: &str| Computed(name == COMPUTED)))
    }
}

/// The weights of morph targets.
pub(super) struct Weights {
    /// Whether one of them is not 0.
    pub(super) are_set: bool,
}

impl<'de> Deserialize<'de> for Weights {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Numbers;
        impl<'de> Visitor<'de> for Numbers {
            type Value = Weights;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a list of numbers")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut numbers: A) -> Result<Weights, A::Error> {
                let mut are_set = false;
                while let Some(weight) = numbers.next_element::<f64>()? {
                    are_set |= weight != 0.0;
                }
                Ok(Weights { are_set })
            }
        }
        deserializer.deserialize_seq(Numbers)
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

/// A number of bytes; none if they are negligible.
pub(super) fn unless_negligible(bytes: u64) -> u64 {
    const NEGLIGIBLE: u64 = 4 << 20;
    if bytes > NEGLIGIBLE { bytes } else { 0 }
}

/// An upper bound on the memory for the document and its embedded buffers; none if it is negligible.
pub(super) fn document_bytes(json: &[u8]) -> u64 {
    // The text itself, its strings, and the buffers decoded from them.
    const PER_BYTE: u64 = 4;
    // Nodes and materials, whose lists are copied when they grow, and the list of open nodes.
    const PER_OBJECT: u64 = 384;
    const PER_COMMA: u64 = 64;
    let count = |letter: u8| json.iter().filter(|&&b| b == letter).count() as u64;
    unless_negligible(PER_BYTE * json.len() as u64 + PER_OBJECT * count(b'{') + PER_COMMA * count(b','))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_may_be_written_as_any_number_of_that_value() {
        let read = |text: &str| serde_json::from_str::<Index>(text).ok().map(|number| number.0);
        for (text, expected) in [("2", 2), ("2.0", 2), ("2e0", 2), ("4294967295", u32::MAX), ("-0.0", 0)] {
            assert_eq!(read(text), Some(expected), "{text}");
        }
        for text in ["2.5", "-1", "4294967296", "1e300", "\"2\"", "null"] {
            assert_eq!(read(text), None, "{text}");
        }
    }

    #[test]
    fn ids_are_texts_or_numbers_and_extras_may_be_anything() {
        let read = |extras: &str| {
            let node: Node = serde_json::from_str(&format!(r#"{{"extras": {extras}, "mesh": 3}}"#)).unwrap();
            assert_eq!(node.mesh, Some(Whole(3)), "{extras}");
            node.id.0
        };
        for (extras, id) in [
            (r#"{"id": "a", "x": [1]}"#, "a"),
            (r#"{"guid": "g", "GLOBALID": "b", "Id": "a"}"#, "a"),
            (r#"{"guid": "g", "globalId": "b"}"#, "b"),
            (r#"{"GUID": "g", "id": null}"#, "g"),
            (r#"{"id": 18446744073709551615}"#, "18446744073709551615"),
            (r#"{"id": -7}"#, "-7"),
            (r#"{"id": 1.5, "guid": {"id": [2]}}"#, "1.5"),
        ] {
            assert_eq!(read(extras).as_deref(), Some(id), "{extras}");
        }
        for extras in ["0", "-1", "1.5", "null", "true", r#""id""#, "[]", r#"[{"id": 1}]"#, "{}", r#"{"id": {}}"#] {
            assert_eq!(read(extras), None, "{extras}");
        }
    }

    #[test]
    fn a_node_takes_less_than_is_counted_for_it() {
        // Twice, as the list is copied when it grows, and with a matrix once.
        assert!(2 * size_of::<Node>() + size_of::<[f64; 16]>() <= 384 + 7 * 64, "{}", size_of::<Node>());
        assert!(2 * size_of::<Node>() <= 384, "{}", size_of::<Node>());
    }
}
