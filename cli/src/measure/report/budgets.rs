//! How far budgets of nodes and triangles go, with one, two and three resolutions a node (Niski 2007, figures 4.5 to
//! 4.9).
//!
//! A node of a file is drawn in one way, and is finer where its children are drawn. The thesis's nodes have several
//! resolutions: each may be refined as it is, or split. Here a node gets them from the tree itself: its second
//! resolution is what its children draw together, its third what theirs do. So all hierarchies have the same surfaces,
//! with the file's own errors and numbers of triangles, and differ in what a budget of nodes allows. What finer
//! neighbours add along borders is left out of all.

use super::ReportError;
use super::analysis::median;
use super::cuts::Open;
use crate::machine::thread_cpu_time;
use lodpack::select::{Hierarchy, HierarchyNode, Resolution, View, select_in};
use lodpack::{Cut, Error, Query};
use serde::Serialize;
use std::sync::Arc;

/// Views around the surface.
const VIEWS: u32 = 8;
/// How far the camera is from the middle, in diagonals of the box: near parts are some ten times as near as far ones.
const DISTANCE: f64 = 0.55;
/// A budget of triangles that does not vary is this part of the finest level's.
const TRIANGLE_PART: u64 = 8;
/// A budget of nodes that does not vary is this part of all nodes.
const NODE_PART: u64 = 8;
/// Budgets double from one to the next.
const MOST_BUDGETS: u32 = 24;

/// Cuts of one kind of hierarchy within the same budgets: means over the views.
#[derive(Clone, Debug, Serialize)]
pub struct BudgetRow {
    /// Resolutions a node.
    pub resolutions: u8,
    /// What varies: `nodes` or `triangles` where both are limited, `nodes_at_error` where nodes are, and the error is
    /// asked for.
    pub varied: &'static str,
    /// The budget of nodes.
    pub max_nodes: u64,
    /// The budget of triangles, if there is one.
    pub max_triangles: Option<u64>,
    /// Nodes of the cut.
    pub nodes: f64,
    /// Triangles of the cut.
    pub triangles: f64,
    /// The largest error in the picture, pixels of 1920 x 1080.
    pub pixel_error: f64,
    /// Processor time to find the cut from scratch, the median.
    pub select_seconds: f64,
}

/// Asks for cuts at budgets of nodes, and of triangles. No rows for a file without a tree.
///
/// # Errors
/// [`ReportError::Open`], [`ReportError::Read`].
pub fn measure_budgets(open: Open) -> Result<Vec<BudgetRow>, ReportError> {
    let file = open().map_err(ReportError::Open)?;
    let (Some(bounds), true) = (file.bounds(), file.index().has_tree()) else { return Ok(vec![]) };
    let tree = Tree::read(&file)?;
    let hierarchy = |count| tree.hierarchy(count).map(Arc::new);
    let hierarchies = [hierarchy(1)?, hierarchy(2)?, hierarchy(3)?];
    let views = views(bounds);
    let (all_nodes, all_triangles) = tree.finest();
    let (some_nodes, some_triangles) = (all_nodes.div_ceil(NODE_PART), all_triangles / TRIANGLE_PART);
    // The error that is asked for is what that many triangles reach without a limit of nodes.
    let reached = reached(&hierarchies[0], &views, some_triangles)?;
    let as_fine_as_possible = vec![0.0; views.len()];
    let budgets = |all: u64| {
        let halves = (0..MOST_BUDGETS).map(move |k| all >> k).take_while(|&budget| budget > 0);
        halves.collect::<Vec<_>>().into_iter().rev()
    };
    let mut rows = vec![];
    for (resolutions, hierarchy) in (1..).zip(&hierarchies) {
        let mut ask = |varied, max_nodes, max_triangles, pixels: &[f64]| -> Result<(), ReportError> {
            let cuts = cuts(hierarchy, &views, pixels, max_nodes, max_triangles)?;
            rows.extend(cuts.map(|cuts| BudgetRow::new(resolutions, varied, max_nodes, max_triangles, &cuts)));
            Ok(())
        };
        for nodes in budgets(all_nodes) {
            ask("nodes", nodes, Some(some_triangles), &as_fine_as_possible)?;
        }
        for triangles in budgets(all_triangles) {
            ask("triangles", some_nodes, Some(triangles), &as_fine_as_possible)?;
        }
        for nodes in budgets(all_nodes) {
            ask("nodes_at_error", nodes, None, &reached)?;
        }
    }
    Ok(rows)
}

