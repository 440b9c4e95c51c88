//! Small tilesets, sound and damaged ones.

use std::fs;

use serde_json::{Value, json};

use super::*;
use crate::progress::Silent;

/// glTF of one triangle in the plane of x and z, whose longer sides have this length.
fn triangle(side: f32) -> String {
    use std::fmt::Write;
    let numbers = [0.0, 0.0, 0.0, side, 0.0, 0.0, 0.0, 0.0, -side];
    // Base64 of 36 bytes: twelve groups of three.
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = numbers.iter().flat_map(|x: &f32| x.to_le_bytes()).collect();
    let mut text = String::new();
    for three in bytes.chunks(3) {
        let word = three.iter().fold(0usize, |word, &byte| word << 8 | usize::from(byte));
        for shift in [18, 12, 6, 0] {
            write!(text, "{}", char::from(LETTERS[word >> shift & 63])).unwrap();
        }
    }
    json!({
        "asset": {"version": "2.0"},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, -side], "max": [side, 0, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": format!("data:application/octet-stream;base64,{text}")}]
    })
    .to_string()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for side in [1.0f32, 2.0, 4.0] {
            folder.put(&format!("{side}.gltf"), triangle(side).as_bytes());
        }
        folder
    }

    fn put(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }

    fn tileset(&self, root: Value) -> PathBuf {
        let text = json!({"asset": {"version": "1.1"}, "geometricError": 100, "root": root}).to_string();
        self.put("tileset.json", text.as_bytes())
    }

    fn open(&self, root: Value) -> Result<Tileset, ReadError> {
        Tileset::open(&self.tileset(root))
    }
}

fn tile(error: f64, uri: &str, children: Vec<Value>) -> Value {
    json!({"boundingVolume": {"sphere": [0, 0, 0, 9]}, "geometricError": error, "content": {"uri": uri}, "children": children})
}

/// For each level what it claims, and the largest coordinates of what it draws.
fn shown(tileset: &Tileset) -> Vec<(f64, usize, [f64; 3])> {
    let of_level = |level: &Level| {
        let mesh = tileset.mesh(level, &Silent).unwrap();
        let most = mesh.positions.iter().fold(DVec3::NEG_INFINITY, |most, &p| most.max(p));
        (level.claimed, mesh.triangles.len(), most.to_array())
    };
    tileset.levels().iter().map(of_level).collect()
}

#[test]
fn levels_are_replaced_or_added_to_and_transforms_scale_errors() {
    let folder = Folder::new();
    let mut root = tile(8.0, "1.gltf", vec![tile(2.0, "2.gltf", vec![tile(0.0, "4.gltf", vec![])])]);
    root["transform"] = json!([2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 1e7, 0, 5, 1]);
    // z of glTF becomes -y.
    let most = |side: f64| [1e7 + 2.0 * side, 2.0 * side, 5.0];
    let replaced = folder.open(root.clone()).unwrap();
    assert_eq!(shown(&replaced), [(16.0, 1, most(1.0)), (4.0, 1, most(2.0)), (0.0, 1, most(4.0))]);
    assert_eq!(replaced.within(4.0).claimed, 4.0);
    assert_eq!(replaced.within(3.9).claimed, 0.0);
    root["refine"] = "ADD".into();
    assert_eq!(shown(&folder.open(root).unwrap()), [(16.0, 1, most(1.0)), (4.0, 2, most(2.0)), (0.0, 3, most(4.0))]);
}

#[test]
fn tilesets_lead_to_tilesets_and_empty_tiles_to_their_children() {
    let folder = Folder::new();
    let inner = json!({"asset": {"version": "1.0", "gltfUpAxis": "Z"}, "root": tile(1.0, "../2.gltf", vec![])});
    folder.put("inner/tileset.json", inner.to_string().as_bytes());
    let tileset = folder.open(tile(8.0, "inner/tileset.json?v=2", vec![])).unwrap();
    assert_eq!(shown(&tileset), [(1.0, 1, [2.0, 0.0, 0.0])]);
    let empty = json!({"geometricError": 9, "children": [tile(3.0, "1.gltf", vec![]), tile(4.0, "2.gltf", vec![])]});
    assert_eq!(shown(&folder.open(empty).unwrap()), [(4.0, 2, [2.0, 2.0, 0.0])]);
}

