//! Materials, textures and images of a glTF document.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use ::gltf::material::AlphaMode as GltfAlpha;
use ::gltf::texture::{Info, MagFilter, Texture, TextureTransform, WrappingMode};
use ::gltf::{Document, Material as GltfMaterial};

use super::buffers::{Buffers, decode_percent, has_scheme};
use crate::import::attributes::AttributeSink;
use crate::import::beside::{Beside, not_beside};
use crate::import::error::Parsed;
use crate::import::source::Source;
use crate::import::textures::Causes;
use crate::mesh::appearance::{AlphaMode, Material, TextureUse, Wrap};
use crate::mesh::images::ImageSource;

/// The materials of a document among those of the input.
#[derive(Default)]
pub(super) struct Materials {
    /// The number of the first one; none where colours are not wanted.
    first: Option<usize>,
    /// The sets of texture coordinates that they use, ascending.
    pub(super) uv_sets: Vec<u32>,
    /// Whether each has an image of normals.
    with_normals: Vec<bool>,
    /// The sets of texture coordinates that the textures of each need.
    needed_sets: Vec<BTreeSet<u32>>,
}

impl Materials {
    /// Adds all materials of a document.
    pub(super) fn read(
        source: &Source,
        document: &Document,
        buffers: &Buffers,
        sink: &mut AttributeSink,
    ) -> Parsed<Self> {
        if !sink.wants_materials() {
            return Ok(Self::default());
        }
        let mut uv_sets: Vec<u32> = document.materials().flat_map(|material| sets_of(&material)).collect();
        uv_sets.sort_unstable();
        uv_sets.dedup();
        // Records have room for as many sets as an input can need.
        uv_sets.truncate(MAX_UV_SETS);
        let mut reader = MaterialReader {
            source,
            document,
            buffers,
            sink,
            uv_sets: &uv_sets,
            images: HashMap::new(),
            noted: BTreeSet::new(),
            causes: Causes::default(),
        };
        let materials: Vec<Material> = document.materials().map(|material| reader.material(&material)).collect();
        reader.causes.sentences().for_each(|sentence| source.note(&sentence));
        let with_normals = materials.iter().map(|material| material.normal_texture.is_some()).collect();
        let sets_of = |material: &Material| material.textures().map(|of| uv_sets[usize::from(of.uv_set)]).collect();
        let needed_sets = materials.iter().map(sets_of).collect();
        Ok(Self { first: Some(sink.add_materials(materials)?), uv_sets, with_normals, needed_sets })
    }

    /// Whether one of them has an image of normals.
    pub(super) fn has_normals(&self) -> bool {
        self.with_normals.contains(&true)
    }

    /// The sets of texture coordinates that the textures of a material need.
    pub(super) fn sets_needed_by(&self, material: &GltfMaterial) -> impl Iterator<Item = u32> {
        material.index().and_then(|index| self.needed_sets.get(index)).into_iter().flatten().copied()
    }

    /// Whether a material has an image of normals.
    pub(super) fn has_normals_of(&self, material: &GltfMaterial) -> bool {
        material.index().and_then(|index| self.with_normals.get(index)).copied().unwrap_or(false)
    }

    /// The number of a primitive's material; 0 where it has none.
    pub(super) fn number_of(&self, material: &GltfMaterial) -> usize {
        self.first.zip(material.index()).map_or(0, |(first, index)| first + index)
    }
}

/// The most sets of texture coordinates that are read.
const MAX_UV_SETS: usize = 8;

/// The texture of the base colour, in either of the two models of materials.
fn base_texture<'a>(material: &GltfMaterial<'a>) -> Option<Info<'a>> {
    match material.pbr_specular_glossiness() {
        Some(other) => other.diffuse_texture(),
        None => material.pbr_metallic_roughness().base_color_texture(),
    }
}

fn uv_set(texture: &Info) -> u32 {
    texture.texture_transform().and_then(|transform| transform.tex_coord()).unwrap_or(texture.tex_coord())
}

/// The sets of texture coordinates that a material uses.
fn sets_of(material: &GltfMaterial) -> Vec<u32> {
    let metallic = material.pbr_metallic_roughness();
    let colours = [base_texture(material), metallic.metallic_roughness_texture(), material.emissive_texture()];
    let others = [
        material.normal_texture().map(|texture| texture.tex_coord()),
        material.occlusion_texture().map(|texture| texture.tex_coord()),
    ];
    colours.iter().flatten().map(uv_set).chain(others.into_iter().flatten()).collect()
}

/// Extensions that give a texture an image of a format that is not read.
pub(super) const UNREAD_IMAGES: [&str; 3] = ["KHR_texture_basisu", "MSFT_texture_dds", "EXT_texture_avif"];

/// What becomes of a material whose texture cannot be used.
const FACTOR_ALONE: &str = "its material has its factor alone";

