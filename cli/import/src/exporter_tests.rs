//! Files as their exporters write them: opacity that is not meant, names, images in tiles, orders of columns, types and
//! ranges of numbers.

use super::attribute_tests::{BYTES, Folder, OBJ_SQUARE, QUAD, RED_TO_BLUE, colours, ply, png, uvs};
use super::tests::{error_of, import_noting};
use lodpack_mesh::appearance::{AlphaMode, Appearance, Material, Wrap};
use lodpack_mesh::srgb::{LINEAR_OF_BYTE, linear_from_srgb};

const CORNERS: &str = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";

/// A square of two materials, whose corners have texture coordinates.
fn two_materials() -> String {
    format!("mtllib a.mtl\n{OBJ_SQUARE}{CORNERS}usemtl m\nf 1/1 2/2 3/3\nusemtl n\nf 1/1 3/3 4/4\n")
}

/// An image all of whose texels are of this colour but the first.
fn image(first: [u8; 4], others: [u8; 4]) -> Vec<u8> {
    let image = image::RgbaImage::from_fn(4, 4, |x, y| image::Rgba(if x + y == 0 { first } else { others }));
    let mut bytes = std::io::Cursor::new(vec![]);
    image.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// The materials of the triangles of an OBJ file with a library, and the notes.
fn materials_of(obj: &str, library: &str, images: &[(&str, &[u8])]) -> (Vec<Material>, String) {
    let g = png(4, 4);
    let files = [("a.obj", obj.as_bytes()), ("a.mtl", library.as_bytes()), ("g.png", &g)];
    let folder = Folder::new(&[&files[..], images].concat());
    let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
    let number = |triangle: usize| usize::from(attributes.materials.get(triangle).copied().unwrap_or(0));
    let material = |triangle| appearance.materials.get(number(triangle)).cloned().unwrap_or_default();
    ((0..2).map(material).collect(), notes)
}

/// Opacity and alpha mode of the two materials of a library.
fn opacities(library: &str) -> ([(f32, AlphaMode); 2], String) {
    let (materials, notes) = materials_of(&two_materials(), library, &[]);
    ([0, 1].map(|k: usize| (materials[k].base_colour[3], materials[k].alpha)), notes)
}

const OPAQUE: (f32, AlphaMode) = (1.0, AlphaMode::Opaque);

#[test]
fn tr_1_is_opaque_where_nothing_would_be_seen_otherwise() {
    // As OpenMVS and PhotoScan write it.
    let written = "Ka 1 1 1\nKd 1 1 1\nKs 0 0 0\nTr 1.000000\nillum 1\nNs 0\n";
    let library = format!("newmtl m\n{written}map_Kd g.png\nnewmtl n\n{written}");
    let (found, notes) = opacities(&library);
    assert_eq!(found, [OPAQUE; 2]);
    assert!(notes.contains("Tr counts as opacity"), "{notes}");
    let (materials, _) = materials_of(&two_materials(), &library, &[]);
    assert!(materials[0].base_texture.is_some());
    // Where 1 is opaque, the others are opacities, too.
    let (found, _) = opacities("newmtl m\nTr 1\nnewmtl n\nTr 0.2\n");
    assert_eq!(found, [OPAQUE, (0.2, AlphaMode::Blend)]);
    // A library that says which materials are opaque is taken at its word.
    let (found, notes) = opacities("newmtl m\nTr 0\nnewmtl n\nTr 1\n");
    assert_eq!(found, [OPAQUE, (0.0, AlphaMode::Blend)]);
    assert!(!notes.contains("opacity"), "{notes}");
    let (found, _) = opacities("newmtl m\nTr 0.2\nnewmtl n\nd 1\nTr 1\n");
    assert_eq!(found, [(0.8, AlphaMode::Blend), OPAQUE]);
}

#[test]
fn tr_is_opacity_in_libraries_of_programs_that_are_known_for_it() {
    for comments in [
        "# wavefront mtl file written by the visualization toolkit\n\n",
        "#\n# Wavefront material file\n# Converted by Meshlab Group\n#\n\n",
        "# Wavefront MTL file written by the Visualization Toolkit\r\n",
    ] {
        let (found, notes) = opacities(&format!("{comments}newmtl m\nTr 1\nnewmtl n\nKd 1 0 0\nTr 0.4\n"));
        assert_eq!(found, [OPAQUE, (0.4, AlphaMode::Blend)], "{comments}");
        assert!(!notes.contains("opacity"), "{notes}");
    }
    // Behind the first statement it is only a remark.
    let (found, _) = opacities("newmtl m\nTr 0.4\n# Meshlab\nnewmtl n\n");
    assert_eq!(found, [(0.6, AlphaMode::Blend), OPAQUE]);
}

#[test]
fn an_image_on_something_invisible_is_shown() {
    let (found, notes) = opacities("newmtl m\nKd 1 1 1\nd 0.0\nmap_Kd g.png\nnewmtl n\nd 1\n");
    assert_eq!(found, [OPAQUE; 2]);
    assert!(notes.contains("1 materials have opacity 0 beside an image"), "{notes}");
    // What an image of opacity says counts.
    let (found, _) = opacities("newmtl m\nd 0\nmap_d g.png\nnewmtl n\nd 1\n");
    assert_eq!(found[0], (1.0, AlphaMode::Blend));
    // Beside what is seen, something without images may be meant to be invisible.
    let (found, notes) = opacities("newmtl m\nd 0\nnewmtl n\nd 1\n");
    assert_eq!(found, [(0.0, AlphaMode::Blend), OPAQUE]);
    assert!(!notes.contains("opacity"), "{notes}");
}

#[test]
fn materials_are_opaque_where_all_would_be_invisible() {
    for library in [
        "newmtl m\nKd 1 0 0\nd 0\nnewmtl n\nKd 0 0 1\nd 0\n",
        "newmtl m\nKd 1 0 0\nmap_Kd clear.png\nmap_d clear.png\nnewmtl n\nKd 0 0 1\nd 0\n",
        "newmtl m\nKd 1 0 0\nmap_Kd g.png\nmap_d black.png\nnewmtl n\nKd 0 0 1\nmap_d clear.png\n",
    ] {
        let (clear, black) = (image([9, 8, 7, 0], [1, 2, 3, 0]), image([0, 0, 0, 255], [0, 0, 0, 255]));
        let (materials, notes) =
            materials_of(&two_materials(), library, &[("clear.png", &clear), ("black.png", &black)]);
        for material in &materials {
            assert_eq!((material.base_colour[3], material.alpha), OPAQUE, "{library}");
            assert!(material.opacity_texture.is_none());
        }
        assert_eq!(materials[1].base_colour, [0.0, 0.0, 1.0, 1.0]);
        assert!(notes.contains("a.obj: all its materials have opacity 0"), "{notes}");
    }
    // One texel that is seen is enough.
    for seen in [image([9, 8, 7, 1], [1, 2, 3, 0]), image([0, 0, 0, 255], [9, 0, 0, 255])] {
        let library = "newmtl m\nmap_Kd g.png\nmap_d seen.png\nnewmtl n\nd 0\n";
        let (materials, notes) = materials_of(&two_materials(), library, &[("seen.png", &seen)]);
        assert!(materials[0].opacity_texture.is_some() && materials[1].base_colour[3] == 0.0);
        assert!(!notes.contains("opacity 0"), "{notes}");
    }
}

#[test]
fn colours_of_which_all_have_alpha_0_are_opaque() {
    let of_ply = |alphas: [u8; 4]| {
        let values: Vec<String> = (0..4).map(|k| format!("{} {}", RED_TO_BLUE[k], alphas[k])).collect();
        let properties = format!("{BYTES}property uchar alpha\n");
        ply("", (&properties, [&values[0], &values[1], &values[2], &values[3]]), QUAD)
    };
    let of_obj = |alphas: [u8; 4]| {
        let rows = [("0 0 0 1 0 0", 0), ("1 0 0 0 0.5 0", 1), ("1 1 0 0 0 1", 2), ("0 1 0 0.1 0.1 0.1", 3)];
        let vertices: String =
            rows.iter().map(|(row, k)| format!("v {row} {}\n", f64::from(alphas[*k]) / 255.0)).collect();
        format!("{vertices}f 1 2 3 4\n").into_bytes()
    };
    let of_off = |alphas: [u8; 4]| {
        let rows = [("0 0 0 255 0 0", 0), ("1 0 0 0 128 0", 1), ("1 1 0 0 0 255", 2), ("0 1 0 9 9 9", 3)];
        let vertices: String = rows.iter().map(|(row, k)| format!("{row} {}\n", alphas[*k])).collect();
        format!("COFF\n4 1 0\n{vertices}4 0 1 2 3\n").into_bytes()
    };
    // Rvcg and PCL write 0, and MeshLab keeps it.
    for (name, file, some) in [
        ("a.ply", of_ply([0; 4]), of_ply([0, 0, 0, 1])),
        ("a.obj", of_obj([0; 4]), of_obj([0, 0, 0, 1])),
        ("a.off", of_off([0; 4]), of_off([0, 0, 0, 1])),
    ] {
        let (appearance, attributes, notes) = Folder::new(&[(name, &file)]).sound(&[name]);
        let found = colours(&appearance, &attributes);
        assert!(found.iter().all(|colour| colour[3] == 1.0) && found[0] == [1.0, 0.0, 0.0, 1.0], "{name}: {found:?}");
        assert!(!appearance.has_alpha && notes.contains(&format!("{name}: all its colours have alpha 0")), "{notes}");
        let (appearance, attributes, notes) = Folder::new(&[(name, &some)]).sound(&[name]);
        assert_eq!(colours(&appearance, &attributes)[0][3], 0.0, "{name}");
        assert!(appearance.has_alpha && !notes.contains("alpha 0"), "{notes}");
    }
    // Each file is judged by itself.
    let folder = Folder::new(&[("a.ply", &of_ply([0; 4])), ("b.ply", &of_ply([0, 0, 0, 1]))]);
    let (appearance, attributes, _) = folder.sound(&["a.ply", "b.ply"]);
    let alphas: Vec<f32> = colours(&appearance, &attributes).iter().map(|colour| colour[3]).collect();
    assert_eq!((alphas[..6].to_vec(), alphas[6]), (vec![1.0; 6], 0.0));
}

#[test]
fn names_may_contain_the_sign_of_comments() {
    let obj = |library: &str, [first, second]: [&str; 2]| {
        format!("mtllib {library}\n{OBJ_SQUARE}usemtl {first}\nf 1 2 3\nusemtl {second}\nf 1 3 4\n")
    };
    let library = "newmtl Color_#1\nKd 1 0 0\nnewmtl # 2\nKd 0 0 1\nnewmtl bare # remark\nKd 0 1 0\n";
    for (name, names, expected) in [
        ("a.mtl", ["Color_#1", "# 2"], [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]]),
        ("roof #2.mtl", ["Color_#1 # a remark", "bare"], [[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]),
        ("a#b.mtl # remark", ["bare # other", "#"], [[0.0, 1.0, 0.0, 1.0], [1.0; 4]]),
        ("none.mtl a.mtl # both", ["Color_#1", "# 2"], [[1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]]),
    ] {
        let files = ["a.mtl", "roof #2.mtl", "a#b.mtl"].map(|name| (name, library.as_bytes()));
        let obj = obj(name, names);
        let (materials, notes) = materials_of(&obj, library, &files);
        assert_eq!([materials[0].base_colour, materials[1].base_colour], expected, "{name}: {notes}");
        assert!(!notes.contains("usemtl") && notes.contains("cannot be read") == name.starts_with("none"), "{notes}");
    }
    // A library that is not there is one, unless the text says that there are several.
    let (_, notes) = materials_of(&obj("my roof.mtl # x", ["a", "a"]), "", &[]);
    assert!(notes.contains("my roof.mtl cannot be read") && notes.matches("cannot").count() == 1, "{notes}");
    let (_, notes) = materials_of(&obj("my roof.mtl b.MTL", ["a", "a"]), "", &[]);
    assert!(notes.contains("my roof.mtl cannot be read") && notes.contains("b.MTL cannot be read"), "{notes}");
}

#[test]
fn files_are_found_whose_names_differ_in_case() {
    let (materials, notes) = materials_of(
        &two_materials().replace("a.mtl", "B.Mtl"),
        "",
        &[("b.MTL", b"newmtl m\nmap_Kd Wood.PNG\nnewmtl n\nmap_Kd G.png\n"), ("wood.png", &png(3, 3))],
    );
    assert!(materials.iter().all(|material| material.base_texture.is_some()), "{notes}");
    assert!(!notes.contains("cannot"), "{notes}");
    // Those in the same letters come first.
    let folder = Folder::new(&[("A.PNG", &png(2, 2)), ("a.png", &png(3, 3)), ("a.PNG", &png(4, 4))]);
    let input = folder.path("a.obj");
    let source = super::source::Source::new(&input, b"", &lodpack_runtime::progress::Silent);
    let find = |name: &[u8]| super::beside::Beside::new(&source).path(name).unwrap();
    assert_eq!(find(b"a.png"), folder.path("a.png"));
    assert_eq!(find(b"a.Png"), folder.path("A.PNG"));
}

#[test]
fn options_of_images_that_are_not_known_are_skipped_and_noted() {
    for (options, note) in [
        ("-colorspace sRGB -s 1 1 1", "are skipped: -colorspace"),
        ("-srgb -channel r g", "are skipped: -channel, -srgb"),
        ("-clamp on -uvset 2 -colorspace raw", "are skipped: -colorspace, -uvset"),
    ] {
        let library = format!("newmtl m\nmap_Kd {options} g.png\nnewmtl n\nmap_Kd g.png\n");
        let (materials, notes) = materials_of(&two_materials(), &library, &[]);
        assert!(materials[0].base_texture.is_some() && notes.contains(note), "{options}: {notes}");
        assert!(!notes.contains("cannot be used"), "{notes}");
    }
}

#[test]
fn a_colour_beside_an_image_is_noted_unless_it_is_grey() {
    for (colour, is_noted) in [("1 0 0", true), ("0.2 0.2 0.3", true), ("0.8 0.8 0.8", false), ("0 0 0", false)] {
        let library = format!("newmtl m\nKd {colour}\nmap_Kd g.png\nnewmtl n\nKd 1 0 0\n");
        let (materials, notes) = materials_of(&two_materials(), &library, &[]);
        assert_eq!(materials[0].base_colour, [1.0; 4]);
        assert_eq!(notes.contains("1 materials have a colour (Kd) beside an image"), is_noted, "{colour}: {notes}");
    }
}

/// Four squares side by side, on tiles 1001, 1002, 1011 and 1013.
fn four_tiles() -> String {
    let mut text = String::from("mtllib a.mtl\nusemtl m\n");
    for (k, [u, v]) in [[0, 0], [1, 0], [0, 1], [2, 1]].into_iter().enumerate() {
        for [x, y] in [[0, 0], [1, 0], [1, 1], [0, 1]] {
            text += &format!("v {} {y} 0\nvt {} {}\n", 2 * k + x, u + x, v + y);
        }
        let [a, b, c, d] = [1, 2, 3, 4].map(|corner| 4 * k + corner);
        text += &format!("f {a}/{a} {b}/{b} {c}/{c} {d}/{d}\n");
    }
    text
}

#[test]
fn each_face_shows_the_tile_on_which_its_texture_coordinates_lie() {
    let names = ["t.1001.png", "T.1002.png", "t.1011.png"];
    let images = [png(2, 2), png(3, 3), png(4, 4)];
    let library = |name: &str| format!("newmtl m\nKd 1 0 0\nmap_Kd {name}\nmap_Pr g.png\n");
    for name in ["t.<UDIM>.png", "t.<udim>.png", "t.1001.png", "C:\\x\\t.<UDIM>.png", "-colorspace sRGB t.<UDIM>.png"] {
        let (obj, library, g) = (four_tiles(), library(name), png(5, 5));
        let files = [("a.obj", obj.as_bytes()), ("a.mtl", library.as_bytes()), ("g.png", &g)];
        let tiles: Vec<(&str, &[u8])> = names.iter().copied().zip(images.iter().map(Vec::as_slice)).collect();
        let folder = Folder::new(&[&files[..], &tiles].concat());
        let (appearance, attributes, notes) = folder.sound(&["a.obj"]);
        for (square, expected) in ["t.1001.png", "T.1002.png", "t.1011.png", ""].into_iter().enumerate() {
            let material = &appearance.materials[usize::from(attributes.materials[2 * square])];
            let name = |image: u32| appearance.images[image as usize].name();
            match &material.base_texture {
                Some(texture) => {
                    assert!(name(texture.image).ends_with(expected) && !expected.is_empty(), "{expected}: {notes}");
                    assert_eq!(texture.wrap, [Wrap::Clamp; 2]);
                    // The first corner is the lower left one of the tile.
                    let record = attributes.records_of(2 * square, appearance.layout.stride);
                    let corners = texture.corners(&appearance.layout, record).unwrap();
                    assert_eq!(corners, [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0]], "{expected}");
                    // What is not in tiles is the same on all of them.
                    assert!(material.roughness_texture.as_ref().is_some_and(|of| of.transform.is_none()));
                }
                None => assert_eq!((square, material.base_colour), (3, [1.0, 0.0, 0.0, 1.0])),
            }
        }
        assert_eq!(uvs(&appearance, &attributes).len(), 24);
        assert!(notes.contains("1 faces lie on tiles (UDIM) of which there is no image"), "{notes}");
        let beside = super::files_beside(&folder.path("a.obj"), &super::Channels::Auto);
        assert_eq!(beside.len(), 5, "{beside:?}");
    }
}

