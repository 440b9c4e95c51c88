use std::path::Path;

use glam::DVec3;
use serde_json::{Value, json};

use super::super::import_meshes;
use super::super::tests::{error_of, import_bytes, import_noting};
use crate::ImportError;
use lodpack_mesh::Mesh;
use lodpack_runtime::progress::Silent;

const SQUARE: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.5], [0., 1., 0.]];

/// Positions (48 bytes), six 16-bit indices (12), four 8-bit strip indices (4), then a sparse index (4) and its
/// position (12).
fn binary() -> Vec<u8> {
    let mut bytes: Vec<u8> = SQUARE.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()));
    bytes.extend([0, 1, 3, 2]);
    bytes.extend(2u32.to_le_bytes());
    bytes.extend([9f32, 9.0, 9.0].iter().flat_map(|c| c.to_le_bytes()));
    bytes
}

/// One node with one mesh over [`binary`]. Each test changes the part that it checks.
fn document() -> Value {
    json!({
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 80}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 12},
            {"buffer": 0, "byteOffset": 60, "byteLength": 4},
            {"buffer": 0, "byteOffset": 64, "byteLength": 4},
            {"buffer": 0, "byteOffset": 68, "byteLength": 12}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0.5]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5121, "count": 4, "type": "SCALAR"}
        ]
    })
}

pub(in super::super) fn glb(document: &Value, binary: &[u8]) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    bytes.extend((12 + 8 + json.len() as u32 + 8 + binary.len() as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json);
    bytes.extend((binary.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(binary);
    bytes
}

/// Imports the document after a change to the JSON.
fn changed(change: impl Fn(&mut Value)) -> Result<Mesh, ImportError> {
    let mut document = document();
    change(&mut document);
    import_bytes("a.glb", &glb(&document, &binary()))
}

fn changed_error(change: impl Fn(&mut Value)) -> String {
    let mut document = document();
    change(&mut document);
    error_of("a.glb", &glb(&document, &binary()))
}

fn corners(mesh: &Mesh) -> Vec<[[f64; 3]; 3]> {
    (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t).map(|p| p.to_array())).collect()
}

fn square(triangles: &[[usize; 3]]) -> Vec<[[f64; 3]; 3]> {
    triangles.iter().map(|t| t.map(|v| SQUARE[v].map(f64::from))).collect()
}

pub(in super::super) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits = |chunk: &[u8]| {
        let word = chunk.iter().fold(0, |word, &b| word << 8 | usize::from(b)) << (8 * (3 - chunk.len()));
        (0..4).map(move |i| LETTERS[word >> (18 - 6 * i) & 63] as char).collect::<Vec<_>>()
    };
    let mut text: String = bytes.chunks(3).flat_map(digits).collect();
    let padding = (3 - bytes.len() % 3) % 3;
    text.truncate(text.len() - padding);
    text + &"=".repeat(padding)
}

#[test]
fn binary_chunk_data_uri_and_file_give_the_same_mesh() {
    let whole = changed(|_| {}).unwrap();
    assert_eq!(corners(&whole), square(&[[0, 1, 2], [0, 2, 3]]));
    let mut document = document();
    document["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{}", base64(&binary())).into();
    assert_eq!(import_bytes("a.gltf", document.to_string().as_bytes()).unwrap(), whole);
    document["buffers"][0]["uri"] = "the%20data.bin".into();
    // A missing image must not matter.
    document["images"] = json!([{"uri": "missing.png"}]);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.gltf"), document.to_string()).unwrap();
    let import = || import_meshes(&[folder.path().join("a.gltf")], &Silent);
    assert!(import().unwrap_err().to_string().contains("the data.bin cannot be read"));
    std::fs::write(folder.path().join("the data.bin"), &binary()[..79]).unwrap();
    assert!(
        import()
            .unwrap_err()
            .to_string()
            .contains("buffer 0: the file ends too early: 80 bytes are announced, 79 are there")
    );
    std::fs::write(folder.path().join("the data.bin"), binary()).unwrap();
    assert_eq!(import().unwrap(), whole);
    assert!(Path::new("a.gltf").parent().is_some());
}

