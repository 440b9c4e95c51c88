//! A mesh becomes geometry images, and those become the same surface again.

use crate::commands::lodpack;
use crate::{open, scan};
use glam::DVec3;
use lodpack_cli::geometry_images::{AtlasOptions, WriteOptions, build_atlas, read_atlas, write_atlas};
use lodpack_cli::import::import_meshes;
use lodpack_cli::measure::verify::distance::BoxTree;
use lodpack_cli::measure::verify::inspect_edges;
use lodpack_cli::mesh::Mesh;
use lodpack_cli::progress::Silent;
use lodpack_cli::stage::repair::repair;
use lodpack_tests::generate::{bumpy_sphere, fan_part, punched_sheet, save_ply, torus};
use std::collections::BTreeMap;
use std::path::Path;

fn arg(path: &Path) -> &str {
    path.to_str().expect("test paths are UTF-8")
}

/// Mean square distance and largest distance of the vertices and triangle centres of one mesh from another.
fn distance(from: &Mesh, to: &Mesh) -> (f64, f64) {
    let tree = BoxTree::new(&to.positions, &to.triangles);
    let (mut sum, mut worst, mut slot) = (0.0, 0.0f64, 0);
    let centres = (0..from.triangles.len() as u32).map(|t| from.corners(t)).map(|[a, b, c]| (a + b + c) / 3.0);
    let points: Vec<DVec3> = from.positions.iter().copied().chain(centres).collect();
    for &p in &points {
        let (d, near, _) = tree.nearest(p, slot).expect("a surface");
        (sum, worst, slot) = (sum + d * d, worst.max(d), near);
    }
    ((sum / points.len() as f64).sqrt(), worst)
}

/// The mesh reconstructed from its atlas, and the number of patches.
fn through_atlas(mesh: &Mesh, options: &AtlasOptions, resolution: Option<u32>, dir: &Path) -> (Mesh, usize) {
    let built = build_atlas(mesh.clone(), options, &Silent);
    let options = WriteOptions { resolution, ..WriteOptions::default() };
    write_atlas(dir, &built.product, &options, &Silent).expect("a writable temporary directory");
    (read_atlas(dir).expect("what was written is readable"), built.product.patches.len())
}

fn imported_scan() -> Mesh {
    repair(import_meshes(&[scan()], &Silent).expect("the scan in the repository is readable")).0
}

/// Number of loops of open edges. Each vertex may be in only one.
fn boundary_loop_count(mesh: &Mesh) -> usize {
    let mut next: BTreeMap<u32, u32> = BTreeMap::new();
    for [from, to] in inspect_edges(&mesh.triangles).boundary {
        assert_eq!(next.insert(from, to), None, "two loops touch at vertex {from}");
    }
    let mut count = 0;
    while let Some((start, mut at)) = next.pop_first() {
        while at != start {
            at = next.remove(&at).expect("boundary loops close");
        }
        count += 1;
    }
    count
}

#[test]
fn a_scan_comes_back_close_and_equally_closed() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mesh = imported_scan();
    let edge = mesh.mean_edge_length();
    let mut last = f64::INFINITY;
    for resolution in [None, Some(5)] {
        let (again, _) = through_atlas(&mesh, &AtlasOptions::default(), resolution, dir.path());
        let edges = inspect_edges(&again.triangles);
        assert_eq!((edges.crowded, edges.repeated, edges.degenerate), (0, 0, 0));
        assert_eq!(boundary_loop_count(&again), boundary_loop_count(&mesh));
        let there = distance(&mesh, &again);
        let back = distance(&again, &mesh);
        let rms = there.0.max(back.0) / edge;
        assert!(rms < 0.2 && rms < last, "RMS distance of {rms} mean edges");
        last = rms;
    }
}

