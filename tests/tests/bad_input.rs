//! Every kind of bad mesh gives a correct file or one clear error that names the file and the place.

use crate::{build_mesh, open};
use glam::DVec3;
use lodpack_cli::build::{BuildOptions, build};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::progress::Silent;
use lodpack_cli::summary::BuildSummary;
use lodpack_cli::verify::{VerifyOptions, verify};
use lodpack_tests::generate::{bumpy_sphere, torus};

/// Builds the bytes of a mesh file; the error as people see it.
fn build_bytes(name: &str, content: &[u8]) -> Result<(Vec<u8>, BuildSummary), String> {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join(name);
    std::fs::write(&path, content).expect("writable");
    let options = BuildOptions { inputs: vec![path], ..BuildOptions::default() };
    let mut bytes = vec![];
    let summary = build(&options, &mut bytes, &Silent).map_err(|error| error.to_string())?;
    verify(&open(&bytes), None, &VerifyOptions { cuts: 10, seed: 3 }, &Silent).expect("readable");
    Ok((bytes, summary))
}

fn message(name: &str, content: &[u8]) -> String {
    let message = build_bytes(name, content).expect_err("this must be refused");
    assert!(message.contains(name), "'{message}' does not name the file");
    message
}

const TRIANGLE_HEAD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

#[test]
fn a_missing_file_is_named() {
    let options = BuildOptions { inputs: vec!["no/such/mesh.ply".into()], ..BuildOptions::default() };
    let error = build(&options, &mut vec![], &Silent).expect_err("nothing to build");
    assert!(error.to_string().contains("no/such/mesh.ply"));
}

#[test]
fn an_empty_file_is_refused() {
    for name in ["a.ply", "a.obj", "a.stl", "a.glb"] {
        message(name, b"");
    }
}

#[test]
fn wrong_magic_is_refused() {
    message("picture.ply", b"\x89PNG\r\n\x1a\n0000");
    message("text.glb", b"this is not a mesh at all");
    message("mesh.xyz", b"1 2 3\n4 5 6\n");
}

#[test]
fn a_truncated_file_is_refused_wherever_it_ends() {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("whole.ply");
    lodpack_tests::generate::save_ply(&bumpy_sphere(3), &path).expect("writable");
    let whole = std::fs::read(&path).expect("readable");
    for length in (0..whole.len()).step_by(37) {
        message("cut.ply", &whole[..length]);
    }
}

#[test]
fn non_finite_coordinates_are_refused() {
    for bad in ["nan", "inf", "-inf", "1e999"] {
        message("bad.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 {bad} 0\n3 0 1 2\n").as_bytes());
        message("bad.obj", format!("v 0 0 0\nv 1 0 0\nv 0 {bad} 0\nf 1 2 3\n").as_bytes());
    }
}

#[test]
fn an_index_out_of_range_is_refused() {
    message("bad.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n").as_bytes());
    message("bad.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n").as_bytes());
    message("bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
}

#[test]
fn negative_obj_indices_count_from_the_end() {
    let (_, summary) = build_bytes("ok.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n").expect("legal");
    assert_eq!(summary.triangles, 1);
}

#[test]
fn a_polygon_of_20_corners_is_covered() {
    let mut text = String::new();
    for i in 0..20 {
        // A star: concave, so that a plain fan would be wrong.
        let (angle, radius) = (f64::from(i) * std::f64::consts::TAU / 20.0, if i % 2 == 0 { 1.0 } else { 0.4 });
        text += &format!("v {} {} 0\n", radius * angle.cos(), radius * angle.sin());
    }
    text += "f";
    (1..=20).for_each(|i| text += &format!(" {i}"));
    let (bytes, summary) = build_bytes("star.obj", text.as_bytes()).expect("legal");
    assert_eq!(summary.triangles, 18);
    let file = open(&bytes);
    let mesh = file.extract(&file.select(&lodpack::Query::default()).expect("selectable")).expect("decodable");
    let area: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|v| DVec3::from_array(mesh.positions[v as usize]));
            (b - a).cross(c - a).length() * 0.5
        })
        .sum();
    let exact = 20.0 * 0.5 * 0.4 * (std::f64::consts::TAU / 20.0).sin();
    assert!((area / exact - 1.0).abs() < 0.02, "area {area} instead of {exact}");
}

#[test]
fn mixed_winding_is_made_consistent() {
    let mut mesh = bumpy_sphere(12);
    for t in mesh.triangles.iter_mut().step_by(3) {
        t.swap(1, 2);
    }
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.repairs.flipped_faces > 0);
    assert_closed(&bytes);
}

#[test]
fn coincident_duplicates_are_welded() {
    let whole = torus(48);
    // A soup: every triangle with vertices of its own.
    let positions: Vec<DVec3> = whole.triangles.iter().flatten().map(|&v| whole.positions[v as usize]).collect();
    let triangles = (0..whole.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let (bytes, summary) = build_mesh(&Mesh { positions, triangles }, "auto");
    assert_eq!(summary.input_vertices, whole.positions.len() as u64);
    assert_closed(&bytes);
}

fn assert_closed(bytes: &[u8]) {
    let report = verify(&open(bytes), None, &VerifyOptions { cuts: 20, seed: 5 }, &Silent).expect("readable");
    assert_eq!((report.problems, report.boundary_edges), (vec![], 0));
}

#[test]
fn no_faces_is_an_error() {
    message("points.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n");
    message("points.obj", b"v 0 0 0\nv 1 0 0\n");
}

#[test]
fn one_triangle_is_a_model() {
    let (bytes, summary) =
        build_bytes("one.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n").as_bytes()).expect("legal");
    assert_eq!(summary.triangles, 1);
    assert_eq!(summary.levels.last().map(|l| l.triangles), Some(1));
    assert!(bytes.len() < 1000, "{} bytes for one triangle", bytes.len());
}

#[test]
fn all_points_equal_is_an_error() {
    let text = format!("{TRIANGLE_HEAD}1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n");
    assert!(message("point.ply", text.as_bytes()).contains("degenerate"));
}

#[test]
fn a_count_alone_allocates_nothing() {
    let huge = TRIANGLE_HEAD.replace("vertex 3", "vertex 1000000000000000000");
    message("huge.ply", format!("{huge}0 0 0\n").as_bytes());
    let binary = huge.replace("ascii", "binary_little_endian");
    message("huge.ply", format!("{binary}0000").as_bytes());
}

#[test]
fn non_manifold_junctions_are_cut_and_counted() {
    // Three sheets that meet in one edge.
    let text = "v 0 0 0\nv 0 0 1\nv 1 0 0\nv -1 1 0\nv -1 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n";
    let (_, summary) = build_bytes("sheets.obj", text.as_bytes()).expect("repairable");
    assert_eq!(summary.triangles, 3);
    assert!(summary.repairs.nonmanifold_edges_cut > 0);
}
