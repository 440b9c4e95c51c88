//! Properties of the levels, on generated charts of every topology.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use glam::DVec3;

use super::half_edges::HalfEdges;
use super::*;
use crate::areas::Jumps;
use crate::certify::{Hint, TriangleBvh};
use crate::chart::{BorderVertex, NEVER};

/// A chart of the given triangles with dyadic levels along each border loop: every second vertex is `NEVER` a sample,
/// every second of the others has the finest level, and so on; at least three corners remain at level 0.
fn chart(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, levels: u8) -> ChartMesh {
    let mesh = HalfEdges::new(&triangles, positions.len()).expect("a manifold");
    let mut seen = vec![false; positions.len()];
    let mut loops = Vec::new();
    for start in 0..positions.len() as u32 {
        if !mesh.is_alive(start) || !mesh.is_border(start) || seen[start as usize] {
            continue;
        }
        let mut vertices = Vec::new();
        let mut v = start;
        while !seen[v as usize] {
            seen[v as usize] = true;
            vertices.push(v);
            v = mesh.target(mesh.fan(v).next().expect("a border half-edge"));
        }
        let n = vertices.len();
        let corners = 4.min(n);
        let border = |(i, &vertex): (usize, &u32)| {
            let side = (i * corners / n) as u32;
            let (from, to) = (side as usize * n, (side as usize + 1) * n);
            let (from, to) = (from.div_ceil(corners), to.div_ceil(corners));
            let k = i - from;
            let level = if k == 0 { 0 } else { levels.saturating_sub(k.trailing_zeros() as u8) };
            let level = if level == levels { NEVER } else { level };
            BorderVertex { vertex, side, param: k as f64 / (to - from) as f64, level }
        };
        loops.push(vertices.iter().enumerate().map(border).collect());
    }
    ChartMesh { positions, triangles, loops }
}

/// Triangles of a grid of `columns` x `rows` vertices, wrapping around as asked.
fn lattice(columns: u32, rows: u32, wrap_columns: bool, wrap_rows: bool) -> Vec<[u32; 3]> {
    let at = |i: u32, j: u32| (j % rows) * columns + i % columns;
    let mut triangles = Vec::new();
    for j in 0..if wrap_rows { rows } else { rows - 1 } {
        for i in 0..if wrap_columns { columns } else { columns - 1 } {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            if (i + j) % 2 == 0 {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[a, b, d], [b, c, d]]);
            }
        }
    }
    triangles
}

fn hilly_grid(n: u32, height: f64) -> ChartMesh {
    let at = |k: u32| f64::from(k) / f64::from(n - 1);
    let positions = (0..n * n)
        .map(|v| (at(v % n), at(v / n)))
        .map(|(x, y)| DVec3::new(x, y, height * ((7.0 * x).sin() * (5.0 * y + x).cos())))
        .collect();
    chart(positions, lattice(n, n, false, false), 4)
}

fn torus_positions(columns: u32, rows: u32) -> Vec<DVec3> {
    (0..columns * rows)
        .map(|v| {
            let (a, b) = (f64::from(v % columns) / f64::from(columns), f64::from(v / columns) / f64::from(rows));
            let r = 1.0 + 0.4 * (TAU * b).cos();
            DVec3::new(r * (TAU * a).cos(), r * (TAU * a).sin(), 0.4 * (TAU * b).sin())
        })
        .collect()
}

fn sphere(rows: u32, columns: u32) -> ChartMesh {
    let mut positions: Vec<DVec3> = (0..rows * columns)
        .map(|v| {
            let (a, b) =
                (f64::from(v % columns) / f64::from(columns), f64::from(v / columns + 1) / f64::from(rows + 1));
            let (sin, cos) = (0.5 * TAU * b).sin_cos();
            DVec3::new(sin * (TAU * a).cos(), sin * (TAU * a).sin(), -cos)
        })
        .collect();
    let mut triangles = lattice(columns, rows, true, false);
    let (south, north) = (positions.len() as u32, positions.len() as u32 + 1);
    positions.extend([-DVec3::Z, DVec3::Z]);
    let top = (rows - 1) * columns;
    for i in 0..columns {
        triangles.push([south, (i + 1) % columns, i]);
        triangles.push([north, top + i, top + (i + 1) % columns]);
    }
    chart(positions, triangles, 4)
}

