//! Writing a file: check the model, order it, make tables from all symbols, encode pages, put the sections together.

mod check;
mod order;

use std::io::Write;

use crate::{
    arc::{Path, encode_corner},
    entropy::{SymbolBuffer, Tables, encode},
    error::{Error, Result},
    error_code::ErrorCode,
    header::{Header, Section, VERSION, kind},
    index::{BlockEntry, ClusterIndex, RootEntry},
    model::{HalfArc, Model},
    overview::write_overview,
    patch::LatticePoint,
    sections::{
        Cluster, ClusterLevel, Extent, LevelRecord, Levels, MAX_BOX, MAX_CLUSTER_ROOTS, Part, write_clusters,
        write_source,
    },
};
use order::Order;

/// Fewest and most roots of a cluster where there are several clusters; in between it is the root of the number of roots. More
/// would make a region read more of the index for other roots; fewer would cost more in CLUSTERS, which everybody reads.
const CLUSTER_ROOTS: [usize; 2] = [12, 24];
const _: () = assert!(CLUSTER_ROOTS[1] <= MAX_CLUSTER_ROOTS);

/// So many times the bytes of the records may go to arcs in index blocks.
const ARCS_PER_RECORD: u64 = 3;

/// A stream of a block part ends after the block that brings it to this many symbols, which is about half a kilobyte: then
/// a stream's own four to six bytes weigh less than one percent, and to reach a block few others have to be decoded.
const STREAM_SYMBOLS: usize = 2048;

/// A group of arcs ends with the arc that brings its samples in pages to this number: about 0.9 kB over all levels. A region
/// at its borders needs few arcs of many clusters; smaller groups would lie farther apart, so that more requests were needed.
const ARC_GROUP_SAMPLES: u16 = 1024;

/// What became of a model.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WriteReport {
    /// Size of the file.
    pub total_bytes: u64,
    /// Name and size of each section; header and directory first.
    pub sections: Vec<(&'static str, u64)>,
    /// Bytes of the arc parts and of the block parts of each level's pages.
    pub levels: Vec<[u64; 2]>,
    /// Which root of the model each root of the file is.
    pub root_order: Vec<u32>,
}

