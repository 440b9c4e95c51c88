//! MTL, the materials of OBJ files: `Kd`, `d`, `Tr`, `map_Kd` and `map_d` with their options, `Ke` and `map_Ke`, `norm`, `Pm`, `Pr`,
//! `map_Pm` and `map_Pr`; `map_Bump` where it holds normals.

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::import::attributes::AttributeSink;
use crate::import::beside::Beside;
use crate::import::relief::Relief;
use crate::import::scan::{Scanner, parse_float};
use crate::import::source::Source;
use crate::import::textures::Causes;
use crate::import::usable_image::NamedImages;
use crate::mesh::appearance::{AlphaMode, Material, TextureUse, Wrap};
use crate::mesh::srgb::linear_from_srgb;

/// A material, as its library describes it.
pub(super) struct LibraryMaterial {
    /// As it is written, in whatever encoding.
    pub name: Vec<u8>,
    /// What faces have that have texture coordinates.
    pub textured: Material,
    /// The same with its numbers alone, for faces without coordinates.
    pub plain: Material,
    /// What stands behind `map_Bump` or `bump`.
    bump: Option<Vec<u8>>,
    /// Whether `d` gave its opacity.
    has_d: bool,
    /// Whether `Pm` said how much it is of metal.
    has_pm: bool,
}

impl LibraryMaterial {
    /// Whether some image can be used.
    pub fn has_textures(&self) -> bool {
        self.textured.images().next().is_some()
    }
}

/// Reads libraries and looks at their images.
pub(super) struct LibraryReader<'a> {
    /// The OBJ file.
    pub source: &'a Source<'a>,
    pub images: &'a mut NamedImages,
    pub sink: &'a mut AttributeSink,
    /// Where the images of the current library are.
    pub beside: Beside<'a>,
    /// How much decoding one may take.
    pub memory: u64,
}

