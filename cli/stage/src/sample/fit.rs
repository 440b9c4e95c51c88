//! Fits the positions of a grid's vertices, one position for all levels.

use crate::least_squares::{Symmetric, System};
use glam::DVec3;
use lodpack::write::grid::GridSite;

use super::{
    border::BorderCandidates,
    correspond::LevelMatches,
    layout::{ChartLattice, border_positions, grid_sides, grid_states, site_coordinates},
    select::GridPlan,
    tree::{SurfacePoint, surface_points},
    triangle,
};
use crate::{
    chart::ChartMesh,
    embed::{Embedding, quad_point},
};

/// Weight of the distance along the surface in the sliding rounds. With less, vertices would wander off where the
/// surface is flat.
const TANGENTIAL_SHARE: f64 = 0.03;
/// Weight that holds each vertex where it is, relative to the mean weight of a vertex's surface points.
const HOLD: f64 = 0.01;
/// Conjugate gradient steps of the least squares, and of each sliding round. More steps have no visible effect.
const ITERATIONS: [usize; 2] = [12, 8];

/// Options of [`fit_positions`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitOptions {
    /// Sliding rounds after the least squares. More rounds follow creases better and take longer; 2 to 4 work well.
    pub rounds: usize,
    /// Weight of a coarser level's squared error, relative to the square of its own threshold. 0 fits the finest level
    /// alone; 0.3 raises the error of that level by 5 % and lowers that of the next coarser one by 20 %.
    pub coarse_weight: f64,
    /// Surface points used per triangle at most.
    pub points_per_triangle: usize,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { rounds: 3, coarse_weight: 0.3, points_per_triangle: 6 }
    }
}

/// The fitted vertices of a grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FittedGrid {
    /// Where the interior vertices are in the grid, coarser levels first.
    pub sites: Vec<GridSite>,
    /// Their positions, in the chart's units.
    pub positions: Vec<DVec3>,
    /// Normals of the surface there: unit length, or zero.
    pub normals: Vec<DVec3>,
}

/// Fits the vertices of all levels of a plan. The chart's border must already have the samples that the plan demands
/// ([`super::demand_samples`]).
///
/// # Errors
///
/// If plan and border do not match.
pub fn fit_positions(
    chart: &ChartMesh,
    embedding: &Embedding,
    plan: &GridPlan,
    options: &FitOptions,
) -> lodpack::Result<FittedGrid> {
    let states = grid_states(plan)?;
    let Some(finest) = states.last() else { return Ok(FittedGrid::default()) };
    let sites = finest.sites().to_vec();
    let points = surface_points(chart, &embedding.uv, plan.side_count);
    let lattice = ChartLattice::new(chart);
    let border = BorderCandidates::new(chart);
    let mut positions = evaluate(chart, embedding, plan.side_count, &sites);

    let finest_error = plan.levels.last().map_or(0.0, |l| l.estimated_error).max(f64::MIN_POSITIVE);
    let mut levels = vec![];
    for (level, mut state) in states.into_iter().enumerate() {
        let is_finest = level + 1 == plan.levels.len();
        let ratio = finest_error / plan.levels[level].estimated_error.max(finest_error);
        let share = if is_finest { 1.0 } else { options.coarse_weight * ratio * ratio };
        let is_same_as_finer = !is_finest && state.sites().len() == sites.len();
        if share <= 0.0 || is_same_as_finer {
            continue;
        }
        let level = level as u8;
        let initial: Vec<_> = positions[..state.sites().len()].iter().map(|&p| lattice.point(p)).collect();
        state.set_positions(&initial);
        let sides = grid_sides(chart, level, |p| lattice.point(p));
        let on_border = border_positions(&border, level);
        levels.push((share, LevelMatches::new(state, sides, on_border, &points, options.points_per_triangle)?));
    }
    for round in 0..=options.rounds {
        let tangential = if round == 0 { 1.0 } else { TANGENTIAL_SHARE };
        if round > 0 {
            for (_, level) in &mut levels {
                level.reproject(&positions, |p| lattice.point(p), &points)?;
            }
        }
        let moves = solve(&levels, &points, &positions, tangential, ITERATIONS[(round > 0) as usize]);
        for (p, d) in positions.iter_mut().zip(moves) {
            *p += d;
        }
    }
    let normals = normals(&levels, &points, positions.len());
    Ok(FittedGrid { sites, positions, normals })
}

