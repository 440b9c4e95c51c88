//! Small charts of known shapes, and the properties of every embedding.

use super::*;
use crate::chart::{BorderVertex, NEVER};
use lodpack_mesh::NONE;

/// A chart from triangles that form a disk, with `corner_count` corners spread along the loop and parameters by arc
/// length.
pub fn disk(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, corner_count: usize) -> ChartMesh {
    let adjacency = Adjacency::new(&triangles, positions.len());
    let mut next = vec![NONE; positions.len()];
    for (h, _) in adjacency.opposite.iter().enumerate().filter(|&(_, &o)| o == NONE) {
        next[triangles[h / 3][h % 3] as usize] = triangles[h / 3][(h + 1) % 3];
    }
    let first = next.iter().position(|&v| v != NONE).unwrap() as u32;
    let mut border = vec![first];
    while next[*border.last().unwrap() as usize] != first {
        border.push(next[*border.last().unwrap() as usize]);
    }
    let corners: Vec<usize> = (0..=corner_count).map(|i| i * border.len() / corner_count).collect();
    let mut vertices = Vec::new();
    for side in 0..corner_count {
        let mut length = vec![0.0];
        for i in corners[side]..corners[side + 1] {
            let [a, b] = [border[i], border[(i + 1) % border.len()]].map(|v| positions[v as usize]);
            length.push(length.last().unwrap() + a.distance(b));
        }
        for (k, i) in (corners[side]..corners[side + 1]).enumerate() {
            let param = length[k] / length.last().unwrap();
            vertices.push(BorderVertex { vertex: border[i], side: side as u32, param, level: NEVER });
        }
    }
    ChartMesh { positions, triangles, loops: vec![vertices] }
}

