use std::io::Cursor;
use std::sync::Mutex;

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgba};

use super::*;
use lodpack_mesh::appearance::{ScalarRange, Wrap};
use lodpack_mesh::attributes::AttributeLayout;
use lodpack_mesh::images::ImageSource;
use lodpack_mesh::srgb::{LINEAR_OF_BYTE, linear_from_srgb};
use lodpack_mesh::{Adjacency, Mesh};

const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

fn encoded(image: &DynamicImage, format: ImageFormat) -> ImageSource {
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, format).unwrap();
    ImageSource::Inline { name: "an image".into(), bytes: bytes.into_inner() }
}

/// A surface of one triangle under the image, whose corner 0 has the coordinates `uv`, corner 1 one texel to the right.
fn textured(image: ImageSource, uv: [[f32; 2]; 3]) -> (Appearance, RegionAttributes) {
    let mut layout = AttributeLayout::default();
    layout.add_uv(1);
    let texture = TextureUse { image: 0, uv_set: 0, wrap: [Wrap::Repeat; 2], transform: None };
    let material = Material { base_texture: Some(texture), base_colour: [0.5, 1.0, 1.0, 1.0], ..Material::default() };
    let appearance = Appearance {
        layout,
        has_colour: true,
        materials: vec![material],
        images: vec![image],
        ..Appearance::default()
    };
    let region = RegionAttributes { corners: vec![[0, 1, 2]], records: uv.concat(), ..RegionAttributes::default() };
    (appearance, region)
}

fn colour_at((appearance, region): &(Appearance, RegionAttributes), footprint: f32) -> ([f32; 4], String) {
    let notes = Mutex::new(String::new());
    let note = |text: &str| notes.lock().unwrap().push_str(text);
    let shader = Shader::new(appearance, None, &std::env::temp_dir(), 0, &note);
    let colour = shader.painter(region).face(0, CORNERS).base_colour([1.0, 0.0, 0.0], footprint);
    drop(shader);
    (colour, notes.into_inner().unwrap())
}

fn close<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-4)
}

#[test]
fn vertex_colours_and_scalars_are_interpolated_between_corners() {
    let mut layout = AttributeLayout::default();
    layout.add_colour();
    layout.add_scalar("quality");
    let appearance = Appearance {
        layout,
        has_colour: true,
        scalars: vec![ScalarRange::new("quality")],
        materials: vec![Material::default()],
        ..Appearance::default()
    };
    let records = [[1.0, 0.0, 0.0, 1.0, 4.0], [0.0, 1.0, 0.0, 0.5, 8.0], [0.0, 0.0, 1.0, 0.0, f32::NAN]];
    let region = RegionAttributes {
        corners: vec![[0, 1, 2], [2, 2, 2]],
        records: records.concat(),
        ..RegionAttributes::default()
    };
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 0, &|_| ());
    let mut painter = shader.painter(&region);
    let face = painter.face(0, CORNERS);
    assert_eq!(face.base_colour([0.25, 0.5, 0.25], 1.0), [0.25, 0.5, 0.25, 0.5]);
    assert_eq!(face.scalar(0, [0.5, 0.5, 0.0]), 6.0);
    // A corner without a value does not count.
    assert_eq!(face.scalar(0, [0.25, 0.25, 0.5]), 6.0);
    assert!(painter.face(1, CORNERS).scalar(0, [0.25, 0.25, 0.5]).is_nan());
    // Two triangles of area 1/2 per vertex.
    assert_eq!((face.material_density(), face.scalar_density()), (1.0, 1.0));
}

#[test]
fn triangles_without_an_area_in_the_image_have_samples_of_their_vertices() {
    let image = || encoded(&DynamicImage::ImageRgba8(ImageBuffer::from_pixel(8, 8, Rgba([9; 4]))), ImageFormat::Png);
    let densities = |uv| {
        let (appearance, region) = textured(image(), uv);
        let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 0, &|_| ());
        let mut painter = shader.painter(&region);
        let face = painter.face(0, CORNERS);
        (face.is_even(), face.material_density(), face.image_density().max(face.least_density()))
    };
    // One place of a palette, nearly one, and a ramp.
    assert_eq!(densities([[0.3, 0.3]; 3]), (true, 1.0, EVEN));
    assert_eq!(densities([[0.3, 0.3], [0.3, 0.31], [0.31, 0.3]]), (true, 1.0, EVEN));
    assert_eq!(densities([[0.1, 0.3], [0.9, 0.3], [0.5, 0.3]]), (false, 0.0, 1.0));
    assert!(densities([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]).2 > 7.9);
}

