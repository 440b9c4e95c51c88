//! Rasters of heights become the surface that they describe: formats, mosaics, planes and globes.

use crate::commands::lodpack;
use crate::open;
use glam::DVec3;
use lodpack::Query;
use lodpack::decode::ChannelImage;
use lodpack_cli::import::import_shape;
use lodpack_cli::import::raster::{HeightCode, Nodata, RasterOptions, SurfaceKind};
use lodpack_cli::mesh::{Adjacency, Mesh, NONE};
use lodpack_cli::progress::Silent;
use lodpack_tests::generate::save_ply;
use lodpack_tests::terrain::{Fractal, Grid, Vertical};
use std::path::{Path, PathBuf};

/// Reads rasters as a surface.
pub fn read(paths: &[PathBuf], options: &RasterOptions) -> Mesh {
    import_shape(paths, options, &Silent).expect("sound rasters are read")
}

/// The heights of a surface by place, in eighths of a unit.
fn by_place(mesh: &Mesh) -> std::collections::BTreeMap<[i64; 2], f64> {
    mesh.positions.iter().map(|p| ([(p.x * 8.0).round() as i64, (p.y * 8.0).round() as i64], p.z)).collect()
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/terrain").join(name)
}

/// The numbers from which all files in `tests/data/terrain` were made: 53 columns, 37 rows.
fn expected() -> Vec<f64> {
    let text = std::fs::read_to_string(data("heights.txt")).expect("it is in the repository");
    text.split_whitespace().map(|number| number.parse().expect("a number")).collect()
}

/// Fractal terrain on a plane.
fn fractal(size: [u32; 2]) -> Vec<f32> {
    let (fractal, mut all) = (Fractal::of_samples(3, size[0].max(size[1])), vec![]);
    let mut row = vec![0.0; size[0] as usize];
    for y in 0..size[1] {
        fractal.flat_row(size, y, 0, &mut row);
        all.extend_from_slice(&row);
    }
    all
}

/// Boundary edges, and edges whose two triangles turn in different directions or lie on top of each other.
fn boundary_edges(mesh: &Mesh) -> usize {
    Adjacency::new(&mesh.triangles, mesh.positions.len()).opposite.iter().filter(|&&other| other == NONE).count()
}

#[test]
fn files_of_gdal_in_every_layout_have_the_same_heights() {
    let expected = expected();
    for (name, step, most) in [
        ("float-tiled-lzw.tif", 0.0, 1e-9),
        ("float-zstd.tif", 0.0, 1e-9),
        ("big.tif", 0.0, 1e-9),
        ("double.tif", 0.0, 1e-9),
        ("overviews.tif", 0.0, 1e-9),
        ("scaled.tif", 0.0, 1e-9),
        ("int-deflate.tif", 0.0, 0.5),
        ("uint32.tif", 0.0, 0.5),
        ("byte.tif", 8.0, 8.0),
        ("lerc.tif", 0.0, 1e-9),
        ("lerc-deflate.tif", 0.0, 0.251),
        ("lerc-zstd.tif", 0.0, 1.0),
    ] {
        let mesh = read(&[data(name)], &RasterOptions::default());
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (53 * 37, 2 * 52 * 36), "{name}");
        for p in &mesh.positions {
            let (column, row) = ((p.x - 600_012.5) / 25.0, (5_099_987.5 - p.y) / 25.0);
            assert!(column.fract() == 0.0 && row.fract() == 0.0, "{name}: {p}");
            let height = expected[row as usize * 53 + column as usize];
            let found = if step > 0.0 { p.z * step } else { p.z };
            assert!((found - height).abs() <= most, "{name}: {found} instead of {height}");
        }
        let up = (0..mesh.triangles.len() as u32).all(|t| mesh.doubled_area(t).z > 0.0);
        assert!(up, "{name}: a triangle is seen from below");
    }
    // Tiles without bytes have no data, and nothing is drawn there.
    let sparse = read(&[data("sparse.tif")], &RasterOptions::default());
    assert_eq!(sparse.positions.len(), 53 * 37 - 16 * 16 - 16 * 32);
}

