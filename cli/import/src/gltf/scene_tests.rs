//! Where meshes are: transforms in f64, skins, instances and centres.

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::super::tests::{error_of, import_bytes, import_noting};
use super::tests::glb;
use lodpack_mesh::Mesh;

const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

/// Numbers of any type, and what an accessor says of them.
fn values<T: Copy, const N: usize>(values: &[T], bytes: impl Fn(T) -> [u8; N], accessor: Value) -> (Value, Vec<u8>) {
    (accessor, values.iter().flat_map(|&value| bytes(value)).collect())
}

fn floats(values_of: &[f32], dimensions: &str) -> (Value, Vec<u8>) {
    let components = match dimensions {
        "VEC3" => 3,
        "VEC4" => 4,
        _ => 16,
    };
    let accessor = json!({"componentType": 5126, "type": dimensions, "count": values_of.len() / components});
    values(values_of, f32::to_le_bytes, accessor)
}

/// A document over one triangle, which is accessor 0, and more arrays.
fn document(nodes: Value, arrays: &[(Value, Vec<u8>)]) -> (Value, Vec<u8>) {
    let (mut binary, mut views, mut accessors) = (vec![], vec![], vec![]);
    let triangle = floats(TRIANGLE.as_flattened(), "VEC3");
    for (accessor, bytes) in std::iter::once(&triangle).chain(arrays) {
        let mut accessor = accessor.clone();
        accessor["bufferView"] = json!(views.len());
        views.push(json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len()}));
        accessors.push(accessor);
        binary.extend(bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
    }
    let document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": binary.len()}]
    });
    (document, binary)
}

fn read((document, binary): &(Value, Vec<u8>)) -> Mesh {
    import_bytes("a.glb", &glb(document, binary)).unwrap()
}

fn refusal((document, binary): &(Value, Vec<u8>)) -> String {
    error_of("a.glb", &glb(document, binary))
}

fn assert_at(mesh: &Mesh, vertex: usize, expected: [f64; 3], tolerance: f64) {
    let found = mesh.positions[vertex];
    assert!(found.distance(DVec3::from(expected)) <= tolerance, "{vertex} {found}");
}

#[test]
fn nodes_that_are_far_away_keep_all_digits() {
    for place in [[4012345.3, 655321.6, 4901234.7], [500123.456789, 5412345.678901, 431.23], [0.1, -1e-9, 1e7 + 0.1]] {
        let moved = read(&document(json!([{"mesh": 0, "translation": place}]), &[]));
        assert_eq!(moved.positions[0].to_array(), place);
        let mut matrix = DMat4::IDENTITY.to_cols_array();
        matrix[12..15].copy_from_slice(&place);
        assert_eq!(read(&document(json!([{"mesh": 0, "matrix": matrix}]), &[])), moved);
        // A centre above, and what is relative to it below.
        let away = place.map(|c| c - 0.25);
        let nodes = json!([{"translation": away, "children": [1]}, {"mesh": 0, "translation": [0.25, 0.25, 0.25]}]);
        let deep = read(&document(nodes, &[]));
        assert_at(&deep, 0, place, 1e-8);
    }
}

#[test]
fn rotations_and_scales_have_all_digits_too() {
    // A third of a circle about an axis, a million away.
    let half = std::f64::consts::FRAC_PI_3;
    let rotation = [0.0, 0.0, half.sin(), half.cos()];
    let nodes = json!([{"rotation": rotation, "children": [1]}, {"mesh": 0, "translation": [1e6, 0.0, 0.0]}]);
    assert_at(&read(&document(nodes, &[])), 0, [-5e5, 1e6 * (2.0 * half).sin(), 0.0], 1e-8);
    // A quaternion that is not of length 1 turns, and does not scale.
    let nodes = json!([{"mesh": 0, "rotation": [0.0, 0.0, 3.0, 3.0]}]);
    assert_at(&read(&document(nodes, &[])), 1, [0.0, 1.0, 0.0], 1e-15);
    let nodes = json!([{"mesh": 0, "scale": [1234.567891234, 1.0, 1.0]}]);
    assert_at(&read(&document(nodes, &[])), 1, [1234.567891234, 0.0, 0.0], 1e-12);
}