/// What vertices of separate triangles show, of which all corners of each have the same record, but for `others`:
/// triangles and their corners.
fn coloured(
    colours: &[[f32; 4]],
    of_triangles: &[u32],
    others: &[(usize, [u32; 3])],
) -> (Appearance, RegionAttributes, Mesh) {
    let mut layout = AttributeLayout::default();
    layout.add_colour();
    let materials = vec![Material::default()];
    let appearance = Appearance { layout, has_colour: true, materials, ..Appearance::default() };
    let mut corners: Vec<[u32; 3]> = of_triangles.iter().map(|&record| [record; 3]).collect();
    others.iter().for_each(|&(triangle, other)| corners[triangle] = other);
    let region = RegionAttributes { corners, records: colours.concat(), ..RegionAttributes::default() };
    let count = of_triangles.len() as u32;
    let positions = (0..count).flat_map(|triangle| CORNERS.map(|corner| corner + 2.0 * f64::from(triangle) * DVec3::X));
    let mesh = Mesh {
        positions: positions.collect(),
        triangles: (0..count).map(|triangle| [0, 1, 2].map(|k| 3 * triangle + k)).collect(),
    };
    (appearance, region, mesh)
}

const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];
const BLUE: [f32; 4] = [0.0, 0.0, 0.6, 1.0];

fn areas_of((appearance, region, mesh): &(Appearance, RegionAttributes, Mesh)) -> Option<ColourAreas> {
    let shader = Shader::new(appearance, None, &std::env::temp_dir(), 0, &|_| ());
    let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
    shader.painter(region).colour_areas(mesh, &adjacency, 7)
}

#[test]
fn parts_of_one_colour_are_an_area_wherever_they_are() {
    let surface = coloured(&[RED, BLUE], &[0, 1, 0, 0, 1], &[]);
    let areas = areas_of(&surface).unwrap();
    assert_eq!(areas.of_triangles, [0, 1, 0, 0, 1]);
    assert!(areas.jumps.are_between(0, 1) && areas.are_part(0) && areas.are_part(4) && !areas.are_part(5));
    // No image reaches beyond them, so few samples are enough.
    let (appearance, region, mesh) = &surface;
    let shader = Shader::new(appearance, None, &std::env::temp_dir(), 0, &|_| ());
    for (areas, is_even, density) in [(None, false, 1.0), (Some(&areas), true, EVEN)] {
        let mut painter = shader.painter(region).with_areas(areas);
        let face = painter.face(1, mesh.corners(1));
        assert_eq!((face.is_even(), face.image_density(), face.material_density()), (is_even, density, 1.0));
    }
    // One colour jumps nowhere.
    let one = areas_of(&coloured(&[RED, BLUE], &[1; 5], &[])).unwrap();
    assert!(one.looks.len() == 1 && one.jumps == Default::default());
}

#[test]
fn looks_that_differ_in_anything_that_is_stored_are_areas_and_alike_ones_are_one() {
    let material =
        |roughness: f32, emissive: f32| Material { roughness, emissive: [emissive; 3], ..Material::default() };
    let materials = vec![material(0.1, 0.0), material(0.9, 0.0), material(0.9, 1.0), material(0.1, 0.0)];
    let mut appearance = Appearance { has_colour: true, materials, ..Appearance::default() };
    (appearance.maps.roughness, appearance.maps.emissive) = (true, true);
    // A strip of welded triangles of one colour.
    let mesh = Mesh {
        positions: (0..6).map(|k| DVec3::new(f64::from(k / 2), f64::from(k % 2), 0.0)).collect(),
        triangles: vec![[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]],
    };
    let region = RegionAttributes { materials: vec![0, 1, 2, 3], ..RegionAttributes::default() };
    let areas = areas_of(&(appearance.clone(), region.clone(), mesh.clone())).unwrap();
    assert_eq!(areas.of_triangles, [0, 1, 2, 0]);
    assert!([[0, 1], [1, 2], [2, 0]].iter().all(|&[a, b]| areas.jumps.are_between(a, b)));
    assert_eq!(areas.looks.len(), 3);
    // Edges between looks that hardly differ are not worth keeping: these are no looks alone.
    appearance.materials[1] = material(0.11, 0.0);
    assert!(areas_of(&(appearance, region, mesh)).is_none_or(|areas| areas.looks.is_empty()));
}

