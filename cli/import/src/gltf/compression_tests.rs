//! Compressed files: each value comes in as it was encoded, and damage anywhere is an error or another mesh, never
//! more.

use meshopt::{
    EncodeExpMode, encode_filter_color, encode_filter_exp, encode_filter_oct, encode_filter_quat, encode_index_buffer,
    encode_index_sequence, encode_vertex_buffer,
};
use serde_json::{Value, json};

use super::super::attribute_tests::Folder;
use super::super::tests::{error_of, import_bytes};
use super::document::Compressed;
use super::meshopt::decompress;
use super::tests::glb;
use lodpack_mesh::Mesh;

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.0]];
const CORNERS: [u32; 6] = [0, 1, 2, 0, 2, 3];

/// A document of compressed views: each has a stride, a count, a mode, a filter and encoded bytes.
fn compressed(name: &str, views: &[(u64, usize, &str, &str, Vec<u8>)], accessors: Value, attributes: Value) -> Vec<u8> {
    let (mut binary, mut list, mut fallback_bytes) = (vec![], vec![], 0);
    for (stride, count, mode, filter, bytes) in views {
        let length = *stride as usize * count;
        let mut view = json!({"buffer": 1, "byteOffset": fallback_bytes, "byteLength": length, "extensions": {
            name: {"buffer": 0, "byteOffset": binary.len(), "byteLength": bytes.len(), "byteStride": stride, "count": count, "mode": mode}
        }});
        if *filter != "NONE" {
            view["extensions"][name]["filter"] = json!(filter);
        }
        if *mode == "ATTRIBUTES" {
            view["byteStride"] = json!(stride);
        }
        list.push(view);
        fallback_bytes += length.next_multiple_of(4);
        binary.extend(bytes);
        binary.resize(binary.len().next_multiple_of(4), 0);
    }
    let document = json!({
        "asset": {"version": "2.0"}, "extensionsUsed": [name], "extensionsRequired": [name],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 0}]}],
        "accessors": accessors, "bufferViews": list,
        "buffers": [{"byteLength": binary.len()}, {"byteLength": fallback_bytes, "extensions": {name: {"fallback": true}}}]
    });
    glb(&document, &binary)
}

