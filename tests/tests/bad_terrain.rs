//! Every kind of bad raster gives a correct surface, or one clear error that names the file and what to do.

use crate::open;
use crate::terrain::read;
use lodpack_cli::import::import_shape;
use lodpack_cli::import::raster::{RasterOptions, SurfaceKind};
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::verify::{VerifyOptions, verify};
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::progress::Silent;
use lodpack_tests::terrain::Grid;
use std::path::{Path, PathBuf};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        path
    }

    /// Writes a grid in which a height depends on its number.
    fn grid(&self, name: &str, grid: &Grid, height: impl Fn(u32) -> f32) -> PathBuf {
        let heights: Vec<f32> = (0..grid.size[0] * grid.size[1]).map(height).collect();
        self.write(name, &grid.bytes(&heights))
    }
}

/// What is said about rasters that are refused. The message names the last of them.
fn refused(paths: &[PathBuf], options: &RasterOptions) -> String {
    let message = import_shape(paths, options, &Silent).expect_err("this must be refused").to_string();
    assert!(crate::heights::is_refused(paths, options), "as a grid of heights, too");
    let names = |path: &PathBuf| message.contains(&*path.file_name().expect("a name").to_string_lossy());
    assert!(paths.iter().any(names), "'{message}' names no file");
    message
}

fn refused_with(path: PathBuf, words: &[&str]) {
    let message = refused(&[path], &RasterOptions::default());
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

/// Builds and verifies; the number of triangles of the input.
fn built(path: PathBuf) -> u64 {
    let options = BuildOptions { inputs: vec![path.clone()], ..BuildOptions::default() };
    let mut bytes = vec![];
    let summary = build(&options, &mut bytes, &Silent).expect("a sound raster builds");
    let input = read(std::slice::from_ref(&path), &RasterOptions::default());
    let report = verify(&open(&bytes), Some(&input), &VerifyOptions { cuts: 10, seed: 3 }, &Silent).expect("readable");
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    crate::heights::is_sound(&path, &RasterOptions::default(), Tolerance::Auto, 10);
    summary.input_triangles
}

#[test]
fn one_row_and_one_column_are_refused() {
    let folder = Folder::new();
    for size in [[1, 1], [1, 9], [9, 1]] {
        refused_with(folder.grid("thin.tif", &Grid::utm(size), |i| i as f32), &["columns and", "needs two of both"]);
    }
}

#[test]
fn two_by_two_samples_and_prime_numbers_of_them_are_built() {
    let folder = Folder::new();
    assert_eq!(built(folder.grid("small.tif", &Grid::utm([2, 2]), |i| i as f32)), 2);
    assert_eq!(built(folder.grid("prime.tif", &Grid::utm([61, 43]), |i| (i % 17) as f32)), 2 * 60 * 42);
}

#[test]
fn a_constant_height_is_built() {
    let folder = Folder::new();
    assert_eq!(built(folder.grid("flat.tif", &Grid::utm([50, 40]), |_| 417.25)), 2 * 49 * 39);
}

#[test]
fn a_cliff_of_9000_metres_is_built() {
    let folder = Folder::new();
    assert_eq!(
        built(folder.grid("cliff.tif", &Grid::utm([40, 40]), |i| if i % 40 < 20 { 0.0 } else { 9000.0 })),
        2 * 39 * 39
    );
}

#[test]
fn a_checkerboard_of_extremes_is_built() {
    let folder = Folder::new();
    let height = |i: u32| if (i % 24 + i / 24).is_multiple_of(2) { -11_000.0 } else { 9_000.0 };
    assert_eq!(built(folder.grid("board.tif", &Grid::utm([24, 24]), height)), 2 * 23 * 23);
}

#[test]
fn cells_with_nan_and_infinite_heights_are_absent() {
    let folder = Folder::new();
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let height = |i: u32| if i % 7 == 3 { bad[(i % 3) as usize] } else { i as f32 };
    let mesh = read(&[folder.grid("holes.tif", &Grid::utm([30, 20]), height)], &RasterOptions::default());
    assert!(!mesh.triangles.is_empty() && mesh.positions.iter().all(|p| p.is_finite()));
    // A single sample without data takes the corners of four cells: six whole triangles, and two more beyond them stay.
    let one = folder.grid("one.tif", &Grid::utm([5, 5]), |i| if i == 12 { f32::NAN } else { 0.0 });
    let mesh = read(&[one], &RasterOptions::default());
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (24, 2 * 12 + 4));
}

