//! What an earlier job has done of regions that are the same in a new one.

use std::collections::BTreeMap;

use super::{Region, RegionDirectory, RegionFacts};

/// The regions of a job that has been planned, by what they were made from.
#[derive(Debug)]
pub struct Earlier {
    store: RegionDirectory,
    by_input: BTreeMap<u64, usize>,
    /// Triangles that its charts should have.
    chart_triangles: u32,
}

impl Earlier {
    /// All regions of the job that are there and sound. A region that was all there is has not been prepared for neighbours.
    pub fn new(store: RegionDirectory, chart_triangles: u32) -> Self {
        let several = if store.count() > 1 { 0..store.count() } else { 0..0 };
        let by_input = several.filter_map(|region| Some((store.facts(region)?.input, region))).collect();
        Self { store, by_input, chart_triangles }
    }

    /// Where the regions are.
    pub fn store(&self) -> &RegionDirectory {
        &self.store
    }

    /// The region that was made from the same triangles.
    pub fn region_of(&self, input: u64) -> Option<usize> {
        self.by_input.get(&input).copied()
    }

    /// What repair made of the same triangles.
    pub(super) fn repaired(&self, input: u64) -> Option<(Region, RegionFacts)> {
        let index = self.region_of(input)?;
        let facts = self.store.facts(index)?;
        let reversed = self.store.reversed(index)?;
        let (mut region, _) = self.store.load_charted(index).ok()?;
        region.reverse(&reversed);
        region.labels.clear();
        Some((region, facts))
    }

    /// The charts of a region that was made from the same triangles and turned over in the same way.
    pub fn labels(&self, input: u64, region: &Region, chart_triangles: u32) -> Option<Vec<u32>> {
        let index = self.region_of(input).filter(|_| chart_triangles == self.chart_triangles)?;
        let (earlier, _) = self.store.load_charted(index).ok()?;
        (earlier.mesh == region.mesh && earlier.adjacency == region.adjacency).then_some(earlier.labels)
    }
}
