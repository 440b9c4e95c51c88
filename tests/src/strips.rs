//! A model that is drawn in many ways: strips of a surface side by side, each with a material of its own.

use lodpack::decode::{AlphaMode, Drawing};
use serde_json::{Value, json};
use std::io::Cursor;

/// Squares along each side of a strip; strips lie side by side along x, each a unit wide.
const SQUARES: u32 = 24;
/// Texels of the image along each side, and of a square of holes in it.
const TEXELS: u32 = 128;
const HOLES: u32 = 32;

/// glTF materials, and how they are drawn: one for each strip.
pub fn materials() -> Vec<(Value, Drawing)> {
    let usual = Drawing::default();
    let masked = |cutoff: f64| Drawing { alpha: AlphaMode::Mask(cutoff), ..usual };
    vec![
        (json!({"alphaMode": "OPAQUE"}), usual),
        (json!({"alphaMode": "MASK", "alphaCutoff": 0.3}), masked(0.3)),
        (json!({"alphaMode": "BLEND"}), Drawing { alpha: AlphaMode::Blend, ..usual }),
        (json!({"doubleSided": true}), Drawing { is_double_sided: true, ..usual }),
        (json!({"extensions": {"KHR_materials_unlit": {}}}), Drawing { is_unlit: true, ..usual }),
        (json!({"alphaMode": "MASK", "doubleSided": true}), Drawing { is_double_sided: true, ..masked(0.5) }),
    ]
}

/// A PNG whose opacity is 0.2, 0.4, 0.6 or 0.8 by square of holes: each takes a quarter of the image. Red is 200
/// everywhere.
///
/// # Panics
/// If it cannot be encoded, which does not happen.
pub fn holes() -> Vec<u8> {
    let texel = |x: u32, y: u32| {
        let opacity = 51 * (1 + (x / HOLES + y / HOLES) % 4);
        image::Rgba([200, (x * 255 / TEXELS) as u8, (y * 255 / TEXELS) as u8, opacity as u8])
    };
    let mut bytes = Cursor::new(vec![]);
    let image = image::RgbaImage::from_fn(TEXELS, TEXELS, texel);
    image.write_to(&mut bytes, image::ImageFormat::Png).expect("a small image");
    bytes.into_inner()
}

/// A glTF document of strips of these materials, all of which show the image of [`holes`].
///
/// # Panics
/// If the image cannot be encoded, which does not happen.
pub fn strips(materials: impl Iterator<Item = Value>) -> String {
    let mut all: Vec<Value> = materials.collect();
    let (columns, rows) = (all.len() as u32 * SQUARES + 1, SQUARES + 1);
    let (mut positions, mut places): (Vec<[f32; 3]>, Vec<[f32; 2]>) = (vec![], vec![]);
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let [x, y] = [column, row].map(|k| k as f32 / SQUARES as f32);
        positions.push([x, y, 0.08 * (9.0 * x).sin() * (7.0 * y).cos()]);
        places.push([x, y]);
    }
    let (mut bytes, mut views) = (vec![], vec![]);
    let mut add = |content: Vec<u8>| {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": content.len()}));
        bytes.extend(content);
    };
    add(positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect());
    add(places.iter().flatten().flat_map(|x| x.to_le_bytes()).collect());
    let ends = |pick: fn(f32, f32) -> f32| [0, 1, 2].map(|k| positions.iter().map(|p| p[k]).reduce(pick));
    let mut accessors = vec![
        json!({"bufferView": 0, "componentType": 5126, "count": positions.len(), "type": "VEC3", "min": ends(f32::min), "max": ends(f32::max)}),
        json!({"bufferView": 1, "componentType": 5126, "count": places.len(), "type": "VEC2"}),
    ];
    let mut primitives = vec![];
    for (strip, material) in (0..).zip(&mut all) {
        let mut indices: Vec<u32> = vec![];
        for square in 0..SQUARES * SQUARES {
            let a = square / SQUARES * columns + strip * SQUARES + square % SQUARES;
            indices.extend([a, a + 1, a + columns + 1, a, a + columns + 1, a + columns]);
        }
        add(indices.iter().flat_map(|x| x.to_le_bytes()).collect());
        primitives.push(json!({
            "attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2 + strip, "material": strip,
        }));
        accessors
            .push(json!({"bufferView": 2 + strip, "componentType": 5125, "count": indices.len(), "type": "SCALAR"}));
        let look = &mut material["pbrMetallicRoughness"];
        (look["baseColorTexture"], look["metallicFactor"]) = (json!({"index": 0}), json!(0.0));
    }
    json!({
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [{"primitives": primitives}],
        "materials": all, "textures": [{"source": 0}], "images": [{"uri": format!("data:image/png;base64,{}", base64(&holes()))}],
        "buffers": [{"byteLength": bytes.len(), "uri": format!("data:application/octet-stream;base64,{}", base64(&bytes))}],
        "bufferViews": views, "accessors": accessors,
    })
    .to_string()
}

fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |three: &[u8]| {
        let number = (0..3).fold(0, |sum, k| sum << 8 | u32::from(three.get(k).copied().unwrap_or(0)));
        let digit = |k: usize| if k <= three.len() { DIGITS[(number >> (18 - 6 * k) & 63) as usize] } else { b'=' };
        [0, 1, 2, 3].map(|k| char::from(digit(k)))
    };
    bytes.chunks(3).flat_map(group).collect()
}
