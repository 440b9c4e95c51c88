use std::sync::Mutex;

use glam::DVec3;
use serde_json::json;

use super::*;
use lodpack_mesh::Mesh;
use lodpack_runtime::progress::Silent;
use lodpack_runtime::storage::RecordReader;

/// Collects the notes.
#[derive(Default)]
pub(super) struct Notes(pub(super) Mutex<String>);

impl Progress for Notes {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, message: &str) {
        let mut notes = self.0.lock().unwrap();
        notes.push_str(message);
        notes.push('\n');
    }
}

/// Reads bytes as if they were a file of this name, and returns the mesh and the notes.
pub(super) fn import_noting(name: &str, bytes: &[u8]) -> (Result<Mesh, ImportError>, String) {
    let notes = Notes::default();
    let mut sink = MeshSink::new(Room::memory_alone(), &ImportOptions::shape());
    let read = read_mesh(&Source::new(Path::new(name), bytes, &notes), &mut sink);
    if let Some(left_out) = sink.left_out() {
        notes.note(&left_out);
    }
    let mesh = read.and_then(|()| sink.finish()).map_err(ImportError::from).map(|imported| match imported {
        Imported::Memory(surface) => surface.mesh,
        Imported::Spilled(_) => panic!("there is enough memory"),
    });
    if let Ok(mesh) = &mesh {
        if name.ends_with(".obj") && obj::looks_like_obj(bytes) {
            super::tobj_tests::assert_as_tobj(bytes, mesh);
        }
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
        assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.positions.len()));
        assert!(!mesh.triangles.is_empty());
    }
    (mesh, notes.0.into_inner().unwrap())
}

pub(super) fn import_bytes(name: &str, bytes: &[u8]) -> Result<Mesh, ImportError> {
    import_noting(name, bytes).0
}

/// The message of the expected error, which must name the file.
pub(super) fn error_of(name: &str, bytes: &[u8]) -> String {
    let message = import_bytes(name, bytes).expect_err("an error is expected").to_string();
    assert!(message.contains(name), "{message}");
    message
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// Nothing but the shape.
fn shape() -> ImportOptions {
    ImportOptions { objects: Objects::Auto, ..ImportOptions::shape() }
}

#[test]
fn inputs_are_joined_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..3).map(|i| folder.path().join(format!("{i}.obj"))).collect();
    for (i, path) in paths.iter().enumerate() {
        std::fs::write(path, format!("v 0 0 {i}\nv 1 0 {i}\nv 0 1 {i}\nf 1 2 3\n")).unwrap();
    }
    let mesh = import_meshes(&paths, &Silent).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 4, 5], [6, 7, 8]]);
    assert_eq!(mesh.positions[6].z, 2.0);
}

/// A mesh as PLY, OFF, OBJ, GLB, and glTF with everything embedded in its text.
fn formats(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> [(&'static str, Vec<u8>); 5] {
    let (n, m) = (positions.len(), triangles.len());
    let line = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}\n");
    let lines: Vec<String> = positions.iter().map(|p| line(p.map(f64::from))).collect();
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {m}\nproperty list int int vertex_indices\nend_header\n"
    );
    let mut off = format!("OFF\n{n} {m} 0\n");
    for text in [&mut ply, &mut off] {
        text.extend(lines.iter().cloned());
        text.extend(triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}\n")));
    }
    // Vertices, and then faces by number, counted back, and before their vertices.
    let mut obj: String =
        triangles[..m / 3].iter().map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1)).collect();
    obj.extend(lines.iter().map(|line| format!("v {line}")));
    let back = |v: u32| i64::from(v) - n as i64;
    obj.extend(triangles[m / 3..].iter().map(|&[a, b, c]| format!("f {}/1 {}//2 {}\n", back(a), b + 1, back(c))));

    let mut binary: Vec<u8> = positions.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    binary.extend(triangles.iter().flatten().flat_map(|v| v.to_le_bytes()));
    let mut document = json!({
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 12 * n},
            {"buffer": 0, "byteOffset": 12 * n, "byteLength": 12 * m}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": n, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3 * m, "type": "SCALAR"}
        ]
    });
    let glb = super::gltf::tests::glb(&document, &binary);
    let uri = format!("data:application/octet-stream;base64,{}", super::gltf::tests::base64(&binary));
    document["buffers"][0]["uri"] = uri.into();
    let gltf = document.to_string();
    let texts =
        [("ply", ply), ("off", off), ("obj", obj), ("gltf", gltf)].map(|(name, text)| (name, text.into_bytes()));
    let [ply, off, obj, gltf] = texts;
    [ply, off, obj, ("glb", glb), gltf]
}

