//! From the products of regions to one file.

use super::coarse::CoarseSurface;
use super::overview::{OVERVIEW_FROM_BYTES, overview};
use super::region::{DrawnLevel, RegionFacts, RegionProduct, head};
use super::root::Times;
use super::{BuildError, Plan};
use crate::pipeline::summary::{BuildSummary, Fallbacks, LevelSummary, Stopwatch, peak_memory_bytes};
use crate::progress::Progress;
use lodpack::{
    LatticePoint,
    write::{Assembly, Encoder, Model, Output, OverviewRecord, Piece, PieceIndex, WriteReport},
};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::Write;
use std::path::Path;

/// Bytes of each run of pages that wait in memory; more go to a file without a name.
const WAITING_BYTES: usize = 1 << 20;

/// Clusters, of some ten kilobytes each, that a thread encodes before all threads go on.
const CLUSTERS_A_THREAD: usize = 8;

/// The products of all regions, in the order of the regions, as often as they are asked for.
pub(crate) trait Products {
    /// What the whole has to know.
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, RegionFacts>, Cow<'_, PieceIndex>), BuildError>>;

    /// What becomes pages.
    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, BuildError>>;
}

impl Products for Vec<RegionProduct> {
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, RegionFacts>, Cow<'_, PieceIndex>), BuildError>> {
        self.iter().map(|product| Ok((Cow::Borrowed(&product.facts), Cow::Borrowed(&product.piece.index))))
    }

    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, BuildError>> {
        self.iter().map(|product| Ok(Cow::Borrowed(&product.piece)))
    }
}

/// Makes one file of the products of all regions. `times` were spent before on products that come from files. Of products and
/// file only a few regions are in memory at a time, if the products are not, and what has to be known of each root to order them all:
/// symbols and pages wait in files in the directory `scratch`.
pub(crate) fn join(
    plan: &Plan,
    products: &impl Products,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
    times: Times,
) -> Result<BuildSummary, BuildError> {
    progress.begin("pack", u64::from(plan.regions));
    let (encoder, joined) = count(plan, products, times)?;
    watch.lap("roots");
    watch.stages.extend(joined.times.stages());
    let report = encode(encoder, products, scratch, out, progress)?;
    watch.lap("pack");

    let levels = joined.level_summaries(&report);
    let (scale, vertices) = (&plan.scale, plan.source.vertex_count);
    let certified_error = levels.last().map_or(0.0, |l| l.certified_error);
    if certified_error > scale.tolerance {
        let tolerance = scale.tolerance;
        progress.note(&format!(
            "the tolerance of {tolerance:.3e} is not reached: the certified error is {certified_error:.3e}"
        ));
    }
    Ok(BuildSummary {
        input_triangles: plan.input_triangles,
        input_vertices: vertices,
        triangles: plan.source.triangle_count,
        mean_edge_length: scale.mean_edge_length,
        repairs: plan.repairs.clone(),
        charts: plan.charts,
        irregular_roots: joined.irregular_roots,
        grid_roots: joined.grid_roots,
        samples_per_input_vertex: joined.samples as f64 / vertices as f64,
        bytes: report.total_bytes,
        bits_per_input_vertex: report.total_bytes as f64 * 8.0 / vertices as f64,
        tolerance: scale.tolerance,
        certified_error,
        levels,
        fallbacks: joined.fallbacks,
        wall_seconds: watch.total().0.as_secs_f64(),
        cpu_seconds: watch.total().1.as_secs_f64(),
        stages: watch.stages,
        peak_memory_bytes: peak_memory_bytes(),
        temporary_bytes: 0,
    })
}

/// What regions have together.
#[derive(Default)]
struct Joined {
    drawn: Vec<DrawnLevel>,
    samples: u64,
    irregular_roots: u64,
    grid_roots: u64,
    fallbacks: Fallbacks,
    times: Times,
    /// Per coarse level those of all regions so far, as far as all have it.
    coarse: Vec<Vec<CoarseSurface>>,
    /// By number of a corner or a seam what the first region knows of it.
    corners: BTreeMap<u32, LatticePoint>,
    seams: BTreeMap<u32, u64>,
}