/// The triangles of a grid of `columns` x `rows` squares.
pub fn grid_triangles(columns: u32, rows: u32) -> Vec<[u32; 3]> {
    let at = |x: u32, y: u32| y * (columns + 1) + x;
    let squares = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
    squares
        .flat_map(|(x, y)| {
            let (a, b, c, d) = (at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect()
}

fn grid_with(columns: u32, rows: u32, corner_count: usize, position: impl Fn(f64, f64) -> DVec3) -> ChartMesh {
    let points = (0..=rows).flat_map(|y| (0..=columns).map(move |x| (x, y)));
    let positions = points.map(|(x, y)| position(f64::from(x) / f64::from(columns), f64::from(y) / f64::from(rows)));
    disk(positions.collect(), grid_triangles(columns, rows), corner_count)
}

/// A flat grid of squares with four corners.
pub(super) fn grid(columns: u32, rows: u32) -> ChartMesh {
    grid_with(columns, rows, 4, |x, y| DVec3::new(x, y, 0.0))
}

/// A hemisphere as a warped square.
fn hemisphere(size: u32, corner_count: usize) -> ChartMesh {
    grid_with(size, size, corner_count, |x, y| {
        let (x, y) = (2.0 * x - 1.0, 2.0 * y - 1.0);
        // The rings of the square become circles of latitude.
        let ring = x.abs().max(y.abs());
        let angle = ring * std::f64::consts::FRAC_PI_2;
        let length = (x * x + y * y).sqrt().max(1e-12);
        DVec3::new(x / length * angle.sin(), y / length * angle.sin(), angle.cos())
    })
}

/// A tube of radius 1, closed at the tip and open at the bottom, with nearly equilateral triangles.
fn finger(length: f64) -> ChartMesh {
    let columns = 24;
    let rows = (length * f64::from(columns) / std::f64::consts::TAU).ceil() as u32;
    let mut positions = Vec::new();
    for y in 0..=rows {
        for x in 0..columns {
            let angle = std::f64::consts::TAU * f64::from(x) / f64::from(columns);
            positions.push(DVec3::new(angle.cos(), angle.sin(), length * f64::from(y) / f64::from(rows)));
        }
    }
    let tip = positions.len() as u32;
    positions.push(DVec3::new(0.0, 0.0, length + 0.2));
    let wrap = |v: u32| (v / (columns + 1)) * columns + v % (columns + 1) % columns;
    let mut triangles: Vec<[u32; 3]> = grid_triangles(columns, rows).iter().map(|t| t.map(wrap)).collect();
    triangles.extend((0..columns).map(|x| [tip - columns + x, tip - columns + (x + 1) % columns, tip]));
    disk(positions, triangles, 4)
}

/// A strip with ears whose vertices all lie on its border: every inner edge is a chord, many with both ends on one
/// side.
pub(super) fn chord_rich_strip(length: u32) -> ChartMesh {
    let mut chart = grid_with(length, 1, 3, |x, y| DVec3::new(x * 10.0, y, (x * 20.0).sin() * 0.2));
    // An ear on every second bottom edge.
    for i in (0..length).step_by(2) {
        let ear = chart.positions.len() as u32;
        chart.positions.push(chart.positions[i as usize].midpoint(chart.positions[i as usize + 1]) - DVec3::Y * 0.5);
        chart.triangles.push([i, ear, i + 1]);
    }
    disk(chart.positions, chart.triangles, 3)
}

/// Checks that the map is a bijection onto the polygon: all triangles are exactly positive, the border runs around
/// once, and the areas add up to the polygon's.
fn assert_bijective(chart: &ChartMesh, embedding: &Embedding) {
    let n = embedding.corner_count;
    for &t in &embedding.triangles {
        assert!(stretch::is_positive(&embedding.uv, t));
    }
    for v in &chart.loops[0] {
        assert_eq!(embedding.uv[v.vertex as usize], side_point(n, v.side as usize, v.param));
    }
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| embedding.uv[v as usize]);
        0.5 * (b - a).perp_dot(c - a)
    };
    let sum: f64 = embedding.triangles.iter().map(area).sum();
    let expected = 0.5 * n as f64 * corner_point(n, 0).perp_dot(corner_point(n, 1));
    assert!((sum - expected).abs() < 1e-12, "{sum} {expected}");
    assert_eq!(embedding.uv.len(), chart.positions.len() + embedding.chords.len());
    assert_eq!(embedding.positions(chart).len(), embedding.uv.len());
}

#[test]
fn charts_of_three_to_eight_corners_are_mapped_bijectively() {
    for n in MIN_CORNERS..=8 {
        for reweightings in 0..=2 {
            let options = EmbedOptions { reweightings, stretch_limit: 100.0, ..EmbedOptions::default() };
            for chart in [hemisphere(20, n), grid_with(13, 7, n, |x, y| DVec3::new(x * 2.0, y, x * y))] {
                let embedding = embed_chart(&chart, &options).unwrap();
                assert_eq!(embedding.corner_count, n);
                assert_bijective(&chart, &embedding);
                assert!(embedding.quality.residual < 1e-14);
            }
        }
    }
}

#[test]
fn a_flat_square_is_mapped_almost_isometrically() {
    let chart = grid(16, 16);
    let embedding = embed_chart(&chart, &EmbedOptions::default()).unwrap();
    assert_bijective(&chart, &embedding);
    let quality = embedding.quality;
    assert!(quality.stretch_total < 1.1 && quality.stretch_p50 < 1.05, "{quality:?}");
    assert_eq!(quality.undersampled_area, 0.0);
}

#[test]
fn reweighting_evens_out_a_hemisphere() {
    let chart = hemisphere(32, 4);
    let [plain, once, twice] = [0, 1, 2].map(|reweightings| {
        let options = EmbedOptions { reweightings, ..EmbedOptions::default() };
        embed_chart(&chart, &options).unwrap().quality.stretch_total
    });
    assert!(once < plain && twice <= once && once < 1.3, "{plain} {once} {twice}");
}

#[test]
fn ears_on_straight_sides_do_not_collapse() {
    for length in [2, 12, 40] {
        let chart = chord_rich_strip(length);
        let options = EmbedOptions { stretch_limit: f64::INFINITY, undersampled_limit: 1.0, ..EmbedOptions::default() };
        let embedding = embed_chart(&chart, &options).unwrap();
        assert!(embedding.chords.len() >= length as usize);
        assert_bijective(&chart, &embedding);
        // Each chart triangle is covered by its parts.
        let positions = embedding.positions(&chart);
        let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
        let mut covered = vec![0.0; chart.triangles.len()];
        for (i, t) in embedding.triangles.iter().enumerate() {
            covered[embedding.chart_triangle(i as u32) as usize] += area(t.map(|v| positions[v as usize]));
        }
        for (t, sum) in chart.triangles.iter().zip(covered) {
            assert!((area(t.map(|v| chart.positions[v as usize])) - sum).abs() < 1e-12);
        }
    }
}

#[test]
fn charts_without_inner_vertices_are_mapped() {
    let triangle = disk(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]], 3);
    let embedding = embed_chart(&triangle, &EmbedOptions::default()).unwrap();
    assert_bijective(&triangle, &embedding);
    assert!(embedding.quality.stretch_total < 1.2);
    let square = grid(1, 1);
    assert_bijective(&square, &embed_chart(&square, &EmbedOptions::default()).unwrap());
}

#[test]
fn a_long_finger_is_refused_as_too_uneven() {
    let short = finger(1.0);
    assert_bijective(&short, &embed_chart(&short, &EmbedOptions::default()).unwrap());
    let error = |length| embed_chart(&finger(length), &EmbedOptions::default()).map(|e| e.quality).unwrap_err();
    assert!(matches!(error(8.0), EmbedError::TooUneven { .. }), "{}", error(8.0));
    // The tip is so crowded, and so far from the origin where numbers are denser, that double precision cannot hold the
    // map.
    let mut crowded = finger(80.0);
    for v in crowded.loops[0].iter_mut().filter(|v| v.side == 0) {
        v.param *= v.param;
    }
    let error = embed_chart(&crowded, &EmbedOptions::default()).map(|e| e.quality).unwrap_err();
    assert!(matches!(error, EmbedError::Flipped { .. }), "{error}");
}