impl BudgetRow {
    /// The means of some cuts; each comes with the processor time that it took.
    fn new(
        resolutions: u8,
        varied: &'static str,
        max_nodes: u64,
        max_triangles: Option<u64>,
        cuts: &[(Cut, f64)],
    ) -> Self {
        let mean = |of: fn(&Cut) -> f64| cuts.iter().map(|(cut, _)| of(cut)).sum::<f64>() / cuts.len() as f64;
        Self {
            resolutions,
            varied,
            max_nodes,
            max_triangles,
            nodes: mean(|cut| cut.nodes.len() as f64),
            triangles: mean(|cut| cut.triangle_count as f64),
            pixel_error: mean(|cut| cut.pixel_error),
            select_seconds: median(cuts.iter().map(|(_, seconds)| *seconds)),
        }
    }
}

/// Errors in pixels, view by view, of as good cuts as a number of triangles allows.
fn reached(hierarchy: &Arc<Hierarchy>, views: &[View], triangles: u64) -> Result<Vec<f64>, ReportError> {
    let ask = |view: &View| {
        let view = View { pixel_tolerance: 0.0, ..*view };
        match select_in(hierarchy, &Query { view: Some(view), max_triangles: Some(triangles), ..Query::default() }) {
            Err(Error::Query { .. }) => Ok(f64::INFINITY),
            cut => Ok(cut?.pixel_error),
        }
    };
    views.iter().map(ask).collect()
}

/// The cut of each view, and the processor time that it took; none if a view has no cut that keeps the budgets, or none
/// within the error that was asked for.
fn cuts(
    hierarchy: &Arc<Hierarchy>,
    views: &[View],
    pixels: &[f64],
    max_nodes: u64,
    max_triangles: Option<u64>,
) -> Result<Option<Vec<(Cut, f64)>>, ReportError> {
    let mut cuts: Vec<(Cut, f64)> = vec![];
    for (view, &pixel_tolerance) in views.iter().zip(pixels) {
        let view = Some(View { pixel_tolerance, ..*view });
        let query = Query { view, max_nodes: Some(max_nodes), max_triangles, ..Query::default() };
        let start = thread_cpu_time();
        match select_in(hierarchy, &query) {
            Err(Error::Query { .. }) => return Ok(None),
            cut => cuts.push((cut?, (thread_cpu_time() - start).as_secs_f64())),
        }
        let missed = cuts.last().is_some_and(|(cut, _)| max_triangles.is_none() && cut.pixel_error > pixel_tolerance);
        if missed {
            return Ok(None);
        }
    }
    Ok(Some(cuts))
}

/// Cameras around the middle of a box, a little above it, that look at it.
fn views([low, high]: [[f64; 3]; 2]) -> Vec<View> {
    let middle = [0, 1, 2].map(|k| f64::midpoint(low[k], high[k]));
    let diagonal = [0, 1, 2].map(|k| high[k] - low[k]).iter().map(|side| side * side).sum::<f64>().sqrt();
    let view = |number: u32| {
        let angle = std::f64::consts::TAU * f64::from(number) / f64::from(VIEWS);
        let forward = [-angle.cos(), -0.3, -angle.sin()];
        let length = forward.iter().map(|x| x * x).sum::<f64>().sqrt();
        let position = [0, 1, 2].map(|k| middle[k] - forward[k] / length * diagonal * DISTANCE);
        View { position, forward, near: (diagonal * 1e-4).max(f64::MIN_POSITIVE), ..View::default() }
    };
    (0..VIEWS).map(view).collect()
}

/// What the index says about the nodes of a file.
struct Tree {
    bounds: Vec<[[f64; 3]; 2]>,
    parents: Vec<Option<u32>>,
    /// The children of each node, which follow each other.
    children: Vec<std::ops::Range<u32>>,
    /// How each node is drawn by itself, coarse to fine.
    own: Vec<Vec<Resolution>>,
    level_count: u8,
}

