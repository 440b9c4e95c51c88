//! A plan's cells as the reader's grid states, without coding: the vertices and the triangles between them.

use glam::{DVec2, DVec3};
use lodpack::{
    LatticePoint,
    write::grid::{GridSides, GridSite, GridState, GridVertexRef, UNIT},
};

use super::{border::BorderCandidates, select::GridPlan};
use crate::chart::ChartMesh;

/// The states of all levels of a plan, with vertices at the lattice's origin. The vertices of a finer level begin with
/// those of the coarser one.
///
/// # Errors
///
/// If the plan's cells do not follow from each other.
pub fn grid_states(plan: &GridPlan) -> lodpack::Result<Vec<GridState>> {
    let mut states: Vec<GridState> = vec![];
    for level in &plan.levels {
        let coarser = states.last().cloned().unwrap_or_default();
        states.push(coarser.refined(plan.side_count, level.shape, &level.splits)?);
    }
    Ok(states)
}

/// The samples on a chart's sides at a level; `lattice` gives their positions.
pub fn grid_sides(chart: &ChartMesh, level: u8, lattice: impl Fn(DVec3) -> LatticePoint) -> GridSides {
    let border = BorderCandidates::new(chart);
    let samples = |side: &Vec<super::border::Candidate>| {
        side.iter().filter(|c| c.level <= level).map(|c| (c.param, lattice(c.position))).collect()
    };
    GridSides { sides: border.sides.iter().map(samples).collect() }
}

/// Positions of a level's border samples, in the order of a patch.
pub(super) fn border_positions(border: &BorderCandidates, level: u8) -> (Vec<GridVertexRef>, Vec<DVec3>) {
    let samples = border.sides.iter().enumerate().flat_map(|(side, candidates)| {
        candidates
            .iter()
            .filter(|c| c.level <= level)
            .map(move |c| (GridVertexRef::Border { side, param: c.param }, c.position))
    });
    samples.unzip()
}

/// A lattice of 2^32 steps across the chart: fine enough to choose the same triangles as the file's lattice will.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChartLattice {
    origin: DVec3,
    per_unit: f64,
}

impl ChartLattice {
    pub fn new(chart: &ChartMesh) -> Self {
        let origin = chart.positions.first().copied().unwrap_or_default();
        let extent = chart.positions.iter().map(|p| (*p - origin).abs().max_element()).fold(0.0, f64::max);
        Self { origin, per_unit: if extent > 0.0 { (1u64 << 32) as f64 / extent } else { 1.0 } }
    }

    pub fn point(&self, p: DVec3) -> LatticePoint {
        ((p - self.origin) * self.per_unit).to_array().map(|c| c.round() as i64)
    }
}

/// The coordinates of a site in its quad, 0 to 1.
pub(super) fn site_coordinates(site: GridSite) -> DVec2 {
    DVec2::new(site.x as f64, site.y as f64) / UNIT as f64
}

/// The coordinates of a grid vertex in a quad, 0 to [`UNIT`], if it belongs to that quad.
pub(super) fn coordinates_in_quad(vertex: GridVertexRef, quad: usize, side_count: usize) -> Option<DVec2> {
    let before = (quad + side_count - 1) % side_count;
    let (x, y) = match vertex {
        GridVertexRef::Border { side, param } if side == quad && param <= UNIT => (UNIT - param, UNIT),
        GridVertexRef::Border { side, param } if side == before && param >= UNIT => (UNIT, param - UNIT),
        GridVertexRef::Inner(GridSite { x: 0, y: 0, .. }) => (0, 0),
        GridVertexRef::Inner(site) if site.quad as usize == quad => (site.x as u32, site.y as u32),
        GridVertexRef::Inner(site) if site.quad as usize == before && site.x == 0 => (site.y as u32, 0),
        _ => return None,
    };
    Some(DVec2::new(x as f64, y as f64))
}
