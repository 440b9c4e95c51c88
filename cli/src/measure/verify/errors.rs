//! Checks stored errors against measured distances, node by node.

use super::cuts::RandomQueries;
use super::distance::{BoxTree, Enclosure, Goal, largest_distance};
use super::{LevelCheck, VerifyOptions, VerifyReport};
use crate::mesh::Mesh;
use crate::progress::Progress;
use glam::DVec3;
use lodpack::{Cut, File, Outside, ReadAt};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// How tightly distances are enclosed.
const RELATIVE_GAP: f64 = 0.01;
/// Distances below this share of the stored error are not resolved.
const FLOOR: f64 = 0.01;
/// Rounding of the measurement, relative to the largest error of the level.
const ROUNDING: f64 = 1e-9;
/// The most points over which the root mean square is taken.
const RMS_POINTS: usize = 100_000;
/// Of this many random cuts one is measured too, but never fewer than [`MIN_MEASURED_CUTS`] if there are that many.
const MEASURED_CUTS: u32 = 100;
const MIN_MEASURED_CUTS: u32 = 4;
/// A model is far from the origin if its coordinates are this many times larger than it is.
const FAR: f64 = 16.0;
/// Triangles or points that share a hint.
const RUN: usize = 4096;

/// The input, with its triangles sorted by root. A triangle belongs to the root whose finest drawing is nearest to its
/// middle.
struct Input<'a> {
    /// Relative to the origin.
    positions: &'a [DVec3],
    origin: DVec3,
    tree: BoxTree<'a>,
    triangles: Vec<[u32; 3]>,
    /// Ranges of `triangles` of each root, ascending: of a group those of all leaves below.
    roots: Vec<Vec<Range<usize>>>,
    /// Box of each root, which contains the root's part of the input.
    boxes: Vec<[DVec3; 2]>,
}

/// Compares the stored errors of every level and of some random cuts with measured ones, in both directions.
///
/// Drawn to input: the largest distance of a node's triangles from the input must not exceed the node's error. Input to
/// drawn: each triangle of the input belongs to one root and must not be farther away than the error of its node. A
/// file does not say which root that is; the nearest at the finest level is almost always right. If a triangle exceeds
/// the error of its node, it may belong to another root whose box it touches.
pub(super) fn check_errors<R: ReadAt + Sync>(
    file: &File<R>,
    mesh: &Mesh,
    options: &VerifyOptions,
    report: &mut VerifyReport,
    progress: &dyn Progress,
) -> lodpack::Result<()> {
    let level_count = file.level_count() as u8;
    let Some(finest) = level_count.checked_sub(1) else { return Ok(()) };
    let origin = far_origin(mesh);
    let local: Cow<[DVec3]> = match origin {
        DVec3::ZERO => Cow::Borrowed(&mesh.positions),
        _ => mesh.positions.iter().map(|&p| p - origin).collect(),
    };
    let input = Input::new(file, (&local, &mesh.triangles), origin, &file.uniform_cut(finest)?)?;
    let mut ratios = vec![];
    for level in 0..level_count {
        let cut = file.uniform_cut(level)?;
        let check = check_nodes(file, &input, &cut, &format!("level {level}"), report)?;
        let mut level_ratios = check.ratios;
        ratios.extend(&level_ratios);
        report.levels.push(LevelCheck {
            level,
            triangles: cut.triangle_count,
            stored: cut.error_everywhere(),
            measured: check.largest,
            ratio_max: level_ratios.iter().copied().fold(0.0, f64::max),
            ratio_median: median(&mut level_ratios).unwrap_or(1.0),
            vertex_rms: check.vertex_rms,
        });
        progress.advance(1);
    }
    report.ratio_median = median(&mut ratios);

    // Cuts of several levels, because errors include what a finer neighbour moves at a border.
    let Some(mut queries) = RandomQueries::new(file, options.seed)? else { return Ok(()) };
    for number in 0..options.cuts.min(MIN_MEASURED_CUTS.max(options.cuts / MEASURED_CUTS)) {
        let mut query = queries.next();
        query.outside = Outside::Coarsest;
        if let Ok(cut) = file.select(&query) {
            check_nodes(file, &input, &cut, &format!("measured cut {number} ({query:?})"), report)?;
            report.measured_cuts += 1;
        }
    }
    Ok(())
}

