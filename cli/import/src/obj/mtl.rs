//! MTL, the materials of OBJ files: `Kd`, `d`, `Tr`, `map_Kd` and `map_d` with their options, `Ke` and `map_Ke`,
//! `norm`, `Pm`, `Pr`, `map_Pm` and `map_Pr`; `map_Bump` where it holds normals. An image may be one in tiles.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::image_name::NamedImage;
use super::opacity::{MeaningOfTr, StatedOpacity};
use super::tiles::{Tile, find_tiles, place};
use crate::attributes::AttributeSink;
use crate::beside::Beside;
use crate::relief::Relief;
use crate::scan::Scanner;
use crate::source::Source;
use crate::textures::Causes;
use crate::usable_image::NamedImages;
use lodpack_mesh::appearance::{AlphaMode, Material, TextureUse, Wrap};
use lodpack_mesh::srgb::linear_from_srgb;

/// A material, as its library describes it.
pub(super) struct LibraryMaterial {
    /// As it is written, in whatever encoding.
    pub name: Vec<u8>,
    /// What faces have that have texture coordinates.
    pub textured: Material,
    /// The same with its numbers alone, for faces without coordinates.
    pub plain: Material,
    /// What faces have on each tile, if images are in tiles.
    pub tiles: Vec<(Tile, Material)>,
    /// What stands behind the keywords of images.
    images: Vec<(ImageKind, Vec<u8>)>,
    bump: Option<PlacedImage>,
    opacity: StatedOpacity,
    /// Whether `Pm` said how much it is of metal.
    has_pm: bool,
}

/// By how much red, green and blue of grey may differ, in linear light.
const GREY: f32 = 0.01;

/// What a material has an image of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum ImageKind {
    Base,
    Opacity,
    Emissive,
    Normal,
    /// Normals or heights: only the image says which. Where there is one of normals, it need not be looked at.
    Bump,
    Metallic,
    Roughness,
}

impl ImageKind {
    fn of_keyword(keyword: &[u8]) -> Option<Self> {
        Some(match keyword {
            b"map_kd" => Self::Base,
            b"map_d" => Self::Opacity,
            b"map_ke" => Self::Emissive,
            b"norm" => Self::Normal,
            b"map_bump" | b"bump" => Self::Bump,
            b"map_pm" => Self::Metallic,
            b"map_pr" => Self::Roughness,
            _ => return None,
        })
    }
}

/// An image with its options, and where it is.
struct PlacedImage {
    /// None where it is in tiles, or outside of the input's folder.
    path: Option<PathBuf>,
    tiles: Vec<(Tile, PathBuf)>,
    wrap: Wrap,
    transform: Option<[f32; 6]>,
    multiplier: f32,
}

/// What is noted of all materials of a library together.
#[derive(Default)]
struct Notes {
    /// Keywords of images that are not read.
    unread: BTreeSet<String>,
    /// Options of images that are not known.
    options: BTreeSet<String>,
    /// Images of relief that hold no normals.
    reliefs: Causes,
    left_out: BTreeSet<PathBuf>,
}