/// Imports files into memory, then to disk with each of several amounts of memory; the result must be the same.
fn assert_same_on_disk(paths: &[PathBuf], amounts: &[u64]) -> Mesh {
    let temp = tempfile::tempdir().unwrap();
    let whole = import_meshes(paths, &Silent).unwrap();
    for &memory in amounts {
        let room = Room { memory, overflow: Overflow::New(temp.path().join("work")) };
        let Imported::Spilled(mesh) = import_large_meshes(paths, &room, &shape(), &Silent).unwrap() else {
            panic!("there is not enough memory")
        };
        assert_eq!((mesh.bounds, mesh.triangle_count), (whole.bounds(), whole.triangles.len() as u64));
        let positions = RecordReader::<DVec3>::open(&mesh.vertex_file).unwrap().read_all().unwrap();
        let triangles = RecordReader::<[u32; 3]>::open(&mesh.triangle_file).unwrap().read_all().unwrap();
        assert!(positions == whole.positions && triangles == whole.triangles);
    }
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 0);
    whole
}

#[test]
fn a_mesh_that_does_not_fit_goes_to_disk_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let vertices: Vec<String> = (0..9000).map(|i| format!("{} {} {}\n", i % 30, i / 30, f64::from(i).sin())).collect();
    // Quads, convex or not: 300 rows of 30 vertices each.
    let quads = (0..299u32).flat_map(|row| (0..29).map(move |column| row * 30 + column));
    let quads: Vec<[u32; 4]> = quads.map(|v| [v, v + 1, v + 31, v + 30]).collect();
    let mut ply = "ply\nformat ascii 1.0\nelement vertex 9000\nproperty float x\nproperty float y\nproperty float z\n\
         element face 8671\nproperty list int int vertex_indices\nend_header\n"
        .to_owned();
    let mut off = "COFF\n9000 8671 0\n".to_owned();
    for text in [&mut ply, &mut off] {
        text.extend(vertices.iter().cloned());
        text.extend(quads.iter().map(|[a, b, c, d]| format!("4 {a} {b} {c} {d}\n")));
    }
    // Every face as soon as the last, or the first, of its vertices exists.
    let (mut late, mut early) = (String::new(), String::new());
    for (i, vertex) in vertices.iter().enumerate() {
        let with =
            |corner: usize| quads.iter().skip(i.saturating_sub(330)).take(331).filter(move |q| q[corner] as usize == i);
        let face = |[a, b, c, d]: &[u32; 4]| format!("f {} {} {} {}\n", a + 1, b + 1, c + 1, d + 1);
        late += &format!("v {vertex}");
        late.extend(with(2).map(face));
        early.extend(with(0).map(face));
        early += &format!("v {vertex}");
    }
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0.1\nendloop\nendfacet\n";
    let stl = format!("solid a\n{}endsolid a\n", facet.repeat(200));
    let save = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let paths = [save("a.obj", TRIANGLE), save("b.ply", ply.as_bytes()), save("c.stl", stl.as_bytes())];
    // Not even enough for one vertex, or enough for part of the second file.
    let amounts = [
        1000,
        lodpack_runtime::storage::memory::mesh_bytes(4000, 1000),
        lodpack_runtime::storage::memory::mesh_bytes(9100, 10_000),
    ];
    for order in [[0, 1, 2], [1, 2, 0], [2, 1, 1]] {
        assert_same_on_disk(&order.map(|file| paths[file].clone()), &amounts);
    }
    let expected = import_meshes(&paths[1..2], &Silent).unwrap();
    for (name, text) in [("late.obj", late), ("early.obj", early), ("d.off", off)] {
        let path = save(name, text.as_bytes());
        assert!(assert_same_on_disk(std::slice::from_ref(&path), &amounts[..2]) == expected, "{name}");
        // After another file, so that its vertices are not numbered from 0.
        assert_same_on_disk(&[paths[2].clone(), path], &amounts);
    }
}

