//! Writes a file with the index of a huge surface and hardly any geometry: large_index DEPTH FILE [ENTRIES OF A LIST]
//!
//! ```sh
//! cargo run --release -p lodpack --features write --example large_index -- 9 billion.lodpack
//! cargo run --release -p lodpack --features write --example large_index -- 4 million.lodpack
//! ```
//!
//! Two trees of squares lie side by side. Each has 4^DEPTH leaves, and groups of four up to one top. A leaf stands for
//! a chart of about 2,000 triangles: 524,288 leaves, for depth 9, are the index of a billion triangles, and 512 leaves
//! that of a million. But the blocks of a leaf have two triangles and eight, so the pages are much smaller than those
//! of a real surface. Borders are real: the border of a group consists of the arcs of the leaves along it. The same
//! depth gives the same bytes on every machine.

use std::error::Error;

use lodpack::{
    Lattice, LatticePoint,
    index::HalfArc,
    write::{
        ArcRecord, BlockRecord, LevelInfo, ListSizes, Model, PARAM_END, PatchTarget, Quantisation, RootRecord, Slide,
        SymbolBuffer, WantedSample, encode_patch, quantise_arc, write_listed,
    },
};

/// Lattice steps along the side of a leaf.
const SIDE: i64 = 64;
const QUANTISATION: Quantisation = Quantisation { normal_shift: 0, tangent_shift: 1 };
/// Leaves have this level more than the groups above them need.
const LEAF_LEVELS: usize = 2;

/// The vertices of these patches are where they belong.
struct Stay;

impl Slide for Stay {
    fn offset(&self, _vertex: u32, _point: [f64; 3], _normal: [f64; 3]) -> f64 {
        0.0
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (depth, path, entries) = match arguments.as_slice() {
        [depth, path] => (depth, path, ListSizes::default().entries),
        [depth, path, entries] => (depth, path, entries.parse()?),
        _ => return Err("usage: large_index DEPTH FILE [ENTRIES OF A LIST]".into()),
    };
    let depth: u32 = depth.parse()?;
    if depth > 10 {
        return Err("depths above 10 would take more than ten gigabytes of memory".into());
    }
    let model = Squares { depth }.model()?;
    let (leaves, roots) = (2 << (2 * depth), model.roots.len());
    let sizes = ListSizes { entries, ..ListSizes::default() };
    let report = write_listed(&model, sizes, &mut std::io::BufWriter::new(std::fs::File::create(path)?))?;
    println!("{path}: {leaves} leaves, {roots} roots, {} bytes", report.total_bytes);
    for (section, bytes) in report.sections {
        println!("  {section:9} {bytes:12}");
    }
    Ok(())
}

/// Level, triangles and symbols of each block.
type Blocks = Vec<(usize, u32, SymbolBuffer)>;

/// Two squares of 2^depth by 2^depth leaves.
struct Squares {
    depth: u32,
}

impl Squares {
    /// Leaves along x and along y.
    fn size(&self) -> [i64; 2] {
        [2 << self.depth, 1 << self.depth]
    }

    /// That of a leaf is 1/256 of its side. Each level has four times the triangles, and a quarter of the error.
    fn tolerance(&self, level: usize) -> f64 {
        (1_u64 << (2 * self.depth)) as f64 / (1_u64 << (2 * level + 8)) as f64
    }

    fn corner(&self, [x, y]: [i64; 2]) -> u32 {
        (y * (self.size()[0] + 1) + x) as u32
    }

    /// The arc from a corner to the next one along x or y.
    fn arc(&self, [x, y]: [i64; 2], axis: usize) -> u32 {
        let [width, height] = self.size();
        let number = if axis == 0 { y * width + x } else { width * (height + 1) + x * height + y };
        number as u32
    }

    /// Half-arcs around a square of `size` by `size` leaves.
    fn outline(&self, [x, y]: [i64; 2], size: i64) -> Vec<HalfArc> {
        let half_arc = |at: [i64; 2], axis: usize, reversed: bool| HalfArc { arc: self.arc(at, axis), reversed };
        let mut around = Vec::with_capacity(4 * size as usize);
        around.extend((0..size).map(|k| half_arc([x + k, y], 0, false)));
        around.extend((0..size).map(|k| half_arc([x + size, y + k], 1, false)));
        around.extend((0..size).rev().map(|k| half_arc([x + k, y + size], 0, true)));
        around.extend((0..size).rev().map(|k| half_arc([x, y + k], 1, true)));
        around
    }

