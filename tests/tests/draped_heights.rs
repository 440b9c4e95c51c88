//! Images over files of heights: where they are, how good they are, what is transparent, and what commands make of
//! them.

use crate::heights::Folder;
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use lodpack::Limits;
use lodpack::heights::Heights;
use lodpack_cli::heights::{HeightsOptions, HeightsSummary, build};
use lodpack_cli::import::raster::{HeightSource, RasterOptions};
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::pipeline::ColourQuality;
use lodpack_cli::progress::Silent;
use lodpack_tests::terrain::Grid;
use std::path::{Path, PathBuf};
use std::process::Command;

fn built(
    raster: &Path,
    drape: &Path,
    colour_quality: ColourQuality,
) -> Result<(Vec<u8>, HeightsSummary), Box<dyn std::error::Error>> {
    let options = RasterOptions { drape: Some(drape.to_owned()), ..RasterOptions::default() };
    let source = HeightSource::open(&[raster.to_owned()], &options, &Silent)?.expect("a raster");
    let tolerance = Tolerance::InputUnits(20.0);
    let options = HeightsOptions { tolerance, memory: 1 << 30, folder: std::env::temp_dir(), colour_quality };
    let mut bytes = vec![];
    let summary = build(&source, &options, &mut bytes, &Silent)?;
    Ok((bytes, summary))
}

/// Hills of colour, with some detail.
fn colour(x: u32, y: u32) -> [u8; 3] {
    let wave = |a: f64, b: f64| ((f64::from(x) * a).sin() * (f64::from(y) * b).cos() * 80.0 + 128.0) as u8;
    [wave(0.03, 0.05), wave(0.11, 0.02), wave(0.21, 0.17)]
}

fn photograph(folder: &Folder, size: [u32; 2]) -> PathBuf {
    let path = folder.0.path().join("photo.png");
    RgbImage::from_fn(size[0], size[1], |x, y| Rgb(colour(x, y))).save(&path).expect("writable");
    path
}

#[test]
fn an_image_over_the_whole_grid_comes_back_where_it_was_and_as_good_as_asked_for() {
    let folder = Folder::new();
    let grid = folder.fractal("dem.tif", &Grid::utm([101, 81]), false, |_, _| false);
    let photo = photograph(&folder, [303, 243]);
    let mut last = (0, f64::INFINITY);
    for quality in [40, 85, 100] {
        let (bytes, summary) = built(&grid, &photo, ColourQuality::Lossy(quality)).expect("sound");
        let file = Heights::open(bytes.as_slice(), Limits::default()).expect("just written");
        file.verify().expect("sound");
        let drape = *file.drape().expect("an image");
        assert_eq!((drape.size, drape.components), ([303, 243], 3));
        // Its edge lies half a sample outside of the first samples.
        assert!(
            (0..2).all(|k| (drape.first[k] + 1.0 / 3.0).abs() < 1e-9 && (drape.spacing[k] - 1.0 / 3.0).abs() < 1e-9)
        );
        let window = drape.window([0.0, 100.0], [0.0, 80.0], 0).expect("covered");
        let image = file.drape_image(&window).expect("sound").image;
        let mut squares = 0.0;
        for (at, texel) in image.data.chunks_exact(3).enumerate() {
            let at = [at as u32 % window.size[0], at as u32 / window.size[0]];
            let wanted = colour(at[0] + window.first[0] as u32, at[1] + window.first[1] as u32);
            squares += (0..3).map(|k| (f64::from(texel[k]) - f64::from(wanted[k])).powi(2)).sum::<f64>();
        }
        let error = squares / image.data.len() as f64;
        let bytes = summary.drape.expect("an image").bytes;
        assert!(bytes > last.0 && error < last.1, "quality {quality}: {bytes} bytes, {error}");
        last = (bytes, error);
        assert!(quality < 85 || error < 12.0, "{error}");
    }
    assert!(built(&grid, &photo, ColourQuality::Lossless).is_err());
}