#[test]
fn an_image_is_no_tile_where_none_other_is_there_or_others_are_named_by_themselves() {
    for (library, others) in [
        ("newmtl m\nmap_Kd t.1001.png\nnewmtl n\nmap_Kd t.1002.png\n", &["t.1001.png", "t.1002.png"][..]),
        ("newmtl m\nmap_Kd t.1001.png\nnewmtl n\n", &["t.1001.png"]),
    ] {
        let image = png(2, 2);
        let images: Vec<(&str, &[u8])> = others.iter().map(|name| (*name, image.as_slice())).collect();
        let (materials, notes) = materials_of(&two_materials(), library, &images);
        let texture = materials[0].base_texture.as_ref().unwrap();
        assert_eq!((texture.wrap, texture.transform), ([Wrap::Repeat; 2], None), "{notes}");
    }
    // Tiles that are missing are named.
    let (materials, notes) = materials_of(&two_materials(), "newmtl m\nmap_Kd t.<UDIM>.png\nnewmtl n\n", &[]);
    assert!(materials[0].base_texture.is_none() && notes.contains("t.<UDIM>.png cannot be used"), "{notes}");
    // So are faces that reach over several.
    let wide = two_materials().replace("vt 1 1\n", "vt 1.5 1.2\n");
    let tiles = png(2, 2);
    let (_, notes) = materials_of(&wide, "newmtl m\nmap_Kd t.<UDIM>.png\nnewmtl n\n", &[("t.1001.png", &tiles)]);
    assert!(notes.contains("1 faces reach over several tiles"), "{notes}");
}