/// Writes a model as a file. The same model gives the same bytes on every machine.
///
/// # Errors
/// [`Error::Model`] where the model breaks a rule, [`Error::Write`] where `out` fails.
pub fn write_file(model: &Model, out: &mut impl Write) -> Result<WriteReport> {
    check::check(model)?;
    let order = Order::new(model)?;
    let tolerances = check::tolerance_codes(model)?;

    // Everything that becomes symbols, so that the tables can be made from all of them.
    let mut drafts = order
        .roots
        .chunks(order.cluster_roots)
        .scan([0_u32; 3], |first, roots| Some(Draft::new(model, &order, roots, first, &tolerances)))
        .collect::<Result<Vec<_>>>()?;
    let blocks = model.roots.iter().flat_map(|root| root.blocks.iter().flatten()).map(|block| &block.symbols);
    let tables = Tables::from_buffers(
        blocks
            .chain(drafts.iter().flat_map(|draft| draft.arcs().chain([&draft.corners, &draft.records])))
            .chain(model.overview.iter().map(|overview| &overview.symbols)),
    );

    // Pages, coarse to fine; then what names their sizes.
    let mut report = WriteReport { root_order: order.roots.clone(), ..WriteReport::default() };
    let mut levels = Levels {
        arc_tangent_shift: model.arc_tangent_shift,
        grid_quantisation: model.grid_quantisation,
        index_arc_levels: index_arc_levels(&drafts, &tables, model.levels.len()),
        arc_group_samples: ARC_GROUP_SAMPLES,
        levels: Vec::new(),
    };
    drafts.iter_mut().for_each(|draft| draft.index.find_groups(&levels));
    let mut pages = Vec::new();
    for (level, info) in (0..).zip(&model.levels) {
        let page_offset = pages.len() as u64;
        let mut bytes = [0; 2];
        // Arcs of neighbouring clusters lie closer together than if blocks lay between: a region needs them at all levels.
        for draft in &mut drafts {
            if level >= levels.index_arc_levels {
                draft.write_arcs(level, &tables, &mut pages);
            }
            bytes[0] += draft.cluster.levels[usize::from(level)].arcs.length;
        }
        for draft in &mut drafts {
            draft.write_blocks(model, level, &tables, &mut pages);
            bytes[1] += draft.cluster.levels[usize::from(level)].blocks.length;
        }
        report.levels.push(bytes);
        let clusters = || drafts.iter().map(|draft| draft.cluster.levels[usize::from(level)]);
        levels.levels.push(LevelRecord {
            tolerance: info.tolerance,
            max_error: clusters().map(|cluster| cluster.max_error).max().unwrap_or_default().bound(&model.lattice),
            triangle_count: clusters().map(|cluster| cluster.triangle_count).sum(),
            page_offset,
            page_bytes: pages.len() as u64 - page_offset,
            quantisation: info.quantisation,
        });
    }
    let mut index = Vec::new();
    for draft in &mut drafts {
        let in_index = draft.arc_stream(levels.index_arc_levels);
        let block = draft.index.write(&draft.records, &in_index, &draft.arc_parts, &tables);
        draft.cluster.index = append(&mut index, &block);
    }
    let clusters: Vec<Cluster> = drafts.into_iter().map(|draft| draft.cluster).collect();

    let mut sections = vec![
        ("levels", kind::LEVELS, true, levels.write()),
        ("tables", kind::TABLES, true, tables.write()),
        ("clusters", kind::CLUSTERS, true, write_clusters(&clusters)),
        ("index", kind::INDEX, true, index),
        ("pages", kind::PAGES, true, pages),
    ];
    if let Some(overview) = &model.overview {
        let bytes = write_overview(overview, &tables, &model.lattice)?;
        sections.insert(2, ("overview", kind::OVERVIEW, false, bytes));
    }
    if model.source != Default::default() {
        sections.insert(0, ("source", kind::SOURCE, false, write_source(&model.source)));
    }
    let entries = sections.iter().map(|&(_, kind, required, ref bytes)| Section {
        kind,
        required,
        checksum: (kind != kind::INDEX && kind != kind::PAGES).then(|| crc32fast::hash(bytes)),
        offset: 0,
        length: bytes.len() as u64,
    });
    let header = Header { version: VERSION, lattice: model.lattice, sections: entries.collect() }.write();
    report.sections.push(("header", header.len() as u64));
    report.sections.extend(sections.iter().map(|(name, .., bytes)| (*name, bytes.len() as u64)));
    report.total_bytes = report.sections.iter().map(|section| section.1).sum();
    let chunks = [&header].into_iter().chain(sections.iter().map(|(.., bytes)| bytes));
    chunks.into_iter().try_for_each(|bytes| out.write_all(bytes)).map_err(|source| Error::Write { source })?;
    Ok(report)
}

/// Appends a part of a section.
fn append(section: &mut Vec<u8>, bytes: &[u8]) -> Part {
    let offset = section.len() as u64;
    section.extend(bytes);
    let checksum = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
    Part { offset, length: bytes.len() as u64, checksum }
}

/// A cluster on its way into the file.
struct Draft {
    cluster: Cluster,
    /// Model roots.
    roots: Vec<u32>,
    index: ClusterIndex,
    records: SymbolBuffer,
    corners: SymbolBuffer,
    /// Per level the new samples of each arc.
    arc_symbols: Vec<Vec<SymbolBuffer>>,
    /// Per level in pages the stream of each group of arcs.
    arc_parts: Vec<Vec<Part>>,
}

