//! The images that comments of a PLY file name, as materials.

use std::ops::Range;

use super::attributes::{Shown, UV_NAMES, find};
use super::header::Header;
use crate::attributes::AttributeSink;
use crate::beside::Beside;
use crate::error::Parsed;
use crate::source::Source;
use crate::usable_image::NamedImages;
use lodpack_mesh::appearance::{AlphaMode, COLOUR, Material, TextureUse, Wrap};

/// The textures of a file.
#[derive(Clone, Debug)]
pub(super) struct Textures {
    /// The numbers of their materials; empty where no texture can be shown.
    pub numbers: Range<usize>,
    /// How many of them can be.
    pub shown: Shown,
}

impl Textures {
    const NONE: Self = Self { numbers: 0..0, shown: Shown::None };

    /// Adds a material for each texture that the header names, if some can be shown.
    pub fn add(header: &Header, source: &Source, sink: &mut AttributeSink) -> Parsed<Self> {
        let has_uv = header.elements.iter().any(|element| {
            find(element, &UV_NAMES).is_some() || element.properties.iter().any(|property| property.name == "texcoord")
        });
        if header.textures.is_empty() || !has_uv {
            return Ok(Self::NONE);
        }
        if !sink.wants_colour() {
            sink.finds(COLOUR, "PLY textures");
            return Ok(Self::NONE);
        }
        let mut images = NamedImages::default();
        let found: Vec<Option<TextureUse>> =
            header.textures.iter().map(|name| texture(name, source, &mut images, sink)).collect();
        let shown = match found.iter().flatten().count() {
            0 => return Ok(Self::NONE),
            count if count < found.len() => Shown::Some,
            _ => Shown::All,
        };
        sink.finds(COLOUR, "PLY textures");
        let named = header.textures.iter().zip(found);
        let materials: Vec<Material> = named.map(|(name, texture)| material(name, texture)).collect();
        let count = materials.len();
        let first = sink.add_materials(materials)?;
        Ok(Self { numbers: first..first + count, shown })
    }
}

/// The texture of a name; none, with a note, if it cannot be shown.
fn texture(name: &[u8], source: &Source, images: &mut NamedImages, sink: &mut AttributeSink) -> Option<TextureUse> {
    if name.is_empty() {
        source.note("a line \"comment TextureFile\" names no image: write the name of the image behind it");
        return None;
    }
    let path = Beside::new(source).find("image", name)?;
    let image = images.number(path, source, sink)?;
    Some(TextureUse { image, uv_set: 0, wrap: [Wrap::Repeat; 2], transform: None })
}

fn material(name: &[u8], base_texture: Option<TextureUse>) -> Material {
    Material {
        name: String::from_utf8_lossy(name).into_owned(),
        base_texture,
        alpha: AlphaMode::Opaque,
        hides_vertex_colour: true,
        ..Material::default()
    }
}