/// The colours of a square in OFF, given its keyword and what stands behind the positions.
fn off(keyword: &str, behind: [&str; 4]) -> (Vec<[f32; 4]>, String) {
    let positions = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
    let vertices: String = positions.iter().zip(behind).map(|(at, rest)| format!("{at} {rest}\n")).collect();
    let text = format!("{keyword}\n4 2 0\n{vertices}3 0 1 2 255 0 0\n3 0 2 3\n");
    let folder = Folder::new(&[("a.off", text.as_bytes())]);
    let (appearance, attributes, notes) = folder.sound(&["a.off"]);
    (colours(&appearance, &attributes), notes)
}

fn are_near(found: [[f32; 4]; 2], expected: [[f32; 4]; 2]) -> bool {
    found.as_flattened().iter().zip(expected.as_flattened()).all(|(a, b)| (a - b).abs() < 1e-6)
}

#[test]
fn off_is_read_with_its_letters_in_any_order_and_its_columns_in_that_of_their_program() {
    let red = [1.0, 0.0, 0.0, 1.0];
    let half = [LINEAR_OF_BYTE[127], 0.0, 0.0, 127.0 / 255.0];
    for (keyword, behind) in [
        // MeshLab.
        ("NCOFF", ["255 0 0 255 -0.9 0.1 0.4", "127 0 0 127 0 0 -2", "9 9 9 9 0 0 1", "9 9 9 9 0 0 1"]),
        ("NCSTOFF", ["255 0 0 255 0 0 1 0.5 2", "127 0 0 127 0 0 1 3 4", "9 9 9 9 0 0 1 1 1", "9 9 9 9 0 0 1 1 1"]),
        ("CSTOFF", ["255 0 0 255 0.5 2", "127 0 0 127 3 4", "9 9 9 9 1 1", "9 9 9 9 1 1"]),
        // Geomview, and others by the order of their letters alone.
        ("STCNOFF", ["0 0 1 255 0 0 255 0.5 2", "0 0 1 127 0 0 127 3 4", "0 0 1 9 9 9 9 1 1", "0 0 1 9 9 9 9 1 1"]),
        ("CNOFF", ["-0.9 0.1 0.4 255 0 0 255", "0 0 -2 127 0 0 127", "0 0 1 9 9 9 9", "0 0 1 9 9 9 9"]),
        // Where the numbers of a colour would be below 0, the order is the other one.
        ("NCOFF", ["-0.9 0.1 0.4 255 0 0 255", "0 0 -2 127 0 0 127", "0 0 1 9 9 9 9", "0 0 1 9 9 9 9"]),
        ("CNOFF", ["255 0 0 255 -0.9 0.1 0.4", "127 0 0 127 0 0 -2", "9 9 9 9 0 0 1", "9 9 9 9 0 0 1"]),
    ] {
        let (found, notes) = off(keyword, behind);
        assert!(are_near([found[0], found[1]], [red, half]), "{keyword} {behind:?}: {found:?} {notes}");
    }
}

