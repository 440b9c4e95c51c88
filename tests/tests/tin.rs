//! Triangulations of windows of heights (`extract --tin`): within their tolerance, without cracks, and of few
//! triangles.

use crate::commands::lodpack;
use crate::heights::{Folder, built};
use lodpack::Limits;
use lodpack::heights::{Heights, HeightsQuery};
use lodpack_cli::heights::{Tin, triangulate};
use lodpack_cli::import::raster::{RasterOptions, SurfaceKind};
use lodpack_cli::mesh::tolerance::Tolerance;
use lodpack_cli::progress::Silent;
use lodpack_tests::terrain::Grid;
use std::collections::HashMap;

type File = Heights<Vec<u8>>;

/// Twice the area of a triangle of samples, counter-clockwise seen from above, where rows go to the south.
fn doubled([a, b, c]: [[i64; 2]; 3]) -> i64 {
    (b[1] - a[1]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[1] - a[1])
}

/// Compares a triangulation of a plane with all samples of a file, by their weights in each triangle.
fn check(file: &File, tin: &Tin, tolerance: f64) {
    let [columns, rows] = file.grid().samples();
    let heights = file.window(0..columns, 0..rows).expect("readable");
    let height = |[column, row]: [i64; 2]| heights[row as usize * columns as usize + column as usize];
    let mut most = 0.0f64;
    let mut area = 0;
    let mut edges = HashMap::<[u32; 2], i32>::new();
    for triangle in &tin.triangles {
        let corners = triangle.map(|vertex| tin.samples[vertex as usize].map(|line| line as i64));
        let whole = doubled(corners);
        assert!(whole > 0, "{corners:?}");
        area += whole;
        let ends = |axis: usize| {
            let all = corners.map(|corner| corner[axis]);
            all.into_iter().min().unwrap_or(0)..=all.into_iter().max().unwrap_or(0)
        };
        for row in ends(1) {
            for column in ends(0) {
                let [a, b, c] = corners;
                let p = [column, row];
                let weights = [[p, b, c], [a, p, c], [a, b, p]].map(doubled);
                if weights.iter().all(|&weight| weight >= 0) {
                    let drawn: f64 =
                        weights.iter().zip(corners).map(|(&w, corner)| w as f64 * height(corner)).sum::<f64>()
                            / whole as f64;
                    assert!(!height(p).is_nan(), "{p:?} has no data");
                    most = most.max((drawn - height(p)).abs());
                }
            }
        }
        for k in 0..3 {
            *edges.entry([triangle[k], triangle[(k + 1) % 3]]).or_default() += 1;
        }
    }
    let is_cell = |column: usize, row: usize| {
        [[0, 0], [1, 0], [0, 1], [1, 1]].iter().all(|[x, y]| !height([(column + x) as i64, (row + y) as i64]).is_nan())
    };
    let cells = (0..rows as usize - 1).flat_map(|row| (0..columns as usize - 1).map(move |column| (column, row)));
    assert_eq!(area, 2 * cells.filter(|&(column, row)| is_cell(column, row)).count() as i64);
    for (&[a, b], &count) in &edges {
        assert_eq!(count, 1);
        if edges.contains_key(&[b, a]) {
            continue;
        }
        // Where the surface ends there is the border of the grid, or data ends.
        let ends = [a, b].map(|vertex| tin.samples[vertex as usize]);
        let is_border = [columns, rows].iter().zip(0..).any(|(&count, axis)| {
            ends.iter().all(|end| end[axis] == 0) || ends.iter().all(|end| end[axis] == count - 1)
        });
        assert!(is_border || (0..2).map(|axis| ends[0][axis].abs_diff(ends[1][axis])).sum::<u64>() == 1);
    }
    let sample_error = file.info().sample_error;
    assert!(most + sample_error <= tin.error * (1.0 + 1e-9) && tin.error <= tolerance * (1.0 + 1e-9));
    assert!(tin.error <= (most + sample_error) * (1.0 + 1e-9), "the error that is stated is larger than the true one");
}

fn open(bytes: Vec<u8>) -> File {
    Heights::open(bytes, Limits::default()).expect("it was just written")
}