/// All vertices on joint 0, half of the second one on joint 1, which is number 2 of the nodes.
fn skinned(of_node: Value, of_joint: Value, inverse: Option<[f64; 16]>) -> (Value, Vec<u8>) {
    let mut node = json!({"mesh": 0, "skin": 0});
    node.as_object_mut().unwrap().extend(of_node.as_object().unwrap().clone());
    let joints = values(
        &[0u8, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0],
        u8::to_le_bytes,
        json!({"componentType": 5121, "type": "VEC4", "count": 3}),
    );
    let weights = floats(&[1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], "VEC4");
    let inverses: Vec<f32> =
        [inverse.unwrap_or(DMat4::IDENTITY.to_cols_array()); 2].as_flattened().iter().map(|&v| v as f32).collect();
    let nodes = json!([{"children": [1, 2, 3]}, node, of_joint, {}]);
    let (mut document, binary) = document(nodes, &[joints, weights, floats(&inverses, "MAT4")]);
    document["skins"] = json!([{"joints": [2, 3]}]);
    if inverse.is_some() {
        document["skins"][0]["inverseBindMatrices"] = json!(3);
    }
    let attributes = &mut document["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = json!(1);
    attributes["WEIGHTS_0"] = json!(2);
    (document, binary)
}

#[test]
fn a_skinned_mesh_is_where_its_joints_are_and_not_where_its_node_is() {
    let plain = read(&document(json!([{"mesh": 0}]), &[]));
    let away = json!({"scale": [0.01, 0.01, 0.01], "translation": [10, 0, 0]});
    assert_eq!(read(&skinned(away.clone(), json!({}), None)), plain);
    // What hangs on no joint stays where it is.
    let mut without = skinned(away.clone(), json!({}), None);
    without.0["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("JOINTS_0");
    assert_eq!(read(&without), plain);
    // A joint that is elsewhere takes its vertices along, as much as they hang on it.
    let moved = read(&skinned(away.clone(), json!({"translation": [0, 0, 4]}), None));
    assert_at(&moved, 0, [0.0, 0.0, 4.0], 0.0);
    assert_at(&moved, 1, [1.0, 0.0, 2.0], 0.0);
    // In its own place, it does nothing.
    let inverse = DMat4::from_translation(DVec3::new(0.0, 0.0, -4.0)).to_cols_array();
    let bound = read(&skinned(away, json!({"translation": [0, 0, 4]}), Some(inverse)));
    assert_at(&bound, 0, [0.0; 3], 0.0);
    assert_at(&bound, 1, [1.0, 0.0, -2.0], 0.0);
}

#[test]
fn skins_that_are_damaged_are_errors() {
    let with = |change: &dyn Fn(&mut Value)| {
        let mut skinned = skinned(json!({}), json!({}), Some(DMat4::IDENTITY.to_cols_array()));
        change(&mut skinned.0);
        refusal(&skinned)
    };
    assert!(with(&|d| d["nodes"][1]["skin"] = json!(1)).contains("skin 1: is used by a node, but is not there"));
    assert!(with(&|d| d["skins"][0]["joints"] = json!([2, 9])).contains("skin 0: uses node 9, which is not there"));
    assert!(with(&|d| d["skins"][0]["inverseBindMatrices"] = json!(9)).contains("skin 0: uses accessor 9"));
    assert!(
        with(&|d| d["skins"][0]["inverseBindMatrices"] = json!(0)).contains("accessor 0: has values of 3 components")
    );
    assert!(with(&|d| d["accessors"][3]["count"] = json!(1)).contains("accessor 3: has fewer matrices"));
}

/// The triangle at many places.
fn instanced(arrays: &[(&str, (Value, Vec<u8>))]) -> (Value, Vec<u8>) {
    let numbers: serde_json::Map<String, Value> =
        arrays.iter().enumerate().map(|(number, (name, _))| ((*name).to_owned(), json!(number + 1))).collect();
    let node = json!({"mesh": 0, "translation": [100, 0, 0], "children": [1], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": numbers}}});
    let arrays: Vec<_> = arrays.iter().map(|(_, array)| array.clone()).collect();
    let (mut document, binary) = document(json!([node, {"mesh": 0}]), &arrays);
    document["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    (document, binary)
}

#[test]
fn instances_are_drawn_each_at_its_place_and_children_once() {
    let places = floats(&[0.0, 0.0, 0.0, 10.0, 0.0, 0.0, 0.0, 20.0, 0.0], "VEC3");
    let mesh = read(&instanced(&[("TRANSLATION", places.clone())]));
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (12, 4));
    assert_at(&mesh, 3, [110.0, 0.0, 0.0], 0.0);
    assert_at(&mesh, 6, [100.0, 20.0, 0.0], 0.0);
    // The child is relative to the node alone.
    assert_at(&mesh, 9, [100.0, 0.0, 0.0], 0.0);
    // Half a turn about z, of length 2, in floats; shares of bytes and of 16 bits, which are a quarter of a turn.
    let turns = floats(&[0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], "VEC4");
    let mesh = read(&instanced(&[("TRANSLATION", places), ("ROTATION", turns)]));
    assert_at(&mesh, 1, [99.0, 0.0, 0.0], 1e-12);
    assert_at(&mesh, 4, [111.0, 0.0, 0.0], 1e-12);
    let accessor = |component: u32| json!({"componentType": component, "type": "VEC4", "count": 1, "normalized": true});
    let bytes = values(&[0i8, 0, 90, 90], i8::to_le_bytes, accessor(5120));
    let shorts = values(&[0i16, 0, 23170, 23170], i16::to_le_bytes, accessor(5122));
    for turn in [bytes, shorts] {
        assert_at(&read(&instanced(&[("ROTATION", turn)])), 1, [100.0, 1.0, 0.0], 1e-12);
    }
}

#[test]
fn mirrored_instances_keep_their_outside() {
    let scales = floats(&[1.0, 1.0, 1.0, -2.0, 1.0, 1.0, 1.0, 1.0, -1.0], "VEC3");
    let mesh = read(&instanced(&[("SCALE", scales)]));
    assert_at(&mesh, 4, [98.0, 0.0, 0.0], 0.0);
    let side = |t: u32| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(c - a).z
    };
    // Seen from the mirror's side, the second is as it was; the third lies on its back, as renderers draw it.
    assert!(side(0) > 0.0 && side(1) > 0.0 && side(2) < 0.0, "{} {} {}", side(0), side(1), side(2));
}

#[test]
fn instances_of_counts_that_lie_are_errors() {
    let places = floats(&[0.0; 6], "VEC3");
    let other = instanced(&[("TRANSLATION", places.clone()), ("SCALE", floats(&[1.0; 3], "VEC3"))]);
    assert!(refusal(&other).contains("node 0: has instances of which attributes have different counts"));
    let mut many = instanced(&[("TRANSLATION", places.clone())]);
    many.0["accessors"][1]["count"] = json!(1_000_000_000_000u64);
    let error = refusal(&many);
    assert!(error.contains("accessor 1: the file ends too early"), "{error}");
    let mut missing = instanced(&[("TRANSLATION", places.clone())]);
    missing.0["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] = json!(7);
    assert!(refusal(&missing).contains("node 0: has instances with accessor 7 for TRANSLATION"));
    assert!(refusal(&instanced(&[("ROTATION", places.clone())])).contains("accessor 1: has values of 3 components"));
    // Many copies of one point have bytes each, but no mesh of that many triangles can be numbered.
    let mut dense = instanced(&[("TRANSLATION", floats(&[0.0; 3 * 65536], "VEC3"))]);
    let primitive = dense.0["meshes"][0]["primitives"][0].clone();
    dense.0["meshes"][0]["primitives"] = json!(vec![primitive; 30_000]);
    assert!(refusal(&dense).contains("but one build takes at most"));
    // Custom attributes alone place nothing.
    assert_eq!(read(&instanced(&[("_ID", places.clone())])).triangles.len(), 2);
    assert_eq!(read(&instanced(&[])).triangles.len(), 1);
}

#[test]
fn instances_of_small_files_that_are_damaged_anywhere_never_panic() {
    let turns = floats(&[0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0], "VEC4");
    let (document, binary) = instanced(&[("TRANSLATION", floats(&[0.0; 6], "VEC3")), ("ROTATION", turns)]);
    let bytes = glb(&document, &binary);
    for at in 0..bytes.len() {
        for value in [0, 0xFF, bytes[at] ^ 1, b'9', b' '] {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            let _ = import_bytes("a.glb", &damaged);
        }
    }
}

#[test]
fn nodes_that_are_not_visible_are_left_out_with_a_note() {
    let hidden = json!({"mesh": 0, "children": [2], "extensions": {"KHR_node_visibility": {"visible": false}}});
    let shown = json!({"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": true}}});
    let (document, binary) = document(json!([{"children": [1, 3]}, hidden, {"mesh": 0}, shown]), &[]);
    let (mesh, notes) = import_noting("a.glb", &glb(&document, &binary));
    assert_eq!(mesh.unwrap().triangles.len(), 1);
    assert!(notes.contains("1 nodes are not visible"), "{notes}");
}

#[test]
fn a_centre_that_positions_are_relative_to_is_added_and_noted() {
    // Its z is up, which is y in the document.
    for (list, centre) in
        [("extensionsUsed", [1000000.25, 2e6, 3e6]), ("extensionsRequired", [4012345.3, 655321.6, 0.1])]
    {
        let (mut document, binary) = document(json!([{"mesh": 0}]), &[]);
        document[list] = json!(["CESIUM_RTC"]);
        document["extensions"] = json!({"CESIUM_RTC": {"center": centre}});
        let (mesh, notes) = import_noting("a.glb", &glb(&document, &binary));
        assert_eq!(mesh.unwrap().positions[0].to_array(), [centre[0], centre[2], -centre[1]]);
        assert!(notes.contains("CESIUM_RTC") && notes.contains(&centre[0].to_string()), "{notes}");
    }
    let (mut document, binary) = document(json!([{"mesh": 0}]), &[]);
    document["extensions"] = json!({"CESIUM_RTC": {"center": [1, 2]}});
    assert!(refusal(&(document, binary)).contains("byte"));
}