impl LibraryReader<'_> {
    /// The materials of a library, in its order.
    pub fn read(&mut self, text: &[u8]) -> Vec<LibraryMaterial> {
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
        let (mut materials, mut unread): (Vec<LibraryMaterial>, BTreeSet<String>) = Default::default();
        for line in text.split(|&b| b == b'\n' || b == b'\r').map(<[u8]>::trim_ascii) {
            let mut words = Scanner::new(line, 0);
            let keyword = words.word().to_ascii_lowercase();
            // Names may contain spaces.
            let rest = line[words.at..].trim_ascii();
            if keyword == b"newmtl" {
                materials.push(LibraryMaterial::new(rest));
            }
            let Some(material) = materials.last_mut() else { continue };
            material.read_number(&keyword, rest);
            let textured = &mut material.textured;
            match keyword.as_slice() {
                b"map_kd" => textured.base_texture = self.texture(rest),
                b"map_d" => textured.opacity_texture = self.texture(rest),
                b"map_ke" => textured.emissive_texture = self.texture(rest),
                b"norm" => textured.normal_texture = self.normal_texture(rest),
                // Only the image says whether these are normals; where there is a `norm`, it need not be looked at.
                b"map_bump" | b"bump" => material.bump = Some(rest.to_owned()),
                b"map_pm" => textured.metallic_texture = self.texture(rest),
                b"map_pr" => textured.roughness_texture = self.texture(rest),
                // What has the light of the surroundings is the image of colours once more.
                b"map_ka" => {}
                b"disp" | b"refl" => drop(unread.insert(readable(&keyword))),
                _ if keyword.starts_with(b"map_") => drop(unread.insert(readable(&keyword))),
                _ => {}
            }
        }
        if !unread.is_empty() {
            let names = unread.into_iter().collect::<Vec<_>>().join(", ");
            self.source.note(&format!(
                "images of materials are left out: {names}; those of map_Kd, map_d, map_Ke, map_Pm, map_Pr and norm are \
                 read, and those of map_Bump that hold normals"
            ));
        }
        self.read_bumps(&mut materials);
        materials.iter_mut().for_each(LibraryMaterial::join);
        materials
    }

    /// Has materials without a `norm` use their `map_Bump` in its place, where that holds normals.
    fn read_bumps(&mut self, materials: &mut [LibraryMaterial]) {
        let (mut causes, mut left_out) = (Causes::default(), BTreeSet::new());
        for material in materials.iter_mut().filter(|material| material.textured.normal_texture.is_none()) {
            let Some(bump) = material.bump.take() else { continue };
            let Some(path) = self.path(NamedImage::new(&bump).name) else { continue };
            let what = match self.images.relief(&path, self.source, self.memory) {
                None => continue,
                Some(Relief::Normals) => {
                    material.textured.normal_texture = self.normal_texture(&bump);
                    continue;
                }
                Some(Relief::Heights) => "heights, which are not read",
                Some(Relief::Colours) => "neither normals nor heights",
            };
            if left_out.insert(path.clone()) {
                causes.add(what, &path.display().to_string(), |name| {
                    format!(
                        "the image {name} of map_Bump holds {what}: it is left out; to have its relief, make it an image of normals"
                    )
                });
            }
        }
        causes.sentences().for_each(|sentence| self.source.note(&sentence));
    }

    /// An image of normals, and what their slopes are multiplied by.
    fn normal_texture(&mut self, text: &[u8]) -> Option<(TextureUse, f32)> {
        Some((self.texture(text)?, NamedImage::new(text).multiplier))
    }

    /// An image with options, such as `-clamp on -s 2 2 1 wood.png`.
    fn texture(&mut self, text: &[u8]) -> Option<TextureUse> {
        let NamedImage { name, offset, scale, wrap, .. } = NamedImage::new(text);
        let path = self.path(name)?;
        let image = self.images.number(path, self.source, self.sink)?;
        // Rows count from above here and from below there.
        let [[x, y], [width, height]] = [offset, scale];
        let is_plain = (offset, scale) == ([0.0, 0.0], [1.0, 1.0]);
        let transform = (!is_plain).then_some([width, 0.0, x, 0.0, height, 1.0 - height - y]);
        Some(TextureUse { image, uv_set: 0, wrap: [wrap; 2], transform })
    }

    /// Where an image is; none, with a note, if that is outside of the input's folder.
    fn path(&self, name: &[u8]) -> Option<PathBuf> {
        if name.is_empty() { None } else { self.beside.find("image", name) }
    }
}

/// An image as a library names it.
struct NamedImage<'a> {
    name: &'a [u8],
    offset: [f32; 2],
    scale: [f32; 2],
    wrap: Wrap,
    /// What slopes are multiplied by: `-bm`.
    multiplier: f32,
}

impl<'a> NamedImage<'a> {
    fn new(text: &'a [u8]) -> Self {
        let ([mut offset, mut scale], mut wrap, mut multiplier) = ([[0.0f32, 0.0], [1.0, 1.0]], Wrap::Repeat, 1.0);
        let number = |word: &[u8]| parse_float(word).map(|value| value as f32).filter(|value| value.is_finite());
        let mut words = Scanner::new(text, 0);
        let name = loop {
            words.skip_space();
            let name = &text[words.at..];
            if !name.starts_with(b"-") {
                break name;
            }
            let option = words.word();
            match option {
                // One to three numbers.
                b"-o" | b"-s" | b"-t" => {
                    let mut values = vec![];
                    while values.len() < 3 {
                        let mut ahead = words.clone();
                        let Some(value) = number(ahead.word()) else { break };
                        values.push(value);
                        words = ahead;
                    }
                    let target = if option == b"-o" { &mut offset } else { &mut scale };
                    if option != b"-t" {
                        target.iter_mut().zip(values).for_each(|(target, value)| *target = value);
                    }
                }
                b"-mm" => {
                    words.word();
                    words.word();
                }
                b"-clamp" => wrap = if words.word() == b"on" { Wrap::Clamp } else { Wrap::Repeat },
                b"-bm" => multiplier = number(words.word()).unwrap_or(1.0),
                b"-blendu" | b"-blendv" | b"-boost" | b"-cc" | b"-imfchan" | b"-texres" | b"-type" => {
                    words.word();
                }
                // A file whose name begins with a hyphen.
                _ => break name,
            }
        };
        Self { name: name.trim_ascii(), offset, scale, wrap, multiplier }
    }
}

