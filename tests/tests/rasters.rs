//! Rasters as their writers lay them out have the heights, the place and the gaps that they say.

use crate::terrain::read;
use image::{ExtendedColorType, ImageEncoder};
use lodpack_cli::import::import_shape;
use lodpack_cli::import::raster::{HeightCode, Nodata, RasterOptions};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::progress::Silent;
use lodpack_tests::tiff::{Image, Values, file};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Columns and rows of most files here.
const SIZE: [u32; 2] = [11, 6];

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary directory"))
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("writable");
        path
    }
}

/// Heights that are all different.
fn heights() -> Vec<u8> {
    (0..66).map(|i| 20 + i * 3).collect()
}

/// Whether a mask leaves a sample out.
fn is_hidden(column: usize, row: usize) -> bool {
    (3..6).contains(&column) && (2..4).contains(&row)
}

/// A number for each sample: one where it counts, another where it is left out.
fn mask<T: Copy>(shown: T, hidden: T) -> Vec<T> {
    (0..66).map(|i| if is_hidden(i % 11, i / 11) { hidden } else { shown }).collect()
}

/// The heights of a surface by column and row of samples 10 apart, of which the first one is at a place.
fn by_sample(mesh: &Mesh, [x, y]: [f64; 2]) -> BTreeMap<[i64; 2], f64> {
    let sample = |at: f64| {
        assert!((at - at.round()).abs() < 1e-6, "{at} is between samples");
        at.round() as i64
    };
    mesh.positions.iter().map(|p| ([sample((p.x - x) / 10.0), sample((y - p.y) / 10.0)], p.z)).collect()
}

/// What a file of [`heights`] has whose samples under the mask have no data.
fn masked_heights() -> BTreeMap<[i64; 2], f64> {
    let all = heights().into_iter().enumerate().filter(|(i, _)| !is_hidden(i % 11, i / 11));
    all.map(|(i, height)| ([i as i64 % 11, i as i64 / 11], f64::from(height))).collect()
}

fn spaced() -> RasterOptions {
    RasterOptions { spacing: Some(10.0), ..RasterOptions::default() }
}

/// A TIFF of bytes whose corner is at 1000, 2000.
fn grey() -> Image {
    Image::grey(SIZE, 8, 1, heights()).at([1000.0, 2000.0, 10.0, 10.0])
}

/// The samples of a file at that place.
fn of_file(path: &Path) -> BTreeMap<[i64; 2], f64> {
    by_sample(&read(&[path.to_owned()], &RasterOptions::default()), [1005.0, 1995.0])
}

fn refused(path: &Path, options: &RasterOptions) -> String {
    let message = import_shape(&[path.to_owned()], options, &Silent).expect_err("it must be refused").to_string();
    assert!(message.contains(&*path.file_stem().expect("a name").to_string_lossy()), "'{message}' names no file");
    message
}

/// Bits of samples one after the other, each row in bytes of its own.
fn packed(samples: &[u32], columns: usize, bits: usize) -> Vec<u8> {
    let mut bytes = vec![];
    for row in samples.chunks(columns) {
        let all: Vec<u8> =
            row.iter().flat_map(|sample| (0..bits).rev().map(move |k| (sample >> k & 1) as u8)).collect();
        bytes.extend(all.chunks(8).map(|bits| bits.iter().enumerate().fold(0, |byte, (k, bit)| byte | bit << (7 - k))));
    }
    bytes
}

#[test]
fn samples_that_a_mask_in_a_tiff_leaves_out_have_no_data() {
    let folder = Folder::new();
    let one_bit = || Image::mask(SIZE, packed(&mask(1, 0), 11, 1));
    let of_bytes = Image::grey(SIZE, 8, 1, mask(255, 0)).with(254, Values::Long(vec![4]));
    // Masks of smaller versions are no masks of the image.
    let reduced = Image::mask([2, 2], vec![0, 0]).with(254, Values::Long(vec![5]));
    for (name, images) in [
        ("bit", vec![grey(), one_bit()]),
        ("bytes", vec![grey(), of_bytes.with(262, Values::Short(vec![4]))]),
        ("overviews", vec![grey(), reduced, one_bit()]),
        ("white", vec![grey().with(262, Values::Short(vec![0])), one_bit()]),
    ] {
        for is_big_endian in [false, true] {
            let path = folder.write(&format!("{name}.tif"), file(&images, is_big_endian));
            assert_eq!(of_file(&path), masked_heights(), "{name}");
            let all = RasterOptions { nodata: Some(Nodata::None), ..RasterOptions::default() };
            assert_eq!(read(&[path], &all).positions.len(), 66, "{name}: all are heights if somebody says so");
        }
    }
}

