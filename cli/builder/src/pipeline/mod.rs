//! The pipeline: the order of the stages.
//!
//! `build_in_memory` is the whole of it, and `build_region` what happens to one region. A build whose input does not
//! fit in memory takes the same steps with files in between ([`crate::job`]), so it writes the same bytes.
//!
//! | file | step |
//! |---|---|
//! | `scale` | from the extent of the input and the tolerance to all lengths: levels, lattice, size of charts |
//! | `plan` | regions are cut into charts, and seams between regions get their corners |
//! | `shared_arcs` | arcs are sampled and quantised, once for both sides |
//! | `roots`, `root_builder`, `chart_work` | charts become roots, again and again until their borders are settled |
//! | `fill`, `fillings` | what a filling is, and the table by which all other steps know them |
//! | `irregular`, `grid`, `choose` | the fillings of a chart, and which one it gets |
//! | `divided` | edges that charts would have in common, and flat ears, get a vertex |
//! | `region_progress` | how far a region is |
//! | `groups` | groups of charts above them, up to one for the region |
//! | `paint`, `texels` | blocks get images of what the input shows |
//! | `redundant_levels` | levels that add nothing are removed |
//! | `owners` | the object of each island of a block |
//! | `drawn` | what is drawn of a root, and where all that is drawn is of one level |
//! | `product` | what a region contributes to the file |
//! | `coarse`, `overview` | the coarsest levels as one surface, which becomes the overview |
//! | `join` | the products of all regions become one file |

mod chart_work;
mod choose;
mod coarse;
mod density;
mod divided;
mod drawn;
mod even;
mod fill;
mod fillings;
mod grid;
mod groups;
mod irregular;
mod join;
mod options;
mod overview;
mod owners;
mod paint;
mod plan;
mod product;
mod redundant_levels;
mod region_progress;
mod root_builder;
mod roots;
mod scale;
mod shared_arcs;
mod sharp;
pub mod summary;
mod texels;

pub(crate) use join::{Arranged, Products, Sums, arrange, join, join_encoded};
pub use options::{ColourQuality, Effort, Fillings, LevelChoice, ModelOptions, PipelineError};
pub use overview::{OVERVIEW_FROM_BYTES, OVERVIEW_FROM_ROOTS, OVERVIEW_TRIANGLES};
pub(crate) use paint::Studio;
pub(crate) use plan::{ChartCount, Found, Plan, Prepared, RegionSize, Whole, prepare, seams_of};
pub(crate) use product::{ProductStats, RegionProduct};
pub use scale::{LevelPlan, Scale};

use std::convert::Infallible;
use std::io::Write;
use std::path::Path;

use crate::region::{Region, RegionStore, Regions, settle_objects};
use groups::above_regions::tops;
use groups::net::Net;
use groups::{Forest, node_of_chart};
use lodpack_mesh::attributes::Surface;
use lodpack_mesh::{Adjacency, Mesh};
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::trace;
use lodpack_stage::arcs::{Atlas, Seams, trace_arcs_to_bends};
use lodpack_stage::areas::{Areas, ColourAreas, Jumps};
use lodpack_stage::pack::chart_weights;
use lodpack_stage::subdivide::texel_shares;
use paint::PaintedRegion;
use redundant_levels::{remove_empty_levels, remove_redundant_levels};
use region_progress::RegionProgress;
use roots::build_roots;
use shared_arcs::SharedArcs;
use summary::{BuildSummary, Fallbacks, Stopwatch, Times};