#[test]
fn colours_that_run_within_a_triangle_and_noise_are_no_parts() {
    assert!(areas_of(&coloured(&[RED, BLUE], &[0, 1, 0, 0, 1], &[(3, [0, 0, 1])])).is_none());
    let many: Vec<[f32; 4]> =
        (0..300).map(|number| [(number % 20) as f32 / 20.0, (number / 20) as f32 / 20.0, 0.0, 1.0]).collect();
    let numbers: Vec<u32> = (0..300).collect();
    assert!(areas_of(&coloured(&many, &numbers[..250], &[])).is_some());
    assert!(areas_of(&coloured(&many, &numbers, &[])).is_none());
    // A tetrahedron has an edge and a half for each triangle.
    let (appearance, region, mut mesh) = coloured(&[RED, BLUE, [0.0, 1.0, 0.0, 1.0], [1.0; 4]], &[0, 1, 2, 3], &[]);
    mesh.triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    assert!(areas_of(&(appearance, region, mesh)).is_none());
}

#[test]
fn textures_are_filtered_in_linear_light_by_footprint() {
    // Black and white columns: their average has half of the light, not half of the code.
    let image = ImageBuffer::from_fn(8, 8, |x, _| Rgba(if x % 2 == 0 { [0, 0, 0, 255] } else { [255; 4] }));
    let image = encoded(&DynamicImage::ImageRgba8(image), ImageFormat::Png);
    let fine = textured(image, [[1.5 / 8.0, 0.5], [9.5 / 8.0, 0.5], [1.5 / 8.0, 1.5]]);
    // The triangle is as large as the image.
    let shader = Shader::new(&fine.0, None, &std::env::temp_dir(), 0, &|_| ());
    assert!((shader.painter(&fine.1).face(0, CORNERS).material_density() - 8.0).abs() < 1e-4);
    assert!(close(colour_at(&fine, 0.0).0, [0.5, 1.0, 1.0, 1.0]));
    assert!(close(colour_at(&fine, 1.0 / 8.0).0, [0.5, 1.0, 1.0, 1.0]));
    for width in [2.0, 3.0, 8.0, 1e9, f32::INFINITY] {
        let (colour, _) = colour_at(&fine, width / 8.0);
        assert!(!width.is_finite() || close(colour, [0.25, 0.5, 0.5, 1.0]), "{width}: {colour:?}");
    }
    // Halfway between a level and the next.
    assert!(close(colour_at(&fine, 1.5 / 8.0).0, [0.375, 0.75, 0.75, 1.0]));
}

#[test]
fn transparent_texels_do_not_bleed_and_opaque_materials_ignore_alpha() {
    let image = ImageBuffer::from_fn(2, 1, |x, _| Rgba(if x == 0 { [255, 255, 255, 255] } else { [0, 0, 0, 0] }));
    let image = encoded(&DynamicImage::ImageRgba8(image), ImageFormat::Png);
    let mut surface = textured(image, [[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]]);
    assert!(close(colour_at(&surface, 0.0).0, [0.5, 1.0, 1.0, 0.5]));
    surface.0.materials[0].alpha = AlphaMode::Mask(0.6);
    assert!(close(colour_at(&surface, 0.0).0, [0.5, 1.0, 1.0, 0.0]));
    // Where it is kept how it is drawn, alpha is compared when it is drawn.
    surface.0.has_drawings = true;
    assert!(close(colour_at(&surface, 0.0).0, [0.5, 1.0, 1.0, 0.5]));
    surface.0.materials[0].alpha = AlphaMode::Opaque;
    assert!(close(colour_at(&surface, 0.0).0, [0.25, 0.5, 0.5, 1.0]));
}