#[test]
fn all_colours_of_an_off_file_have_one_range() {
    let grey = linear_from_srgb(0.5);
    for (behind, expected) in [
        // Whole numbers among shares are shares.
        (["1 0 0 1", "0.5 0.5 0.5 1", "0 0 0 1", "0 1 0 1"], [[1.0, 0.0, 0.0, 1.0], [grey, grey, grey, 1.0]]),
        (["1 0 0", "1 1 1", "0 0 0", "0 1 0"], [[1.0, 0.0, 0.0, 1.0], [1.0; 4]]),
        (["255.0 0.0 0.0 1", "1 0 0 1", "0 0 0 1", "0 1 0 1"], [[1.0, 0.0, 0.0, 1.0], [LINEAR_OF_BYTE[1], 0., 0., 1.]]),
    ] {
        let (found, _) = off("COFF", behind);
        assert!(are_near([found[0], found[1]], expected), "{behind:?}: {found:?}");
    }
}

#[test]
fn colours_up_to_255_as_floats_are_bytes() {
    let red = |appearance: &Appearance, attributes: &_| colours(appearance, attributes)[0];
    let expected = [LINEAR_OF_BYTE[128], LINEAR_OF_BYTE[64], LINEAR_OF_BYTE[32]];
    let floats = BYTES.replace("uchar", "float");
    let doubles = format!("{}property double alpha\n", BYTES.replace("uchar", "double"));
    let of_ply = |properties: &str, values: [&str; 4]| ply("", (properties, values), QUAD);
    let vertices = |last: &str| {
        format!("v 0 0 0 128 64 32\nv 1 0 0 0 0 0\nv 1 1 0 1 1 1\nv 0 1 0 {last}\nf 1 2 3 4\n").into_bytes()
    };
    for (name, file, is_bytes) in [
        ("a.ply", of_ply(&floats, ["128 64 32", "0 0 0", "1 1 1", "9 9 9"]), true),
        ("a.ply", of_ply(&doubles, ["128.0 64 32 255", "0 0 0 255", "1 1 1 255", "9 9 9 255"]), true),
        ("a.ply", of_ply(&doubles, ["128 64 32 1", "0 0 0 1", "1 1 1 1", "9 9 9 1"]), true),
        ("a.obj", vertices("9 9 9"), true),
        ("a.obj", vertices("9.0 255 9 255"), true),
        // Nothing is known of these.
        ("a.obj", vertices("9.5 9 9"), false),
        ("a.ply", of_ply(&floats, ["128 64 32", "0 0 0", "0.5 1 1", "9 9 9"]), false),
        ("a.ply", of_ply(&floats, ["128 64 32", "0 0 0", "1 1 1", "256 9 9"]), false),
    ] {
        let (appearance, attributes, notes) = Folder::new(&[(name, &file)]).sound(&[name]);
        let found = red(&appearance, &attributes);
        let expected = if is_bytes { expected } else { [1.0; 3] };
        assert!((0..3).all(|k| (found[k] - expected[k]).abs() < 1e-6) && found[3] == 1.0, "{found:?} {notes}");
        assert_eq!(notes.contains("colours are whole numbers up to 255"), is_bytes, "{notes}");
        assert_eq!(notes.contains("255 if that is the largest"), !is_bytes, "{notes}");
    }
    // Pure colours are shares.
    let (appearance, attributes, notes) =
        Folder::new(&[("a.ply", &of_ply(&floats, ["1 0 0", "0 1 0", "0 0 1", "0 0 0"]))]).sound(&["a.ply"]);
    assert_eq!(red(&appearance, &attributes), [1.0, 0.0, 0.0, 1.0]);
    assert!(!notes.contains("up to 255"), "{notes}");
    // Those of faces, too.
    let faces = ["3 0 1 2 128 64 32", "3 0 2 3 0 0 0"];
    let folder = Folder::new(&[("a.ply", &ply("", ("", [""; 4]), (&floats, &faces)))]);
    let (appearance, attributes, _) = folder.sound(&["a.ply"]);
    assert!((0..3).all(|k| (red(&appearance, &attributes)[k] - expected[k]).abs() < 1e-6));
}