/// The square, with `index_bytes` bytes an index.
fn square(name: &str, mode: &str, index_bytes: u64) -> Vec<u8> {
    let indices = match mode {
        "TRIANGLES" => encode_index_buffer(&CORNERS, 4).unwrap(),
        _ => encode_index_sequence(&CORNERS, 4).unwrap(),
    };
    let accessors = json!([
        {"bufferView": 0, "componentType": if index_bytes == 2 { 5123 } else { 5125 }, "count": 6, "type": "SCALAR"},
        {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"}
    ]);
    let views = [
        (index_bytes, 6, mode, "NONE", indices),
        (12, 4, "ATTRIBUTES", "NONE", encode_vertex_buffer(&SQUARE).unwrap()),
    ];
    compressed(name, &views, accessors, json!({"POSITION": 1}))
}

/// The triangles of a square by their corners: the codec may turn and order them.
fn assert_square(mesh: &Mesh) {
    assert_eq!(mesh.positions.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<_>>(), SQUARE);
    let mut triangles: Vec<[u32; 3]> = mesh.triangles.clone();
    triangles.iter_mut().for_each(|triangle| {
        let least = (0..3).min_by_key(|&k| triangle[k]).unwrap();
        triangle.rotate_left(least);
    });
    triangles.sort_unstable();
    assert_eq!(triangles, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn views_of_meshoptimizer_are_what_was_encoded() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        for mode in ["TRIANGLES", "INDICES"] {
            for index_bytes in [2, 4] {
                assert_square(&import_bytes("a.glb", &square(name, mode, index_bytes)).unwrap());
            }
        }
    }
}

/// Decodes a view alone.
fn decoded(stride: u64, count: u64, mode: &str, filter: &str, bytes: &[u8]) -> Result<Vec<u8>, String> {
    let json = json!({"byteStride": stride, "count": count, "mode": mode, "filter": filter});
    decompress(bytes, &serde_json::from_value::<Compressed>(json).unwrap())
}

#[test]
fn vertices_of_every_length_come_back() {
    fn check<const N: usize>() {
        let vertices: Vec<[u32; N]> =
            (0..300u32).map(|i| std::array::from_fn(|k| i * 7 + (k as u32) * 65_537)).collect();
        let encoded = encode_vertex_buffer(&vertices).unwrap();
        let expected: Vec<u8> = vertices.as_flattened().iter().flat_map(|word| word.to_ne_bytes()).collect();
        assert_eq!(decoded(4 * N as u64, 300, "ATTRIBUTES", "NONE", &encoded), Ok(expected), "{N}");
    }
    check::<1>();
    check::<2>();
    check::<3>();
    check::<5>();
    check::<16>();
    check::<33>();
    check::<64>();
}

#[test]
fn filters_give_back_what_was_filtered() {
    let near = |found: f64, expected: f32, step: f64| {
        assert!((found - f64::from(expected)).abs() <= step, "{found} {expected}")
    };
    let directions = [[0.0f32, 0.0, 1.0, 0.0], [0.6, 0.0, -0.8, 0.0], [-0.6, 0.64, 0.48, 0.0], [0.0, -1.0, 0.0, 0.0]];
    let small = encode_vertex_buffer(&encode_filter_oct::<i8>(&directions, 8)).unwrap();
    let found = decoded(4, 4, "ATTRIBUTES", "OCTAHEDRAL", &small).unwrap();
    for (found, expected) in found.as_chunks::<4>().0.iter().zip(directions) {
        (0..3).for_each(|k| near(f64::from(found[k] as i8) / 127.0, expected[k], 0.03));
    }
    let large = encode_vertex_buffer(&encode_filter_oct::<i16>(&directions, 16)).unwrap();
    let found = decoded(8, 4, "ATTRIBUTES", "OCTAHEDRAL", &large).unwrap();
    for (found, expected) in found.as_chunks::<8>().0.iter().zip(directions) {
        (0..3).for_each(|k| {
            near(f64::from(i16::from_ne_bytes([found[2 * k], found[2 * k + 1]])) / 32767.0, expected[k], 1e-4)
        });
    }
    let turns = [[0.0f32, 0.0, 0.6, 0.8], [0.5, 0.5, 0.5, 0.5]];
    let encoded = encode_vertex_buffer(&encode_filter_quat(&turns, 16)).unwrap();
    let found = decoded(8, 2, "ATTRIBUTES", "QUATERNION", &encoded).unwrap();
    for (found, expected) in found.as_chunks::<8>().0.iter().zip(turns) {
        (0..4).for_each(|k| {
            near(f64::from(i16::from_ne_bytes([found[2 * k], found[2 * k + 1]])) / 32767.0, expected[k], 1e-4)
        });
    }
    let numbers = [[0.5f32, -1000.25, 3e-5], [7.0, 0.0, 1.0]];
    let encoded = encode_vertex_buffer(&encode_filter_exp(&numbers, 20, EncodeExpMode::Separate)).unwrap();
    let found = decoded(12, 2, "ATTRIBUTES", "EXPONENTIAL", &encoded).unwrap();
    for (found, expected) in found.as_chunks::<4>().0.iter().zip(numbers.as_flattened()) {
        near(f64::from(f32::from_ne_bytes(*found)), *expected, f64::from(expected.abs()) * 1e-5);
    }
    let colours = [[1.0f32, 0.5, 0.25, 1.0], [0.0, 0.0, 1.0, 0.5]];
    let encoded = encode_vertex_buffer(&encode_filter_color::<u8>(&colours, 8)).unwrap();
    let found = decoded(4, 2, "ATTRIBUTES", "COLOR", &encoded).unwrap();
    for (found, expected) in found.iter().zip(colours.as_flattened()) {
        near(f64::from(*found) / 255.0, *expected, 0.02);
    }
    let encoded = encode_vertex_buffer(&encode_filter_color::<u16>(&colours, 12)).unwrap();
    let found = decoded(8, 2, "ATTRIBUTES", "COLOR", &encoded).unwrap();
    for (found, expected) in found.as_chunks::<2>().0.iter().zip(colours.as_flattened()) {
        near(f64::from(u16::from_ne_bytes(*found)) / 65535.0, *expected, 2e-3);
    }
}

#[test]
fn views_whose_counts_lie_are_refused_before_anything_is_allocated() {
    let encoded = encode_vertex_buffer(&SQUARE).unwrap();
    for (stride, count, mode, filter, problem) in [
        (12, u64::MAX, "ATTRIBUTES", "NONE", "which is impossible"),
        (12, 1 << 40, "ATTRIBUTES", "NONE", "which is impossible"),
        (4, 1 << 40, "TRIANGLES", "NONE", "which is impossible"),
        (2, 1 << 40, "INDICES", "NONE", "which is impossible"),
        (12, 40, "ATTRIBUTES", "NONE", "damaged"),
        (12, 3, "TRIANGLES", "NONE", "a stride of 12 bytes, which TRIANGLES cannot have"),
        (4, 4, "TRIANGLES", "NONE", "4 indices as triangles"),
        (4, 3, "TRIANGLES", "OCTAHEDRAL", "not supported"),
        (13, 4, "ATTRIBUTES", "NONE", "a stride of 13 bytes"),
        (260, 4, "ATTRIBUTES", "NONE", "a stride of 260 bytes"),
        (0, 4, "ATTRIBUTES", "NONE", "a stride of 0 bytes"),
        (12, 4, "ATTRIBUTES", "OCTAHEDRAL", "the filter OCTAHEDRAL"),
        (12, 4, "ATTRIBUTES", "QUATERNION", "not supported"),
        (12, 4, "ATTRIBUTES", "WAVELET", "the filter WAVELET"),
        (12, 4, "POINTS", "NONE", "compressed as POINTS"),
    ] {
        let error = decoded(stride, count, mode, filter, &encoded).unwrap_err();
        assert!(error.contains(problem), "{stride} {count} {mode} {filter}: {error}");
    }
    assert_eq!(decoded(12, 0, "ATTRIBUTES", "NONE", &[]), Ok(vec![]));
    // The densest vertices there are still count as possible.
    let even = vec![[7u32]; 100_000];
    let encoded = encode_vertex_buffer(&even).unwrap();
    assert!(decoded(4, 100_000, "ATTRIBUTES", "NONE", &encoded).is_ok(), "{}", encoded.len());
}

#[test]
fn a_small_file_of_meshoptimizer_that_is_damaged_anywhere_never_panics() {
    let bytes = square("EXT_meshopt_compression", "TRIANGLES", 2);
    damage_everywhere(&bytes);
    for length in 1..bytes.len() {
        error_of("a.glb", &bytes[..length]);
    }
}

fn damage_everywhere(bytes: &[u8]) {
    for at in 0..bytes.len() {
        for value in [0, 0xFF, bytes[at] ^ 1, bytes[at] ^ 0x80, b'9'] {
            let mut damaged = bytes.to_vec();
            damaged[at] = value;
            let _ = import_bytes("a.glb", &damaged);
        }
    }
}

/// 3 x 3 vertices at (column, row, column * row / 4), with normals up, coordinates of (column, row) / 2 and colours of
/// (40 column, 40 row, 200, 255) of bytes; positions have 14 bits, normals 8, coordinates 10. Encoded by npm's draco3d
/// 1.5.7, `Encoder.EncodeMeshToDracoBuffer`: with edges at speed 0 (valences) and 7, and in sequence.
const GRIDS: [(&str, &str); 3] = [
    (
        "edgebreaker with valences",
        "RFJBQ08CAgEBAAAACQgDCAEAA+/TGv8BEf8CiED/AohA/wKIQAT/AAEAAAABAAACAAABAAkDAAACAQEJAwABAwEDCQIAAgIBAgIEAAMBAQEBAA8DHQcnVRU5DlkVBZrP\
         +UuA////DwD9//7//wMA9P8AAAAEwP8DAADg/wEAAACAAAAA/w8AAAAABAAAAAD/PwAAAAAAAAAAAAAAAAAAAAAAQA4GAwEACQMdBxflOAM1xYXVFdYK5wjnEFh/JHsk\
         YwR/AP8AAAB/AAAA/wKZQAgFAQEACwM5DgcdBx0HOQ4dBwc9DgURE7zOlv///7//0D6AB4DyLgAHAAAAJQP1BYEAAAAA/wMAAAAAAAAAAAAAAACAPwoBAQEBBXCNM8kB\
         /zORA1UFd8kBB6JTWKxc/pYAAAAA/wAAAA==",
    ),
    (
        "edgebreaker",
        "RFJBQ08CAgEBAAAACQgACAEAA+/TGv8BEQH/AAAEAAkDAAABCQMAAQMJAgACAgIEAAMCAwIBAQEBAA8DHQcnVRU5DlkVBZrP+UuA////DwD9//7//wMA9P8AAAAEwP8D\
         AADg/wEAAACAAAAA/w8AAAAABAAAAAD/PwAAAAMBAQGAAXE8//eRAwOgzIr/AAAAfwAAAAEBAQALA60qH1UVAypiTP///7//APQvAAAAAAD/AwAAAQEBAQFwjTPJAf8z\
         kQNVBXfJAQeiU1isXP6WAAAAAP8AAAAAAAAAAAAAAAAAAAAAAABADggAAAAAAAAAAAAAgD8K",
    ),
    (
        "sequential",
        "RFJBQ08CAgEAAAAICQEAAQMBBAMBAgQCBQQDBAYEBwYEBQcFCAcBBAAJAwAAAQkDAAEDCQIAAgICBAADAgMCAQABAQAPAx0HL+U4AwTghfj/AQAAwP8HAAAAAeD/BwD+\
         fwAAAPL/AQAASADw//+//x8AAAD9fwAAAAQAAAAA/z8AAAADAQEBgAFxPP/3kQMDoMyK/wAAAH8AAAAAAQEACwMdBx/lOAME4IX8D4D/AAjw//8A+A+AAP7/D4D/AAAA\
         AAAA/wMAAAABAQEBoAGpKskB/zc5DnfJAbuRAwnS9VxfzBAftIAAAAAA/wAAAAAAAAAAAAAAAAAAAAAAAEAOCAAAAAAAAAAAAACAPwo=",
    ),
];

/// A document whose only primitive is a stream of Draco; `change` changes its JSON.
fn draco(stream: &[u8], change: impl Fn(&mut Value)) -> Vec<u8> {
    let name = "KHR_draco_mesh_compression";
    let mut document = json!({
        "asset": {"version": "2.0"}, "extensionsUsed": [name], "extensionsRequired": [name],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 1, "NORMAL": 2, "TEXCOORD_0": 3, "COLOR_0": 4}, "indices": 0,
            "extensions": {name: {"bufferView": 0, "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3}}}
        }]}],
        "accessors": [
            {"componentType": 5125, "count": 24, "type": "SCALAR"},
            {"componentType": 5126, "count": 9, "type": "VEC3"},
            {"componentType": 5126, "count": 9, "type": "VEC3"},
            {"componentType": 5126, "count": 9, "type": "VEC2"},
            {"componentType": 5121, "normalized": true, "count": 9, "type": "VEC4"}
        ],
        "bufferViews": [{"buffer": 0, "byteLength": stream.len()}], "buffers": [{"byteLength": stream.len()}]
    });
    change(&mut document);
    glb(&document, stream)
}

