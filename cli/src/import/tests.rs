use std::sync::Mutex;

use glam::DVec3;

use super::*;
use crate::mesh::Mesh;
use crate::progress::Silent;
use crate::work::RecordReader;

/// Remembers the notes.
#[derive(Default)]
struct Notes(Mutex<String>);

impl Progress for Notes {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, message: &str) {
        let mut notes = self.0.lock().unwrap();
        notes.push_str(message);
        notes.push('\n');
    }
}

/// Reads bytes as if they were a file of this name, and returns the notes.
pub(super) fn import_noting(name: &str, bytes: &[u8]) -> (Result<Mesh, ImportError>, String) {
    let notes = Notes::default();
    let mut sink = MeshSink::new(Room::memory_alone());
    let read = read_mesh(&Source::new(Path::new(name), bytes, &notes), &mut sink);
    let mesh = read.and_then(|()| sink.finish()).map_err(ImportError::from).map(|imported| match imported {
        Imported::Memory(mesh) => mesh,
        Imported::Spilled(_) => panic!("there is memory enough"),
    });
    if let Ok(mesh) = &mesh {
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
        assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < mesh.positions.len()));
        assert!(!mesh.triangles.is_empty());
    }
    (mesh, notes.0.into_inner().unwrap())
}

pub(super) fn import_bytes(name: &str, bytes: &[u8]) -> Result<Mesh, ImportError> {
    import_noting(name, bytes).0
}

/// The message of the error that must come, which must name the file.
pub(super) fn error_of(name: &str, bytes: &[u8]) -> String {
    let message = import_bytes(name, bytes).expect_err("an error must come").to_string();
    assert!(message.contains(name), "{message}");
    message
}

const TRIANGLE: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

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

#[test]
fn what_does_not_fit_goes_to_disk_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let vertices: String = (0..9000).map(|i| format!("{} {} {}\n", i % 30, i / 30, f64::from(i).sin())).collect();
    // Quads, convex or not, of 300 rows with 30 vertices each.
    let faces = (0..299u32).flat_map(|row| (0..29).map(move |column| row * 30 + column));
    let faces: String = faces.map(|v| format!("4 {} {} {} {}\n", v, v + 1, v + 31, v + 30)).collect();
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 9000\nproperty float x\nproperty float y\nproperty float z\n\
         element face 8671\nproperty list int int vertex_indices\nend_header\n{vertices}{faces}"
    );
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0.1\nendloop\nendfacet\n";
    let stl = format!("solid a\n{}endsolid a\n", facet.repeat(200));
    let files: [(&str, &[u8]); 3] = [("a.obj", TRIANGLE), ("b.ply", ply.as_bytes()), ("c.stl", stl.as_bytes())];
    let paths = files.map(|(name, bytes)| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    });
    let temp = tempfile::tempdir().unwrap();
    for order in [[0, 1, 2], [1, 2, 0], [2, 1, 1]] {
        let paths = order.map(|file| paths[file].clone());
        let whole = import_meshes(&paths, &Silent).unwrap();
        // Not even a vertex, or some of the second file.
        for memory in [1000, crate::memory::mesh_bytes(4000, 1000), crate::memory::mesh_bytes(9100, 10_000)] {
            let room = Room { memory, overflow: Overflow::New(temp.path().join("work")) };
            let Imported::Spilled(mesh) = import_large_meshes(&paths, &room, &Silent).unwrap() else {
                panic!("there is not memory enough")
            };
            assert_eq!((mesh.bounds, mesh.triangle_count), (whole.bounds(), whole.triangles.len() as u64));
            let positions = RecordReader::<DVec3>::open(&mesh.vertex_file).unwrap().read_all().unwrap();
            let triangles = RecordReader::<[u32; 3]>::open(&mesh.triangle_file).unwrap().read_all().unwrap();
            assert!(positions == whole.positions && triangles == whole.triangles);
        }
    }
    assert_eq!(std::fs::read_dir(temp.path()).unwrap().count(), 0);
    let room = Room { memory: 100, overflow: Overflow::New(temp.path().join("work")) };
    let error = import_large_meshes(&paths[..1], &room, &Silent).unwrap_err().to_string();
    assert!(error.contains("a.obj") && error.contains("PLY or STL"), "{error}");
}

#[test]
fn inputs_that_are_no_files_are_named() {
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
fn content_decides_before_the_name() {
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
    assert!(error_of("a.fbx", b"Kaydara FBX Binary  \x00").contains("\"Kaydara FBX Bina\""));
    assert!(error_of("a.ply", b"plx\nformat").contains("must start with the line \"ply\""));
    assert!(error_of("a.glb", b"glTX\x02\0\0\0").contains("must start with the letters glTF"));
    assert!(error_of("a.gltf", b"[]").contains("JSON object"));
}
