//! `lodpack verify`: what a file claims, checked by code that shares nothing with the builder.

pub mod distance;
mod topology;

pub use topology::{EdgeReport, inspect_edges};

use crate::mesh::Mesh;
use crate::progress::Progress;
use distance::{BoxTree, Corners, Enclosure, largest_distances};
use glam::DVec3;
use lodpack::{Cut, File, Outside, Query, ReadAt};
use rayon::prelude::*;
use serde::Serialize;

/// How far the verifier narrows its own distances down.
const RELATIVE_GAP: f64 = 0.02;

/// What is checked, and how much.
#[derive(Clone, Debug)]
pub struct VerifyOptions {
    /// Number of random cuts.
    pub cuts: u32,
    /// Seed of the random cuts.
    pub seed: u64,
}

/// One finding that makes a file unsound.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Problem {
    /// Where: a level, a node, a cut.
    pub place: String,
    /// What is wrong there.
    pub what: String,
}

/// The stored errors of one level against measured ones.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LevelCheck {
    /// 0 is the coarsest.
    pub level: u8,
    /// Triangles of the level.
    pub triangles: u64,
    /// Largest stored error.
    pub stored: f64,
    /// Largest distance found, both ways (a distance that occurs).
    pub measured: f64,
    /// Stored over measured error, over the level's nodes: median.
    pub ratio_median: f64,
    /// Stored over measured error, over the level's nodes: largest.
    pub ratio_max: f64,
    /// Root mean square of the distance of the input's vertices to the level.
    pub vertex_rms: f64,
}

/// The outcome of a verification.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct VerifyReport {
    /// Everything that is wrong; empty for a sound file.
    pub problems: Vec<Problem>,
    /// Random cuts that were stitched and inspected.
    pub cuts: u32,
    /// Edges with more than two triangles over all cuts; thin surfaces may touch themselves.
    pub crowded_edges: u64,
    /// Boundary edges of the finest cut: the input's own boundary as sampled.
    pub boundary_edges: u64,
    /// Error checks by level, coarsest first; only against a mesh.
    pub levels: Vec<LevelCheck>,
    /// Median over all nodes and levels of stored over measured error.
    pub ratio_median: Option<f64>,
}

/// Checks a file; `against` is the repaired input.
///
/// # Errors
/// [`lodpack::Error`] where the file cannot be read at all; damage is a [`Problem`].
pub fn verify<R: ReadAt>(
    file: &File<R>,
    against: Option<&Mesh>,
    options: &VerifyOptions,
    progress: &dyn Progress,
) -> lodpack::Result<VerifyReport> {
    let mut report = VerifyReport::default();
    progress.begin("structure", 0);
    if let Err(error) = file.verify() {
        report.problem("file", &error.to_string());
        return Ok(report);
    }
    let level_count = file.level_count() as u8;
    let finest_cut = file.select(&Query::default())?;
    let finest = match file.extract(&finest_cut) {
        Ok(mesh) => mesh,
        Err(error) => {
            report.problem("finest level", &error.to_string());
            return Ok(report);
        }
    };
    report.boundary_edges = inspect_edges(&finest.triangles).boundary.len() as u64;

    progress.begin("cuts", u64::from(options.cuts));
    check_cuts(file, options, &mut report, progress)?;

    if let Some(mesh) = against {
        progress.begin("errors", u64::from(level_count));
        let triangles: Vec<Corners> = (0..mesh.triangles.len() as u32).map(|t| mesh.corners(t)).collect();
        let input = Input { tree: BoxTree::new(&triangles), triangles, mesh };
        let mut ratios = vec![];
        for level in 0..level_count {
            let cut = file.uniform_cut(level)?;
            check_level(file, &input, level, &cut, &mut report, &mut ratios)?;
            progress.advance(1);
        }
        report.ratio_median = median(&mut ratios);
    }
    Ok(report)
}

impl VerifyReport {
    fn problem(&mut self, place: &str, what: &str) {
        self.problems.push(Problem { place: place.into(), what: what.into() });
    }
}