fn annulus() -> ChartMesh {
    let (columns, rows) = (48, 12);
    let positions = (0..columns * rows)
        .map(|v| {
            let (a, r) = (TAU * f64::from(v % columns) / f64::from(columns), 2.0 - f64::from(v / columns) / 10.0);
            DVec3::new(r * a.cos(), r * a.sin(), 0.1 * (3.0 * a).sin())
        })
        .collect();
    chart(positions, lattice(columns, rows, true, false), 4)
}

/// A torus without a small square: one loop and a handle.
fn handle() -> ChartMesh {
    let (columns, rows) = (40, 24);
    let cut = |v: &u32| (10..16).contains(&(v % columns)) && (5..11).contains(&(v / columns));
    let triangles = lattice(columns, rows, true, true).into_iter().filter(|t| !t.iter().all(cut)).collect();
    chart(torus_positions(columns, rows), triangles, 4)
}

fn euler(triangles: &[[u32; 3]]) -> i64 {
    let vertices: BTreeSet<u32> = triangles.as_flattened().iter().copied().collect();
    let edges: BTreeSet<(u32, u32)> =
        triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).map(|(a, b)| (a.min(b), a.max(b))).collect();
    vertices.len() as i64 - edges.len() as i64 + triangles.len() as i64
}

/// Vertex positions of a patch.
fn positions_of(chart: &ChartMesh, patch: &LevelPatch) -> Vec<DVec3> {
    let border = patch.border.iter().map(|&v| chart.positions[v as usize]);
    border.chain(patch.interior.iter().copied()).collect()
}

/// Checks everything that holds for every level of every chart.
fn check_levels(chart: &ChartMesh, result: &SimplifiedChart) {
    for (level, patch) in result.levels.iter().enumerate() {
        let Some(patch) = patch else {
            assert!(
                result.stuck.iter().any(|s| usize::from(s.level) == level),
                "level {level} is missing without a reason"
            );
            continue;
        };
        let wanted: Vec<Vec<u32>> = chart
            .loops
            .iter()
            .map(|l| l.iter().filter(|b| usize::from(b.level) <= level).map(|b| b.vertex).collect())
            .collect();
        assert_eq!(patch.border, wanted.concat());
        assert_eq!(patch.border_loops, wanted.iter().map(|l| l.len() as u32).collect::<Vec<_>>());

        let positions = positions_of(chart, patch);
        let used: BTreeSet<u32> = patch.triangles.as_flattened().iter().copied().collect();
        assert_eq!(used.len(), positions.len(), "every vertex is used");
        assert!(used.last().is_none_or(|&v| (v as usize) < positions.len()));
        assert_eq!(patch.interior.len(), patch.interior_quadrics.len());

        let mut start = 0;
        let loops = patch.border_loops.iter().map(|&count| {
            start += count;
            let vertices = start - count..start;
            vertices.map(|vertex| BorderVertex { vertex, side: 0, param: 0.0, level: 0 }).collect()
        });
        let local =
            ChartMesh { positions: positions.clone(), triangles: patch.triangles.clone(), loops: loops.collect() };
        let mesh = HalfEdges::new(&local.triangles, positions.len()).expect("a manifold");
        assert!(border_is(&local, &mesh), "the loops are the border");
        assert_eq!(euler(&patch.triangles), euler(&chart.triangles));

        let mut sets: Vec<[u32; 3]> = patch.triangles.clone();
        sets.iter_mut().for_each(|t| t.sort_unstable());
        sets.sort_unstable();
        let count = sets.len();
        sets.dedup();
        assert_eq!(sets.len(), count, "no triangle twice");
        for t in &patch.triangles {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            assert!((b - a).cross(c - a).length() > 0.0, "no triangle without area");
        }
    }
}

fn simplify(chart: &ChartMesh, thresholds: &[f64]) -> SimplifiedChart {
    let result = simplify_chart(chart, &SimplifyOptions { thresholds, ..Default::default() });
    check_levels(chart, &result);
    result
}

