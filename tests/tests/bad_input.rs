//! Every kind of bad mesh gives a correct file, or one clear error that names the file and the location.

use crate::{build_mesh, open};
use glam::DVec3;
use lodpack_cli::job::{BuildOptions, build};
use lodpack_cli::measure::verify::{VerifyOptions, verify};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::pipeline::summary::BuildSummary;
use lodpack_cli::progress::Silent;
use lodpack_cli::stage::repair::repair;
use lodpack_tests::generate::{bumpy_sphere, torus};

/// Builds the bytes of a mesh file. An error is returned as people see it.
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
    for name in ["a.ply", "a.obj", "a.off", "a.stl", "a.glb"] {
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
        message("bad.off", format!("OFF\n3 1 0\n0 0 0\n1 0 0\n0 {bad} 0\n3 0 1 2\n").as_bytes());
    }
}

#[test]
fn an_index_out_of_range_is_refused() {
    message("bad.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n").as_bytes());
    message("bad.ply", format!("{TRIANGLE_HEAD}0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n").as_bytes());
    message("bad.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n");
    message("bad.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n");
}

#[test]
fn text_in_utf_16_is_told_from_damage() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    for (name, order) in [("a.obj", u16::to_le_bytes as fn(u16) -> [u8; 2]), ("b.off", u16::to_be_bytes)] {
        let bytes: Vec<u8> = std::iter::once(0xFEFF).chain(text.encode_utf16()).flat_map(order).collect();
        let message = message(name, &bytes);
        assert!(message.contains("UTF-16"), "{message}");
    }
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
        // A star: concave, so a plain fan would be wrong.
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
    // A soup: every triangle has vertices of its own.
    let positions: Vec<DVec3> = whole.triangles.iter().flatten().map(|&v| whole.positions[v as usize]).collect();
    let triangles = (0..whole.triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let (bytes, summary) = build_mesh(&Mesh { positions, triangles }, "auto");
    assert_eq!(summary.input_vertices, whole.positions.len() as u64);
    assert_closed(&bytes);
}

fn assert_closed(bytes: &[u8]) {
    let report = verify(&open(bytes), None, &VerifyOptions { cuts: 20, seed: 5 }, &Silent).expect("readable");
    assert_eq!((report.problems, report.boundary_edges), (vec![], Some(0)));
}

