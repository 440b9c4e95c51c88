//! What the JSON says of materials, textures and images.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, Error, IgnoredAny, MapAccess, Visitor};

use super::fields::{Index, Whole};

/// The extension of images that are WebP.
pub(super) const WEBP: &str = "EXT_texture_webp";

/// Extensions that give a texture an image of a format that is not read.
pub(super) const UNREAD_IMAGES: [&str; 3] = ["KHR_texture_basisu", "MSFT_texture_dds", "EXT_texture_avif"];

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
