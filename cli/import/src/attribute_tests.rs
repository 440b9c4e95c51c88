//! Colours, textures and numbers of input files, sound and damaged, in memory and on disk.

use std::fs;

use image::{DynamicImage, ImageBuffer, ImageFormat, Rgba};
use serde_json::json;

use super::tests::Notes;
use super::*;
use lodpack_mesh::appearance::{AlphaMode, Appearance, Wrap};
use lodpack_mesh::attributes::{AttributeValues, RegionAttributes, Surface};
use lodpack_mesh::images::ImageSource;
use lodpack_mesh::srgb::{LINEAR_OF_BYTE, linear_from_srgb};
use lodpack_runtime::storage::{Lookup, RecordReader, WorkDirectory};

/// Reads files with these channels.
fn kept(channels: &str) -> ImportOptions {
    ImportOptions { channels: channels.parse().unwrap(), ..ImportOptions::default() }
}

/// A folder with files in it.
pub(super) struct Folder(tempfile::TempDir);

impl Folder {
    pub(super) fn new(files: &[(&str, &[u8])]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        files.iter().for_each(|(name, bytes)| fs::write(folder.path(name), bytes).unwrap());
        folder
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Imports files into memory; returns the surface with the attributes of its triangles, and the notes.
    pub(super) fn import(
        &self,
        names: &[&str],
        channels: &str,
    ) -> (Result<(Surface, RegionAttributes), String>, String) {
        let notes = Notes::default();
        let paths: Vec<PathBuf> = names.iter().map(|name| self.path(name)).collect();
        let imported = import_large_meshes(&paths, &Room::memory_alone(), &kept(channels), &notes);
        let imported = imported.map_err(|error| error.to_string()).map(|imported| match imported {
            Imported::Memory(surface) => {
                let Surface { mesh, attributes, appearance } = &surface;
                let numbered = (0..mesh.triangles.len() as u32).zip(mesh.triangles.iter().copied());
                let attributes = RegionAttributes::gather(attributes, appearance, attributes, numbered);
                self.assert_same_on_disk(&paths, channels, &surface, &attributes);
                (surface, attributes)
            }
            Imported::Spilled(_) => panic!("there is enough memory"),
        });
        (imported, notes.0.into_inner().unwrap())
    }

    pub(super) fn sound(&self, names: &[&str]) -> (Appearance, RegionAttributes, String) {
        let (imported, notes) = self.import(names, "auto");
        let (surface, attributes) = imported.unwrap();
        (surface.appearance, attributes, notes)
    }

    /// Imports to disk, where the mesh must be the same and have the same attributes.
    fn assert_same_on_disk(&self, paths: &[PathBuf], channels: &str, surface: &Surface, attributes: &RegionAttributes) {
        let is_gltf = paths.iter().any(|path| path.extension().is_some_and(|e| e == "gltf"));
        let room = if is_gltf {
            let directory = WorkDirectory::create(&self.path("work")).unwrap();
            Room { memory: 64 << 20, overflow: Overflow::Into(directory) }
        } else {
            Room { memory: 1 << 20, overflow: Overflow::New(self.path("work")) }
        };
        let imported = import_large_meshes(paths, &room, &kept(channels), &Silent);
        let Ok(Imported::Spilled(mesh)) = imported else { panic!("there is not enough memory") };
        let named: Vec<u32> = mesh.appearance.materials.iter().flat_map(|material| material.images()).collect();
        let kept = (0..).zip(&mesh.appearance.images).all(|(number, image)| match image {
            ImageSource::Kept { .. } => image.open(Some(mesh.directory.folder())).is_ok(),
            // Only images that no material uses stay where they were.
            _ => !named.contains(&number),
        });
        assert!(kept);
        let mut appearance = mesh.appearance.clone();
        appearance.images.clone_from(&surface.appearance.images);
        assert_eq!(appearance, surface.appearance);
        let triangles = RecordReader::<[u32; 3]>::open(&mesh.triangle_file).unwrap().read_all().unwrap();
        let positions = (0..mesh.vertices.count() as u32).map(|v| mesh.vertices.position(v)).collect();
        let values = ValuesOnDisk(
            mesh.value_files.as_ref().map(|files| files.each_ref().map(|file| Lookup::open(file).unwrap())),
        );
        let numbered = (0..triangles.len() as u32).zip(triangles.iter().copied());
        assert!(RegionAttributes::gather(&mesh.attributes, &mesh.appearance, &values, numbered) == *attributes);
        assert!(Mesh { positions, triangles } == surface.mesh);
    }
}

/// The values of vertices and of corners, where there are any.
struct ValuesOnDisk(Option<[Lookup; 2]>);

impl AttributeValues for ValuesOnDisk {
    fn of_vertex(&self, place: u64, values: &mut [f32]) {
        self.0.as_ref().unwrap()[0].floats(place, values);
    }