/// A binary PLY file of a square whose vertices have a label, and whose faces have corners, of these types.
fn integers(label: &str, corner: &str, is_big_endian: bool, labels: [u64; 4]) -> Vec<u8> {
    let order = if is_big_endian { "big" } else { "little" };
    let mut file = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property {label} label\nelement face 2\nproperty list uchar {corner} vertex_indices\nend_header\n"
    )
    .into_bytes();
    let mut push = |bytes: &[u8]| match is_big_endian {
        true => file.extend(bytes.iter().rev()),
        false => file.extend(bytes),
    };
    for ([x, y], label) in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].into_iter().zip(labels) {
        [x, y, 0.0].iter().for_each(|value| push(&value.to_le_bytes()));
        push(&label.to_le_bytes());
    }
    for corners in [[0u64, 1, 2], [0, 2, 3]] {
        push(&[3]);
        corners.iter().for_each(|corner| push(&corner.to_le_bytes()));
    }
    file
}

#[test]
fn integers_of_64_bits_are_read() {
    for is_big_endian in [false, true] {
        for (label, corner) in [("int64", "int64"), ("uint64", "uint64"), ("int64", "uint64")] {
            let file = integers(label, corner, is_big_endian, [7, 7, 9, 9]);
            let (appearance, attributes, notes) = Folder::new(&[("a.ply", &file)]).sound(&["a.ply"]);
            assert!(appearance.scalars[0].is_label() && appearance.scalars[0].high == 9.0, "{notes}");
            assert_eq!(attributes.corners.len(), 2);
            for length in 0..file.len() {
                assert!(super::tests::import_bytes("a.ply", &file[..length]).is_err(), "{length}");
            }
        }
    }
    // As text, they are what others are.
    let file = ply("", ("property int64 label\n", ["-3", "4", "5", "6"]), QUAD);
    let (appearance, ..) = Folder::new(&[("a.ply", &file)]).sound(&["a.ply"]);
    assert_eq!((appearance.scalars[0].low, appearance.scalars[0].is_label()), (-3.0, true));
    // Corners that no mesh has.
    let mut file = integers("uint64", "uint64", false, [0; 4]);
    let last = file.len() - 8;
    file[last..].copy_from_slice(&u64::MAX.to_le_bytes());
    assert!(error_of("a.ply", &file).contains("18446744073709551615 is too large"));
    let mut file = integers("int64", "int64", false, [0; 4]);
    let last = file.len() - 8;
    file[last..].copy_from_slice(&(-2i64).to_le_bytes());
    assert!(error_of("a.ply", &file).contains("uses vertex -2"));
}

