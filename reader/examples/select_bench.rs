//! Prints how long it takes to choose a cut: from scratch, and frame by frame along a slow camera path.
//!
//! `cargo run --release -p lodpack --example select_bench`, with the name of a file to measure that file.
#![allow(clippy::disallowed_methods, reason = "cameras and pictures; no file depends on them")]

use std::{error::Error, sync::Arc, time::Instant};

use lodpack::{
    File, Limits, Outside, Query, View,
    select::{Adapter, Coherence, Hierarchy, HierarchyNode, Resolution, select_in},
};

const FRAMES: u32 = 500;

fn main() -> Result<(), Box<dyn Error>> {
    println!("   nodes  algorithm     cold ms  frame ms  worst ms  ratio  changes  evaluations");
    if let Some(name) = std::env::args().nth(1) {
        let file = File::open(std::fs::read(name)?, Limits::default())?;
        return measure(&Arc::new(file.hierarchy()?));
    }
    for side in [32, 100, 316] {
        measure(&plane(side)?)?;
    }
    Ok(())
}

/// A square of square nodes with seven levels each.
fn plane(side: u32) -> lodpack::Result<Arc<Hierarchy>> {
    let mut state = 1_u64;
    let mut random = move |end: u64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) % end
    };
    let vertical = side * (side + 1);
    let (mut nodes, mut sample_counts) = (Vec::new(), Vec::new());
    for _ in 0..2 * vertical {
        let mut count = 0;
        for level in 0..7 {
            count += random(1 + (1 << level)) as u32;
            sample_counts.push(count);
        }
    }
    for (x, y) in (0..side * side).map(|k| (k % side, k / side)) {
        let rough = 0.02 + random(1000) as f64 * random(1000) as f64 * 1e-6;
        let resolution = |level: u8| Resolution {
            level,
            error: rough * 0.25_f64.powi(i32::from(level)),
            border_deviation: rough * 0.25_f64.powi(i32::from(level)) * 0.3,
            triangle_count: 4 << (2 * level),
            pages: Vec::new(),
        };
        let low = [f64::from(x), f64::from(y), -rough];
        nodes.push(HierarchyNode {
            bounds: [low, [low[0] + 1.0, low[1] + 1.0, rough]],
            parent: None,
            resolutions: (0..7).map(resolution).collect(),
            borders: vec![y * side + x, (y + 1) * side + x, vertical + x * side + y, vertical + (x + 1) * side + y],
        });
    }
    Ok(Arc::new(Hierarchy::new(&nodes, sample_counts, 7, Vec::new())?))
}

fn measure(hierarchy: &Arc<Hierarchy>) -> Result<(), Box<dyn Error>> {
    let all = 0..hierarchy.node_count();
    let fold = |k: usize, side: usize, pick: fn(f64, f64) -> f64, start: f64| {
        all.clone().map(|node| hierarchy.bounds(node)[side][k]).fold(start, pick)
    };
    let low = [0, 1, 2].map(|k| fold(k, 0, f64::min, f64::INFINITY));
    let high = [0, 1, 2].map(|k| fold(k, 1, f64::max, f64::NEG_INFINITY));
    let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
    // A fortieth of the model a second at 60 frames a second, turning by 6 degrees a second.
    let start = View {
        position: [low[0] + size * 0.1, low[1] + size * 0.4, high[2] + size * 0.15],
        forward: [1.0, 0.0, -0.7],
        up: [0.0, 0.0, 1.0],
        near: size * 1e-5,
        ..View::default()
    };
    let view = |frame: u32| {
        let (mut view, t) = (start, f64::from(frame) / 60.0);
        view.position[0] += size * 0.025 * t;
        view.orbit(view.position, 0.1 * t, 0.0);
        view
    };
    // Everything is in sight, so the cut has all nodes.
    for (name, triangles_per_node) in [("dual-queue", None), ("quad-queue", Some(30))] {
        let query = |frame: u32| Query {
            view: Some(view(frame)),
            outside: Outside::Coarsest,
            max_triangles: triangles_per_node.map(|count| count * u64::from(hierarchy.node_count())),
            ..Query::default()
        };
        let start = Instant::now();
        let cut = select_in(hierarchy, &query(0))?;
        let cold = start.elapsed().as_secs_f64() * 1e3;
        let mut adapter = Adapter::new(Arc::clone(hierarchy), &query(0), Coherence::default())?;
        adapter.update(&query(0))?;
        let (mut total, mut worst, mut changes, mut evaluations) = (0.0, 0.0_f64, 0, 0);
        for frame in 1..=FRAMES {
            let query = query(frame);
            let start = Instant::now();
            let frame = adapter.update(&query)?;
            let time = start.elapsed().as_secs_f64() * 1e3;
            (total, worst) = (total + time, worst.max(time));
            changes += frame.changes.len();
            evaluations += frame.evaluation_count;
        }
        let mean = total / f64::from(FRAMES);
        println!(
            "{:8}  {name}  {cold:9.2}  {mean:8.3}  {worst:8.3}  {:5.0}  {:7.1}  {:8}   {:?} {} triangles",
            cut.nodes.len(),
            cold / mean,
            changes as f64 / f64::from(FRAMES),
            evaluations / u64::from(FRAMES),
            cut.limited_by,
            cut.triangle_count,
        );
    }
    Ok(())
}