#[test]
fn samples_that_a_mask_of_lerc_leaves_out_have_no_data() {
    let expected = expected();
    let tiled = read(&[data("lerc-holes.tif")], &RasterOptions::default());
    assert_eq!(tiled.positions.len(), 53 * 37 - 6 * 7);
    // A blob by itself does not say where it is.
    let bounds = Some([600_000.0, 5_099_075.0, 601_325.0, 5_100_000.0]);
    let blob = read(&[data("holes.lerc")], &RasterOptions { bounds, ..RasterOptions::default() });
    assert!(blob.triangles.len() == tiled.triangles.len());
    for (mesh, most) in [(&tiled, 1e-9), (&blob, 0.001)] {
        for p in &mesh.positions {
            let [column, row] = [(p.x - 600_012.5) / 25.0, (5_099_987.5 - p.y) / 25.0].map(|at| at.round() as usize);
            assert!((p.z - expected[row * 53 + column]).abs() <= most, "{p}");
        }
    }
}

#[test]
fn a_pixel_that_is_a_point_lies_half_a_pixel_from_one_that_is_an_area() {
    let [area, point] = ["float-zstd.tif", "point.tif"].map(|name| read(&[data(name)], &RasterOptions::default()));
    // GDAL moves the corner of a file of points, so that both files show the same places.
    assert_eq!(area, point);
    let grid = Grid::utm([5, 4]);
    let dir = tempfile::tempdir().expect("a temporary directory");
    let [low, high] = [false, true].map(|is_point| {
        let path = dir.path().join(format!("{is_point}.tif"));
        std::fs::write(&path, Grid { is_point, ..grid.clone() }.bytes(&fractal([5, 4]))).expect("writable");
        read(&[path], &RasterOptions::default()).bounds()[0]
    });
    assert_eq!((low - high).truncate(), glam::DVec2::new(15.0, -15.0));
}

#[test]
fn all_formats_say_the_same_surface() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| dir.path().join(name);
    let (columns, rows) = (9, 7);
    let heights: Vec<i16> = (0..columns * rows).map(|i: i32| (i * i % 97) as i16 - 20).collect();
    let floats: Vec<f32> = heights.iter().map(|&h| h.into()).collect();
    let grid = Grid { place: Some([1000.0, 2000.0, 10.0, 10.0]), epsg: None, ..Grid::utm([9, 7]) };
    std::fs::write(at("a.tif"), grid.bytes(&floats)).expect("writable");
    let expected = read(&[at("a.tif")], &RasterOptions::default());
    let text: String =
        heights.chunks(9).map(|row| row.iter().map(|h| format!(" {h}")).collect::<String>() + "\r\n").collect();
    let head = "ncols 9\r\nnrows 7\r\nxllcorner 1000\r\nYLLCORNER 1930\r\ncellsize 10\r\nNODATA_value -9999\r\n";
    std::fs::write(at("b.asc"), format!("{head}{text}")).expect("writable");
    std::fs::write(at("no-name"), format!("{head}{}", text.replace("\r\n", " "))).expect("writable");
    let hdr = "NROWS 7\nNCOLS 9\nNBITS 16\nPIXELTYPE SIGNEDINT\nULXMAP 1005\nULYMAP 1995\nXDIM 10\nYDIM 10\n";
    for (name, order) in [("c", "M"), ("d", "I")] {
        let bytes = |h: &i16| if order == "M" { h.to_be_bytes() } else { h.to_le_bytes() };
        std::fs::write(at(&format!("{name}.bil")), heights.iter().flat_map(bytes).collect::<Vec<u8>>())
            .expect("writable");
        std::fs::write(at(&format!("{name}.hdr")), format!("{hdr}BYTEORDER {order}\n")).expect("writable");
    }
    std::fs::write(at("e.flt"), floats.iter().flat_map(|h| h.to_le_bytes()).collect::<Vec<u8>>()).expect("writable");
    std::fs::write(at("e.hdr"), format!("{head}BYTEORDER LSBFIRST\n")).expect("writable");
    for name in ["b.asc", "no-name", "c.bil", "d.bil", "e.flt"] {
        assert!(read(&[at(name)], &RasterOptions::default()) == expected, "{name}");
    }
    // A picture has no place, and nothing below 0.
    let above: Vec<u16> = heights.iter().map(|&h| (h + 20) as u16).collect();
    let picture = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(9, 7, above).expect("it has the size");
    picture.save(at("f.png")).expect("writable");
    let bounds = Some([1000.0, 1930.0, 1090.0, 2000.0]);
    let mesh = read(&[at("f.png")], &RasterOptions { bounds, ..RasterOptions::default() });
    assert!(mesh.triangles == expected.triangles);
    assert!(mesh.positions.iter().zip(&expected.positions).all(|(a, b)| *a == *b + DVec3::Z * 20.0));
    let code = image::RgbImage::from_fn(9, 7, |x, y| {
        let height = i32::from(heights[(y * 9 + x) as usize]) + 32768;
        image::Rgb([(height / 256) as u8, (height % 256) as u8, 128])
    });
    code.save(at("g.png")).expect("writable");
    let options = RasterOptions { bounds, height_code: HeightCode::Terrarium, ..RasterOptions::default() };
    let mesh = read(&[at("g.png")], &options);
    assert!(mesh.positions.iter().zip(&expected.positions).all(|(a, b)| *a == *b + DVec3::Z * 0.5));
}

