//! Properties of selection and fitting on small generated charts.

use glam::{DVec3, dvec3};
use lodpack::write::grid::GridShape;

use super::*;
use crate::chart::{BorderVertex, ChartMesh, NEVER};
use crate::embed::{EmbedOptions, Embedding, embed_chart};
use lodpack_mesh::{Adjacency, NONE};

/// Edges along a side of the square.
const SIZE: u32 = 64;

/// A square of 2 x 64 x 64 triangles with a height. So far only its corners are samples; all other border vertices can
/// become samples.
fn square(height: impl Fn(f64, f64) -> f64) -> (ChartMesh, Embedding) {
    let row = SIZE + 1;
    let id = |x: u32, y: u32| y * row + x;
    let mut chart = ChartMesh::default();
    for y in 0..row {
        for x in 0..row {
            let (x, y) = (x as f64 / SIZE as f64, y as f64 / SIZE as f64);
            chart.positions.push(dvec3(x, y, height(x, y)));
        }
    }
    for y in 0..SIZE {
        for x in 0..SIZE {
            let [a, b, c, d] = [id(x, y), id(x + 1, y), id(x + 1, y + 1), id(x, y + 1)];
            chart.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let side_vertex = |side: u32, k: u32| match side {
        0 => id(k, 0),
        1 => id(SIZE, k),
        2 => id(SIZE - k, SIZE),
        _ => id(0, SIZE - k),
    };
    let border = (0..4).flat_map(|side| (0..SIZE).map(move |k| (side, k)));
    let border = border.map(|(side, k)| BorderVertex {
        vertex: side_vertex(side, k),
        side,
        param: k as f64 / SIZE as f64,
        level: if k == 0 { 0 } else { NEVER },
    });
    chart.loops = vec![border.collect()];
    let embedding = embed_chart(&chart, &EmbedOptions::default()).unwrap();
    (chart, embedding)
}

fn bump(x: f64, y: f64) -> f64 {
    0.3 * (-20.0 * ((x - 0.4).powi(2) + (y - 0.6).powi(2))).exp()
}

fn options() -> SelectOptions {
    SelectOptions { thresholds: vec![0.03, 0.01, 0.003, 0.001] }
}

fn planned() -> (ChartMesh, Embedding, GridPlan) {
    let (mut chart, embedding) = square(bump);
    let plan = select_cells(&chart, &embedding.uv, &options()).unwrap();
    demand_samples(&mut chart, &plan.demanded);
    (chart, embedding, plan)
}

#[test]
fn a_plane_is_one_polygon_at_every_level() {
    let (chart, embedding) = square(|x, y| 0.5 * x - y);
    let plan = select_cells(&chart, &embedding.uv, &options()).unwrap();
    assert!(plan.levels.iter().all(|l| l.shape == GridShape::Polygon && l.splits.is_empty() && l.triangle_count == 2));
    assert!(plan.demanded.is_empty());
    let fitted = fit_positions(&chart, &embedding, &plan, &FitOptions::default()).unwrap();
    assert!(fitted.positions.is_empty());
}

#[test]
fn errors_fall_below_their_thresholds_level_by_level() {
    let (chart, embedding, plan) = planned();
    let fitted = fit_positions(&chart, &embedding, &plan, &FitOptions::default()).unwrap();
    let errors = level_errors(&chart, &embedding, &plan, &fitted.positions).unwrap();
    for (error, threshold) in errors.iter().zip(options().thresholds) {
        assert!(*error < 1.5 * threshold, "{errors:?}");
    }
    assert!(errors.windows(2).all(|e| e[1] < 0.7 * e[0]), "{errors:?}");
}

#[test]
fn fitting_beats_sampling() {
    let (chart, embedding, plan) = planned();
    let errors = |rounds| {
        let options = FitOptions { rounds, coarse_weight: 0.0, ..FitOptions::default() };
        let fitted = fit_positions(&chart, &embedding, &plan, &options).unwrap();
        *level_errors(&chart, &embedding, &plan, &fitted.positions).unwrap().last().unwrap()
    };
    assert!(errors(4) < errors(0));
}

#[test]
fn every_level_of_a_plan_is_a_watertight_patch_with_exactly_its_samples() {
    let (chart, embedding, plan) = planned();
    assert!(plan.levels.iter().map(|l| l.splits.len()).sum::<usize>() > 20);
    let fitted = fit_positions(&chart, &embedding, &plan, &FitOptions::default()).unwrap();
    let lattice = |p: DVec3| (p * 1e6).to_array().map(|c| c.round() as i64);
    let positions: Vec<_> = fitted.positions.iter().map(|&p| lattice(p)).collect();
    for (level, mut state) in grid_states(&plan).unwrap().into_iter().enumerate() {
        assert!(fitted.sites.starts_with(state.sites()));
        state.set_positions(&positions);
        let patch = state.patch(&grid_sides(&chart, level as u8, lattice)).unwrap();
        let samples = chart.loops[0].iter().filter(|v| v.level as usize <= level).count();
        assert_eq!(patch.border_count as usize, samples);
        let vertex_count = samples + patch.interior.len();
        let open = Adjacency::new(&patch.triangles, vertex_count).opposite.iter().filter(|&&o| o == NONE).count();
        assert_eq!(open, samples);
        assert_eq!(patch.triangles.len(), 2 * vertex_count - 2 - samples);
    }
}

#[test]
fn cells_split_only_where_the_border_has_vertices() {
    let (mut chart, embedding) = square(bump);
    // Only every eighth vertex can be a sample.
    chart.loops[0].iter_mut().for_each(|v| {
        let k = (v.param * SIZE as f64) as u32;
        v.param += if k.is_multiple_of(8) { 0.0 } else { 1e-7 };
    });
    let plan = select_cells(&chart, &embedding.uv, &SelectOptions { thresholds: vec![0.01, 1e-5] }).unwrap();
    assert!(plan.demanded.iter().all(|d| d.1.is_multiple_of(65536 / 8)));
    assert!(plan.demanded.windows(2).all(|d| (d[0].0, d[0].1) < (d[1].0, d[1].1)));
    demand_samples(&mut chart, &plan.demanded);
    for (level, state) in grid_states(&plan).unwrap().iter().enumerate() {
        state.patch(&grid_sides(&chart, level as u8, |_| [0; 3])).unwrap();
    }
}

#[test]
fn charts_that_are_not_disks_have_no_plan() {
    let mut chart = square(bump).0;
    chart.loops.push(chart.loops[0].clone());
    assert!(select_cells(&chart, &[], &options()).is_none());
    chart.loops.clear();
    assert!(select_cells(&chart, &[], &options()).is_none());
}
