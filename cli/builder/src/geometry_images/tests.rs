//! Round trips through a folder, and folders that must be refused.

use std::fs;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::image::GeometryImage;
use super::*;
use lodpack_mesh::appearance::Channels;
use lodpack_mesh::{Adjacency, NONE};
use lodpack_runtime::progress::Silent;
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::chart::{BorderVertex, ChartMesh, NEVER};
use lodpack_stage::embed::{EmbedOptions, embed_chart};

/// A folder of its own that goes away with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("lodpack-atlas-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        Self(path)
    }

    fn edit(&self, from: &str, to: &str) {
        let path = self.0.join(MANIFEST_NAME);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{text}");
        fs::write(path, text.replacen(from, to, 1)).unwrap();
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// A chart with four corners in even distances along its border, where parameters are by arc length.
fn square_chart(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, border: &[u32]) -> ChartMesh {
    let at = |i: usize| positions[border[i % border.len()] as usize];
    let edges = border.len() / 4;
    let length = |from: usize, to: usize| (from..to).map(|i| at(i).distance(at(i + 1))).sum::<f64>();
    let vertex = |i: usize| {
        let first = i - i % edges;
        let param = length(first, i) / length(first, first + edges);
        BorderVertex { vertex: border[i], side: (i / edges) as u32, param, level: NEVER }
    };
    let vertices = (0..border.len()).map(vertex).collect();
    ChartMesh { positions, triangles, loops: vec![vertices] }
}

/// A pillow: two charts with four corners each that share their whole borders. The upper one is `up` high.
fn pillow_charts() -> [ChartMesh; 2] {
    [1.0, -0.5].map(|up| {
        let points = (0..=8).flat_map(|y| (0..=8).map(move |x| (f64::from(x) / 8.0, f64::from(y) / 8.0)));
        let positions =
            points.map(|(x, y)| DVec3::new(x + 0.1 * (y * 9.0).sin(), y, up * x * (1.0 - x) * y * (1.0 - y)));
        let quads = (0..8).flat_map(|y| (0..8).map(move |x| y * 9 + x));
        let mut triangles: Vec<[u32; 3]> = quads.flat_map(|a| [[a, a + 1, a + 10], [a, a + 10, a + 9]]).collect();
        let mut border: Vec<u32> =
            [|k| k, |k| 8 + 9 * k, |k| 80 - k, |k| 72 - 9 * k].iter().flat_map(|at| (0..8).map(at)).collect();
        if up < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
            border[1..].reverse();
        }
        square_chart(positions.collect(), triangles, &border)
    })
}

/// The arcs are the sides of the upper chart; the lower one has them in reverse.
fn pillow() -> AtlasProduct {
    let charts = pillow_charts();
    let mut product = AtlasProduct {
        header: AtlasHeader { origin: DVec3::new(1e6 + 0.1, -0.3, 1e-7), units: "metre".into() },
        ..AtlasProduct::default()
    };
    for side in 0..4 {
        product.arcs.push(side_vertices(&charts[0], side).into_iter().map(|(knot, _)| knot).collect());
    }
    product.charts = charts
        .into_iter()
        .map(|mesh| {
            let embedding = embed_chart(&mesh, &EmbedOptions::default()).unwrap();
            AtlasChart { mesh, embedding, ..AtlasChart::default() }
        })
        .collect();
    product.charts[0].sides = (0..4).map(|arc| HalfArc { arc, reversed: false }).collect();
    product.charts[1].sides = (0..4).rev().map(|arc| HalfArc { arc, reversed: true }).collect();
    product
}

/// The vertices of a side, its last corner included.
fn side_vertices(chart: &ChartMesh, side: u32) -> Vec<(ArcKnot, u32)> {
    let border = &chart.loops[0];
    let end = border.iter().find(|v| v.side == side + 1).unwrap_or(&border[0]);
    let own = border.iter().filter(|v| v.side == side).map(|v| (v.param, v.vertex));
    own.chain([(1.0, end.vertex)])
        .map(|(param, v)| (ArcKnot { param, position: chart.positions[v as usize] }, v))
        .collect()
}

/// The pillow with its lower chart as a patch.
fn pillow_with_patch() -> AtlasProduct {
    let mut product = pillow();
    let chart = product.charts.pop().unwrap().mesh;
    let borders = (0..4).map(|arc| {
        let vertices = side_vertices(&chart, 3 - arc).into_iter().rev().map(|(_, v)| v).collect();
        PatchBorder { arc, vertices }
    });
    let borders = borders.collect();
    product.patches =
        vec![AtlasPatch { positions: chart.positions, triangles: chart.triangles, borders, numbers: vec![] }];
    product
}

fn written(name: &str, resolution: u32) -> Folder {
    let folder = Folder::new(name);
    write_atlas(&folder.0, &pillow(), &WriteOptions::at(resolution), &Silent).unwrap();
    folder
}

fn refusal(dir: &Path) -> String {
    let error = read_atlas(dir).unwrap_err();
    let reason = std::error::Error::source(&error).map_or(String::new(), ToString::to_string);
    format!("{error}: {reason}")
}

