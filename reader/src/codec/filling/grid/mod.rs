//! The grid filling: a disk with n >= 3 sides as n quadtrees of cells, nested from level to level (SPEC.md, "Grid
//! blocks").
//!
//! The corners of quad i are, counter-clockwise, the centre, the middle of side i - 1, corner i, and the middle of side
//! i. Its coordinates (x, y) run from (0, 0) at the centre to ([`UNIT`], [`UNIT`]) at corner i. Quads meet along
//! **spokes**, which lead from the centre to the middle of a side. A level draws every leaf of its trees as a polygon
//! through all vertices on the leaf's edges, so a coarse cell may lie beside finer ones without a crack; `triangulate`
//! derives the triangles from the positions. Coarser than one cell per quad, a disk is drawn as a fan around its
//! centre, or as one polygon (see [`GridShape`]).
//!
//! Levels are nested: a level keeps all cells and vertices of the coarser level, splits more cells, and moves no
//! vertex. format-spec/trials/simplification.md compares these adaptive grids, which keep their T-vertices, with
//! uniform ones.

mod block;
mod codec;
mod contexts;
mod edges;
mod patch;
mod predict;
mod state;
mod triangulate;

#[cfg(test)]
mod tests;

use codec::decode_level;
pub use codec::{GridTarget, encode_level};
pub use state::{GridCell, GridSite, GridState, GridVertexRef};

use crate::{
    codec::{
        filling::{Descriptor, Filling, Quantisation},
        patch::LatticePoint,
    },
    error::{Error, Result},
};

/// The filling's row in the table.
pub(super) const DESCRIPTOR: Descriptor = Descriptor {
    filling: Filling::Grid,
    code: 1,
    name: "grid",
    description: "quadtrees of samples, whose finer levels build on the coarser ones",
    is_nested: true,
    uses: contexts::USES,
    decoder: || Box::<block::BlockDecoder>::default(),
};

/// The extent of a quad's coordinates. The parameters of a side run to twice as many units (0 to 65536).
pub const UNIT: u32 = 1 << 15;

/// Cells of this depth are not split.
pub const MAX_DEPTH: u8 = 12;

/// The most sides of a grid: a chart with more corners is no candidate.
pub const MAX_SIDE_COUNT: usize = 4096;

/// Samples of a disk's sides at one level, in the winding of its triangles.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GridSides {
    /// Per side, ascending, the parameters (0 to 65535, in 1/65536 of the side) and positions of its samples. The
    /// corner where the side begins (parameter 0) is included; the next corner is not.
    pub sides: Vec<Vec<(u32, LatticePoint)>>,
}

/// Limits against hostile grids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GridLimits {
    /// The most interior vertices of one grid.
    pub vertex_count: u64,
}

impl Default for GridLimits {
    fn default() -> Self {
        Self { vertex_count: 1 << 22 }
    }
}

/// How the inside of the disk is drawn. A finer level never returns to an earlier shape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum GridShape {
    /// One polygon through the border samples.
    #[default]
    Polygon,
    /// One sector per side around a centre vertex.
    Fan,
    /// One quadtree per corner; the middle of every side is a sample.
    Quads,
}

impl GridShape {
    /// Shapes from coarse to fine.
    const ALL: [Self; 3] = [Self::Polygon, Self::Fan, Self::Quads];
}

/// The samples of [`GridSides`], checked, and in the order in which a patch numbers them.
#[derive(Clone, Debug)]
struct Border<'a> {
    sides: &'a GridSides,
    /// The patch vertex of each side's first corner, and one more entry with the count.
    first: Vec<u32>,
    positions: Vec<LatticePoint>,
}

impl<'a> Border<'a> {
    fn new(sides: &'a GridSides) -> Result<Self> {
        if sides.sides.len() < 3 || sides.sides.len() > MAX_SIDE_COUNT {
            return Err(Error::format("a grid needs 3 to 4096 sides"));
        }
        let mut first = vec![0];
        let mut positions = Vec::new();
        for side in &sides.sides {
            let ascending = side.windows(2).all(|pair| pair[0].0 < pair[1].0);
            let in_range = side.first().is_some_and(|s| s.0 == 0) && side.last().is_some_and(|s| s.0 < 2 * UNIT);
            if !ascending || !in_range {
                return Err(Error::format("the parameters of a grid's side do not ascend from 0 to below 65536"));
            }
            positions.extend(side.iter().map(|s| s.1));
            first.push(positions.len() as u32);
        }
        Ok(Self { sides, first, positions })
    }

    /// The patch vertices of the samples that a grid has names for.
    fn named(&self, places: &[(u32, u32)]) -> Result<Vec<u32>> {
        let vertex = |&(side, param): &(u32, u32)| self.vertex(side as usize, param);
        let vertices: Option<Vec<u32>> = places.iter().map(vertex).collect();
        vertices.ok_or_else(|| Error::format("a corner of a grid's cell is missing"))
    }

    fn side_count(&self) -> usize {
        self.sides.sides.len()
    }

    fn count(&self) -> u32 {
        self.positions.len() as u32
    }

    /// The patch vertex of the sample of `side` at `param`, if there is one. Parameter 65536 is the corner of the next
    /// side.
    fn vertex(&self, side: usize, param: u32) -> Option<u32> {
        if param == 2 * UNIT {
            return Some(self.first[(side + 1) % self.side_count()]);
        }
        let index = self.sides.sides[side].binary_search_by_key(&param, |s| s.0).ok()?;
        Some(self.first[side] + index as u32)
    }

    /// The parameters and patch vertices of the samples of `side` strictly between two parameters.
    fn between(&self, side: usize, after: u32, before: u32) -> impl DoubleEndedIterator<Item = (u32, u32)> + '_ {
        let samples = &self.sides.sides[side];
        let from = samples.partition_point(|s| s.0 <= after);
        let to = samples.partition_point(|s| s.0 < before).max(from);
        (from..to).map(move |i| (samples[i].0, self.first[side] + i as u32))
    }
}
