//! From repaired regions to charts, and to everything that has to be known of all regions before one of them can be
//! built.

use lodpack::index::Placement;
use lodpack::index::SourceInfo;
use serde::{Deserialize, Serialize};

use super::coarse::coarse_triangles;
use super::overview::OVERVIEW_FROM_ROOTS;
use super::scale::{Heights, largest_chart};
use super::{Effort, Fillings, LevelChoice, ModelOptions, PipelineError, Scale};
use crate::region::{
    BoundarySketch, Earlier, Extent, Matching, Nodes, Region, RegionBoundary, RegionError, RegionStats, RegionStore,
    Regions, find_seams,
};
use lodpack_mesh::appearance::Appearance;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::{least_bytes, region_bytes};
use lodpack_stage::arcs::Seams;
use lodpack_stage::group;
use lodpack_stage::pack::{chart_weights, pack_parts};
use lodpack_stage::repair::RepairReport;
use lodpack_stage::segment::{SegmentOptions, halve_heavy, keep_charts, segment_charts};
use lodpack_stage::subdivide::texel_shares;

/// The tops of regions to which more may be added bring along what those of this many regions do. A merge of more
/// leaves some of it out.
const REGIONS_OF_EXTENSIBLE: u32 = 4;

/// Where images repeat, as those of bricks do, a file shows the surface with at most this many times their texels.
const MOST_REPEATS: f64 = 16.0;
/// It may always have this many, which take 100 MB, about.
const MOST_REPEATED: f64 = 1_073_741_824.0;

/// What is known once all regions are cut into charts: enough to build each region by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Plan {
    pub scale: Scale,
    pub effort: Effort,
    pub fillings: Fillings,
    pub levels: LevelChoice,
    pub source: SourceInfo,
    /// Where the surface is in the world, if it is known.
    pub placement: Option<Placement>,
    /// Before repair.
    pub input_triangles: u64,
    pub repairs: RepairReport,
    /// The number of charts in all regions.
    pub charts: u64,
    /// The number of regions.
    pub regions: u32,
    /// Triangles to which the coarse surfaces of each region are simplified, where there are several regions.
    pub coarse_triangles: u64,
    /// Whether a region's product must not depend on the number of roots elsewhere, so that more can be added later.
    pub extensible: bool,
    /// How the surface looks.
    pub appearance: Appearance,
    /// What the input names, as far as it is kept.
    pub nodes: Nodes,
    /// The step of quantisation of colours, of 255; 0 if nothing of them may be lost.
    pub colour_step: u8,
    /// The share of the texels of images on the surface that the file shows.
    pub texel_share: f64,
}

impl Plan {
    /// Whether two extensible jobs build the same product from a region that both have, but for the levels above
    /// regions.
    pub fn builds_like(&self, other: &Self) -> bool {
        let of = |plan: &Self| {
            let scale = plan.scale.of_regions();
            let texels = (plan.colour_step, plan.texel_share);
            (scale, plan.effort, plan.fillings, plan.levels, plan.regions > 1, plan.coarse_triangles, texels)
        };
        self.extensible && of(self) == of(other) && other.appearance.continues(&self.appearance)
    }

    /// How many regions share what tops may bring along when they are built: where more may come, that must not depend
    /// on how many there are now.
    pub fn sharing_regions(&self) -> u32 {
        if self.extensible { REGIONS_OF_EXTENSIBLE } else { self.regions }
    }

    /// Whether the file has, or may later have, enough roots to need an overview.
    pub fn has_overview(&self) -> bool {
        self.levels == LevelChoice::All && (self.extensible || self.charts >= OVERVIEW_FROM_ROOTS)
    }
}

/// The amount of work in a region.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RegionSize {
    pub triangles: u64,
    pub vertices: u64,
    pub charts: u64,
    /// Bytes of its attributes, and of decoding an image that they need.
    pub attribute_bytes: u64,
}

impl RegionSize {
    /// Bytes of memory that building the region takes.
    pub fn memory(&self) -> u64 {
        least_bytes(region_bytes(self.vertices, self.triangles) + self.attribute_bytes)
    }
}

/// Regions that are cut into charts.
pub(crate) struct Prepared {
    pub plan: Plan,
    pub store: RegionStore,
    /// By region.
    pub sizes: Vec<RegionSize>,
    /// By region.
    pub seams: Vec<Seams>,
}