#[test]
fn strips_fans_and_missing_indices_are_read() {
    let with = |mode: u32, indices: Value| {
        changed(|d| {
            let primitive = &mut d["meshes"][0]["primitives"][0];
            primitive["mode"] = mode.into();
            primitive["indices"] = indices.clone();
            if indices.is_null() {
                primitive.as_object_mut().unwrap().remove("indices");
            }
        })
    };
    assert_eq!(corners(&with(5, 2.into()).unwrap()), square(&[[0, 1, 3], [3, 1, 2]]));
    assert_eq!(corners(&with(6, Value::Null).unwrap()), square(&[[0, 1, 2], [0, 2, 3]]));
    assert_eq!(corners(&with(5, Value::Null).unwrap()), square(&[[0, 1, 2], [2, 1, 3]]));
    assert!(
        with(4, Value::Null)
            .unwrap_err()
            .to_string()
            .contains("mesh 0: primitive 0 has 4 indices, which is not a multiple of three")
    );
    assert!(with(1, 1.into()).unwrap_err().to_string().contains("no triangles"));
}

#[test]
fn instances_are_expanded_with_their_transforms() {
    let mesh = changed(|d| {
        d["scenes"][0]["nodes"] = json!([0, 1]);
        d["nodes"] = json!([
            {"mesh": 0, "children": [2], "translation": [5e6, 0, 0], "rotation": [0, 0, 0.5, 0.5]},
            {"mesh": 0, "matrix": [-1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,7,1]},
            {"mesh": 0, "scale": [2, 2, 2]},
            {"mesh": 0, "name": "in no scene"}
        ]);
    })
    .unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (12, 6));
    let near = |v: usize, x: f64, y: f64, z: f64| {
        assert!(mesh.positions[v].distance(DVec3::new(x, y, z)) < 1e-6, "{v} {}", mesh.positions[v])
    };
    near(2, 5e6 - 1.0, 1.0, 0.5);
    near(6, 5e6 - 2.0, 2.0, 1.0);
    near(10, -1.0, 1.0, 7.5);
    let normal = |t: u32| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(c - a).z
    };
    assert!((0..6).all(|t| normal(t) > 0.0), "a mirrored instance must not turn inside out");
}

#[test]
fn a_document_without_scenes_or_nodes_is_read_whole() {
    let remove = |names: &[&str]| {
        changed(|d| names.iter().for_each(|n| drop(d.as_object_mut().unwrap().remove(*n)))).unwrap().triangles.len()
    };
    assert_eq!(remove(&["scene"]), 2);
    assert_eq!(remove(&["scene", "scenes"]), 2);
    assert_eq!(remove(&["scene", "scenes", "nodes"]), 2);
}

#[test]
fn sparse_and_quantised_positions_are_read() {
    let sparse = json!({"count": 1, "indices": {"bufferView": 3, "componentType": 5125}, "values": {"bufferView": 4}});
    let mesh = changed(|d| d["accessors"][0]["sparse"] = sparse.clone()).unwrap();
    assert_eq!(mesh.positions[2], DVec3::splat(9.0));
    let bare = |d: &mut Value, count: u64| {
        d["accessors"][0]["sparse"] = sparse.clone();
        d["accessors"][0]["count"] = count.into();
        d["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    };
    let mesh = changed(|d| bare(d, 4)).unwrap();
    assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::ZERO, DVec3::splat(9.0), DVec3::ZERO]);
    assert!(
        changed_error(|d| bare(d, 4_000_000_000)).contains("accessor 0: it has 4000000000 items but only 1 values")
    );
    assert!(changed_error(|d| bare(d, 2)).contains("accessor 0: it replaces item 2 of 2"));
    let falling = changed_error(|d| {
        d["accessors"][0]["sparse"] =
            json!({"count": 4, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 0}});
    });
    assert!(falling.contains("accessor 0: it replaces item 2 after item 3"), "{falling}");
    let mut document = document();
    document["accessors"][0] = json!({"bufferView": 0, "componentType": 5122, "normalized": true, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]});
    document["bufferViews"][0]["byteStride"] = 8.into();
    document["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    document["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let mut bytes = binary();
    let quantised = [[0i16, 0, 0, 0], [32767, 0, 0, 0], [32767, 32767, -32768, 0], [0, 32767, 0, 0]];
    bytes.splice(..32, quantised.iter().flatten().flat_map(|c| c.to_le_bytes()));
    let mesh = import_bytes("a.glb", &glb(&document, &bytes)).unwrap();
    assert_eq!(mesh.positions[2], DVec3::new(1.0, 1.0, -1.0));
}

