//! Chooses which cells are split at which level, by optimal pruning of the full trees for the least error + lambda x
//! triangles.
//!
//! For one tree and falling lambda, the optimal prunings are nested (Breiman et al., "Classification and Regression
//! Trees", 1984, chapter 3). So nesting costs nothing here: each level is the best grid for its number of triangles.

use glam::DVec2;
use lodpack::write::grid::{GridCell, GridShape};

use super::{border::BorderCandidates, tree::CellTree};
use crate::chart::ChartMesh;
use lodpack_mesh::NONE;

/// Triangles of a leaf, not counting those of T-vertices.
const CELL_TRIANGLES: f64 = 2.0;
/// A fitted grid's error at the finest level as a share of the error of the planes with which its cells are measured.
/// Measured on scans at 5 to 10 % of the triangles.
const FITTED_SHARE: f64 = 0.8;
/// The same at coarser levels, whose vertices are fitted for all finer levels too. More cells there cost no bytes,
/// because the finer levels need them anyway.
const COARSE_SHARE: f64 = 1.1;
/// Bits of a vertex with its share of split flags, for [`GridLevel::estimated_bits`]. Measured on scans: 11 to 16.
const VERTEX_BITS: f64 = 14.0;
/// Steps of the search for lambda. Each halves the interval of its logarithm; the result is within 1 % of the wanted
/// error.
const SEARCH_STEPS: usize = 16;
/// Cells with a smaller share of the finest level's error are not split.
pub const NEGLIGIBLE: f64 = 0.2;
/// Points on which shapes without cells are measured.
const SHAPE_POINTS: usize = 200;

/// Options of [`select_cells`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SelectOptions {
    /// The root mean square distance between surface and fitted grid that each level may have, in input units; coarsest
    /// first.
    pub thresholds: Vec<f64>,
}

/// One level of a plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridLevel {
    /// How the inside is drawn.
    pub shape: GridShape,
    /// Cells that this level splits and no coarser level does, each after the cell that contains it.
    pub splits: Vec<GridCell>,
    /// Expected root mean square distance after fitting, in input units.
    pub estimated_error: f64,
    /// Number of triangles, without those that T-vertices and border samples add.
    pub triangle_count: u64,
    /// Expected bits of this level's block.
    pub estimated_bits: f64,
}

/// The cells of a chart's grid at every level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GridPlan {
    /// Sides of the chart.
    pub side_count: usize,
    /// Levels, coarsest first, one per threshold.
    pub levels: Vec<GridLevel>,
    /// Samples that the cells need on the border at a coarser level than the arcs have them so far: side, parameter in
    /// 1/65536, level. Ascending, each once.
    pub demanded: Vec<(u32, u32, u8)>,
}

/// Chooses the shape and cells of every level. Returns nothing if the chart is not a disk with three or more sides.
pub fn select_cells(chart: &ChartMesh, uv: &[DVec2], options: &SelectOptions) -> Option<GridPlan> {
    let finest = options.thresholds.iter().copied().fold(f64::INFINITY, f64::min);
    let tree = CellTree::new(chart, uv, NEGLIGIBLE * finest);
    (tree.side_count >= 3)
        .then(|| select_at(chart, &tree, &find_prices(&tree, &options.thresholds), &options.thresholds))
}

/// The price of a triangle, for [`select_at`], at which each level has the error that it may have.
pub fn find_prices(tree: &CellTree, thresholds: &[f64]) -> Vec<f64> {
    let mut pruning = Pruning::new(tree);
    let wanted = |(level, &threshold): (usize, &f64)| {
        let error = threshold / fitted_share(level, thresholds.len());
        pruning.lambda_for(tree, error * error * tree.area)
    };
    thresholds.iter().enumerate().map(wanted).collect()
}

/// The error after fitting, relative to the error of planes.
fn fitted_share(level: usize, level_count: usize) -> f64 {
    if level + 1 == level_count { FITTED_SHARE } else { COARSE_SHARE }
}