#[test]
fn an_srtm_tile_is_where_its_name_says() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let heights = |first: i32| -> Vec<u8> {
        let at = move |i: i32| if i % 5000 == 17 { -32768i16 } else { (((first + i) / 7) % 3000) as i16 };
        (0..1201 * 1201).flat_map(|i| at(i).to_be_bytes()).collect()
    };
    let path = dir.path().join("S34W071.hgt");
    std::fs::write(&path, heights(0)).expect("writable");
    let mesh = read(&[path], &RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() });
    // The sample in the north-west, by `pyproj` 3.7.2: EPSG:4979 to EPSG:4978 of -71, -33, 0.
    let corner = DVec3::new(1_743_246.474454, -5_062_755.373578, -3_453_958.641178);
    let nearest = mesh.positions.iter().map(|p| p.distance(corner)).fold(f64::INFINITY, f64::min);
    assert!(nearest < 1e-3, "{nearest}");
    let voids = (0..1201 * 1201).filter(|i| i % 5000 == 17).count();
    assert_eq!(mesh.positions.len(), 1201 * 1201 - voids);
}

#[test]
fn tiles_become_the_grid_that_they_were_cut_from() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let grid = Grid::utm([37, 29]);
    let heights = fractal(grid.size);
    let write = |name: &str, first: [u32; 2], size: [u32; 2]| {
        let part: Vec<f32> = (0..size[1])
            .flat_map(|y| (0..size[0]).map(move |x| (x, y)))
            .map(|(x, y)| heights[((first[1] + y) * 37 + first[0] + x) as usize])
            .collect();
        let path = dir.path().join(name);
        std::fs::write(&path, grid.window(first, size).bytes(&part)).expect("writable");
        path
    };
    let whole = read(&[write("whole.tif", [0, 0], [37, 29])], &RasterOptions::default());
    // Tiles that continue each other, in any order, and tiles that share rows and columns.
    let apart = [
        write("d.tif", [20, 11], [17, 18]),
        write("a.tif", [0, 0], [20, 11]),
        write("c.tif", [0, 11], [20, 18]),
        write("b.tif", [20, 0], [17, 11]),
    ];
    let shared = [write("e.tif", [0, 0], [21, 29]), write("f.tif", [20, 0], [17, 29])];
    for tiles in [&apart[..], &shared[..]] {
        assert!(read(tiles, &RasterOptions::default()) == whole);
    }
    // Where a tile is missing, the surface has a hole.
    let with_gap = read(&apart[..3], &RasterOptions::default());
    // The cell at its corner keeps three of its samples.
    assert_eq!(whole.triangles.len() - with_gap.triangles.len(), 2 * 17 * 11 - 1);
    let known = by_place(&whole);
    assert!(by_place(&with_gap).iter().all(|(place, height)| known.get(place) == Some(height)));
}