/// Cuts all regions into charts, or takes the charts of an earlier job, and finds the arcs that regions share.
pub(crate) fn prepare(
    regions: Regions,
    input_triangles: u64,
    options: &ModelOptions,
    earlier: Option<&Earlier>,
    progress: &dyn Progress,
) -> Result<Prepared, PipelineError> {
    let Regions { mut store, stats, matching, doubled_vertices, repairs, appearance, nodes } = regions;
    let whole = Whole::of(&stats, input_triangles, &appearance, options)?;
    whole.note_repeats(progress);

    // Every chart is connected; every loop of a chart has at least three arcs.
    progress.begin("segment", whole.extent.triangles);
    let cutter = whole.cutter(options);
    let charts = |region: &Region, stats: &RegionStats| {
        let labels = earlier.and_then(|earlier| earlier.labels(stats.input, region, whole.scale.chart_triangles));
        cutter.cut(region, labels, &stats.boundary)
    };
    let charted = store.set_labels(&stats, progress, charts).map_err(RegionError::from)?;
    let (counts, sketches): (Vec<ChartCount>, Vec<BoundarySketch>) = charted.into_iter().unzip();
    let seams = seams_of(&stats, &matching, &sketches);
    let found = Found { input_triangles, doubled_vertices, repairs, appearance, nodes };
    let (plan, sizes) = whole.plan(&stats, &counts, found, options);
    Ok(Prepared { plan, store, sizes, seams })
}

/// The seams of all regions. `stats` are those after components were reversed.
pub(crate) fn seams_of(stats: &[RegionStats], matching: &Matching, sketches: &[BoundarySketch]) -> Vec<Seams> {
    let boundaries: Vec<&RegionBoundary> = stats.iter().map(|stats| &stats.boundary).collect();
    if stats.len() == 1 { vec![Seams::default()] } else { find_seams(&boundaries, matching, sketches) }
}

/// All repaired regions together: with it, each can be cut into charts by itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Whole {
    pub extent: Extent,
    /// Without the levels of groups.
    pub scale: Scale,
    /// The most triangles of a chart that the input brings.
    largest_chart: u32,
    /// Whether there is only one region.
    alone: bool,
    /// What triangles show.
    appearance: Appearance,
    /// The share of the texels of images on the surface that the file shows.
    pub texel_share: f64,
}

/// What was found of an input before its regions were cut into charts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Found {
    pub input_triangles: u64,
    pub doubled_vertices: u64,
    pub repairs: RepairReport,
    pub appearance: Appearance,
    pub nodes: Nodes,
}

impl Whole {
    pub fn of(
        stats: &[RegionStats],
        input_triangles: u64,
        appearance: &Appearance,
        options: &ModelOptions,
    ) -> Result<Self, PipelineError> {
        let extents = stats.iter().map(|stats| stats.extent.clone()).filter(|extent| extent.triangles > 0);
        let Some(extent) = extents.reduce(Extent::plus) else {
            return Err(PipelineError::Empty { dropped: input_triangles });
        };
        let texels_each = appearance.texels_each(input_triangles);
        let scale = Scale::new(&extent, texels_each, options)?;
        let largest_chart = largest_chart(texels_each).max(scale.chart_triangles.saturating_mul(2));
        let (alone, appearance) = (stats.len() == 1, appearance.clone());
        let texel_share = texel_share(extent.texels, appearance.texels);
        Ok(Self { extent, scale, largest_chart, alone, appearance, texel_share })
    }

    /// Notes it if the file shows fewer texels than there are on the surface.
    pub fn note_repeats(&self, progress: &dyn Progress) {
        if self.texel_share < 1.0 {
            let [all, kept] = [1.0, self.texel_share].map(|share| share * self.extent.texels / 1e6);
            progress.note(&format!(
                "images repeat: {all:.0} million texels of them are on the surface, and the file shows it with {kept:.0} million"
            ));
        }
    }