#[test]
fn surfaces_keep_exactly_their_boundary_with_and_without_patches() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mut patch_count, mut mixed) = (0, 0);
    for (index, mesh) in [bumpy_sphere(40), torus(64), fan_part(24), punched_sheet(64)].iter().enumerate() {
        let (mesh, ..) = repair(mesh.clone());
        // Many borders first. Then charts with holes or handles, and charts called too uneven, become patches among
        // images.
        for (chart_triangles, retries, stretch_limit, resolution) in [
            (300, 2, 8.0, 1),
            (300, 2, 8.0, 3),
            (300, 0, 1.1, 1),
            (300, 0, 1.2, 4),
            (1500, 0, 8.0, 3),
            (1500, 1, 1.2, 2),
        ] {
            let mut options = AtlasOptions { chart_triangles, retries, ..AtlasOptions::default() };
            options.embed.stretch_limit = stretch_limit;
            let dir = dir.path().join(format!("{index}-{chart_triangles}-{retries}-{stretch_limit}-{resolution}"));
            let (again, patches) = through_atlas(&mesh, &options, Some(resolution), &dir);
            patch_count += patches;
            mixed += usize::from(patches > 0 && dir.join("root_00000_0.exr").exists());
            let after = inspect_edges(&again.triangles);
            let case = format!("mesh {index}, {options:?}, resolution {resolution}: {patches} patches");
            assert_eq!(boundary_loop_count(&again), boundary_loop_count(&mesh), "{case}");
            assert_eq!((after.crowded, after.repeated, after.degenerate), (0, 0, 0), "{case}");
        }
    }
    assert!(patch_count > 10 && mixed > 5, "the test must produce patches among images: {patch_count}, {mixed}");
}

#[test]
fn a_chart_without_a_map_is_kept_unchanged() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    // A closed surface that is one chart and too small to be cut.
    let mesh = bumpy_sphere(5);
    let (again, patches) =
        through_atlas(&mesh, &AtlasOptions { retries: 0, ..AtlasOptions::default() }, None, dir.path());
    assert_eq!((patches, again.triangles.len()), (1, repair(mesh).0.triangles.len()));
    assert!(dir.path().join("patch_00000.ply").exists());
}

#[test]
fn an_atlas_does_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let mesh = bumpy_sphere(40);
    let options = AtlasOptions { chart_triangles: 300, ..AtlasOptions::default() };
    let built = [1, 4].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        let dir = dir.path().join(threads.to_string());
        pool.install(|| through_atlas(&mesh, &options, Some(2), &dir))
    });
    assert_eq!(built[0], built[1]);
    let manifest = |threads: &str| std::fs::read(dir.path().join(threads).join("atlas.json")).expect("written");
    assert_eq!(manifest("1"), manifest("4"));
}

#[test]
fn the_commands_go_from_mesh_to_atlas_to_file() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let (mesh, atlas, file) = (dir.path().join("m.ply"), dir.path().join("atlas"), dir.path().join("m.lodpack"));
    save_ply(&bumpy_sphere(60), &mesh).expect("a writable temporary directory");
    lodpack().args(["atlas", arg(&mesh), "-o", arg(&atlas), "--resolution", "4"]).assert().code(0);
    lodpack().args(["atlas", arg(&mesh), "-o", arg(&atlas)]).assert().code(2);
    lodpack().args(["atlas", arg(&mesh), "-o", arg(&atlas), "--resolution", "3", "--force"]).assert().code(0);
    let out = lodpack().args(["build", arg(&atlas), "-o", arg(&file), "--json"]).output().expect("runs");
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let summary: serde_json::Value = serde_json::from_slice(&out.stdout).expect("--json prints JSON");
    assert!(summary["triangles"].as_u64() > Some(0));
    let bytes = std::fs::read(&file).expect("written");
    let file = open(&bytes);
    let drawn = file.extract(&file.uniform_cut(0).expect("a cut")).expect("decodable");
    assert!(inspect_edges(&drawn.triangles).boundary.is_empty());

    // A damaged atlas is refused by name.
    let image = std::fs::read_dir(&atlas).expect("readable").filter_map(Result::ok).map(|e| e.path());
    let image = image.filter(|p| p.extension().is_some_and(|e| e == "exr")).min().expect("an image");
    std::fs::remove_file(&image).expect("removable");
    let out = lodpack()
        .args(["build", arg(&atlas), "-o", arg(&mesh.with_extension("again.lodpack"))])
        .output()
        .expect("runs");
    assert_eq!(out.status.code(), Some(2));
    let name = image.file_name().and_then(|n| n.to_str()).expect("a name");
    assert!(String::from_utf8_lossy(&out.stderr).contains(name), "{}", String::from_utf8_lossy(&out.stderr));
}