/// Chooses shape and cells for given prices of a triangle (integrals of squared error, falling). Equal prices in all
/// charts give the least total error for the total number of triangles.
pub fn select_at(chart: &ChartMesh, tree: &CellTree, lambdas: &[f64], thresholds: &[f64]) -> GridPlan {
    let border = BorderCandidates::new(chart);
    let mut plan = GridPlan { side_count: tree.side_count, ..GridPlan::default() };
    let mut pruning = Pruning::new(tree);
    let mut is_split = vec![false; tree.nodes.len()];
    let mut vertex_count = 0;
    let mut coarser = GridShape::Polygon;
    for (level, &lambda) in lambdas.iter().enumerate() {
        let quads = pruning.prune(tree, lambda);
        let shapes = shape_errors(&border, tree, level as u8);
        let threshold = thresholds.get(level).copied().unwrap_or(0.0);
        let share = fitted_share(level, lambdas.len());
        let share = share * share;
        let quads_cost = quads.map(|(cost, _)| cost * share);
        let shape = choose_shape(tree, shapes, quads_cost, lambda * share, threshold, coarser);
        let mut entry = GridLevel { shape, ..GridLevel::default() };
        let error = match shape {
            GridShape::Polygon | GridShape::Fan => {
                entry.triangle_count = tree.side_count as u64 - if shape == GridShape::Fan { 0 } else { 2 };
                shapes[shape as usize]
            }
            GridShape::Quads => {
                let (error, leaf_count) = pruning.collect(tree, &mut is_split, &mut entry.splits);
                entry.triangle_count = 2 * leaf_count;
                error * share
            }
        };
        entry.estimated_error = (error / tree.area.max(f64::MIN_POSITIVE)).sqrt();
        // A split adds a middle and, because edges are shared, two more vertices.
        let count = (shape >= GridShape::Fan) as u64 + 3 * is_split.iter().filter(|&&s| s).count() as u64;
        entry.estimated_bits = VERTEX_BITS * (count - vertex_count) as f64;
        vertex_count = count;
        demand(&border, level as u8, &entry, coarser, &mut plan.demanded);
        coarser = shape;
        plan.levels.push(entry);
    }
    plan.demanded.sort_unstable();
    plan.demanded.dedup_by_key(|d| (d.0, d.1));
    plan
}

/// Adds the samples that a level's new cells need and that the arcs do not have yet.
fn demand(
    border: &BorderCandidates,
    level: u8,
    entry: &GridLevel,
    coarser: GridShape,
    demanded: &mut Vec<(u32, u32, u8)>,
) {
    let mut ask = |side: usize, param: u32| {
        if border.find(side, param).is_some_and(|c| c.level > level) {
            demanded.push((side as u32, param, level));
        }
    };
    if entry.shape == GridShape::Quads && coarser < GridShape::Quads {
        (0..border.side_count()).for_each(|side| ask(side, lodpack::write::grid::UNIT));
    }
    for &cell in &entry.splits {
        for (side, param) in border.border_middles(cell).into_iter().flatten() {
            ask(side, param);
        }
    }
}

/// The cheapest allowed shape: not coarser than before, and below the threshold if it has no cells to refine.
fn choose_shape(
    tree: &CellTree,
    shapes: [f64; 2],
    quads_cost: Option<f64>,
    lambda: f64,
    threshold: f64,
    coarser: GridShape,
) -> GridShape {
    let n = tree.side_count as f64;
    let fits = |error: f64| error <= threshold * threshold * tree.area;
    let flat = [(GridShape::Polygon, shapes[0], n - 2.0), (GridShape::Fan, shapes[1], n)];
    flat.into_iter()
        .filter(|&(shape, error, _)| shape >= coarser && (fits(error) || quads_cost.is_none()))
        .map(|(shape, error, triangles)| (shape, error + lambda * triangles))
        .filter(|&(_, cost)| quads_cost.is_none_or(|quads| cost <= quads))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(if quads_cost.is_some() { GridShape::Quads } else { coarser.max(GridShape::Fan) }, |(shape, _)| shape)
}