impl Draft {
    /// The cluster of a run of model roots. `first` are the first root, arc and corner, moved on to the next cluster's.
    fn new(
        model: &Model,
        order: &Order,
        roots: &[u32],
        first: &mut [u32; 3],
        tolerances: &[ErrorCode],
    ) -> Result<Self> {
        let [first_root, first_arc, first_corner] = *first;
        let mut next = [first_root + roots.len() as u32, first_arc, first_corner];
        let level_count = model.levels.len();
        let mut entries = Vec::with_capacity(roots.len());
        for &root in roots {
            let entry = root_entry(model, order, root)?;
            let last_arc = entry.half_arcs().map(|half_arc| half_arc.arc + 1).max();
            next[1] = next[1].max(last_arc.unwrap_or(0));
            entries.push(entry);
        }
        mark_streams(model, roots, &mut entries);
        let bounds = entries.iter().map(|entry| entry.bounds).reduce(union).unwrap_or_default();

        let arcs = &order.arcs[first_arc as usize..next[1] as usize];
        let mut arc_ends = Vec::with_capacity(arcs.len());
        let mut new_samples = vec![0; arcs.len() * level_count];
        for (arc, counts) in arcs.iter().zip(new_samples.chunks_mut(level_count)) {
            let record = &model.arcs[*arc as usize];
            let ends = record.ends.map(|corner| order.corner_ids[corner as usize]);
            next[2] = next[2].max(ends[0] + 1).max(ends[1] + 1);
            arc_ends.push(ends);
            record.samples.iter().for_each(|sample| counts[usize::from(sample.level)] += 1);
        }
        let mut index = ClusterIndex::new(entries, arc_ends, &new_samples, level_count);
        index.find_streams()?;
        let mut cluster = Cluster {
            first_root,
            root_count: roots.len() as u32,
            first_arc,
            arc_count: arcs.len() as u32,
            first_corner,
            corner_count: next[2] - first_corner,
            bounds,
            ..Cluster::default()
        };
        for level in 0..level_count as u8 {
            let (triangle_count, max_error) = index.summary(level, &model.lattice)?;
            cluster.levels.push(ClusterLevel { triangle_count, max_error, ..ClusterLevel::default() });
        }
        *first = next;
        Ok(Self {
            corners: corner_symbols(model, order, &cluster),
            arc_symbols: arc_symbols(model, order, &cluster, &index)?,
            arc_parts: Vec::new(),
            records: index.records(&cluster, tolerances),
            cluster,
            roots: roots.to_vec(),
            index,
        })
    }

    /// The symbols of all arcs at all levels.
    fn arcs(&self) -> impl Iterator<Item = &SymbolBuffer> {
        self.arc_symbols.iter().flatten()
    }

    /// What the index block has of arcs: corners, then samples of the coarsest levels.
    fn arc_stream(&self, index_arc_levels: u8) -> Vec<&SymbolBuffer> {
        let levels = self.arc_symbols.iter().take(usize::from(index_arc_levels));
        [&self.corners].into_iter().chain(levels.flatten()).collect()
    }

    /// Appends the arc part of a level and notes its streams.
    fn write_arcs(&mut self, level: u8, tables: &Tables, pages: &mut Vec<u8>) {
        let start = pages.len() as u64;
        let mut parts = Vec::new();
        for group in &self.index.arc_groups {
            let arcs = &self.arc_symbols[usize::from(level)][group.start as usize..group.end as usize];
            parts.push(append(pages, &encode(tables, &arcs.iter().collect::<Vec<_>>())));
        }
        self.arc_parts.push(parts);
        let length = pages.len() as u64 - start;
        self.cluster.levels[usize::from(level)].arcs = Extent { offset: start, length };
    }

    /// Appends the block part of a level and notes its streams.
    fn write_blocks(&mut self, model: &Model, level: u8, tables: &Tables, pages: &mut Vec<u8>) {
        let start = pages.len() as u64;
        for stream in self.index.streams.iter_mut().filter(|stream| stream.level == level) {
            let roots = &self.roots[stream.roots.start as usize..stream.roots.end as usize];
            let blocks =
                roots.iter().filter_map(|&root| model.roots[root as usize].blocks[usize::from(level)].as_ref());
            let buffers: Vec<&SymbolBuffer> = blocks.map(|block| &block.symbols).collect();
            stream.part = append(pages, &encode(tables, &buffers));
        }
        let length = pages.len() as u64 - start;
        self.cluster.levels[usize::from(level)].blocks = Extent { offset: start, length };
    }
}

/// How many levels' samples go into the index blocks: as many as take, with the corners, at most [`ARCS_PER_RECORD`] times the
/// bytes of the records. Coarse samples are few and needed by whoever needs finer ones; in pages of their own they would cost
/// a request or two a level.
fn index_arc_levels(drafts: &[Draft], tables: &Tables, level_count: usize) -> u8 {
    let size = |buffers: &[&SymbolBuffer]| encode(tables, buffers).len() as u64;
    let room: u64 = drafts.iter().map(|draft| size(&[&draft.records])).sum();
    let fits = |&levels: &u8| {
        drafts.iter().map(|draft| size(&draft.arc_stream(levels))).sum::<u64>() <= ARCS_PER_RECORD * room
    };
    (2..=level_count as u8).take_while(fits).last().unwrap_or(1)
}