/// Builds a file from a mesh in memory. The bytes depend on the mesh and the options alone; its images take a share of
/// the memory.
pub(crate) fn build_in_memory(
    mut surface: Surface,
    options: &ModelOptions,
    memory: u64,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
) -> Result<BuildSummary, PipelineError> {
    let input_triangles = surface.mesh.triangles.len() as u64;
    Scale::check_size(surface.mesh.bounds())?;
    let Surface { mesh, attributes, .. } = &mut surface;
    let settled = settle_objects(options.kept_objects(), attributes, input_triangles, memory, progress, &mut |visit| {
        (0..mesh.triangles.len() as u32).for_each(|triangle| visit(mesh.corners(triangle)));
        Ok(())
    });
    settled.unwrap_or_else(|never: Infallible| match never {});

    progress.begin("repair", 0);
    let division = options.division(input_triangles, &surface.appearance);
    let regions = Regions::in_memory(surface, division);
    watch.lap("repair");
    // Every edge has one or two triangles, consistently wound; every vertex has one fan. Boundary edges at which two
    // regions meet know each other.

    let Prepared { store, plan, seams, .. } = prepare(regions, input_triangles, options, None, progress)?;
    watch.lap("segment");
    // Every chart is connected, and each of its loops has at least three arcs. Both sides of a seam end its arcs at the
    // same corners. No region needs to know more of the others.

    progress.begin("roots", plan.charts);
    let RegionStore::Memory(regions) = store else { unreachable!("nothing has been written") };
    let regions = regions.into_iter().zip(&seams);
    let note = |text: &str| progress.note(text);
    let studio = Studio::new(&plan.appearance, None, scratch, memory, &note);
    let products = regions.map(|(region, seams)| build_region(&region, seams, &plan, &studio, progress));
    let products = products.collect::<Result<Vec<_>, PipelineError>>()?;
    // Neighbouring roots share their arcs bit for bit, and the stored error of every root's finest block is within the
    // tolerance, unless even the input's own triangles are farther off once they are quantised.

    join(&plan, &products, scratch, out, progress, watch, Times::default())
}