/// Integrals of the squared distance to the polygon, and to the fan, through the samples of a level.
fn shape_errors(border: &BorderCandidates, tree: &CellTree, level: u8) -> [f64; 2] {
    let ring: Vec<_> = border.sides.iter().flatten().filter(|c| c.level <= level).map(|c| c.position).collect();
    let mean = ring.iter().sum::<glam::DVec3>() / ring.len().max(1) as f64;
    let centre = tree.points.iter().min_by(|a, b| a.at.length_squared().total_cmp(&b.at.length_squared()));
    let centre = centre.map_or(mean, |p| p.position);
    let stride = tree.points.len().div_ceil(SHAPE_POINTS).max(1);
    let (mut weight, mut errors) = (0.0, [0.0; 2]);
    for point in tree.points.iter().step_by(stride) {
        let mut least = [f64::INFINITY; 2];
        for (i, &a) in ring.iter().enumerate() {
            let b = ring[(i + 1) % ring.len()];
            // The fan around its mean stands in for the polygon: only flat polygons are useful, and for those both
            // agree.
            for (least, apex) in least.iter_mut().zip([mean, centre]) {
                *least = least.min(super::triangle::squared_distance(point.position, [apex, a, b]));
            }
        }
        weight += point.weight;
        errors = [0, 1].map(|k| errors[k] + point.weight * least[k]);
    }
    errors.map(|e| if weight > 0.0 { e / weight * tree.area } else { 0.0 })
}

/// Working memory for prunings of one tree.
struct Pruning {
    cost: Vec<f64>,
    error: Vec<f64>,
    keep: Vec<bool>,
    /// The latest lambda found; the next search begins there.
    lambda: f64,
}

impl Pruning {
    fn new(tree: &CellTree) -> Self {
        let n = tree.nodes.len();
        Self { cost: vec![0.0; n], error: vec![0.0; n], keep: vec![false; n], lambda: f64::INFINITY }
    }

    /// Finds the best pruning and returns its cost and error; nothing if there are no cells.
    fn prune(&mut self, tree: &CellTree, lambda: f64) -> Option<(f64, f64)> {
        for (i, node) in tree.nodes.iter().enumerate().rev() {
            let (mut cost, mut error, mut keep) = (node.error + lambda * CELL_TRIANGLES, node.error, false);
            if node.children != NONE {
                let c = node.children as usize;
                let sum = |v: &[f64]| (v[c] + v[c + 1]) + (v[c + 2] + v[c + 3]);
                let split = sum(&self.cost);
                if split < cost {
                    (cost, error, keep) = (split, sum(&self.error), true);
                }
            }
            (self.cost[i], self.error[i], self.keep[i]) = (cost, error, keep);
        }
        (!tree.nodes.is_empty()).then(|| {
            let total = |v: &[f64]| v[..tree.side_count].iter().sum();
            (total(&self.cost), total(&self.error))
        })
    }

    /// The largest lambda whose pruning has at most the `wanted` error.
    fn lambda_for(&mut self, tree: &CellTree, wanted: f64) -> f64 {
        let whole: f64 = tree.nodes.iter().take(tree.side_count).map(|n| n.error).sum();
        if tree.nodes.is_empty() || whole <= wanted {
            return self.lambda.min(whole.max(wanted));
        }
        let (mut high, mut low) = (self.lambda.min(whole), wanted / (4.0 * tree.nodes.len() as f64));
        for _ in 0..SEARCH_STEPS {
            let middle = (high * low).sqrt();
            match self.prune(tree, middle) {
                Some((_, error)) if error > wanted => high = middle,
                _ => low = middle,
            }
        }
        self.lambda = low;
        low
    }

    /// Appends the split cells that `is_split` does not have yet. Returns the error and the number of all leaves.
    fn collect(&self, tree: &CellTree, is_split: &mut [bool], splits: &mut Vec<GridCell>) -> (f64, u64) {
        let (mut error, mut leaf_count) = (0.0, 0);
        let mut queue: Vec<u32> = (0..tree.side_count as u32).collect();
        let mut next = 0;
        while next < queue.len() {
            let index = queue[next] as usize;
            let node = tree.nodes[index];
            if node.children != NONE && (self.keep[index] || is_split[index]) {
                if !std::mem::replace(&mut is_split[index], true) {
                    splits.push(node.cell);
                }
                queue.extend(node.children..node.children + 4);
            } else {
                error += node.error;
                leaf_count += 1;
            }
            next += 1;
        }
        (error, leaf_count)
    }
}