#[test]
fn samples_that_are_transparent_have_no_data() {
    let folder = Folder::new();
    let two: Vec<u8> = heights().into_iter().zip(mask(255, 0)).flat_map(<[u8; 2]>::from).collect();
    let with_alpha = |kind, pieces: Vec<Vec<u8>>| {
        let image = grey().with(258, Values::Short(vec![8, 8])).with(277, Values::Short(vec![2]));
        Image { pieces, ..image.with(338, Values::Short(vec![kind])).with(339, Values::Short(vec![1, 1])) }
    };
    let planes = with_alpha(2, vec![heights(), mask(255, 0)]).with(284, Values::Short(vec![2]));
    for (name, image) in [("beside", with_alpha(1, vec![two.clone()])), ("planes", planes)] {
        assert_eq!(of_file(&folder.write(&format!("{name}.tif"), file(&[image], false))), masked_heights(), "{name}");
    }
    // A second band of another meaning is refused.
    let other = folder.write("other.tif", file(&[with_alpha(0, vec![two.clone()])], false));
    assert!(refused(&other, &RasterOptions::default()).contains("no single band of heights but 2 bands"));
    let path = folder.0.path().join("alpha.png");
    image::save_buffer(&path, &two, 11, 6, ExtendedColorType::La8).expect("writable");
    let sixteen: Vec<u8> = two.iter().flat_map(|byte| [0, *byte]).collect();
    let fine = folder.0.path().join("fine.png");
    let encoder = image::codecs::png::PngEncoder::new(std::fs::File::create(&fine).expect("writable"));
    // The encoder takes numbers in the order of the machine.
    let native: Vec<u8> =
        sixteen.as_chunks().0.iter().flat_map(|pair| u16::from_be_bytes(*pair).to_ne_bytes()).collect();
    encoder.write_image(&native, 11, 6, ExtendedColorType::La16).expect("writable");
    for path in [path, fine] {
        assert_eq!(by_sample(&read(&[path], &spaced()), [0.0, 50.0]), masked_heights());
    }
    let colours: Vec<u8> = heights().into_iter().zip(mask(1, 0)).flat_map(|(h, alpha)| [128, h, 0, alpha]).collect();
    let tile = folder.0.path().join("terrarium.png");
    image::save_buffer(&tile, &colours, 11, 6, ExtendedColorType::Rgba8).expect("writable");
    let options = RasterOptions { height_code: HeightCode::Terrarium, ..spaced() };
    assert_eq!(by_sample(&read(&[tile], &options), [0.0, 50.0]), masked_heights());
}

#[test]
fn the_grey_of_a_png_that_stands_for_nothing_has_no_data() {
    let folder = Folder::new();
    for depth in [png::BitDepth::Eight, png::BitDepth::Sixteen] {
        let path = folder.0.path().join("a.png");
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).expect("writable"), 11, 6);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(depth);
        encoder.set_trns(vec![0, 7]);
        let shown: Vec<u8> =
            heights().into_iter().zip(mask(true, false)).map(|(h, shown)| if shown { h } else { 7 }).collect();
        let is_fine = depth == png::BitDepth::Sixteen;
        let bytes: Vec<u8> = if is_fine { shown.iter().flat_map(|h| [0, *h]).collect() } else { shown };
        encoder.write_header().and_then(|mut writer| writer.write_image_data(&bytes)).expect("writable");
        assert_eq!(by_sample(&read(&[path], &spaced()), [0.0, 50.0]), masked_heights());
    }
}