#[test]
fn elements_of_ply_that_are_no_surface_are_noted() {
    let file = String::from_utf8(ply("", ("", [""; 4]), QUAD)).unwrap();
    let file =
        file.replace("end_header\n", "element edge 1\nproperty int vertex1\nelement none 0\nend_header\n") + "7\n";
    let (mesh, notes) = import_noting("a.ply", file.as_bytes());
    assert_eq!(mesh.unwrap().triangles.len(), 2);
    assert!(notes.contains("elements that are no surface are left out: edge\n"), "{notes}");
}

/// A binary STL file of two triangles, with this header and these last bytes of each.
fn stl(header: &[u8], attributes: [u16; 2]) -> Vec<u8> {
    let mut file = header.to_vec();
    file.resize(80, b' ');
    file.extend(2u32.to_le_bytes());
    for (k, attribute) in [0.0f32, 2.0].into_iter().zip(attributes) {
        let corners = [[0.0, 0.0, 1.0], [k, 0.0, 0.0], [k + 1.0, 0.0, 0.0], [k, 1.0, 0.0]];
        file.extend(corners.iter().flatten().flat_map(|value| value.to_le_bytes()));
        file.extend(attribute.to_le_bytes());
    }
    file
}

#[test]
fn colours_of_stl_are_noted() {
    for (file, note) in [
        // Magics, VisCAM, and what nobody knows.
        (stl(b"COLOR=\x10\x20\x30\xff,MATERIAL=", [0, 0]), "colours of the input are left out"),
        (stl(b"COLOR=\x10\x20\x30\xff", [31, 0x8000]), "colours of the input are left out"),
        (stl(b"made by hand", [0x801f, 0]), "colours of the input are left out"),
        (stl(b"made by hand", [7, 7]), "numbers of triangles of the input are left out"),
    ] {
        let (mesh, notes) = import_noting("a.stl", &file);
        assert!(mesh.unwrap().triangles.len() == 2 && notes.contains(note), "{notes}");
    }
    let (_, notes) = import_noting("a.stl", &stl(b"color", [0, 0]));
    assert!(notes.is_empty(), "{notes}");
}

