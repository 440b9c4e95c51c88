//! Every OBJ text that tests of this room read, read by another reader as well.
//!
//! tobj refuses what it does not know: faces before their vertices, comments behind statements, lines that go on. What
//! it reads has the same triangles, area, box and materials here.

use glam::DVec3;

use super::attribute_tests::{Folder, OBJ_SQUARE};
use super::tests::import_noting;
use lodpack_mesh::Mesh;

/// What two readers have to agree on.
#[derive(Debug)]
struct Measured {
    triangles: usize,
    /// The sum of the areas of all triangles as vectors, which does not depend on how polygons are divided.
    area: DVec3,
    bounds: [DVec3; 2],
}

impl Measured {
    fn new() -> Self {
        Self { triangles: 0, area: DVec3::ZERO, bounds: Mesh::default().bounds() }
    }

    /// Adds a face by its corners, unless it has fewer than three distinct ones.
    fn add(&mut self, numbers: &[u32], corners: &[DVec3]) {
        let mut distinct = numbers.to_vec();
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() < 3 {
            return;
        }
        self.triangles += distinct.len() - 2;
        for (k, &corner) in corners.iter().enumerate() {
            let next = corners[(k + 1) % corners.len()];
            self.area += 0.5 * (corner - corners[0]).cross(next - corners[0]);
            self.bounds = [self.bounds[0].min(corner), self.bounds[1].max(corner)];
        }
    }

    fn assert_same(&self, other: &Self) {
        let size = (self.bounds[1] - self.bounds[0]).length();
        assert_eq!((self.triangles, self.bounds), (other.triangles, other.bounds));
        assert!((self.area - other.area).length() <= 1e-9 * size * size, "{self:?} {other:?}");
    }
}

/// What tobj reads of a text. None where it refuses it, or takes it for something else: it divides positions by
/// weights, takes lines of several corners for polygons, and knows no line ends of a carriage return alone.
fn by_tobj(text: &[u8]) -> Option<Measured> {
    let lines = || text.split(|&byte| byte == b'\n');
    let is_other = |line: &[u8]| {
        let words: Vec<&[u8]> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
        matches!(words[..], [b"v", _, _, _, _] | [b"l", _, _, _, ..])
    };
    let has_other_ends = lines().any(|line| line.strip_suffix(b"\r").unwrap_or(line).contains(&b'\r'));
    if lines().any(is_other) || has_other_ends {
        return None;
    }
    let no_library = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let (models, _) = tobj::load_obj_buf(&mut &*text, &tobj::LoadOptions::default(), no_library).ok()?;
    let mut measured = Measured::new();
    for tobj::Mesh { positions, indices, face_arities, .. } in models.into_iter().map(|model| model.mesh) {
        let position = |number: u32| DVec3::from_slice(&positions[3 * number as usize..][..3]);
        let mut rest = &indices[..];
        let arities = if face_arities.is_empty() { vec![3; indices.len() / 3] } else { face_arities };
        for arity in arities {
            let (face, others) = rest.split_at(arity as usize);
            let corners: Vec<DVec3> = face.iter().map(|&number| position(number)).collect();
            measured.add(face, &corners);
            rest = others;
        }
    }
    Some(measured)
}

/// Compares a mesh with what tobj reads of its text. Returns whether it reads it.
pub(super) fn assert_as_tobj(text: &[u8], mesh: &Mesh) -> bool {
    let Some(expected) = by_tobj(text) else { return false };
    let mut measured = Measured::new();
    for (number, triangle) in (0..).zip(&mesh.triangles) {
        measured.add(triangle, &mesh.corners(number));
    }
    measured.assert_same(&expected);
    true
}

#[test]
fn another_reader_of_obj_reads_the_same_surface() {
    let star: String = (0..10)
        .map(|k| {
            let (angle, radius) = (f64::from(k) * std::f64::consts::TAU / 10.0, f64::from(1 + k % 2));
            format!("v {} {} {}\n", angle.cos() * radius, angle.sin() * radius, 0.1 * radius)
        })
        .collect();
    for faces in [
        format!("{OBJ_SQUARE}f 1 2 3 4\n"),
        format!("{OBJ_SQUARE}f -4 -3 -2\ng a\nf 1/ 3/ 4/\n").replace("/ ", " ").replace("/\n", "\n"),
        format!("{OBJ_SQUARE}vt 0 0\nvt 1 1\nvn 0 0 1\nf 1/1/1 2/2/1 3/1/1\no b\nf 1//1 3//1 4//1\nl 1 2\np 1\n"),
        format!("{star}f 1 2 3 4 5 6 7 8 9 10\nf 1 1 2\nf 1 2\n"),
        format!("v 5000000.001 -5e6 0 1 0 0\nv 5000000.002 1 0 0 1 0\nv 5000000.003 0 1 0 0 1\nf 1 2 3\n# {star}\n"),
    ] {
        let (mesh, _) = import_noting("a.obj", faces.as_bytes());
        assert!(assert_as_tobj(faces.as_bytes(), &mesh.unwrap()), "{faces}");
    }
}

#[test]
#[should_panic(expected = "assertion")]
fn another_surface_is_told_from_that_of_the_text() {
    let (mesh, _) = import_noting("a.obj", format!("{OBJ_SQUARE}f 1 2 3\n").as_bytes());
    assert_as_tobj(format!("{OBJ_SQUARE}f 1 2 3 4\n").as_bytes(), &mesh.unwrap());
}

#[test]
fn another_reader_of_mtl_finds_the_same_materials_and_numbers() {
    let library = "newmtl Color_#1\nKd 0.5 0.25 1\nd 0.5\nnewmtl with spaces\nKd 0 1 0\nnewmtl unused\nKd 1 0 0\n";
    let obj = format!("mtllib my lib.mtl\n{OBJ_SQUARE}usemtl Color_#1\nf 1 2 3\nusemtl with spaces\nf 1 3 4\n");
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("my lib.mtl", library.as_bytes())]);
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    let (models, materials) = tobj::load_obj(folder.path("a.obj"), &tobj::LoadOptions::default()).unwrap();
    let materials = materials.unwrap();
    assert_eq!(models.len(), 2);
    for (triangle, model) in models.iter().enumerate() {
        let expected = &materials[model.mesh.material_id.unwrap()];
        let found = &appearance.materials[usize::from(attributes.materials[triangle])];
        assert_eq!(found.name, expected.name, "{notes}");
        let colour = expected.diffuse.unwrap().map(|value| lodpack_mesh::srgb::linear_from_srgb(value as f32));
        assert!((0..3).all(|k| (found.base_colour[k] - colour[k]).abs() < 3e-3), "{found:?}");
        let opacity = expected.dissolve.unwrap_or(1.0) as f32;
        assert!((found.base_colour[3] - opacity).abs() < 3e-3);
    }
}