    fn of_corner(&self, place: u64, values: &mut [f32]) {
        self.0.as_ref().unwrap()[1].floats(place, values);
    }
}

const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

/// A PLY file of a square, with more properties and values of vertices and faces.
pub(super) fn ply(comments: &str, of_vertices: (&str, [&str; 4]), of_faces: (&str, &[&str])) -> Vec<u8> {
    let vertices: String =
        SQUARE.lines().zip(of_vertices.1).map(|(position, values)| format!("{position} {values}\n")).collect();
    let faces: String = of_faces.1.iter().map(|face| format!("{face}\n")).collect();
    let count = of_faces.1.len();
    format!(
        "ply\nformat ascii 1.0\n{comments}element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{}\
         element face {count}\nproperty list uchar int vertex_indices\n{}end_header\n{vertices}{faces}",
        of_vertices.0, of_faces.0
    )
    .into_bytes()
}

pub(super) fn png(width: u32, height: u32) -> Vec<u8> {
    let image = ImageBuffer::from_fn(width, height, |x, y| Rgba([x as u8 * 16, y as u8 * 16, 7, 255]));
    let mut bytes = std::io::Cursor::new(vec![]);
    DynamicImage::ImageRgba8(image).write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}

pub(super) const BYTES: &str = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
pub(super) const RED_TO_BLUE: [&str; 4] = ["255 0 0", "0 128 0", "0 0 255", "9 9 9"];
pub(super) const QUAD: (&str, &[&str]) = ("", &["4 0 1 2 3"]);

/// The colours of all corners.
pub(super) fn colours(appearance: &Appearance, attributes: &RegionAttributes) -> Vec<[f32; 4]> {
    let place = appearance.layout.colour.unwrap();
    let corners = attributes.corners.iter().flatten();
    corners
        .map(|&corner| {
            attributes.records[corner as usize * appearance.layout.stride + place..][..4].try_into().unwrap()
        })
        .collect()
}

pub(super) fn uvs(appearance: &Appearance, attributes: &RegionAttributes) -> Vec<[f32; 2]> {
    let place = appearance.layout.uv[0];
    let corners = attributes.corners.iter().flatten();
    corners
        .map(|&corner| {
            attributes.records[corner as usize * appearance.layout.stride + place..][..2].try_into().unwrap()
        })
        .collect()
}

#[test]
fn vertex_colours_of_ply_come_in_all_types() {
    let floats = BYTES.replace("uchar", "float");
    let words = BYTES.replace("uchar", "ushort");
    let diffuse = BYTES.replace("uchar ", "uchar diffuse_");
    for (properties, values) in [
        (BYTES, RED_TO_BLUE),
        (diffuse.as_str(), RED_TO_BLUE),
        (words.as_str(), ["65535 0 0", "0 32896 0", "0 0 65535", "2313 2313 2313"]),
        (floats.as_str(), ["1 0 0", "0 0.5019608 0", "0 0 1", "0.03529412 0.03529412 0.03529412"]),
    ] {
        let folder = Folder::new(&[("a.ply", &ply("", (properties, values), QUAD))]);
        let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
        let grey = LINEAR_OF_BYTE[9];
        let expected = [[1., 0., 0., 1.], [0., LINEAR_OF_BYTE[128], 0., 1.], [0., 0., 1., 1.], [grey, grey, grey, 1.]];
        let found = colours(&appearance, &attributes);
        for (corner, vertex) in [0, 1, 2, 0, 2, 3].into_iter().enumerate() {
            assert!((0..4).all(|i| (found[corner][i] - expected[vertex][i]).abs() < 1e-6), "{properties}: {found:?}");
        }
        // Each record is there once.
        assert_eq!((attributes.records.len(), appearance.has_alpha), (16, false));
        assert!(notes.contains("channels: colour (vertex colours)") && !notes.contains("left out"), "{notes}");
    }
}

#[test]
fn each_image_has_one_number() {
    let mut sink = super::attributes::AttributeSink::new(&Channels::Auto);
    let file = |path: &str, range| ImageSource::File { path: path.into(), range };
    let inline = |bytes: &[u8]| ImageSource::Inline { name: "a".into(), bytes: bytes.to_vec() };
    let images = [file("a", None), file("a", Some(0..3)), file("a", Some(3..6)), inline(b"a"), inline(b"b")];
    for _ in 0..2 {
        let numbers: Vec<u32> = images.iter().map(|image| sink.add_image(image.clone())).collect();
        assert_eq!(numbers, [0, 1, 2, 3, 4]);
    }
}

#[test]
fn alpha_counts_only_where_some_of_it_is_not_opaque() {
    let properties = format!("{BYTES}property uchar alpha\n");
    for (last, expected) in [("9 9 9 255", false), ("9 9 9 51", true)] {
        let values = ["255 0 0 255", "0 128 0 255", "0 0 255 255", last];
        let folder = Folder::new(&[("a.ply", &ply("", (&properties, values), QUAD))]);
        let (appearance, attributes, _) = folder.sound(&["a.ply"]);
        assert_eq!(appearance.has_alpha, expected);
        assert_eq!(colours(&appearance, &attributes)[5][3], if expected { 0.2 } else { 1.0 });
    }
}

#[test]
fn without_channels_nothing_is_kept_and_nothing_is_said_of_them() {
    let folder = Folder::new(&[("a.ply", &ply("", (BYTES, RED_TO_BLUE), QUAD))]);
    let (imported, notes) = folder.import(&["a.ply"], "none");
    let (surface, attributes) = imported.unwrap();
    assert_eq!((surface.appearance, attributes), (Appearance::default(), RegionAttributes::default()));
    assert!(surface.attributes.files.is_empty());
    assert_eq!(notes, "colours of the input are left out\n");
    // Nor is anything kept of an input that has nothing.
    let folder = Folder::new(&[("a.ply", &ply("", ("", [""; 4]), QUAD))]);
    let (imported, notes) = folder.import(&["a.ply"], "auto");
    assert!(imported.unwrap().0.attributes.files.is_empty() && notes.is_empty(), "{notes}");
}

#[test]
fn numbers_of_vertices_are_scalars_by_name() {
    let properties = format!("{BYTES}property float nx\nproperty double quality\nproperty int label\n");
    let values = ["1 2 3 0 0.5 4", "1 2 3 0 -1e3 5", "1 2 3 0 nan 6", "1 2 3 0 inf 7"];
    let folder = Folder::new(&[("a.ply", &ply("", (&properties, values), QUAD))]);
    let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
    let ranges: Vec<_> = appearance.scalars.iter().map(|s| (s.name.as_str(), s.low, s.high, s.is_whole)).collect();
    assert_eq!(ranges, [("quality", -1000.0, 0.5, false), ("label", 4.0, 7.0, true)]);
    assert!(notes.contains("label (PLY property), quality (PLY property)") && notes.contains("normals"), "{notes}");
    let [_, _, c] = attributes.records_of(0, appearance.layout.stride);
    assert!(c[4].is_nan() && c[5] == 6.0, "{c:?}");
    // By name, and names that are not there.
    let (imported, notes) = folder.import(&["a.ply"], "label");
    let (surface, _) = imported.unwrap();
    assert_eq!((surface.appearance.scalars.len(), surface.appearance.has_colour), (1, false));
    assert!(notes.contains("channels: label (PLY property); not asked for: colour"), "{notes}");
    let (imported, _) = folder.import(&["a.ply"], "label,heat");
    let error = imported.unwrap_err();
    assert!(error.contains("no channel \"heat\"; it has colour, label, quality"), "{error}");
}

#[test]
fn numbers_that_are_missing_or_rounded_are_noted_and_too_many_refused() {
    let properties = format!("{BYTES}property double quality\nproperty double time\n");
    let values = ["1 2 3 nan 1600000001", "1 2 3 inf 1600000002", "1 2 3 1 1600000003", "1 2 3 2 1600000004"];
    let folder = Folder::new(&[("a.ply", &ply("", (&properties, values), QUAD))]);
    let (_, _, notes) = folder.sound(&["a.ply"]);
    assert!(notes.contains("quality is no finite number at 2 vertices, which get what is beside them"), "{notes}");
    assert!(notes.contains("time has numbers of more digits than are kept: they may be off by 64"), "{notes}");

    let many: String = (0..70).map(|number| format!("property float n{number}\n")).collect();
    let zeros = format!("1 2 3{}", " 0".repeat(70));
    let values = [zeros.as_str(); 4];
    let folder = Folder::new(&[("a.ply", &ply("", (&format!("{BYTES}{many}"), values), QUAD))]);
    let error = folder.import(&["a.ply"], "auto").0.unwrap_err();
    assert!(error.contains("has 71 channels, of which a file keeps 63: choose some with --channels"), "{error}");
    assert!(folder.import(&["a.ply"], "n1,n69").0.is_ok());
}

#[test]
fn float_colours_above_one_are_clamped_and_counted() {
    let floats = BYTES.replace("uchar", "float");
    let values = ["2 0 0", "0 1 0", "nan 0 -1", "0 0 0"];
    let folder = Folder::new(&[("a.ply", &ply("", (&floats, values), QUAD))]);
    let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
    assert!(notes.contains("a.ply: 3 values of colours are outside"), "{notes}");
    assert_eq!(colours(&appearance, &attributes)[0], [1., 0., 0., 1.]);
}

#[test]
fn colours_that_are_lists_are_noted_and_left_out() {
    let properties = "property list uchar uchar red\nproperty uchar green\nproperty uchar blue\n";
    let folder = Folder::new(&[("a.ply", &ply("", (properties, ["1 9 8 7"; 4]), QUAD))]);
    let (appearance, _, notes) = folder.sound(&["a.ply"]);
    assert!(appearance.is_empty() && notes.contains("1 colour properties are lists"), "{notes}");
}

#[test]
fn face_colours_belong_to_all_corners_of_their_face() {
    let folder = Folder::new(&[("a.ply", &ply("", ("", [""; 4]), (BYTES, &["3 0 1 2 255 0 0", "3 0 2 3 0 0 255"])))]);
    let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
    let (red, blue) = ([1., 0., 0., 1.], [0., 0., 1., 1.]);
    assert_eq!(colours(&appearance, &attributes), [red, red, red, blue, blue, blue]);
    assert!(attributes.records.len() == 8 && notes.contains("face colours"), "{notes}");
}

#[test]
fn textures_of_ply_are_at_vertices_or_at_the_corners_of_faces() {
    let comment = "comment TextureFile my wood.png\n";
    let at_vertices = ("property float s\nproperty float t\n", ["0 0", "1 0", "1 1", "0 1"]);
    let at_corners =
        ("property list uchar float texcoord\nproperty int texnumber\n", &["4 0 1 2 3 8 0 0 1 0 1 1 0 1 0"][..]);
    let files = [ply(comment, at_vertices, QUAD), ply(comment, ("", [""; 4]), at_corners)];
    for file in &files {
        let folder = Folder::new(&[("a.ply", file), ("my wood.png", &png(4, 2))]);
        let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
        assert_eq!(uvs(&appearance, &attributes), [[0., 1.], [1., 1.], [1., 0.], [0., 1.], [1., 0.], [0., 0.]]);
        assert_eq!(attributes.materials, [1, 1]);
        let material = &appearance.materials[1];
        assert!(material.base_texture.is_some() && material.alpha == AlphaMode::Opaque && !appearance.has_alpha);
        assert!(appearance.images[0].name().ends_with("my wood.png") && notes.contains("PLY textures"), "{notes}");
    }
    // Without the image, the faces have no texture, and the note names it.
    let folder = Folder::new(&[("a.ply", &files[0])]);
    let (appearance, _, notes) = folder.sound(&["a.ply"]);
    assert!(appearance.is_empty() && notes.contains("my wood.png cannot be used"), "{notes}");
    // Without coordinates the texture means nothing.
    let folder = Folder::new(&[("a.ply", &ply(comment, ("", [""; 4]), QUAD)), ("my wood.png", &png(4, 2))]);
    assert!(folder.sound(&["a.ply"]).0.is_empty());
}

#[test]
fn faces_whose_texture_coordinates_do_not_fit_have_none() {
    let properties = "property list uchar float texcoord\nproperty int texnumber\n";
    let faces = ["3 0 1 2 4 0 0 1 0 0", "3 0 2 3 6 0 0 nan 0 1 1 0", "3 0 1 3 6 0 0 1e9 0 1 1 5", "3 1 2 3 0 -1"];
    let file = ply("comment TextureFile a.png\n", ("", [""; 4]), (properties, &faces));
    let folder = Folder::new(&[("a.ply", &file), ("a.png", &png(1, 1))]);
    let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
    assert!(notes.contains("2 faces have texture coordinates or texture numbers that do not fit"), "{notes}");
    assert_eq!(attributes.materials, [1, 1, 0, 0]);
    let uvs = uvs(&appearance, &attributes);
    assert!(uvs[0][0].is_nan() && uvs[4][0].is_nan() && !uvs[3][0].is_nan() && uvs[7][0] == 1e9 && uvs[9][0].is_nan());
}

pub(super) const OBJ_SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

#[test]
fn obj_faces_take_the_texture_coordinates_of_their_corners() {
    let obj = format!(
        "mtllib my materials.mtl\n{OBJ_SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1 0\nusemtl blue one\nf 1/1 2/2 3/3\n\
         usemtl wood\nf -4/-4 -2/-2 -1/-1\nusemtl nowhere\nf 1/1 2/9 3\n"
    );
    let mtl = b"# a comment\nnewmtl blue one\nKd 0 0 1\nd 0.5\n\nnewmtl wood\nKd 0.1 0.1 0.1\nmap_Kd -clamp on -s 2 4 -o 0.5 textures\\wood grain.png\n";
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("my materials.mtl", mtl)]);
    fs::create_dir(folder.path("textures")).unwrap();
    fs::write(folder.path("textures/wood grain.png"), png(2, 2)).unwrap();
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    assert_eq!(attributes.materials, [1, 2, 0]);
    let uvs = uvs(&appearance, &attributes);
    // The first material has no texture, so its coordinates do not count.
    assert!(uvs[0][0].is_nan() && uvs[6..].iter().flatten().filter(|value| value.is_nan()).count() == 4, "{uvs:?}");
    assert_eq!(uvs[3..6], [[0., 1.], [1., 0.], [0., 0.]]);
    let [_, blue, wood] = &appearance.materials[..] else { panic!("{:?}", appearance.materials) };
    assert_eq!((blue.base_colour, blue.alpha), ([0., 0., 1., 0.5], AlphaMode::Blend));
    let texture = wood.base_texture.as_ref().unwrap();
    assert_eq!((wood.base_colour, texture.wrap), ([1.0; 4], [Wrap::Clamp; 2]));
    assert_eq!(texture.transform, Some([2.0, 0.0, 0.5, 0.0, 4.0, -3.0]));
    assert!(notes.contains("1 usemtl statements") && notes.contains("1 corners name texture coordinates"), "{notes}");
    assert!(notes.contains("channels: colour (materials, textures)"), "{notes}");
}