#[test]
fn a_mask_in_a_file_beside_a_raster_counts_for_every_format() {
    let folder = Folder::new();
    let of_bytes = file(&[Image::grey(SIZE, 8, 1, mask(255, 0))], false);
    let tiff = folder.write("a.tif", file(&[grey()], false));
    folder.write("a.tif.msk", &of_bytes);
    assert_eq!(of_file(&tiff), masked_heights());
    let rows: String = heights().chunks(11).map(|row| format!("{row:?}\n").replace(['[', ']', ','], "")).collect();
    let asc = format!("ncols 11\nnrows 6\nxllcorner 1000\nyllcorner 1940\ncellsize 10\n{rows}");
    let asc = folder.write("b.asc", asc);
    folder.write("b.asc.MSK", &of_bytes);
    assert_eq!(of_file(&asc), masked_heights());
    let picture = folder.0.path().join("c.png");
    image::save_buffer(&picture, &heights(), 11, 6, ExtendedColorType::L8).expect("writable");
    folder.write("c.png.msk", &of_bytes);
    assert_eq!(by_sample(&read(&[picture], &spaced()), [0.0, 50.0]), masked_heights());
}

#[test]
fn a_mask_of_another_size_is_refused() {
    let folder = Folder::new();
    let inside = folder.write("inside.tif", file(&[grey(), Image::mask([11, 5], vec![255; 10])], false));
    let beside = folder.write("beside.tif", file(&[grey()], false));
    folder.write("beside.tif.msk", file(&[Image::grey([12, 6], 8, 1, vec![255; 72])], false));
    for (path, size) in [(inside, "11 x 5"), (beside, "12 x 6")] {
        let message = refused(&path, &RasterOptions::default());
        assert!(message.contains(&format!("a mask of {size} samples over 11 x 6")), "{message}");
    }
    let other = folder.write("text.tif", file(&[grey()], false));
    folder.write("text.tif.msk", "no mask at all");
    assert!(refused(&other, &RasterOptions::default()).contains("text.tif.msk"));
}

#[test]
fn no_data_is_found_where_its_text_has_fewer_digits_than_the_samples() {
    let folder = Folder::new();
    let count = |samples: Vec<u8>, bits, nodata: &str, options: &RasterOptions| {
        let mut image = Image::grey(SIZE, bits, 3, samples).at([1000.0, 2000.0, 10.0, 10.0]);
        if !nodata.is_empty() {
            image = image.with(42113, Values::Text(nodata.into()));
        }
        read(&[folder.write("a.tif", file(&[image], false))], options).positions.len()
    };
    let floats = |hidden: f32| mask(100.0_f32, hidden).iter().flat_map(|height| height.to_le_bytes()).collect();
    let default = RasterOptions::default();
    for (hidden, nodata) in [
        (f32::MIN, "-3.40282e+38"),
        (f32::MIN, ""),
        (f32::MAX, "3.4028e38"),
        (-9999.1, "-9999.1"),
        (-9999.101, "-9999.1"),
        (f32::NAN, "-1.#QNAN"),
        (-2e30, ""),
    ] {
        assert_eq!(count(floats(hidden), 32, nodata, &default), 60, "{hidden} {nodata}");
    }
    assert_eq!(count(floats(-9999.11), 32, "-9999.1", &default), 66, "another height");
    let doubles: Vec<f64> = mask(100.0, -1.797_693_134_862_315_7e308);
    let doubles = doubles.iter().flat_map(|height| height.to_le_bytes()).collect();
    assert_eq!(count(doubles, 64, "-1.79769e+308", &default), 60);
    let all = RasterOptions { nodata: Some(Nodata::None), ..default };
    assert_eq!(count(floats(-2e30), 32, "", &all), 66, "all are heights if somebody says so");
}