fn grid(text: &str) -> Vec<u8> {
    super::buffers::decode_data_uri(&format!("data:;base64,{text}")).unwrap()
}

/// A grid of nine points, for tests of the decoder itself.
pub(super) fn one_stream_of_draco() -> Vec<u8> {
    grid(GRIDS[1].1)
}

#[test]
fn primitives_of_draco_are_what_was_encoded() {
    for (kind, text) in GRIDS {
        let folder = Folder::new(&[("a.glb", &draco(&grid(text), |_| {}))]);
        let (surface, _) = folder.import(&["a.glb"], "all").0.unwrap();
        assert_eq!((surface.mesh.positions.len(), surface.mesh.triangles.len()), (9, 8), "{kind}");
        let layout = &surface.attributes.files[0].layout;
        let values = surface.attributes.vertex_values.chunks_exact(layout.stride);
        for (position, values) in surface.mesh.positions.iter().zip(values) {
            let [column, row] = [position.x.round(), position.y.round()];
            let expected = glam::DVec3::new(column, row, column * row / 4.0);
            // Half of a step of 14 bits.
            assert!(position.distance(expected) < 2e-4, "{kind} {position}");
            let colour = layout.colour.unwrap();
            let expected = [40.0 * column, 40.0 * row, 200.0, 255.0].map(|byte| (byte / 255.0) as f32);
            assert!(
                values[colour..colour + 4]
                    .iter()
                    .zip(expected)
                    .all(|(found, expected)| (found - expected).abs() < 1e-6),
                "{kind} {values:?}"
            );
            let normal = layout.normal.unwrap();
            assert!(values[normal + 2] > 0.999, "{kind} {values:?}");
        }
        let up = |t: u32| {
            let [a, b, c] = surface.mesh.corners(t);
            (b - a).cross(c - a).z
        };
        assert!((0..8).all(|t| (up(t) - 1.0).abs() < 1e-3), "{kind}");
    }
}