#[test]
fn obj_polygons_before_their_vertices_keep_their_corners() {
    let head = "mtllib a.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
    let face = "usemtl wood\nf 1/1 2/2 3/3 4/4\nusemtl plain\n";
    let files = [format!("{head}{OBJ_SQUARE}{face}"), format!("{head}{face}{OBJ_SQUARE}")];
    let read = files.map(|obj| {
        let mtl = b"newmtl plain\nnewmtl wood\nmap_Kd a.png\n";
        let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl), ("a.png", &png(2, 2))]);
        let (appearance, attributes, _) = folder.sound(&["a.obj"]);
        assert_eq!(attributes.materials, [2, 2]);
        uvs(&appearance, &attributes)
    });
    assert_eq!(read[0], read[1]);
    assert_eq!(read[0], [[0., 1.], [1., 1.], [1., 0.], [0., 1.], [1., 0.], [0., 0.]]);
}

#[test]
fn obj_colours_may_begin_late_and_files_without_materials_are_plain() {
    let obj = "v 0 0 0\nv 1 0 0 0.5\nv 1 1 0 1 0 0\nv 0 1 0 0 0.5 2\nf 1 2 3 4\nmtllib gone.mtl\n";
    let folder = Folder::new(&[("a.obj", obj.as_bytes())]);
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    let white = [1.0; 4];
    let last = [0.0, linear_from_srgb(0.5), 1.0, 1.0];
    let red = [1., 0., 0., 1.];
    assert_eq!(colours(&appearance, &attributes), [white, white, red, white, red, last]);
    assert!(notes.contains("1 vertices have colours outside") && notes.contains("gone.mtl cannot be read"), "{notes}");
    let obj = format!("{OBJ_SQUARE}vt 0 0\nusemtl x\nf 1/1 2/1 3/1\n");
    let folder = Folder::new(&[("a.obj", obj.as_bytes())]);
    let (appearance, _, notes) = folder.sound(&["a.obj"]);
    assert!(appearance.is_empty() && notes.contains("texture coordinates of the input are left out"), "{notes}");
}