fn triangle_counts(result: &SimplifiedChart) -> Vec<usize> {
    result.levels.iter().map(|l| l.as_ref().map_or(0, |l| l.triangles.len())).collect()
}

#[test]
fn levels_of_a_disk_keep_every_rule_and_get_coarser() {
    let result = simplify(&hilly_grid(65, 0.1), &[0.02, 0.005, 0.00125, 0.0003]);
    assert_eq!(result.stuck, []);
    let counts = triangle_counts(&result);
    assert!(counts.windows(2).all(|w| 2 * w[0] < w[1]), "{counts:?}");
    assert!(counts[0] < 200 && counts[3] > 1000, "{counts:?}");
}

#[test]
fn no_triangle_of_a_height_field_folds_over() {
    let grid = hilly_grid(65, 0.1);
    let result = simplify(&grid, &[0.05, 0.01, 0.002, 0.0005]);
    for patch in result.levels.iter().flatten() {
        let positions = positions_of(&grid, patch);
        for t in &patch.triangles {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            assert!((b - a).cross(c - a).z > 0.0);
        }
    }
}

#[test]
fn levels_of_an_annulus_keep_every_rule() {
    let result = simplify(&annulus(), &[0.1, 0.01, 0.003, 0.001]);
    assert_eq!(result.stuck, []);
    assert!(triangle_counts(&result)[0] < 100);
}

#[test]
fn a_handle_survives_any_threshold() {
    let result = simplify(&handle(), &[10.0, 0.01, 0.003]);
    assert_eq!(result.stuck, []);
    assert!(triangle_counts(&result)[0] < 200);
}

#[test]
fn a_closed_chart_stops_before_it_vanishes() {
    let result = simplify(&sphere(20, 40), &[100.0, 0.01, 0.001]);
    assert!((4..40).contains(&triangle_counts(&result)[0]));
    let result = simplify(&chart(torus_positions(40, 24), lattice(40, 24, true, true), 4), &[100.0, 0.01, 0.001]);
    assert!((14..100).contains(&triangle_counts(&result)[0]));
}

#[test]
fn a_flat_chart_needs_its_border_only() {
    let result = simplify(&hilly_grid(33, 0.0), &[1e-9]);
    let patch = result.levels[0].as_ref().expect("nothing is stuck");
    assert!(patch.interior.len() <= 1, "{}", patch.interior.len());
    assert!(patch.triangles.len() <= patch.border.len());
}

#[test]
fn corners_and_creases_of_a_roof_stay_sharp() {
    let n = 33;
    let mut roof = hilly_grid(n, 0.0);
    for p in &mut roof.positions {
        p.z = 0.5 - (p.x - 0.5).abs().max((p.y - 0.5).abs());
    }
    let result = simplify(&roof, &[1e-6]);
    let patch = result.levels[0].as_ref().expect("nothing is stuck");
    let positions = positions_of(&roof, patch);
    assert!(positions.iter().any(|p| p.distance(DVec3::new(0.5, 0.5, 0.5)) < 1e-5), "the tip is there");
    for p in positions {
        let height = 0.5 - (p.x - 0.5).abs().max((p.y - 0.5).abs());
        assert!((p.z - height).abs() < 1e-5);
    }
    assert!(patch.interior.len() < 40, "{}", patch.interior.len());
}

#[test]
fn scale_and_position_of_the_input_do_not_matter() {
    let near = hilly_grid(33, 0.1);
    let expected = triangle_counts(&simplify(&near, &[0.005, 0.001]));
    for scale in [2f64.powi(-60), 2f64.powi(70)] {
        let mut other = near.clone();
        other.positions.iter_mut().for_each(|p| *p = *p * scale + DVec3::splat(8.0 * scale));
        let result = simplify(&other, &[0.005 * scale, 0.001 * scale]);
        for (a, b) in triangle_counts(&result).into_iter().zip(&expected) {
            assert!(a.abs_diff(*b) * 20 < *b, "{a} triangles at scale {scale}, not {b}");
        }
    }
}