#[test]
fn text_of_stl_may_have_colours_and_several_solids() {
    let vertices = "outer loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n";
    let facet = format!("facet normal 0 0 1\n{vertices}endfacet\n");
    let expected = import_noting("a.stl", format!("solid a\n{facet}{facet}endsolid a\n").as_bytes()).0.unwrap();
    for (facet, is_coloured) in [
        (format!("facet normal 0 0 1\n{vertices}endfacet color 31744\n"), true),
        (format!("facet normal 0 0 1\nCOLOR 0.5 0.25 1\n{vertices}endfacet\n"), true),
        (format!("color 1 0 0\nfacet normal 0 0 1 {vertices}endfacet\n"), true),
        (facet.replace('\n', " "), false),
    ] {
        let (mesh, notes) = import_noting("a.stl", format!("solid a\n{facet}{facet}endsolid a\n").as_bytes());
        assert!(mesh.unwrap() == expected, "{facet}");
        assert_eq!(notes.contains("colours of the input"), is_coloured, "{notes}");
        assert!(!notes.contains("groups"), "{notes}");
    }
    let two = format!("solid a\n{facet}endsolid a\nsolid b\n{facet}endsolid b\n");
    let (mesh, notes) = import_noting("a.stl", two.as_bytes());
    assert!(mesh.unwrap() == expected && notes.contains("groups of the input are left out"), "{notes}");
}

