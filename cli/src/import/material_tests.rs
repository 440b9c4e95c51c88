//! Normals and the maps of materials of input files.

use serde_json::json;

use super::attribute_tests::{Folder, glb, gltf, ply};
use crate::mesh::appearance::{Appearance, MaterialMaps};
use crate::mesh::attributes::RegionAttributes;

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
    let library = "newmtl m\nKd 1 0 0\nmap_Ka a.png\nmap_Bump b.png\nmap_Ks c.png\nbump b.png\nmap_Bump b.png\n";
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", library.as_bytes())]);
    let (_, _, notes) = folder.sound(&["a.obj"]);
    assert!(notes.contains("images of materials are left out: bump, map_bump, map_ks; those of map_Kd"), "{notes}");
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