#[test]
fn positions_on_the_ellipsoid_and_the_sphere_are_those_of_proj() {
    // Made with pyproj 3.7.2: EPSG:4979 to EPSG:4978, and +proj=cart +R=6371008.7714.
    let ellipsoid = [
        ([7.5, 46.95, 560.25], [4324815.085280, 569372.707581, 4638381.522877]),
        ([-122.4, 37.8, -12.5], [-2703811.962362, -4260525.913449, 3887919.503932]),
        ([180.0, -89.5, 8848.0], [-55923.479005, 0.0, -6365356.300518]),
        ([0.0, 90.0, 100.0], [0.0, 0.0, 6356852.314245]),
        ([-179.75, 0.25, 0.0], [-6378015.976485, -27829.521245, 27643.483001]),
        ([151.2, -33.85, 1234.5], [-4647553.343608, 2555014.071963, -3533328.387163]),
    ];
    let sphere = [
        ([7.5, 46.95, 560.25], [4312254.201209, 567719.035821, 4656076.738520]),
        ([151.2, -33.85, 1234.5], [-4637537.380494, 2549507.749644, -3549470.606855]),
        ([-122.4, 37.8, -12.5], [-2697392.078790, -4250409.795649, 3904828.553538]),
    ];
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    for (surface, places) in [(SurfaceKind::Wgs84, &ellipsoid[..]), (SurfaceKind::Sphere, &sphere[..])] {
        for ([longitude, latitude, height], expected) in places {
            // The sample is one of four, in the south where there is no room in the north.
            let south = if *latitude > 0.0 { 0.0 } else { 0.001 };
            let grid = Grid {
                place: Some([*longitude, latitude + south, 0.001, 0.001]),
                is_point: true,
                epsg: Some(4326),
                ..Grid::utm([2, 2])
            };
            std::fs::write(&path, grid.bytes(&[*height as f32; 4])).expect("writable");
            let mesh = read(std::slice::from_ref(&path), &RasterOptions { surface, ..RasterOptions::default() });
            let expected = DVec3::from_array(*expected);
            let off = mesh.positions.iter().map(|p| p.distance(expected)).fold(f64::INFINITY, f64::min);
            assert!(off < 1e-3, "{surface} at {longitude}, {latitude}: {off} m off");
        }
    }
}

#[test]
fn a_global_grid_is_closed_over_the_date_line_and_both_poles() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let options = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    let size = [72, 36];
    let fractal = Fractal::of_samples(5, 72);
    let globe = Grid::globe(size);
    let (areas, points) = (dir.path().join("areas.tif"), dir.path().join("points.tif"));
    let write = |path: &Path, grid: &Grid| {
        let mut out = std::fs::File::create(path).expect("writable");
        grid.write(&mut out, |row, into| {
            fractal.globe_row(size, row, 0, &mut into[..72]);
            // A grid of points has its first meridian twice, and one height at each pole.
            if into.len() > 72 {
                into[72] = into[0];
                if row == 0 || row == 36 {
                    into.fill(123.0);
                }
            }
        })
        .expect("writable");
    };
    write(&areas, &globe);
    write(&points, &Grid { size: [73, 37], is_point: true, ..globe.clone() });
    let (of_areas, of_points) = (read(&[areas], &options), read(&[points], &options));
    // Half a row before each pole, a vertex of its own closes the surface.
    assert_eq!((of_areas.positions.len(), of_areas.triangles.len()), (72 * 36 + 2, 2 * 72 * 35 + 2 * 72));
    assert_eq!((of_points.positions.len(), of_points.triangles.len()), (72 * 35 + 2, 2 * 72 * 34 + 2 * 72));
    for mesh in [&of_areas, &of_points] {
        assert_eq!(boundary_edges(mesh), 0);
        let outside = (0..mesh.triangles.len() as u32).all(|t| mesh.doubled_area(t).dot(mesh.corners(t)[0]) > 0.0);
        assert!(outside, "a triangle is seen from inside");
        // A sphere has two more vertices and triangles than edges.
        assert_eq!(mesh.positions.len() - mesh.triangles.len() / 2, 2);
    }
    // Tiles on both sides of the date line are neighbours, also where none is on the other side of the globe.
    let tile = |name: &str, first: [u32; 2], size: [u32; 2]| {
        let path = dir.path().join(name);
        let mut out = std::fs::File::create(&path).expect("writable");
        let part = globe.window(first, size);
        part.write(&mut out, |row, into| fractal.globe_row([72, 36], first[1] + row, first[0], into))
            .expect("writable");
        path
    };
    let halves = [tile("west.tif", [0, 0], [36, 36]), tile("east.tif", [36, 0], [36, 36])];
    assert_eq!(boundary_edges(&read(&halves, &options)), 0);
    let across = [tile("last.tif", [62, 10], [10, 10]), tile("first.tif", [0, 10], [10, 10])];
    let mesh = read(&across, &options);
    assert_eq!((mesh.triangles.len(), boundary_edges(&mesh)), (2 * 19 * 9, 2 * (19 + 9)));
}