#[test]
fn images_of_every_kind_are_decoded() {
    let half = 0x80;
    let grey = DynamicImage::ImageLuma8(ImageBuffer::from_pixel(1, 1, Luma([half])));
    let fine = DynamicImage::ImageLuma16(ImageBuffer::from_pixel(3, 2, Luma([0x8080])));
    let light = LINEAR_OF_BYTE[usize::from(half)];
    for (image, format) in [
        (&grey, ImageFormat::Png),
        (&grey, ImageFormat::Jpeg),
        (&grey, ImageFormat::Tiff),
        (&grey.to_rgb8().into(), ImageFormat::WebP),
        (&fine, ImageFormat::Png),
    ] {
        let (colour, notes) = colour_at(&textured(encoded(image, format), [[0.0; 2]; 3]), 0.0);
        assert!(close(colour, [light / 2.0, light, light, 1.0]) && notes.is_empty(), "{format:?} {colour:?} {notes}");
    }
    assert_eq!(light, linear_from_srgb(f32::from(half) / 255.0));
}

#[test]
fn floats_are_linear_light_and_end_at_white() {
    let floats = |x: f32| DynamicImage::ImageRgba32F(ImageBuffer::from_pixel(3, 2, Rgba([x, 7.0, f32::NAN, 0.5])));
    for (x, red) in [(0.25, 0.25), (-1.0, 0.0), (f32::INFINITY, 1.0)] {
        let (colour, notes) = colour_at(&textured(encoded(&floats(x), ImageFormat::OpenExr), [[0.0; 2]; 3]), 0.0);
        assert!(close(colour, [red / 2.0, 1.0, 0.0, 0.5]) && notes.is_empty(), "{colour:?} {notes}");
    }
}

/// A JPEG of 8 x 8 texels in cyan, magenta, yellow and black, inverted as Adobe's programs write it: all red.
const CMYK: &str = "ffd8ffee000e41646f626500640000000000ffdb004300100b0c0e0c0a100e0d0e1211101318281a181616183123251d283a333d3c393338 \
     3740485c4e404457453738506d51575f626768673e4d71797064785c656763ffc000140800080008044311004d11005911004b1100ffc400 \
     14000100000000000000000000000000000007ffc40014100100000000000000000000000000000000ffda000e0443004d0059004b00003f \
     00401f8fc80fffd9";

#[test]
fn jpeg_in_printing_colours_is_decoded() {
    let digits: Vec<_> = CMYK.chars().filter_map(|digit| digit.to_digit(16)).collect();
    let bytes = digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect();
    let (colour, notes) = colour_at(&textured(ImageSource::Inline { name: "a".into(), bytes }, [[0.0; 2]; 3]), 0.0);
    assert!(colour[0] > 0.45 && colour[1] < 0.02 && colour[2] < 0.02, "{colour:?} {notes}");
}

#[test]
fn an_image_that_cannot_be_decoded_is_noted_once_and_the_factor_stays() {
    let image = ImageBuffer::from_fn(64, 64, |x, y| Luma([(x * y) as u8]));
    let ImageSource::Inline { name, mut bytes } = encoded(&DynamicImage::ImageLuma8(image), ImageFormat::Png) else {
        panic!("it was encoded in memory")
    };
    bytes.truncate(bytes.len() / 2);
    let cut = ImageSource::Inline { name, bytes };
    let gone = ImageSource::File { path: "nowhere.png".into(), range: None };
    for (image, name) in [(cut, "an image"), (gone, "nowhere.png")] {
        let surface = textured(image, [[0.0; 2]; 3]);
        let notes = Mutex::new(String::new());
        let note = |text: &str| notes.lock().unwrap().push_str(text);
        let shader = Shader::new(&surface.0, None, &std::env::temp_dir(), 0, &note);
        for _ in 0..2 {
            let colour = shader.painter(&surface.1).face(0, CORNERS).base_colour([1.0, 0.0, 0.0], 0.0);
            assert_eq!(colour, [0.5, 1.0, 1.0, 1.0]);
        }
        let notes = notes.lock().unwrap();
        assert!(notes.contains(name) && notes.matches("cannot be used").count() == 1, "{notes}");
    }
}

#[test]
fn coordinates_that_are_missing_or_far_away_give_a_colour() {
    let image = DynamicImage::ImageLuma8(ImageBuffer::from_pixel(4, 4, Luma([255])));
    for uv in [f32::NAN, f32::INFINITY, 1e9, -1e30] {
        let surface = textured(encoded(&image, ImageFormat::Png), [[uv, uv], [0.0, 1.0], [1.0, 0.0]]);
        assert!(close(colour_at(&surface, 0.5).0, [0.5, 1.0, 1.0, 1.0]), "{uv}");
    }
}