/// A glTF document of one triangle per primitive, its buffer, and what is behind the positions.
pub(super) fn gltf(
    primitives: serde_json::Value,
    more: serde_json::Value,
    rest: &[u8],
) -> (serde_json::Value, Vec<u8>) {
    let positions: [[f32; 3]; 3] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
    let mut binary: Vec<u8> = positions.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
    binary.extend_from_slice(rest);
    let mut document = json!({
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": primitives}],
        "buffers": [{"byteLength": binary.len()}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": rest.len()}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}]
    });
    for (key, value) in more.as_object().unwrap() {
        match document.get_mut(key).and_then(|there| there.as_array_mut()) {
            Some(there) => there.extend(value.as_array().unwrap().iter().cloned()),
            None => document[key] = value.clone(),
        }
    }
    (document, binary)
}

pub(super) fn glb(document: &(serde_json::Value, Vec<u8>)) -> Vec<u8> {
    gltf::tests::glb(&document.0, &document.1)
}

#[test]
fn gltf_colours_are_linear_and_shared_by_all_primitives() {
    let values: Vec<u8> = [255u8, 0, 0, 51, 0, 128, 0, 255, 0, 0, 255, 255].to_vec();
    let floats: Vec<u8> =
        [0.5f32, 2.0, -1.0, 0.0, 1.0, 0.0, 0.25, 0.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let document = gltf(
        json!([{"attributes": {"POSITION": 0, "COLOR_0": 1}}, {"attributes": {"POSITION": 0}, "material": 0},
               {"attributes": {"POSITION": 0, "COLOR_0": 2}}]),
        json!({
            "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 1.0]}, "doubleSided": true,
                           "extensions": {"KHR_materials_unlit": {}}}],
            "extensionsUsed": ["KHR_materials_unlit"],
            "accessors": [
                {"bufferView": 1, "componentType": 5121, "normalized": true, "count": 3, "type": "VEC4"},
                {"bufferView": 1, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC3"}
            ]
        }),
        &[values, floats].concat(),
    );
    let folder = Folder::new(&[("a.glb", &glb(&document))]);
    let (appearance, attributes, notes) = folder.sound(&["a.glb"]);
    let expected = [
        [1., 0., 0., 0.2],
        [0., 128.0 / 255.0, 0., 1.],
        [0., 0., 1., 1.],
        [1.; 4],
        [1.; 4],
        [1.; 4],
        [0.5, 1., 0., 1.],
        [0., 1., 0., 1.],
        [0.25, 0., 0., 1.],
    ];
    assert_eq!(colours(&appearance, &attributes), expected);
    assert_eq!(attributes.materials, [0, 1, 0]);
    let material = &appearance.materials[1];
    assert_eq!((material.base_colour, material.unlit, material.double_sided), ([0.5, 0.25, 1., 1.], true, true));
    assert!(appearance.has_alpha && notes.contains("1 vertices have colours outside of 0 to 1"), "{notes}");
}

/// A glTF document with a texture, whose image is described by `image`.
fn textured(image: serde_json::Value, rest: &[u8]) -> (serde_json::Value, Vec<u8>) {
    let uv: Vec<u8> = [0u16, 65535, 65535, 0, 0, 0].iter().flat_map(|value| value.to_le_bytes()).collect();
    let transform = json!({"offset": [0.5, 0.0], "scale": [2.0, 1.0], "texCoord": 1});
    gltf(
        json!([{"attributes": {"POSITION": 0, "TEXCOORD_1": 1}, "material": 0}, {"attributes": {"POSITION": 0}, "material": 0}]),
        json!({
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {
                "index": 0, "extensions": {"KHR_texture_transform": transform}}}, "alphaMode": "MASK"}],
            "textures": [{"source": 0, "sampler": 0}],
            "samplers": [{"wrapS": 33071, "wrapT": 33648}],
            "images": [image],
            "extensionsUsed": ["KHR_texture_transform"],
            "extensionsRequired": ["KHR_texture_transform"],
            "bufferViews": [{"buffer": 0, "byteOffset": 48, "byteLength": rest.len().max(1)}],
            "accessors": [{"bufferView": 1, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2"}]
        }),
        &[&uv[..], rest, &[0]].concat(),
    )
}