#[test]
fn all_formats_give_the_same_mesh_in_memory_and_on_disk() {
    let folder = tempfile::tempdir().unwrap();
    let (n, m) = (300u32, 260u32);
    let positions: Vec<[f32; 3]> =
        (0..n * m).map(|i| [(i % m) as f32 / 7.0, (i / m) as f32, (i as f32 * 0.01).sin()]).collect();
    let quads = (0..n - 1).flat_map(|row| (0..m - 1).map(move |column| row * m + column));
    let triangles: Vec<[u32; 3]> = quads.flat_map(|v| [[v, v + 1, v + m], [v + 1, v + m + 1, v + m]]).collect();
    let meshes = formats(&positions, &triangles).map(|(extension, bytes)| {
        let path = folder.path().join("mesh").with_extension(extension);
        std::fs::write(&path, bytes).unwrap();
        let enough = lodpack_runtime::storage::memory::mesh_bytes(0, 0) + (16 << 20);
        let amounts = if extension == "gltf" { [enough; 2] } else { [1000, enough] };
        assert_same_on_disk(&[path], &amounts)
    });
    assert!(meshes.iter().all(|mesh| *mesh == meshes[0]));
    assert_eq!(meshes[0].triangles, triangles);
}

#[test]
fn text_that_must_be_held_is_refused_without_memory_for_it() {
    let folder = tempfile::tempdir().unwrap();
    let positions = vec![[0.5f32, 0.25, 1.0]; 100_000];
    for (extension, bytes) in formats(&positions, &[[0, 1, 2]]) {
        let path = folder.path().join("mesh").with_extension(extension);
        std::fs::write(&path, bytes).unwrap();
        let import = |memory| {
            let room = Room { memory, overflow: Overflow::New(folder.path().join("work")) };
            import_large_meshes(std::slice::from_ref(&path), &room, &shape(), &Silent)
        };
        let Err(error) = import(28 << 20) else {
            assert_ne!(extension, "gltf");
            continue;
        };
        let error = error.to_string();
        assert!(extension == "gltf" && error.contains("mesh.gltf") && error.contains(".bin file"), "{error}");
        let needed: u64 = error.split_once("--memory ").unwrap().1.split_once("MiB").unwrap().0.parse().unwrap();
        assert!(import(needed << 20).is_ok());
    }
}

#[test]
fn inputs_that_are_not_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| import_meshes(&[path.to_owned()], &Silent).unwrap_err().to_string();
    assert!(message(folder.path()).contains("is a directory"));
    assert!(message(&folder.path().join("missing.ply")).contains("missing.ply: cannot be read"));
    assert!(message(Path::new("/dev/zero")).contains("device"));
    assert!(matches!(import_meshes(&[], &Silent), Err(ImportError::NoInput)));
    let empty = folder.path().join("empty.ply");
    std::fs::write(&empty, b"").unwrap();
    assert!(message(&empty).contains("empty.ply: the file is empty"));
}

#[test]
fn content_decides_the_format_before_the_name() {
    for name in ["a.ply", "a.stl", "a.glb", "a.gltf"] {
        assert!(import_bytes(name, TRIANGLE).is_err());
    }
    for name in ["a.obj", "a.OBJ", "a", "a.txt"] {
        assert_eq!(import_bytes(name, TRIANGLE).unwrap().triangles.len(), 1);
    }
    assert_eq!(import_bytes("a.obj", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty int x\nproperty int y\nproperty int z\nelement face 1\nproperty list int int vertex_index\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").unwrap().triangles.len(), 1);
}

#[test]
fn unknown_content_is_shown() {
    assert!(error_of("a.dat", b"Kaydara fbx Binary  \x00").contains("\"Kaydara fbx Bina\""));
    assert!(error_of("a.ply", b"plx\nformat").contains("must start with the line \"ply\""));
    assert!(error_of("a.glb", b"glTX\x02\0\0\0").contains("must start with the letters glTF"));
    assert!(error_of("a.gltf", b"[]").contains("JSON object"));
}
