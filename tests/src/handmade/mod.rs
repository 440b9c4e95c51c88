//! Files put together by hand, symbol by symbol, without the library's writer: so that single rules can be broken.
//!
//! The model is the worked example of SPEC.md, chapter 17: a triangle; at level 1 one of its arcs has a sample, and
//! there is an interior vertex. All contexts use one table in which all 256 tokens are equally likely, so that any
//! symbol can become any other one. [`HandmadeTexels`] gives it channels.

mod channels;
mod container;
mod faults;
mod ground;
mod objects;
mod symbols;

pub use channels::{HandmadeChannel, HandmadeTexels};
pub use container::{Container, Section};
pub use faults::{Fault, faults};
pub use ground::grounded;
pub use objects::{HandmadeObjects, Symbol, coded};
pub use symbols::{CONTEXT_COUNT, encode, flat_tables, pack_bits};

/// LEVELS, TABLES, CLUSTERS, INDEX and PAGES.
pub const LEVELS: u32 = 2;
/// See [`LEVELS`].
pub const TABLES: u32 = 3;
/// See [`LEVELS`].
pub const CLUSTERS: u32 = 4;
/// See [`LEVELS`].
pub const INDEX: u32 = 5;
/// See [`LEVELS`].
pub const PAGES: u32 = 6;
/// See [`LEVELS`].
pub const CHANNELS: u32 = 8;
/// See [`LEVELS`].
pub const TEXELS: u32 = 9;
/// See [`LEVELS`].
pub const PLACEMENT: u32 = 10;
/// See [`LEVELS`].
pub const HEIGHTS: u32 = 11;
/// See [`LEVELS`].
pub const HEIGHT_INDEX: u32 = 12;
/// See [`LEVELS`].
pub const GROUND: u32 = 14;
/// The section SCALES.
pub const SCALES: u32 = 15;
/// The section DRAPE.
pub const DRAPE: u32 = 16;

/// The section OBJECTS.
pub const OBJECTS: u32 = 17;
/// The section OBJECT_PAGES.
pub const OBJECT_PAGES: u32 = 18;

/// Codes of fillings.
pub const IRREGULAR: u16 = 0;
/// See [`IRREGULAR`].
pub const GRID: u16 = 1;

/// A file of one cluster, as the numbers that are in it.
#[derive(Clone, Debug)]
pub struct Handmade {
    /// Root, arc and corner count of the file.
    pub totals: [u64; 3],
    /// Those of the cluster, and its child count.
    pub counts: [u64; 4],
    /// The cluster's box: low coordinates, zigzag mapped.
    pub low: [u64; 3],
    /// The cluster's box: extents.
    pub extent: [u64; 3],
    /// Lists that lie one in the other, the outermost first; the cluster lies in the innermost one.
    pub lists: Vec<HandmadeList>,
    /// Symbols of the index block.
    pub records: Vec<u64>,
    /// Bytes of level 1 after the last of the arc pages and of the block pages, in no page.
    pub part_excess: [usize; 2],
    /// Symbols of the index block's arc stream: corners, then samples of level 0.
    pub corners: Vec<u64>,
    /// Codes of the fillings that LEVELS lists.
    pub fillings: Vec<u16>,
    /// Bytes after the stream of level 1's only arc run.
    pub arc_excess: Vec<u8>,
    /// Coarse to fine.
    pub levels: Vec<HandmadeLevel>,
}

/// A list of clusters with one entry, as the entry for it says.
#[derive(Clone, Debug)]
pub struct HandmadeList {
    /// How many lists lie one in the other here.
    pub height: u64,
    /// How many clusters it has.
    pub clusters: u64,
    /// Their roots, arcs, corners and children.
    pub counts: [u64; 4],
    /// The extents of their box.
    pub extent: [u64; 3],
    /// The number of its entries, which the list itself says.
    pub entries: u64,
    /// Bytes after its last entry.
    pub excess: Vec<u8>,
    /// Bytes of INDEX after everything below it.
    pub below_excess: usize,
}