#[test]
fn heights_are_the_same_with_and_without_an_image() {
    let folder = Folder::new();
    let grid = folder.fractal("dem.tif", &Grid::utm([300, 173]), false, |_, _| false);
    let photo = photograph(&folder, [64, 64]);
    let draped = built(&grid, &photo, ColourQuality::Auto).expect("sound").0;
    let bare = crate::heights::built(&grid, &RasterOptions::default(), Tolerance::InputUnits(20.0), 1 << 30).0;
    let open = |bytes: &'static [u8]| Heights::open(bytes, Limits::default()).expect("sound");
    let [draped, bare] = [draped, bare].map(|bytes| open(bytes.leak()));
    let of = |file: &Heights<&[u8]>| file.mesh(&file.cut(&Default::default()).expect("sound")).expect("sound");
    assert_eq!(of(&draped), of(&bare));
    assert_eq!((draped.index().version(), bare.index().version()), ((4, 5), (4, 2)));
}

#[test]
fn what_is_transparent_or_beside_the_image_stays_so() {
    let folder = Folder::new();
    let grid = folder.fractal("dem.tif", &Grid::utm([101, 81]), false, |_, _| false);
    let opacity = |x: u32, y: u32| if x.abs_diff(200) < 60 && y < 100 { 0 } else { 255 };
    let path = folder.0.path().join("hole.png");
    let picture = RgbaImage::from_fn(400, 320, |x, y| {
        let [r, g, b] = colour(x, y);
        Rgba([r, g, b, opacity(x, y)])
    });
    picture.save(&path).expect("writable");
    let (bytes, _) = built(&grid, &path, ColourQuality::Auto).expect("sound");
    let file = Heights::open(bytes.as_slice(), Limits::default()).expect("just written");
    let drape = *file.drape().expect("an image");
    assert_eq!(drape.components, 4);
    for halvings in 0..4 {
        let window = drape.window([0.0, 100.0], [0.0, 80.0], halvings).expect("covered");
        let image = file.drape_image(&window).expect("sound");
        for place in [[49.0, 10.0], [20.0, 10.0], [49.0, 60.0]] {
            let [x, y] = image.place(place);
            let shown = image.image.texel(x as u32, y as u32)[3];
            let there = opacity((place[0] * 4.0) as u32, (place[1] * 4.0) as u32);
            assert!(shown.abs_diff(there) < 8, "{halvings} {place:?}: {shown} and {there}");
        }
    }
    // Beyond the image nothing is opaque.
    let window = drape.window([-30.0, 20.0], [0.0, 80.0], 2).expect("covered in part");
    let image = file.drape_image(&window).expect("sound").image;
    assert_eq!((image.components, image.texel(0, 30)), (4, &[0; 4][..]));
}

#[test]
fn commands_tell_of_the_image_and_write_it() {
    let folder = Folder::new();
    folder.fractal("dem.tif", &Grid::utm([101, 81]), false, |_, _| false);
    photograph(&folder, [303, 243]);
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lodpack"));
        let output = command.current_dir(folder.0.path()).args(arguments).output().expect("it runs");
        (output.status.success(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    let (is_built, said) = run(&["build", "dem.tif", "--heights", "--drape", "photo.png", "-o", "a.lodpack"]);
    assert!(is_built && said.contains("303 x 243 texels"), "{said}");
    let (is_sound, said) = run(&["verify", "a.lodpack"]);
    assert!(is_sound, "{said}");
    let said = run(&["info", "a.lodpack"]).1;
    assert!(said.contains("303 x 243 texels"), "{said}");
    for (name, mark) in [("a.glb", "image/jpeg"), ("a.obj", "mtllib"), ("a.ply", "property uchar red")] {
        let (is_written, said) = run(&["extract", "a.lodpack", "-o", name]);
        assert!(is_written, "{said}");
        let bytes = std::fs::read(folder.0.path().join(name)).expect("written");
        assert!(String::from_utf8_lossy(&bytes).contains(mark), "{name}");
    }
    assert!(folder.0.path().join("a-0.jpg").exists());
    let (is_built, said) = run(&["build", "dem.tif", "--heights", "--color-quality", "50", "-o", "b.lodpack"]);
    assert!(!is_built && said.contains("--drape"), "{said}");
}