#[test]
fn omissions_are_noted_and_unreadable_features_refused() {
    let mut document = document();
    document["scenes"] = json!([{"nodes": [0]}, {"nodes": []}]);
    let points = json!({"attributes": {"POSITION": 0}, "mode": 0});
    document["meshes"][0]["primitives"].as_array_mut().unwrap().push(points);
    let (mesh, notes) = import_noting("a.glb", &glb(&document, &binary()));
    assert_eq!(mesh.unwrap().triangles.len(), 2);
    assert!(notes.contains("1 other scenes") && notes.contains("1 point or line primitives"), "{notes}");
    assert!(changed_error(|d| d["buffers"][0]["uri"] = "https://example.org/a.bin".into()).contains("download it"));
}

#[test]
fn required_extensions_that_are_not_read_are_named_and_never_called_damage() {
    let with = |names: Value| {
        let mut document = document();
        document["extensionsUsed"] = names.clone();
        document["extensionsRequired"] = names;
        let (mesh, notes) = import_noting("a.glb", &glb(&document, &binary()));
        (mesh.map_err(|error| error.to_string()), notes)
    };
    let whole = changed(|_| {}).unwrap();
    // They say how the surface looks, moves or is used.
    for name in ["KHR_materials_clearcoat", "KHR_lights_punctual", "EXT_mesh_features", "KHR_animation_pointer"] {
        let (mesh, notes) = with(json!([name]));
        assert_eq!(mesh.as_ref(), Ok(&whole), "{name}");
        let note = format!("uses the extension {name}, which is not supported; the surface is read without it");
        assert!(notes.contains(&note), "{notes}");
    }
    // Those that are read need no word.
    for name in ["KHR_mesh_quantization", "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_texture_basisu"]
    {
        assert_eq!(with(json!([name])), (Ok(whole.clone()), String::new()), "{name}");
    }
    for name in ["ACME_curves", "EXT_primitive_voxels", "curves"] {
        let error = with(json!(["KHR_materials_ior", name])).0.unwrap_err();
        assert!(error.contains(&format!("uses the extension {name}, which is not supported")), "{error}");
        assert!(!error.contains("export") && !error.contains("damaged") && !error.contains("not valid"), "{error}");
    }
}

#[test]
fn bytes_that_are_not_compressed_stand_in_place_of_those_that_are() {
    let whole = changed(|_| {}).unwrap();
    let used = |pointer: &str, name: &str, value: Value, lacks: bool| {
        let change = |document: &mut Value| {
            document["extensionsUsed"] = json!([name]);
            document.pointer_mut(pointer).unwrap()["extensions"] = json!({name: value});
            if lacks && name == "KHR_draco_mesh_compression" {
                document["accessors"][0].as_object_mut().unwrap().remove("bufferView");
            } else if lacks {
                document["bufferViews"][0]["buffer"] = json!(1);
                document["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 48}));
            }
        };
        changed(change).map_err(|error| error.to_string())
    };
    // What is compressed here is nothing that could be decompressed.
    let draco = "KHR_draco_mesh_compression";
    let of_primitive = json!({"bufferView": 4, "attributes": {"POSITION": 0}});
    assert_eq!(used("/meshes/0/primitives/0", draco, of_primitive.clone(), false), Ok(whole.clone()));
    let error = used("/meshes/0/primitives/0", draco, of_primitive, true).unwrap_err();
    assert!(error.contains("mesh 0: primitive 0 cannot be decoded by Draco"), "{error}");
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let of_view = json!({"buffer": 0, "byteLength": 9, "byteStride": 12, "count": 4, "mode": "ATTRIBUTES"});
        assert_eq!(used("/bufferViews/0", name, of_view.clone(), false), Ok(whole.clone()));
        let error = used("/bufferViews/0", name, of_view, true).unwrap_err();
        assert!(error.contains("buffer view 0: its compressed bytes are damaged"), "{error}");
    }
}

