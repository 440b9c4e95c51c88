//! Inputs that are read in ranges give what an import of the whole gives.

use std::path::PathBuf;

use super::*;
use lodpack_mesh::export::{MeshFormat, write_mesh};

/// A small mesh with vertices that no triangle has.
fn mesh() -> Mesh {
    let position = |i: u32| glam::DVec3::new(f64::from(i) * 0.25, f64::from(i * i % 7), -f64::from(i % 3));
    Mesh {
        positions: (0..50).map(position).collect(),
        triangles: (0..45).map(|t| [t, (t * 7 + 1) % 47, (t * 3 + 2) % 47]).collect(),
    }
}

/// A PLY of triangles in some types and either byte order.
fn ply(big_endian: bool, double: bool, index: &str, extra: bool) -> Vec<u8> {
    let mesh = mesh();
    let (order, coordinate) = (if big_endian { "big" } else { "little" }, if double { "double" } else { "float" });
    let normal = if extra { "property float nx\nproperty uchar ny\n" } else { "" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex {}\nproperty {coordinate} z\n{normal}property {coordinate} x\n\
         property {coordinate} y\nelement face {}\nproperty list uchar {index} vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    )
    .into_bytes();
    let mut push = |mut word: Vec<u8>| {
        if big_endian {
            word.reverse();
        }
        bytes.extend(word);
    };
    let number = |value: f64| {
        if double { value.to_le_bytes().to_vec() } else { (value as f32).to_le_bytes().to_vec() }
    };
    for p in &mesh.positions {
        push(number(p.z));
        if extra {
            push(1.5_f32.to_le_bytes().to_vec());
            push(vec![7]);
        }
        push(number(p.x));
        push(number(p.y));
    }
    for triangle in &mesh.triangles {
        push(vec![3]);
        for vertex in triangle {
            push(if index == "int" { vertex.to_le_bytes().to_vec() } else { (*vertex as u16).to_le_bytes().to_vec() });
        }
    }
    bytes
}

fn open(files: &[(&str, Vec<u8>)], channels: &Channels) -> (tempfile::TempDir, Vec<PathBuf>, Option<RangedMesh>) {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| folder.path().join(name)).collect();
    files.iter().zip(&paths).for_each(|((_, bytes), path)| std::fs::write(path, bytes).unwrap());
    let mesh = RangedMesh::open(&paths, channels, None).unwrap();
    (folder, paths, mesh)
}

fn assert_is_import(files: &[(&str, Vec<u8>)]) {
    let (_folder, paths, ranged) = open(files, &Channels::Auto);
    let (ranged, whole) = (ranged.expect("it has ranges"), import_meshes(&paths, &Silent).unwrap());
    assert_eq!(ranged.vertex_count(), whole.positions.len() as u64);
    assert_eq!(ranged.triangle_count(), whole.triangles.len() as u64);
    let positions: Vec<glam::DVec3> = (0..ranged.vertex_count() as u32).map(|v| ranged.position(v)).collect();
    assert_eq!(positions, whole.positions);
    assert!(ranged.position(whole.positions.len() as u32).is_nan());
    for cuts in [vec![], vec![1], vec![40, 44, 46, 90]] {
        let ends = cuts.iter().copied().chain([whole.triangles.len() as u64]);
        let (mut triangles, mut first) = (vec![], 0);
        for end in ends.map(|end: u64| end.min(whole.triangles.len() as u64)) {
            ranged.for_each_triangle(first..end, |triangle| triangles.push(triangle)).unwrap();
            first = end;
        }
        assert_eq!(triangles, whole.triangles);
    }
    // Each vertex belongs to the bytes in which it begins.
    let mut bounds = Mesh::default().bounds();
    for (file, path) in paths.iter().enumerate() {
        let size = std::fs::metadata(path).unwrap().len();
        for bytes in [0..size / 3, size / 3..size / 3 + 1, size / 3 + 1..size] {
            let of_bytes = ranged.check_vertices(file, bytes).unwrap();
            bounds = [bounds[0].min(of_bytes[0]), bounds[1].max(of_bytes[1])];
        }
    }
    assert_eq!(bounds, whole.bounds());
}

fn stl() -> Vec<u8> {
    let (mesh, mut bytes) = (mesh(), vec![]);
    let positions: Vec<[f64; 3]> = mesh.positions.iter().map(|p| p.to_array()).collect();
    write_mesh(&mut bytes, MeshFormat::Stl, &positions, &mesh.triangles).unwrap();
    bytes
}