/// A model root in the file's numbers; its streams are not marked yet.
fn root_entry(model: &Model, order: &Order, root: u32) -> Result<RootEntry> {
    let record = &model.roots[root as usize];
    let renumbered = |half_arc: &HalfArc| HalfArc { arc: order.arc_ids[half_arc.arc as usize], ..*half_arc };
    let mut blocks = Vec::new();
    for (level, block) in (0..).zip(&record.blocks) {
        let Some(block) = block else { continue };
        blocks.push(BlockEntry {
            level,
            error: ErrorCode::at_least(block.error, &model.lattice)?,
            border_deviation: ErrorCode::at_least(block.border_deviation, &model.lattice)?,
            triangle_count: block.triangle_count,
            begins_stream: false,
        });
    }
    Ok(RootEntry {
        filling: record.filling,
        loops: record.loops.iter().map(|half_arcs| half_arcs.iter().map(renumbered).collect()).collect(),
        bounds: lattice_box(model, record.bounds)?,
        blocks,
    })
}

/// A world box on the lattice, rounded outward.
fn lattice_box(model: &Model, bounds: [[f64; 3]; 2]) -> Result<[LatticePoint; 2]> {
    // More than the rounding of `units` can be off below 2^41 steps.
    const MARGIN: f64 = 1.0 / 512.0;
    let [low, high] = bounds.map(|point| model.lattice.units(point));
    let mut result = [[0; 3]; 2];
    for axis in 0..3 {
        let (low, high) = ((low[axis] - MARGIN).floor(), (high[axis] + MARGIN).ceil());
        if !(low >= -MAX_BOX as f64 && low <= high && high <= MAX_BOX as f64) {
            return Err(Error::model("a root's bounds are empty, not finite or beyond 2^41 lattice steps"));
        }
        result[0][axis] = low as i64;
        result[1][axis] = high as i64;
    }
    Ok(result)
}

fn union(a: [LatticePoint; 2], b: [LatticePoint; 2]) -> [LatticePoint; 2] {
    let each = |side: usize, pick: fn(i64, i64) -> i64| [0, 1, 2].map(|axis| pick(a[side][axis], b[side][axis]));
    [each(0, i64::min), each(1, i64::max)]
}

/// Decides which blocks begin a stream: see [`STREAM_SYMBOLS`].
fn mark_streams(model: &Model, roots: &[u32], entries: &mut [RootEntry]) {
    let mut filled = vec![STREAM_SYMBOLS; model.levels.len()];
    for (entry, &root) in entries.iter_mut().zip(roots) {
        for block in &mut entry.blocks {
            let level = usize::from(block.level);
            let symbols = model.roots[root as usize].blocks[level].as_ref().map_or(0, |block| block.symbols.len());
            block.begins_stream = filled[level] >= STREAM_SYMBOLS;
            filled[level] = if block.begins_stream { symbols } else { filled[level] + symbols };
        }
    }
}

/// The positions of a cluster's corners.
fn corner_symbols(model: &Model, order: &Order, cluster: &Cluster) -> SymbolBuffer {
    let mut symbols = SymbolBuffer::default();
    let mut before = cluster.bounds[0];
    let corners = cluster.first_corner as usize..(cluster.first_corner + cluster.corner_count) as usize;
    for &corner in &order.corners[corners] {
        let position = model.corners[corner as usize];
        encode_corner(position, before, &mut symbols);
        before = position;
    }
    symbols
}

/// Per level the new samples of each of a cluster's arcs.
fn arc_symbols(
    model: &Model,
    order: &Order,
    cluster: &Cluster,
    index: &ClusterIndex,
) -> Result<Vec<Vec<SymbolBuffer>>> {
    let arcs = cluster.first_arc as usize..(cluster.first_arc + cluster.arc_count) as usize;
    let mut levels = vec![vec![SymbolBuffer::default(); arcs.len()]; model.levels.len()];
    for (local, &arc) in order.arcs[arcs].iter().enumerate() {
        let record = &model.arcs[arc as usize];
        let mut path = Path::new(record.ends.map(|corner| model.corners[corner as usize]));
        for (level, symbols) in (0..).zip(&mut levels) {
            if index.new_sample_count(local as u32, level) > 0 {
                path.encode_level(level, model.arc_tangent_shift, &record.samples, &mut symbols[local])?;
            }
        }
    }
    Ok(levels)
}