#[test]
fn what_is_valid_and_not_needed_is_no_error() {
    let whole = changed(|_| {}).unwrap();
    let changes: [(&str, &str, Value); 12] = [
        ("/meshes/0/primitives/0/attributes", "_FEATURE_ID_0", json!(2)),
        ("/meshes/0/primitives/0/attributes", "_", json!(2)),
        ("/meshes/0/primitives/0/attributes", "_TEMPERATURE", json!(2)),
        ("", "scenes", json!([{"nodes": [0]}, {"name": "Scene.001"}])),
        ("", "scenes", json!([{"nodes": [0]}, {}])),
        (
            "",
            "animations",
            json!([{"channels": [{"sampler": 0, "target": {"path": "pointer"}}], "samplers": [{"input": 0, "output": 1}]}]),
        ),
        ("", "animations", json!([{}])),
        ("", "cameras", json!([{"type": "of another kind"}])),
        ("", "extensionsUsed", json!(["ACME_thing", "KHR_materials_clearcoat"])),
        ("/accessors/0", "count", json!(4.0)),
        ("/asset", "minVersion", json!("2.0")),
        ("/scenes/0", "name", Value::Null),
    ];
    for (place, key, value) in changes {
        let read = changed(|document| document.pointer_mut(place).unwrap()[key] = value.clone());
        assert!(read.as_ref().is_ok_and(|mesh| *mesh == whole), "{place} {key} {value}: {:?}", read.err());
    }
    // Scenes of nothing have no surface, and are no damage.
    let empty = changed_error(|document| document["scenes"] = json!([{}]));
    assert!(empty.contains("no triangles") && !empty.contains("not valid"), "{empty}");
    // Primitives without positions are not drawn (glTF 2.0, section 3.7.2.1).
    let mut with_blank = document();
    with_blank["meshes"][0]["primitives"].as_array_mut().unwrap().push(json!({"attributes": {"NORMAL": 0}}));
    let (mesh, notes) = import_noting("a.glb", &glb(&with_blank, &binary()));
    assert_eq!(mesh.unwrap(), whole);
    assert!(notes.contains("1 primitives without positions were left out"), "{notes}");
}

#[test]
fn what_is_lost_beside_the_surface_is_noted() {
    let mut document = document();
    document["meshes"][0]["primitives"][0]["attributes"]["_FEATURE_ID_0"] = json!(2);
    let noted = |document: &Value| import_noting("a.glb", &glb(document, &binary())).1;
    assert!(noted(&document).contains("custom attributes of the input are left out"), "{}", noted(&document));
    document["scenes"][0]["nodes"] = json!([0, 1]);
    document["nodes"] = json!([{"mesh": 0, "name": "roof"}, {"mesh": 0, "name": "wall"}]);
    assert!(noted(&document).contains("names of nodes"), "{}", noted(&document));
    // The name of the only part is that of the model.
    document["nodes"] = json!([{"mesh": 0, "name": "house"}, {"name": "nothing"}]);
    assert!(!noted(&document).contains("names of nodes"), "{}", noted(&document));
}

#[test]
fn extras_and_unknown_extensions_may_be_anything() {
    let more = json!({
        "materials": [{"pbrMetallicRoughness": {}}], "textures": [{"source": 0}], "samplers": [{}],
        "images": [{"uri": "missing.png"}], "cameras": [], "skins": [], "animations": []
    });
    let whole = changed(|_| {}).unwrap();
    let places = [
        "",
        "/asset",
        "/scenes/0",
        "/nodes/0",
        "/meshes/0",
        "/meshes/0/primitives/0",
        "/materials/0",
        "/textures/0",
        "/materials/0/pbrMetallicRoughness",
        "/samplers/0",
        "/images/0",
        "/accessors/0",
        "/bufferViews/0",
        "/buffers/0",
    ];
    for place in places {
        for value in [json!({"a": 1}), json!([1]), json!("text"), json!(3), json!(true), Value::Null] {
            let with = |key: &str, value: &Value| {
                let read = changed(|document| {
                    document.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
                    document.pointer_mut(place).unwrap()[key] = value.clone();
                });
                assert!(read.as_ref().is_ok_and(|mesh| *mesh == whole), "{place} {key} {value}: {:?}", read.err());
            };
            with("extras", &value);
            with("extensions", &json!({"ACME_thing": value}));
        }
    }
}