/// A small generator whose sequence is fixed for ever.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        // splitmix64
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Random boxes, tolerances and budgets; every cut has to be closed but for the arcs that have no second root in it.
fn check_cuts<R: ReadAt>(
    file: &File<R>,
    options: &VerifyOptions,
    report: &mut VerifyReport,
    progress: &dyn Progress,
) -> lodpack::Result<()> {
    let mut random = Random(options.seed);
    let Some([low, high]) = file.bounds().map(|bounds| bounds.map(DVec3::from_array)) else { return Ok(()) };
    let (coarsest, finest) = (file.uniform_cut(0)?, file.uniform_cut(file.level_count() as u8 - 1)?);
    for number in 0..options.cuts {
        let mut query = Query::default();
        if random.unit() < 0.5 {
            let centre = low + (high - low) * DVec3::new(random.unit(), random.unit(), random.unit());
            let half = (high - low) * (0.02 + 0.5 * random.unit());
            query.region = Some([(centre - half).to_array(), (centre + half).to_array()]);
            query.outside = if random.unit() < 0.5 { Outside::Drop } else { Outside::Coarsest };
        }
        if random.unit() < 0.6 {
            let (small, large) = (finest.error.max(1e-300), coarsest.error.max(1e-300) * 1.5);
            query.tolerance = Some(small * (large / small).powf(random.unit()));
        }
        if random.unit() < 0.6 {
            let (few, many) = (coarsest.triangle_count as f64, finest.triangle_count as f64 * 1.2);
            query.max_triangles = Some((few * (many / few.max(1.0)).powf(random.unit())).ceil() as u64);
        }
        let place = || format!("random cut {number} ({query:?})");
        match file.select(&query) {
            Ok(cut) => {
                if query.max_triangles.is_some_and(|limit| cut.triangle_count > limit) {
                    report.problem(&place(), &format!("{} triangles, above its budget", cut.triangle_count));
                }
                if let Some(tolerance) = query.tolerance
                    && cut.error > tolerance
                    && cut.triangle_count < query.max_triangles.unwrap_or(u64::MAX)
                    && query.max_triangles.is_none()
                    && cut.error > finest.error
                {
                    report.problem(&place(), &format!("error {} above its tolerance", cut.error));
                }
                check_cut(file, &cut, &place, report);
            }
            // A box may miss everything, and a budget may be below the coarsest cut: both are answers.
            Err(lodpack::Error::Query { .. }) => {}
            Err(error) => report.problem(&place(), &error.to_string()),
        }
        report.cuts += 1;
        progress.advance(1);
    }
    Ok(())
}

fn check_cut<R: ReadAt>(file: &File<R>, cut: &Cut, place: &dyn Fn() -> String, report: &mut VerifyReport) {
    let mesh = match file.extract(cut) {
        Ok(mesh) => mesh,
        Err(error) => return report.problem(&place(), &error.to_string()),
    };
    let edges = inspect_edges(&mesh.triangles);
    if mesh.triangles.len() as u64 != cut.triangle_count {
        report.problem(
            &place(),
            &format!("{} triangles where {} were promised", mesh.triangles.len(), cut.triangle_count),
        );
    }
    if edges.repeated + edges.degenerate > 0 {
        report.problem(&place(), &format!("{} triangles twice, {} degenerate", edges.repeated, edges.degenerate));
    }
    let expected = match file.boundary_edge_count(cut) {
        Ok(count) => count,
        Err(error) => return report.problem(&place(), &error.to_string()),
    };
    if edges.boundary.len() as u64 != expected {
        report.problem(&place(), &format!("{} boundary edges where {expected} are due", edges.boundary.len()));
    }
    report.crowded_edges += edges.crowded;
}

struct Input<'a> {
    mesh: &'a Mesh,
    triangles: Vec<Corners>,
    tree: BoxTree,
}