impl Joined {
    /// Adds a region.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] where it has another idea of a seam than a region before it.
    fn add(&mut self, facts: RegionFacts) -> lodpack::Result<()> {
        agree(&mut self.corners, facts.corners, "the place of a corner")?;
        agree(&mut self.seams, facts.seams, "the samples of an arc")?;
        self.drawn.resize(facts.drawn.len(), DrawnLevel::default());
        for (sum, drawn) in self.drawn.iter_mut().zip(facts.drawn) {
            sum.triangles += drawn.triangles;
            sum.error = sum.error.max(drawn.error);
        }
        self.samples += facts.samples;
        self.irregular_roots += facts.irregular_roots;
        self.grid_roots += facts.grid_roots;
        self.fallbacks = std::mem::take(&mut self.fallbacks).plus(facts.fallbacks);
        self.times.add(&facts.times);
        self.coarse.resize(facts.coarse.len(), vec![]);
        self.coarse.iter_mut().zip(facts.coarse).for_each(|(all, surface)| all.push(surface));
        Ok(())
    }

    /// The first overview that can be made.
    fn overview(&mut self, plan: &Plan) -> Option<OverviewRecord> {
        let mut levels = std::mem::take(&mut self.coarse).into_iter();
        levels.find_map(|surfaces| overview(&CoarseSurface::joined(surfaces), &plan.scale))
    }

    /// Triangles, errors and bytes by level, every root drawn at that level.
    fn level_summaries(&self, report: &WriteReport) -> Vec<LevelSummary> {
        let levels = (0..).zip(&self.drawn).zip(&report.levels);
        let summary = |((level, drawn), bytes): ((u8, &DrawnLevel), &[u64; 2])| LevelSummary {
            level,
            triangles: drawn.triangles,
            certified_error: drawn.error,
            bytes: bytes.iter().sum(),
        };
        levels.map(summary).collect()
    }
}

/// Notes what a region knows of what is shared, or compares it with what the first one knew.
fn agree<T: PartialEq>(known: &mut BTreeMap<u32, T>, of_region: Vec<(u32, T)>, what: &str) -> lodpack::Result<()> {
    for (number, value) in of_region {
        match known.entry(number) {
            Entry::Vacant(entry) => drop(entry.insert(value)),
            Entry::Occupied(entry) if *entry.get() == value => {}
            Entry::Occupied(_) => {
                let what = format!("two regions disagree about {what} on the seam between them");
                return Err(lodpack::Error::Model { what });
            }
        }
    }
    Ok(())
}

/// The first pass: all that has to be known before anything is encoded.
fn count(plan: &Plan, products: &impl Products, times: Times) -> Result<(Encoder, Joined), BuildError> {
    let mut joined = Joined { times, ..Joined::default() };
    let mut assembly: Option<(Assembly, Model)> = None;
    for (region, product) in products.heads().enumerate() {
        let (facts, index) = product?;
        let levels = facts.levels.clone();
        let (assembly, head) = match &mut assembly {
            Some(begun) => begun,
            None => {
                let head = Model { levels, ..head(plan) };
                assembly.insert((Assembly::new(&head)?, head))
            }
        };
        let added = match head.levels == facts.levels {
            true => joined.add(facts.into_owned()).and_then(|()| assembly.count(&index)),
            false => Err(lodpack::Error::Model { what: "it has other levels than the regions before it".into() }),
        };
        added.map_err(|error| match error {
            lodpack::Error::Model { what } => lodpack::Error::Model { what: format!("region {region}: {what}") },
            other => other,
        })?;
    }
    let (assembly, _) = match assembly {
        Some(assembly) => assembly,
        None => return Err(lodpack::Error::Model { what: "there is no region".into() }.into()),
    };
    // Where header, index and coarsest level are small, they come as fast as an overview would.
    let arranged = assembly.arrange()?;
    let is_large = plan.has_overview() && arranged.first_picture_bytes() > OVERVIEW_FROM_BYTES;
    let overview = if is_large { joined.overview(plan) } else { None };
    Ok((arranged.seal(overview), joined))
}

/// The second pass: the symbols of all regions, brought into the order of the file, become bytes.
fn encode(
    encoder: Encoder,
    products: &impl Products,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<WriteReport, BuildError> {
    let waiting = || Ok(tempfile::spooled_tempfile_in(WAITING_BYTES, scratch));
    let mut output = Output::new(encoder, waiting)?;
    for (number, piece) in products.pieces().enumerate() {
        output.take(number, piece?.as_ref())?;
        progress.advance(1);
    }
    let clusters: Vec<usize> = (0..output.encoder().cluster_count()).collect();
    for some in clusters.chunks(CLUSTERS_A_THREAD * rayon::current_num_threads()) {
        let symbols = some.iter().map(|&cluster| output.symbols(cluster)).collect::<lodpack::Result<Vec<_>>>()?;
        let encoded = symbols.par_iter().map(|symbols| output.encoder().encode(symbols));
        encoded.collect::<lodpack::Result<Vec<_>>>()?.into_iter().try_for_each(|cluster| output.add(cluster))?;
    }
    Ok(output.finish(out)?)
}
