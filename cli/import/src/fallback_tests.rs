//! What surfaces show where files describe colours in an unusual way, or name files that cannot be used.

use std::fs;

use super::attribute_tests::{BYTES, Folder, OBJ_SQUARE, QUAD, RED_TO_BLUE, colours, ply, png};
use lodpack_mesh::appearance::{AlphaMode, Appearance, Material};
use lodpack_mesh::srgb::{LINEAR_OF_BYTE, linear_from_srgb};

/// Two triangles of a material `m`, whose corners have texture coordinates.
fn textured_square(head: &str) -> String {
    format!("{head}{OBJ_SQUARE}vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
}

/// Reads the square with a library and an image of several colours `g.png`; returns what the material of each triangle
/// is, and the notes.
fn materials_of(obj: &str, library: &[u8]) -> (Vec<Material>, String) {
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", library), ("g.png", &png(4, 4))]);
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    let material = |&number: &u16| appearance.materials.get(usize::from(number)).cloned().unwrap_or_default();
    (attributes.materials.iter().map(material).collect(), notes)
}

fn square_of(library: &[u8]) -> (Vec<Material>, String) {
    materials_of(&textured_square("mtllib a.mtl\n"), library)
}

/// The factor that `Kd 0.6 0 0` is.
fn dark_red() -> [f32; 4] {
    [linear_from_srgb(0.6), 0.0, 0.0, 1.0]
}

/// A PNG without its second half.
fn cut_short() -> Vec<u8> {
    let whole = png(16, 16);
    whole[..whole.len() / 2].to_vec()
}

#[test]
fn a_material_whose_image_cannot_be_used_shows_its_factor() {
    let obj = textured_square("mtllib a.mtl\n");
    let problems = ["there is no such file: put it there", "its format is unknown", "it is damaged"];
    for (image, problem) in ["none.png", "a.mtl", "cut.png"].into_iter().zip(problems) {
        let library = format!("newmtl m\nmap_Kd {image}\nKd 0.6 0 0\nmap_Ke {image}\n");
        let folder =
            Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", library.as_bytes()), ("cut.png", &cut_short())]);
        let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
        let material = &appearance.materials[usize::from(attributes.materials[0])];
        assert_eq!((material.base_colour, material.images().count()), (dark_red(), 0));
        assert_eq!(material.emissive, [0.0; 3]);
        // It is named once.
        let expected = format!("{image} cannot be used: ");
        assert!(notes.matches(&expected).count() == 1 && notes.contains(problem), "{notes}");
    }
}

#[test]
fn faces_without_texture_coordinates_show_the_factor_of_their_material() {
    let obj = format!("{}f 1 3 4\nf 1//1 3//1 4//1\nf 1/-9 2/-9 4/-9\nf 1/1 2/2 4\nf 1/1 2/2 4/4\n", {
        textured_square("mtllib a.mtl\n")
    });
    let (materials, notes) = materials_of(&obj, b"newmtl m\nKd 0.6 0 0\nmap_Kd g.png\n");
    let has_image: Vec<bool> = materials.iter().map(|material| material.base_texture.is_some()).collect();
    assert_eq!(has_image, [true, true, false, false, false, false, true]);
    for material in &materials {
        assert_eq!(material.base_colour, if material.base_texture.is_some() { [1.0; 4] } else { dark_red() });
    }
    assert!(notes.contains("a.obj: 4 faces of materials with textures have no texture coordinates"), "{notes}");
    let (_, notes) = square_of(b"newmtl m\nmap_Kd g.png\n");
    assert!(!notes.contains("texture coordinates"), "{notes}");
}

#[test]
fn materials_are_found_in_libraries_that_follow_their_use() {
    let library = b"newmtl m\nmap_Kd g.png\n";
    let first = textured_square("").replace("usemtl m\n", "");
    let late = textured_square("").replace("f 1/1 3/3 4/4\n", "mtllib a.mtl\nf 1/1 3/3 4/4\n");
    for obj in [format!("usemtl m\n{first}mtllib \\\n a.mtl # here\n"), late] {
        let (materials, notes) = materials_of(&obj, library);
        assert!(materials.len() == 2 && materials.iter().all(|material| material.base_texture.is_some()), "{notes}");
        assert!(!notes.contains("usemtl"), "{notes}");
    }
}

#[test]
fn a_library_is_read_once_however_often_it_is_named() {
    let head = "mtllib a.mtl\nmtllib none.mtl\nmtllib ./a.mtl a.mtl\nmtllib none.mtl\n";
    let obj = textured_square(head);
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", b"newmtl m\nKd 1 0 0\n")]);
    let (appearance, _, notes) = folder.sound(&["a.obj"]);
    assert_eq!((appearance.materials.len(), notes.matches("cannot be read").count()), (2, 1), "{notes}");
}

#[test]
fn names_of_materials_and_images_may_be_in_any_encoding() {
    let obj = [textured_square("mtllib a.mtl\n").replace("usemtl m\n", "").as_bytes(), b"usemtl \xe9\nf 1/1 2/2 4/4\n"]
        .concat();
    let library = b"\xEF\xBB\xBFnewmtl \xe9\nKd 0.6 0 0\nmap_Kd \xe9.png\n";
    let folder = Folder::new(&[("a.obj", &obj), ("a.mtl", library), ("\u{e9}.png", &png(4, 4))]);
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    let material = &appearance.materials[usize::from(attributes.materials[2])];
    assert!(material.base_texture.is_some(), "{notes}");
}

#[test]
fn libraries_without_materials_and_unknown_materials_are_noted() {
    let (_, notes) = square_of(b"\x00\xff\x00\xff");
    assert!(notes.contains("a.mtl has no materials") && notes.contains("1 usemtl statements"), "{notes}");
    let (_, notes) = materials_of(&textured_square("usemtl x\n"), b"");
    assert!(notes.contains("2 usemtl statements"), "{notes}");
    // No name means no material.
    let (_, notes) = materials_of(&format!("{OBJ_SQUARE}usemtl\nf 1 2 3\n"), b"");
    assert!(!notes.contains("usemtl"), "{notes}");
}

#[test]
fn images_of_a_library_are_beside_it_or_beside_the_file() {
    let obj = textured_square("mtllib sub/b.mtl\n");
    for image in ["there.png", "g.png", "C:\\x\\there.png", "..\\g.png", "\"there.png\" # the colour"] {
        let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("g.png", &png(4, 4))]);
        fs::create_dir(folder.path("sub")).unwrap();
        fs::write(folder.path("sub/b.mtl"), format!("newmtl m\nmap_Kd -clamp on {image}\n")).unwrap();
        fs::write(folder.path("sub/there.png"), png(4, 4)).unwrap();
        let (appearance, _, notes) = folder.sound(&["a.obj"]);
        assert!(appearance.materials[1].base_texture.is_some(), "{image}: {notes}");
        let beside = super::files_beside(&folder.path("a.obj"), &super::Channels::Auto);
        assert!(beside.len() == 2 && beside.iter().all(|path| path.is_file()), "{beside:?}");
    }
}