/// An origin for a model that is far from the origin of coordinates. Points between its vertices would be rounded as
/// coarsely as those are. Relative to an origin that differs from them by exact numbers, they are not. Zero for other
/// models.
fn far_origin(mesh: &Mesh) -> DVec3 {
    let [low, high] = mesh.bounds();
    let far = low.abs().max(high.abs()).max_element() > FAR * (high - low).max_element();
    if far { low } else { DVec3::ZERO }
}

/// Vertices of a drawn mesh relative to an origin.
fn local_positions(drawn: &lodpack::Mesh, origin: DVec3) -> Vec<DVec3> {
    drawn.positions.iter().map(|&p| DVec3::from_array(p) - origin).collect()
}

impl<'a> Input<'a> {
    fn new<R: ReadAt + Sync>(
        file: &File<R>,
        (mesh_positions, mesh_triangles): (&'a [DVec3], &[[u32; 3]]),
        origin: DVec3,
        finest: &Cut,
    ) -> lodpack::Result<Self> {
        let tree = BoxTree::new(mesh_positions, mesh_triangles);
        let drawn = file.extract(finest)?;
        let positions = local_positions(&drawn, origin);
        let drawn_tree = BoxTree::new(&positions, &drawn.triangles);
        let root_of = |run: &[[u32; 3]]| -> Vec<u32> {
            let mut hint = 0;
            let mut root = |t: &[u32; 3]| {
                let [a, b, c] = t.map(|v| mesh_positions[v as usize]);
                drawn_tree.nearest((a + b + c) / 3.0, hint).map_or(0, |(_, slot, triangle)| {
                    hint = slot;
                    finest.nodes[drawn.triangle_nodes[triangle as usize] as usize].root
                })
            };
            run.iter().map(&mut root).collect()
        };
        let roots: Vec<u32> = tree.triangles().par_chunks(RUN).flat_map_iter(root_of).collect();

        let root_count = file.root_count() as usize;
        let mut starts = vec![0usize; root_count + 1];
        for &root in &roots {
            starts[root as usize + 1] += 1;
        }
        for root in 0..root_count {
            starts[root + 1] += starts[root];
        }
        let own: Vec<Range<usize>> = starts.windows(2).map(|w| w[0]..w[1]).collect();
        let mut ranges: Vec<Vec<Range<usize>>> = vec![vec![]; root_count];
        // Children come after their parents.
        for root in (0..root_count).rev() {
            let mut all: Vec<Range<usize>> =
                Some(own[root].clone()).filter(|own| !own.is_empty()).into_iter().collect();
            for child in file.children(root as u32)? {
                all.extend_from_slice(&ranges[child as usize]);
            }
            all.sort_unstable_by_key(|range| range.start);
            all.dedup_by(|next, range| {
                let follows = range.end == next.start;
                range.end = if follows { next.end } else { range.end };
                follows
            });
            ranges[root] = all;
        }
        let mut triangles = vec![[0; 3]; roots.len()];
        for (triangle, &root) in tree.triangles().iter().zip(&roots) {
            triangles[starts[root as usize]] = *triangle;
            starts[root as usize] += 1;
        }
        let boxes = (0..file.root_count())
            .map(|root| Ok(file.root_bounds(root)?.map(|p| DVec3::from_array(p) - origin)))
            .collect::<lodpack::Result<_>>()?;
        Ok(Self { positions: mesh_positions, origin, tree, triangles, roots: ranges, boxes })
    }

    /// The triangles of a root: of a group those of all leaves below.
    fn triangles_of(&self, root: u32) -> Cow<'_, [[u32; 3]]> {
        match self.roots[root as usize].as_slice() {
            [only] => Cow::Borrowed(&self.triangles[only.clone()]),
            ranges => {
                ranges.iter().flat_map(|range| &self.triangles[range.clone()]).copied().collect::<Vec<_>>().into()
            }
        }
    }
}

/// The measurements of a node.
struct Measured {
    forward: Enclosure,
    backward: Enclosure,
    /// A triangle's distance that exceeds the error of every root near it, and the largest of those errors.
    excess: Option<(Enclosure, f64)>,
}

/// The measurements of a cut.
struct CutCheck {
    /// Stored over measured error of each node.
    ratios: Vec<f64>,
    /// The largest distance found.
    largest: f64,
    vertex_rms: f64,
}

