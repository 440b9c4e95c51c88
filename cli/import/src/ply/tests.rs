use super::super::tests::{error_of, import_bytes, import_noting};
use super::*;
use lodpack_mesh::Mesh;

const ASCII: &str = "ply\nformat ascii 1.0\ncomment made for a test\nobj_info x\n\
    element vertex 4\nproperty float x\nproperty double y\nproperty float z\n\
    element face 2\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0.5\n1 1e0 -0\n0 1 0\n3 0 1 2\n3 0 2 3\n";

const SQUARE: [[f64; 3]; 4] = [[0., 0., 0.], [1., 0., 0.5], [1., 1., 0.], [0., 1., 0.]];

fn assert_is_square(mesh: &Mesh) {
    assert_eq!(mesh.positions.iter().map(|p| p.to_array()).collect::<Vec<_>>(), SQUARE);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
}

/// A number as any PLY type in any byte order.
fn push(bytes: &mut Vec<u8>, kind: &str, big_endian: bool, value: f64) {
    let mut word = match kind {
        "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
        "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
        "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
        "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
        "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
        "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
        "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
        _ => value.to_le_bytes().to_vec(),
    };
    if big_endian {
        word.reverse();
    }
    bytes.extend(word);
}

/// The square, with other elements and properties before, between and after.
fn crowded(format: &str, coordinate: &str, count: &str, index: &str, index_name: &str, faces_first: bool) -> Vec<u8> {
    let vertex = format!(
        "element vertex 4\nproperty list uchar short weights\nproperty {coordinate} z\nproperty uchar red\nproperty {coordinate} x\n\
         property {coordinate} y\nproperty list {count} float more\n"
    );
    let face = format!(
        "element face 2\nproperty double quality\nproperty list {count} {index} {index_name}\nproperty list uchar float texcoord\n"
    );
    let (first, second) = if faces_first { (&face, &vertex) } else { (&vertex, &face) };
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement nothing 1000000000000000000\nelement camera 2\nproperty float view\n\
         property list uchar double matrix\n{first}element edge 1\nproperty int a\n{second}element last 1\nproperty uchar b\nend_header\n"
    )
    .into_bytes();
    let mut item = |values: &[(&str, f64)]| {
        for &(kind, value) in values {
            if format == "ascii" {
                bytes.extend(format!("{value} ").bytes());
            } else {
                push(&mut bytes, kind, format == "binary_big_endian", value);
            }
        }
        if format == "ascii" {
            bytes.push(b'\n');
        }
    };
    item(&[("float", 1.0), ("uchar", 2.0), ("double", 0.1), ("double", 1e300)]);
    item(&[("float", 1.0), ("uchar", 0.0)]);
    for turn in [!faces_first, faces_first] {
        if turn {
            for [x, y, z] in SQUARE {
                let z = if coordinate.contains("int") { 2.0 * z } else { z };
                let weights = [("uchar", 2.0), ("short", -7.0), ("short", 300.0)];
                let location =
                    [(coordinate, z), ("uchar", 200.0), (coordinate, x), (coordinate, y), (count, 1.0), ("float", 0.5)];
                item(&[&weights[..], &location[..]].concat());
            }
        } else {
            for [a, b, c] in [[0., 1., 2.], [0., 2., 3.]] {
                item(&[
                    ("double", 0.5),
                    (count, 3.0),
                    (index, a),
                    (index, b),
                    (index, c),
                    ("uchar", 2.0),
                    ("float", 9.0),
                    ("float", 8.0),
                ]);
            }
        }
        if turn != faces_first {
            item(&[("int", -1.0)]);
        }
    }
    item(&[("uchar", 5.0)]);
    bytes
}

#[test]
fn ascii_is_read_with_any_line_ends() {
    assert_is_square(&import_bytes("a.ply", ASCII.as_bytes()).unwrap());
    assert_is_square(&import_bytes("a", ASCII.replace('\n', "\r\n").as_bytes()).unwrap());
    assert_is_square(&import_bytes("a.stl", ASCII.replace('\n', "\r").as_bytes()).unwrap());
    let (mesh, notes) = import_noting("a.ply", ASCII.trim_end().as_bytes());
    assert_is_square(&mesh.unwrap());
    assert!(notes.contains("no line end"));
}