#[test]
fn every_sample_is_within_the_tolerance_and_every_cell_is_covered_once() {
    let folder = Folder::new();
    // The last one is divided into blocks.
    for (number, size) in [[2, 2], [65, 3], [301, 200], [2100, 90]].into_iter().enumerate() {
        for has_voids in [false, true] {
            let is_void = |column: u32, row: u32| {
                let [x, y] = [f64::from(column) - f64::from(size[0]) * 0.48, f64::from(row) - 40.0];
                has_voids && size[0] > 2 && (x.hypot(y) < 30.0 || (column * 7 + row * 13).is_multiple_of(97))
            };
            let path = folder.fractal(&format!("{number}-{has_voids}.tif"), &Grid::utm(size), false, is_void);
            let file = open(built(&path, &RasterOptions::default(), Tolerance::InputUnits(0.25), 1 << 30).0);
            let mut before = usize::MAX;
            for tolerance in [0.25, 1.0, 20.0, 500.0] {
                let tin = triangulate(&file, None, tolerance, &Silent).expect("within what the file has");
                check(&file, &tin, tolerance);
                assert!(tin.triangles.len() <= before);
                before = tin.triangles.len();
            }
        }
    }
}

#[test]
fn globes_are_closed() {
    let folder = Folder::new();
    let path = folder.fractal("globe.tif", &Grid::globe([256, 129]), true, |_, _| false);
    let on_globe = RasterOptions { surface: SurfaceKind::Wgs84, ..RasterOptions::default() };
    let file = open(built(&path, &on_globe, Tolerance::Metres(5.0), 1 << 30).0);
    for tolerance in [200.0, 3000.0, 50_000.0] {
        let tin = triangulate(&file, None, tolerance, &Silent).expect("within what the file has");
        assert!(tin.error <= tolerance && tin.triangles.len() > 100);
        let mut edges = HashMap::<[u32; 2], i32>::new();
        for triangle in &tin.triangles {
            (0..3).for_each(|k| *edges.entry([triangle[k], triangle[(k + 1) % 3]]).or_default() += 1);
        }
        // Around a pole two edges may be one line.
        assert!(edges.iter().all(|([a, b], &count)| edges.get(&[*b, *a]) == Some(&count)));
        // A closed surface without handles.
        assert_eq!(tin.positions.len() - tin.triangles.len() / 2, 2);
    }
}

#[test]
fn triangulations_take_fewer_triangles_than_tiles() {
    let folder = Folder::new();
    let path = folder.fractal("a.tif", &Grid::utm([513, 513]), false, |_, _| false);
    let file = open(built(&path, &RasterOptions::default(), Tolerance::InputUnits(0.25), 1 << 30).0);
    for tolerance in [40.0, 150.0] {
        let cut = file.cut(&HeightsQuery { tolerance: Some(tolerance), ..HeightsQuery::default() }).expect("readable");
        let tin = triangulate(&file, None, tolerance, &Silent).expect("within what the file has");
        assert!(2 * tin.triangles.len() < cut.triangle_count as usize);
    }
}

#[test]
fn the_program_writes_triangulations_of_windows_and_refuses_what_it_cannot_reach() {
    let folder = Folder::new();
    let path = folder.fractal("a.tif", &Grid::utm([200, 150]), false, |_, _| false);
    let (bytes, _) = built(&path, &RasterOptions::default(), Tolerance::InputUnits(0.5), 1 << 30);
    let at = folder.0.path();
    let file = open(bytes.clone());
    let low = file.surface().first;
    std::fs::write(at.join("a.lodpack"), bytes).expect("writable");
    let bbox = format!("{},{},0,{},{},0", low[0] + 100.0, low[1] - 3000.0, low[0] + 2000.0, low[1] - 500.0);
    for output in ["a.ply", "a.obj", "a.stl", "a.glb"] {
        let args = ["extract", "a.lodpack", "-o", output, "--tin", "--tolerance", "20", "--bbox", &bbox];
        lodpack().current_dir(at).args(args).assert().success();
        assert!(std::fs::metadata(at.join(output)).is_ok_and(|file| file.len() > 500));
    }
    let fails = |args: &[&str], why: &str| {
        let ran = lodpack().current_dir(at).args(["extract", "-o", "b.ply", "--tin"]).args(args).assert().failure();
        let said = String::from_utf8_lossy(&ran.get_output().stderr).into_owned();
        assert!(said.contains(why), "{said}");
    };
    fails(&["a.lodpack"], "--tolerance");
    fails(&["a.lodpack", "--tolerance", "0.1"], "build the file with a smaller --tolerance");
    fails(&["a.lodpack", "--tolerance", "9", "--bbox", "0,0,0,1,1,1"], "the grid reaches");
}