/// Root mean square distance of the chart's vertices and centroids from each level's triangles at the fitted positions.
/// For these points it is an upper bound, because the search for the closest triangle starts at the matching one and
/// goes only a few steps.
///
/// # Errors
///
/// If plan and border do not match.
pub fn level_errors(
    chart: &ChartMesh,
    embedding: &Embedding,
    plan: &GridPlan,
    positions: &[DVec3],
) -> lodpack::Result<Vec<f64>> {
    let points = surface_points(chart, &embedding.uv, plan.side_count);
    let lattice = ChartLattice::new(chart);
    let border = BorderCandidates::new(chart);
    let mut errors = vec![];
    for (level, mut state) in grid_states(plan)?.into_iter().enumerate() {
        let initial: Vec<_> = positions[..state.sites().len()].iter().map(|&p| lattice.point(p)).collect();
        state.set_positions(&initial);
        let sides = grid_sides(chart, level as u8, |p| lattice.point(p));
        let on_border = border_positions(&border, level as u8);
        let mut matches = LevelMatches::new(state, sides, on_border, &points, usize::MAX >> 32)?;
        matches.reproject(positions, |p| lattice.point(p), &points)?;
        let square = |found: &super::correspond::Match| {
            let point = &points[found.point as usize];
            let on_grid = triangle::at(matches.corners(positions, found.triangle), found.barycentric);
            (point.weight * point.position.distance_squared(on_grid), point.weight)
        };
        let (sum, weight) = matches.matches.iter().map(square).fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        errors.push((sum / f64::max(weight, f64::MIN_POSITIVE)).sqrt());
    }
    Ok(errors)
}

/// The surface at the parameters of the sites.
fn evaluate(chart: &ChartMesh, embedding: &Embedding, side_count: usize, sites: &[GridSite]) -> Vec<DVec3> {
    let surface = embedding.positions(chart);
    let locator = embedding.locator();
    let mut hint = 0;
    let position = |site: &GridSite| {
        let at = site_coordinates(*site);
        let found = locator.find(quad_point(side_count, site.quad as usize, at.x, at.y), hint);
        hint = found.map_or(0, |f| f.triangle);
        found.map_or(DVec3::ZERO, |f| locator.evaluate(&surface, f))
    };
    sites.iter().map(position).collect()
}

/// The moves that bring the levels' triangles closer to their surface points.
fn solve(
    levels: &[(f64, LevelMatches)],
    points: &[SurfacePoint],
    positions: &[DVec3],
    tangential: f64,
    iterations: usize,
) -> Vec<DVec3> {
    // Fixed vertices get numbers beyond those of the interior ones.
    let unknown = |level: &LevelMatches, v: u32| v.checked_sub(level.border.len() as u32).unwrap_or(u32::MAX);
    let count = positions.len() as u32;
    let pairs = levels.iter().flat_map(|(_, level)| {
        let edges = level.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
        edges.map(move |e| e.map(|v| unknown(level, v))).filter(move |e| e[0] < count && e[1] < count)
    });
    let mut system = System::new(positions.len(), pairs);
    for (share, level) in levels {
        for found in &level.matches {
            let point = &points[found.point as usize];
            let r = point.position - triangle::at(level.corners(positions, found.triangle), found.barycentric);
            let weight = share * level.stride as f64 * point.weight;
            let across = if point.normal == DVec3::ZERO { tangential } else { 1.0 };
            let g = Symmetric::along(point.normal, weight * across, weight * tangential);
            let vertices = level.triangles[found.triangle as usize].map(|v| unknown(level, v));
            system.add(vertices, found.barycentric, &g, r);
        }
    }
    let total: f64 = points.iter().map(|p| p.weight).sum();
    system.hold(HOLD * total / positions.len().max(1) as f64);
    system.solve(iterations)
}

/// The mean normal of the surface points around each vertex.
fn normals(levels: &[(f64, LevelMatches)], points: &[SurfacePoint], count: usize) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; count];
    if let Some((_, level)) = levels.last() {
        for found in &level.matches {
            let point = &points[found.point as usize];
            for (k, &v) in level.triangles[found.triangle as usize].iter().enumerate() {
                if let Some(v) = (v as usize).checked_sub(level.border.len()) {
                    normals[v] += point.weight * found.barycentric[k] * point.normal;
                }
            }
        }
    }
    normals.into_iter().map(DVec3::normalize_or_zero).collect()
}