#[test]
fn every_type_order_and_encoding_gives_the_same_mesh() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for index in ["char", "uint8", "short", "ushort", "int", "uint32", "float", "float64"] {
            for (coordinate, count) in
                [("float", "uchar"), ("double", "int"), ("float32", "ushort"), ("float64", "char")]
            {
                for (name, faces_first) in [("vertex_indices", false), ("vertex_index", true)] {
                    assert_is_square(
                        &import_bytes("a.ply", &crowded(format, coordinate, count, index, name, faces_first)).unwrap(),
                    );
                }
            }
        }
        let whole = import_bytes("a.ply", &crowded(format, "int16", "uchar", "int", "vertex_index", false)).unwrap();
        assert_eq!(whole.positions[1], DVec3::new(1.0, 0.0, 1.0));
    }
}

#[test]
fn files_cut_anywhere_are_errors_or_whole() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for faces_first in [false, true] {
            let bytes = crowded(format, "float", "uchar", "int", "vertex_indices", faces_first);
            for length in 1..bytes.len() {
                match import_bytes("a.ply", &bytes[..length]) {
                    // Only blanks after the last number are missing.
                    Ok(mesh) => {
                        assert!(format == "ascii" && length + 2 >= bytes.len());
                        assert_is_square(&mesh);
                    }
                    Err(error) => assert!(error.to_string().contains("a.ply: "), "{error}"),
                }
            }
        }
    }
}

#[test]
fn flipped_bytes_never_panic() {
    let whole = [
        crowded("ascii", "float", "uchar", "int", "vertex_indices", false),
        crowded("binary_big_endian", "double", "int", "uint", "vertex_index", true),
    ];
    for bytes in whole {
        for at in 0..bytes.len() {
            for value in [0, 0xFF, bytes[at] ^ 1, bytes[at] ^ 0x10, b'9', b'-', b'\n'] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let _ = import_bytes("a.ply", &damaged);
            }
        }
    }
}

#[test]
fn huge_counts_are_refused_at_once() {
    for count in ["1000000000000000000", "18446744073709551615", "4294967296", "13"] {
        for element in ["vertex 4", "face 2"] {
            let name = element.split(' ').next().unwrap();
            let error = error_of("a.ply", ASCII.replace(element, &format!("{name} {count}")).as_bytes());
            assert!(error.contains("ends too early") || count == "13", "{error}");
        }
    }
    assert!(
        error_of("a.ply", ASCII.replace("vertex 4", "vertex 18446744073709551616").as_bytes())
            .contains("is not a count")
    );
    assert!(error_of("a.ply", ASCII.replace("vertex 4", "vertex -4").as_bytes()).contains("line 5"));
    for format in ["binary_little_endian", "binary_big_endian"] {
        let bytes = crowded(format, "float", "uint", "int", "vertex_indices", false);
        let at = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        for (from, count) in [("face 2", "face 1000000000000000000"), ("camera 2", "camera 999999999999")] {
            let (header, body) = bytes.split_at(at);
            let header = String::from_utf8(header.to_vec()).unwrap().replace(from, count);
            assert!(error_of("a.ply", &[header.as_bytes(), body].concat()).contains("ends too early"));
        }
        // The length of the first face's list.
        let mut damaged = bytes.clone();
        let list = bytes.len() - 1 - (8 + 4 + 12 + 1 + 8) * 2 + 8;
        damaged[list..list + 4].copy_from_slice(&[0xFF; 4]);
        error_of("a.ply", &damaged);
    }
}

