//! The ends of the range: few triangles for any surface, the finest level alone, and parts that must not vanish.

use crate::{build_file, build_mesh, open, scan};
use glam::DVec3;
use lodpack::Query;
use lodpack_cli::import::import_meshes;
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::verify::distance::{BoxTree, Goal, largest_distance};
use lodpack_cli::measure::verify::{VerifyOptions, inspect_edges, verify};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::{LevelChoice, ModelOptions};
use lodpack_cli::progress::Silent;
use lodpack_cli::reduce::{Topology, cut_to_finish, finish};
use lodpack_tests::generate::{rough_sphere, save_ply, torus};
use lodpack_tests::parts::{add_box, pipes, sponge};

/// A distance that occurs between two meshes, near the largest one.
fn largest(a: &Mesh, b: &Mesh) -> f64 {
    let [tree_a, tree_b] = [a, b].map(|mesh| BoxTree::new(&mesh.positions, &mesh.triangles));
    let goal = Goal { floor: 0.0, claim: 0.0, ..Goal::default() };
    let forward = largest_distance(&a.positions, &a.triangles, &tree_b, &goal);
    forward.lower.max(largest_distance(&b.positions, &b.triangles, &tree_a, &goal).lower)
}

/// Beams of a square cross-section, one unit apart.
fn beams(count: u32, side: f64, length: f64) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..count {
        let low = DVec3::new(f64::from(i % 30), f64::from(i / 30), f64::from(i % 7));
        add_box(&mut mesh, low, DVec3::new(side, side, length));
    }
    mesh
}

/// A sheet in waves. If it has a needle, that is a hundred times as high as it is thick, on one triangle.
fn waves(has_needle: bool) -> Mesh {
    let n = 140;
    let mut mesh = Mesh::default();
    for (i, j) in (0..n * n).map(|v| (f64::from(v % n), f64::from(v / n))) {
        let height = 4.0 * (0.11 * i).sin() * (0.09 * j).cos() + 0.6 * (0.7 * i + 0.4 * j).sin();
        mesh.positions.push(DVec3::new(i, j, height));
    }
    for a in (0..n * (n - 1)).filter(|v| v % n < n - 1) {
        mesh.triangles.extend([[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]);
    }
    if has_needle {
        let foot = mesh.triangles.swap_remove(2700);
        let corners = foot.map(|v| mesh.positions[v as usize]);
        let centre = (corners[0] + corners[1] + corners[2]) / 3.0;
        let inner = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(|p| centre + 0.02 * (p - centre)));
        mesh.positions.push(centre + DVec3::Z * 3.0);
        for side in 0..3 {
            let (p, q) = (foot[side as usize], foot[(side as usize + 1) % 3]);
            let (u, v) = (inner + side, inner + (side + 1) % 3);
            mesh.triangles.extend([[p, q, v], [p, v, u], [u, v, inner + 3]]);
        }
    }
    mesh
}

#[test]
fn a_place_that_is_hard_to_draw_leaves_the_rest_as_it_is() {
    let [plain, needle] = [false, true].map(|has_needle| build_mesh(&waves(has_needle), "0.5edge"));
    assert_eq!([&plain, &needle].map(|(_, summary)| summary.fallbacks.retried_charts), [0, 1]);
    assert!(needle.1.certified_error <= needle.1.tolerance);
    let [plain, needle] = [plain, needle].map(|(bytes, _)| bytes.len());
    assert!(needle * 100 <= plain * 105, "{needle} bytes instead of {plain}");
}

#[test]
fn a_scan_is_reduced_to_any_number_of_triangles_and_certified() {
    let (bytes, _) = build_file(&scan(), "auto");
    let (file, input) = (open(&bytes), import_meshes(&[scan()], &Silent).expect("the scan is readable"));
    let mut coarser = f64::INFINITY;
    for most in [120, 500, 2000, 8000] {
        let (cut, _) = cut_to_finish(&file, &Query::default(), most).expect("affordable");
        let mesh = file.extract(&cut).expect("decodable");
        let finished = finish(&mesh.positions, &mesh.triangles, cut.error, &file.lattice(), most as usize);
        let finished = finished.expect("a scan has such a surface");
        let count = finished.triangles.len() as u64;
        assert!(count <= most && count * 100 >= most * 98, "{count} of {most}");
        let positions = finished.positions.iter().map(|&p| DVec3::from_array(p)).collect();
        let occurs = largest(&input, &Mesh { positions, triangles: finished.triangles });
        assert!(occurs <= finished.error, "{most}: {occurs} occurs, {} is certified", finished.error);
        assert!(finished.error < 2.5 * occurs && finished.error < coarser, "{most}: {occurs}, {}", finished.error);
        coarser = finished.error;
    }
}

