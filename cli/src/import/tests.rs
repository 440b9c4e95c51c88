use std::sync::Mutex;

use super::*;
use crate::progress::Silent;

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
    let mesh = read_mesh(&Source::new(Path::new(name), bytes, &notes)).map_err(ImportError::from);
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