#[test]
fn streams_of_draco_that_are_cut_are_errors_and_name_the_primitive() {
    for (kind, text) in GRIDS {
        let stream = grid(text);
        for length in 0..stream.len() {
            let error = error_of("a.glb", &draco(&stream[..length], |_| {}));
            assert!(
                error.contains("mesh 0: primitive 0 cannot be decoded by Draco") || length == 0,
                "{kind} {length} {error}"
            );
        }
        let missing = draco(&stream, |document| {
            let extension = &mut document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"];
            extension["attributes"]["POSITION"] = json!(9);
        });
        assert!(error_of("a.glb", &missing).contains("accessor 1: it has no data"));
    }
}

#[test]
fn a_small_stream_of_draco_that_is_damaged_anywhere_never_panics() {
    for (_, text) in GRIDS {
        let stream = grid(text);
        for at in 0..stream.len() {
            for value in [0, 0xFF, stream[at] ^ 1, stream[at] ^ 0x80, stream[at].wrapping_add(1)] {
                let mut damaged = stream.clone();
                damaged[at] = value;
                let _ = import_bytes("a.glb", &draco(&damaged, |_| {}));
            }
        }
    }
    damage_everywhere(&draco(&grid(GRIDS[1].1), |_| {}));
}

#[test]
fn a_stream_of_draco_has_the_vertices_that_it_says_whatever_its_accessors_say() {
    let count = |change: &dyn Fn(&mut Value)| {
        let read = import_bytes("a.glb", &draco(&grid(GRIDS[1].1), change)).map_err(|error| error.to_string());
        read.map(|mesh| [mesh.positions.len(), mesh.triangles.len()])
    };
    assert_eq!(count(&|d| d["accessors"][1]["count"] = json!(1_000_000_000_000u64)), Ok([9, 8]));
    assert_eq!(count(&|d| d["accessors"][0]["count"] = json!(3)), Ok([9, 8]));
    // What was a strip is triangles.
    assert_eq!(count(&|d| d["meshes"][0]["primitives"][0]["mode"] = json!(5)), Ok([9, 8]));
}

#[test]
fn a_primitive_of_draco_is_drawn_at_all_of_its_nodes() {
    let bytes = draco(&grid(GRIDS[0].1), |document| {
        document["nodes"] =
            json!([{"mesh": 0}, {"mesh": 0, "scale": [-1, 1, 1]}, {"mesh": 0, "translation": [5e6, 0.1, 0]}]);
    });
    let mesh = import_bytes("a.glb", &bytes).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (27, 24));
    let up = |t: u32| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(c - a).z
    };
    assert!((0..24).all(|t| up(t) > 0.9));
}

#[test]
fn many_primitives_that_name_one_stream_are_as_many_surfaces() {
    let many = draco(&grid(GRIDS[0].1), |document| {
        let primitive = document["meshes"][0]["primitives"][0].clone();
        document["meshes"][0]["primitives"] = json!(vec![primitive; 500]);
    });
    let mesh = import_bytes("a.glb", &many).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (500 * 9, 500 * 8));
}
