//! From repaired regions to charts: what has to be known of all regions before any of them can be built.

use lodpack::index::SourceInfo;
use serde::{Deserialize, Serialize};

use super::coarse::coarse_triangles;
use super::overview::OVERVIEW_FROM_ROOTS;
use super::{BuildError, BuildOptions, Effort, Fillings, Scale};
use crate::progress::Progress;
use crate::region::{
    Border, BorderSketch, Earlier, Extent, Region, RegionError, RegionFacts, RegionStore, Regions, find_seams,
};
use crate::stage::arcs::Seams;
use crate::stage::repair::RepairReport;
use crate::stage::segment::{SegmentOptions, segment_charts};
use crate::storage::memory::{least_bytes, region_bytes};

/// What is known of all regions once they are cut into charts: with it each is built by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Plan {
    pub scale: Scale,
    pub effort: Effort,
    pub fillings: Fillings,
    pub source: SourceInfo,
    /// Before repair.
    pub input_triangles: u64,
    pub repairs: RepairReport,
    /// How many charts all regions have together.
    pub charts: u64,
    /// How many regions there are.
    pub regions: u32,
    /// Triangles that the coarse surfaces of each region are thinned to, where there are several regions.
    pub coarse_triangles: u64,
    /// Whether what is built of a region must not depend on how many roots there are elsewhere.
    pub extensible: bool,
}

impl Plan {
    /// Whether of two jobs to which more can be added each builds the same of a region that both have.
    pub fn builds_like(&self, other: &Self) -> bool {
        // The mean edge is for people.
        let of = |plan: &Self| {
            let scale = Scale { mean_edge_length: 0.0, ..plan.scale.clone() };
            (scale, plan.effort, plan.fillings, plan.regions > 1, plan.coarse_triangles)
        };
        self.extensible && of(self) == of(other)
    }

    /// Whether there are so many roots that the file may need an overview, or may be more later.
    pub fn has_overview(&self) -> bool {
        self.extensible || self.charts >= OVERVIEW_FROM_ROOTS
    }
}

/// How much there is to do for a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RegionSize {
    pub triangles: u64,
    pub vertices: u64,
    pub charts: u64,
}

impl RegionSize {
    /// Memory that building the region takes.
    pub fn memory(&self) -> u64 {
        least_bytes(region_bytes(self.vertices, self.triangles))
    }
}

/// Regions that are cut into charts.
pub(crate) struct Prepared {
    pub plan: Plan,
    pub store: RegionStore,
    /// Of each region.
    pub sizes: Vec<RegionSize>,
    /// Of each region.
    pub seams: Vec<Seams>,
}

/// Cuts all regions into charts, or takes those of an earlier job, and finds the arcs that these share.
pub(crate) fn prepare(
    regions: Regions,
    input_triangles: u64,
    options: &BuildOptions,
    earlier: Option<&Earlier>,
    progress: &dyn Progress,
) -> Result<Prepared, BuildError> {
    let Regions { mut store, facts, matching, doubled_vertices, repairs } = regions;
    let extents = facts.iter().map(|facts| facts.extent).filter(|extent| extent.triangles > 0);
    let Some(extent) = extents.reduce(Extent::plus) else {
        let input = options.inputs.first().map(|p| p.display().to_string()).unwrap_or_default();
        return Err(BuildError::Empty { input, dropped: input_triangles });
    };
    let scale = Scale::new(&extent, options)?;

    // Every chart is connected; every loop of a chart has at least three arcs.
    progress.begin("segment", extent.triangles);
    let segment_options = SegmentOptions { target_triangles: scale.chart_triangles, ..SegmentOptions::default() };
    let alone = store.count() == 1;
    let charts = |region: &Region, facts: &RegionFacts| {
        let labels = earlier.and_then(|earlier| earlier.labels(facts.input, region, scale.chart_triangles));
        chart_region(region, labels, &facts.border, &segment_options, alone)
    };
    let charted = store.set_labels(&facts, progress, charts).map_err(RegionError::from)?;
    let (counts, sketches): (Vec<u64>, Vec<BorderSketch>) = charted.into_iter().unzip();
    let borders: Vec<&Border> = facts.iter().map(|facts| &facts.border).collect();
    let seams = if alone { vec![Seams::default()] } else { find_seams(&borders, &matching, &sketches) };

    let source = SourceInfo {
        triangle_count: extent.triangles,
        vertex_count: extent.vertices - doubled_vertices,
        mean_edge_length: scale.mean_edge_length,
        area: extent.area,
        generator: concat!("lodpack ", env!("CARGO_PKG_VERSION")).into(),
    };
    let charts = counts.iter().sum();
    let sizes = facts.iter().zip(counts).map(|(facts, charts)| {
        let Extent { triangles, vertices, .. } = facts.extent;
        RegionSize { triangles, vertices, charts }
    });
    let plan = Plan {
        scale,
        effort: options.effort,
        fillings: options.fillings,
        source,
        input_triangles,
        repairs,
        charts,
        regions: facts.len() as u32,
        coarse_triangles: coarse_triangles(facts.len() as u64, options.extensible),
        extensible: options.extensible,
    };
    Ok(Prepared { sizes: sizes.collect(), plan, store, seams })
}

/// Cuts a region into charts, if it is not yet; how many there are and, unless it is all there is, what they do at its border.
fn chart_region(
    Region { mesh, adjacency, .. }: &Region,
    labels: Option<Vec<u32>>,
    border: &Border,
    options: &SegmentOptions,
    alone: bool,
) -> (Vec<u32>, (u64, BorderSketch)) {
    let labels = labels.unwrap_or_else(|| segment_charts(mesh, adjacency, options));
    let count = labels.iter().max().map_or(0, |&last| u64::from(last) + 1);
    let sketch = if alone { BorderSketch::default() } else { BorderSketch::new(mesh, adjacency, border, &labels) };
    (labels, (count, sketch))
}