fn readable(name: &[u8]) -> String {
    String::from_utf8_lossy(name).into_owned()
}

impl LibraryMaterial {
    fn new(name: &[u8]) -> Self {
        // Colours of vertices without a texture are multiplied by Kd; alpha counts only where the library mentions it.
        let plain = Material { name: readable(name), alpha: AlphaMode::Opaque, ..Material::default() };
        Self { name: name.to_owned(), textured: Material::default(), plain, bump: None, has_d: false, has_pm: false }
    }

    /// Reads a statement that gives numbers.
    fn read_number(&mut self, keyword: &[u8], rest: &[u8]) {
        let mut words = Scanner::new(rest, 0);
        let mut number = || words.float().ok().map(|value| value as f32).filter(|value| value.is_finite());
        let material = &mut self.plain;
        match keyword {
            b"kd" => {
                // Colours in libraries are those of screens. `Kd spectral` and `Kd xyz` have no number here.
                if let Some(red) = number() {
                    let (green, blue) = (number().unwrap_or(red), number().unwrap_or(red));
                    material.base_colour[..3].copy_from_slice(&[red, green, blue].map(linear_from_srgb));
                }
            }
            b"d" | b"tr" => self.read_opacity(keyword, rest),
            b"ke" => {
                if let (Some(red), Some(green), Some(blue)) = (number(), number(), number()) {
                    material.emissive = [red, green, blue].map(linear_from_srgb);
                }
            }
            b"pm" => {
                material.metallic = number().unwrap_or(0.0).clamp(0.0, 1.0);
                self.has_pm = true;
            }
            b"pr" => material.roughness = number().unwrap_or(1.0).clamp(0.0, 1.0),
            _ => {}
        }
    }

    /// `d` is opacity, and `Tr` what is missing of it. Some programs write both with the same number, so `d` alone counts then.
    fn read_opacity(&mut self, keyword: &[u8], rest: &[u8]) {
        let mut words = Scanner::new(rest, 0);
        if rest.starts_with(b"-halo") {
            words.word();
        }
        let Some(value) = words.float().ok().filter(|value| value.is_finite()) else { return };
        let is_d = keyword == b"d";
        if self.has_d && !is_d {
            return;
        }
        self.has_d |= is_d;
        let opacity = if is_d { value } else { 1.0 - value };
        self.plain.base_colour[3] = opacity.clamp(0.0, 1.0) as f32;
        self.plain.alpha = if opacity < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
    }

    /// Makes the material with textures, once all of it has been read.
    fn join(&mut self) {
        let images = std::mem::take(&mut self.textured);
        let material = &mut self.textured;
        *material = Material {
            base_texture: images.base_texture,
            opacity_texture: images.opacity_texture,
            emissive_texture: images.emissive_texture,
            normal_texture: images.normal_texture,
            metallic_texture: images.metallic_texture,
            roughness_texture: images.roughness_texture,
            ..self.plain.clone()
        };
        if material.opacity_texture.is_some() {
            material.alpha = AlphaMode::Blend;
        }
        // Programs name an image with alpha twice.
        material.opacity_texture.take_if(|opacity| material.base_texture.as_ref() == Some(opacity));
        if material.emissive_texture.is_some() && material.emissive == [0.0; 3] {
            material.emissive = [1.0; 3];
        }
        // Factors are 0 and 1 where nothing is said of them, as without images.
        if material.metallic_texture.is_some() && !self.has_pm {
            material.metallic = 1.0;
        }
        if material.base_texture.is_some() {
            // Programs that write a texture often write an arbitrary Kd beside it, and those that read both show the texture alone.
            material.base_colour[..3].fill(1.0);
            material.hides_vertex_colour = true;
        }
    }
}