#[test]
fn images_beyond_the_memory_are_forgotten_and_come_back() {
    let image = |value: u8| {
        encoded(&DynamicImage::ImageLuma8(ImageBuffer::from_pixel(16, 16, Luma([value]))), ImageFormat::Png)
    };
    let (mut appearance, _) = textured(image(0), [[0.0; 2]; 3]);
    appearance.images = (0..20).map(|i| image(i * 10)).collect();
    let texture = appearance.materials[0].base_texture.clone().unwrap();
    appearance.materials = (0..20)
        .map(|image| Material { base_texture: Some(TextureUse { image, ..texture.clone() }), ..Material::default() })
        .collect();
    let region = RegionAttributes {
        corners: vec![[0; 3]; 20],
        records: vec![0.5; 2],
        materials: (0..20).collect(),
        ..RegionAttributes::default()
    };
    // Room for three of them.
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 16 * 16 * 4 * 5, &|_| ());
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (shader, region) = (&shader, &region);
            scope.spawn(move || {
                let mut painter = shader.painter(region);
                for i in 0..100 {
                    let at = (i * 7 + thread * 3) % 20;
                    let colour = painter.face(at, CORNERS).base_colour([1.0, 0.0, 0.0], 0.0);
                    assert!((colour[0] - LINEAR_OF_BYTE[at * 10]).abs() < 1e-5);
                }
            });
        }
    });
}

#[test]
fn normals_are_turned_by_their_image_towards_where_its_rows_begin() {
    // Right, up and outwards: the image's first coordinate grows along x, and its rows go down along -y.
    let image = ImageBuffer::from_pixel(1, 1, image::Rgb([255u8, 128, 128]));
    let (mut appearance, region) =
        textured(encoded(&DynamicImage::ImageRgb8(image), ImageFormat::Png), [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]);
    let texture = appearance.materials[0].base_texture.take().unwrap();
    appearance.materials[0].normal_texture = Some((texture, 1.0));
    (appearance.has_colour, appearance.maps.normal) = (false, true);
    let normal = |appearance: &Appearance, corners| {
        let shader = Shader::new(appearance, None, &std::env::temp_dir(), 1 << 20, &|_| ());
        shader.painter(&region).face(0, corners).normal([0.2, 0.3, 0.5], 0.0)
    };
    let along = |found: [f32; 3], wanted: [f32; 3]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.01);
    let found = normal(&appearance, CORNERS);
    assert!(along(found, [1.0, 0.0, 0.0]), "{found:?}");
    let up = ImageBuffer::from_pixel(1, 1, image::Rgb([128u8, 255, 128]));
    appearance.images[0] = encoded(&DynamicImage::ImageRgb8(up), ImageFormat::Png);
    let found = normal(&appearance, CORNERS);
    assert!(along(found, [0.0, 1.0, 0.0]), "{found:?}");
    // A mirrored image turns with its coordinates.
    let [a, b, c] = CORNERS;
    let found = normal(&appearance, [a, c, b]);
    assert!(along(found, [1.0, 0.0, 0.0]), "{found:?}");
    // Without an image, or where coordinates lie on a line, the triangle's own.
    appearance.materials[0].normal_texture = None;
    assert!(along(normal(&appearance, CORNERS), [0.0, 0.0, 1.0]));
    assert!(along(normal(&appearance, [DVec3::ZERO; 3]), [0.0, 0.0, 1.0]));
}