#[test]
fn a_header_without_triangles_before_some_is_an_error() {
    for count in [0u32, 3] {
        let mut file = stl(b"", [0, 0]);
        file[80..84].copy_from_slice(&count.to_le_bytes());
        let expected = if count == 0 { "no triangles, but the bytes of 2 follow" } else { "announces 3 triangles" };
        assert!(error_of("a.stl", &file).contains(expected));
    }
    let empty = &stl(b"", [0, 0])[..84];
    let mut file = empty.to_vec();
    file[80] = 0;
    assert!(error_of("a.stl", &file).contains("no triangles: the file has 0 vertices"));
}

#[test]
fn decimal_commas_are_named_in_every_text_format() {
    let message = "numbers need a point, not a comma";
    for (name, text, line) in [
        ("a.obj", "v 0 0 0\nv 1,5 0 0\nv 0 1 0\nf 1 2 3\n", "line 2"),
        ("a.obj", "v 0 0 -1,5e3\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1,5 0 0\n0 1 0\n3 0 1 2\n", "line 4"),
        ("a.stl", "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0,5 0 0\n", "line 4"),
        (
            "a.ply",
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1,5 0 0\n0 1 0\n3 0 1 2\n",
            "line 11",
        ),
    ] {
        let error = error_of(name, text.as_bytes());
        assert!(error.contains(message) && error.contains(line), "{error}");
    }
    // Other commas are no decimal ones.
    assert!(!error_of("a.obj", b"v 1,2,3 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").contains(message));
}