#[test]
fn opacity_counts_before_what_is_missing_of_it() {
    for (statements, expected) in [
        ("d 1\nTr 1\n", (1.0, AlphaMode::Opaque)),
        ("Tr 1\nd 1\n", (1.0, AlphaMode::Opaque)),
        ("Tr 0.2\n", (0.8, AlphaMode::Blend)),
        ("Tr 0.2\nd -halo 0.6\nTr 0\n", (0.6, AlphaMode::Blend)),
    ] {
        let (materials, _) = square_of(format!("newmtl m\nKd 0.6 0 0\n{statements}").as_bytes());
        assert_eq!((materials[0].base_colour[3], materials[0].alpha), expected, "{statements}");
    }
}

/// Colours of vertices, with texture coordinates.
fn coloured(comments: &str) -> Vec<u8> {
    let values = RED_TO_BLUE.map(|colour| format!("{colour} 0.5 0.5"));
    let properties = format!("{BYTES}property float s\nproperty float t\n");
    ply(comments, (&properties, [&values[0], &values[1], &values[2], &values[3]]), QUAD)
}

fn first_colour(appearance: &Appearance, attributes: &lodpack_mesh::attributes::RegionAttributes) -> [f32; 4] {
    colours(appearance, attributes)[0]
}

#[test]
fn vertex_colours_of_ply_are_kept_where_its_textures_cannot_be_used() {
    let red = [1.0, 0.0, 0.0, 1.0];
    for (comments, problem) in [
        ("comment TextureFile none.png\n", "none.png cannot be used"),
        ("comment TextureFile cut.png\n", "cut.png cannot be used"),
        ("comment TextureFile\n", "names no image"),
        ("comment TextureFile g.png\ncomment TextureFile none.png\n", "none.png cannot be used"),
    ] {
        let folder = Folder::new(&[("a.ply", &coloured(comments)), ("cut.png", &cut_short()), ("g.png", &png(4, 4))]);
        let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
        assert!(notes.contains(problem) && appearance.has_colour, "{notes}");
        assert_eq!(first_colour(&appearance, &attributes), red, "{comments}");
    }
    // A texture hides them all.
    let folder = Folder::new(&[("a.ply", &coloured("comment TextureFile g.png\n")), ("g.png", &png(4, 4))]);
    let (appearance, ..) = folder.sound(&["a.ply"]);
    assert!(appearance.layout.colour.is_none() && appearance.materials[1].base_texture.is_some());
}