#[test]
fn tangents_of_the_input_come_before_those_of_texture_coordinates() {
    let of_image = |texel: [u8; 3]| {
        let image = ImageBuffer::from_pixel(1, 1, image::Rgb(texel));
        encoded(&DynamicImage::ImageRgb8(image), ImageFormat::Png)
    };
    // Coordinates say that right is along x. Tangents are those of the corners, to which normals along z belong.
    let normal = |texel: [u8; 3], tangents: [[f32; 4]; 3]| {
        let (mut appearance, mut region) = textured(of_image(texel), [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]);
        let texture = appearance.materials[0].base_texture.take().unwrap();
        appearance.materials[0].normal_texture = Some((texture, 1.0));
        (appearance.has_colour, appearance.maps.normal) = (false, true);
        appearance.layout.add_tangent();
        let uvs = region.records.as_chunks::<2>().0.to_vec();
        region.records = uvs.iter().zip(&tangents).flat_map(|(uv, tangent)| [&uv[..], tangent].concat()).collect();
        let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 1 << 20, &|_| ());
        shader.painter(&region).face(0, CORNERS).normal([0.25, 0.25, 0.5], 0.0)
    };
    let along = |found: [f32; 3], wanted: [f32; 3]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 0.01);
    let ([right, up], y) = ([[255, 128, 128], [128, 255, 128]], [0.0, 1.0, 0.0, 1.0]);
    assert!(along(normal(right, [y; 3]), [0.0, 1.0, 0.0]));
    assert!(along(normal(up, [y; 3]), [-1.0, 0.0, 0.0]));
    assert!(along(normal(up, [[0.0, 1.0, 0.0, -1.0]; 3]), [1.0, 0.0, 0.0]));
    // Between corners they are interpolated, and what of them points outwards does not count.
    let half = 0.5f32.sqrt();
    assert!(along(normal(right, [[1.0, 0.0, 0.5, 1.0], [1.0, 0.0, 0.0, 1.0], y]), [half, half, 0.0]));
    // Coordinates say it where a corner has no tangent, or one without a length or a side.
    let none = [f32::NAN; 4];
    for tangents in [[y, y, none], [[0.0, 0.0, 0.0, 1.0]; 3], [[0.0, 0.0, 3.0, 1.0]; 3], [[0.0, 1.0, 0.0, 0.0]; 3]] {
        assert!(along(normal(right, tangents), [1.0, 0.0, 0.0]), "{tangents:?}");
        assert!(along(normal(up, tangents), [0.0, 1.0, 0.0]), "{tangents:?}");
    }
}

#[test]
fn factors_of_materials_come_from_their_components() {
    let image = ImageBuffer::from_pixel(1, 1, image::Rgb([51u8, 102, 204]));
    let (mut appearance, region) =
        textured(encoded(&DynamicImage::ImageRgb8(image), ImageFormat::Png), [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let texture = appearance.materials[0].base_texture.take().unwrap();
    let material = &mut appearance.materials[0];
    (material.metallic, material.roughness, material.emissive) = (0.5, 1.0, [1.0, 0.5, 0.0]);
    material.metallic_roughness_texture = Some(texture.clone());
    material.occlusion_texture = Some((texture.clone(), 0.5));
    material.emissive_texture = Some(texture);
    let maps = &mut appearance.maps;
    (maps.metallic, maps.roughness, maps.occlusion, maps.emissive) = (true, true, true, true);
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 1 << 20, &|_| ());
    let face = shader.painter(&region).face(0, CORNERS);
    let at = [0.3, 0.3, 0.4];
    let [metallic, roughness] = face.metallic_roughness(at, 0.0);
    assert!((metallic - 0.4).abs() < 1e-4 && (roughness - 0.4).abs() < 1e-4, "{metallic} {roughness}");
    assert!((face.occlusion(at, 0.0) - 0.6).abs() < 1e-4);
    let light = LINEAR_OF_BYTE[51];
    assert!(close(face.emissive(at, 0.0), [light, 0.5 * LINEAR_OF_BYTE[102], 0.0]));
    // Images of one factor alone have it in their red.
    let material = &mut appearance.materials[0];
    (material.metallic_texture, material.metallic_roughness_texture) =
        (material.metallic_roughness_texture.take(), None);
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 1 << 20, &|_| ());
    let [metallic, roughness] = shader.painter(&region).face(0, CORNERS).metallic_roughness(at, 0.0);
    assert!((metallic - 0.1).abs() < 1e-4 && roughness == 1.0, "{metallic} {roughness}");
    let material = &mut appearance.materials[0];
    (material.roughness_texture, material.metallic_texture) = (material.metallic_texture.take(), None);
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 1 << 20, &|_| ());
    let [metallic, roughness] = shader.painter(&region).face(0, CORNERS).metallic_roughness(at, 0.0);
    assert!(metallic == 0.5 && (roughness - 0.2).abs() < 1e-4, "{metallic} {roughness}");
}