#[test]
fn meshes_that_are_not_in_their_base_shape_are_noted() {
    let noted = |of_mesh: Value, of_node: Value| {
        let mut document = document();
        document["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": 0}]);
        document["meshes"][0]["weights"] = of_mesh;
        document["nodes"][0]["weights"] = of_node;
        let (mesh, notes) = import_noting("a.glb", &glb(&document, &binary()));
        assert_eq!(mesh.unwrap(), changed(|_| {}).unwrap());
        notes.contains("1 meshes have morph targets with weights, which were ignored")
    };
    assert!(noted(json!([0.5]), Value::Null) && noted(Value::Null, json!([0.5])) && noted(json!([0]), json!([0.5])));
    assert!(!noted(json!([0.0]), Value::Null) && !noted(Value::Null, Value::Null) && !noted(json!([0.5]), json!([0])));
}

#[test]
fn damaged_documents_give_one_clear_error() {
    let far = json!([{"scale": [1e308, 1, 1], "children": [1]}, {"mesh": 0, "scale": [1e308, 1, 1]}]);
    let cases: [(&str, Value, &str); 19] = [
        ("/nodes/0/children", json!([0]), "node 0: is reached twice"),
        ("/scenes/0/nodes", json!([0, 0]), "node 0: is reached twice"),
        ("/nodes", far, "node 1: has a transform that is not finite"),
        ("/nodes/0/mesh", json!(7), "node 0: uses mesh 7, but there are 1"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(99), "mesh 0: uses accessor 99, but there are 3"),
        ("/meshes/0/primitives/0/indices", json!(99), "mesh 0: uses accessor 99, but there are 3"),
        ("/meshes/0/primitives/0/indices", json!(-1), "a whole number from 0 on"),
        ("/accessors/0/componentType", json!(5124), "accessor 0: has the component type 5124, which is none"),
        ("/accessors/0/bufferView", json!(5), "buffer view 5: is not there: the document has 5"),
        ("/bufferViews/0/buffer", json!(1), "buffer 1: is not there: the document has 1"),
        ("/nodes/0/children", json!([9]), "node 9: is named, but there are 1"),
        ("/scene", json!(3), "scene 3: is the default one, but there are 1"),
        ("/meshes/0/primitives/0/indices", json!(0), "accessor 0: indices must be single unsigned numbers"),
        ("/accessors/0/count", json!(5), "accessor 0: the file ends too early"),
        ("/accessors/0/count", json!(1_000_000_000_000_000_000u64), "accessor 0: the file ends too early"),
        ("/accessors/1/count", json!(1_000_000_000_000_000_000u64), "accessor 1: the file ends too early"),
        ("/accessors/0/byteOffset", json!(u64::MAX), "accessor 0: the file ends too early"),
        ("/bufferViews/0/byteOffset", json!(u64::MAX), "accessor 0: the file ends too early"),
        ("/accessors/0/count", json!(2), "face 0 uses vertex 2, but the file has 2 vertices"),
    ];
    for (pointer, value, expected) in cases {
        let error = changed_error(|d| {
            let (parent, key) = pointer.rsplit_once('/').unwrap();
            d.pointer_mut(parent).unwrap()[key] = value.clone();
        });
        assert!(error.contains(expected), "{pointer}: {error}");
    }
    let mut bytes = binary();
    bytes[12..16].copy_from_slice(&f32::INFINITY.to_le_bytes());
    assert!(error_of("a.glb", &glb(&document(), &bytes)).contains("accessor 0: vertex 1 has the coordinate inf"));
    bytes = binary();
    bytes[50..52].copy_from_slice(&4u16.to_le_bytes());
    assert!(error_of("a.glb", &glb(&document(), &bytes)).contains("mesh 0: face 0 uses vertex 4, but the file has 4"));
}

