//! A chart's border as a grid sees it: the samples that a side can have, and those that it has at a level.

use glam::DVec3;
use lodpack::write::grid::{GridCell, UNIT};

use crate::chart::{BorderVertex, ChartMesh, NEVER};

/// A border vertex that is a sample, or can become one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// In 1/65536 of the side.
    pub param: u32,
    pub level: u8,
    pub position: DVec3,
}

/// For each side, the candidates in ascending order.
#[derive(Clone, Debug, Default)]
pub(super) struct BorderCandidates {
    pub sides: Vec<Vec<Candidate>>,
}

impl BorderCandidates {
    /// The border of a disk; no sides if the chart is not a disk.
    pub fn new(chart: &ChartMesh) -> Self {
        let [border] = chart.loops.as_slice() else { return Self::default() };
        let side_count = border.iter().map(|v| v.side as usize + 1).max().unwrap_or(0);
        let mut sides = vec![vec![]; side_count];
        for vertex in border {
            if let Some(param) = exact_param(vertex) {
                let position = chart.positions[vertex.vertex as usize];
                sides[vertex.side as usize].push(Candidate { param, level: vertex.level, position });
            }
        }
        if sides.iter().any(|side: &Vec<Candidate>| side.first().is_none_or(|c| c.param != 0)) {
            return Self::default();
        }
        Self { sides }
    }

    pub fn side_count(&self) -> usize {
        self.sides.len()
    }

    pub fn find(&self, side: usize, param: u32) -> Option<&Candidate> {
        let index = self.sides[side].binary_search_by_key(&param, |c| c.param).ok()?;
        self.sides[side].get(index)
    }

    /// Whether every side can have a sample at its middle.
    pub fn has_all_middles(&self) -> bool {
        (0..self.side_count()).all(|side| self.find(side, UNIT).is_some())
    }

    /// Whether the edges of a cell that lie on the border can have a sample at their middle.
    pub fn can_split(&self, cell: GridCell) -> bool {
        self.border_middles(cell).into_iter().flatten().all(|(side, param)| self.find(side, param).is_some())
    }

    /// Side and parameter of the middle of each border edge of a cell.
    pub fn border_middles(&self, cell: GridCell) -> [Option<(usize, u32)>; 2] {
        let (x, y, size) = (cell.x as u32, cell.y as u32, cell.size());
        let quad = cell.quad as usize;
        let before = (quad + self.side_count() - 1) % self.side_count();
        [
            (x + size == UNIT).then_some((before, UNIT + y + size / 2)),
            (y + size == UNIT).then_some((quad, UNIT - x - size / 2)),
        ]
    }
}

/// The parameter in 1/65536, if it is an exact multiple.
fn exact_param(vertex: &BorderVertex) -> Option<u32> {
    let scaled = vertex.param * 65536.0;
    ((0.0..65536.0).contains(&scaled) && scaled.fract() == 0.0).then_some(scaled as u32)
}

/// Makes the demanded samples of a plan (side, parameter, level) part of the chart's border.
pub fn demand_samples(chart: &mut ChartMesh, demanded: &[(u32, u32, u8)]) {
    let Some(border) = chart.loops.first_mut() else { return };
    for vertex in border {
        let Some(param) = exact_param(vertex) else { continue };
        if let Ok(index) = demanded.binary_search_by_key(&(vertex.side, param), |d| (d.0, d.1)) {
            debug_assert!(vertex.level != NEVER || demanded[index].2 < NEVER);
            vertex.level = vertex.level.min(demanded[index].2);
        }
    }
}
