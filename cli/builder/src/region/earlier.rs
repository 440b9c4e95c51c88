//! The regions of an earlier job, for a new job in which some are the same.

use std::collections::BTreeMap;

use super::{Region, RegionDirectory, RegionStats};

/// The regions of a planned job by the hash of their input.
#[derive(Debug)]
pub struct Earlier {
    store: RegionDirectory,
    by_input: BTreeMap<u64, usize>,
    /// Input triangles per chart to aim for in that job.
    chart_triangles: u32,
}

impl Earlier {
    /// Takes all regions of the job that exist and are undamaged. A single region is left out, because it was not
    /// prepared for neighbours.
    pub fn new(store: RegionDirectory, chart_triangles: u32) -> Self {
        let several = if store.count() > 1 { 0..store.count() } else { 0..0 };
        let by_input = several.filter_map(|region| Some((store.stats(region)?.input, region))).collect();
        Self { store, by_input, chart_triangles }
    }

    /// The directory of the regions.
    pub fn store(&self) -> &RegionDirectory {
        &self.store
    }

    /// The region that was made from the same triangles.
    pub fn region_of(&self, input: u64) -> Option<usize> {
        self.by_input.get(&input).copied()
    }

    /// The repaired region that was made from the same triangles.
    pub(super) fn repaired(&self, input: u64) -> Option<(Region, RegionStats)> {
        let index = self.region_of(input)?;
        let stats = self.store.stats(index)?;
        let reversed = self.store.reversed(index)?;
        let (mut region, _) = self.store.load_charted(index).ok()?;
        region.reverse(&reversed);
        region.labels.clear();
        Some((region, stats))
    }

    /// The charts of the region that was made from the same triangles and reversed in the same components.
    pub fn labels(&self, input: u64, region: &Region, chart_triangles: u32) -> Option<Vec<u32>> {
        let index = self.region_of(input).filter(|_| chart_triangles == self.chart_triangles)?;
        let (earlier, _) = self.store.load_charted(index).ok()?;
        (earlier.mesh == region.mesh && earlier.adjacency == region.adjacency).then_some(earlier.labels)
    }
}