#[test]
fn a_file_without_any_data_is_refused() {
    let folder = Folder::new();
    let grid = Grid { nodata: Some(-9999.0), ..Grid::utm([6, 6]) };
    refused_with(folder.grid("void.tif", &grid, |_| -9999.0), &["no data in any sample", "--nodata"]);
    refused_with(folder.grid("nan.tif", &grid, |_| f32::NAN), &["no data in any sample"]);
    // Heights that are no neighbours.
    refused_with(folder.grid("lone.tif", &grid, |i| if i % 14 == 0 { 1.0 } else { -9999.0 }), &["no triangle"]);
}

#[test]
fn tiles_that_overlap_must_agree() {
    let folder = Folder::new();
    let grid = Grid::utm([20, 10]);
    let a = folder.grid("a.tif", &grid.window([0, 0], [12, 10]), |i| (i % 12) as f32);
    let same = folder.grid("same.tif", &grid.window([10, 0], [10, 10]), |i| (i % 10 + 10) as f32);
    assert_eq!(read(&[a.clone(), same], &RasterOptions::default()).positions.len(), 200);
    let other = folder.grid("other.tif", &grid.window([10, 0], [10, 10]), |i| (i % 10 + 11) as f32);
    let message = refused(&[a.clone(), other], &RasterOptions::default());
    assert!(message.contains("a.tif") && message.contains("other.tif") && message.contains("500315"), "{message}");
    // Where one of them has no data, the other one counts.
    let void = folder.grid("void.tif", &grid.window([10, 0], [10, 10]), |i| if i % 10 < 2 { f32::NAN } else { 3.0 });
    assert_eq!(read(&[a, void], &RasterOptions::default()).positions.len(), 200);
}

#[test]
fn a_gap_between_tiles_stays_open() {
    let folder = Folder::new();
    let grid = Grid::utm([30, 10]);
    let a = folder.grid("a.tif", &grid.window([0, 0], [10, 10]), |i| i as f32);
    let b = folder.grid("b.tif", &grid.window([15, 0], [10, 10]), |i| i as f32);
    let below = folder.grid("c.tif", &grid.window([0, 5000], [10, 10]), |i| i as f32);
    let mesh = read(&[a, b, below], &RasterOptions::default());
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (300, 3 * 2 * 81));
}

#[test]
fn half_a_pixel_and_other_spacings_are_refused() {
    let folder = Folder::new();
    let grid = Grid::utm([10, 10]);
    let a = folder.grid("a.tif", &grid, |i| i as f32);
    let point = Grid { is_point: true, ..grid.window([10, 0], [10, 10]) };
    let b = folder.grid("b.tif", &point, |i| i as f32);
    let message = refused(&[a.clone(), b], &RasterOptions::default());
    assert!(message.contains("b.tif") && message.contains("an area differs from one that is a point"), "{message}");
    let finer = Grid { place: Some([500_300.0, 5_200_000.0, 29.0, 30.0]), ..grid };
    let message = refused(&[a, folder.grid("c.tif", &finer, |i| i as f32)], &RasterOptions::default());
    assert!(message.contains("the same spacing"), "{message}");
}