#[test]
fn interior_quadrics_measure_the_offset_from_their_vertex() {
    let grid = hilly_grid(33, 0.1);
    let result = simplify(&grid, &[0.003]);
    let patch = result.levels[0].as_ref().expect("nothing is stuck");
    for q in &patch.interior_quadrics {
        // The last pass allows a little more than the level.
        assert!(q.mean(q.error(DVec3::ZERO)) <= 0.003 * 0.003 * 1.11);
        assert!(q.mean(q.error(DVec3::new(0.0, 0.0, 0.1))) > 0.002, "moving off the surface costs");
    }
    let total: f64 = patch.interior_quadrics.iter().map(|q| q.weight).sum();
    assert!(total > 0.5 && total < 1.2, "weights are areas in input units, {total}");
}

#[test]
fn a_noisy_surface_is_nearer_where_planes_are_renewed_on_the_way() {
    let mut grid = hilly_grid(65, 0.1);
    for (i, p) in grid.positions.iter_mut().enumerate() {
        p.z += 0.004 * ((i * 7919 % 1009) as f64 / 1009.0 - 0.5);
    }
    let mean_square = |stops: &[f64]| {
        let options =
            SimplifyOptions { thresholds: &[f64::INFINITY], min_triangles: 400, stops, ..SimplifyOptions::default() };
        let patch = simplify_chart(&grid, &options).levels.pop().flatten().expect("nothing is stuck");
        let border = patch.border.iter().map(|&v| grid.positions[v as usize]);
        let drawn: Vec<DVec3> = border.chain(patch.interior.iter().copied()).collect();
        let bvh = TriangleBvh::new(&drawn, &patch.triangles);
        let mut hint = Hint::default();
        let squares = grid.positions.iter().map(|&p| bvh.closest(p, &mut hint).distance.powi(2));
        squares.sum::<f64>() / grid.positions.len() as f64
    };
    let (once, often) = (mean_square(&[]), mean_square(&[8.0, 4.0, 2.0]));
    assert!(often < 0.95 * once, "{often} and {once}");
}

#[test]
fn importance_keeps_part_of_a_chart_finer() {
    let grid = hilly_grid(33, 0.1);
    let importance: Vec<f32> = grid.positions.iter().map(|p| if p.x < 0.5 { 100.0 } else { 1.0 }).collect();
    let options = SimplifyOptions { thresholds: &[0.005], importance: Some(&importance), ..Default::default() };
    let result = simplify_chart(&grid, &options);
    let patch = result.levels[0].as_ref().expect("nothing is stuck");
    let left = patch.interior.iter().filter(|p| p.x < 0.5).count();
    assert!(left > 2 * (patch.interior.len() - left), "{left} of {}", patch.interior.len());
}

#[test]
fn a_later_attempt_repeats_all_but_what_became_important() {
    for chart in [hilly_grid(33, 0.1), annulus(), handle(), sphere(20, 40)] {
        let thresholds = [0.02, 0.005];
        let attempt = |importance: &[f32], early: &mut Option<Early>| {
            let options =
                SimplifyOptions { thresholds: &thresholds, importance: Some(importance), ..Default::default() };
            let result = simplify_again(&chart, &options, Some(early));
            check_levels(&chart, &result);
            result.levels[1].clone().expect("nothing is stuck")
        };
        let mut early = None;
        let first = attempt(&[], &mut early);
        let merges = early.as_ref().map_or(0, |early| early.merges.len());
        assert!(merges > 0);
        let middle = chart.positions.iter().sum::<DVec3>() / chart.positions.len() as f64;
        let is_left = |p: &DVec3| p.x < middle.x;
        let importance: Vec<f32> = chart.positions.iter().map(|p| if is_left(p) { 100.0 } else { 1.0 }).collect();
        let second = attempt(&importance, &mut early);
        assert_eq!(early.as_ref().map_or(0, |early| early.merges.len()), merges, "it is that of the first attempt");
        let sides = |patch: &LevelPatch| {
            let left = patch.interior.iter().filter(|p| is_left(p)).count();
            [left, patch.interior.len() - left]
        };
        let ([left, right], [finer, same]) = (sides(&first), sides(&second));
        assert!(2 * finer >= 3 * left && same.abs_diff(right) <= 4 + right / 4, "{left} {right} {finer} {same}");
    }
}

