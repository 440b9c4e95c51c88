//! Surfaces of another topology: closed ones [resampled](lodpack_stage::resample), any with [clustered
//! vertices](lodpack_stage::cluster_vertices).

use super::collapsed::collapsed;
use super::surface::filled;
use lodpack_mesh::Mesh;
use lodpack_mesh::union_find::count_components;
use lodpack_runtime::trace;
use lodpack_stage::chart::ChartMesh;
use lodpack_stage::cluster_vertices::{cluster_vertices, has_more_triangles};
use lodpack_stage::resample::{Shape, Solid};
use rayon::prelude::*;

/// Edge collapse does harm once it has fewer triangles than this per handle and per component.
const TRIANGLES_A_HANDLE: usize = 60;
const TRIANGLES_A_PART: usize = 12;
/// The fewest triangles to which parts are resampled where nothing else is possible.
const LEAST_A_PART: usize = 4;
/// A surface that may have fewer than this many times the triangles that its topology needs is also tried with another
/// topology.
pub(crate) const CROWDED: usize = 3;
/// Lattices that are tried for a new topology, the finest first: cells along the longest side.
const LATTICES: [usize; 9] = [192, 128, 96, 64, 48, 32, 24, 16, 8];
/// How many of the lattices on which the surface is simple enough are tried to the end.
const LATTICES_TRIED: usize = 2;
/// The most triangles before simplification: this many per triangle that is asked for, and always the number below.
const RESAMPLED_PER_TRIANGLE: usize = 60;
const MIN_RESAMPLED: usize = 120_000;
/// Halvings of the interval of cell sizes for clustering.
const CLUSTER_STEPS: usize = 12;
/// The smallest cells for clustering, as a share of the longest side of the box.
const FINEST_CLUSTERS: f64 = 1e-7;

/// About how many triangles a surface needs for its topology.
pub(crate) fn needed(chart: &ChartMesh) -> usize {
    let used = chart.positions.len() as i64;
    let half_edges = 3 * chart.triangles.len() as i64;
    let border: i64 = chart.loops.iter().map(|l| l.len() as i64).sum();
    let characteristic = used - (half_edges + border) / 2 + chart.triangles.len() as i64;
    let parts = count_components(chart.positions.len(), &chart.triangles);
    // characteristic = 2 parts - 2 handles - loops
    let handles = (2 * parts as i64 - chart.loops.len() as i64 - characteristic).max(0) / 2;
    TRIANGLES_A_HANDLE * handles as usize + TRIANGLES_A_PART * (parts + chart.loops.len())
}

/// The surface with all of its holes filled.
pub(crate) fn capped(chart: &ChartMesh) -> Mesh {
    let mut triangles = chart.triangles.clone();
    for border in &chart.loops {
        let vertices: Vec<u32> = border.iter().map(|b| b.vertex).collect();
        triangles.extend(filled(&vertices, &chart.positions).0);
    }
    Mesh { positions: chart.positions.clone(), triangles }
}

/// The solid on the finest lattices on which it is simple enough, simplified.
pub(crate) fn resampled(whole: &Mesh, triangles: usize) -> Vec<Mesh> {
    let most = (RESAMPLED_PER_TRIANGLE * triangles).max(MIN_RESAMPLED);
    let (mut simple, mut crowded) = (vec![], vec![]);
    let on_lattice = |&cells: &usize| {
        let _pass = trace::pass("lattice");
        let solid = Solid::new(whole, cells)?;
        let shape = solid.shape();
        Some((solid, shape))
    };
    let mut left = &LATTICES[..];
    while simple.len() < LATTICES_TRIED && !left.is_empty() {
        // At least as many are missing.
        let (next, later) = left.split_at((LATTICES_TRIED - simple.len()).min(left.len()));
        left = later;
        let of_all = trace::parallel("lattices");
        let made: Vec<Option<(Solid, Shape)>> = next.par_iter().map(on_lattice).collect();
        drop(of_all);
        for (solid, shape) in made.into_iter().flatten().filter(|(_, shape)| shape.triangles <= most) {
            let fits = |a_part| TRIANGLES_A_HANDLE * shape.handles + a_part * shape.components <= triangles;
            if fits(TRIANGLES_A_PART) {
                simple.push(solid);
            } else if fits(LEAST_A_PART) && crowded.len() < LATTICES_TRIED {
                crowded.push(solid);
            }
        }
    }
    let solids = if simple.is_empty() { crowded } else { simple };
    let _all = trace::parallel("solids");
    let drawn = solids.into_par_iter().filter_map(|solid| {
        let _pass = trace::pass("solid");
        let Mesh { positions, triangles: all } = solid.surface();
        collapsed(&ChartMesh { positions, triangles: all, loops: vec![] }, triangles)
    });
    drawn.collect()
}

/// Vertices clustered on the smallest cells that leave few enough triangles, as far as halving finds them. `mended`
/// makes of the clusters what is needed, perhaps with more triangles.
pub(crate) fn clustered(whole: &Mesh, triangles: usize, mended: impl Fn(Mesh) -> Option<Mesh>) -> Option<Mesh> {
    let [low, high] = whole.bounds();
    let longest = (high - low).max_element();
    // Halving the ratio of the two: geometrically, since sizes range over many orders of magnitude.
    let (mut fine, mut coarse) = (longest * FINEST_CLUSTERS, longest * (1.0 + 1e-6));
    let mut best = None;
    for _ in 0..CLUSTER_STEPS {
        let middle = (fine * coarse).sqrt();
        let is_small = |mesh: &Mesh| mesh.triangles.len() <= triangles;
        let is_fine = has_more_triangles(whole, middle, triangles);
        let mesh = (!is_fine).then(|| cluster_vertices(whole, middle));
        let mesh = mesh.filter(is_small).and_then(&mended).filter(is_small);
        match mesh {
            None => fine = middle,
            Some(mesh) => {
                coarse = middle;
                best = Some(mesh).filter(|mesh| !mesh.triangles.is_empty()).or(best);
            }
        }
    }
    best
}