#[test]
fn textures_of_ply_are_named_in_any_letters() {
    for word in ["TextureFile", "textureFile", "texturefile", "TEXTUREFILE"] {
        let folder = Folder::new(&[("a.ply", &coloured(&format!("comment {word} g.png\n"))), ("g.png", &png(4, 4))]);
        let (appearance, _, notes) = folder.sound(&["a.ply"]);
        assert!(appearance.materials.len() == 2, "{word}: {notes}");
    }
}

#[test]
fn colours_of_16_bits_that_are_numbers_of_8_bits_are_read_as_such() {
    let words = BYTES.replace("uchar", "ushort");
    let grey = LINEAR_OF_BYTE[128];
    for (last, green) in [("9 9 255", grey), ("9 9 256", linear_from_srgb(128.0 / 65535.0))] {
        let values = ["255 0 0", "0 128 0", "0 0 255", last];
        let folder = Folder::new(&[("a.ply", &ply("", (&words, values), QUAD))]);
        let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
        assert!((colours(&appearance, &attributes)[1][1] - green).abs() < 1e-6);
        assert_eq!(notes.contains("colours have 16 bits, but no number is above 255"), last == "9 9 255", "{notes}");
    }
    // Those of faces, too.
    let faces = ["3 0 1 2 255 0 0", "3 0 2 3 0 128 0"];
    let folder = Folder::new(&[("a.ply", &ply("", ("", [""; 4]), (&words, &faces)))]);
    let (appearance, attributes, notes) = folder.sound(&["a.ply"]);
    assert_eq!(first_colour(&appearance, &attributes), [1.0, 0.0, 0.0, 1.0], "{notes}");
}

#[test]
fn numbers_that_ply_has_and_no_channel_keeps_are_noted() {
    let of_faces = format!("{BYTES}property float quality\nproperty int label\nproperty int flags\n");
    let faces = ["3 0 1 2 255 0 0 0.5 7 0", "3 0 2 3 0 0 255 0.5 7 0"];
    let folder = Folder::new(&[("a.ply", &ply("", (BYTES, RED_TO_BLUE), (&of_faces, &faces)))]);
    let (_, _, notes) = folder.sound(&["a.ply"]);
    assert!(notes.contains("a.ply: colours of faces are left out"), "{notes}");
    assert!(notes.contains("a.ply: numbers of faces are left out: quality, label; "), "{notes}");
    let (_, notes) = folder.import(&["a.ply"], "none");
    assert!(!notes.contains("of faces"), "{notes}");
    for name in ["colour", "color", "alpha", "a"] {
        let property = format!("property float {name}\n");
        let folder = Folder::new(&[("a.ply", &ply("", (&property, ["0.5"; 4]), QUAD))]);
        let (appearance, _, notes) = folder.sound(&["a.ply"]);
        assert!(appearance.is_empty() && notes.contains(&format!("stand for colours: {name}; rename")), "{notes}");
    }
    let folder = Folder::new(&[("a.ply", &ply("", (&format!("{BYTES}property uchar alpha\n"), ["9 9 9 9"; 4]), QUAD))]);
    let (_, _, notes) = folder.sound(&["a.ply"]);
    assert!(!notes.contains("rename"), "{notes}");
}

#[test]
#[cfg(unix)]
fn pipes_are_refused_before_they_are_opened() {
    let make_pipe = |path: &std::path::Path| {
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    };
    let obj = textured_square("mtllib pipe.mtl\nmtllib a.mtl\n");
    let file = ply("comment TextureFile pipe.png\n", ("property float s\nproperty float t\n", ["0 0"; 4]), QUAD);
    let library = b"newmtl m\nKd 0.6 0 0\nmap_Kd pipe.png\n";
    let folder = Folder::new(&[("a.obj", obj.as_bytes()), ("a.mtl", library), ("a.ply", &file)]);
    make_pipe(&folder.path("pipe.mtl"));
    make_pipe(&folder.path("pipe.png"));
    let (_, _, notes) = folder.sound(&["a.obj"]);
    let refused = "it is a device or pipe, not a file";
    assert!(notes.contains(&format!("pipe.mtl cannot be read: {refused}")), "{notes}");
    assert!(notes.contains(&format!("pipe.png cannot be used: {refused}")), "{notes}");
    let (_, _, notes) = folder.sound(&["a.ply"]);
    assert!(notes.contains(&format!("pipe.png cannot be used: {refused}")), "{notes}");
}
