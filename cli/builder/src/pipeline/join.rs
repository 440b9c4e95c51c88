//! From the products of regions to one file.

use super::drawn::DrawnLevel;
use super::groups::above_regions::{AboveRegions, Top, count_above};
use super::overview::{OVERVIEW_FROM_BYTES, overview};
use super::product::{ProductStats, RegionProduct, head};
use super::summary::{BuildSummary, Fallbacks, LevelSummary, Stopwatch, Times};
use super::{PipelineError, Plan};
use crate::reduce::CoarseSurface;
use lodpack::{
    LatticePoint,
    index::{Filling, FillingCounts},
    write::{
        Assembly, EncodedCluster, Encoder, EncoderHead, Model, Output, OverviewRecord, Piece, PieceIndex, WriteReport,
    },
};
use lodpack_runtime::machine::peak_memory_bytes;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::trace;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::Write;
use std::path::Path;

/// Bytes of each run of pages that may wait in memory; beyond that they go to an anonymous file.
const WAITING_BYTES: usize = 1 << 20;

/// Clusters (of some ten kilobytes each) that every thread encodes before their bytes are written.
const CLUSTERS_A_THREAD: usize = 8;
/// With this many bytes they are written sooner: clusters with texels may be a thousand times as large.
const CLUSTER_BYTES: usize = 16 << 20;

/// The products of all regions in the order of the regions. They can be visited repeatedly.
pub(crate) trait Products {
    /// What the file as a whole has to know of each.
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, ProductStats>, Cow<'_, PieceIndex>), PipelineError>>;

    /// What becomes pages.
    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, PipelineError>>;
}

impl Products for Vec<RegionProduct> {
    fn heads(&self) -> impl Iterator<Item = Result<(Cow<'_, ProductStats>, Cow<'_, PieceIndex>), PipelineError>> {
        self.iter().map(|product| Ok((Cow::Borrowed(&product.stats), Cow::Borrowed(&product.piece.index))))
    }

    fn pieces(&self) -> impl Iterator<Item = Result<Cow<'_, Piece>, PipelineError>> {
        self.iter().map(|product| Ok(Cow::Borrowed(&product.piece)))
    }
}

/// Makes one file of the products of all regions. `times` is the time that was spent earlier on products that come from
/// files.
///
/// Memory holds a few regions at a time, unless `products` itself does, and what has to be known of each root to put
/// them all in order. Symbols and pages wait in files in the directory `scratch`.
pub(crate) fn join(
    plan: &Plan,
    products: &impl Products,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
    mut watch: Stopwatch,
    times: Times,
) -> Result<BuildSummary, PipelineError> {
    progress.begin("pack", u64::from(plan.regions));
    let Arranged { encoder, sums, above } = arrange(plan, products, times)?;
    watch.lap("roots");
    watch.stages.extend(sums.times.stages());
    let report = encode(plan, encoder, products, above, scratch, out, progress)?;
    watch.lap("pack");
    Ok(summary(plan, sums, &report, watch, progress))
}

/// Puts a file together from clusters that are encoded, as [`join`] does. They come in the order of the file.
pub(crate) fn join_encoded(
    plan: &Plan,
    head: EncoderHead,
    sums: Sums,
    clusters: impl Iterator<Item = Result<EncodedCluster, PipelineError>>,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<BuildSummary, PipelineError> {
    let mut watch = Stopwatch::default();
    progress.begin("pack", head.cluster_count() as u64);
    let waiting = || Ok(tempfile::spooled_tempfile_in(WAITING_BYTES, scratch));
    let mut output = Output::new(head.encoder()?, waiting)?.with_nodes(plan.nodes.list.clone())?;
    for cluster in clusters {
        output.add(cluster?)?;
        progress.advance(1);
    }
    let report = output.finish(out)?;
    watch.lap("pack");
    Ok(summary(plan, sums, &report, watch, progress))
}

/// What is said of a file that has been written.
fn summary(plan: &Plan, sums: Sums, report: &WriteReport, watch: Stopwatch, progress: &dyn Progress) -> BuildSummary {
    let levels = sums.level_summaries(report);
    let (scale, vertices) = (&plan.scale, plan.source.vertex_count);
    let certified_error = levels.last().map_or(0.0, |l| l.certified_error);
    if certified_error > scale.tolerance {
        let tolerance = scale.tolerance;
        progress.note(&format!(
            "the tolerance of {tolerance:.3e} is not reached: the certified error is {certified_error:.3e}"
        ));
    }
    BuildSummary {
        input_triangles: plan.input_triangles,
        input_vertices: vertices,
        triangles: plan.source.triangle_count,
        objects: plan.nodes.objects,
        assemblies: plan.nodes.assemblies(),
        mean_edge_length: scale.mean_edge_length,
        repairs: plan.repairs.clone(),
        charts: plan.charts,
        roots: sums.roots,
        samples_per_input_vertex: sums.samples as f64 / vertices as f64,
        bytes: report.total_bytes,
        bits_per_input_vertex: report.total_bytes as f64 * 8.0 / vertices as f64,
        tolerance: scale.tolerance,
        certified_error,
        levels,
        fallbacks: sums.fallbacks,
        wall_seconds: watch.total().0.as_secs_f64(),
        cpu_seconds: watch.total().1.as_secs_f64(),
        stages: watch.stages,
        peak_memory_bytes: peak_memory_bytes(),
        temporary_bytes: 0,
    }
}

/// Sums over all regions.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Sums {
    drawn: Vec<DrawnLevel>,
    samples: u64,
    roots: FillingCounts,
    fallbacks: Fallbacks,
    times: Times,
}