impl LibraryMaterial {
    /// Whether some image can be used.
    pub fn has_textures(&self) -> bool {
        self.has(|material| material.images().next().is_some())
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
        let (mut materials, mut notes): (Vec<LibraryMaterial>, Notes) = Default::default();
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
            match (ImageKind::of_keyword(&keyword), keyword.as_slice()) {
                (Some(kind), _) => material.images.push((kind, rest.to_owned())),
                // What has the light of the surroundings is the image of colours once more.
                (None, b"map_ka") => {}
                (None, b"disp" | b"refl") => drop(notes.unread.insert(readable(&keyword))),
                _ if keyword.starts_with(b"map_") => drop(notes.unread.insert(readable(&keyword))),
                _ => {}
            }
        }
        self.read_images(&mut materials, &mut notes);
        self.settle_opacity(text, &mut materials);
        let tinted = materials
            .iter()
            .filter(|material| material.has_tint() && material.has(|of| of.base_texture.is_some()))
            .count();
        self.source.note_skipped(
            tinted as u64,
            "materials have a colour (Kd) beside an image (map_Kd): the image is shown as it is, since most programs do not \
             mean both; multiply it into the image to tint that",
        );
        materials.iter_mut().for_each(LibraryMaterial::join);
        self.note(&notes);
        materials
    }

    fn note(&self, Notes { unread, options, reliefs, .. }: &Notes) {
        let list = |names: &BTreeSet<String>| names.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        if !unread.is_empty() {
            self.source.note(&format!(
                "images of materials are left out: {}; those of map_Kd, map_d, map_Ke, map_Pm, map_Pr and norm are \
                 read, and those of map_Bump that hold normals",
                list(unread)
            ));
        }
        if !options.is_empty() {
            self.source.note(&format!("options of images that are not known are skipped: {}", list(options)));
        }
        reliefs.sentences().for_each(|sentence| self.source.note(&sentence));
    }

    /// Looks at the images of all materials, and at each tile of those that are in tiles.
    fn read_images(&mut self, materials: &mut [LibraryMaterial], notes: &mut Notes) {
        let name = |(_, text): &(ImageKind, Vec<u8>)| self.named(text).name.to_owned();
        let names: BTreeSet<Vec<u8>> = materials.iter().flat_map(|material| &material.images).map(name).collect();
        for material in materials.iter_mut() {
            let mut placed = vec![];
            for (kind, text) in std::mem::take(&mut material.images) {
                let image = self.named(&text);
                notes.options.extend(image.unknown.iter().map(|option| readable(option)));
                placed.push((kind, self.placed(&image, &names)));
            }
            let tiles = placed.iter().flat_map(|(_, image)| &image.tiles).map(|(tile, _)| *tile);
            let tiles: BTreeSet<Tile> = tiles.collect();
            material.tiles = tiles.into_iter().map(|tile| (tile, Material::default())).collect();
            for (kind, image) in placed {
                if kind == ImageKind::Bump {
                    material.bump = Some(image);
                    continue;
                }
                for (tile, textures) in material.variants() {
                    let texture = self.texture(&image, tile);
                    set_image(textures, kind, texture, image.multiplier);
                }
            }
        }
        // These have to be decoded, which is not worth it where there is one of normals.
        for material in materials {
            let Some(image) = material.bump.take() else { continue };
            for (tile, textures) in material.variants().filter(|(_, material)| material.normal_texture.is_none()) {
                if self.holds_normals(&image, tile, notes) {
                    let texture = self.texture(&image, tile);
                    set_image(textures, ImageKind::Normal, texture, image.multiplier);
                }
            }
        }
    }

    /// Whether an image of relief holds normals.
    fn holds_normals(&mut self, image: &PlacedImage, tile: Option<Tile>, notes: &mut Notes) -> bool {
        let Some(path) = image.path_on(tile) else { return false };
        let what = match self.images.relief(path, self.source, self.memory) {
            None => return false,
            Some(Relief::Normals) => return true,
            Some(Relief::Heights) => "heights, which are not read",
            Some(Relief::Colours) => "neither normals nor heights",
        };
        if notes.left_out.insert(path.to_owned()) {
            notes.reliefs.add(what, &path.display().to_string(), |name| {
                format!(
                    "the image {name} of map_Bump holds {what}: it is left out; to have its relief, make it an image of normals"
                )
            });
        }
        false
    }

    /// An image, or the tile of it.
    fn texture(&mut self, of: &PlacedImage, tile: Option<Tile>) -> Option<TextureUse> {
        let image = self.images.number(of.path_on(tile)?.to_owned(), self.source, self.sink)?;
        let mut texture = TextureUse { image, uv_set: 0, wrap: [of.wrap; 2], transform: of.transform };
        tile.filter(|_| !of.tiles.is_empty()).into_iter().for_each(|tile| place(&mut texture, tile));
        Some(texture)
    }

    /// An image with options, such as `-clamp on -s 2 2 1 wood.png`.
    fn named<'t>(&self, text: &'t [u8]) -> NamedImage<'t> {
        NamedImage::new(text, &|name| self.beside.is_there(name))
    }

    /// Where an image is; nowhere, with a note, if that is outside of the input's folder.
    fn placed(&self, image: &NamedImage, names: &BTreeSet<Vec<u8>>) -> PlacedImage {
        let &NamedImage { name, offset, scale, wrap, multiplier, .. } = image;
        let tiles = find_tiles(name, names, &self.beside);
        let path = (tiles.is_empty() && !name.is_empty()).then(|| self.beside.find("image", name)).flatten();
        // Rows count from above here and from below there.
        let [[x, y], [width, height]] = [offset, scale];
        let is_plain = (offset, scale) == ([0.0, 0.0], [1.0, 1.0]);
        let transform = (!is_plain).then_some([width, 0.0, x, 0.0, height, 1.0 - height - y]);
        PlacedImage { path, tiles, wrap, transform, multiplier }
    }

    /// Decides how opaque materials are, once all of them are known.
    fn settle_opacity(&self, text: &[u8], materials: &mut [LibraryMaterial]) {
        let meaning = MeaningOfTr::of(text, materials.iter().map(|material| material.opacity));
        if meaning == MeaningOfTr::OpacityByNumbers {
            self.source.note(
                "materials have Tr 1 and none has Tr 0, so that they would be invisible: Tr counts as opacity, as MeshLab \
                 and others write it; write d to say what is meant",
            );
        }
        let mut shown = 0;
        for material in materials {
            let Some(opacity) = material.opacity.value(meaning) else { continue };
            // An image on something invisible is there to be seen.
            let is_unmeant = opacity <= 0.0 && material.has_colours();
            shown += u64::from(is_unmeant);
            let opacity = if is_unmeant { 1.0 } else { opacity };
            material.plain.base_colour[3] = opacity;
            material.plain.alpha = if opacity < 1.0 { AlphaMode::Blend } else { AlphaMode::Opaque };
        }
        self.source
            .note_skipped(shown, "materials have opacity 0 beside an image: it counts as 1, and the image is shown");
    }
}

