//! Coarse levels of open surfaces: sheets with turned, ragged and holed borders, and closed and scattered ones beside
//! them.

use crate::open;
use glam::DVec3;
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::verify::inspect_edges;
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::ModelOptions;
use lodpack_cli::progress::Silent;
use lodpack_tests::generate::{punched_sheet, rough_sphere, save_ply};
use lodpack_tests::parts::pipes;

/// Cells along a side of a sheet.
const CELLS: u32 = 100;

/// A sheet of gentle hills, as far as `is_inside` says of the middles of cells, from -1 to 1 both ways.
fn hills(is_inside: impl Fn(f64, f64) -> bool) -> Mesh {
    let along = |k: u32| 2.0 * f64::from(k) / f64::from(CELLS) - 1.0;
    let mut mesh = Mesh::default();
    let mut numbers = vec![u32::MAX; ((CELLS + 1) * (CELLS + 1)) as usize];
    for (column, row) in (0..CELLS * CELLS).map(|cell| (cell % CELLS, cell / CELLS)) {
        let half = 1.0 / f64::from(CELLS);
        if !is_inside(along(column) + half, along(row) + half) {
            continue;
        }
        let mut vertex = |column: u32, row: u32| {
            let number = &mut numbers[(row * (CELLS + 1) + column) as usize];
            if *number == u32::MAX {
                *number = mesh.positions.len() as u32;
                let (x, y) = (along(column), along(row));
                let height = 0.03 * (5.0 * x).sin() * (4.0 * y).cos() + 0.004 * (31.0 * x + 17.0 * y).sin();
                mesh.positions.push(DVec3::new(x, y, height));
            }
            *number
        };
        let [a, b, c, d] = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[x, y]| vertex(column + x, row + y));
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// A rectangle that is turned by two degrees, so that its borders are staircases.
fn turned() -> Mesh {
    let (sine, cosine) = 0.035_f64.sin_cos();
    hills(|x, y| (x * cosine + y * sine).abs() < 0.9 && (y * cosine - x * sine).abs() < 0.8)
}

/// Rays of different lengths, and holes.
fn torn() -> Mesh {
    hills(|x, y| {
        let reach = 0.75 + 0.2 * (3.0 * y.atan2(x)).sin() + 0.04 * (37.0 * y.atan2(x)).sin();
        let is_hole = |[at_x, at_y, size]: [f64; 3]| (x - at_x).hypot(y - at_y) < size;
        x.hypot(y) < reach && ![[0.2, 0.3, 0.12], [-0.3, 0.1, 0.05], [-0.1, -0.4, 0.02]].into_iter().any(is_hole)
    })
}

/// A file with several charts, and so with groups.
fn built(mesh: &Mesh) -> Vec<u8> {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    save_ply(mesh, &path).expect("a writable temporary directory");
    let model = ModelOptions { chart_triangles: Some(1024), ..ModelOptions::default() };
    let mut bytes = vec![];
    let options = BuildOptions { inputs: vec![path], model, ..BuildOptions::default() };
    build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
    bytes
}

#[test]
fn the_top_of_a_turned_sheet_keeps_its_corners_and_does_not_fold() {
    let bytes = built(&turned());
    let file = open(&bytes);
    let top = file.uniform_cut(0).expect("a level");
    let drawn = file.extract(&top).expect("decodable");
    assert!(drawn.triangles.len() < 500, "{}", drawn.triangles.len());
    assert!(top.error < 0.1, "{}", top.error);
    let (sine, cosine) = 0.035_f64.sin_cos();
    for [x, y] in [[0.9, 0.8], [-0.9, 0.8], [-0.9, -0.8], [0.9, -0.8]] {
        let corner = [x * cosine - y * sine, x * sine + y * cosine];
        let nearest = drawn.positions.iter().map(|p| (p[0] - corner[0]).hypot(p[1] - corner[1])).fold(2.0, f64::min);
        assert!(nearest < 0.06, "{nearest} from the corner at {corner:?}");
    }
    // Slivers may turn over where vertices are rounded.
    let (mut front, mut back) = (0.0, 0.0);
    for corners in &drawn.triangles {
        let [a, b, c] = corners.map(|v| DVec3::from_array(drawn.positions[v as usize]));
        let area = 0.5 * (b - a).cross(c - a).z;
        *(if area > 0.0 { &mut front } else { &mut back }) += area.abs();
    }
    assert!(back < 0.01 * front && (front - back - 1.8 * 1.6).abs() < 0.15, "{back} of {front} lies on its back");
}

#[test]
fn holes_and_rays_stay_open_at_all_levels() {
    let bytes = built(&torn());
    let file = open(&bytes);
    for level in 0..file.level_count() as u8 {
        let cut = file.uniform_cut(level).expect("a level");
        let drawn = file.extract(&cut).expect("decodable");
        // Closed, a sheet would have two sides.
        assert!(!inspect_edges(&drawn.triangles).boundary.is_empty(), "{level}");
        assert!(cut.error < 0.2, "{level}: {}", cut.error);
    }
}

#[test]
fn errors_of_levels_fall_strictly() {
    let all = [
        ("turned", turned()),
        ("torn", torn()),
        ("flat", Mesh { positions: turned().positions.iter().map(|p| p.with_z(0.0)).collect(), ..turned() }),
        ("punched", punched_sheet(64)),
        ("closed", rough_sphere(40)),
        ("parts", pipes(60)),
    ];
    for (name, mesh) in all {
        let bytes = built(&mesh);
        let levels = open(&bytes).summary().expect("a sound file").levels;
        let errors: Vec<f64> =
            levels.iter().filter(|level| level.block_count > 0).map(|level| level.max_error).collect();
        assert!(errors.windows(2).all(|pair| pair[0] > pair[1]), "{name}: {errors:?}");
    }
}