/// The height of a made-up geoid at the samples of a grid of 18 x 10, 20 degrees apart, over the whole globe: multiples
/// of 8 metres.
fn undulation(column: u32, row: u32) -> f32 {
    8.0 * ((row * 7 + column % 18 * 5) % 11) as f32 - 40.0
}

/// Such a grid from some column and row on, as a `.gtx`.
pub fn gtx(first: [u32; 2], size: [u32; 2]) -> Vec<u8> {
    let [columns, rows] = size;
    let (west, south) = (-180.0 + 20.0 * f64::from(first[0]), 90.0 - 20.0 * f64::from(first[1] + rows - 1));
    let mut bytes: Vec<u8> = [south, west, 20.0, 20.0].iter().flat_map(|number| number.to_be_bytes()).collect();
    bytes.extend([rows, columns].iter().flat_map(|count| count.to_be_bytes()));
    for row in (0..rows).rev() {
        bytes.extend((0..columns).flat_map(|column| undulation(first[0] + column, first[1] + row).to_be_bytes()));
    }
    bytes
}

#[test]
fn heights_above_a_geoid_become_heights_above_the_ellipsoid() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| dir.path().join(name);
    // Samples lie at eighths of the geoid's, so that all sums are exact.
    let height = |column: u32, row: u32| ((column * 31 + row * 17) % 500) as f32;
    let above = |column: u32, row: u32| {
        let [x, y] = [column, row].map(|number| 2 * number + 1);
        let [[column, right], [row, down]] = [x, y].map(|at| [at / 8, at % 8]);
        let [right, down] = [right, down].map(|part| part as f32 / 8.0);
        let mean = |row| undulation(column, row) * (1.0 - right) + undulation(column + 1, row) * right;
        mean(row) * (1.0 - down) + mean(row + 1) * down
    };
    let grid = Grid::globe([72, 36]);
    let write = |name: &str, grid: &Grid, with: &dyn Fn(u32, u32) -> f32| {
        let mut out = std::fs::File::create(at(name)).expect("writable");
        let row = |row, into: &mut [f32]| (0..).zip(into).for_each(|(column, height)| *height = with(column, row));
        grid.write(&mut out, row).expect("writable");
        at(name)
    };
    let plain = write("plain.tif", &grid, &height);
    let added = write("added.tif", &grid, &|column, row| height(column, row) + above(column, row));
    std::fs::write(at("geoid.gtx"), gtx([0, 0], [18, 10])).expect("writable");
    let geoid_tif = Grid { size: [18, 10], place: Some([-180.0, 90.0, 20.0, 20.0]), is_point: true, ..grid.clone() };
    let geoid_tif = write("geoid.tif", &geoid_tif, &undulation);
    for surface in [SurfaceKind::Wgs84, SurfaceKind::Sphere] {
        let plainly = RasterOptions { surface, ..RasterOptions::default() };
        let expected = read(std::slice::from_ref(&added), &plainly);
        for geoid in [at("geoid.gtx"), geoid_tif.clone()] {
            let options = RasterOptions { geoid: Some(geoid), ..plainly.clone() };
            assert!(read(std::slice::from_ref(&plain), &options) == expected, "{surface}");
        }
    }
    // A part of the globe, over the date line, by a part of the geoid.
    let options = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    std::fs::write(at("part.gtx"), gtx([16, 2], [4, 4])).expect("writable");
    let window = Grid { place: Some([150.0, 30.0, 5.0, 5.0]), size: [10, 8], ..grid.clone() };
    let plain = write("part.tif", &window, &height);
    let added = write("partly.tif", &window, &|column, row| height(column, row) + above(66 + column, 12 + row));
    let with = RasterOptions { geoid: Some(at("part.gtx")), ..options.clone() };
    assert!(read(&[plain], &with) == read(&[added], &options));
    // The files of heights are those of the heights that are above the ellipsoid, too.
    let build = |input: &str, geoid: &[&str]| {
        let [input, output] = [input, "out.lodpack"].map(|name| at(name).to_string_lossy().into_owned());
        let fixed = ["build", &input, "--heights", "--surface", "wgs84", "--tolerance", "1m", "-o", &output, "--force"];
        lodpack().args(fixed).args(geoid).assert().success();
        std::fs::read(&output).expect("it was built")
    };
    let geoid = at("geoid.gtx").to_string_lossy().into_owned();
    assert!(build("plain.tif", &["--geoid", &geoid]) == build("added.tif", &[]));
}