impl PlacedImage {
    /// Where it is, or its tile.
    fn path_on(&self, tile: Option<Tile>) -> Option<&Path> {
        let on_tile = self.tiles.iter().find(|(known, _)| Some(*known) == tile).map(|(_, path)| path);
        on_tile.or(self.path.as_ref()).map(PathBuf::as_path)
    }
}

fn set_image(material: &mut Material, kind: ImageKind, texture: Option<TextureUse>, multiplier: f32) {
    match kind {
        ImageKind::Base => material.base_texture = texture,
        ImageKind::Opacity => material.opacity_texture = texture,
        ImageKind::Emissive => material.emissive_texture = texture,
        ImageKind::Normal | ImageKind::Bump => {
            material.normal_texture = texture.map(|texture| (texture, multiplier));
        }
        ImageKind::Metallic => material.metallic_texture = texture,
        ImageKind::Roughness => material.roughness_texture = texture,
    }
}

fn readable(name: &[u8]) -> String {
    String::from_utf8_lossy(name).into_owned()
}

impl LibraryMaterial {
    fn new(name: &[u8]) -> Self {
        // Colours of vertices without a texture are multiplied by Kd; alpha counts only where the library mentions it.
        let plain = Material { name: readable(name), alpha: AlphaMode::Opaque, ..Material::default() };
        let (textured, tiles, images, opacity) = Default::default();
        Self { name: name.to_owned(), textured, plain, tiles, images, bump: None, opacity, has_pm: false }
    }

    /// What has images of its own: each tile, or the material where none is in tiles.
    fn variants(&mut self) -> impl Iterator<Item = (Option<Tile>, &mut Material)> {
        let whole = self.tiles.is_empty().then_some((None, &mut self.textured));
        whole.into_iter().chain(self.tiles.iter_mut().map(|(tile, material)| (Some(*tile), material)))
    }

    /// Whether `Kd` is not grey: grey is what exporters write where nobody has chosen a colour.
    fn has_tint(&self) -> bool {
        let [red, green, blue, _] = self.plain.base_colour;
        red.max(green).max(blue) - red.min(green).min(blue) > GREY
    }

    /// Whether it has some image, as a whole or on a tile.
    pub fn has(&self, is_there: impl Fn(&Material) -> bool) -> bool {
        is_there(&self.textured) || self.tiles.iter().any(|(_, material)| is_there(material))
    }

    /// Whether there are images of its colour or its opacity.
    fn has_colours(&self) -> bool {
        self.has(|material| material.base_texture.is_some() || material.opacity_texture.is_some())
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
            b"d" | b"tr" => self.opacity.read(keyword, rest),
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

    /// Makes the materials with textures, once all of it has been read.
    fn join(&mut self) {
        let (plain, has_pm) = (self.plain.clone(), self.has_pm);
        join(&mut self.textured, &plain, has_pm);
        self.tiles.iter_mut().for_each(|(_, material)| join(material, &plain, has_pm));
    }
}

/// Makes a material of its images and its numbers.
fn join(material: &mut Material, plain: &Material, has_pm: bool) {
    let images = std::mem::take(material);
    *material = Material {
        base_texture: images.base_texture,
        opacity_texture: images.opacity_texture,
        emissive_texture: images.emissive_texture,
        normal_texture: images.normal_texture,
        metallic_texture: images.metallic_texture,
        roughness_texture: images.roughness_texture,
        ..plain.clone()
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
    if material.metallic_texture.is_some() && !has_pm {
        material.metallic = 1.0;
    }
    if material.base_texture.is_some() {
        // Programs that write a texture often write an arbitrary Kd beside it, and those that read both show the
        // texture alone.
        material.base_colour[..3].fill(1.0);
        material.hides_vertex_colour = true;
    }
}