#[test]
fn a_mix_of_systems_and_of_rasters_with_meshes_is_refused() {
    let folder = Folder::new();
    let grid = Grid::utm([10, 10]);
    let a = folder.grid("a.tif", &grid, |i| i as f32);
    let b = folder.grid("b.tif", &Grid { epsg: Some(32633), ..grid.window([10, 0], [10, 10]) }, |i| i as f32);
    let message = refused(&[a.clone(), b.clone()], &RasterOptions::default());
    assert!(message.contains("EPSG:32632") && message.contains("EPSG:32633"), "{message}");
    // Somebody knows better.
    let crs = Some("EPSG:32632".to_owned());
    assert_eq!(read(&[a.clone(), b], &RasterOptions { crs, ..RasterOptions::default() }).positions.len(), 200);
    let mesh = folder.write("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let message = refused(&[a, mesh], &RasterOptions::default());
    assert!(message.contains("mesh.obj") && message.contains("a file of each"), "{message}");
}

#[test]
fn a_wrong_georeference_is_refused() {
    let folder = Folder::new();
    let at = |place: [f64; 4]| Grid { place: Some(place), epsg: Some(4326), ..Grid::utm([10, 10]) };
    // Metres in a system of degrees, rows beyond a pole, more than once around the globe.
    for place in [[500_000.0, 5_200_000.0, 30.0, 30.0], [8.0, 95.0, 0.1, 0.1], [8.0, 60.0, 41.0, 1.0]] {
        refused_with(folder.grid("wrong.tif", &at(place), |i| i as f32), &["wrong georeference", "--crs"]);
    }
    for place in [[f64::NAN, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0], [0.0, 1e300, 1.0, 1.0]] {
        let grid = Grid { place: Some(place), ..Grid::utm([10, 10]) };
        refused_with(folder.grid("wrong.tif", &grid, |i| i as f32), &["wrong georeference"]);
    }
    let utm = folder.grid("utm.tif", &Grid::utm([4, 4]), |i| i as f32);
    let options = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    assert!(refused(std::slice::from_ref(&utm), &options).contains("not in degrees"));
    let options = RasterOptions { spacing: Some(3.0), ..RasterOptions::default() };
    assert!(refused(&[utm], &options).contains("omit --spacing"));
}

#[test]
fn a_truncated_tiff_is_refused_wherever_it_ends() {
    let folder = Folder::new();
    let grid = Grid { nodata: Some(-1.0), ..Grid::utm([20, 20]) };
    let whole = grid.bytes(&[5.0; 400]);
    for length in (1..whole.len()).step_by(13) {
        refused(&[folder.write("cut.tif", &whole[..length])], &RasterOptions::default());
    }
}

#[test]
fn tables_that_lie_and_flipped_bytes_never_panic() {
    let folder = Folder::new();
    let grid = Grid { strip_rows: 3, nodata: Some(-1.0), ..Grid::utm([9, 11]) };
    let sound = grid.bytes(&[5.0; 99]);
    let read = |bytes: &[u8]| import_shape(&[folder.write("flip.tif", bytes)], &RasterOptions::default(), &Silent);
    assert!(read(&sound).is_ok());
    // Everything before the samples, bit by bit and with extreme values.
    for at in 0..sound.len() - 99 * 4 {
        for value in [0, 0xff, 0x7f, sound[at] ^ 1, sound[at] ^ 0x80] {
            let mut bytes = sound.clone();
            bytes[at] = value;
            let _ = read(&bytes);
        }
    }
    // Strips far behind the end of the file, and of enormous length.
    let entry =
        |tag: u16| 10 + 12 * (0..17).find(|i| sound[10 + 12 * i..][..2] == tag.to_le_bytes()).expect("it is there");
    for tag in [273u16, 279] {
        let at = entry(tag);
        let table = u32::from_le_bytes(sound[at + 8..at + 12].try_into().expect("four bytes")) as usize;
        let mut bytes = sound.clone();
        bytes[table..table + 4].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f]);
        let error = read(&bytes).expect_err("the strip is not there").to_string();
        assert!(error.contains("flip.tif"), "{error}");
    }
}

#[test]
fn a_raster_larger_than_its_file_takes_no_memory() {
    let folder = Folder::new();
    let sound = Grid { strip_rows: 1, ..Grid::utm([9, 11]) }.bytes(&[5.0; 99]);
    for (columns, rows) in [(u32::MAX, 11), (4_000_000, 11), (9, u32::MAX), (1 << 20, 1 << 20)] {
        let mut bytes = sound.clone();
        bytes[18..22].copy_from_slice(&columns.to_le_bytes());
        bytes[30..34].copy_from_slice(&rows.to_le_bytes());
        refused(&[folder.write("huge.tif", &bytes)], &RasterOptions::default());
    }
    let hdr = "NROWS 1000000\nNCOLS 1000000\nNBITS 16\n";
    folder.write("huge.hdr", hdr.as_bytes());
    refused_with(folder.write("huge.bil", &[0; 64]), &["ends too early", "1000000 x 1000000"]);
    refused_with(folder.write("huge.asc", b"ncols 1000000\nnrows 1000000\ncellsize 1\n1 2 3\n"), &["ends too early"]);
}