#[test]
fn degrees_become_metres_on_a_plane_and_large_grids_of_degrees_are_refused() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    let grid = |size: [u32; 2], spacing: f64| Grid {
        place: Some([8.0, 47.0, spacing, spacing]),
        is_point: true,
        epsg: Some(4326),
        ..Grid::utm(size)
    };
    std::fs::write(&path, grid([11, 11], 0.01).bytes(&[100.0; 121])).expect("writable");
    let [low, high] = read(std::slice::from_ref(&path), &RasterOptions::default()).bounds();
    // By pyproj 3.7.2, Geod(ellps="WGS84"): along 46.95 north, and along a meridian from 46.9 to 47.
    assert!((high.x - low.x - 7612.692).abs() < 1e-2 && (high.y - low.y - 11116.987).abs() < 1e-2, "{low} {high}");
    assert!((low.x + high.x).abs() < 1e-6 && low.z == 100.0);
    std::fs::write(&path, grid([40, 40], 1.0).bytes(&[0.0; 1600])).expect("writable");
    let error = import_shape(&[path], &RasterOptions::default(), &Silent).expect_err("no plane shows it").to_string();
    assert!(error.contains("--surface wgs84") && error.contains("a.tif"), "{error}");
}

#[test]
fn the_shorter_diagonal_divides_a_cell() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    for heights in [[9.0, 0.0, 3.0, 8.0], [0.0, 9.0, 8.0, 3.0]] {
        std::fs::write(&path, Grid::utm([2, 2]).bytes(&heights)).expect("writable");
        let mesh = read(std::slice::from_ref(&path), &RasterOptions::default());
        // Both triangles have the ends of the diagonal; a ridge stays a ridge.
        let highs = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize].z).iter().sum::<f64>());
        assert_eq!(highs.sum::<f64>(), 2.0 * (9.0 + 8.0) + 3.0, "{heights:?}");
    }
}

#[test]
fn units_come_from_the_file_and_from_what_is_typed() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    std::fs::write(&path, Grid::utm([3, 3]).bytes(&[1000.0; 9])).expect("writable");
    let feet = RasterOptions { vertical_unit: "ft".parse().ok(), ..RasterOptions::default() };
    assert_eq!(read(std::slice::from_ref(&path), &feet).bounds()[0].z, 1000.0 * 0.3048);
    let moved = RasterOptions { origin: Some([500_000.0, 5_199_000.0, 400.0]), ..RasterOptions::default() };
    assert_eq!(read(&[path], &moved).bounds()[1], DVec3::new(75.0, 985.0, 600.0));
}