/// Calls `with` for each value of a document in turn, with a document in which something else stands in its place.
fn with_each_replaced(whole: &Value, other: &Value, with: &mut impl FnMut(&str, &Value)) {
    fn places(value: &Value, at: String, out: &mut Vec<String>) {
        match value {
            Value::Object(fields) => fields.iter().for_each(|(name, inner)| places(inner, format!("{at}/{name}"), out)),
            Value::Array(items) => {
                items.iter().enumerate().for_each(|(k, inner)| places(inner, format!("{at}/{k}"), out));
            }
            _ => {}
        }
        out.push(at);
    }
    let mut all = vec![];
    places(whole, String::new(), &mut all);
    for at in all {
        let mut changed = whole.clone();
        *changed.pointer_mut(&at).unwrap() = other.clone();
        with(&at, &changed);
    }
}

#[test]
fn values_of_other_types_are_one_clear_error_or_do_not_matter() {
    let mut whole = document();
    whole["scenes"] = json!([{"nodes": [0], "name": "a"}]);
    whole["nodes"] = json!([{"mesh": 0, "translation": [1, 2, 3], "children": [1], "skin": 0}, {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}]);
    whole["skins"] = json!([{"joints": [1]}]);
    whole["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK"}]);
    whole["textures"] = json!([{"source": 0, "sampler": 0, "extensions": {"EXT_texture_webp": {"source": 0}}}]);
    whole["images"] = json!([{"uri": "a.png"}]);
    whole["samplers"] = json!([{"wrapS": 10497}]);
    whole["extensionsUsed"] = json!(["KHR_materials_unlit"]);
    whole["extensionsRequired"] = json!([]);
    whole["meshes"][0]["primitives"][0]["material"] = json!(0);
    whole["accessors"][0]["sparse"] =
        json!({"count": 1, "indices": {"bufferView": 3, "componentType": 5125}, "values": {"bufferView": 4}});
    for other in [
        json!(1),
        json!(-1),
        json!(0.5),
        json!(1e300),
        json!("a"),
        json!(true),
        json!(null),
        json!([]),
        json!({}),
        json!([1]),
    ] {
        with_each_replaced(&whole, &other, &mut |at, changed| {
            if let Err(error) = import_bytes("a.glb", &glb(changed, &binary())) {
                let error = error.to_string();
                assert!(error.contains("a.glb") && !error.contains('\n'), "{at} {other}: {error}");
            }
        });
    }
    for (list, other) in
        [("scenes", json!([1])), ("nodes", json!([true])), ("meshes", json!(["a"])), ("scenes", json!({"a": 1}))]
    {
        let error = changed_error(|document| document[list] = other.clone());
        assert!(error.contains("not valid glTF JSON") && error.contains("byte"), "{list} {other}: {error}");
    }
}

#[test]
fn files_cut_anywhere_are_errors() {
    let bytes = glb(&document(), &binary());
    for length in 1..bytes.len() {
        error_of("a.glb", &bytes[..length]);
    }
    let text = document().to_string();
    for length in 1..text.len() {
        error_of("a.gltf", &text.as_bytes()[..length]);
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let bytes = glb(&document(), &binary());
    for at in 0..bytes.len() {
        for value in [0, 0xFF, bytes[at] ^ 1, bytes[at] ^ 0x10, b'9', b'-', b' '] {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            let _ = import_bytes("a.glb", &damaged);
        }
    }
}

#[test]
fn other_versions_and_buffers_outside_the_folder_are_refused() {
    let error = |change: &dyn Fn(&mut Value)| changed(|document| change(document)).unwrap_err().to_string();
    assert!(changed(|document| document["asset"]["version"] = json!("2.1")).is_ok());
    for (field, version) in [("version", "1.0"), ("version", "3.0"), ("minVersion", "2.1")] {
        let message = error(&|document| document["asset"][field] = json!(version));
        assert!(message.contains(&format!("glTF version {version}")), "{message}");
    }
    for (uri, word) in [
        ("../a.bin", "outside its folder"),
        ("/a.bin", "outside its folder"),
        ("file:///a.bin", "file:///a.bin"),
        ("missing.bin", "its buffer missing.bin cannot be read"),
    ] {
        let message = error(&|document| document["buffers"][0]["uri"] = json!(uri));
        assert!(message.contains(word) && message.contains("a.gl"), "{message}");
    }
}
