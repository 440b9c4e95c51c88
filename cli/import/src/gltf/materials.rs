//! Materials, textures and images of a glTF document.

use std::borrow::Cow;
use std::collections::{BTreeSet, HashMap};

use super::buffers::{Buffers, decode_data_uri, decode_percent, has_scheme};
use super::document::Document;
use super::fields::Index;
use super::material_fields::{Material as GltfMaterial, Texture, TextureInfo, TextureTransform, UNREAD_IMAGES, WEBP};
use crate::attributes::AttributeSink;
use crate::beside::{Beside, not_beside};
use crate::error::Parsed;
use crate::source::Source;
use crate::textures::Causes;
use lodpack_mesh::appearance::{AlphaMode, Material, TextureUse, Wrap};
use lodpack_mesh::images::ImageSource;

/// The materials of a document among those of the input.
#[derive(Default)]
pub(super) struct Materials {
    /// The number of each in the input; none where colours are not wanted. Those that differ in name alone are one:
    /// exporters write one for each of very many objects.
    numbers: Vec<usize>,
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
        let mut uv_sets: Vec<u32> = document.materials.iter().flat_map(sets_of).collect();
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
        let materials: Vec<Material> = document.materials.iter().map(|material| reader.material(material)).collect();
        reader.causes.sentences().for_each(|sentence| source.note(&sentence));
        let with_normals = materials.iter().map(|material| material.normal_texture.is_some()).collect();
        let sets_of = |material: &Material| material.textures().map(|of| uv_sets[usize::from(of.uv_set)]).collect();
        let needed_sets = materials.iter().map(sets_of).collect();
        let (mut different, mut places) = (vec![], HashMap::new());
        let mut place_of = |material: Material| {
            let material = Material { name: String::new(), ..material };
            *places.entry(format!("{material:?}")).or_insert_with(|| {
                different.push(material);
                different.len() - 1
            })
        };
        let places_in_input: Vec<usize> = materials.into_iter().map(&mut place_of).collect();
        let first = sink.add_materials(different)?;
        let numbers = places_in_input.into_iter().map(|place| first + place).collect();
        Ok(Self { numbers, uv_sets, with_normals, needed_sets })
    }

    /// Whether one of them has an image of normals.
    pub(super) fn has_normals(&self) -> bool {
        self.with_normals.contains(&true)
    }

    /// The sets of texture coordinates that the textures of a material need.
    pub(super) fn sets_needed_by(&self, material: Option<Index>) -> impl Iterator<Item = u32> {
        material.and_then(|index| self.needed_sets.get(usize::from(index))).into_iter().flatten().copied()
    }

    /// Whether a material has an image of normals.
    pub(super) fn has_normals_of(&self, material: Option<Index>) -> bool {
        material.and_then(|index| self.with_normals.get(usize::from(index))).copied().unwrap_or(false)
    }

    /// The number of a primitive's material; 0 where it has none, or one that is not there.
    pub(super) fn number_of(&self, material: Option<Index>) -> usize {
        material.and_then(|index| self.numbers.get(usize::from(index))).copied().unwrap_or(0)
    }
}

/// The filter that shows the nearest texel.
const NEAREST: usize = 9728;
/// The most sets of texture coordinates that are read.
const MAX_UV_SETS: usize = 8;

/// The texture of the base colour, in either of the two models of materials.
fn base_texture(material: &GltfMaterial) -> Option<&TextureInfo> {
    match &material.extensions.specular_glossiness {
        Some(other) => other.diffuse_texture.as_ref(),
        None => material.pbr_metallic_roughness.base_color_texture.as_ref(),
    }
}

