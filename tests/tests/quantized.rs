//! Files of heights as quantized-mesh: decoded by a library that lodpack has no part in, and compared with the heights
//! that they were made from.
//!
//! The decoder comes with `npm ci` in `tests/tiles`. Where it is not there, its tests say so and pass, unless
//! `LODPACK_REQUIRE_TILES=1` is set.

use crate::commands::lodpack;
use crate::heights::Folder;
use lodpack_tests::terrain::{Fractal, Grid};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

fn tools() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/tiles")
}

/// Whether the decoder is there; says so where it is not.
fn has_decoder() -> bool {
    let has = tools().join("node_modules/@here/quantized-mesh-decoder").is_dir();
    if !has {
        let needed = "needs the decoder of quantized-mesh: npm ci --prefix tests/tiles";
        assert!(std::env::var_os("LODPACK_REQUIRE_TILES").is_none_or(|value| value != "1"), "{needed}");
        eprintln!("skipped: {needed}");
    }
    has
}

/// Exports a raster on the ellipsoid; returns what the program says of it.
fn export(folder: &Folder, raster: &Path, tolerance: &str, more: &[&str]) -> Value {
    let (file, tiles) = (folder.0.path().join("file.lodpack"), folder.0.path().join("tiles"));
    let words = ["--heights", "--surface", "wgs84", "--tolerance", tolerance, "--force", "-o"];
    lodpack().arg("build").arg(raster).args(words).arg(&file).assert().success();
    let mut command = lodpack();
    command.arg("export").arg(&file).args(["--as", "quantized-mesh", "--force", "--json", "-o"]).arg(&tiles).args(more);
    serde_json::from_slice(&command.assert().success().get_output().stdout).expect("JSON")
}

/// What the decoder finds.
fn decoded(folder: &Folder) -> Value {
    let out = Command::new("node").arg(tools().join("quantized.js")).arg(folder.0.path().join("tiles")).output();
    let out = out.expect("node runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    serde_json::from_slice(&out.stdout).expect("JSON")
}

/// The height between four areas of a grid around the globe.
fn between(heights: &[Vec<f32>], longitude: f64, latitude: f64) -> Option<f64> {
    let (rows, columns) = (heights.len() as f64, heights[0].len() as f64);
    let (x, y) = ((longitude + 180.0) / 360.0 * columns - 0.5, (90.0 - latitude) / 180.0 * rows - 0.5);
    // Beyond the first and the last row there is a pole.
    if !(0.0..=rows - 1.0).contains(&y) {
        return None;
    }
    let at = |column: f64, row: f64| {
        let row = (row as usize).min(heights.len() - 1);
        f64::from(heights[row][column.rem_euclid(columns) as usize])
    };
    let (west, north) = (x.floor(), y.floor());
    let mix = |a: f64, b: f64, share: f64| a + share * (b - a);
    let [upper, lower] = [0.0, 1.0].map(|down| mix(at(west, north + down), at(west + 1.0, north + down), x - west));
    Some(mix(upper, lower, y - north))
}

#[test]
fn a_globe_becomes_terrain_tiles_that_another_decoder_reads() {
    if !has_decoder() {
        return;
    }
    let (folder, size) = (Folder::new(), [400u32, 200]);
    let raster = folder.fractal("globe.tif", &Grid::globe(size), true, |_, _| false);
    let summary = export(&folder, &raster, "2m", &[]);
    let found = decoded(&folder);
    assert_eq!((&found["tiles"], &found["triangles"]), (&summary["tiles"], &summary["triangles"]));
    // 2 + 8 + 32 tiles, of which each has a neighbour in the east, and all but the northernmost ones have one in the
    // north.
    assert_eq!((found["tiles"].as_u64(), found["neighbours"].as_u64()), (Some(42), Some(42 + 42 - 2 - 4 - 8)));
    let fractal = Fractal::of_samples(5, size[0]);
    let row = |row: u32| {
        let mut heights = vec![0.0; size[0] as usize];
        fractal.globe_row(size, row, 0, &mut heights);
        heights
    };
    let heights: Vec<Vec<f32>> = (0..size[1]).map(row).collect();
    let mut compared = 0;
    for vertex in found["vertices"].as_array().expect("vertices") {
        let [longitude, latitude, height] = [0, 1, 2].map(|k| vertex[k].as_f64().expect("a number"));
        // Positions are rounded to 1/32,767 of a tile: some 150 m, on which slopes of the fractal rise by some metres.
        let Some(expected) = between(&heights, longitude, latitude) else { continue };
        assert!((height - expected).abs() < 2.0 + 12.0, "{vertex}: {expected}");
        compared += 1;
    }
    assert!(compared > 1000, "{compared}");
    // What is asked for ends it earlier.
    assert_eq!(export(&folder, &raster, "2m", &["--tolerance", "10km"])["levels"], 2);
    decoded(&folder);
}

#[test]
fn a_region_with_a_coast_has_tiles_where_it_lies_alone() {
    if !has_decoder() {
        return;
    }
    let folder = Folder::new();
    // Degrees 7 to 27 and 32 to 47; and across the date line.
    for first in [[1870, 430], [3500, 430]] {
        let mut grid = Grid::globe([3600, 1800]).window(first, [200, 150]);
        grid.is_point = true;
        let raster = folder.fractal("region.tif", &grid, false, |column, row| column + row < 60);
        let summary = export(&folder, &raster, "2m", &[]);
        let found = decoded(&folder);
        assert_eq!(found["tiles"], summary["tiles"]);
        // 180 / 64 / 2^5 degrees are less than a tenth.
        assert_eq!(summary["levels"], 6);
        assert!((20..60).contains(&found["tiles"].as_u64().expect("a number")), "{summary}");
        let error = summary["finest_error"].as_f64().expect("a number");
        // Where data end heights fall to 0 within a cell, by which places that are rounded by 10 m of its 11 km matter.
        assert!(error > 0.0 && error < 3.0, "{error}");
    }
}

#[test]
fn what_does_not_lie_on_the_ellipsoid_is_refused() {
    let folder = Folder::new();
    let raster = folder.fractal("flat.tif", &Grid::utm([100, 80]), false, |_, _| false);
    let (file, tiles) = (folder.0.path().join("flat.lodpack"), folder.0.path().join("tiles"));
    lodpack().arg("build").arg(&raster).args(["--heights", "-o"]).arg(&file).assert().success();
    let refused = |file: &Path, more: &[&str]| {
        let mut command = lodpack();
        command.arg("export").arg(file).args(["--as", "quantized-mesh", "-o"]).arg(&tiles).args(more);
        String::from_utf8_lossy(&command.assert().code(2).get_output().stderr).into_owned()
    };
    assert!(refused(&file, &[]).contains("--surface wgs84"));
    assert!(refused(&file, &["--local"]).contains("--local"));
    let mesh = folder.0.path().join("mesh.lodpack");
    lodpack().arg("build").arg(&raster).args(["--as", "mesh", "--tolerance", "50", "-o"]).arg(&mesh).assert().success();
    assert!(refused(&mesh, &[]).contains("holds a mesh"));
    assert!(!tiles.exists());
}