#[test]
fn gltf_images_are_found_inside_beside_and_in_the_text() {
    let image = png(3, 5);
    let uri = format!("data:image/png;base64,{}", gltf::tests::base64(&image));
    for (description, rest) in [
        (json!({"bufferView": 2, "mimeType": "image/png"}), &image[..]),
        (json!({"uri": "my%20image.png"}), &[]),
        (json!({"uri": uri}), &[]),
    ] {
        let folder = Folder::new(&[("a.glb", &glb(&textured(description, rest))), ("my image.png", &image)]);
        let (appearance, attributes, notes) = folder.sound(&["a.glb"]);
        // The text may end with some zeros.
        let mut start = vec![0; image.len()];
        let opened = appearance.images[0].open(None).and_then(|mut encoded| encoded.read_exact(&mut start));
        assert!(opened.is_ok() && start == image, "{notes}");
        let material = &appearance.materials[1];
        let texture = material.base_texture.as_ref().unwrap();
        assert_eq!((texture.uv_set, texture.wrap), (0, [Wrap::Clamp, Wrap::Mirror]));
        assert_eq!(texture.transform, Some([2.0, 0.0, 0.5, 0.0, 1.0, 0.0]));
        assert_eq!(material.alpha, AlphaMode::Mask(0.5));
        let uvs = uvs(&appearance, &attributes);
        assert_eq!(uvs[..3], [[0., 1.], [1., 0.], [0., 0.]]);
        // The second primitive has no coordinates: the factor is used.
        assert!(uvs[3..].iter().flatten().all(|value| value.is_nan()));
        assert!(notes.contains("channels: colour (textures)"), "{notes}");
    }
    // The same as text, with its buffer in it.
    let (mut document, binary) = textured(json!({"bufferView": 2, "mimeType": "image/png"}), &image);
    document["buffers"][0]["uri"] =
        format!("data:application/octet-stream;base64,{}", gltf::tests::base64(&binary)).into();
    let folder = Folder::new(&[("a.gltf", document.to_string().as_bytes())]);
    let (appearance, ..) = folder.sound(&["a.gltf"]);
    assert!(matches!(&appearance.images[0], ImageSource::Inline { bytes, .. } if bytes.starts_with(&image)));
}