#[test]
fn a_file_without_faces_is_an_error() {
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
fn a_mesh_whose_points_are_all_equal_is_an_error() {
    let text = format!("{TRIANGLE_HEAD}1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n");
    assert!(message("point.ply", text.as_bytes()).contains("degenerate"));
}

#[test]
fn a_large_count_alone_allocates_nothing() {
    let huge = TRIANGLE_HEAD.replace("vertex 3", "vertex 1000000000000000000");
    message("huge.ply", format!("{huge}0 0 0\n").as_bytes());
    let binary = huge.replace("ascii", "binary_little_endian");
    message("huge.ply", format!("{binary}0000").as_bytes());
}

#[test]
fn non_manifold_junctions_are_cut_and_counted() {
    // Three sheets that meet at one edge.
    let text = "v 0 0 0\nv 0 0 1\nv 1 0 0\nv -1 1 0\nv -1 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n";
    let (_, summary) = build_bytes("sheets.obj", text.as_bytes()).expect("repairable");
    assert_eq!(summary.triangles, 3);
    assert!(summary.repairs.nonmanifold_edges_cut > 0);
}

/// Builds a mesh at any scale and position, and verifies the file against it.
fn sound(mesh: &Mesh) -> (Vec<u8>, BuildSummary) {
    let (bytes, summary) = build_mesh(mesh, "auto");
    let (repaired, ..) = repair(mesh.clone());
    let report =
        verify(&open(&bytes), Some(&repaired), &VerifyOptions { cuts: 20, seed: 9 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
    assert!(summary.certified_error <= summary.tolerance);
    (bytes, summary)
}

fn moved(mesh: &Mesh, scale: f64, offset: DVec3) -> Mesh {
    Mesh { positions: mesh.positions.iter().map(|&p| p * scale + offset).collect(), triangles: mesh.triangles.clone() }
}

/// The message for a mesh that cannot be built.
fn refusal(mesh: &Mesh) -> String {
    let dir = tempfile::tempdir().expect("a temporary directory");
    let path = dir.path().join("mesh.ply");
    lodpack_tests::generate::save_ply(mesh, &path).expect("writable");
    let options = BuildOptions { inputs: vec![path], ..BuildOptions::default() };
    build(&options, &mut vec![], &Silent).expect_err("this must be refused").to_string()
}

fn cube() -> Mesh {
    let positions = (0..8).map(|i| DVec3::new(f64::from(i >> 2), f64::from(i >> 1 & 1), f64::from(i & 1))).collect();
    let quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { positions, triangles }
}

fn tetrahedron() -> Mesh {
    Mesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
    }
}

/// n by m quads over the unit square, with vertices where `position_at` puts them.
fn sheet(n: u32, m: u32, position_at: impl Fn(f64, f64) -> DVec3) -> Mesh {
    let at = |i: u32, j: u32| i * (m + 1) + j;
    let positions = (0..=n)
        .flat_map(|i| (0..=m).map(move |j| (i, j)))
        .map(|(i, j)| position_at(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m)))
        .collect();
    let triangles = (0..n)
        .flat_map(|i| (0..m).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Mesh { positions, triangles }
}

fn together(parts: impl IntoIterator<Item = Mesh>) -> Mesh {
    parts.into_iter().fold(Mesh::default(), |mut whole, part| {
        let first = whole.positions.len() as u32;
        whole.positions.extend(part.positions);
        whole.triangles.extend(part.triangles.iter().map(|t| t.map(|v| v + first)));
        whole
    })
}

/// Numbers in 0..1 in a fixed sequence.
fn random() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[test]
fn solids_of_few_triangles_cost_a_few_hundred_bytes() {
    for (mesh, triangles) in [(cube(), 12), (tetrahedron(), 4), (sheet(1, 1, |x, y| DVec3::new(x, y, x * y)), 2)] {
        let (bytes, summary) = sound(&mesh);
        assert_eq!(summary.levels.last().map(|l| l.triangles), Some(triangles));
        assert!(bytes.len() < 800, "{} bytes for {triangles} triangles", bytes.len());
    }
}

#[test]
fn a_flat_sheet_is_a_few_triangles() {
    let mesh = sheet(50, 50, |x, y| DVec3::new(x, y, 0.0));
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.levels.last().is_some_and(|l| l.triangles <= 16), "{:?}", summary.levels);
    assert!(bytes.len() < 800, "{} bytes", bytes.len());
}

#[test]
fn sizes_from_atoms_to_galaxies_are_built_and_others_refused() {
    let mesh = bumpy_sphere(8);
    for scale in [1e-39, 1e-30, 1e-3, 6.4e6, 1e30, 1e39] {
        sound(&moved(&mesh, scale, DVec3::ZERO));
    }
    for scale in [1e-310, 1e-300, 1e-60, 1e60, 1e160, 1e300] {
        assert!(refusal(&moved(&mesh, scale, DVec3::ZERO)).contains("scale"), "{scale:e}");
    }
}

#[test]
fn far_models_are_built_as_long_as_their_coordinates_distinguish_points() {
    let mesh = bumpy_sphere(8);
    sound(&moved(&mesh, 1.0, DVec3::new(1e9, -1e9, 1e9)));
    sound(&moved(&mesh, 1e-3, DVec3::new(1e8, 0.0, 0.0)));
    assert!(refusal(&moved(&mesh, 1.0, DVec3::new(1e15, 0.0, 0.0))).contains("origin"));
}

#[test]
fn a_speck_light_years_away_is_refused_with_a_hint() {
    let speck = moved(&tetrahedron(), 1.0, DVec3::new(1e12, 0.0, 0.0));
    let message = refusal(&together([bumpy_sphere(16), speck]));
    assert!(message.contains("far off") && message.contains("--tolerance"), "{message}");
}

#[test]
fn a_thousand_components_are_a_thousand_roots() {
    let position_at = |i: u32| DVec3::new(f64::from(i % 10), f64::from(i / 10 % 10), f64::from(i / 100));
    let (bytes, summary) = sound(&together((0..1000).map(|i| moved(&tetrahedron(), 0.3, position_at(i)))));
    assert_eq!(summary.levels.last().map(|l| l.triangles), Some(4000));
    assert!(bytes.len() < 40_000, "{} bytes", bytes.len());
}

#[test]
fn one_sided_strips_are_cut_open() {
    // A Möbius strip: its last row is the first one upside down.
    let (n, m) = (200, 6);
    let strip = sheet(n, m, |x, y| {
        let (angle, t) = (x * std::f64::consts::TAU, (y - 0.5) * 0.6);
        let radius = 1.0 + t * (angle / 2.0).cos();
        DVec3::new(radius * angle.cos(), radius * angle.sin(), t * (angle / 2.0).sin())
    });
    let glued = |v: u32| if v >= n * (m + 1) { m - (v - n * (m + 1)) } else { v };
    let mesh = Mesh { triangles: strip.triangles.iter().map(|t| t.map(glued)).collect(), ..strip };
    let (_, summary) = sound(&mesh);
    assert_eq!(summary.triangles, u64::from(2 * n * m));
}

#[test]
fn random_soups_are_sound() {
    let mut random = random();
    let mut point = || DVec3::new(random(), random(), random());
    let separate = (0..2000).map(|_| {
        let centre = point();
        let corners = [0; 3].map(|_| centre + (point() - 0.5) * 0.1);
        Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]] }
    });
    let (_, summary) = sound(&together(separate));
    assert_eq!(summary.triangles, 2000);

    // Sixty vertices and six hundred triangles among them, so that most edges have many triangles.
    let positions: Vec<DVec3> = (0..60).map(|_| point()).collect();
    let mut corner = || ((point().x * 60.0) as u32).min(59);
    let triangles = (0..600).map(|_| [corner(), corner(), corner()]).filter(|[a, b, c]| a != b && b != c && c != a);
    let mesh = Mesh { positions, triangles: triangles.collect() };
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.repairs.nonmanifold_edges_cut > 0 && summary.certified_error <= summary.tolerance);
    let report = verify(&open(&bytes), None, &VerifyOptions { cuts: 50, seed: 9 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
}

#[test]
fn a_vertex_with_20000_triangles_is_built() {
    let n = 20_000;
    let rim = (0..n)
        .map(|i| DVec3::from((glam::DVec2::from_angle(f64::from(i) / f64::from(n) * std::f64::consts::TAU), 0.0)));
    let mesh = Mesh {
        positions: std::iter::once(DVec3::Z).chain(rim).collect(),
        triangles: (0..n).map(|i| [0, 1 + i, 1 + (i + 1) % n]).collect(),
    };
    let (bytes, summary) = build_mesh(&mesh, "auto");
    assert!(summary.certified_error <= summary.tolerance);
    assert!(bytes.len() < 2000, "{} bytes", bytes.len());
    let report = verify(&open(&bytes), None, &VerifyOptions { cuts: 20, seed: 9 }, &Silent).expect("readable");
    assert_eq!(report.problems, []);
}

#[test]
fn a_tolerance_above_the_size_of_the_model_is_limited_to_about_its_size() {
    for tolerance in ["50%", "1e30", "1e300"] {
        let mesh = bumpy_sphere(8);
        let (bytes, summary) = build_mesh(&mesh, tolerance);
        assert!(summary.certified_error < 4.0, "{tolerance}: {}", summary.certified_error);
        let report =
            verify(&open(&bytes), Some(&mesh), &VerifyOptions { cuts: 20, seed: 9 }, &Silent).expect("readable");
        assert_eq!(report.problems, []);
    }
}

#[test]
fn a_built_file_that_is_not_whole_is_refused() {
    let (bytes, _) = build_mesh(&cube(), "auto");
    assert!(message("again.lodpack", &bytes[..bytes.len() - 9]).contains("again.lodpack: "));
}
