//! Textures that cannot be read: each is named with what becomes of its material.

use serde_json::{Value, json};

use super::super::attribute_tests::{Folder, glb, gltf, png};
use lodpack_mesh::appearance::{Appearance, Material};
use lodpack_mesh::srgb::linear_from_srgb;

/// Of numbers that bytes have: without any image, others are rounded.
const FACTOR: [f32; 4] = [linear_from_srgb(0.6), linear_from_srgb(0.4), 1.0, 1.0];

/// A document of one triangle under a material with a factor and a texture.
fn textured(texture: Value, images: Value) -> (Value, Vec<u8>) {
    let uv: Vec<u8> = [0u16, 65535, 65535, 0, 0, 0].iter().flat_map(|value| value.to_le_bytes()).collect();
    gltf(
        json!([{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]),
        json!({
            "materials": [{"pbrMetallicRoughness": {
                "baseColorFactor": FACTOR, "baseColorTexture": {"index": 0}, "metallicFactor": 0.0}}],
            "textures": [texture],
            "images": images,
            "accessors": [{"bufferView": 1, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2"}]
        }),
        &uv,
    )
}

fn import(document: &(Value, Vec<u8>), more: &[(&str, &[u8])]) -> (Appearance, String) {
    let model = glb(document);
    let folder = Folder::new(&[&[("a.glb", &model[..])], more].concat());
    let (appearance, _, notes) = folder.sound(&["a.glb"]);
    (appearance, notes)
}

fn is_factor_alone(material: &Material) -> bool {
    material.base_texture.is_none() && material.base_colour == FACTOR
}

#[test]
fn textures_whose_image_is_not_read_are_named_and_their_factor_stays() {
    let with = |extension: &str, source: u32| json!({"extensions": {extension: {"source": source}}});
    for (texture, problem) in [
        (with("KHR_texture_basisu", 0), "texture 0 has its image only in the form of KHR_texture_basisu"),
        (with("MSFT_texture_dds", 0), "texture 0 has its image only in the form of MSFT_texture_dds"),
        (with("EXT_texture_avif", 0), "texture 0 has its image only in the form of EXT_texture_avif"),
        (with("EXT_texture_webp", 7), "texture 0 names no image that is there"),
        (json!({"name": "wood"}), "texture 0 (wood) names no image that is there"),
    ] {
        for list in ["extensionsUsed", "extensionsRequired"] {
            let mut document = textured(texture.clone(), json!([{"uri": "a.png"}]));
            let names: Vec<&String> =
                texture["extensions"].as_object().map_or(vec![], |extensions| extensions.keys().collect());
            if !names.is_empty() {
                document.0[list] = json!(names);
            }
            let (appearance, notes) = import(&document, &[("a.png", &png(2, 2))]);
            assert!(is_factor_alone(&appearance.materials[1]), "{problem}");
            assert!(notes.contains(problem) && notes.contains("its material has its factor alone"), "{notes}");
        }
    }
}

#[test]
fn an_image_of_an_extension_that_is_not_there_is_no_loss_if_there_is_another() {
    for extensions in [json!({"EXT_texture_webp": {"source": 7}}), json!({"KHR_texture_basisu": {"source": 0}})] {
        let document = textured(json!({"source": 0, "extensions": extensions}), json!([{"uri": "a.png"}]));
        let (appearance, notes) = import(&document, &[("a.png", &png(2, 2))]);
        assert!(appearance.materials[1].base_texture.is_some() && !notes.contains("texture 0"), "{notes}");
    }
}

#[test]
fn primitives_without_the_coordinates_of_their_texture_are_named() {
    let mut document = textured(json!({"source": 0}), json!([{"uri": "a.png"}]));
    let without = json!({"attributes": {"POSITION": 0}, "material": 0});
    document.0["meshes"][0]["primitives"].as_array_mut().unwrap().push(without.clone());
    let image = png(2, 2);
    let (_, notes) = import(&document, &[("a.png", &image)]);
    assert!(notes.contains("primitive 1 of mesh 0 has no TEXCOORD_0") && notes.contains("factor alone"), "{notes}");
    document.0["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = json!(1);
    let (_, notes) = import(&document, &[("a.png", &image)]);
    assert!(notes.contains("primitive 0 of mesh 0 has no TEXCOORD_1"), "{notes}");
    assert!(notes.contains("the same is true of primitive 1 of mesh 0"), "{notes}");
    // Without a texture, nothing is missing.
    document.0["materials"][0]["pbrMetallicRoughness"].as_object_mut().unwrap().remove("baseColorTexture");
    assert!(!import(&document, &[]).1.contains("TEXCOORD"));
}

#[test]
fn an_image_of_several_maps_is_noted_once() {
    let mut document = textured(json!({"source": 0}), json!([{"uri": "noise.png"}]));
    let texture = json!({"index": 0});
    let material = &mut document.0["materials"][0];
    material["normalTexture"] = texture.clone();
    material["occlusionTexture"] = texture.clone();
    material["emissiveTexture"] = texture.clone();
    material["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
    material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = texture;
    let (appearance, notes) = import(&document, &[("noise.png", b"noise")]);
    assert_eq!(appearance.materials[1].images().count(), 0);
    assert_eq!(notes.matches("noise.png").count(), 1, "{notes}");
    assert!(notes.contains("convert it to PNG, JPEG, WebP, TIFF or EXR"), "{notes}");
}

#[test]
fn names_that_are_no_text_or_of_another_machine_are_looked_for() {
    let with = |uri: &str| textured(json!({"source": 0}), json!([{"uri": uri}]));
    let (appearance, notes) = import(&with("%ff.png"), &[]);
    assert!(is_factor_alone(&appearance.materials[1]));
    assert!(notes.contains("%ff.png cannot be used: there is no such file: put it there"), "{notes}");
    let (_, notes) = import(&with("C:\\t\\g.png"), &[]);
    assert!(notes.contains("the image C:\\t\\g.png is not in the folder of the file: put it there"), "{notes}");
    let (appearance, notes) = import(&with("C:\\t\\g.png"), &[("g.png", &png(2, 2))]);
    assert!(appearance.materials[1].base_texture.is_some(), "{notes}");
}

#[test]
fn many_images_that_are_missing_have_one_note() {
    let mut document = textured(json!({"source": 0}), json!([]));
    let all = |item: &dyn Fn(usize) -> Value| Value::from((0..300).map(item).collect::<Vec<_>>());
    document.0["textures"] = all(&|number| json!({"source": number}));
    document.0["materials"] =
        all(&|number| json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": number}, "metallicFactor": 0.0}}));
    for uri in ["no", "../no", "https://example.org/no"] {
        document.0["images"] = all(&|number| json!({"uri": format!("{uri}{number:03}.png")}));
        let (_, notes) = import(&document, &[]);
        assert!(notes.contains("no000.png") && notes.contains("no009.png and 290 more"), "{notes}");
        assert!(notes.lines().count() < 4, "{notes}");
    }
}

#[test]
fn textures_of_nearest_texels_are_noted_once() {
    let mut document = textured(json!({"source": 0, "sampler": 0}), json!([{"uri": "a.png"}]));
    document.0["samplers"] = json!([{"magFilter": 9728}]);
    document.0["materials"][0]["emissiveTexture"] = json!({"index": 0});
    let (appearance, notes) = import(&document, &[("a.png", &png(2, 2))]);
    assert!(appearance.materials[1].base_texture.is_some());
    let sentence = "texture 0 asks for its nearest texel: colours are interpolated between texels here";
    assert!(notes.contains(sentence) && !notes.contains("the same is true"), "{notes}");
}

#[test]
fn coordinates_that_a_transform_names_count_for_every_map() {
    let maps = ["normalTexture", "occlusionTexture", "emissiveTexture", "metallicRoughnessTexture", "baseColorTexture"];
    for (number, map) in maps.into_iter().enumerate() {
        let mut document = textured(json!({"source": 0}), json!([{"uri": "a.png"}]));
        document.0["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = json!(1);
        let material = &mut document.0["materials"][0];
        material["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
        for other in maps {
            // The transform's set counts, and not that of the texture.
            let transform = json!({"KHR_texture_transform": {"texCoord": 1, "offset": [0.5, 0.0]}});
            let info = if other == map {
                json!({"index": 0, "texCoord": 0, "extensions": transform})
            } else {
                json!({"index": 0})
            };
            let place = if ["metallicRoughnessTexture", "baseColorTexture"].contains(&other) {
                &mut material["pbrMetallicRoughness"]
            } else {
                &mut *material
            };
            place[other] = info;
        }
        let (appearance, notes) = import(&document, &[("a.png", &png(2, 2))]);
        let material = &appearance.materials[1];
        let uses = [
            material.normal_texture.as_ref().map(|(texture, _)| texture),
            material.occlusion_texture.as_ref().map(|(texture, _)| texture),
            material.emissive_texture.as_ref(),
            material.metallic_roughness_texture.as_ref(),
            material.base_texture.as_ref(),
        ];
        for (other, texture) in uses.into_iter().enumerate() {
            let texture = texture.unwrap_or_else(|| panic!("{map} {notes}"));
            assert_eq!(texture.uv_set, u8::from(other == number), "{map} {other}");
            assert_eq!(texture.transform.map(|rows| rows[2]), (other == number).then_some(0.5), "{map} {other}");
        }
    }
}

#[test]
fn materials_that_look_the_same_are_one_whatever_their_names_are() {
    let material = |number: u32| {
        let colour = [f64::from(number % 2), 0.5, 0.25, 1.0];
        json!({"name": format!("of part {number}"), "pbrMetallicRoughness": {"baseColorFactor": colour}})
    };
    let primitives: Vec<Value> =
        [0, 1, 19, 20].map(|number| json!({"attributes": {"POSITION": 0}, "material": number})).into();
    let materials: Vec<Value> = (0..21).map(material).collect();
    let model = glb(&gltf(json!(primitives), json!({"materials": materials}), &[0; 4]));
    let (appearance, attributes, _) = Folder::new(&[("a.glb", &model)]).sound(&["a.glb"]);
    let red = |triangle: usize| appearance.materials[usize::from(attributes.materials[triangle])].base_colour[0];
    assert_eq!((appearance.materials.len(), [0, 1, 2, 3].map(red)), (3, [0.0, 1.0, 1.0, 0.0]));
}