#[test]
fn contents_of_version_1_0_are_unpacked() {
    let folder = Folder::new();
    let padded = |text: &str, size: usize| format!("{text:size$}").into_bytes();
    let words = |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|word| word.to_le_bytes()).collect() };
    let model = triangle(1.0);
    let features = padded(r#"{"BATCH_LENGTH":0,"RTC_CENTER":[10,20,30]}"#, 48);
    let mut b3dm = b"b3dm".to_vec();
    b3dm.extend(words(&[1, (28 + features.len() + model.len()) as u32, features.len() as u32, 0, 0, 0]));
    b3dm.extend(&features);
    b3dm.extend(model.as_bytes());
    folder.put("a.b3dm", &b3dm);
    assert_eq!(shown(&folder.open(tile(0.0, "a.b3dm", vec![])).unwrap()), [(0.0, 1, [11.0, 21.0, 30.0])]);
    let features = padded(r#"{"INSTANCES_LENGTH":2,"POSITION":{"byteOffset":0},"SCALE":{"byteOffset":24}}"#, 80);
    let places: Vec<u8> = [0f32, 0.0, 0.0, 100.0, 0.0, 7.0, 1.0, 3.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let mut i3dm = b"i3dm".to_vec();
    let length = 32 + features.len() + places.len() + model.len();
    i3dm.extend(words(&[1, length as u32, features.len() as u32, places.len() as u32, 0, 0, 1]));
    i3dm.extend([features, places, model.into_bytes()].concat());
    let mut cmpt = b"cmpt".to_vec();
    cmpt.extend(words(&[1, (16 + b3dm.len() + i3dm.len()) as u32, 2]));
    cmpt.extend([b3dm, i3dm.clone()].concat());
    folder.put("a.cmpt", &cmpt);
    assert_eq!(shown(&folder.open(tile(0.0, "a.cmpt", vec![])).unwrap()), [(0.0, 3, [103.0, 21.0, 30.0])]);

    // At every byte, damage ends in an error or in triangles, and never in a panic.
    let tileset = folder.open(tile(0.0, "a.cmpt", vec![])).unwrap();
    let level = &tileset.levels()[0];
    for at in (0..64).chain(300..cmpt.len().min(420)) {
        for value in [0, 0xff] {
            let mut bytes = cmpt.clone();
            bytes[at] = value;
            folder.put("a.cmpt", &bytes);
            let _ = tileset.mesh(level, &Silent);
        }
        folder.put("a.cmpt", &cmpt[..at]);
        assert!(tileset.mesh(level, &Silent).is_err(), "{at}");
    }
    let many = i3dm.windows(17).position(|text| text == br#""INSTANCES_LENGTH"#).unwrap();
    let mut lying = i3dm;
    lying[many + 19] = b'9';
    folder.put("a.cmpt", &lying);
    assert!(tileset.mesh(level, &Silent).unwrap_err().to_string().contains("beyond its end"));
}

/// A quadtree of two levels in one subtree of one level each: the root and its children 0 and 3.
fn implicit(folder: &Folder) -> Value {
    let subtree = |tiles: u8, contents: u8, children: u8| {
        let text = json!({
            "buffers": [{"byteLength": 24}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 1},
                {"buffer": 0, "byteOffset": 8, "byteLength": 1},
                {"buffer": 0, "byteOffset": 16, "byteLength": 1}
            ],
            "tileAvailability": {"bitstream": 0},
            "contentAvailability": [{"bitstream": 1}],
            "childSubtreeAvailability": {"bitstream": 2}
        });
        let text = text.to_string();
        let width = text.len().next_multiple_of(8);
        let text = format!("{text:width$}");
        let mut bytes = b"subt".to_vec();
        bytes.extend(1u32.to_le_bytes());
        bytes.extend((text.len() as u64).to_le_bytes());
        bytes.extend(24u64.to_le_bytes());
        bytes.extend(text.as_bytes());
        for byte in [tiles, contents, children] {
            bytes.extend([byte, 0, 0, 0, 0, 0, 0, 0]);
        }
        bytes
    };
    folder.put("s/0/0/0.subtree", &subtree(1, 1, 0b1001));
    folder.put("s/1/0/0.subtree", &subtree(1, 1, 0));
    folder.put("s/1/1/1.subtree", &subtree(1, 1, 0));
    folder.put("c/0/0/0.gltf", triangle(1.0).as_bytes());
    folder.put("c/1/0/0.gltf", triangle(2.0).as_bytes());
    folder.put("c/1/1/1.gltf", triangle(4.0).as_bytes());
    json!({
        "boundingVolume": {"sphere": [0, 0, 0, 9]}, "geometricError": 8, "refine": "REPLACE",
        "content": {"uri": "c/{level}/{x}/{y}.gltf"},
        "implicitTiling": {
            "subdivisionScheme": "QUADTREE", "subtreeLevels": 1, "availableLevels": 2,
            "subtrees": {"uri": "s/{level}/{x}/{y}.subtree"}
        }
    })
}

#[test]
fn implicit_tiles_are_those_that_bits_say() {
    let folder = Folder::new();
    let root = implicit(&folder);
    assert_eq!(shown(&folder.open(root.clone()).unwrap()), [(8.0, 1, [1.0, 1.0, 0.0]), (4.0, 2, [4.0, 4.0, 0.0])]);
    // Counts that lie, and damage at every byte.
    for (levels, available) in [(0u32, 2u32), (40, 2), (u32::MAX, 2)] {
        let mut root = root.clone();
        root["implicitTiling"]["subtreeLevels"] = levels.into();
        root["implicitTiling"]["availableLevels"] = available.into();
        assert!(matches!(folder.open(root), Err(ReadError::Limit { .. })), "{levels}");
    }
    let mut deep = root.clone();
    deep["implicitTiling"]["subtreeLevels"] = 12.into();
    assert!(folder.open(deep).err().unwrap().to_string().contains("fewer bits"));
    let path = folder.tileset(root);
    let name = "s/0/0/0.subtree";
    let sound = fs::read(folder.0.path().join(name)).unwrap();
    for at in 0..sound.len() {
        let mut bytes = sound.clone();
        bytes[at] ^= 0xff;
        folder.put(name, &bytes);
        let _ = Tileset::open(&path);
        folder.put(name, &sound[..at]);
        assert!(Tileset::open(&path).is_err(), "{at}");
    }
}

#[test]
fn circles_depths_and_addresses_elsewhere_are_errors_that_name_them() {
    let folder = Folder::new();
    let fault = |root: Value| folder.open(root).err().unwrap();
    assert!(matches!(fault(tile(1.0, "tileset.json", vec![])), ReadError::Circle { .. }));
    let two = json!({"asset": {"version": "1.1"}, "root": tile(1.0, "tileset.json", vec![])});
    folder.put("two.json", two.to_string().as_bytes());
    assert!(matches!(fault(tile(1.0, "two.json", vec![])), ReadError::Circle { .. }));
    for uri in ["http://example.org/a.glb", "../a.glb", "/a.glb"] {
        let error = fault(tile(1.0, uri, vec![]));
        assert!(matches!(&error, ReadError::Elsewhere { uri: named, .. } if named == uri), "{error}");
    }
    for number in 0..200 {
        let next = json!({"asset": {"version": "1.1"}, "root": tile(1.0, &format!("{}.json", number + 1), vec![])});
        folder.put(&format!("{number}.json"), next.to_string().as_bytes());
    }
    assert!(matches!(fault(tile(1.0, "0.json", vec![])), ReadError::Limit { .. }));
    let deep = format!(
        "{{\"asset\": {{\"version\": \"1.1\"}}, \"root\": {}{}",
        "{\"geometricError\": 1, \"children\": [".repeat(100_000),
        "]}".repeat(100_000)
    );
    let path = folder.put("tileset.json", deep.as_bytes());
    assert!(Tileset::open(&path).err().unwrap().to_string().contains("recursion limit"));
    let missing = folder.open(tile(1.0, "gone.glb", vec![])).unwrap();
    assert!(matches!(missing.mesh(&missing.levels()[0], &Silent), Err(ReadError::Io { .. })));
    let mut bad = tile(1.0, "1.gltf", vec![]);
    bad["transform"] = json!([1, 2, 3]);
    assert!(matches!(fault(bad), ReadError::Damaged { .. }));
}