#[test]
fn grids_that_are_no_geoid_of_the_heights_are_refused() {
    let folder = Folder::new();
    let here = Grid { size: [4, 3], place: Some([150.0, 30.0, 5.0, 5.0]), ..Grid::globe([4, 3]) };
    let here = folder.grid("here.tif", &here, |i| i as f32);
    let with = |heights: &Path, geoid: PathBuf, words: &[&str]| {
        let options = RasterOptions { surface: SurfaceKind::Wgs84, geoid: Some(geoid), ..RasterOptions::default() };
        let message = import_shape(&[heights.to_owned()], &options, &Silent).expect_err("refused").to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    let geoid = crate::terrain::gtx([0, 0], [18, 10]);
    with(
        &here,
        folder.write("elsewhere.gtx", &crate::terrain::gtx([2, 2], [4, 4])),
        &["elsewhere.gtx", "does not cover"],
    );
    with(&here, folder.write("short.gtx", &geoid[..geoid.len() - 1]), &["short.gtx", "18 x 10 samples"]);
    with(&here, folder.write("tiny.gtx", &geoid[..30]), &["tiny.gtx", "40 bytes"]);
    with(&here, folder.0.path().join("none.gtx"), &["none.gtx"]);
    with(&here, folder.write("text.gtx", &[b'x'; 400]), &["text.gtx"]);
    let metres = folder.grid("metres.tif", &Grid::utm([18, 10]), |i| i as f32);
    with(&here, metres.clone(), &["metres.tif", "no grid of a geoid"]);
    let flat = RasterOptions { geoid: Some(folder.write("geoid.gtx", &geoid)), ..RasterOptions::default() };
    assert!(refused(&[metres], &flat).contains("not in degrees"));
    // A geoid without a value is an error only where there is a height.
    let mut holes = geoid.clone();
    for value in holes[40..].chunks_exact_mut(4) {
        value.copy_from_slice(&(-88.8888_f32).to_be_bytes());
    }
    with(&here, folder.write("holes.gtx", &holes), &["holes.gtx", "says nothing of the geoid at 152.5"]);
}

#[test]
fn damaged_blobs_of_lerc_are_refused() {
    let folder = Folder::new();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain");
    let blob = std::fs::read(data.join("holes.lerc")).expect("readable");
    refused_with(folder.write("short.lerc", &blob[..blob.len() / 2]), &["LERC is damaged"]);
    refused_with(folder.write("twice.lerc", &[&*blob, &*blob].concat()), &["several bands", "gdal_translate"]);
    refused_with(folder.write("none.lerc", b"nothing"), &["LERC is damaged"]);
    refused_with(data.join("lossless.lerc"), &["floating-point Huffman", "not supported", "gdal_translate"]);
    for (name, count) in [("lerc.tif", 64), ("lerc-zstd.tif", 512), ("lerc-deflate.tif", 512)] {
        let good = std::fs::read(data.join(name)).expect("readable");
        let header = good.len() - 1000;
        for at in (0..count).map(|i| 8 + i * (header - 8) / count) {
            let mut bytes = good.clone();
            bytes[at] ^= 0x55;
            // Whatever is said, nothing panics and nothing large is allocated.
            let path = folder.write(name, &bytes);
            let _ = import_shape(&[path], &RasterOptions::default(), &Silent);
        }
        refused(&[folder.write(name, &good[..good.len() / 2])], &RasterOptions::default());
    }
}

#[test]
fn pictures_and_compressions_that_are_no_heights_say_what_to_do() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain");
    refused_with(data.join("rgb.tif"), &["no single band of heights", "--drape"]);
    let folder = Folder::new();
    let picture = image::RgbImage::new(4, 4);
    let path = folder.0.path().join("picture.png");
    picture.save(&path).expect("writable");
    refused_with(path, &["coloured", "--height-code terrarium"]);
    refused_with(folder.write("broken.png", b"\x89PNG\r\n\x1a\n0000"), &["broken.png"]);
    refused_with(folder.write("nowhere.hgt", &[0; 2 * 1201 * 1201]), &["N47E008.hgt"]);
    refused_with(folder.write("N47E008.hgt", &[0; 1000]), &["1201 x 1201"]);
    refused_with(folder.write("alone.bil", &[0; 1000]), &["needs its header"]);
    for text in [
        "ncols 3\nnrows 3\ncellsize 1\n1 2 3\n4 five 6\n7 8 9\n",
        "ncols 3\nnrows -3\ncellsize 1\n1 2 3\n",
        "ncols 3\n1 2 3\n",
    ] {
        refused_with(folder.write("bad.asc", text.as_bytes()), &["bad.asc"]);
    }
}

#[test]
fn options_of_rasters_have_no_meaning_for_meshes() {
    let folder = Folder::new();
    let mesh = folder.write("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let mut options = BuildOptions { inputs: vec![mesh], ..BuildOptions::default() };
    options.model.raster.spacing = Some(2.0);
    let error = build(&options, &mut vec![], &Silent).expect_err("meshes have no spacing").to_string();
    assert!(error.contains("no rasters"), "{error}");
}