impl Sums {
    /// Triangles, errors and bytes by level, every root drawn at that level. A level without blocks is drawn as the one
    /// beside it, and is left out; blocks of other levels may take no bytes.
    fn level_summaries(&self, report: &WriteReport) -> Vec<LevelSummary> {
        let is_drawn_beside = |level: usize| {
            let beside = [level.checked_sub(1), Some(level + 1)];
            let is_same = |other: &DrawnLevel| {
                (other.triangles, other.error) == (self.drawn[level].triangles, self.drawn[level].error)
            };
            beside.into_iter().flatten().filter_map(|level| self.drawn.get(level)).any(is_same)
        };
        let levels = (0..).zip(&self.drawn).zip(&report.levels);
        let levels = levels.filter(|((level, _), [_, blocks])| *blocks > 0 || !is_drawn_beside(usize::from(*level)));
        let summary = |((level, drawn), bytes): ((u8, &DrawnLevel), &[u64; 2])| LevelSummary {
            level,
            triangles: drawn.triangles,
            certified_error: drawn.error,
            bytes: bytes.iter().sum(),
        };
        levels.map(summary).collect()
    }
}

/// What all regions have together.
#[derive(Default)]
struct Joined {
    sums: Sums,
    /// The surfaces of all regions so far by coarse level, for the levels that all of them have.
    coarse: Vec<Vec<CoarseSurface>>,
    /// By region.
    tops: Vec<Vec<Top>>,
    /// What the first region that has a corner or a seam knows of it, by number.
    corners: BTreeMap<u32, LatticePoint>,
    seams: BTreeMap<u32, u64>,
}

impl Joined {
    /// Adds a region.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if it disagrees with an earlier region about a seam.
    fn add(&mut self, stats: ProductStats) -> lodpack::Result<()> {
        agree(&mut self.corners, stats.corners, "the position of a corner")?;
        agree(&mut self.seams, stats.seams, "the samples of an arc")?;
        let Sums { drawn, samples, roots, fallbacks, times } = &mut self.sums;
        drawn.resize(stats.drawn.len(), DrawnLevel::default());
        for (sum, drawn) in drawn.iter_mut().zip(stats.drawn) {
            sum.triangles += drawn.triangles;
            sum.error = sum.error.max(drawn.error);
        }
        *samples += stats.samples;
        roots.add(&stats.roots);
        *fallbacks = std::mem::take(fallbacks).plus(stats.fallbacks);
        times.add(&stats.times);
        self.tops.push(stats.tops);
        self.coarse.resize(stats.coarse.len(), vec![]);
        self.coarse.iter_mut().zip(stats.coarse).for_each(|(all, surface)| all.push(surface));
        Ok(())
    }

    /// Adds the groups above regions; returns their piece.
    fn add_above(&mut self, above: AboveRegions) -> Piece {
        self.sums.drawn.iter_mut().zip(above.drawn).for_each(|(sum, drawn)| *sum = drawn);
        self.sums.samples += above.interior_vertices;
        self.sums.roots.add(&(0..above.groups).map(|_| Filling::Irregular).collect());
        self.coarse = above.coarsest.into_iter().map(|surface| vec![surface]).collect();
        above.piece
    }

