//! Gathering the triangles of an input by region, before they are written in large pieces.

use glam::DVec3;

use super::decompose::Decomposition;
use super::split::centroid;
use lodpack_runtime::storage::WorkError;

/// Triangles to gather before they are written: 12 MiB.
const GATHERED: usize = 1 << 20;

/// Triangles of a region, and their numbers in the input where they have attributes.
#[derive(Clone, Debug, Default)]
pub(super) struct Gathered {
    pub triangles: Vec<[u32; 3]>,
    pub numbers: Vec<u32>,
}

/// Sends triangles to their regions.
pub(super) struct Gathering<'a> {
    tree: &'a Decomposition,
    gathered: Vec<Gathered>,
    held: usize,
    /// Triangles of each region so far.
    counts: Vec<u64>,
    /// The number of the next triangle, where numbers are kept.
    next: Option<u32>,
}

impl<'a> Gathering<'a> {
    /// `first` is the number of the first triangle.
    pub fn new(tree: &'a Decomposition, has_attributes: bool, first: u32) -> Self {
        let regions = tree.region_count() as usize;
        let (gathered, counts) = (vec![Gathered::default(); regions], vec![0; regions]);
        Self { tree, gathered, held: 0, counts, next: has_attributes.then_some(first) }
    }

    /// Adds the next triangle. `write` takes what has been gathered by region, and leaves nothing of it.
    #[inline]
    pub fn push(
        &mut self,
        triangle: [u32; 3],
        position: impl Fn(u32) -> DVec3,
        write: &mut impl FnMut(&mut [Gathered]) -> Result<(), WorkError>,
    ) -> Result<(), WorkError> {
        let region = self.tree.region_of(centroid(triangle.map(position))) as usize;
        self.gathered[region].triangles.push(triangle);
        if let Some(next) = &mut self.next {
            self.gathered[region].numbers.push(*next);
            *next += 1;
        }
        self.counts[region] += 1;
        self.held += 1;
        if self.held == GATHERED {
            write(&mut self.gathered)?;
            self.held = 0;
        }
        Ok(())
    }

    /// Writes the rest; returns how many triangles each region got.
    pub fn finish(
        mut self,
        write: &mut impl FnMut(&mut [Gathered]) -> Result<(), WorkError>,
    ) -> Result<Vec<u64>, WorkError> {
        write(&mut self.gathered)?;
        Ok(self.counts)
    }
}