#[test]
fn charts_that_are_not_disks_are_refused() {
    let mut tube = grid(6, 3);
    for t in &mut tube.triangles {
        *t = t.map(|v| if v % 7 == 6 { v - 6 } else { v });
    }
    let error = embed_chart(&tube, &EmbedOptions::default()).unwrap_err();
    assert!(matches!(error, EmbedError::NotADisk { loop_count: 1, euler_characteristic: 0 }), "{error}");
    let closed = ChartMesh {
        positions: vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        loops: Vec::new(),
    };
    let error = embed_chart(&closed, &EmbedOptions::default()).unwrap_err();
    assert_eq!(error, EmbedError::NotADisk { loop_count: 0, euler_characteristic: 2 });
}

#[test]
fn bad_borders_and_corner_counts_are_refused() {
    let options = EmbedOptions::default();
    let corners = |n| embed_chart(&grid_with(20, 20, n, |x, y| DVec3::new(x, y, 0.0)), &options);
    assert_eq!(corners(2).unwrap_err(), EmbedError::CornerCount { corner_count: 2 });
    assert_eq!(corners(33).unwrap_err(), EmbedError::CornerCount { corner_count: 33 });
    assert!(corners(32).is_ok());

    let mut not_growing = grid(4, 4);
    not_growing.loops[0][2].param = not_growing.loops[0][1].param;
    assert!(matches!(embed_chart(&not_growing, &options), Err(EmbedError::UnsoundBorder { index: 2, .. })));
    let mut swapped = grid(4, 4);
    swapped.loops[0].swap(1, 2);
    assert!(matches!(embed_chart(&swapped, &options), Err(EmbedError::UnsoundBorder { index: 0, .. })));
    let mut short = grid(4, 4);
    short.loops[0].pop();
    assert!(matches!(embed_chart(&short, &options), Err(EmbedError::UnsoundBorder { index: 0, .. })));
    let mut not_a_number = grid(4, 4);
    not_a_number.loops[0][1].param = f64::NAN;
    assert!(matches!(embed_chart(&not_a_number, &options), Err(EmbedError::UnsoundBorder { index: 1, .. })));
}

#[test]
fn found_locations_reproduce_the_point_from_any_hint() {
    let chart = hemisphere(24, 5);
    let embedding = embed_chart(&chart, &EmbedOptions::default()).unwrap();
    let locator = embedding.locator();
    let plane: Vec<DVec3> = embedding.uv.iter().map(|p| p.extend(0.0)).collect();
    let mut hint = 0;
    for quad in 0..5 {
        for y in 0..=32 {
            for x in 0..=32 {
                let point = quad_point(5, quad, f64::from(x) / 32.0, f64::from(y) / 32.0);
                let location = locator.find(point, hint).unwrap();
                assert!(locator.evaluate(&plane, location).distance(point.extend(0.0)) < 1e-9);
                assert!(location.barycentric.iter().all(|&w| w >= 0.0));
                hint = (hint + 977) % embedding.triangles.len() as u32;
            }
        }
    }
    // A vertex of the map is found in a triangle that has it.
    for (v, &uv) in embedding.uv.iter().enumerate() {
        let location = locator.find(uv, 0).unwrap();
        let corner = embedding.triangles[location.triangle as usize].iter().position(|&w| w as usize == v);
        assert!(corner.is_some_and(|k| location.barycentric[k] > 1.0 - 1e-9), "{v}");
    }
}

#[test]
fn points_outside_are_moved_to_the_border() {
    let chart = grid(8, 8);
    let embedding = embed_chart(&chart, &EmbedOptions::default()).unwrap();
    let locator = embedding.locator();
    let plane: Vec<DVec3> = embedding.uv.iter().map(|p| p.extend(0.0)).collect();
    // The square's side from (1, 0) to (0, 1) is nearest to this point at its middle.
    let location = locator.find(DVec2::new(2.0, 2.0), 50).unwrap();
    assert!(locator.evaluate(&plane, location).distance(DVec3::new(0.5, 0.5, 0.0)) < 1e-12);
    assert_eq!(locator.find(DVec2::new(f64::NAN, 0.0), 0), None);
    assert!(locator.find(DVec2::ZERO, u32::MAX).is_some());
}

#[test]
fn embedding_is_independent_of_position_and_power_of_two_scale() {
    let chart = hemisphere(12, 4);
    let mut large = chart.clone();
    for p in &mut large.positions {
        *p *= 1_048_576.0;
    }
    let [a, b] = [chart, large].map(|c| embed_chart(&c, &EmbedOptions::default()).unwrap());
    assert_eq!(a.uv, b.uv);
}