#[test]
fn images_in_files_show_what_those_in_memory_show() {
    let value = |x: u32, y: u32, k: u32| ((x * (3 + k) + y * y * (k + 1)) % 251) as u8;
    let rgb = ImageBuffer::from_fn(61, 40, |x, y| image::Rgb([0, 1, 2].map(|k| value(x, y, k))));
    let rgba = ImageBuffer::from_fn(61, 40, |x, y| Rgba([0, 1, 2, 3].map(|k| value(x, y, k))));
    let fine = ImageBuffer::from_fn(61, 40, |x, y| Rgba([0, 1, 2, 3].map(|k| u16::from(value(x, y, k)) * 257 + 5)));
    let grey = ImageBuffer::from_fn(61, 40, |x, y| image::LumaA([value(x, y, 1), value(x, y, 2)]));
    let (rgb, rgba) = (DynamicImage::ImageRgb8(rgb), DynamicImage::ImageRgba8(rgba));
    let images = [
        encoded(&rgb, ImageFormat::Png),
        encoded(&rgb, ImageFormat::Jpeg),
        encoded(&rgba, ImageFormat::Png),
        encoded(&DynamicImage::ImageRgba16(fine), ImageFormat::Png),
        encoded(&DynamicImage::ImageLumaA8(grey), ImageFormat::Png),
    ];
    for (number, image) in images.into_iter().enumerate() {
        for alpha in [AlphaMode::Opaque, AlphaMode::Blend] {
            let (mut appearance, region) = textured(image.clone(), [[0.21, 0.4], [0.83, 0.7], [0.1, 0.9]]);
            appearance.materials[0].alpha = alpha;
            for footprint in [0.0, 0.05, 0.2, 1.0] {
                let [file, memory] = [0, 1 << 30].map(|memory| {
                    let shader =
                        Shader::new(&appearance, None, &std::env::temp_dir(), memory, &|text| panic!("{text}"));
                    shader.painter(&region).face(0, CORNERS).base_colour([0.2, 0.5, 0.3], footprint).map(f32::to_bits)
                });
                assert_eq!(file, memory, "{number} {footprint}");
            }
        }
    }
}

#[test]
fn a_large_image_that_ends_early_is_left_out_with_a_note() {
    let image = DynamicImage::ImageLuma8(ImageBuffer::from_fn(64, 64, |x, y| Luma([(x * y % 256) as u8])));
    let ImageSource::Inline { name, bytes } = encoded(&image, ImageFormat::Png) else { unreachable!() };
    for end in [40, bytes.len() / 2, bytes.len() - 30] {
        let cut = ImageSource::Inline { name: name.clone(), bytes: bytes[..end].to_vec() };
        let (colour, note) = colour_at(&textured(cut, [[0.5; 2]; 3]), 0.0);
        assert!(note.contains("cannot be used"), "{end}: {note}");
        assert!(close([colour[0], colour[1], colour[2]], [0.5, 1.0, 1.0]), "{end}: {colour:?}");
    }
}

#[test]
fn a_damaged_image_of_several_meanings_is_noted_once() {
    let image = DynamicImage::ImageLuma8(ImageBuffer::from_fn(64, 64, |x, y| Luma([(x * y % 256) as u8])));
    let ImageSource::Inline { name, bytes } = encoded(&image, ImageFormat::Jpeg) else { unreachable!() };
    let (mut appearance, region) = textured(ImageSource::Inline { name, bytes: bytes[..900].to_vec() }, [[0.5; 2]; 3]);
    let texture = appearance.materials[0].base_texture.clone().unwrap();
    appearance.materials[0].occlusion_texture = Some((texture, 1.0));
    appearance.maps.occlusion = true;
    let notes = Mutex::new(String::new());
    let note = |text: &str| notes.lock().unwrap().push_str(text);
    let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 0, &note);
    let colour = shader.painter(&region).face(0, CORNERS).base_colour([1.0, 0.0, 0.0], 0.0);
    assert_eq!(colour, [0.5, 1.0, 1.0, 1.0]);
    let notes = notes.lock().unwrap();
    assert!(notes.matches("cannot be used: it is damaged").count() == 1, "{notes}");
}

#[test]
fn a_file_of_texels_that_cannot_be_made_is_an_error_and_no_note() {
    let image = encoded(&DynamicImage::ImageLuma8(ImageBuffer::from_pixel(8, 8, Luma([9]))), ImageFormat::Png);
    let (appearance, region) = textured(image, [[0.5; 2]; 3]);
    let nowhere = tempfile::tempdir().unwrap().path().join("nowhere");
    let shader = Shader::new(&appearance, None, &nowhere, 0, &|text| panic!("{text}"));
    shader.check().unwrap();
    shader.painter(&region).face(0, CORNERS);
    let error = shader.check().unwrap_err();
    assert!(error.path.starts_with(&nowhere) && error.action == "made", "{error}");
}