#[test]
fn a_closed_surface_comes_back_closed() {
    for resolution in [0, 1, 4] {
        let folder = written(&format!("closed-{resolution}"), resolution);
        let mesh = read_atlas(&folder.0).unwrap();
        let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
        assert!(adjacency.opposite.iter().all(|&o| o != NONE));
        let side = 1 << resolution;
        assert_eq!(mesh.triangles.len(), 8 * side * side * 2);
        // Euler: vertices - edges + triangles = 2, with three edges for two triangles.
        assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
    }
}

#[test]
fn samples_lie_on_the_surface_and_keep_its_winding() {
    let folder = written("surface", 4);
    let mesh = read_atlas(&folder.0).unwrap();
    let origin = DVec3::new(1e6 + 0.1, -0.3, 1e-7);
    let pillow = pillow();
    let corner = pillow.charts[0].mesh.positions[0];
    assert!(mesh.positions.iter().any(|&p| p == origin + corner.as_vec3().as_dvec3()));
    let volume = |positions: &[DVec3], triangles: &[[u32; 3]]| -> f64 {
        let term = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            a.dot(b.cross(c)) / 6.0
        };
        triangles.iter().map(term).sum()
    };
    let moved: Vec<DVec3> = mesh.positions.iter().map(|&p| p - origin).collect();
    let expected: f64 = pillow.charts.iter().map(|c| volume(&c.mesh.positions, &c.mesh.triangles)).sum();
    let found = volume(&moved, &mesh.triangles);
    assert!(expected > 0.0 && (found / expected - 1.0).abs() < 0.02, "{found} {expected}");
}

#[test]
fn writing_twice_gives_the_same_bytes() {
    let [a, b] = ["once", "again"].map(|name| written(name, 3));
    let mut names: Vec<_> = fs::read_dir(&a.0).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names.len(), 9);
    for name in names {
        assert_eq!(fs::read(a.0.join(&name)).unwrap(), fs::read(b.0.join(&name)).unwrap());
    }
}

#[test]
fn an_open_chart_has_a_border_where_it_has_no_neighbour() {
    let folder = Folder::new("open");
    let mut product = pillow();
    product.charts.pop();
    write_atlas(&folder.0, &product, &WriteOptions::at(2), &Silent).unwrap();
    let mesh = read_atlas(&folder.0).unwrap();
    let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
    assert_eq!(adjacency.opposite.iter().filter(|&&o| o == NONE).count(), 4 * 2 * 4);
}

#[test]
fn missing_files_are_named() {
    let folder = written("missing", 1);
    fs::remove_file(folder.0.join("root_00001_2.exr")).unwrap();
    assert!(refusal(&folder.0).contains("root_00001_2.exr"));
    fs::remove_file(folder.0.join(MANIFEST_NAME)).unwrap();
    assert!(refusal(&folder.0).contains(MANIFEST_NAME));
}

#[test]
fn images_of_the_wrong_size_and_damaged_images_are_named() {
    let folder = written("size", 2);
    let path = folder.0.join("root_00000_1.exr");
    GeometryImage { last: 8, samples: vec![[0.0; 3]; 81] }.write(&path).unwrap();
    assert!(matches!(read_atlas(&folder.0), Err(AtlasError::ImageSize { width: 9, height: 9, expected: 5, .. })));
    let bytes = fs::read(&path).unwrap();
    for length in [0, 3, 40, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&path, &bytes[..length]).unwrap();
        assert!(refusal(&folder.0).contains("root_00000_1.exr"), "{length}");
    }
}

#[test]
fn borders_that_do_not_agree_name_both_roots() {
    let folder = written("borders", 2);
    let path = folder.0.join("root_00000_1.exr");
    let mut image = GeometryImage::read(&path, 2).unwrap();
    image.samples[2][0] += 1.0; // On the top edge, the left edge of root 0.
    image.write(&path).unwrap();
    let message = refusal(&folder.0);
    assert!(
        message.contains("root_00000_0.exr (left edge)") && message.contains("root_00000_1.exr (top edge)"),
        "{message}"
    );
}

#[test]
fn samples_that_are_not_finite_are_refused() {
    let folder = Folder::new("finite");
    let mut product = pillow();
    for p in &mut product.charts[1].mesh.positions {
        p.z *= 1e45;
    }
    assert!(matches!(
        write_atlas(&folder.0, &product, &WriteOptions::at(2), &Silent),
        Err(AtlasError::NotFinite { .. })
    ));
    assert!(!folder.0.join(MANIFEST_NAME).exists());
    assert!(write_atlas(&folder.0, &product, &WriteOptions::at(MAX_RESOLUTION + 1), &Silent).is_err());
}