#[test]
fn shades_over_white_are_heights_as_they_are_stored() {
    let folder = Folder::new();
    let expected: BTreeMap<[i64; 2], f64> =
        heights().iter().enumerate().map(|(i, h)| ([i as i64 % 11, i as i64 / 11], f64::from(*h))).collect();
    let bytes = |width: usize| heights().iter().flat_map(|h| [&[*h][..], &vec![0; width - 1]].concat()).collect();
    let floats = heights().iter().flat_map(|h| f32::from(*h).to_le_bytes()).collect();
    for (bits, format, samples) in
        [(8, 1, bytes(1)), (16, 1, bytes(2)), (32, 1, bytes(4)), (16, 2, bytes(2)), (32, 3, floats)]
    {
        let image = Image::grey(SIZE, bits, format, samples).at([1000.0, 2000.0, 10.0, 10.0]);
        let path = folder.write("a.tif", file(&[image.with(262, Values::Short(vec![0]))], false));
        assert_eq!(of_file(&path), expected, "{bits} bits, format {format}");
    }
}

#[test]
fn samples_of_any_number_of_bits_are_heights() {
    let folder = Folder::new();
    for bits in [1, 2, 4, 7, 12, 15, 17, 24, 31] {
        let samples: Vec<u32> = (0..66).map(|i| (i * 2_654_435_761_u64) as u32 & ((1 << bits) - 1)).collect();
        let strip = Image::grey(SIZE, bits, 1, packed(&samples, 11, bits.into()));
        // The first tile of 16 x 16, of which the image has a part.
        let within = |i: usize| if i % 16 < 11 && i / 16 < 6 { samples[i / 16 * 11 + i % 16] } else { 0 };
        let tile: Vec<u32> = (0..256).map(within).collect();
        let tiled = Image { pieces: vec![packed(&tile, 16, bits.into())], ..strip.clone() };
        let tiled = tiled.with(322, Values::Long(vec![16])).with(323, Values::Long(vec![16]));
        for image in [strip, tiled] {
            let path = folder.write("a.tif", file(&[image.at([1000.0, 2000.0, 10.0, 10.0])], false));
            let found: Vec<f64> = of_file(&path).into_values().collect();
            let mut columns: Vec<f64> = vec![];
            (0..11).for_each(|column| columns.extend(samples.iter().skip(column).step_by(11).map(|s| f64::from(*s))));
            assert_eq!(found, columns, "{bits} bits");
        }
    }
    let odd = Image::grey(SIZE, 12, 2, packed(&[0; 66], 11, 12));
    let message = refused(&folder.write("signed.tif", file(&[odd], false)), &RasterOptions::default());
    assert!(message.contains("samples of 12 bits"), "{message}");
    let reversed = grey().with(266, Values::Short(vec![2]));
    assert!(
        refused(&folder.write("order.tif", file(&[reversed], false)), &RasterOptions::default()).contains("FillOrder")
    );
}