#[test]
fn images_that_cannot_be_used_are_named_and_their_factor_stays() {
    for (description, problem) in [
        (json!({"uri": "gone.png"}), "gone.png cannot be used"),
        (json!({"uri": "../secret.png"}), "secret.png is not in the folder"),
        (json!({"uri": "https://example.org/a.png"}), "https://example.org/a.png is not a file beside"),
        (json!({"uri": "data:image/png;base64,!"}), "image 0 has a data URI that is not base64"),
        (json!({"uri": "noise.png"}), "noise.png cannot be used"),
        (json!({"bufferView": 2, "mimeType": "image/png"}), "cannot be used"),
    ] {
        let folder = Folder::new(&[("a.glb", &glb(&textured(description, b"not an image"))), ("noise.png", b"noise")]);
        let (appearance, _, notes) = folder.sound(&["a.glb"]);
        assert!(appearance.materials.iter().all(|material| material.base_texture.is_none()));
        assert!(notes.contains(problem), "{problem}: {notes}");
    }
}

#[test]
fn an_image_that_says_it_is_huge_is_refused_by_name() {
    // The size of a PNG is in its first chunk, whose checksum must fit.
    let mut huge = png(1, 1);
    huge[16..20].copy_from_slice(&60_000u32.to_be_bytes());
    huge[20..24].copy_from_slice(&60_000u32.to_be_bytes());
    let checksum = crc32fast::hash(&huge[12..29]);
    huge[29..33].copy_from_slice(&checksum.to_be_bytes());
    let obj = format!("mtllib a.mtl\n{OBJ_SQUARE}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n");
    let files: [(&str, &[u8]); 3] =
        [("a.obj", obj.as_bytes()), ("a.mtl", b"newmtl a\nmap_Kd huge.png\n"), ("huge.png", &huge)];
    let folder = Folder::new(&files);
    let error = folder.import(&["a.obj"], "auto").0.unwrap_err();
    assert!(error.contains("huge.png has 60000 x 60000 texels, but one image may have at most 268435456"), "{error}");
    assert!(folder.import(&["a.obj"], "none").0.is_ok());
}

