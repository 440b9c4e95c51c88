//! MTL, the materials of OBJ files: `Kd`, `d`, `Tr`, `map_Kd` and `map_d` with their options, `Ke` and `map_Ke`, `norm`, `Pm` and `Pr`.

use crate::import::attributes::AttributeSink;
use crate::import::scan::{Scanner, parse_float};
use crate::import::source::Source;
use crate::import::textures::file_beside;
use crate::mesh::appearance::{AlphaMode, Material, TextureUse, Wrap};
use crate::mesh::images::ImageSource;
use crate::mesh::srgb::linear_from_srgb;

/// The materials of a library, in its order. `source` is the OBJ file, whose folder the images are in.
pub(super) fn read_materials(text: &[u8], source: &Source, sink: &mut AttributeSink) -> Vec<Material> {
    let mut materials: Vec<Material> = vec![];
    for line in text.split(|&b| b == b'\n' || b == b'\r').map(<[u8]>::trim_ascii) {
        let mut words = Scanner::new(line, 0);
        let keyword = words.word().to_ascii_lowercase();
        // Names may contain spaces.
        let rest = line[words.at..].trim_ascii();
        if keyword == b"newmtl" {
            let name = String::from_utf8_lossy(rest).into_owned();
            // Colours of vertices without a texture are multiplied by Kd; alpha counts only where the library mentions it.
            materials.push(Material { name, alpha: AlphaMode::Opaque, ..Material::default() });
        }
        let Some(material) = materials.last_mut() else { continue };
        let mut number = || words.float().ok().map(|value| value as f32).filter(|value| value.is_finite());
        match keyword.as_slice() {
            b"kd" => {
                // Colours in libraries are those of screens. `Kd spectral` and `Kd xyz` have no number here.
                if let Some(red) = number() {
                    let (green, blue) = (number().unwrap_or(red), number().unwrap_or(red));
                    material.base_colour[..3].copy_from_slice(&[red, green, blue].map(linear_from_srgb));
                }
            }
            b"d" | b"tr" => {
                if rest.starts_with(b"-halo") {
                    words.word();
                }
                if let Some(value) = words.float().ok().filter(|value| value.is_finite()) {
                    let opacity = if keyword == b"d" { value } else { 1.0 - value };
                    material.base_colour[3] = opacity.clamp(0.0, 1.0) as f32;
                    if opacity < 1.0 {
                        material.alpha = AlphaMode::Blend;
                    }
                }
            }
            b"ke" => {
                if let (Some(red), Some(green), Some(blue)) = (number(), number(), number()) {
                    material.emissive = [red, green, blue].map(linear_from_srgb);
                }
            }
            b"pm" => material.metallic = number().unwrap_or(0.0).clamp(0.0, 1.0),
            b"pr" => material.roughness = number().unwrap_or(1.0).clamp(0.0, 1.0),
            b"map_kd" => material.base_texture = texture(rest, source, sink),
            b"map_d" => {
                material.opacity_texture = texture(rest, source, sink);
                if material.opacity_texture.is_some() {
                    material.alpha = AlphaMode::Blend;
                }
            }
            b"map_ke" => material.emissive_texture = texture(rest, source, sink),
            // Images of heights have these keywords, too, and cannot be told apart; `norm` is always an image of normals.
            b"norm" => material.normal_texture = texture(rest, source, sink).map(|texture| (texture, 1.0)),
            _ => {}
        }
    }
    // Programs name an image with alpha twice.
    for material in &mut materials {
        material.opacity_texture.take_if(|opacity| material.base_texture.as_ref() == Some(opacity));
    }
    for material in materials.iter_mut().filter(|material| material.emissive_texture.is_some()) {
        if material.emissive == [0.0; 3] {
            material.emissive = [1.0; 3];
        }
    }
    for material in materials.iter_mut().filter(|material| material.base_texture.is_some()) {
        // Programs that write a texture often write an arbitrary Kd beside it, and those that read both show the texture alone.
        material.base_colour[..3].fill(1.0);
        material.hides_vertex_colour = true;
    }
    materials
}

/// An image with options, such as `-clamp on -s 2 2 1 wood.png`.
fn texture(text: &[u8], source: &Source, sink: &mut AttributeSink) -> Option<TextureUse> {
    let ([mut offset, mut scale], mut wrap) = ([[0.0f32, 0.0], [1.0, 1.0]], Wrap::Repeat);
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
                    let Some(value) = parse_float(ahead.word()).filter(|value| value.is_finite()) else { break };
                    values.push(value as f32);
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
            b"-blendu" | b"-blendv" | b"-boost" | b"-bm" | b"-cc" | b"-imfchan" | b"-texres" | b"-type" => {
                words.word();
            }
            // A file whose name begins with a hyphen.
            _ => break name,
        }
    };
    let path = file_beside(source, std::str::from_utf8(name.trim_ascii()).ok().filter(|name| !name.is_empty())?)?;
    let image = sink.add_image(ImageSource::File { path, range: None });
    // Rows count from above here and from below there.
    let [[x, y], [width, height]] = [offset, scale];
    let is_plain = (offset, scale) == ([0.0, 0.0], [1.0, 1.0]);
    let transform = (!is_plain).then_some([width, 0.0, x, 0.0, height, 1.0 - height - y]);
    Some(TextureUse { image, uv_set: 0, wrap: [wrap; 2], transform })
}
