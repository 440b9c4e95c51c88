//! From repaired regions to charts: what has to be known of all regions before any of them can be built.

use lodpack::SourceInfo;
use serde::{Deserialize, Serialize};

use super::{BuildError, BuildOptions, Effort, Fillings, Scale};
use crate::atlas::Seams;
use crate::memory::{least_bytes, region_bytes};
use crate::progress::Progress;
use crate::region::{Border, BorderSketch, Extent, Region, RegionError, RegionStore, Regions, find_seams};
use crate::repair::RepairReport;
use crate::segment::{SegmentOptions, segment_charts};

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

/// Cuts all regions into charts and finds the arcs that these share.
pub(crate) fn prepare(
    regions: Regions,
    input_triangles: u64,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<Prepared, BuildError> {
    let Regions { mut store, facts, matching, repairs } = regions;
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
    let charts = |region: &Region, border: &Border| chart_region(region, border, &segment_options, alone);
    let charted = store.set_labels(&facts, progress, charts).map_err(RegionError::from)?;
    let (counts, sketches): (Vec<u64>, Vec<BorderSketch>) = charted.into_iter().unzip();
    let borders: Vec<&Border> = facts.iter().map(|facts| &facts.border).collect();
    let seams = if alone { vec![Seams::default()] } else { find_seams(&borders, &matching, &sketches) };

    let source = SourceInfo {
        triangle_count: extent.triangles,
        vertex_count: extent.vertices,
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
    };
    Ok(Prepared { sizes: sizes.collect(), plan, store, seams })
}

/// Cuts a region into charts; how many there are and, unless it is all there is, what they do at its border.
fn chart_region(
    Region { mesh, adjacency, .. }: &Region,
    border: &Border,
    options: &SegmentOptions,
    alone: bool,
) -> (Vec<u32>, (u64, BorderSketch)) {
    let labels = segment_charts(mesh, adjacency, options);
    let count = labels.iter().max().map_or(0, |&last| u64::from(last) + 1);
    let sketch = if alone { BorderSketch::default() } else { BorderSketch::new(mesh, adjacency, border, &labels) };
    (labels, (count, sketch))
}