/// Builds all roots of a region that is cut into charts.
pub(crate) fn build_region(
    region: &Region,
    seams: &Seams,
    plan: &Plan,
    studio: &Studio<'_>,
    progress: &dyn Progress,
) -> Result<RegionProduct, PipelineError> {
    let Region { mesh, adjacency, labels, attributes } = region;
    let start = thread_cpu_time();
    let scale = &plan.scale;
    // A grid lies between few corners.
    let has_grids = plan.fillings != Fillings::IrregularOnly;
    let straight = if has_grids { f64::INFINITY } else { scale.straight_boundary() };
    let step = trace::step("arcs");
    let atlas = trace_arcs_to_bends(mesh, adjacency, labels, seams, straight);
    let coarsest = if atlas.charts.len() > 1 { scale.coarsest_of_charts } else { scale.coarsest_of_regions };
    let has_channels = !plan.appearance.is_empty();
    let start_of_areas = thread_cpu_time();
    let areas = if has_channels {
        // What differs by less than some steps is no line: without steps as little as with the smallest.
        studio.shader.painter(attributes).colour_areas(mesh, adjacency, plan.colour_step.max(1))
    } else {
        None
    };
    let areas_time = thread_cpu_time() - start_of_areas;
    let areas = areas.as_ref();
    let objects = &attributes.objects;
    let charted = ChartedMesh { mesh, adjacency, labels, objects, atlas: &atlas, scale, coarsest, has_channels, areas };
    let mut arcs = SharedArcs::new(&charted)?;
    drop(step);
    let arcs_time = thread_cpu_time() - start - areas_time;
    // Both sides of an arc see the same samples from here on, whatever is added to them.

    // Palettes take next to no time.
    let is_baked = has_channels && !even::are_palettes(&charted, &texels::storage(&plan.appearance, plan.colour_step));
    let progress = &RegionProgress::new(progress, atlas.charts.len() as u64, coarsest > 0, is_baked);
    let mut fallbacks = Fallbacks::default();
    let (roots, mut interior_vertices, mut times) =
        build_roots(&charted, plan.fillings, &mut arcs, &mut fallbacks, progress)?;
    times.arcs += arcs_time;
    times.texels += areas_time;
    // Every block of a root has a certified error, and finer blocks never have larger ones.

    let net = Net::of_region(&charted, &arcs);
    let (mut records, mut drawn, mut nodes) = (vec![], vec![], vec![]);
    for ((number, root), chart) in (0..).zip(roots).zip(&atlas.charts) {
        if coarsest > 0 {
            nodes.push(node_of_chart(&net, scale, number, chart.loops.clone(), &root, coarsest));
        }
        records.push(root.record);
        if has_channels {
            drawn.push(root.drawn);
        }
    }
    let mut forest = Forest::new(&net, scale, [scale.coarsest_of_regions, coarsest], records, drawn, nodes);
    forest.jumps = charted.jumps();
    let shares = texel_shares(attributes, &plan.appearance, labels.len(), plan.texel_share);
    let weights = chart_weights(labels, scale.chart_triangles, &shares);
    if coarsest > 0 {
        forest.add_groups(&weights, f64::from(scale.chart_triangles), &mut times);
        interior_vertices += forest.interior_vertices;
    }
    progress.grouped();
    // Errors never grow from a group to its members.

    if has_channels {
        let painted = PaintedRegion {
            charted: &charted,
            arcs: &arcs,
            attributes,
            appearance: &plan.appearance,
            texel_share: plan.texel_share,
            studio,
        };
        let (time, coarser) = even::paint(&painted, &mut forest.records, &forest.drawn, plan.colour_step, progress);
        times.texels += time;
        fallbacks.coarser_images += coarser;
        studio.shader.check()?;
    }
    // Each block has an image of what the input shows where the block lies.

    progress.finish();
    let _step = trace::step("product");
    let start = thread_cpu_time();
    let has_above = scale.coarsest_of_regions > 0;
    let tops = if has_above { tops(&forest, weights.iter().sum(), plan.sharing_regions()) } else { vec![] };
    let Forest { records, corner_levels, .. } = forest;
    let mut model = product::model(plan, &atlas, arcs, records);
    model.corner_levels = corner_levels;
    if plan.regions == 1 {
        if coarsest == 0 { remove_redundant_levels(&mut model) } else { remove_empty_levels(&mut model) }
    }
    let mut product = RegionProduct::new(&model, plan, product::shares(&atlas, seams), interior_vertices)?;
    times.encode += thread_cpu_time() - start;
    (product.stats.fallbacks, product.stats.times, product.stats.tops) = (fallbacks, times, tops);
    Ok(product)
}

/// The mesh of a region, cut into charts: every later stage reads it, and none changes it.
#[derive(Clone, Copy)]
pub(crate) struct ChartedMesh<'a> {
    pub mesh: &'a Mesh,
    pub adjacency: &'a Adjacency,
    /// The chart of each triangle.
    pub labels: &'a [u32],
    /// The object of each triangle; empty if there are none.
    pub objects: &'a [u32],
    pub atlas: &'a Atlas,
    pub scale: &'a Scale,
    /// The coarsest level of its charts; groups have the levels above.
    pub coarsest: u8,
    /// Whether its blocks get texels.
    pub has_channels: bool,
    /// Parts between which its colours jump, if they do somewhere.
    pub areas: Option<&'a ColourAreas>,
}

impl<'a> ChartedMesh<'a> {
    /// Where colours jump.
    fn jumps(&self) -> Option<&'a Jumps> {
        self.areas.map(|areas| &areas.jumps)
    }

    /// Whether colours jump between areas of a chart.
    fn jumps_inside(&self, chart: u32) -> bool {
        Areas::of(&self.areas_of(chart), self.jumps()).is_some_and(|areas| areas.have_jumps())
    }

    /// The area of each triangle of a chart; empty if colours jump nowhere.
    fn areas_of(&self, chart: u32) -> Vec<u32> {
        let triangles = &self.atlas.charts[chart as usize].triangles;
        self.areas.map_or(vec![], |areas| triangles.iter().map(|&t| areas.of_triangles[t as usize]).collect())
    }
}