impl Tree {
    fn read(file: &super::Reader) -> Result<Self, ReportError> {
        let mut tree = Self {
            bounds: vec![],
            parents: vec![],
            children: vec![],
            own: vec![],
            level_count: file.level_count() as u8,
        };
        for root in 0..file.root_count() {
            let blocks = file.root_contents(root)?.blocks;
            if blocks.is_empty() {
                // It begins with a level that this file does not have, and so do all after it.
                break;
            }
            tree.bounds.push(file.root_bounds(root)?);
            tree.parents.push(file.parent(root)?);
            tree.children.push(file.children(root)?);
            tree.own.push(
                blocks.iter().map(|block| resolution(block.level, block.error, block.triangle_count.into())).collect(),
            );
        }
        let count = tree.own.len() as u32;
        for children in &mut tree.children {
            *children = children.start.min(count)..children.end.min(count);
        }
        Ok(tree)
    }

    /// Leaves, and their triangles at the finest.
    fn finest(&self) -> (u64, u64) {
        let leaves = self.children.iter().zip(&self.own).filter(|(children, _)| children.is_empty());
        leaves.fold((0, 0), |(nodes, triangles), (_, own)| {
            (nodes + 1, triangles + own.last().map_or(0, |finest| finest.triangle_count))
        })
    }

    /// The hierarchy with up to the given number of resolutions a node.
    fn hierarchy(&self, resolutions: u8) -> Result<Hierarchy, Error> {
        // What lies one height below each node, drawn together; then two.
        let mut below: Vec<Resolution> = self.own.iter().map(|own| own.last().cloned().unwrap_or_default()).collect();
        let mut all = self.own.clone();
        for _ in 1..resolutions {
            let join = |(node, children): (usize, &std::ops::Range<u32>)| {
                let parts = &below[children.start as usize..children.end as usize];
                parts.iter().cloned().reduce(joined).unwrap_or_else(|| below[node].clone())
            };
            let joined: Vec<Resolution> = self.children.iter().enumerate().map(join).collect();
            for (resolutions, finer) in all.iter_mut().zip(&joined) {
                if resolutions.last().is_some_and(|last| last.level < finer.level) {
                    resolutions.push(finer.clone());
                }
            }
            below = joined;
        }
        let nodes =
            all.into_iter().zip(&self.bounds).zip(&self.parents).map(|((resolutions, &bounds), &parent)| {
                HierarchyNode { bounds, parent, resolutions, borders: vec![] }
            });
        Hierarchy::new(&nodes.collect::<Vec<_>>(), vec![], self.level_count, vec![])
    }
}

fn resolution(level: u8, error: f64, triangle_count: u64) -> Resolution {
    Resolution { level, error, triangle_count, ..Resolution::default() }
}

/// Two pieces drawn as one.
fn joined(a: Resolution, b: Resolution) -> Resolution {
    resolution(a.level.max(b.level), a.error.max(b.error), a.triangle_count + b.triangle_count)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A node of a hundred triangles above two leaves of a thousand.
    fn tree() -> Tree {
        let bounds = [[[0.0; 3], [2.0, 1.0, 1.0]], [[0.0; 3], [1.0; 3]], [[1.0, 0.0, 0.0], [2.0, 1.0, 1.0]]];
        Tree {
            bounds: bounds.into(),
            parents: vec![None, Some(0), Some(0)],
            children: vec![1..3, 3..3, 3..3],
            own: vec![vec![resolution(0, 0.5, 100)], vec![resolution(1, 0.1, 1000)], vec![resolution(1, 0.2, 1000)]],
            level_count: 2,
        }
    }

    #[test]
    fn a_second_resolution_draws_the_children_with_one_node() {
        let everything = |resolutions, max_nodes| {
            let hierarchy = Arc::new(tree().hierarchy(resolutions).expect("it is sound"));
            select_in(&hierarchy, &Query { max_nodes: Some(max_nodes), ..Query::default() })
                .expect("the top is one node")
        };
        let [one, two, both] = [everything(1, 1), everything(2, 1), everything(1, 2)];
        assert_eq!((one.triangle_count, one.error), (100, 0.5));
        assert_eq!((two.triangle_count, two.error, two.nodes.len()), (2000, 0.2, 1));
        assert_eq!((both.triangle_count, both.error, both.nodes.len()), (2000, 0.2, 2));
        assert_eq!(tree().finest(), (2, 2000));
    }
}