/// A level of a [`Handmade`] file.
#[derive(Clone, Debug)]
pub struct HandmadeLevel {
    /// World units.
    pub tolerance: f64,
    /// The largest error, as it is stored and as LEVELS repeats it.
    pub error: (u16, f64),
    /// As CLUSTERS and LEVELS have it.
    pub triangle_count: u64,
    /// Symbols of the only arc page; none at level 0.
    pub arcs: Vec<u64>,
    /// Symbols of the only block page, if there is a block.
    pub blocks: Vec<u64>,
}

/// A section PLACEMENT: z is up, a unit is a millimetre, and the CRS has a character of each kind.
pub fn placement() -> Section {
    let mut content = vec![2, 0, 0, 0, 0, 0, 0, 0];
    [0.001, 500_000.0, -4.5e6, 0.25].iter().for_each(|x: &f64| content.extend(x.to_le_bytes()));
    content.extend("PROJCRS[\"\u{e9}\u{1f30d} \\\",1]".as_bytes());
    Section { kind: 10, flags: 0, content, reserved: 0 }
}

impl Handmade {
    /// The worked example.
    pub fn example() -> Self {
        let coarse = HandmadeLevel {
            tolerance: 0.25,
            error: (15258, 0.200_195_312_5),
            triangle_count: 1,
            arcs: vec![],
            // Nothing closed, no refinement; Next.
            blocks: vec![0, 1],
        };
        let fine = HandmadeLevel {
            tolerance: 0.0625,
            error: (14336, 0.015_625),
            triangle_count: 4,
            // Arc 0 is split, with a residual of three numbers.
            arcs: vec![1, 7, 0, 0],
            // New with a residual, Next, Next, Next.
            blocks: vec![0, 0, 26, 11, 20, 1, 1, 1],
        };
        let records = [
            vec![1],              // one loop, the only filling
            vec![3, 0, 0, 0],     // three half-arcs, each of a new arc
            vec![0, 0, 0],        // box: low
            vec![255, 255, 255],  // box: size
            vec![0],              // children
            vec![3],              // levels 0 and 1
            vec![204, 820, 1, 1], // level 0: error, deviation, triangles, begins a stream
            vec![1024, 0, 4, 1],  // level 1
            vec![0, 0, 0, 0],     // arc 0: two new corners, both of level 0
            vec![0, 1],           // no sample at level 0, one at level 1
            vec![1, 0, 0, 0, 0],  // arc 1: one new corner
            vec![1, 3, 0, 0],     // arc 2
        ];
        Self {
            totals: [1, 3, 3],
            counts: [1, 3, 3, 0],
            low: [1, 17, 1],
            extent: [66, 74, 18],
            lists: vec![],
            records: records.concat(),
            part_excess: [0; 2],
            // (0, 0, 0), (64, 0, 0), (0, 64, 0).
            corners: vec![2, 18, 2, 128, 0, 0, 127, 128, 0],
            fillings: vec![IRREGULAR],
            arc_excess: vec![],
            levels: vec![coarse, fine],
        }
    }

    /// The same triangle with a grid: a polygon at both levels.
    pub fn grid() -> Self {
        let mut file = Self::example();
        file.fillings = vec![GRID];
        file.levels[0].blocks = vec![0];
        file.levels[1].blocks = vec![0];
        file.set_fine_triangles(2);
        file
    }

    /// The grid becomes a fan around a centre at level 1.
    pub fn fan() -> Self {
        let mut file = Self::grid();
        file.levels[1].blocks = vec![1, 8, 4, 3];
        file.set_fine_triangles(4);
        file
    }

    /// A grid that is a polygon with 63 samples on its first side: more than are triangulated at once.
    pub fn long_polygon() -> Self {
        let mut file = Self::grid();
        file.records[FIRST_ARC_SAMPLES + 1] = 63;
        file.levels[1].arcs = [1, 0, 0, 0].repeat(63);
        file.set_fine_triangles(64);
        file
    }