#[test]
fn jpeg_data_in_a_file_called_png_is_an_image() {
    // An image of one colour would be a factor.
    let image = DynamicImage::ImageLuma8(ImageBuffer::from_fn(8, 8, |x, _| image::Luma([30 * x as u8])));
    let mut bytes = std::io::Cursor::new(vec![]);
    image.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
    let folder =
        Folder::new(&[("a.glb", &glb(&textured(json!({"uri": "a.png"}), &[]))), ("a.png", &bytes.into_inner())]);
    let (appearance, _, notes) = folder.sound(&["a.glb"]);
    assert!(appearance.materials[1].base_texture.is_some() && !notes.contains("cannot"), "{notes}");
}

#[test]
fn gltf_attributes_that_cannot_be_read_are_noted_and_the_surface_stays() {
    let colour = |accessor: serde_json::Value| {
        let document =
            gltf(json!([{"attributes": {"POSITION": 0, "COLOR_0": 1}}]), json!({"accessors": [accessor]}), &[0; 12]);
        let folder = Folder::new(&[("a.glb", &glb(&document))]);
        let (appearance, attributes, notes) = folder.sound(&["a.glb"]);
        assert_eq!(colours(&appearance, &attributes), [[1.0; 4]; 3]);
        notes
    };
    let accessor = |count: u32, kind: &str| json!({"bufferView": 1, "componentType": 5121, "normalized": true, "count": count, "type": kind});
    assert!(colour(accessor(9, "VEC4")).contains("accessor 1 has 9 values for 3 vertices"));
    assert!(colour(accessor(3, "VEC2")).contains("colours must have three or four components"));
    assert!(
        colour(json!({"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC4"}))
            .contains("beyond its buffer")
    );
    // A material that is not there makes the document invalid.
    let document = gltf(json!([{"attributes": {"POSITION": 0}, "material": 3}]), json!({}), &[0; 4]);
    let folder = Folder::new(&[("a.glb", &glb(&document))]);
    let error = folder.import(&["a.glb"], "auto").0.unwrap_err();
    assert!(error.contains("mesh 0: uses material 3, but there are 0"), "{error}");
}