#[test]
fn a_loop_without_enough_samples_is_reported() {
    let mut disk = hilly_grid(9, 0.1);
    disk.loops[0].iter_mut().skip(1).for_each(|b| b.level = 1);
    let result = simplify(&disk, &[0.1, 0.01]);
    assert!(result.levels[0].is_none() && result.levels[1].is_some());
    assert!(result.stuck.len() >= 2 && result.stuck.iter().all(|s| s.level == 0));
}

#[test]
fn chords_and_enclosed_vertices_do_not_block_the_border() {
    // Vertex 0 must go. A chord connects its neighbours 1 and 3, and with it encloses vertex 2.
    let positions = [[0., 0.], [2., 0.], [0.7, 0.7], [0., 2.], [2., 2.]].map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
    let mut chart = chart(positions, vec![[0, 1, 2], [0, 2, 3], [1, 3, 2], [1, 4, 3]], 4);
    chart.loops[0].iter_mut().for_each(|b| b.level = if b.vertex == 0 { NEVER } else { 0 });
    let result = simplify(&chart, &[0.0]);
    assert_eq!(result.stuck, []);
    assert_eq!(result.levels[0].as_ref().map(|l| l.triangles.len()), Some(1));
}

#[test]
fn the_same_input_gives_the_same_levels() {
    let chart = handle();
    assert_eq!(simplify(&chart, &[0.05, 0.01, 0.002]), simplify(&chart, &[0.05, 0.01, 0.002]));
}

#[test]
fn a_chart_that_is_not_a_manifold_has_no_levels() {
    let mut broken = hilly_grid(9, 0.1);
    broken.loops[0].pop();
    let result = simplify_chart(&broken, &SimplifyOptions { thresholds: &[1.0], ..Default::default() });
    assert_eq!(result, SimplifiedChart { levels: vec![None], stuck: vec![] });
}

#[test]
fn lines_at_which_colours_jump_stay_where_they_are() {
    // A plane whose middle row of vertices is a wave.
    let n = 33;
    let mut grid = hilly_grid(n, 0.0);
    let wave = |x: f64| 0.5 + 0.15 * (x * TAU).sin();
    for p in &mut grid.positions {
        p.y += (1.0 - (p.y - 0.5).abs() * 2.0) * (wave(p.x) - 0.5);
    }
    let is_above = |t: &[u32; 3]| t.iter().map(|v| v / n).sum::<u32>() * 2 > 3 * (n - 1);
    let of_triangles: Vec<u32> = grid.triangles.iter().map(|t| if is_above(t) { 7 } else { 3 }).collect();
    let [none, one] = [vec![], vec![[3, 7]]].map(Jumps::new);
    let [without, with] = [none, one].map(|jumps| {
        let areas = Some(Areas { of_triangles: &of_triangles, jumps: &jumps });
        let options = SimplifyOptions { thresholds: &[0.004], areas, ..Default::default() };
        let result = simplify_chart(&grid, &options);
        let patch = result.levels[0].as_ref().expect("nothing is stuck");
        assert_eq!(patch.areas.len(), patch.triangles.len());
        let positions = positions_of(&grid, patch);
        let mut sides: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
        for (&[a, b, c], &area) in patch.triangles.iter().zip(&patch.areas) {
            for [p, q] in [[a, b], [b, c], [c, a]] {
                sides.entry([p.min(q), p.max(q)]).or_default().push(area);
            }
        }
        let line = sides.iter().filter(|(_, areas)| areas.len() == 2 && areas[0] != areas[1]);
        let inside = line.flat_map(|(edge, _)| edge.map(|v| positions[v as usize])).filter(|p| p.x > 0.0 && p.x < 1.0);
        let distances: Vec<f64> = inside.map(|p| (p.y - wave(p.x)).abs()).collect();
        assert!(patch.triangles.len() < 400, "{}", patch.triangles.len());
        distances.into_iter().fold(0.0, f64::max)
    });
    assert!(with < 0.01 && without > 0.03, "{with} {without}");
}