#[test]
fn ranges_give_what_an_import_gives() {
    for big_endian in [false, true] {
        for double in [false, true] {
            assert_is_import(&[("a.ply", ply(big_endian, double, "int", false))]);
            assert_is_import(&[("a.ply", ply(big_endian, double, "ushort", true))]);
        }
    }
    // Axes in their usual order are read in another way.
    for double in [false, true] {
        let mut bytes = ply(false, double, "int", false);
        for (from, to) in [(" z\n", " X\n"), (" x\n", " Y\n"), (" y\n", " Z\n")] {
            let at = bytes.windows(3).position(|some| some == from.as_bytes()).unwrap();
            bytes[at..at + 3].copy_from_slice(to.as_bytes());
        }
        let header = bytes.windows(10).position(|some| some == b"end_header").unwrap();
        bytes[..header].iter_mut().filter(|byte| b"XYZ".contains(byte)).for_each(|byte| byte.make_ascii_lowercase());
        assert_is_import(&[("a.ply", bytes)]);
    }
    assert_is_import(&[("a.stl", stl())]);
    let several =
        [("a.ply", ply(false, false, "int", false)), ("b.stl", stl()), ("c.ply", ply(true, true, "ushort", true))];
    assert_is_import(&several);
}

#[test]
fn what_has_no_ranges_or_carries_more_is_left_to_the_import() {
    let plain = ply(false, false, "int", false);
    let renamed = |from: &str, to: &str| {
        let at = plain.windows(from.len()).position(|some| some == from.as_bytes()).unwrap();
        [&plain[..at], to.as_bytes(), &plain[at + from.len()..]].concat()
    };
    let longer = [&plain[..], b"\0"].concat();
    let quality = ply(false, false, "int", true);
    let at = quality.windows(3).position(|some| some == b" nx").unwrap();
    let quality = [&quality[..at], b" qx", &quality[at + 3..]].concat();
    for bytes in [
        longer,
        plain[..plain.len() - 1].to_vec(),
        renamed("end_header", "element tristrips 0\nproperty list int int vertex_indices\nend_header"),
        renamed("end_header", "comment TextureFile a.png\nend_header"),
        renamed("property list uchar int vertex_indices", "property list uchar int vertex_indices\nproperty uchar red"),
        renamed("element face", "property list uchar int more\nelement face"),
        quality,
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
          property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
            .to_vec(),
    ] {
        assert!(open(&[("a.ply", bytes.clone())], &Channels::Auto).2.is_none(), "{}", String::from_utf8_lossy(&bytes));
    }
    assert!(open(&[("a.ply", plain.clone())], &Channels::All).2.is_none(), "normals are made");
    assert!(open(&[("a.ply", plain.clone())], &Channels::Named(vec!["quality".into()])).2.is_none());
    assert!(open(&[("a.ply", plain), ("b.stl", [stl(), vec![0]].concat())], &Channels::Auto).2.is_none());
}

#[test]
fn damage_within_a_range_names_the_place() {
    let sound = ply(false, false, "int", false);
    let mesh = mesh();
    let faces = sound.len() - 13 * mesh.triangles.len();
    let error = |bytes: Vec<u8>, range: std::ops::Range<u64>| {
        let (_folder, _paths, ranged) = open(&[("a.ply", bytes)], &Channels::Auto);
        let ranged = ranged.expect("it has ranges");
        let vertices = ranged.check_vertices(0, 0..u64::MAX).map(drop);
        vertices.and_then(|()| ranged.for_each_triangle(range, |_| {})).map_err(|error| error.to_string())
    };
    // Two lists that make up for each other.
    let mut bytes = sound.clone();
    bytes[faces + 13 * 20] = 4;
    assert_eq!(error(bytes.clone(), 0..20), Ok(()));
    let message = error(bytes, 20..30).unwrap_err();
    assert!(message.contains("face 20 has 4 corners") && message.contains("--stages"), "{message}");
    let mut bytes = sound.clone();
    bytes[faces + 13 * 7 + 1..][..4].copy_from_slice(&50_u32.to_le_bytes());
    let message = error(bytes, 5..30).unwrap_err();
    assert!(message.contains("a.ply") && message.contains("50"), "{message}");
    let mut bytes = sound.clone();
    bytes[faces + 13 * 7 + 1..][..4].copy_from_slice(&(-2_i32).to_le_bytes());
    let message = error(bytes, 5..30).unwrap_err();
    assert!(message.contains("-2"), "{message}");
    let mut bytes = sound;
    bytes[faces - 4..faces].copy_from_slice(&f32::NAN.to_le_bytes());
    let message = error(bytes, 0..1).unwrap_err();
    assert!(message.contains("vertex 49 has the coordinate NaN"), "{message}");
}