    /// Corners 0 and 1 lie in one place: frames and angles that do not exist.
    pub fn coincident() -> Self {
        let mut file = Self::example();
        file.corners = vec![2, 18, 2, 0, 0, 0, 0, 128, 0];
        file.levels[1].arcs = vec![1, 8, 0, 0];
        file.levels[1].blocks = vec![0, 0, 0, 0, 0, 1, 1, 1];
        file
    }

    /// The tangential step of level 1 is halved.
    pub fn refined() -> Self {
        let mut file = Self::example();
        file.levels[1].blocks[0] = 1;
        file
    }

    /// The worked example as a tree: a group with the triangle of level 0, whose only child has the triangles of
    /// level 1.
    pub fn tree() -> Self {
        let mut file = Self::example();
        (file.totals[0], file.counts[0], file.counts[3]) = (2, 2, 1);
        (file.records[CHILDREN], file.records[LEVEL_SET]) = (1, 1);
        let child = [vec![1], vec![3, 6, 4, 2], vec![0, 0, 0, 255, 255, 255], vec![0], vec![2]].concat();
        file.records.splice(FINE_ERROR..FINE_ERROR, child);
        file
    }

    /// The same with a level between those of the group and its child: nothing is drawn there.
    pub fn tree_with_a_gap() -> Self {
        let mut file = Self::tree();
        file.records[CHILD_LEVEL_SET] = 4;
        for number_of_samples in TREE_FINE_SAMPLES {
            file.records.insert(number_of_samples, 0);
        }
        let (arcs, blocks) = (vec![], vec![]);
        file.levels.insert(1, HandmadeLevel { tolerance: 0.125, error: (0, 0.0), triangle_count: 0, arcs, blocks });
        file
    }

    /// The worked example with its cluster in some lists, one in the other.
    pub fn listed(heights: &[u64]) -> Self {
        let mut file = Self::example();
        let (counts, extent) = (file.counts, file.extent);
        let list = |&height| {
            let excess = vec![];
            HandmadeList { height, clusters: 1, counts, extent, entries: 1, excess, below_excess: 0 }
        };
        file.lists = heights.iter().map(list).collect();
        file
    }

    fn set_fine_triangles(&mut self, count: u64) {
        self.records[FINE_TRIANGLES] = count;
        self.levels[1].triangle_count = count;
    }

    /// A surface without anything.
    pub fn nothing() -> Self {
        let mut file = Self::example();
        file.totals = [0; 3];
        file.counts = [0; 4];
        file.fillings.clear();
        file.corners.clear();
        for level in &mut file.levels {
            (level.error, level.triangle_count) = ((0, 0.0), 0);
            level.arcs.clear();
            level.blocks.clear();
        }
        file
    }

