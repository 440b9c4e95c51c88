//! Measures the distances between two meshes in both directions, as JSON: RMS over the surface and an enclosed maximum.
//!
//! distance A B [--samples N]
//!
//! The RMS uses N points spread evenly over each surface by area (default 300,000). The maximum comes from branch and
//! bound, because sampled maxima miss thin features.

use glam::DVec3;
use lodpack_cli::import::import_meshes;
use lodpack_cli::measure::verify::distance::{BoxTree, Corners, Goal, largest_distance};
use lodpack_cli::mesh::Mesh;
use lodpack_cli::progress::Silent;
use rayon::prelude::*;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut paths = vec![];
    let mut samples = 300_000usize;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        if arg == "--samples" {
            samples = args.next().ok_or("--samples needs a number")?.parse()?;
        } else {
            paths.push(arg.into());
        }
    }
    let [a, b] = <[std::path::PathBuf; 2]>::try_from(paths).map_err(|_| "usage: distance A B [--samples N]")?;
    let (a, b) = (import_meshes(&[a], &Silent)?, import_meshes(&[b], &Silent)?);
    let [tree_a, tree_b] = [&a, &b].map(|mesh| BoxTree::new(&mesh.positions, &mesh.triangles));
    let (ab, ba) = (rms(&a, &tree_a, &tree_b, samples), rms(&b, &tree_b, &tree_a, samples));
    let (max_ab, max_ba) = (largest(&a, &tree_a, &tree_b, ab.1), largest(&b, &tree_b, &tree_a, ba.1));
    let report = serde_json::json!({
        "mean_edge_a": a.mean_edge_length(),
        "triangles_a": a.triangles.len(), "triangles_b": b.triangles.len(),
        "rms_ab": ab.0, "rms_ba": ba.0,
        "max_ab": [max_ab.0, max_ab.1], "max_ba": [max_ba.0, max_ba.1],
    });
    println!("{report}");
    Ok(())
}

/// Lower and upper bound of the largest distance. `occurring` is a distance known to occur. Runs of triangles that are
/// near each other are searched in parallel.
fn largest(from: &Mesh, tree: &BoxTree, to: &BoxTree, occurring: f64) -> (f64, f64) {
    let triangles = tree.triangles();
    // With no claim, every run is searched to the end.
    let goal = Goal { floor: occurring.max(from.mean_edge_length() * 1e-6), claim: 0.0, ..Goal::default() };
    let runs: Vec<&[[u32; 3]]> = triangles.chunks(triangles.len().div_ceil(64).max(1)).collect();
    let found: Vec<_> = runs.par_iter().map(|run| largest_distance(&from.positions, run, to, &goal)).collect();
    found.iter().fold((occurring, 0.0), |m, e| (m.0.max(e.lower), m.1.max(e.upper)))
}

/// Root mean square and largest distance of samples, stratified over area: sample i lies where the accumulated area
/// passes (i + 1/2) / n of the total.
fn rms(from: &Mesh, tree: &BoxTree, to: &BoxTree, samples: usize) -> (f64, f64) {
    let corners = |t: usize| tree.triangles()[t].map(|v| from.positions[v as usize]);
    let mut running = Vec::with_capacity(from.triangles.len());
    let mut total = 0.0;
    for t in 0..from.triangles.len() {
        let [a, b, c] = corners(t);
        total += (b - a).cross(c - a).length() * 0.5;
        running.push(total);
    }
    let squares: Vec<(f64, f64)> = (0..samples)
        .collect::<Vec<_>>()
        .par_chunks(4096)
        .map(|chunk| {
            let mut hint = 0;
            let one = |&i: &usize| {
                let at = total * (i as f64 + 0.5) / samples as f64;
                let t = running.partition_point(|&r| r < at).min(running.len() - 1);
                let p = point_in(&corners(t), i as u64);
                let (d, slot, _) = to.nearest(p, hint).unwrap_or((f64::INFINITY, 0, 0));
                hint = slot;
                d * d
            };
            chunk.iter().map(one).fold((0.0, 0.0f64), |(sum, most), square| (sum + square, most.max(square)))
        })
        .collect();
    let (sum, most) = squares.iter().fold((0.0, 0.0f64), |all, chunk| (all.0 + chunk.0, all.1.max(chunk.1)));
    ((sum / samples as f64).sqrt(), most.sqrt())
}

/// The i-th point of a low-discrepancy sequence, folded into the triangle.
fn point_in([a, b, c]: &Corners, i: u64) -> DVec3 {
    let fraction = |k: u64| (i.wrapping_mul(k) >> 11) as f64 / (1u64 << 53) as f64;
    let (mut u, mut v) = (fraction(0xC13F_A9A9_02A6_328F), fraction(0x91E1_0DA5_C79E_7B1D));
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    *a + (*b - *a) * u + (*c - *a) * v
}