    fn model(&self) -> Result<Model, Box<dyn Error>> {
        let [width, height] = self.size();
        let level_count = self.depth as usize + LEAF_LEVELS;
        let tolerance = |level: usize| self.tolerance(level);
        let levels = (0..level_count)
            .map(|level| LevelInfo { tolerance: tolerance(level), steps: QUANTISATION.into() })
            .collect();
        let places = || (0..=height).flat_map(|y| (0..=width).map(move |x| [x, y]));
        // A corner is a vertex from the level on whose squares have it as a corner.
        let corner_level = |[x, y]: [i64; 2]| {
            let zeros = (x | y | 1 << self.depth).trailing_zeros();
            (self.depth - zeros) as u8
        };
        let corners: Vec<LatticePoint> = places().map(|[x, y]| [x * SIDE, y * SIDE, 0]).collect();
        let mut arcs = Vec::new();
        for axis in 0..2 {
            let along = |at: [i64; 2]| if axis == 0 { [at[0] + 1, at[1]] } else { [at[0], at[1] + 1] };
            let mut of_axis: Vec<(u32, [u32; 2])> = Vec::new();
            for at in places().filter(|&at| along(at)[0] <= width && along(at)[1] <= height) {
                of_axis.push((self.arc(at, axis), [self.corner(at), self.corner(along(at))]));
            }
            of_axis.sort_unstable();
            for (_, ends) in of_axis {
                let points = ends.map(|end| corners[end as usize]);
                let position = [0, 1, 2].map(|k| (points[0][k] + points[1][k]) as f64 / 2.0);
                let middle = WantedSample { param: PARAM_END / 2, level: self.depth as u8 + 1, position };
                arcs.push(ArcRecord { ends, samples: quantise_arc(points, &[middle], 1)? });
            }
        }
        let mut model = Model {
            lattice: Lattice { origin: [0.0; 3], step_log2: -6 },
            arc_tangent_shift: 1,
            levels,
            corners,
            corner_levels: places().map(corner_level).collect(),
            arcs,
            ..Model::default()
        };
        let mut parents: Vec<u32> = Vec::new();
        for depth in 0..=self.depth {
            let size = 1 << (self.depth - depth);
            let blocks = self.blocks(depth)?;
            let first = model.roots.len() as u32;
            for y in 0..1 << depth {
                for x in 0..2 << depth {
                    let parent = (depth > 0).then(|| parents[((y / 2) * (1 << depth) + x / 2) as usize]);
                    model.roots.push(self.root([x * size, y * size], size, parent, &blocks));
                }
            }
            parents = (first..model.roots.len() as u32).collect();
        }
        Ok(model)
    }

    /// Levels and symbols of the blocks of a square at a depth. All squares of a depth have the same, since only
    /// distances are coded.
    fn blocks(&self, depth: u32) -> Result<Blocks, Box<dyn Error>> {
        let size = (SIDE << (self.depth - depth)) as f64;
        let ends = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]].map(|p: LatticePoint| p.map(|x| x * size as i64));
        let mut blocks = vec![(depth as usize, 2, encoded(&ends, &[], &[[0, 1, 2], [0, 2, 3]])?)];
        if depth == self.depth {
            let with_middles: Vec<LatticePoint> = (0..8)
                .map(|k| {
                    let (a, b) = (ends[k / 2], ends[(k / 2 + k % 2) % 4]);
                    [0, 1, 2].map(|axis| (a[axis] + b[axis]) / 2)
                })
                .collect();
            let fan: Vec<[u32; 3]> = (0..8).map(|k| [8, k, (k + 1) % 8]).collect();
            blocks.push((depth as usize + 1, 8, encoded(&with_middles, &[[size / 2.0, size / 2.0, 0.0]], &fan)?));
        }
        Ok(blocks)
    }

    fn root(&self, at: [i64; 2], size: i64, parent: Option<u32>, blocks: &Blocks) -> RootRecord {
        let mut records = vec![None; self.depth as usize + LEAF_LEVELS];
        for (level, triangle_count, symbols) in blocks {
            let tolerance = self.tolerance(*level);
            // Between half of the tolerance and all of it, here more and there less.
            let share = (at[0] * 7919 + at[1] * 104_729 + *level as i64 * 31) % 64;
            let error = tolerance * (0.5 + share as f64 / 128.0);
            let (triangle_count, symbols) = (*triangle_count, symbols.clone());
            records[*level] = Some(BlockRecord {
                error,
                border_deviation: tolerance / 16.0,
                triangle_count,
                symbols,
                ..BlockRecord::default()
            });
        }
        let [x, y] = at.map(|x| x as f64);
        let size_in_world = size as f64;
        RootRecord {
            loops: vec![self.outline(at, size)],
            bounds: [[x, y, -0.5], [x + size_in_world, y + size_in_world, 0.5]],
            parent,
            blocks: records,
            ..RootRecord::default()
        }
    }
}

fn encoded(
    border: &[LatticePoint],
    interior: &[[f64; 3]],
    triangles: &[[u32; 3]],
) -> Result<SymbolBuffer, Box<dyn Error>> {
    let mut symbols = SymbolBuffer::default();
    let target = PatchTarget { loops: &[border.to_vec()], interior, triangles };
    encode_patch(&target, QUANTISATION, &Stay, &mut symbols)?;
    Ok(symbols)
}