fn check_nodes<R: ReadAt + Sync>(
    file: &File<R>,
    input: &Input,
    cut: &Cut,
    cut_name: &str,
    report: &mut VerifyReport,
) -> lodpack::Result<CutCheck> {
    let drawn = file.extract(cut)?;
    let positions = local_positions(&drawn, input.origin);
    let drawn_tree = BoxTree::new(&positions, &drawn.triangles);
    let rounding = ROUNDING * cut.error;
    // The triangles of a cut are sorted by node.
    let drawn_range = |node: usize| {
        let begin = drawn.triangle_nodes.partition_point(|&n| (n as usize) < node);
        begin..drawn.triangle_nodes.partition_point(|&n| n as usize <= node)
    };
    let measure = |node: usize| {
        let stored = cut.node_errors[node];
        let goal = Goal { relative_gap: RELATIVE_GAP, floor: stored * FLOOR, claim: stored + rounding };
        let triangles = input.triangles_of(cut.nodes[node].root);
        let mut backward = largest_distance(input.positions, &triangles, &drawn_tree, &goal);
        let mut excess = None;
        if backward.lower > goal.claim {
            (backward, excess) = attribute(input, &triangles, &drawn_tree, cut, &goal, rounding);
        }
        let forward = largest_distance(&positions, &drawn.triangles[drawn_range(node)], &input.tree, &goal);
        Measured { forward, backward, excess }
    };
    let nodes: Vec<Measured> = (0..cut.nodes.len()).into_par_iter().map(measure).collect();

    let (mut ratios, mut largest) = (vec![], 0.0f64);
    for (node, measured) in nodes.iter().enumerate() {
        let (stored, Measured { forward, backward, excess }) = (cut.node_errors[node], measured);
        let location = || format!("{cut_name}, root {}", cut.nodes[node].root);
        if forward.lower > stored + rounding {
            let (lower, at) = (forward.lower, forward.at + input.origin);
            report.problem(&location(), &format!("stores error {stored} but is {lower} away from the input at {at}"));
        } else if forward.upper > stored + rounding {
            report.unproven_nodes += 1;
        }
        if let Some((distance, allowed)) = excess {
            let (lower, at) = (distance.lower, distance.at + input.origin);
            if lower > allowed + rounding {
                report.problem(&location(), &format!("errors up to {allowed} but the input is {lower} away at {at}"));
            }
        }
        if backward.upper > stored + rounding {
            report.unproven_nodes += 1;
        }
        let truth = forward.lower.max(backward.lower);
        largest = largest.max(truth).max(excess.as_ref().map_or(0.0, |e| e.0.lower));
        if truth > rounding {
            ratios.push(stored / truth);
        }
    }
    report.nodes += cut.nodes.len() as u64;
    Ok(CutCheck { ratios, largest, vertex_rms: vertex_rms(input.positions, &drawn_tree) })
}

/// Examines, triangle by triangle, a root's part of the input that exceeds the error of its node. Triangles proven to
/// be nearer count for the node; for each of the others, some root whose box the triangle touches must allow the
/// distance.
fn attribute(
    input: &Input,
    triangles: &[[u32; 3]],
    drawn: &BoxTree,
    cut: &Cut,
    goal: &Goal,
    rounding: f64,
) -> (Enclosure, Option<(Enclosure, f64)>) {
    let (mut own, mut excess): (Enclosure, Option<(Enclosure, f64)>) = (Enclosure::default(), None);
    for triangle in triangles {
        let positions = input.positions;
        let one = std::slice::from_ref(triangle);
        // Distances below the known ones need no resolution.
        let known = Goal { floor: goal.floor.max(own.lower), ..*goal };
        let found = largest_distance(positions, one, drawn, &known);
        if found.lower <= goal.claim {
            if found.lower >= own.lower {
                (own.lower, own.at) = (found.lower, found.at);
            }
            own.upper = own.upper.max(found.upper);
            continue;
        }
        let corners = triangle.map(|v| positions[v as usize]);
        let hull = [corners.into_iter().reduce(DVec3::min), corners.into_iter().reduce(DVec3::max)];
        let touches = |root: u32| {
            let [low, high] = input.boxes[root as usize];
            hull[1].is_some_and(|h| low.cmple(h).all()) && hull[0].is_some_and(|l| l.cmple(high).all())
        };
        let around = cut.nodes.iter().zip(&cut.node_errors).filter(|(node, _)| touches(node.root));
        let allowed = around.map(|(_, &error)| error).fold(0.0, f64::max);
        let claim = Goal { claim: allowed + rounding, ..*goal };
        let found = largest_distance(positions, one, drawn, &claim);
        let over = |(e, allowed): &(Enclosure, f64)| e.lower - allowed;
        if excess.as_ref().is_none_or(|worst| over(&(found, allowed)) > over(worst)) {
            excess = Some((found, allowed));
        }
    }
    (own, excess)
}