struct MaterialReader<'a> {
    source: &'a Source<'a>,
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    sink: &'a mut AttributeSink,
    uv_sets: &'a [u32],
    /// The numbers of the document's images among those of the input; none of those that cannot be used.
    images: HashMap<usize, Option<u32>>,
    /// Textures of which something was noted. Several maps may use them.
    noted: BTreeSet<usize>,
    causes: Causes,
}

impl MaterialReader<'_> {
    fn material(&mut self, material: &GltfMaterial) -> Material {
        let metallic = material.pbr_metallic_roughness();
        let is_other = material.unlit() || material.pbr_specular_glossiness().is_some();
        let base = material.pbr_specular_glossiness().map_or(metallic.base_color_factor(), |m| m.diffuse_factor());
        Material {
            name: material.name().unwrap_or_default().to_owned(),
            base_colour: base.map(|factor| if factor.is_finite() { factor.clamp(0.0, 1.0) } else { 1.0 }),
            opacity_texture: None,
            has_object_normals: false,
            base_texture: base_texture(material).and_then(|texture| self.texture(&texture)),
            normal_texture: material.normal_texture().and_then(|info| {
                let transform = transform_of(info.extension_value("KHR_texture_transform"));
                Some((self.image_use(&info.texture(), info.tex_coord(), transform)?, info.scale()))
            }),
            emissive: material.emissive_factor().map(|factor| factor * emissive_strength(material)),
            emissive_texture: material.emissive_texture().and_then(|texture| self.texture(&texture)),
            occlusion_texture: material.occlusion_texture().and_then(|info| {
                let transform = transform_of(info.extension_value("KHR_texture_transform"));
                Some((self.image_use(&info.texture(), info.tex_coord(), transform)?, info.strength()))
            }),
            metallic_roughness_texture: metallic
                .metallic_roughness_texture()
                .filter(|_| !is_other)
                .and_then(|texture| self.texture(&texture)),
            metallic_texture: None,
            roughness_texture: None,
            // Materials of other models are no metals: their factors stand at values that nobody chose.
            metallic: if is_other { 0.0 } else { metallic.metallic_factor() },
            roughness: if is_other { 1.0 } else { metallic.roughness_factor() },
            double_sided: material.double_sided(),
            alpha: match material.alpha_mode() {
                GltfAlpha::Opaque => AlphaMode::Opaque,
                GltfAlpha::Mask => AlphaMode::Mask(material.alpha_cutoff().unwrap_or(0.5)),
                GltfAlpha::Blend => AlphaMode::Blend,
            },
            unlit: material.unlit(),
            hides_vertex_colour: false,
        }
    }

    fn texture(&mut self, info: &Info) -> Option<TextureUse> {
        let transform = info.texture_transform().map(|transform| rows(&transform));
        self.image_use(&info.texture(), uv_set(info), transform)
    }

    fn image_use(&mut self, texture: &Texture, set: u32, transform: Option<[f32; 6]>) -> Option<TextureUse> {
        let image = self.image_of(texture)?;
        let Ok(set) = self.uv_sets.binary_search(&set) else {
            self.causes.add("sets", &label_of(texture), |label| {
                format!(
                    "{label} needs TEXCOORD_{set}, but only {MAX_UV_SETS} sets of texture coordinates are read: \
                     {FACTOR_ALONE}; export it with fewer sets"
                )
            });
            return None;
        };
        let sampler = texture.sampler();
        if sampler.mag_filter() == Some(MagFilter::Nearest) && self.noted.insert(texture.index()) {
            self.causes.add("nearest", &label_of(texture), |label| {
                format!("{label} asks for its nearest texel: colours are interpolated between texels here")
            });
        }
        let wrap = |mode: WrappingMode| match mode {
            WrappingMode::Repeat => Wrap::Repeat,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::ClampToEdge => Wrap::Clamp,
        };
        Some(TextureUse { image, uv_set: set as u8, wrap: [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())], transform })
    }

    /// The number of a texture's image: that of the WebP extension where there is one. None, with a note, where it cannot be read.
    fn image_of(&mut self, texture: &Texture) -> Option<u32> {
        let webp = texture.extension_value("EXT_texture_webp").and_then(|extension| extension.get("source")?.as_u64());
        let named = [webp.map(|source| source as usize), texture.source().map(|image| image.index())];
        let image_count = self.document.as_json().images.len();
        let Some(number) = named.into_iter().flatten().find(|&number| number < image_count) else {
            if self.noted.insert(texture.index()) {
                self.note_texture_without_image(texture);
            }
            return None;
        };
        if let Some(known) = self.images.get(&number) {
            return *known;
        }
        let image = self.image(number).map(|image| self.sink.add_image(image));
        self.images.insert(number, image);
        image
    }

    fn note_texture_without_image(&mut self, texture: &Texture) {
        let label = label_of(texture);
        match UNREAD_IMAGES.iter().find(|name| texture.extension_value(name).is_some()) {
            Some(extension) => self.causes.add(extension, &label, |label| {
                format!(
                    "{label} has its image only in the form of {extension}, which is not read: {FACTOR_ALONE}; \
                     convert the image to PNG, JPEG or WebP"
                )
            }),
            None => self.causes.add("none", &label, |label| {
                format!("{label} names no image that is there: {FACTOR_ALONE}; export it again with its images")
            }),
        }
    }

    /// Where an image is; none, with a note, where it cannot be.
    fn image(&mut self, number: usize) -> Option<ImageSource> {
        // The document's own access panics where an image is not described completely.
        let json = self.document.as_json().images.get(number)?;
        let (name, label) = (format!("image {number}"), format!("image {number} of {}", self.source.path.display()));
        if let Some(view) = &json.buffer_view {
            let view = self.document.views().nth(view.value())?;
            let found = self.buffers.image(&view, &label);
            if found.is_none() {
                self.causes.add("beyond", &name, |name| format!("{name} reaches beyond its buffer: it was left out"));
            }
            return found;
        }
        match json.uri.as_deref() {
            Some(uri) if uri.starts_with("data:") => {
                let decoded = ::gltf::buffer::Data::from_source(::gltf::buffer::Source::Uri(uri), None);
                if decoded.is_err() {
                    let sentence = |name: &str| format!("{name} has a data URI that is not base64: it was left out");
                    self.causes.add("base64", &name, sentence);
                }
                decoded.ok().map(|data| ImageSource::Inline { name: label, bytes: data.0 })
            }
            Some(uri) if has_scheme(uri) => {
                self.causes.add("remote", uri, |uri| {
                    format!("the image {uri} is not a file beside the model: it was left out; download it")
                });
                None
            }
            Some(uri) => {
                // What is no text when it is decoded may be the name as it is.
                let name = decode_percent(uri).unwrap_or(Cow::Borrowed(uri));
                let path = Beside::new(self.source).path(name.as_bytes());
                if path.is_none() {
                    self.causes.add("outside", name.trim(), |name| not_beside("image", name));
                }
                Some(ImageSource::File { path: path?, range: None })
            }
            None => {
                let sentence = |name: &str| format!("{name} has neither a name nor bytes: it was left out");
                self.causes.add("nothing", &name, sentence);
                None
            }
        }
    }
}

