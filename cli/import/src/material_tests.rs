//! Normals and the maps of materials of input files.

use std::io::Cursor;

use image::ImageFormat;
use serde_json::json;

use super::attribute_tests::{Folder, glb, gltf, ply};
use lodpack_mesh::appearance::{Appearance, MaterialMaps};
use lodpack_mesh::attributes::RegionAttributes;

/// The normals of the first triangle's corners.
fn normals(appearance: &Appearance, attributes: &RegionAttributes) -> [[f32; 3]; 3] {
    let place = appearance.layout.normal.expect("there are normals");
    let records = attributes.records_of(0, appearance.layout.stride);
    records.map(|record| [record[place], record[place + 1], record[place + 2]])
}

const NORMALS: &str = "property float nx\nproperty float ny\nproperty float nz\n";

#[test]
fn normals_of_ply_are_kept_only_if_they_are_asked_for() {
    let file = ply("", (NORMALS, ["0 0 1", "0 1 0", "1 0 0", "nan 0 0"]), ("", &["3 0 1 2", "3 0 2 3"]));
    let folder = Folder::new(&[("a.ply", &file)]);
    let (appearance, _, notes) = folder.sound(&["a.ply"]);
    assert_eq!(appearance, Appearance::default());
    assert!(notes.contains("normals of the input are left out"), "{notes}");
    for channels in ["all", "normal"] {
        let (imported, notes) = folder.import(&["a.ply"], channels);
        let (surface, attributes) = imported.unwrap();
        assert!(surface.appearance.maps.normal && !surface.appearance.has_colour, "{notes}");
        assert_eq!(normals(&surface.appearance, &attributes), [[0., 0., 1.], [0., 1., 0.], [1., 0., 0.]]);
        assert!(notes.contains("normal (PLY properties") && !notes.contains("left out"), "{notes}");
    }
}

#[test]
fn a_surface_without_normals_has_those_of_its_triangles() {
    let folder = Folder::new(&[("a.ply", &ply("", ("", [""; 4]), ("", &["4 0 1 2 3"])))]);
    let (imported, notes) = folder.import(&["a.ply"], "normal");
    let (surface, _) = imported.unwrap();
    assert!(surface.appearance.maps.normal && surface.appearance.layout.stride == 0);
    assert!(notes.contains("normal (triangles)"), "{notes}");
}

#[test]
fn obj_faces_take_the_normals_of_their_corners() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nvt 0 0\nf 1//1 2//2 3//-1\nf 1 3/1/9 2\n";
    let folder = Folder::new(&[("a.obj", text.as_bytes())]);
    let (imported, notes) = folder.import(&["a.obj"], "all");
    let (surface, attributes) = imported.unwrap();
    assert_eq!(normals(&surface.appearance, &attributes), [[0., 0., 1.], [0., 1., 0.], [0., 1., 0.]]);
    // Corners without a normal, or with one that does not exist, have that of the triangle.
    let place = surface.appearance.layout.normal.unwrap();
    assert!(attributes.records_of(1, surface.appearance.layout.stride).iter().all(|record| record[place].is_nan()));
    assert!(!notes.contains("normals of the input are left out"), "{notes}");
}

#[test]
fn images_of_mtl_that_are_not_read_are_named() {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let library = "newmtl m\nKd 1 0 0\nmap_Ka a.png\nmap_Ks c.png\ndisp b.png\nmap_Ks b.png\n";
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", library.as_bytes())]);
    let (_, _, notes) = folder.sound(&["a.obj"]);
    assert!(notes.contains("images of materials are left out: disp, map_ks; those of map_Kd"), "{notes}");
}