/// Measures both directions and compares them with the stored errors, node by node.
///
/// Drawn to input: the largest distance of each node's triangles from the input must not exceed the node's error.
/// Input to drawn: each input triangle counts for the node that its middle is nearest to; the distance must not exceed
/// the largest error among the nodes whose box holds the triangle (the box covers the node's piece of input).
fn check_level<R: ReadAt>(
    file: &File<R>,
    input: &Input,
    level: u8,
    cut: &Cut,
    report: &mut VerifyReport,
    ratios: &mut Vec<f64>,
) -> lodpack::Result<()> {
    let drawn = file.extract(cut)?;
    let corners = |t: &[u32; 3]| t.map(|v| DVec3::from_array(drawn.positions[v as usize]));
    let mut drawn_by_node: Vec<Vec<Corners>> = vec![vec![]; cut.nodes.len()];
    for (triangle, &node) in drawn.triangles.iter().zip(&drawn.triangle_nodes) {
        drawn_by_node[node as usize].push(corners(triangle));
    }
    let floor = cut.error * 1e-6;
    let forward = largest_distances(&drawn_by_node, &input.tree, RELATIVE_GAP, floor, &cut.node_errors);

    let drawn_triangles: Vec<Corners> = drawn.triangles.iter().map(corners).collect();
    let drawn_tree = BoxTree::new(&drawn_triangles);
    let nearest_node: Vec<(u32, f64)> = input
        .triangles
        .par_chunks(4096)
        .flat_map_iter(|chunk| {
            let mut hint = 0;
            let near: Vec<(u32, f64)> = chunk
                .iter()
                .map(|t| match drawn_tree.nearest((t[0] + t[1] + t[2]) / 3.0, hint) {
                    Some((d, slot, triangle)) => {
                        hint = slot;
                        (drawn.triangle_nodes[triangle as usize], d)
                    }
                    None => (0, f64::INFINITY),
                })
                .collect();
            near
        })
        .collect();
    let mut input_by_node: Vec<Vec<Corners>> = vec![vec![]; cut.nodes.len()];
    for (triangle, &(node, _)) in input.triangles.iter().zip(&nearest_node) {
        input_by_node[node as usize].push(*triangle);
    }
    let backward = largest_distances(&input_by_node, &drawn_tree, RELATIVE_GAP, floor, &cut.node_errors);

    let stored = cut.node_errors.clone();
    let tolerance_of_measurement = 1e-9 * cut.error;
    let level_maximum = stored.iter().copied().fold(0.0, f64::max);
    let mut level_ratios = vec![];
    let mut measured = 0.0f64;
    for node in 0..cut.nodes.len() {
        let (f, b): (Enclosure, Enclosure) = (forward[node], backward[node]);
        let place = || format!("level {level}, root {}", cut.nodes[node].root);
        if f.lower > stored[node] + tolerance_of_measurement {
            report.problem(&place(), &format!("stores error {} but lies {} off the input", stored[node], f.lower));
        }
        if b.lower > stored[node] + tolerance_of_measurement {
            // The farthest input point may belong to a neighbour's piece: only the nodes around it can answer for it.
            let allowed = largest_error_around(file, cut, &input_by_node[node], &stored);
            if b.lower > allowed + tolerance_of_measurement {
                report.problem(&place(), &format!("errors up to {allowed} but the input lies {} off", b.lower));
            }
        }
        let truth = f.lower.max(b.lower);
        measured = measured.max(truth);
        if truth > floor {
            level_ratios.push(stored[node] / truth);
        }
    }
    let squares: Vec<f64> = input
        .mesh
        .positions
        .par_chunks(4096)
        .map(|chunk| {
            let mut hint = 0;
            let distance = |p: &DVec3| {
                let (d, slot, _) = drawn_tree.nearest(*p, hint).unwrap_or((f64::INFINITY, 0, 0));
                hint = slot;
                d * d
            };
            chunk.iter().map(distance).sum()
        })
        .collect();
    ratios.extend(&level_ratios);
    report.levels.push(LevelCheck {
        level,
        triangles: drawn.triangles.len() as u64,
        stored: level_maximum,
        measured,
        ratio_max: level_ratios.iter().copied().fold(0.0, f64::max),
        ratio_median: median(&mut level_ratios).unwrap_or(1.0),
        vertex_rms: (squares.iter().sum::<f64>() / input.mesh.positions.len().max(1) as f64).sqrt(),
    });
    Ok(())
}

fn largest_error_around<R: ReadAt>(file: &File<R>, cut: &Cut, pieces: &[Corners], stored: &[f64]) -> f64 {
    let mut hull = [DVec3::INFINITY, DVec3::NEG_INFINITY];
    for &p in pieces.iter().flatten() {
        hull = [hull[0].min(p), hull[1].max(p)];
    }
    cut.nodes
        .iter()
        .zip(stored)
        .filter(|(node, _)| {
            let Ok(bounds) = file.root_bounds(node.root) else { return false };
            let [low, high] = bounds.map(DVec3::from_array);
            low.cmple(hull[1]).all() && hull[0].cmple(high).all()
        })
        .map(|(_, &error)| error)
        .fold(0.0, f64::max)
}

fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f64::total_cmp);
    Some(values[values.len() / 2])
}
