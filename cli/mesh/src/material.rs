//! What a page looks like, as a material of glTF 2.0 (section 3.9): images of its layers, and factors where all texels
//! are the same.

use std::io;

use lodpack::decode::texels::Image;
use lodpack::decode::{AlphaMode, Drawing};
use serde_json::{Value, json};

use super::encoded::even_texel;
use super::layers::Layer;

use super::srgb::LINEAR_OF_BYTE;

/// The extension of materials that are shown without light.
pub const UNLIT: &str = "KHR_materials_unlit";
/// Where the parts of a material are that tell metals from others.
const SURFACE: &str = "pbrMetallicRoughness";

/// White, and no metal.
pub fn plain() -> Value {
    json!({SURFACE: {"metallicFactor": 0.0, "roughnessFactor": 1.0}})
}

/// The material of a page. `texture` is asked to add an image of a layer, and returns the number of its texture.
///
/// # Errors
/// Those of `texture`.
pub fn material(
    page: &[(Layer, Image<u8>)],
    mut texture: impl FnMut(Layer, &Image<u8>) -> io::Result<usize>,
) -> io::Result<Value> {
    let mut material = plain();
    for (layer, image) in page {
        let even = even_texel(image);
        match layer {
            Layer::Colour => {
                let alpha = even.map_or(0, |texel| texel.get(3).copied().unwrap_or(u8::MAX));
                match even {
                    Some(texel) => {
                        let [red, green, blue] = linear(texel);
                        material[SURFACE]["baseColorFactor"] = json!([red, green, blue, share(alpha)]);
                    }
                    None => material[SURFACE]["baseColorTexture"] = json!({"index": texture(*layer, image)?}),
                }
                if image.components == 4 && alpha < u8::MAX {
                    material["alphaMode"] = "BLEND".into();
                }
            }
            // A normal that is that of the surface everywhere needs no image.
            Layer::Normal if even == Some(&layer.blank()) => {}
            Layer::Normal => material["normalTexture"] = json!({"index": texture(*layer, image)?}),
            Layer::Emissive => match even {
                Some([0, 0, 0, ..]) => {}
                Some(texel) => material["emissiveFactor"] = json!(linear(texel)),
                None => {
                    material["emissiveTexture"] = json!({"index": texture(*layer, image)?});
                    material["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
                }
            },
            Layer::Factors => add_factors(&mut material, image, |image| texture(*layer, image))?,
        }
    }
    Ok(material)
}

/// Adds occlusion, for which there is no factor, and metallic and roughness.
fn add_factors(
    material: &mut Value,
    image: &Image<u8>,
    texture: impl FnOnce(&Image<u8>) -> io::Result<usize>,
) -> io::Result<()> {
    let even = |component: usize| {
        let mut values = image.data.iter().skip(component).step_by(3).copied();
        let first = values.next()?;
        values.all(|value| value == first).then_some(first)
    };
    let is_occluded = even(0) != Some(u8::MAX);
    let factors = even(1).zip(even(2));
    if let Some((roughness, metallic)) = factors {
        material[SURFACE]["roughnessFactor"] = share(roughness).into();
        material[SURFACE]["metallicFactor"] = share(metallic).into();
    }
    if !is_occluded && factors.is_some() {
        return Ok(());
    }
    let texture = json!({"index": texture(image)?});
    if factors.is_none() {
        material[SURFACE]["metallicFactor"] = 1.0.into();
        material[SURFACE]["metallicRoughnessTexture"] = texture.clone();
    }
    if is_occluded {
        material["occlusionTexture"] = texture;
    }
    Ok(())
}

/// Colours of factors are in linear light; those of images are as screens have them.
fn linear(texel: &[u8]) -> [f32; 3] {
    [0, 1, 2].map(|k| LINEAR_OF_BYTE[usize::from(texel[k])])
}

fn share(byte: u8) -> f64 {
    f64::from(byte) / f64::from(u8::MAX)
}

/// Has a material drawn in this way.
pub fn draw(material: &mut Value, drawing: Drawing) {
    if let Some(known) = material.as_object_mut() {
        ["alphaMode", "alphaCutoff", "doubleSided"].iter().for_each(|&name| drop(known.remove(name)));
    }
    match drawing.alpha {
        AlphaMode::Opaque => {}
        AlphaMode::Mask(cutoff) => {
            (material["alphaMode"], material["alphaCutoff"]) = ("MASK".into(), cutoff.into());
        }
        AlphaMode::Blend => material["alphaMode"] = "BLEND".into(),
    }
    if drawing.is_double_sided {
        material["doubleSided"] = true.into();
    }
    if drawing.is_unlit {
        material["extensions"] = json!({UNLIT: {}});
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The material of a page, and which layers it has asked to add.
    fn of(page: &[(Layer, Image<u8>)]) -> (Value, Vec<Layer>) {
        let mut added = vec![];
        let texture = |layer, _: &Image<u8>| {
            added.push(layer);
            Ok(added.len() + 6)
        };
        (material(page, texture).unwrap(), added)
    }

    fn even(texel: &[u8]) -> Image<u8> {
        Image::filled([2, 1], texel)
    }

    fn two(first: [u8; 3], second: [u8; 3]) -> Image<u8> {
        Image { size: [2, 1], components: 3, data: [first, second].concat() }
    }

    #[test]
    fn what_is_the_same_everywhere_is_a_factor_in_linear_light() {
        let page = [
            (Layer::Colour, even(&[188, 0, 255])),
            (Layer::Normal, even(&[128, 128, 255])),
            (Layer::Emissive, even(&[255, 188, 0])),
            (Layer::Factors, even(&[255, 51, 102])),
        ];
        let (known, added) = of(&page);
        assert_eq!(added, []);
        let number = |value: &Value| value.as_f64().unwrap();
        let surface = &known["pbrMetallicRoughness"];
        assert!((number(&surface["baseColorFactor"][0]) - 0.502_886).abs() < 1e-5, "{known}");
        assert_eq!([1, 2, 3].map(|k| number(&surface["baseColorFactor"][k])), [0.0, 1.0, 1.0]);
        assert!((number(&known["emissiveFactor"][1]) - 0.502_886).abs() < 1e-5, "{known}");
        assert_eq!(["roughnessFactor", "metallicFactor"].map(|name| number(&surface[name])), [0.2, 0.4]);
        assert!(["normalTexture", "occlusionTexture", "alphaMode"].iter().all(|&name| known[name].is_null()));
        assert!(of(&[(Layer::Emissive, even(&[0; 3]))]).0["emissiveFactor"].is_null());
        let glass = of(&[(Layer::Colour, even(&[255, 255, 255, 51]))]).0;
        assert_eq!((&glass["alphaMode"], number(&glass[SURFACE]["baseColorFactor"][3])), (&"BLEND".into(), 0.2));
        assert!(of(&[(Layer::Colour, even(&[255; 4]))]).0["alphaMode"].is_null());
    }

    #[test]
    fn factors_have_an_image_only_of_what_varies() {
        let indices = |image: Image<u8>| {
            let known = of(&[(Layer::Factors, image)]).0;
            let surface = &known[SURFACE];
            assert_eq!(surface["metallicRoughnessTexture"].is_null(), surface["metallicFactor"] != 1.0, "{known}");
            [&surface["metallicRoughnessTexture"], &known["occlusionTexture"]].map(|texture| texture["index"].as_u64())
        };
        assert_eq!(indices(two([255, 9, 9], [255, 9, 9])), [None, None]);
        assert_eq!(indices(two([255, 9, 9], [255, 8, 9])), [Some(7), None]);
        assert_eq!(indices(two([255, 9, 9], [254, 9, 9])), [None, Some(7)]);
        // There is no factor for occlusion.
        assert_eq!(indices(two([100, 9, 9], [100, 9, 9])), [None, Some(7)]);
        assert_eq!(indices(two([255, 9, 9], [100, 9, 0])), [Some(7), Some(7)]);
    }

    #[test]
    fn what_varies_is_an_image() {
        let page = [Layer::Colour, Layer::Normal, Layer::Emissive].map(|layer| (layer, two([0; 3], [128, 128, 255])));
        let (known, added) = of(&page);
        assert_eq!(added, [Layer::Colour, Layer::Normal, Layer::Emissive]);
        assert_eq!(known["pbrMetallicRoughness"]["baseColorTexture"]["index"], 7);
        assert_eq!([&known["normalTexture"]["index"], &known["emissiveTexture"]["index"]], [8, 9]);
        assert_eq!(known["emissiveFactor"], json!([1.0, 1.0, 1.0]));
    }
}