#[test]
fn handles_give_way_only_where_they_have_to() {
    let (bytes, _) = build_mesh(&torus(128), "auto");
    let file = open(&bytes);
    let finest = file.uniform_cut(file.level_count() as u8 - 1).expect("a level");
    let mesh = file.extract(&finest).expect("decodable");
    let reduced =
        |most| finish(&mesh.positions, &mesh.triangles, finest.error, &file.lattice(), most).expect("a torus");
    assert_eq!(reduced(1000).topology, Topology::Kept);
    for most in [1000, 200, 30] {
        let edges = inspect_edges(&reduced(most).triangles);
        assert_eq!((edges.boundary.len(), edges.repeated), (0, 0), "{most}");
    }
}

#[test]
fn a_sponge_of_hundreds_of_handles_gets_down_to_any_number() {
    let mesh = sponge(3);
    let (bytes, _) = build_mesh(&mesh, "auto");
    let file = open(&bytes);
    // Its handles need some 20,000 triangles; what has fewer has lost some of them.
    let mut fewer = 0;
    for most in [500, 2_000, 8_000] {
        let (cut, coarser) = cut_to_finish(&file, &Query::default(), most).expect("affordable");
        assert!(cut.triangle_count >= most, "{} for {most}", cut.triangle_count);
        assert!(coarser.is_none_or(|coarser| coarser.triangle_count < most));
        let drawn = file.extract(&cut).expect("decodable");
        let finished = finish(&drawn.positions, &drawn.triangles, cut.error, &file.lattice(), most as usize);
        let finished = finished.expect("a solid");
        assert!((fewer + 1..=most).contains(&(finished.triangles.len() as u64)), "{}", finished.triangles.len());
        fewer = finished.triangles.len() as u64;
        // A handle takes dozens of triangles.
        assert!(finished.topology != Topology::Kept, "{most}");
        // Clustered sheets may share an edge, but none ends.
        assert_eq!(inspect_edges(&finished.triangles).boundary.len(), 0);
        let positions = finished.positions.iter().map(|&p| DVec3::from_array(p)).collect();
        assert!(largest(&mesh, &Mesh { positions, triangles: finished.triangles }) <= finished.error);
    }
}

#[test]
fn many_small_parts_share_roots_and_end_in_one_of_few_triangles() {
    let mesh = beams(2500, 0.2, 2.0);
    let (bytes, _) = build_mesh(&mesh, "auto");
    let file = open(&bytes);
    assert!(file.root_count() < 250, "{} roots for 2,500 parts", file.root_count());
    assert_eq!(file.top_count(), 1);
    let mut coarser = f64::INFINITY;
    for level in 0..file.level_count() as u8 {
        let cut = file.uniform_cut(level).expect("a level");
        let drawn = file.extract(&cut).expect("decodable");
        assert!(level > 0 || drawn.triangles.len() <= 500 && !drawn.triangles.is_empty(), "{}", drawn.triangles.len());
        assert_eq!(inspect_edges(&drawn.triangles).boundary.len(), 0);
        let positions = drawn.positions.iter().map(|&p| DVec3::from_array(p)).collect();
        let occurs = largest(&mesh, &Mesh { positions, triangles: drawn.triangles });
        assert!(occurs <= cut.error, "{occurs} occurs, {} is certified", cut.error);
        assert!(cut.error <= coarser);
        coarser = cut.error;
    }
}

#[test]
fn tops_of_many_handles_or_pipes_have_few_triangles() {
    // The first two are one chart each, without a group.
    for mesh in [sponge(2), pipes(100), sponge(3), pipes(300)] {
        let (bytes, _) = build_mesh(&mesh, "auto");
        let file = open(&bytes);
        let cut = file.uniform_cut(0).expect("a level");
        let drawn = file.extract(&cut).expect("decodable");
        assert!((1..=500).contains(&drawn.triangles.len()), "{}", drawn.triangles.len());
        file.verify().expect("all vertices lie in the boxes of their roots");
        assert_eq!(inspect_edges(&drawn.triangles).boundary.len(), 0);
        let positions = drawn.positions.iter().map(|&p| DVec3::from_array(p)).collect();
        let occurs = largest(&mesh, &Mesh { positions, triangles: drawn.triangles });
        assert!(occurs <= cut.error, "{occurs} occurs, {} is certified", cut.error);
    }
}