/// Root mean square distance of evenly chosen vertices of the input.
fn vertex_rms(positions: &[DVec3], drawn: &BoxTree) -> f64 {
    let stride = positions.len().div_ceil(RMS_POINTS).max(1);
    let chosen: Vec<DVec3> = positions.iter().copied().step_by(stride).collect();
    let squares = |run: &[DVec3]| -> f64 {
        let mut hint = 0;
        let mut square = |p: &DVec3| {
            let (d, slot, _) = drawn.nearest(*p, hint).unwrap_or((f64::INFINITY, 0, 0));
            hint = slot;
            d * d
        };
        run.iter().map(&mut square).sum()
    };
    let sums: Vec<f64> = chosen.par_chunks(RUN).map(squares).collect();
    (sums.iter().sum::<f64>() / chosen.len().max(1) as f64).sqrt()
}

fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    values.sort_unstable_by(f64::total_cmp);
    Some(values[values.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::import_meshes;
    use crate::job::{BuildOptions, build};
    use crate::pipeline::ModelOptions;
    use crate::progress::Silent;
    use crate::stage::repair::repair;
    use std::fmt::Write;

    /// A rolling sheet as OBJ text, with 2 n^2 triangles.
    fn rolling_sheet(n: usize) -> String {
        let mut text = String::new();
        for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
            let (x, y) = (i as f64 / n as f64, j as f64 / n as f64);
            writeln!(text, "v {x} {y} {}", 0.1 * (11.0 * x).sin() * (7.0 * y + x).cos()).expect("memory");
        }
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let at = |i: usize, j: usize| i * (n + 1) + j + 1;
            writeln!(text, "f {} {} {} {}", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)).expect("memory");
        }
        text
    }

    #[test]
    fn a_halved_error_is_found_in_whichever_node_it_is_planted() {
        let dir = tempfile::tempdir().expect("a temporary directory");
        let path = dir.path().join("sheet.obj");
        std::fs::write(&path, rolling_sheet(70)).expect("a writable directory");
        let mut bytes = vec![];
        let model = ModelOptions { chart_triangles: Some(1500), ..ModelOptions::default() };
        let options = BuildOptions { inputs: vec![path.clone()], model, ..BuildOptions::default() };
        build(&options, &mut bytes, &Silent).expect("a sound sheet");
        let file = File::open(bytes, lodpack::Limits::default()).expect("what was written");
        let (mesh, ..) = repair(import_meshes(&[path], &Silent).expect("what was written"));

        let finest = file.level_count() as u8 - 1;
        let whole = file.uniform_cut(finest).expect("a level");
        let surface = (mesh.positions.as_slice(), mesh.triangles.as_slice());
        let input = Input::new(&file, surface, DVec3::ZERO, &whole).expect("readable");
        let (mut planted, mut found) = (0, 0);
        for level in 0..=finest {
            let cut = file.uniform_cut(level).expect("a level");
            let check = |cut: &Cut| {
                let mut report = VerifyReport::default();
                let check = check_nodes(&file, &input, cut, "cut", &mut report).expect("readable");
                assert_eq!(report.unproven_nodes, 0);
                (report.problems, check.ratios)
            };
            let (problems, ratios) = check(&cut);
            assert_eq!(problems, []);
            for (node, _) in ratios.iter().enumerate().filter(|(_, ratio)| **ratio < 1.9) {
                let mut halved = cut.clone();
                halved.node_errors[node] *= 0.5;
                planted += 1;
                let (problems, _) = check(&halved);
                let location = format!("cut, root {}", cut.nodes[node].root);
                found += usize::from(problems.iter().any(|problem| problem.location == location));
            }
        }
        // Where only the input is too far away, a neighbour with a larger error may allow it.
        assert!(planted >= 6 && found * 5 >= planted * 4, "{found} of {planted} were found");
    }
}
