//! What the index says about a root, as plain records: for tools that compare, show or convert files.

use crate::{
    error::{Error, Result},
    format::{
        index_block::BlockEntry,
        records::{Filling, HalfArc},
    },
    index::Index,
    lattice::LatticePoint,
};

/// What the index says about a root.
#[derive(Clone, Debug, PartialEq)]
pub struct RootContents {
    /// How its blocks are coded.
    pub filling: Filling,
    /// Half-arcs, loop after loop, in the winding of the triangles.
    pub loops: Vec<Vec<HalfArc>>,
    /// Smallest and largest lattice coordinates of everything that the root draws, and of the piece of input that it
    /// stands for.
    pub bounds: [LatticePoint; 2],
    /// Coarse to fine, at least one.
    pub blocks: Vec<BlockContents>,
}

/// What the index says about a root at one level.
///
/// `error` bounds the two-sided (Hausdorff) distance between the block's patch and the piece of input that the root
/// stands for, as long as no neighbour brings samples that the block lacks. Where a neighbour in the cut is finer and
/// has more samples on a shared arc, the root's border triangles take these (see [`crate::Cut`]), and the bound is
/// `error + border_deviation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockContents {
    /// The level; 0 is the coarsest.
    pub level: u8,
    /// Bound of the distance to the input where no neighbour is finer, world units.
    pub error: f64,
    /// What is added to the error where any neighbour is finer, world units.
    pub border_deviation: f64,
    /// Triangles of the block's patch.
    pub triangle_count: u32,
}

impl Index {
    /// What the index says about a root.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no such root; [`Error::Format`], [`Error::Limit`].
    pub fn root_contents(&self, root: u32) -> Result<RootContents> {
        self.check_root(root)?;
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

    /// World box around everything that a root draws and around the piece of input that it stands for.
    ///
    /// # Errors
    /// [`Error::Missing`]; [`Error::Query`] if there is no such root; [`Error::Format`].
    pub fn root_bounds(&self, root: u32) -> Result<[[f64; 3]; 2]> {
        self.check_root(root)?;
        Ok(self.root_entry(root)?.bounds.map(|point| self.lattice().world(point)))
    }

    pub(super) fn check_root(&self, root: u32) -> Result<()> {
        let count = self.root_count();
        if root < count {
            Ok(())
        } else {
            Err(Error::Query { what: format!("there is no root {root}: the file has {count}") })
        }
    }
}