#[test]
fn the_top_of_several_regions_is_nearly_as_near_as_a_reduced_finer_cut() {
    let mesh = rough_sphere(64);
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    save_ply(&mesh, &path).expect("a writable temporary directory");
    for region_triangles in [u64::MAX, 15_000, 3_000] {
        let model = ModelOptions {
            region_triangles,
            chart_triangles: Some(256),
            levels: LevelChoice::All,
            ..ModelOptions::default()
        };
        let options = BuildOptions { inputs: vec![path.clone()], model, ..BuildOptions::default() };
        let mut bytes = vec![];
        build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
        let file = open(&bytes);
        assert_eq!(file.top_count(), 1);
        let far = |positions: &[[f64; 3]], triangles: &[[u32; 3]]| {
            let positions = positions.iter().map(|&p| DVec3::from_array(p)).collect();
            largest(&mesh, &Mesh { positions, triangles: triangles.to_vec() })
        };
        let cut = file.uniform_cut(0).expect("a level");
        let top = file.extract(&cut).expect("decodable");
        let occurs = far(&top.positions, &top.triangles);
        assert!(occurs <= cut.error && cut.error < 4.0 * occurs, "{occurs} occurs, {} is certified", cut.error);

        let (finer, _) = cut_to_finish(&file, &Query::default(), top.triangles.len() as u64).expect("affordable");
        let whole = file.extract(&finer).expect("decodable");
        let reduced = finish(&whole.positions, &whole.triangles, finer.error, &file.lattice(), top.triangles.len());
        let reduced = reduced.expect("a sphere has such a surface");
        let best = far(&reduced.positions, &reduced.triangles);
        // The finer cut is reduced in several ways, of which the best is taken: 2.5 times in two regions.
        assert!(occurs < 3.0 * best, "{region_triangles}: {occurs} of the top, {best} of a finer cut");
    }
}

#[test]
fn hundreds_of_pinholes_are_closed_above_and_large_holes_stay() {
    // Five triangles a hole would be 6,000.
    let mut mesh = rough_sphere(96);
    let centre = |corners: &[u32; 3]| corners.map(|v| mesh.positions[v as usize]).into_iter().sum::<DVec3>() / 3.0;
    let in_cap: Vec<bool> = mesh.triangles.iter().map(|corners| centre(corners).normalize().z > 0.97).collect();
    let mut number = 0;
    mesh.triangles.retain(|_| {
        number += 1;
        number % 89 != 0 && !in_cap[number - 1]
    });
    let boundary = inspect_edges(&mesh.triangles).boundary.len();
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    save_ply(&mesh, &path).expect("a writable temporary directory");
    for region_triangles in [60_000, u64::MAX] {
        let model = ModelOptions { region_triangles, ..ModelOptions::default() };
        let options = BuildOptions { inputs: vec![path.clone()], model, ..BuildOptions::default() };
        let mut bytes = vec![];
        build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
        let file = open(&bytes);
        let open_edges = |level: u8| {
            let cut = file.uniform_cut(level).expect("a level");
            let drawn = file.extract(&cut).expect("decodable");
            (drawn.triangles.len(), inspect_edges(&drawn.triangles).boundary.len())
        };
        let (triangles, open) = open_edges(0);
        assert!((100..=500).contains(&triangles) && (3..60).contains(&open), "{triangles} {open}");
        // The finest level has all of them.
        let (_, open) = open_edges(file.level_count() as u8 - 1);
        assert!(open > 3 * 1150 && open <= boundary, "{open} of {boundary}");
        file.verify().expect("what ends inside a group is a hole");
        let report = verify(&file, Some(&mesh), &VerifyOptions { cuts: 60, seed: 8 }, &Silent).expect("readable");
        assert_eq!(report.problems, []);
    }
}

#[test]
fn thin_parts_of_long_triangles_do_not_vanish_at_the_automatic_tolerance() {
    // Half a mean edge would be eight times the thickness.
    let mesh = beams(60, 0.1, 8.0);
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.tolerance < 0.06 * 0.1 && summary.tolerance > 0.001, "{}", summary.tolerance);
    assert!(summary.certified_error <= summary.tolerance);
    let report = verify(&open(&bytes), Some(&mesh), &VerifyOptions { cuts: 50, seed: 3 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
}

#[test]
fn the_finest_level_alone_is_a_smaller_file_with_the_same_promise() {
    let all = build_file(&scan(), "auto");
    let model = ModelOptions { levels: LevelChoice::Finest, ..ModelOptions::default() };
    let options = BuildOptions { inputs: vec![scan()], model, ..BuildOptions::default() };
    let mut bytes = vec![];
    let summary = build(&options, &mut bytes, &Silent).expect("a sound mesh builds");
    assert_eq!(summary.levels.len(), 1);
    assert!(summary.certified_error <= summary.tolerance && summary.tolerance == all.1.tolerance);
    assert!(bytes.len() * 10 < all.0.len() * 9, "{} of {} bytes", bytes.len(), all.0.len());
    let input = import_meshes(&[scan()], &Silent).expect("the scan is readable");
    let report = verify(&open(&bytes), Some(&input), &VerifyOptions { cuts: 20, seed: 5 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
    assert!(open(&bytes).overview().expect("readable").is_none());
}