#[test]
fn bad_values_name_their_line() {
    for (from, to, expected) in [
        ("3 0 1 2", "3 0 1 4", "a.ply: line 16: face 0 uses vertex 4, but the file has 4 vertices numbered from 0"),
        ("3 0 2 3", "3 0 -1 3", "line 17: face 1 uses vertex -1"),
        ("3 0 2 3", "3 0 1.5 3", "line 17: \"1.5\" is not a whole number"),
        ("3 0 2 3", "-3 0 1 3", "line 17: a list has the length -3"),
        ("3 0 2 3", "3 0 2 3 1", "line 17: this line has more numbers"),
        ("1 0 0.5", "1 nan 0.5", "line 13: vertex 1 has the coordinate NaN"),
        ("1 0 0.5", "1 0 -inf", "line 13: vertex 1 has the coordinate -inf"),
        ("1 0 0.5", "1 0 1e999", "line 13: vertex 1 has the coordinate inf"),
        ("1 0 0.5", "1 0 x", "line 13: \"x\" is not a number"),
        ("1 0 0.5", "1 0", "line 14: this line has more numbers"),
        ("1 0 0.5", "1 0 0.5 7", "line 13: this line has more numbers"),
        ("float x", "float u", "line 5: vertices have no property \"x\""),
        ("float z", "list uchar float z", "line 5: vertices need exactly one number"),
        ("vertex_indices", "corners", "line 9: \"face\" has no list"),
        ("property double y", "property quad y", "line 7: unknown type \"quad\""),
        ("element face 2", "element vertex 2", "line 9: element \"vertex\" is declared twice"),
        ("format ascii 1.0", "format ascii 2.0", "PLY version 2.0"),
        ("format ascii 1.0", "format text 1.0", "line 2: unknown PLY format"),
        ("format ascii 1.0", "comment", "no line \"format\""),
        ("element vertex 4", "comment", "line 6: property \"x\" comes before any element"),
        ("end_header", "end", "line 11: cannot understand"),
        ("element face 2", "element face 0", "no triangles: the file has 4 vertices"),
        ("element face", "element facet", "no triangles: the file has 4 vertices"),
    ] {
        let error = error_of("a.ply", ASCII.replacen(from, to, 1).as_bytes());
        assert!(error.contains(expected), "{error}");
    }
    let mut bytes = crowded("binary_little_endian", "float", "uchar", "int", "vertex_indices", false);
    let at = bytes.len() - 1 - (8 + 1 + 12 + 1 + 8) + 8 + 1;
    bytes[at..at + 4].copy_from_slice(&(-2i32).to_le_bytes());
    let error = error_of("a.ply", &bytes);
    assert!(error.contains(&format!("byte {}: face 1 uses vertex -2", at - 9)), "{error}");
}

#[test]
fn polygons_are_triangulated_and_thin_faces_noted() {
    let mut text = "ply\nformat ascii 1.0\nelement vertex 20\nproperty float x\nproperty float y\nproperty float z\n\
        element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        .to_owned();
    for i in 0..20 {
        let (angle, radius) = (f64::from(i) / 20.0 * std::f64::consts::TAU, if i % 2 == 0 { 2.0 } else { 0.5 });
        text += &format!("{} {} 0\n", angle.cos() * radius, angle.sin() * radius);
    }
    let polygon: String = (0..20).map(|i| format!(" {i}")).collect();
    text += &format!("2 0 1\n20{polygon}\n0\n4 0 5 10 15\n");
    let (mesh, notes) = import_noting("a.ply", text.as_bytes());
    let mesh = mesh.unwrap();
    let area = |t: u32| {
        let [a, b, c] = mesh.corners(t);
        (b - a).cross(c - a).z / 2.0
    };
    assert_eq!(mesh.triangles.len(), 20);
    assert!((0..18).all(|t| area(t) > 0.0));
    let expected = 10.0 * (std::f64::consts::TAU / 20.0).sin();
    assert!(((0..18).map(area).sum::<f64>() - expected).abs() < 1e-6);
    assert!(notes.contains("2 faces with fewer than three"), "{notes}");
}

#[test]
fn strips_are_read() {
    let text = ASCII.replace("element face 2\nproperty list uchar int", "element tristrips 1\nproperty list int int");
    let text = text.replace("3 0 1 2\n3 0 2 3\n", "9 0 1 3 2 -1 0 0 1 3\n");
    let mesh = import_bytes("a.ply", text.as_bytes()).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 3], [3, 1, 2], [1, 0, 3]]);
    assert!(error_of("a.ply", text.replace("-1", "-2").as_bytes()).contains("uses vertex -2"));
}

#[test]
fn far_coordinates_keep_their_millimetres() {
    let text = ASCII
        .replace("float x", "double x")
        .replace("1 0 0.5", "5000000.001 0 0.5")
        .replace("1 1e0 -0", "5000000.002 1 0");
    let mesh = import_bytes("a.ply", text.as_bytes()).unwrap();
    assert_eq!([mesh.positions[1].x, mesh.positions[2].x], [5000000.001, 5000000.002]);
    let mut bytes = crowded("binary_big_endian", "double", "uchar", "int", "vertex_indices", false);
    let one = bytes.windows(8).rposition(|w| w == 1f64.to_be_bytes()).unwrap();
    bytes[one..one + 8].copy_from_slice(&5000000.001f64.to_be_bytes());
    assert_eq!(import_bytes("a.ply", &bytes).unwrap().bounds()[1].max_element(), 5000000.001);
}
