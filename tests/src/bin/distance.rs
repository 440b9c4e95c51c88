//! Distances between two meshes, both ways, as JSON: RMS over the surface and an enclosed maximum.
//!
//! distance A B [--samples N]
//!
//! The RMS comes from N points spread evenly over each surface by area (default 300,000); the maximum from branch and bound,
//! since sampled maxima miss thin features.

use glam::DVec3;
use lodpack_cli::import::import_meshes;
use lodpack_cli::mesh::Mesh;
use lodpack_cli::progress::Silent;
use lodpack_cli::verify::distance::{BoxTree, Corners, largest_distances};
use rayon::prelude::*;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut paths = vec![];
    let mut samples = 300_000usize;
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        if arg == "--samples" {
            samples = args.next().ok_or("--samples wants a number")?.parse()?;
        } else {
            paths.push(arg.into());
        }
    }
    let [a, b] = <[std::path::PathBuf; 2]>::try_from(paths).map_err(|_| "usage: distance A B [--samples N]")?;
    let (a, b) = (import_meshes(&[a], &Silent)?, import_meshes(&[b], &Silent)?);
    let (ta, tb) = (corners(&a), corners(&b));
    let (tree_a, tree_b) = (BoxTree::new(&ta), BoxTree::new(&tb));
    let (ab, ba) = (rms(&ta, &tree_b, samples), rms(&tb, &tree_a, samples));
    let (max_ab, max_ba) = (largest(&ta, &tree_b), largest(&tb, &tree_a));
    let report = serde_json::json!({
        "mean_edge_a": a.mean_edge_length(),
        "triangles_a": ta.len(), "triangles_b": tb.len(),
        "rms_ab": ab, "rms_ba": ba,
        "max_ab": [max_ab.0, max_ab.1], "max_ba": [max_ba.0, max_ba.1],
    });
    println!("{report}");
    Ok(())
}

fn corners(mesh: &Mesh) -> Vec<Corners> {
    (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t)).collect()
}

/// Runs of triangles are searched side by side; a run's bounds do not depend on the others.
fn largest(from: &[Corners], to: &BoxTree) -> (f64, f64) {
    let runs: Vec<Vec<Corners>> = from.chunks(from.len().div_ceil(64).max(1)).map(<[Corners]>::to_vec).collect();
    let found = largest_distances(&runs, to, 0.02, 0.0, &[]);
    found.iter().fold((0.0, 0.0), |m, e| (m.0.max(e.lower), m.1.max(e.upper)))
}

/// Stratified over area: sample i lies where the running area passes (i + 1/2) / n of the whole.
fn rms(from: &[Corners], to: &BoxTree, samples: usize) -> f64 {
    let mut running = Vec::with_capacity(from.len());
    let mut total = 0.0;
    for [a, b, c] in from {
        total += (b - a).cross(c - a).length() * 0.5;
        running.push(total);
    }
    let squares: Vec<f64> = (0..samples)
        .collect::<Vec<_>>()
        .par_chunks(4096)
        .map(|chunk| {
            let mut hint = 0;
            let one = |&i: &usize| {
                let at = total * (i as f64 + 0.5) / samples as f64;
                let t = running.partition_point(|&r| r < at).min(from.len() - 1);
                let p = point_in(&from[t], i as u64);
                let (d, slot, _) = to.nearest(p, hint).unwrap_or((f64::INFINITY, 0, 0));
                hint = slot;
                d * d
            };
            chunk.iter().map(one).sum()
        })
        .collect();
    (squares.iter().sum::<f64>() / samples as f64).sqrt()
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