#[test]
fn rasters_that_begin_in_the_south_or_east_lie_where_they_say() {
    let folder = Folder::new();
    let shifted = |column: f64, row: f64, x: f64, y: f64| {
        let map = vec![column, 0.0, 0.0, x, 0.0, row, 0.0, y, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        Image::grey(SIZE, 8, 1, heights()).with(34264, Values::Double(map))
    };
    let masked = Image::mask(SIZE, packed(&mask(1, 0), 11, 1));
    for (name, image, [from_east, from_south]) in [
        ("north", shifted(10.0, -10.0, 1000.0, 2000.0), [false, false]),
        ("south", shifted(10.0, 10.0, 1000.0, 1940.0), [false, true]),
        ("east", shifted(-10.0, -10.0, 1110.0, 2000.0), [true, false]),
        ("both", shifted(-10.0, 10.0, 1110.0, 1940.0), [true, true]),
    ] {
        let turned = |[column, row]: [i64; 2]| {
            [if from_east { 10 - column } else { column }, if from_south { 5 - row } else { row }]
        };
        let expected = masked_heights().into_iter().map(|(at, height)| (turned(at), height)).collect();
        let path = folder.write(&format!("{name}.tif"), file(&[image, masked.clone()], false));
        assert_eq!(of_file(&path), expected, "{name}");
    }
    // The sign of a row's height in the other tags says nothing, as GDAL has it.
    let negative = Image::grey(SIZE, 8, 1, heights()).at([1000.0, 2000.0, 10.0, -10.0]);
    assert_eq!(
        of_file(&folder.write("n.tif", file(&[negative], false))),
        of_file(&folder.write("p.tif", file(&[grey()], false)))
    );
    for (name, [b, d]) in [("turned", [1.0, -1.0]), ("sheared", [0.0, 0.5])] {
        let map = vec![10.0, b, 0.0, 1000.0, d, -10.0, 0.0, 2000.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let image = Image::grey(SIZE, 8, 1, heights()).with(34264, Values::Double(map));
        let message = refused(&folder.write(&format!("{name}.tif"), file(&[image], false)), &RasterOptions::default());
        assert!(message.contains("rotated") && message.contains("gdalwarp"), "{message}");
    }
}

#[test]
fn world_files_say_where_rasters_and_images_are() {
    let folder = Folder::new();
    let world = "10\n0\n0\n-10\n1005\n1995\n";
    for (name, sidecar) in [("a.tif", "a.tfw"), ("b.tif", "b.TFW"), ("c.tiff", "c.tiffw"), ("d.tif", "d.wld")] {
        folder.write(sidecar, world);
        let path = folder.write(name, file(&[Image::grey(SIZE, 8, 1, heights())], false));
        assert_eq!(of_file(&path).len(), 66, "{name}");
    }
    let picture = folder.0.path().join("e.png");
    image::save_buffer(&picture, &heights(), 11, 6, ExtendedColorType::L8).expect("writable");
    folder.write("e.pgw", world);
    assert_eq!(of_file(&picture).len(), 66);
    assert!(refused(&picture, &spaced()).contains("omit --spacing"));
    folder.write("e.pgw", "10\n0\n0\n10\n1005\n1945\n");
    assert!(refused(&picture, &RasterOptions::default()).contains("first row in the south"));
    folder.write("e.pgw", "10,5\n0\n0\n-10,5\n1005\n1945\n");
    assert!(refused(&picture, &RasterOptions::default()).contains("numbers with a point"));
    // What the file says itself comes first.
    folder.write("f.tfw", "1\n0\n0\n-1\n5\n5\n");
    assert_eq!(of_file(&folder.write("f.tif", file(&[grey()], false))).len(), 66);
    folder.write("g.tfw", "10\n0\n0\n10\n1005\n1945\n");
    let south = folder.write("g.tif", file(&[Image::grey(SIZE, 8, 1, heights())], false));
    assert_eq!(of_file(&south)[&[0, 5]], 20.0);
}

/// What GDAL writes beside a raster that lies at the place of [`grey`]. Heights are two more than what is stored.
const AUX: &str = "<PAMDataset><SRS>EPSG:32633</SRS><GeoTransform>1000, 10, 0, 2000, 0, -10</GeoTransform><PAMRasterBand band=\"1\">\
    <NoDataValue>20</NoDataValue><UnitType>ft</UnitType><Offset>2</Offset></PAMRasterBand></PAMDataset>";

#[test]
fn what_gdal_writes_beside_rasters_counts() {
    let folder = Folder::new();
    let expected: BTreeMap<[i64; 2], f64> = (heights().into_iter().enumerate().skip(1))
        .map(|(i, height)| ([i as i64 % 11, i as i64 / 11], (f64::from(height) + 2.0) * 0.3048))
        .collect();
    let agrees = |path: &Path| {
        let found = of_file(path);
        assert_eq!(found.len(), 65, "{}", path.display());
        assert!(found.iter().all(|(at, z)| (z - expected[at]).abs() < 1e-9), "{}", path.display());
    };
    let picture = folder.0.path().join("a.png");
    image::save_buffer(&picture, &heights(), 11, 6, ExtendedColorType::L8).expect("writable");
    folder.write("a.png.aux.xml", AUX);
    agrees(&picture);
    // Those of a TIFF are later news than its tags.
    let elsewhere = Image::grey(SIZE, 8, 1, heights()).at([7.0, 7.0, 1.0, 1.0]).with(42113, Values::Text("23".into()));
    folder.write("b.tif.aux.xml", AUX);
    agrees(&folder.write("b.tif", file(&[elsewhere], false)));
    // A format with numbers of its own keeps them.
    let rows: Vec<String> = heights().chunks(11).map(|row| row.iter().map(|h| format!("{h} ")).collect()).collect();
    let text = format!(
        "ncols 11\nnrows 6\nxllcorner 1000\nyllcorner 1940\ncellsize 10\nNODATA_value 20\n{}\n",
        rows.join("\n")
    );
    let own = folder.write("c.asc", text);
    folder.write("c.asc.AUX.XML", AUX.replace("1000, 10", "5, 1").replace(">20<", ">23<"));
    agrees(&own);
    // So does a world file beside.
    folder.write("a.png.aux.xml", AUX.replace("1000, 10", "5, 1"));
    folder.write("a.pgw", "10\n0\n0\n-10\n1005\n1995\n");
    agrees(&picture);
    folder.write("a.png.aux.xml", AUX.replace("</SRS>", ""));
    assert!(refused(&picture, &RasterOptions::default()).contains("a.png.aux.xml"));
}

#[test]
fn tiles_of_one_system_are_joined_whatever_is_remarked_about_one_of_them() {
    let folder = Folder::new();
    let tile = |name: &str, x: f64| {
        let grey = Image::grey(SIZE, 8, 1, heights()).at([x, 2000.0, 10.0, 10.0]);
        folder.write(name, file(&[grey], false))
    };
    let tiles = [tile("west.tif", 1000.0), tile("east.tif", 1110.0)];
    let unit = "<UnitType>cubits</UnitType>";
    folder.write("east.tif.aux.xml", format!("<PAMDataset><PAMRasterBand>{unit}</PAMRasterBand></PAMDataset>"));
    assert_eq!(by_sample(&read(&tiles, &RasterOptions::default()), [1005.0, 1995.0]).len(), 132);
}

#[test]
fn an_image_lies_where_the_metadata_beside_it_say() {
    let folder = Folder::new();
    let grid = folder.write("grid.tif", file(&[grey()], false));
    let picture = image::RgbImage::from_pixel(22, 12, image::Rgb([200, 90, 40]));
    for name in ["drape.png", "drape.tif"] {
        let drape = folder.0.path().join(name);
        picture.save(&drape).expect("writable");
        let lies = |corner: &str| {
            let text = format!("<PAMDataset><GeoTransform>{corner}, 5, 0, 2000, 0, -5</GeoTransform></PAMDataset>");
            folder.write(&format!("{name}.aux.xml"), text);
            String::from_utf8_lossy(&draped(&folder, &grid, &drape).stderr).into_owned()
        };
        assert!(lies("9000").contains("lies beside the grid"), "{name}");
        let said = lies("1000");
        assert!(!said.contains("only a part") && !said.contains("error"), "{said}");
    }
}

#[test]
fn headers_beside_samples_say_their_kind_in_many_ways_and_capitals() {
    let folder = Folder::new();
    let hdr = "NROWS 6\nNCOLS 11\nULXMAP 1005\nULYMAP 1995\nXDIM 10\nYDIM 10\n";
    let of = |width: usize, is_big: bool| -> Vec<u8> {
        let number = |h: &u8| {
            let mut bytes = vec![0; width];
            bytes[if is_big { width - 1 } else { 0 }] = *h;
            bytes
        };
        heights().iter().flat_map(number).collect()
    };
    let floats: Vec<u8> = heights().iter().flat_map(|h| f32::from(*h).to_le_bytes()).collect();
    let expected = of_file(&folder.write("a.tif", file(&[grey()], false)));
    for (name, sidecar, says, bytes) in [
        ("E020N40.DEM", "E020N40.HDR", "BYTEORDER M\nNBITS 16\n", of(2, true)),
        ("b.bil", "B.Hdr", "BYTEORDER MSBFIRST\nNBITS 16\nPIXELTYPE UNSIGNEDINT\n", of(2, true)),
        ("c.bil", "c.hdr", "BYTEORDER LSBFIRST\nNBITS 32\nPIXELTYPE SIGNEDINT\n", of(4, false)),
        ("d.BIL", "d.hdr", "DATATYPE INT2S\n", of(2, false)),
        ("e.bil", "e.hdr", "DATATYPE FLT4S\n", floats.clone()),
        ("f.bil", "f.hdr", "NBITS 32\nPIXELTYPE F\n", floats),
        ("g.bil", "g.hdr", "NBITS 8\nDATATYPE U8\n", heights()),
        ("h.raw", "h.HDR", "byteorder big_endian\nnbits 16\npixeltype signedint\n", of(2, true)),
    ] {
        folder.write(sidecar, format!("{hdr}{says}"));
        assert_eq!(of_file(&folder.write(name, bytes)), expected, "{name}");
    }
    folder.write("i.hdr", format!("{hdr}BYTEORDER VAX\n"));
    assert!(refused(&folder.write("i.bil", of(2, true)), &RasterOptions::default()).contains("BYTEORDER"));
}

#[test]
fn compressions_that_cannot_be_read_are_named_and_sound_files_are_not_called_damaged() {
    let folder = Folder::new();
    for (number, name) in [(10u8, "HTJ2K"), (12, "LJ2K"), (13, "ZSTD")] {
        let mut bytes = vec![0x76, 0x2f, 0x31, 1, 2, 0, 0, 0];
        bytes.extend(b"owner\0string\0\x03\0\0\0abccompression\0compression\0\x01\0\0\0");
        bytes.extend([number, 0]);
        let message = refused(&folder.write("a.exr", bytes), &RasterOptions::default());
        assert!(message.contains(name) && message.contains("ZIP") && !message.contains("damaged"), "{message}");
    }
    for (number, name) in [(34925, "LZMA (34925)"), (34712, "JPEG 2000"), (50002, "JPEG XL"), (777, "number 777")] {
        let path = folder.write("a.tif", file(&[grey().with(259, Values::Short(vec![number]))], false));
        let message = refused(&path, &RasterOptions::default());
        let words = [name, "is not supported; convert it first"];
        assert!(words.iter().all(|word| message.contains(word)) && !message.contains("damaged"), "{message}");
    }
}

/// An image over a raster, and what a build says.
fn draped(folder: &Folder, grid: &Path, drape: &Path) -> std::process::Output {
    let mut command = crate::commands::lodpack();
    command.current_dir(folder.0.path()).args([
        "build",
        "--force",
        "--as",
        "mesh",
        "--tolerance",
        "1",
        "-o",
        "a.lodpack",
    ]);
    command.arg(grid).arg("--drape").arg(drape).output().expect("the program runs")
}

#[test]
fn an_image_that_cannot_be_shown_over_a_raster_is_an_error_that_says_what_to_do() {
    let folder = Folder::new();
    let grid = folder.write("grid.tif", file(&[grey()], false));
    let rgb = |compression| {
        let image = Image::grey(SIZE, 8, 1, vec![90; 198]).with(277, Values::Short(vec![3]));
        let image = image.with(258, Values::Short(vec![8; 3])).with(339, Values::Short(vec![1; 3]));
        image.with(262, Values::Short(vec![2])).with(259, Values::Short(vec![compression]))
    };
    let palette = Image::grey(SIZE, 8, 1, vec![1; 66]).with(262, Values::Short(vec![3]));
    let palette = palette.with(320, Values::Short(vec![7; 768]));
    for (name, image) in [("lzma", rgb(34925)), ("palette", palette)] {
        let drape = folder.write(&format!("{name}.tif"), file(&[image], false));
        let said = draped(&folder, &grid, &drape);
        let message = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(!said.status.success() && message.contains("cannot be shown"), "{message}");
        assert!(message.contains(name) && message.contains("gdal_translate"), "{message}");
    }
    let shown = folder.write("shown.tif", file(&[rgb(1)], false));
    let said = draped(&folder, &grid, &shown);
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    assert!(!String::from_utf8_lossy(&said.stderr).contains("opaque"));
    // Masks of images are noted, and everything is shown.
    let masked = folder.write("masked.tif", file(&[rgb(1), Image::mask(SIZE, vec![0; 12])], false));
    let beside = folder.write("beside.tif", file(&[rgb(1)], false));
    folder.write("beside.tif.msk", file(&[Image::mask(SIZE, vec![0; 12])], false));
    let clear = folder.0.path().join("clear.png");
    image::RgbaImage::from_pixel(11, 6, image::Rgba([200, 90, 40, 0])).save(&clear).expect("writable");
    for drape in [masked, beside, clear] {
        let said = draped(&folder, &grid, &drape);
        let message = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(said.status.success() && message.contains("all are shown as if they were opaque"), "{message}");
    }
}

#[test]
fn an_image_lies_where_its_world_file_says() {
    let folder = Folder::new();
    let grid = folder.write("grid.tif", file(&[grey()], false));
    let drape = folder.0.path().join("drape.png");
    image::RgbImage::from_pixel(22, 12, image::Rgb([200, 90, 40])).save(&drape).expect("writable");
    folder.write("drape.pgw", "5\n0\n0\n-5\n9002.5\n1997.5\n");
    let said = String::from_utf8_lossy(&draped(&folder, &grid, &drape).stderr).into_owned();
    assert!(said.contains("lies beside the grid"), "{said}");
    for world in ["5\n0\n0\n-5\n1002.5\n1997.5\n", "5\n0\n0\n5\n1002.5\n1942.5\n"] {
        folder.write("drape.pgw", world);
        let said = draped(&folder, &grid, &drape);
        let message = String::from_utf8_lossy(&said.stderr).into_owned();
        assert!(said.status.success() && !message.contains("only a part"), "{message}");
    }
}

#[test]
fn damaged_masks_and_bits_never_panic() {
    let folder = Folder::new();
    let masked = file(&[grey(), Image::mask(SIZE, packed(&mask(1, 0), 11, 1))], true);
    let bits = file(&[Image::grey(SIZE, 12, 1, packed(&[7; 66], 11, 12)).at([0.0, 0.0, 1.0, 1.0])], false);
    for bytes in [masked, bits] {
        for at in 0..bytes.len() {
            for value in [0xFF, bytes[at] ^ 1] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let _ = import_shape(&[folder.write("a.tif", &damaged)], &RasterOptions::default(), &Silent);
            }
        }
        for end in 0..bytes.len() {
            refused(&folder.write("a.tif", &bytes[..end]), &RasterOptions::default());
        }
    }
    // A list of images that leads back to itself, and one that leads nowhere.
    let sound = file(&[grey()], false);
    let next = 8 + 2 + 12 * usize::from(u16::from_le_bytes([sound[8], sound[9]]));
    for to in [8, sound.len() as u32 + 5] {
        let mut bytes = sound.clone();
        bytes[next..next + 4].copy_from_slice(&to.to_le_bytes());
        refused(&folder.write("a.tif", &bytes), &RasterOptions::default());
    }
}

#[test]
fn headers_of_envi_say_samples_and_place() {
    let folder = Folder::new();
    let header = |kind: u8, more: &str| {
        format!(
            "ENVI\ndescription = {{\nan = example}}\nsamples = 11\nlines = 6\nbands = 1\ndata type = {kind}\ninterleave = bsq\n{more}\
             map info = {{UTM, 1, 1, 1000,\n 2000, 10, 10, 32, North, WGS-84}}\n"
        )
    };
    let expected = of_file(&folder.write("a.tif", file(&[grey()], false)));
    let doubles: Vec<u8> = heights().iter().flat_map(|h| f64::from(*h).to_be_bytes()).collect();
    let shorts: Vec<u8> = [0; 5].into_iter().chain(heights().into_iter().flat_map(|h| [h, 0])).collect();
    for (name, header_name, kind, more, bytes) in [
        ("b.img", "b.hdr", 1, "", heights()),
        ("c.dat", "c.HDR", 5, "byte order = 1\n", doubles),
        ("d.raw", "d.hdr", 12, "header offset = 5\nbyte order = 0\n", shorts),
    ] {
        folder.write(header_name, header(kind, more));
        assert_eq!(of_file(&folder.write(name, bytes)), expected, "{name}");
    }
    for (more, says) in
        [("bands = 2\n", "several bands"), ("samples = 12\n", "12 x 6"), ("lines = x\n", "lines is \"x\"")]
    {
        folder.write("e.hdr", header(1, more));
        assert!(refused(&folder.write("e.img", heights()), &RasterOptions::default()).contains(says), "{says}");
    }
}