/// An image of 90 x 130 texels in some format.
fn encoded(format: ImageFormat, texel: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
    let image = image::RgbImage::from_fn(90, 130, |x, y| image::Rgb(texel(x, y)));
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// Those of waves along a diagonal.
fn waves(x: u32, y: u32) -> [u8; 3] {
    let slope = f64::from((x + y) % 40) / 40.0 - 0.5;
    let normal = glam::DVec3::new(-slope, -slope, 1.0).normalize();
    normal.to_array().map(|value| (127.5 + 127.5 * value).round() as u8)
}

/// What a library of one material gives, among images of several kinds: its image of normals with what that is
/// multiplied by, and the notes.
fn with_bump(library: &str) -> (Option<(String, f32)>, String) {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    let grey = |x: u32, y: u32| [((x * y) % 256) as u8; 3];
    let sky = |_: u32, _: u32| [135, 206, 235];
    let mut large = vec![];
    let mut encoder = png::Encoder::new(&mut large, 1 << 15, 1 << 14);
    encoder.set_depth(png::BitDepth::One);
    encoder.write_header().unwrap().write_chunk(png::chunk::IDAT, &[]).unwrap();
    let folder = Folder::new(&[
        ("a.obj", obj.as_bytes()),
        ("a.mtl", library.as_bytes()),
        ("waves.png", &encoded(ImageFormat::Png, waves)),
        ("waves.jpg", &encoded(ImageFormat::Jpeg, waves)),
        ("cut.png", &encoded(ImageFormat::Png, waves)[..3000]),
        ("cut.jpg", &encoded(ImageFormat::Jpeg, waves)[..2000]),
        ("grey.png", &encoded(ImageFormat::Png, grey)),
        ("grey.jpg", &encoded(ImageFormat::Jpeg, grey)),
        ("sky.png", &encoded(ImageFormat::Png, sky)),
        ("large.png", &large),
    ]);
    let (imported, notes) = folder.import(&["a.obj"], "auto");
    let (surface, _) = imported.unwrap_or_else(|error| panic!("{library}: {error}"));
    let Appearance { materials, images, maps, .. } = surface.appearance;
    let normals = materials.get(1).and_then(|material| material.normal_texture.clone());
    assert_eq!(normals.is_some(), maps.normal);
    let name = |image: u32| images[image as usize].name().rsplit('/').next().unwrap_or_default().to_owned();
    (normals.map(|(texture, scale)| (name(texture.image), scale)), notes)
}

#[test]
fn what_stands_behind_map_bump_is_read_if_it_holds_normals() {
    let of = |name: &str, scale: f32| Some((name.to_owned(), scale));
    for (library, expected) in [
        ("map_Bump waves.png", of("waves.png", 1.0)),
        ("bump -bm 0.5 -clamp on waves.jpg", of("waves.jpg", 0.5)),
        ("map_bump -bm x waves.png", of("waves.png", 1.0)),
        ("norm -bm 2 waves.png", of("waves.png", 2.0)),
        // `norm` wins wherever it stands, and nothing is said of what is not needed.
        ("norm waves.jpg\nmap_Bump -bm 3 grey.png", of("waves.jpg", 1.0)),
        ("map_Bump none.png\nnorm waves.jpg", of("waves.jpg", 1.0)),
        ("bump", None),
    ] {
        let (found, notes) = with_bump(&format!("newmtl m\nKd 1 0 0\n{library}\n"));
        assert_eq!(found, expected, "{library}: {notes}");
        assert!(!notes.contains("the image "), "{library}: {notes}");
    }
}

#[test]
fn what_holds_no_normals_is_noted_once_with_its_name() {
    for (name, note) in [
        ("grey.png", "of map_Bump holds heights, which are not read: it is left out"),
        ("grey.jpg", "of map_Bump holds heights, which are not read: it is left out"),
        ("sky.png", "of map_Bump holds neither normals nor heights: it is left out"),
        ("none.png", "cannot be used: there is no such file"),
        ("cut.png", "cannot be used: it is damaged"),
        ("cut.jpg", "cannot be used: it is damaged"),
        ("large.png", "cannot be used: it has 32768 x 16384 texels, more than 268435456: make it smaller"),
    ] {
        let (found, notes) = with_bump(&format!("newmtl m\nKd 1 0 0\nmap_Bump {name}\nnewmtl n\nbump {name}\n"));
        assert_eq!(found, None, "{notes}");
        assert_eq!((notes.matches(name).count(), notes.matches(note).count()), (1, 1), "{name}: {notes}");
    }
    // Where the image of `norm` cannot be used, the other one can.
    let (found, notes) = with_bump("newmtl m\nnorm none.png\nmap_Bump waves.png\n");
    assert!(found.is_some_and(|(name, _)| name == "waves.png") && notes.contains("none.png"), "{notes}");
}

#[test]
fn factors_of_mtl_have_images_of_their_own() {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    let read = |library: &str| {
        let folder = Folder::new(&[
            ("a.obj", obj.as_bytes()),
            ("a.mtl", library.as_bytes()),
            ("grey.png", &super::attribute_tests::png(2, 2)),
        ]);
        let (appearance, _, notes) = folder.sound(&["a.obj"]);
        (appearance.materials[1].clone(), appearance.maps, notes)
    };
    let (material, maps, notes) = read("newmtl m\nmap_Pm grey.png\nmap_Pr grey.png\nPr 0.5\n");
    assert!(material.metallic_texture.is_some() && material.roughness_texture.is_some(), "{notes}");
    assert_eq!((material.metallic, material.roughness), (1.0, 0.5));
    assert_eq!(maps, MaterialMaps { metallic: true, roughness: true, ..MaterialMaps::default() });
    // Without its image, nothing is of metal.
    let (material, maps, notes) = read("newmtl m\nmap_Pm none.png\nmap_Pr grey.png\n");
    assert!(material.metallic_texture.is_none() && material.metallic == 0.0 && !maps.metallic, "{notes}");
    assert!(maps.roughness && notes.contains("none.png"), "{notes}");
}

#[test]
fn images_of_more_than_8_bits_are_noted_together() {
    let obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    let library = "newmtl m\nmap_Kd colour.png\nnorm fine.png\nmap_Ke fine.tif\nmap_Pr plain.png\n";
    let fine = |format: ImageFormat| {
        let image = image::ImageBuffer::from_fn(4, 4, |x, y| image::Rgb([x as u16 * 4097, y as u16 * 4097, 60_000u16]));
        let mut bytes = Cursor::new(vec![]);
        image::DynamicImage::ImageRgb16(image).write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    };
    let folder = Folder::new(&[
        ("a.obj", obj.as_bytes()),
        ("a.mtl", library.as_bytes()),
        ("colour.png", &fine(ImageFormat::Png)),
        ("fine.png", &fine(ImageFormat::Png)),
        ("fine.tif", &fine(ImageFormat::Tiff)),
        ("plain.png", &super::attribute_tests::png(2, 2)),
    ]);
    let (_, _, notes) = folder.sound(&["a.obj"]);
    let note = notes.lines().find(|line| line.contains("more than 8 bits for each number; texels of the file have 8"));
    let note = note.unwrap_or_else(|| panic!("{notes}"));
    assert!(["colour.png", "fine.png", "fine.tif"].iter().all(|name| note.contains(name)), "{notes}");
    assert!(!notes.contains("plain.png") && notes.matches("8 bits").count() == 1, "{notes}");
}

#[test]
fn gltf_materials_have_all_their_maps_and_normals_turn_with_their_node() {
    let directions: [[f32; 3]; 3] = [[0., 0., 1.], [0., 1., 0.], [1., 0., 0.]];
    let bytes: Vec<u8> = directions.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    let texture = json!({"index": 0});
    let mut document = gltf(
        json!([{"attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2}, "material": 0}]),
        json!({
            "materials": [{
                "pbrMetallicRoughness": {"metallicFactor": 0.5, "metallicRoughnessTexture": texture},
                "normalTexture": {"index": 0, "scale": 0.5}, "occlusionTexture": {"index": 0, "strength": 0.25},
                "emissiveTexture": texture, "emissiveFactor": [1.0, 0.5, 0.0]}],
            "textures": [{"source": 0}],
            "images": [{"uri": "a.png"}],
            "nodes": [{"mesh": 0, "scale": [2.0, 1.0, -1.0]}],
            "accessors": [
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]
        }),
        &bytes,
    );
    let file = |document: &(serde_json::Value, Vec<u8>), channels: &str| {
        let folder = Folder::new(&[("a.glb", &glb(document)), ("a.png", &super::attribute_tests::png(2, 2))]);
        let (imported, notes) = folder.import(&["a.glb"], channels);
        let (surface, attributes) = imported.unwrap_or_else(|error| panic!("{error}"));
        (surface.appearance, attributes, notes)
    };
    let (appearance, attributes, notes) = file(&document, "auto");
    let all = MaterialMaps { normal: true, emissive: true, occlusion: true, metallic: true, roughness: true };
    assert_eq!((appearance.maps, appearance.has_colour), (all, false), "{notes}");
    // A mirror turns triangles, and those of its second axis stay where they are.
    assert_eq!(normals(&appearance, &attributes)[0], [0.0, 0.0, -1.0]);
    let material = &appearance.materials[1];
    assert_eq!(material.normal_texture.as_ref().map(|(_, scale)| *scale), Some(0.5));
    assert_eq!(material.occlusion_texture.as_ref().map(|(_, strength)| *strength), Some(0.25));
    assert_eq!((material.emissive, material.metallic), ([1.0, 0.5, 0.0], 0.5));
    assert!(["normal (", "emissive (", "occlusion (", "metallic (", "roughness ("].iter().all(|of| notes.contains(of)));
    let (appearance, ..) = file(&document, "roughness");
    assert_eq!(appearance.maps, MaterialMaps { roughness: true, ..MaterialMaps::default() });
    // Without light there is nothing that is metal or matt.
    document.0["materials"][0] = json!({"extensions": {"KHR_materials_unlit": {}}});
    document.0["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    let (appearance, ..) = file(&document, "auto");
    assert_eq!(appearance.maps, MaterialMaps::default());
}

#[test]
fn gltf_tangents_are_read_where_an_image_of_normals_is_relative_to_them() {
    let directions: [[f32; 3]; 3] = [[0.0, 0.0, 1.0]; 3];
    let tangents: [[f32; 4]; 3] = [[1.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, -1.0], [0.0; 4]];
    let numbers = directions.as_flattened().iter().chain(tangents.as_flattened());
    let bytes: Vec<u8> = numbers.flat_map(|value| value.to_le_bytes()).collect();
    let read = |attributes: serde_json::Value, material: serde_json::Value, of_tangents: &str| {
        let document = gltf(
            json!([{"attributes": attributes, "material": 0}]),
            json!({
                "materials": [material],
                "textures": [{"source": 0}],
                "images": [{"uri": "a.png"}],
                "nodes": [{"mesh": 0, "scale": [-1.0, 2.0, 1.0]}],
                "accessors": [
                    {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC3"},
                    {"bufferView": 1, "byteOffset": 36, "componentType": 5126, "count": 3, "type": of_tangents},
                    {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]
            }),
            &bytes,
        );
        let folder = Folder::new(&[("a.glb", &glb(&document)), ("a.png", &super::attribute_tests::png(2, 2))]);
        let (imported, notes) = folder.import(&["a.glb"], "auto");
        let (surface, attributes) = imported.unwrap_or_else(|error| panic!("{error}"));
        let layout = surface.appearance.layout;
        let records = attributes.records_of(0, layout.stride).map(<[f32]>::to_vec);
        let tangents = layout.tangent.map(|place| records.map(|record| record[place..place + 4].to_vec()));
        (tangents, notes)
    };
    let all = || json!({"POSITION": 0, "NORMAL": 1, "TANGENT": 2, "TEXCOORD_0": 3});
    let with_image = || json!({"normalTexture": {"index": 0}});
    let (tangents, notes) = read(all(), with_image(), "VEC4");
    // A node that mirrors turns its triangles, and swaps the sides of tangents.
    let [a, b, c] = tangents.expect("there are tangents");
    assert_eq!([a, c], [vec![-1.0, 0.0, 0.0, -1.0], vec![0.0, 1.0, 0.0, 1.0]], "{notes}");
    assert!(b[0].is_nan(), "{b:?}");
    // Without normals they do not count, and without an image they are not needed.
    let without = json!({"POSITION": 0, "TANGENT": 2, "TEXCOORD_0": 3});
    assert_eq!(read(without, with_image(), "VEC4").0, None);
    assert_eq!(read(all(), json!({"occlusionTexture": {"index": 0}}), "VEC4").0, None);
    // Damaged ones are left out, and the surface is there without them.
    let (tangents, notes) = read(all(), with_image(), "VEC3");
    assert!(tangents.is_some_and(|of| of.concat().iter().all(|value| value.is_nan())), "{notes}");
    assert!(notes.contains("tangents must have four components"), "{notes}");
}