#[test]
fn inconsistent_manifests_are_refused() {
    let cases = [
        ("\"version\": 1", "\"version\": 2", "version 2"),
        ("root_00000_1.exr", "../root_00000_1.exr", "plain file name"),
        ("\"resolution\": 1", "\"resolution\": 40", "resolution 40"),
        ("\"edge\": \"top\"", "\"edge\": \"bottom\"", "does not name it back"),
        ("\"root\": 1,", "\"root\": 99,", "no root 99"),
        ("\"reversed\": false", "\"reversed\": true", "does not name it back"),
        ("\"roots\"", "\"rots\"", "roots"),
        ("\"origin\": [", "\"origin\": [7, ", "atlas.json"),
    ];
    for (i, (from, to, expected)) in cases.into_iter().enumerate() {
        let folder = written(&format!("manifest-{i}"), 1);
        folder.edit(from, to);
        let message = refusal(&folder.0);
        assert!(message.contains(expected), "{from}: {message}");
    }
}

#[test]
fn more_roots_than_materials_are_refused_before_an_image_is_read() {
    let folder = Folder::new("many");
    fs::create_dir_all(&folder.0).unwrap();
    let refusal = |count: usize, channels: Channels| {
        let root = r#"{"file": "none.exr", "resolution": 0, "drawing": 1}"#;
        let roots = vec![root; count].join(",");
        let manifest =
            format!(r#"{{"format": "lodpack-atlas", "version": 1, "origin": [0, 0, 0], "roots": [{roots}]}}"#);
        fs::write(folder.0.join(MANIFEST_NAME), manifest).unwrap();
        super::read::read_surface(&folder.0, &channels).err().map_or(String::new(), |error| error.to_string())
    };
    let message = refusal(65_535, Channels::Auto);
    assert!(message.contains("65535 roots and patches") && message.contains("--channels none"), "{message}");
    // What needs no materials, and what has enough of them, gets as far as the images.
    for (count, channels) in [(65_534, Channels::Auto), (65_535, Channels::None)] {
        let message = refusal(count, channels);
        assert!(message.contains("none.exr cannot be read"), "{message}");
    }
}

#[test]
fn an_image_may_border_on_itself_and_run_backwards() {
    // A sheet whose top edge is folded onto itself about its middle, as in an octahedral map.
    let folder = Folder::new("fold");
    fs::create_dir_all(&folder.0).unwrap();
    let samples = (0..25).map(|i| {
        let (x, y) = ((i % 5) as f32 - 2.0, (i / 5) as f32);
        if y == 0.0 { [x.abs(), 0.0, 0.0] } else { [x, y, x * y] }
    });
    GeometryImage { last: 4, samples: samples.collect() }.write(&folder.0.join("sheet.exr")).unwrap();
    let manifest = r#"{"format": "lodpack-atlas", "version": 1, "origin": [0, 0, 0], "roots": [
        {"file": "sheet.exr", "resolution": 2, "neighbours": {"top": {"root": 0, "edge": "top", "reversed": true}}}]}"#;
    fs::write(folder.0.join(MANIFEST_NAME), manifest).unwrap();
    let mesh = read_atlas(&folder.0).unwrap();
    assert_eq!(mesh.positions.len(), 25 - 2);
    let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
    assert_eq!(adjacency.opposite.iter().filter(|&&o| o == NONE).count(), 12);
}

#[test]
fn a_patch_closes_the_surface_and_keeps_all_its_vertices() {
    for resolution in [1, 2, 3, 5] {
        let folder = Folder::new(&format!("patch-{resolution}"));
        let product = pillow_with_patch();
        write_atlas(&folder.0, &product, &WriteOptions::at(resolution), &Silent).unwrap();
        let mesh = read_atlas(&folder.0).unwrap();
        let adjacency = Adjacency::new(&mesh.triangles, mesh.positions.len());
        assert!(adjacency.opposite.iter().all(|&o| o != NONE), "{resolution}");
        assert_eq!(mesh.positions.len(), mesh.triangles.len() / 2 + 2);
        for p in &product.patches[0].positions {
            let found = mesh.positions.iter().any(|q| q.distance(product.header.origin + *p) < 1e-6);
            assert!(found, "{resolution}: {p}");
        }
    }
}

#[test]
fn patches_that_do_not_fit_are_refused() {
    let spoil = |name: &str, from: &str, to: &str| {
        let folder = Folder::new(name);
        write_atlas(&folder.0, &pillow_with_patch(), &WriteOptions::at(1), &Silent).unwrap();
        folder.edit(from, to);
        refusal(&folder.0)
    };
    assert!(spoil("patch-vertex", "\"vertices\": [", "\"vertices\": [9999, ").contains("patch_00000.ply"));
    let message = spoil("patch-order", "\"vertices\": [", "\"vertices\": [40, ");
    assert!(message.contains("patch_00000.ply") && message.contains("root_00000_0.exr (bottom edge)"), "{message}");
    assert!(
        spoil(
            "patch-root",
            "\"edge\": \"bottom\",\n          \"vertices\"",
            "\"edge\": \"left\",\n          \"vertices\""
        )
        .contains("another neighbour")
    );
    assert!(spoil("patch-file", "patch_00000.ply", "patch_00001.ply").contains("patch_00001.ply"));
}