/// The name of a texture in messages.
fn label_of(texture: &Texture) -> String {
    match texture.name().filter(|name| !name.is_empty()) {
        Some(name) => format!("texture {} ({name})", texture.index()),
        None => format!("texture {}", texture.index()),
    }
}

/// By how much emitted light is brighter than its factor (`KHR_materials_emissive_strength`).
fn emissive_strength(material: &GltfMaterial) -> f32 {
    let strength = material.extension_value("KHR_materials_emissive_strength");
    let strength = strength.and_then(|extension| extension.get("emissiveStrength")?.as_f64()).unwrap_or(1.0);
    if strength.is_finite() { strength.max(0.0) as f32 } else { 1.0 }
}

/// The rows of a texture transform (`KHR_texture_transform`).
fn rows(transform: &TextureTransform) -> [f32; 6] {
    affine(transform.offset(), transform.scale(), transform.rotation())
}

/// The rows of a texture transform that the `gltf` crate does not read: those of images of normals and of occlusion.
fn transform_of(extension: Option<&serde_json::Value>) -> Option<[f32; 6]> {
    let pair = |name: &str, default: f32| {
        let values = extension?.get(name).and_then(|values| values.as_array());
        let value = |k: usize| values.and_then(|values| values.get(k)?.as_f64()).map_or(default, |value| value as f32);
        Some([value(0), value(1)])
    };
    let rotation = extension?.get("rotation").and_then(|value| value.as_f64()).unwrap_or(0.0);
    Some(affine(pair("offset", 0.0)?, pair("scale", 1.0)?, rotation as f32))
}

/// Scaled, turned, moved.
fn affine([x, y]: [f32; 2], [width, height]: [f32; 2], rotation: f32) -> [f32; 6] {
    let [sine, cosine] = sine_and_cosine(f64::from(rotation));
    let of = |factor: f64, scale: f32| (factor * f64::from(scale)) as f32;
    [of(cosine, width), of(sine, height), x, of(-sine, width), of(cosine, height), y]
}

/// By their series, so that all machines get the same bits.
fn sine_and_cosine(angle: f64) -> [f64; 2] {
    let angle = if angle.is_finite() { angle % std::f64::consts::TAU } else { 0.0 };
    let (mut sums, mut term) = ([0.0, 0.0], 1.0);
    for power in 0..48 {
        // The terms of 1, x, -x^2/2, -x^3/6, ...
        sums[1 - power % 2] += if power % 4 < 2 { term } else { -term };
        term *= angle / (power + 1) as f64;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::disallowed_methods, reason = "the functions are what the series are compared with")]
    fn series_agree_with_the_functions() {
        for i in -100..100 {
            let angle = f64::from(i) * 0.17;
            let [sine, cosine] = sine_and_cosine(angle);
            assert!((sine - angle.sin()).abs() < 1e-11 && (cosine - angle.cos()).abs() < 1e-11, "{angle}");
        }
        assert_eq!(sine_and_cosine(f64::NAN), [0.0, 1.0]);
    }
}