/// The sets of texture coordinates that a material uses.
fn sets_of(material: &GltfMaterial) -> impl Iterator<Item = u32> {
    let others = [
        &material.pbr_metallic_roughness.metallic_roughness_texture,
        &material.emissive_texture,
        &material.normal_texture,
        &material.occlusion_texture,
    ];
    base_texture(material).into_iter().chain(others.into_iter().flatten()).map(TextureInfo::uv_set)
}

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
        let (metallic, extensions) = (&material.pbr_metallic_roughness, &material.extensions);
        let is_unlit = extensions.unlit.is_some();
        let is_other = is_unlit || extensions.specular_glossiness.is_some();
        let base = extensions.specular_glossiness.as_ref().map_or(metallic.base_color_factor, |of| of.diffuse_factor);
        let mut texture = |info: Option<&TextureInfo>| self.texture(info?);
        Material {
            name: material.name.clone().unwrap_or_default(),
            base_colour: base.map(|factor| factor.clamp(0.0, 1.0) as f32),
            opacity_texture: None,
            has_object_normals: false,
            base_texture: texture(base_texture(material)),
            normal_texture: material
                .normal_texture
                .as_ref()
                .and_then(|info| Some((texture(Some(info))?, info.scale as f32))),
            emissive: material.emissive_factor.map(|factor| factor as f32 * emissive_strength(material)),
            emissive_texture: texture(material.emissive_texture.as_ref()),
            occlusion_texture: material
                .occlusion_texture
                .as_ref()
                .and_then(|info| Some((texture(Some(info))?, info.strength as f32))),
            metallic_roughness_texture: texture(metallic.metallic_roughness_texture.as_ref().filter(|_| !is_other)),
            metallic_texture: None,
            roughness_texture: None,
            // Materials of other models are no metals: their factors stand at values that nobody chose.
            metallic: if is_other { 0.0 } else { metallic.metallic_factor as f32 },
            roughness: if is_other { 1.0 } else { metallic.roughness_factor as f32 },
            double_sided: material.double_sided,
            alpha: match material.alpha_mode.as_deref() {
                Some("MASK") => AlphaMode::Mask(material.alpha_cutoff as f32),
                Some("BLEND") => AlphaMode::Blend,
                _ => AlphaMode::Opaque,
            },
            unlit: is_unlit,
            hides_vertex_colour: false,
        }
    }

    fn texture(&mut self, info: &TextureInfo) -> Option<TextureUse> {
        let (number, set) = (usize::from(info.index), info.uv_set());
        let texture = self.document.textures.get(number);
        let (image, label) = (self.image_of(number, texture)?, label_of(number, texture));
        let Ok(set) = self.uv_sets.binary_search(&set) else {
            self.causes.add("sets", &label, |label| {
                format!(
                    "{label} needs TEXCOORD_{set}, but only {MAX_UV_SETS} sets of texture coordinates are read: \
                     {FACTOR_ALONE}; export it with fewer sets"
                )
            });
            return None;
        };
        let sampler = texture.and_then(|texture| self.document.samplers.get(usize::from(texture.sampler?)));
        if sampler.and_then(|sampler| sampler.mag_filter).map(usize::from) == Some(NEAREST) && self.noted.insert(number)
        {
            self.causes.add("nearest", &label, |label| {
                format!("{label} asks for its nearest texel: colours are interpolated between texels here")
            });
        }
        let wrap = |mode: Option<Index>| match mode.map(usize::from) {
            Some(33648) => Wrap::Mirror,
            Some(33071) => Wrap::Clamp,
            _ => Wrap::Repeat,
        };
        let wrap = [sampler.and_then(|of| of.wrap_s), sampler.and_then(|of| of.wrap_t)].map(wrap);
        Some(TextureUse { image, uv_set: set as u8, wrap, transform: info.transform().map(rows) })
    }

    /// The number of a texture's image: that of the WebP extension where there is one. None, with a note, where it
    /// cannot be read.
    fn image_of(&mut self, texture_number: usize, texture: Option<&Texture>) -> Option<u32> {
        let webp = texture.and_then(|texture| *texture.extensions.get(WEBP)?);
        let named = [webp, texture.and_then(|texture| texture.source)].into_iter().flatten().map(usize::from);
        let image_count = self.document.images.len();
        let Some(number) = named.into_iter().find(|&number| number < image_count) else {
            if self.noted.insert(texture_number) {
                self.note_texture_without_image(texture_number, texture);
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

    fn note_texture_without_image(&mut self, number: usize, texture: Option<&Texture>) {
        let label = label_of(number, texture);
        let has = |name: &&&str| texture.is_some_and(|texture| texture.extensions.contains_key(**name));
        match UNREAD_IMAGES.iter().find(has) {
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
        let json = self.document.images.get(number)?;
        let (name, label) = (format!("image {number}"), format!("image {number} of {}", self.source.path.display()));
        if let Some(view) = json.buffer_view {
            let found = self.buffers.image(view.into(), &label);
            if found.is_none() {
                self.causes.add("beyond", &name, |name| format!("{name} reaches beyond its buffer: it was left out"));
            }
            return found;
        }
        match json.uri.as_deref() {
            Some(uri) if uri.starts_with("data:") => {
                let decoded = decode_data_uri(uri);
                if decoded.is_none() {
                    let sentence = |name: &str| format!("{name} has a data URI that is not base64: it was left out");
                    self.causes.add("base64", &name, sentence);
                }
                decoded.map(|bytes| ImageSource::Inline { name: label, bytes })
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
fn label_of(number: usize, texture: Option<&Texture>) -> String {
    match texture.and_then(|texture| texture.name.as_ref()).filter(|name| !name.is_empty()) {
        Some(name) => format!("texture {number} ({name})"),
        None => format!("texture {number}"),
    }
}

/// By how much emitted light is brighter than its factor (`KHR_materials_emissive_strength`).
fn emissive_strength(material: &GltfMaterial) -> f32 {
    let strength = material.extensions.emissive_strength.as_ref().and_then(|extension| extension.emissive_strength);
    strength.unwrap_or(1.0).max(0.0) as f32
}

/// The rows of a texture transform (`KHR_texture_transform`).
fn rows(transform: &TextureTransform) -> [f32; 6] {
    let pair = |pair: [f64; 2]| pair.map(|value| value as f32);
    affine(pair(transform.offset), pair(transform.scale), transform.rotation)
}

/// Scaled, turned, moved.
fn affine([x, y]: [f32; 2], [width, height]: [f32; 2], rotation: f64) -> [f32; 6] {
    let [sine, cosine] = sine_and_cosine(rotation);
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