/// Runs the program in a folder; words are separated by spaces.
fn run(folder: &Path, words: &str) {
    lodpack().current_dir(folder).args(words.split_whitespace()).assert().success();
}

#[test]
fn a_built_terrain_keeps_its_place_and_its_heights_within_the_tolerance() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("a.tif");
    let grid = Grid { nodata: Some(-1.0), ..Grid::utm([150, 130]) };
    let mut samples = fractal(grid.size);
    (0..20).for_each(|y| samples[(40 + y) * 150 + 60..][..25].fill(-1.0));
    std::fs::write(&path, grid.bytes(&samples)).expect("writable");
    run(dir.path(), "build a.tif --as mesh --tolerance 5m");
    let bytes = std::fs::read(dir.path().join("a.lodpack")).expect("written");
    let file = open(&bytes);
    let placement = file.placement().expect("it has a place");
    assert_eq!((placement.crs.as_str(), placement.unit, placement.origin), ("EPSG:32632", Some(1.0), [0.0; 3]));
    run(dir.path(), "verify a.lodpack --against a.tif --cuts 20");
    // A foreign judge: a point within the error of the input is above it by no more than that and what the steepest
    // slope adds.
    let input = read(&[path], &RasterOptions::default());
    let drawn = file.extract(&file.select(&Query::default()).expect("selectable")).expect("decodable");
    let vertical = Vertical::between(&drawn.positions, &drawn.triangles, &input);
    // Samples on the border may lie a step of the lattice outside.
    assert!(vertical.missing <= 2 * (150 + 130) + 2 * (20 + 25) + 8, "{vertical:?}");
    assert!(vertical.largest > 0.5 && vertical.largest <= 5.0 * (1.0 + vertical.steepest), "{vertical:?}");
}

#[test]
fn every_way_of_building_terrain_gives_the_same_bytes() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let at = |name: &str| dir.path().join(name);
    let grid = Grid::globe([160, 80]);
    let fractal = Fractal::of_samples(2, 160);
    for (name, first) in [("w.tif", 0), ("e.tif", 80)] {
        let mut out = std::fs::File::create(at(name)).expect("writable");
        let half = grid.window([first, 0], [80, 80]);
        half.write(&mut out, |row, into| fractal.globe_row([160, 80], row, first, into)).expect("writable");
    }
    let options = "--as mesh --surface wgs84 --ramp earth --region-triangles 8000";
    run(dir.path(), &format!("build w.tif e.tif -o one.lodpack --threads 1 {options}"));
    run(dir.path(), &format!("build e.tif w.tif -o small.lodpack --memory 64MiB {options}"));
    run(dir.path(), &format!("plan w.tif e.tif -o job --parts 3 {options}"));
    (0..3).for_each(|part| run(dir.path(), &format!("build --job job --part {part}")));
    run(dir.path(), "merge job -o merged.lodpack");
    let one = std::fs::read(at("one.lodpack")).expect("written");
    assert!(one == std::fs::read(at("merged.lodpack")).expect("written"), "parts differ");
    assert!(
        one == std::fs::read(at("small.lodpack")).expect("written"),
        "files in another order, and little memory, differ"
    );
    let placement = open(&one).placement().cloned().expect("it has a place");
    assert_eq!((placement.crs.as_str(), placement.unit), ("EPSG:4978", Some(1.0)));
    // What the file says of its place is enough to read its input again.
    run(dir.path(), "verify one.lodpack --against w.tif e.tif --cuts 5");
}