    /// The first overview that can be made.
    fn overview(&mut self, plan: &Plan) -> Option<OverviewRecord> {
        let mut levels = std::mem::take(&mut self.coarse).into_iter();
        levels.find_map(|surfaces| overview(&CoarseSurface::joined(surfaces), &plan.scale))
    }
}

/// Notes what a region knows of corners or seams, and compares it with what earlier regions know.
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

/// What is known of a file before anything is encoded.
pub(crate) struct Arranged {
    pub encoder: Encoder,
    pub sums: Sums,
    /// The piece with the groups above regions, which follows those of the regions.
    pub above: Option<Piece>,
}

/// The first pass collects everything that has to be known before anything is encoded.
pub(crate) fn arrange(plan: &Plan, products: &impl Products, times: Times) -> Result<Arranged, PipelineError> {
    let mut joined = Joined { sums: Sums { times, ..Sums::default() }, ..Joined::default() };
    let mut assembly: Option<(Assembly, Model)> = None;
    for (region, product) in products.heads().enumerate() {
        let (stats, index) = product?;
        let levels = stats.levels.clone();
        let (assembly, head) = match &mut assembly {
            Some(begun) => begun,
            None => {
                let head = Model { levels, ..head(plan) };
                assembly.insert((Assembly::new(&head)?, head))
            }
        };
        let mut stats = stats.into_owned();
        stats.tops.iter_mut().for_each(|top| top.keep_share(plan.regions));
        let added = match head.levels == stats.levels {
            true => joined.add(stats).and_then(|()| assembly.count(&index)),
            false => {
                Err(lodpack::Error::Model { what: "its levels differ from those of the regions before it".into() })
            }
        };
        added.map_err(|error| match error {
            lodpack::Error::Model { what } => lodpack::Error::Model { what: format!("region {region}: {what}") },
            other => other,
        })?;
    }
    let (mut assembly, head) = match assembly {
        Some(assembly) => assembly,
        None => return Err(lodpack::Error::Model { what: "there is no region".into() }.into()),
    };
    let above = count_above(plan, &head, &mut assembly, std::mem::take(&mut joined.tops), &mut joined.sums.times)?;
    let above = above.map(|above| joined.add_above(above));
    // Where header, index and coarsest level are small, they arrive as fast as an overview would.
    let arranged = assembly.arrange()?;
    let is_large = plan.has_overview() && arranged.first_picture_bytes() > OVERVIEW_FROM_BYTES;
    let overview = if is_large { joined.overview(plan) } else { None };
    Ok(Arranged { encoder: arranged.seal(overview), sums: joined.sums, above })
}

/// The second pass brings the symbols of all regions into the order of the file and encodes them.
fn encode(
    plan: &Plan,
    encoder: Encoder,
    products: &impl Products,
    above: Option<Piece>,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<WriteReport, PipelineError> {
    let waiting = || Ok(tempfile::spooled_tempfile_in(WAITING_BYTES, scratch));
    let mut output = Output::new(encoder, waiting)?.with_nodes(plan.nodes.list.clone())?;
    let mut count = 0;
    for piece in products.pieces() {
        output.take(count, piece?.as_ref())?;
        progress.advance(1);
        count += 1;
    }
    above.iter().try_for_each(|piece| output.take(count, piece))?;
    let (mut clusters, most) = (0..output.encoder().cluster_count(), CLUSTERS_A_THREAD * rayon::current_num_threads());
    while !clusters.is_empty() {
        let (mut symbols, mut bytes) = (vec![], 0);
        while symbols.len() < most && bytes < CLUSTER_BYTES {
            let Some(cluster) = clusters.next() else { break };
            let of_cluster = output.symbols(cluster)?;
            bytes += of_cluster.bytes();
            symbols.push(of_cluster);
        }
        let of_all = trace::parallel("clusters");
        let encoded = symbols.par_iter().map(|symbols| {
            let _pass = trace::pass("encode");
            output.encoder().encode(symbols)
        });
        let encoded = encoded.collect::<lodpack::Result<Vec<_>>>()?;
        drop(of_all);
        encoded.into_iter().try_for_each(|cluster| output.add(cluster))?;
    }
    Ok(output.finish(out)?)
}