    /// The sections, with sound checksums of all parts.
    pub fn container(&self) -> Container {
        let mut index = vec![];
        for symbols in [&self.records, &self.corners] {
            let stream = encode(symbols);
            put_varint(&mut index, stream.len() as u64);
            index.extend(stream);
        }
        let mut levels = vec![self.levels.len() as u8, 2, 1, self.fillings.len() as u8];
        levels.extend(512_u16.to_le_bytes());
        levels.extend([0; 2]);
        let (mut pages, mut page_records) = (vec![], vec![]);
        for (number, level) in self.levels.iter().enumerate() {
            let page_offset = pages.len() as u64;
            let (mut arcs, mut blocks) = (vec![], encode(&level.blocks));
            if number > 0 {
                arcs = [encode(&level.arcs), self.arc_excess.clone()].concat();
                put_part(&mut index, &arcs);
            }
            if !level.blocks.is_empty() {
                put_part(&mut index, &blocks);
            }
            if number > 0 {
                arcs.resize(arcs.len() + self.part_excess[0], 0);
                blocks.resize(blocks.len() + self.part_excess[1], 0);
            }
            put_varint(&mut page_records, arcs.len() as u64);
            put_varint(&mut page_records, blocks.len() as u64);
            put_varint(&mut page_records, level.triangle_count);
            if level.triangle_count > 0 {
                page_records.extend(level.error.0.to_le_bytes());
            }
            pages.extend([arcs, blocks].concat());
            levels.extend(level.tolerance.to_le_bytes());
            levels.extend(level.error.1.to_le_bytes());
            for number in [level.triangle_count, page_offset, pages.len() as u64 - page_offset] {
                levels.extend(number.to_le_bytes());
            }
        }
        for filling in &self.fillings {
            levels.extend(filling.to_le_bytes());
            levels.extend((2 * self.levels.len() as u16).to_le_bytes());
            // Normal and tangent shift: grids are as fine as the lattice.
            let shifts = if *filling == GRID { [0, 0] } else { [0, 1] };
            self.levels.iter().for_each(|_| levels.extend(shifts));
        }
        let mut clusters = vec![];
        self.totals.iter().for_each(|&x| put_varint(&mut clusters, x));
        put_varint(&mut clusters, u64::from(self.counts[0] > 0));
        if self.counts[0] > 0 {
            let mut entry = vec![];
            for x in [self.counts.as_slice(), &self.low, &self.extent].concat() {
                put_varint(&mut entry, x);
            }
            put_part(&mut entry, &index);
            entry.extend(&page_records);
            for list in self.lists.iter().rev() {
                let mut content = vec![];
                put_varint(&mut content, list.entries);
                content.extend([std::mem::take(&mut entry), list.excess.clone()].concat());
                index.resize(index.len() + list.below_excess, 0);
                let head = [0, list.height, list.clusters];
                for x in [head.as_slice(), &list.counts, &self.low, &list.extent].concat() {
                    put_varint(&mut entry, x);
                }
                put_part(&mut entry, &content);
                put_varint(&mut entry, index.len() as u64);
                entry.extend(&page_records);
                index = [content, index].concat();
            }
            clusters.extend(entry);
        } else {
            index.clear();
        }
        let contents = [levels, flat_tables(CONTEXT_COUNT), clusters, index, pages];
        let flags = [1, 1, 1, 3, 3];
        let sections = (LEVELS..).zip(flags).zip(contents);
        Container {
            step_log2: -6,
            sections: sections.map(|((kind, flags), content)| Section { kind, flags, content, reserved: 0 }).collect(),
            ..Container::default()
        }
    }
}

/// Places in the records of [`Handmade::example`].
const ROOT: usize = 0;
const HALF_ARC_COUNT: usize = 1;
const HALF_ARCS: usize = 2;
const BOX_SIZE: usize = 8;
const CHILDREN: usize = 11;
const LEVEL_SET: usize = 12;
const COARSE_ERROR: usize = 13;
const FINE_ERROR: usize = 17;
const FINE_TRIANGLES: usize = 19;
const FINE_BEGINS: usize = 20;
const FIRST_ARC: usize = 21;
const FIRST_CORNER_LEVEL: usize = 22;
const SECOND_CORNER_LEVEL: usize = 24;
const FIRST_ARC_SAMPLES: usize = 25;
const LAST_ARC: usize = 32;

/// Places in the records of [`Handmade::tree`].
const CHILD_HALF_ARCS: usize = 19;
const CHILD_CHILDREN: usize = 28;
const CHILD_LEVEL_SET: usize = 29;
const CHILD_TRIANGLES: usize = 32;
/// Each arc's number of samples at level 1, backwards.
const TREE_FINE_SAMPLES: [usize; 3] = [48, 44, 39];

fn put_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn put_part(bytes: &mut Vec<u8>, part: &[u8]) {
    put_varint(bytes, part.len() as u64);
    if !part.is_empty() {
        bytes.extend(crc32fast::hash(part).to_le_bytes());
    }
}