#[test]
fn a_ramp_and_a_drape_become_colours() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let grid = Grid::utm([60, 60]);
    let samples: Vec<f32> = (0..3600).map(|i| 1000.0 + 300.0 * ((i % 60) as f32 / 8.0).sin()).collect();
    std::fs::write(dir.path().join("a.tif"), grid.bytes(&samples)).expect("writable");
    let picture =
        image::RgbImage::from_fn(60, 60, |_, y| image::Rgb(if y < 30 { [250, 10, 10] } else { [10, 20, 240] }));
    picture.save(dir.path().join("drape.png")).expect("writable");
    run(dir.path(), "build a.tif --as mesh -o drape.lodpack --drape drape.png");
    run(dir.path(), "build a.tif --as mesh -o ramp.lodpack --ramp viridis");
    for name in ["drape.lodpack", "ramp.lodpack"] {
        let bytes = std::fs::read(dir.path().join(name)).expect("written");
        let file = open(&bytes);
        let cut = file.select(&Query { tolerance: Some(0.0), ..Query::default() }).expect("selectable");
        let shown = file.extract_textured(&cut, &[0]).expect("decodable");
        let mut seen = 0;
        for (number, (corners, places)) in shown.mesh.triangles.iter().zip(&shown.places).enumerate() {
            let mean = |of: &dyn Fn(usize) -> f64| (0..3).map(of).sum::<f64>() / 3.0;
            let point = [0, 1, 2].map(|axis| mean(&|k| shown.mesh.positions[corners[k] as usize][axis]));
            let place = [0, 1].map(|axis| mean(&|k| f64::from(places[k][axis])));
            let texture = &shown.textures[shown.mesh.triangle_nodes[number] as usize];
            let [Some(ChannelImage::Colours(colours))] = &texture.images[..] else { panic!("a node has no colours") };
            let [red, _, blue] = [0, 1, 2].map(|k| colours.interpolated(place)[k]);
            let from_middle = point[1] - (5_200_000.0 - 900.0);
            if name == "drape.lodpack" && from_middle.abs() > 150.0 {
                assert!((red > blue) == (from_middle > 0.0), "{point:?}: {red} {blue}");
                seen += 1;
            }
            if name == "ramp.lodpack" && (point[2] - 1000.0).abs() > 200.0 {
                // Yellow above, violet below.
                assert!((red > blue) == (point[2] > 1000.0), "{point:?}: {red} {blue}");
                seen += 1;
            }
        }
        assert!(seen > 10, "{name}: {seen} triangles");
    }
}

#[test]
fn nodata_may_be_a_height_if_somebody_says_so() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("sea.tif");
    let grid = Grid { nodata: Some(0.0), ..Grid::utm([6, 6]) };
    let heights: Vec<f32> = (0..36).map(|i| if i % 6 < 3 { 0.0 } else { i as f32 }).collect();
    std::fs::write(&path, grid.bytes(&heights)).expect("writable");
    let count = |nodata| {
        read(std::slice::from_ref(&path), &RasterOptions { nodata, ..RasterOptions::default() }).positions.len()
    };
    assert_eq!([count(None), count(Some(Nodata::None)), count(Some(Nodata::Value(35.0)))], [18, 36, 35]);
}

#[test]
fn a_group_with_a_long_straight_border_begins_with_a_corner() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    // Samples alone are enough for the shape of these borders; builders of earlier days wrote no file then.
    for (size, tolerance) in [([100, 100], "auto"), ([130, 150], "0.1edge")] {
        let heights = fractal(size);
        let at = |x: u32, y: u32| y * size[0] + x;
        let places = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| (x, y)));
        let vertex = |(x, y)| DVec3::new(f64::from(x) * 30.0, f64::from(y) * -30.0, heights[at(x, y) as usize].into());
        let positions = places.clone().map(vertex).collect();
        let cells = places.filter(|&(x, y)| x + 1 < size[0] && y + 1 < size[1]);
        let triangles = cells.flat_map(|(x, y)| {
            let [nw, ne, sw, se] = [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1)];
            [[nw, sw, se], [nw, se, ne]]
        });
        save_ply(&Mesh { positions, triangles: triangles.collect() }, &dir.path().join("a.ply")).expect("writable");
        run(dir.path(), &format!("build a.ply --force --tolerance {tolerance}"));
    }
}
