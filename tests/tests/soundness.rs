//! Certified errors hold, cuts are watertight, and budgets are kept.

use crate::{build_file, build_mesh, open, scan};
use glam::DVec3;
use lodpack::{Outside, Query, index::Filling};
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::verify::{VerifyOptions, inspect_edges, verify};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::{Fillings, ModelOptions};
use lodpack_cli::progress::Silent;
use lodpack_cli::stage::repair::repair;
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, torus};

/// Verifies a built mesh against itself, with many random cuts.
fn assert_sound(mesh: &Mesh, bytes: &[u8], cuts: u32) {
    let report = verify(&open(bytes), Some(mesh), &VerifyOptions { cuts, seed: 7 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
    for level in &report.levels {
        // No largest distance is smaller than a mean one, of groups either. Far below the bound none is resolved.
        assert!(level.measured + 0.02 * level.stored >= level.vertex_rms, "{level:?}");
    }
    let ratio = report.levels.last().expect("errors were compared").ratio_median;
    assert!(ratio < 1.3, "median of stored over measured error at the finest level is {ratio}");
    // A top's error is a sum of two bounds, and small models have few other nodes.
    let ratio = report.ratio_median.expect("errors were compared");
    assert!(ratio < 1.7, "median of stored over measured error is {ratio}");
}

#[test]
fn stored_errors_bound_true_distances_on_generated_meshes() {
    for mesh in [bumpy_sphere(48), torus(128), punched_sheet(96), fan_part(32)] {
        let (bytes, summary) = build_mesh(&mesh, "auto");
        assert!(summary.certified_error <= summary.tolerance);
        assert_sound(&mesh, &bytes, 100);
    }
}

#[test]
fn stored_errors_bound_true_distances_on_a_real_scan() {
    let (bytes, summary) = build_file(&scan(), "auto");
    assert!(summary.certified_error <= summary.tolerance);
    let (mesh, ..) =
        repair(lodpack_cli::import::import_meshes(&[scan()], &Silent).expect("the scan in the repository is readable"));
    assert_sound(&mesh, &bytes, 200);
}

#[test]
fn closed_meshes_stay_closed_at_every_level() {
    for mesh in [bumpy_sphere(40), torus(96), fan_part(24)] {
        let (bytes, summary) = build_mesh(&mesh, "auto");
        let file = open(&bytes);
        for level in 0..summary.levels.len() as u8 {
            let drawn = file.extract(&file.uniform_cut(level).expect("a level")).expect("decodable");
            let edges = inspect_edges(&drawn.triangles);
            assert_eq!((edges.boundary.len(), edges.repeated, edges.degenerate), (0, 0, 0), "level {level}");
        }
    }
}

#[test]
fn finest_cuts_have_no_flat_triangle_and_no_edge_of_four() {
    // Specks smaller than a lattice step, as scans have them beside their surface, open and closed.
    let mut specks = bumpy_sphere(40);
    for k in 0..12 {
        let at = DVec3::new(1.5 + f64::from(k), 0.3, -0.7) * 0.2;
        let first = specks.positions.len() as u32;
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let count = if k % 2 == 0 { 3 } else { 4 };
        specks.positions.extend(corners.iter().take(count).map(|&corner| at + corner * 1e-7 * f64::from(k + 1)));
        let sides = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        let sides = sides.iter().take(if count == 3 { 1 } else { 4 });
        specks.triangles.extend(sides.map(|side| side.map(|corner| first + corner)));
    }
    for (name, (bytes, summary)) in [("specks", build_mesh(&specks, "auto")), ("scan", build_file(&scan(), "auto"))] {
        assert!(summary.certified_error <= summary.tolerance, "{name}");
        let file = open(&bytes);
        let finest = file.uniform_cut(file.level_count() as u8 - 1).expect("a level");
        let drawn = file.extract(&finest).expect("decodable");
        let edges = inspect_edges(&drawn.triangles);
        assert_eq!((edges.crowded, edges.degenerate), (0, 0), "{name}");
        let is_flat = |corners: &&[u32; 3]| {
            let [a, b, c] = corners.map(|v| DVec3::from_array(drawn.positions[v as usize]));
            (b - a).cross(c - a) == DVec3::ZERO
        };
        assert_eq!(drawn.triangles.iter().filter(is_flat).count(), 0, "{name}");
    }
}

#[test]
fn a_mesh_with_holes_keeps_exactly_its_own_boundary() {
    let mesh = punched_sheet(96);
    let loops = boundary_loops(&mesh.triangles);
    let (bytes, summary) = build_mesh(&mesh, "auto");
    let file = open(&bytes);
    for level in 0..summary.levels.len() as u8 {
        let drawn = file.extract(&file.uniform_cut(level).expect("a level")).expect("decodable");
        assert_eq!(boundary_loops(&drawn.triangles), loops, "level {level}");
    }
}

/// Number of closed chains of boundary edges.
fn boundary_loops(triangles: &[[u32; 3]]) -> usize {
    let mut next: std::collections::BTreeMap<u32, u32> =
        inspect_edges(triangles).boundary.iter().map(|&[a, b]| (a, b)).collect();
    let mut loops = 0;
    while let Some((start, mut at)) = next.pop_first() {
        while at != start {
            at = next.remove(&at).expect("boundary edges form closed chains");
        }
        loops += 1;
    }
    loops
}

#[test]
fn triangle_budgets_are_met_and_used() {
    let (bytes, summary) = build_mesh(&bumpy_sphere(64), "auto");
    let file = open(&bytes);
    let (coarsest, finest) = (summary.levels[0].triangles, summary.levels.last().expect("a level").triangles);
    let mut last_error = f64::INFINITY;
    for step in 0..20 {
        let budget = coarsest + (finest - coarsest) * step / 19;
        let cut = file
            .select(&Query { max_triangles: Some(budget), ..Query::default() })
            .expect("the coarsest cut is affordable");
        assert!(cut.triangle_count <= budget);
        assert!(cut.error <= last_error, "{budget} triangles give {}, fewer gave {last_error}", cut.error);
        last_error = cut.error;
        assert_eq!(file.extract(&cut).expect("decodable").triangles.len() as u64, cut.triangle_count);
    }
    assert!(file.select(&Query { max_triangles: Some(coarsest - 1), ..Query::default() }).is_err());
}

#[test]
fn a_box_reads_only_roots_that_touch_it() {
    let (bytes, _) = build_file(&scan(), "auto");
    let file = open(&bytes);
    let [low, high] = file.bounds().expect("not empty");
    let third = [0, 1, 2].map(|k| low[k] + (high[k] - low[k]) / 3.0);
    let cut = file
        .select(&Query { volume: Some([low, third].into()), outside: Outside::Drop, ..Query::default() })
        .expect("the box holds something");
    let finest = file.uniform_cut(file.level_count() as u8 - 1).expect("a level");
    assert!(cut.nodes.len() < finest.nodes.len());
    let mesh = file.extract(&cut).expect("decodable");
    assert_eq!(inspect_edges(&mesh.triangles).boundary.len() as u64, file.boundary_edge_count(&cut).expect("readable"));
}

#[test]
fn detail_far_from_the_origin_is_kept() {
    let mut mesh = bumpy_sphere(24);
    for p in &mut mesh.positions {
        *p = *p * 0.05 + glam::DVec3::new(5e6, -3e6, 4e6);
    }
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.certified_error < 0.005);
    assert_sound(&mesh, &bytes, 20);
}

#[test]
fn grids_and_irregular_fillings_meet_without_cracks_at_any_levels() {
    let mesh = bumpy_sphere(64);
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    lodpack_tests::generate::save_ply(&mesh, &path).expect("a writable temporary directory");
    let built = |fillings| {
        let chart_triangles = Some(8192);
        let model = ModelOptions { fillings, chart_triangles, ..ModelOptions::default() };
        let options = BuildOptions { inputs: vec![path.clone()], model, ..BuildOptions::default() };
        let mut bytes = vec![];
        let summary = build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
        (bytes, summary)
    };
    let (bytes, summary) = built(Fillings::GridWherePossible);
    assert!(summary.roots.of(Filling::Grid) > 0, "no grid among {} roots", summary.charts);
    assert!(summary.certified_error <= summary.tolerance);
    assert_sound(&mesh, &bytes, 100);

    // Any level for any root, so that neighbours may be far apart in level.
    let file = open(&bytes);
    let mut state = 1_u64;
    for _ in 0..50 {
        let mut cut = file.uniform_cut(0).expect("a level");
        for node in &mut cut.nodes {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            node.level = ((state >> 33) % summary.levels.len() as u64) as u8;
        }
        let edges = inspect_edges(&file.extract(&cut).expect("decodable").triangles);
        assert_eq!((edges.boundary.len(), edges.repeated, edges.degenerate), (0, 0, 0));
    }
    assert_eq!(built(Fillings::IrregularOnly).1.roots.of(Filling::Grid), 0);
}

#[test]
fn an_error_stored_too_low_is_found_at_its_level() {
    // The file is right about one surface, but the input it is compared with has a dent of twice the certified error.
    let mesh = bumpy_sphere(32);
    let (bytes, summary) = build_mesh(&mesh, "auto");
    let levels = summary.levels.len();
    let depth = 2.0 * summary.certified_error;
    let mut dented = mesh.clone();
    let height = dented.positions[500].length();
    dented.positions[500] *= 1.0 - depth / height;
    let options = VerifyOptions { cuts: 0, seed: 1 };
    let report = verify(&open(&bytes), Some(&dented), &options, &Silent).expect("readable");
    let finest = format!("level {}", levels - 1);
    assert!(report.problems.iter().any(|problem| problem.location.starts_with(&finest)), "{:?}", report.problems);
}