#[test]
fn files_of_different_attributes_are_joined() {
    let coloured = ply("", (BYTES, RED_TO_BLUE), QUAD);
    let measured = ply("", ("property float quality\n", ["1", "2", "3", "4"]), QUAD);
    let plain = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let folder = Folder::new(&[("a.ply", &coloured), ("b.ply", &measured), ("c.obj", plain)]);
    for names in [["a.ply", "b.ply", "c.obj"], ["c.obj", "b.ply", "a.ply"]] {
        let (appearance, attributes, notes) = folder.sound(&names);
        assert!(notes.contains("channels: colour (vertex colours), quality (PLY property)"), "{notes}");
        assert_eq!((appearance.layout.stride, attributes.corners.len()), (5, 5));
        let stride = appearance.layout.stride;
        let quality = appearance.layout.scalars[0].1;
        let missing =
            (0..5).filter(|&t| attributes.records_of(t, stride).iter().all(|record| record[quality].is_nan()));
        assert_eq!(missing.count(), 3);
    }
}

#[test]
fn vertex_colours_of_off_are_behind_normals() {
    for (head, values) in [
        ("COFF", ["255 0 0", "0 128 0 255", "0 0 255", "9 9 9 255"]),
        ("CNOFF", ["0 0 1 255 0 0", "0 0 1 0 128 0", "0 0 1 0 0 255", "0 0 1 9 9 9"]),
        (
            "STCOFF",
            ["1. 0. 0. 1. 0 0", "0 0.50196078 0. 1 0 0", "0. 0 1 1 0 0", "0.035294118 0.035294118 0.035294118 1. 0 0"],
        ),
    ] {
        let vertices: String = SQUARE.lines().zip(values).map(|(p, values)| format!("{p} {values}\n")).collect();
        let folder = Folder::new(&[("a.off", format!("{head}\n4 1 0\n{vertices}4 0 1 2 3\n").as_bytes())]);
        let (appearance, attributes, _) = folder.sound(&["a.off"]);
        let found = colours(&appearance, &attributes);
        let grey = LINEAR_OF_BYTE[9];
        let expected = [[1., 0., 0., 1.], [0., LINEAR_OF_BYTE[128], 0., 1.], [0., 0., 1., 1.], [grey, grey, grey, 1.]];
        for (corner, vertex) in [0, 1, 2, 0, 2, 3].into_iter().enumerate() {
            assert!((0..4).all(|i| (found[corner][i] - expected[vertex][i]).abs() < 1e-6), "{head}: {found:?}");
        }
    }
}
