//! What a file holds as plain records: for tools that compare, show or convert files.

use crate::{
    codec::{arc::Knot, patch::LatticePoint},
    decode::{Decoded, Wanted},
    error::{Error, Result},
    format::{
        index_block::BlockEntry,
        model::{Filling, HalfArc},
    },
    index::resident::Index,
    source::fetched::Fetched,
};

/// What the index says about a root.
#[derive(Clone, Debug, PartialEq)]
pub struct RootContents {
    /// How its blocks are coded.
    pub filling: Filling,
    /// Half-arcs, loop after loop, in the winding of the triangles.
    pub loops: Vec<Vec<HalfArc>>,
    /// Smallest and largest lattice coordinates of everything drawn and of the piece of input that it stands for.
    pub bounds: [LatticePoint; 2],
    /// Coarse to fine; the first one is of level 0.
    pub blocks: Vec<BlockContents>,
}

/// What the index says about a root at one level.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockContents {
    /// Which level.
    pub level: u8,
    /// Bound of the two-sided distance to the input while no neighbour is finer, world units.
    pub error: f64,
    /// What is to be added to it when any neighbour is finer, world units.
    pub border_deviation: f64,
    /// Triangles of the block's patch.
    pub triangle_count: u32,
}

/// All corners and arcs of a file: the lines along which its roots meet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Borders {
    /// Positions of the corners.
    pub corners: Vec<LatticePoint>,
    /// The arcs between them.
    pub arcs: Vec<ArcContents>,
}

/// An arc with its samples.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ArcContents {
    /// Corners at both ends.
    pub ends: [u32; 2],
    /// Samples by ascending parameter.
    pub samples: Vec<ArcPoint>,
}

/// A sample of an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ArcPoint {
    /// 1 to 65535 along the arc.
    pub param: u32,
    /// Coarsest level at which it is part of the arc.
    pub level: u8,
    /// Where it is.
    pub position: LatticePoint,
}

impl Index {
    /// What the index says about a root.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] where there is no such root; [`Error::Format`], [`Error::Limit`].
    pub fn root_contents(&self, root: u32) -> Result<RootContents> {
        if root >= self.root_count() {
            return Err(Error::Query { what: format!("root {root} does not exist: there are {}", self.root_count()) });
        }
        let (entry, lattice) = (self.root_entry(root)?, self.lattice());
        let block = |block: &BlockEntry| BlockContents {
            level: block.level,
            error: block.error.bound(&lattice),
            border_deviation: block.border_deviation.bound(&lattice),
            triangle_count: block.triangle_count,
        };
        Ok(RootContents {
            filling: entry.filling,
            loops: entry.loops.clone(),
            bounds: entry.bounds,
            blocks: entry.blocks.iter().filter(|b| usize::from(b.level) < self.level_count()).map(block).collect(),
        })
    }

    /// Decodes all corners and arcs, with the samples of every level that the file holds.
    ///
    /// # Errors
    /// [`Error::Missing`], [`Error::Format`], [`Error::Limit`].
    pub fn borders(&self, fetched: &Fetched) -> Result<Borders> {
        self.load_indices(0..self.cluster_count())?;
        // Every arc has a root; level 0 is the cheapest block to bring all of a root's samples along.
        let arc_level = self.level_count().saturating_sub(1) as u8;
        let wanted: Vec<Wanted> = (0..self.root_count()).map(|root| Wanted { root, level: 0, arc_level }).collect();
        let decoded = Decoded::new(self, fetched, &wanted)?;
        let mut borders = Borders::default();
        let mut corners: Vec<Option<LatticePoint>> = Vec::new();
        for arc in 0..self.arc_count() {
            let (path, ends) = decoded.arc(arc)?;
            for (end, position) in ends.into_iter().zip(path.end_positions()) {
                // Below the corner count, since the arc could be decoded.
                let end = end as usize;
                corners.resize(corners.len().max(end + 1), None);
                corners[end] = Some(position);
            }
            let point = |knot: &Knot| {
                let Knot { param, level, position, .. } = *knot;
                ArcPoint { param, level, position }
            };
            borders.arcs.push(ArcContents { ends, samples: path.samples().iter().map(point).collect() });
        }
        let corner = |position: Option<LatticePoint>| position.ok_or_else(|| Error::format("a corner ends no arc"));
        borders.corners = corners.into_iter().map(corner).collect::<Result<_>>()?;
        Ok(borders)
    }
}
