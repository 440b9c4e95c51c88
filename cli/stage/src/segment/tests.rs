use super::*;
use crate::arcs::tests::{check_atlas, grid, quad_mesh, sphere, torus};
use crate::arcs::{Seams, trace_arcs};
use glam::DVec3;

fn adjacency_of(mesh: &Mesh) -> Adjacency {
    Adjacency::new(&mesh.triangles, mesh.positions.len())
}

fn options(target_triangles: u32) -> SegmentOptions {
    SegmentOptions { target_triangles, ..SegmentOptions::default() }
}

/// Segments a mesh, checks what must always hold, and returns the labels and the number of triangles of each chart.
fn segment(mesh: &Mesh, options: &SegmentOptions) -> (Vec<u32>, Vec<u32>) {
    let adjacency = adjacency_of(mesh);
    let mut labels = segment_charts(mesh, &adjacency, options);
    let (components, count) = components::connected_components(&adjacency, &labels);
    assert_eq!(components, labels, "charts are connected and numbered by their smallest triangle");
    assert_eq!(compact_labels(&mut labels), count);
    check_atlas(mesh, &labels, &trace_arcs(mesh, &adjacency, &labels, &Seams::default()));
    let sizes = label_sizes(&labels, count);
    (labels, sizes)
}

#[test]
fn charts_have_about_the_wanted_size() {
    for mesh in [grid(80), torus([120, 60]), sphere(40)] {
        let (_, sizes) = segment(&mesh, &options(1000));
        assert!(sizes.iter().all(|&size| (334..=2000).contains(&size)), "{sizes:?}");
    }
}

#[test]
fn small_components_stay_whole() {
    let mesh = quad_mesh([400, 3], [false; 2], |x, _| x % 4 != 3, |x, y| DVec3::new(x, y, 0.0));
    let (_, sizes) = segment(&mesh, &options(1000));
    assert_eq!(sizes, [18; 100]);
}

#[test]
fn a_large_component_is_cut_beside_small_ones() {
    let mesh = quad_mesh([100, 40], [false; 2], |x, _| x < 79 || x % 4 != 3, |x, y| DVec3::new(x, y, 0.0));
    let (_, sizes) = segment(&mesh, &options(1000));
    assert_eq!(sizes.iter().filter(|&&size| size == 240).count(), 5, "three columns of 40 quads each");
    assert!((5..=20).contains(&(sizes.len() - 5)));
}

#[test]
fn a_long_strip_is_cut_across() {
    let mesh = quad_mesh([2000, 1], [false; 2], |_, _| true, |x, y| DVec3::new(x * 2000.0, y, 0.0));
    let (_, sizes) = segment(&mesh, &options(500));
    assert!(sizes.iter().all(|&size| (167..=1000).contains(&size)), "{sizes:?}");
}

#[test]
fn a_tube_cut_into_rings_is_opened() {
    let mesh = quad_mesh(
        [24, 200],
        [true, false],
        |_, _| true,
        |u, v| {
            let a = std::f64::consts::TAU * u;
            DVec3::new(a.cos(), a.sin(), v * 40.0)
        },
    );
    let adjacency = adjacency_of(&mesh);
    let labels = segment_charts(&mesh, &adjacency, &options(1000));
    let atlas = trace_arcs(&mesh, &adjacency, &labels, &Seams::default());
    assert!(atlas.charts.iter().all(|chart| chart.loops.len() == 1));
}

#[test]
fn small_holes_stay_inside_a_chart() {
    let mesh = quad_mesh([80, 80], [false; 2], |x, y| !(x % 20 == 9 && y % 20 == 9), |x, y| DVec3::new(x, y, 0.0));
    let (labels, sizes) = segment(&mesh, &options(4000));
    assert!(sizes.len() <= 5);
    let atlas = trace_arcs(&mesh, &adjacency_of(&mesh), &labels, &Seams::default());
    assert!(atlas.charts.iter().map(|chart| chart.loops.len()).sum::<usize>() > 10);
}

#[test]
fn borders_follow_a_crease() {
    // A roof: two slopes that meet at x = 0.5, and the triangles along the ridge.
    let mesh = quad_mesh(
        [64, 32],
        [false; 2],
        |_, _| true,
        |x, y| DVec3::new(x, 0.5 * y, if x < 0.5 { x } else { 1.0 - x } * 1.5),
    );
    let (labels, _) = segment(&mesh, &options(2048));
    let across = (0..32).filter(|y| labels[2 * (64 * y + 31)] == labels[2 * (64 * y + 32)]).count();
    assert!(across <= 2, "{across} of 32 rows cross the ridge inside a chart");
}

#[test]
fn the_size_of_the_coordinates_does_not_matter() {
    let mesh = torus([60, 40]);
    let labels = segment_charts(&mesh, &adjacency_of(&mesh), &options(500));
    for scale in [2.0f64.powi(-500), 2.0f64.powi(500)] {
        let mut scaled = mesh.clone();
        for p in &mut scaled.positions {
            *p *= scale;
        }
        assert_eq!(segment_charts(&scaled, &adjacency_of(&mesh), &options(500)), labels);
    }
}

#[test]
fn degenerate_meshes_are_cut_too() {
    // All vertices at one point, or on a line.
    for flatten in [0.0, 1.0] {
        let mesh = quad_mesh([50, 50], [false; 2], |_, _| true, |x, _| DVec3::new(x * flatten, 0.0, 0.0));
        segment(&mesh, &options(500));
    }
    segment(&Mesh::default(), &options(500));
}

#[test]
fn labels_do_not_depend_on_the_number_of_threads() {
    // More triangles than the blocks of any step hold.
    let mesh = torus([520, 260]);
    let adjacency = adjacency_of(&mesh);
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| segment_charts(&mesh, &adjacency, &options(2000)))
    });
    assert_eq!(one, three);
}

#[test]
fn charts_of_the_input_stay_unless_they_are_apart_or_too_large() {
    let (mesh, largest) = (grid(40), 1600);
    let adjacency = adjacency_of(&mesh);
    let strip = |t: u32| mesh.corners(t).iter().map(|p| p.x).sum::<f64>() / 3.0;
    let [low, high] = mesh.bounds();
    let share = |t: u32| (strip(t) - low.x) / (high.x - low.x);
    // Three strips: two are one chart for the input, with the third between them, which is too large.
    let charts: Vec<u32> =
        (0..mesh.triangles.len() as u32).map(|t| u32::from((0.2..0.8).contains(&share(t)))).collect();
    let kept = |largest: u32, target: u32| {
        let labels = keep_charts(&mesh, &adjacency, &charts, largest, &options(target));
        let (components, count) = components::connected_components(&adjacency, &labels);
        assert_eq!(components, labels, "charts are connected and numbered by their smallest triangle");
        for (t, &label) in labels.iter().enumerate() {
            assert_eq!(charts[t], charts[labels.iter().position(|&other| other == label).unwrap_or(t)]);
        }
        (labels, count)
    };
    assert_eq!(kept(3200, 800).1, 3);
    let (labels, count) = kept(largest, 400);
    assert!((5..12).contains(&count), "{count}");
    let sizes = label_sizes(&labels, count);
    assert_eq!(sizes.iter().filter(|&&size| size == 640).count(), 2, "{sizes:?}");
    assert!(sizes.iter().all(|&size| size <= 800), "{sizes:?}");
}