    /// What cuts a region into charts.
    pub fn cutter(&self, options: &ModelOptions) -> ChartCutter<'_> {
        let target_triangles = self.scale.chart_triangles;
        let segment = SegmentOptions { target_triangles, ..SegmentOptions::default() };
        let Self { largest_chart: largest, alone, ref appearance, texel_share, .. } = *self;
        ChartCutter { segment, largest, alone, packs: options.has_tree(), appearance, texel_share }
    }

    /// The plan, and the size of each region, given the number of charts in each.
    pub fn plan(
        &self,
        stats: &[RegionStats],
        counts: &[ChartCount],
        found: Found,
        options: &ModelOptions,
    ) -> (Plan, Vec<RegionSize>) {
        let Self { extent, mut scale, .. } = self.clone();
        let source = SourceInfo {
            triangle_count: extent.undivided_triangles(),
            vertex_count: extent.vertices - extent.added_vertices - found.doubled_vertices,
            mean_edge_length: scale.mean_edge_length,
            area: extent.area,
            generator: concat!("lodpack ", env!("CARGO_PKG_VERSION")).into(),
        };
        let chart = f64::from(scale.chart_triangles);
        let heights = counts.iter().map(|count| group::heights(count.charts, count.weight, chart)).max();
        let by_shape = counts
            .iter()
            .zip(stats)
            .map(|(count, stats)| group::heights(count.charts, stats.extent.undivided_triangles(), chart));
        let has_tree = options.has_tree();
        if let Some(mut in_regions) = heights.filter(|_| has_tree) {
            let largest = options.division(found.input_triangles, &found.appearance).triangles;
            let may_grow = Some(largest).filter(|_| options.extensible && !self.alone);
            let mut by_shape = by_shape.max().unwrap_or(0);
            if let Some(largest) = may_grow {
                // A region that gets triangles later must not need more.
                let most = group::heights(2, largest, chart);
                (in_regions, by_shape) = (in_regions.max(most), by_shape.max(most));
            }
            let weight = counts.iter().map(|count| count.weight).sum();
            let above = group::heights(counts.len() as u64, weight, group::size(chart, in_regions));
            let triangles = extent.undivided_triangles();
            let above_by_shape = group::heights(counts.len() as u64, triangles, group::size(chart, by_shape));
            let of_texels = (in_regions + above).saturating_sub(by_shape + above_by_shape);
            if in_regions + above > 0 {
                let [low, high] = extent.bounds;
                let heights = Heights { in_regions, above, of_texels, may_grow };
                scale = scale.with_heights(heights, low.distance(high));
            }
        }
        let decoding_bytes = found.appearance.decoding_bytes;
        let sizes = stats.iter().zip(counts).map(|(stats, &ChartCount { charts, .. })| {
            let Extent { triangles, vertices, .. } = stats.extent;
            let attribute_bytes = stats.attribute_bytes + decoding_bytes;
            RegionSize { triangles, vertices, charts, attribute_bytes }
        });
        let plan = Plan {
            scale,
            effort: options.effort,
            fillings: options.fillings,
            levels: options.levels,
            source,
            placement: options.placement.clone(),
            input_triangles: found.input_triangles,
            repairs: found.repairs,
            charts: counts.iter().map(|count| count.charts).sum(),
            regions: stats.len() as u32,
            coarse_triangles: coarse_triangles(stats.len() as u64, options.extensible),
            extensible: options.extensible,
            colour_step: options.colour_quality.step_of(&found.appearance),
            texel_share: self.texel_share,
            appearance: found.appearance,
            nodes: found.nodes,
        };
        (plan, sizes.collect())
    }
}

/// The share that a file shows of the texels on the surface, given those of the images.
fn texel_share(on_surface: f64, of_images: u64) -> f64 {
    let most = MOST_REPEATED.max(MOST_REPEATS * of_images as f64);
    if on_surface > most { most / on_surface } else { 1.0 }
}

/// The charts of a region.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct ChartCount {
    pub charts: u64,
    /// What they weigh together ([`chart_weights`]).
    pub weight: u64,
}

/// Cuts regions into charts.
pub(crate) struct ChartCutter<'a> {
    segment: SegmentOptions,
    /// The most triangles of a chart that the input brings.
    largest: u32,
    /// Whether there is only one region.
    alone: bool,
    /// Whether small parts share charts.
    packs: bool,
    /// What its triangles show, and the share of it that the file shows.
    appearance: &'a Appearance,
    texel_share: f64,
}

impl ChartCutter<'_> {
    /// Cuts a region into charts unless it has `labels` already, or the input has brought charts, which stay as they
    /// are. Returns the labels, the charts and, where there are other regions, what these do at the region's boundary.
    pub fn cut(
        &self,
        Region { mesh, adjacency, attributes, .. }: &Region,
        labels: Option<Vec<u32>>,
        boundary: &RegionBoundary,
    ) -> (Vec<u32>, (ChartCount, BoundarySketch)) {
        let shares = texel_shares(attributes, self.appearance, mesh.triangles.len(), self.texel_share);
        let target = self.segment.target_triangles;
        let segment = || {
            if !attributes.charts.is_empty() {
                return keep_charts(mesh, adjacency, &attributes.charts, self.largest, &self.segment);
            }
            let mut labels = segment_charts(mesh, adjacency, &self.segment);
            if !shares.is_empty() {
                halve_heavy(adjacency, &shares, 1.0, &mut labels);
            }
            match self.packs {
                true => pack_parts(mesh, adjacency, labels, target, self.alone, &shares),
                false => labels,
            }
        };
        let labels = labels.unwrap_or_else(segment);
        let weights = chart_weights(&labels, target, &shares);
        let count = ChartCount { charts: weights.len() as u64, weight: weights.iter().sum() };
        let sketch = match self.alone {
            true => BoundarySketch::default(),
            false => BoundarySketch::new(mesh, adjacency, boundary, &labels),
        };
        (labels, (count, sketch))
    }
}
