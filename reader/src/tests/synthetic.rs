//! Atlases whose faces are polygons: each face a root, each edge an arc with samples pushed outward at random.

use std::collections::BTreeMap;

use crate::{
    Lattice,
    codec::filling::{
        Slide,
        grid::{self, GridCell, GridShape, GridSides, GridSite, GridTarget},
        irregular::{PatchTarget, encode_patch},
    },
    decode::Patch,
    format::records::HalfArc,
    index::{ChannelInfo, ChannelKind, Filling, SourceInfo},
    lattice::LatticePoint,
    write::{
        ArcRecord, ArcTarget, BlockRecord, LevelInfo, ListSizes, Model, PARAM_END, Quantisation, RootRecord,
        SymbolBuffer, WantedSample, quantise_arcs, write_listed,
    },
};

/// Random numbers (xorshift).
#[derive(Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// A number below `end`.
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) % end
    }

    /// A number from 0 to 1.
    pub(crate) fn unit(&mut self) -> f64 {
        self.below(1 << 40) as f64 / (1_u64 << 40) as f64
    }
}

/// A polyhedron on the lattice.
pub(crate) struct Faces {
    pub points: Vec<LatticePoint>,
    pub faces: Vec<Vec<u32>>,
}

/// The surface of a cube with `n` by `n` faces on each side.
pub(crate) fn cube(n: i64) -> Faces {
    let mut points = Vec::new();
    let mut numbers = BTreeMap::new();
    let mut faces = Vec::new();
    let mut number = |cell: [i64; 3]| {
        *numbers.entry(cell).or_insert_with(|| {
            points.push(cell.map(|x| (2 * x - n) * 5000 / n));
            points.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for (side, u, v) in [(0, (axis + 2) % 3, (axis + 1) % 3), (n, (axis + 1) % 3, (axis + 2) % 3)] {
            for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(a, b)| {
                    let mut cell = [0; 3];
                    (cell[axis], cell[u], cell[v]) = (side, a, b);
                    number(cell)
                });
                faces.push(corners.to_vec());
            }
        }
    }
    Faces { points, faces }
}

/// Four triangles: at level 0 every triangle has three border edges.
pub(crate) fn tetrahedron() -> Faces {
    let points = vec![[0, 0, 0], [9000, 100, 0], [0, 9000, 200], [300, 0, 9000]];
    Faces { points, faces: vec![vec![0, 2, 1], vec![0, 1, 3], vec![1, 2, 3], vec![0, 3, 2]] }
}

/// How a model is made.
#[derive(Clone, Copy)]
pub(crate) struct Options {
    pub levels: u8,
    pub seed: u64,
    /// Of four roots, how many are grids.
    pub grids_of_four: u64,
    /// Heights of groups above the faces. They need a cube with 2^(heights - 1) by 2^(heights - 1) faces on each side.
    pub heights: u8,
}

/// Adds nested samples between two parameters.
fn split(samples: &mut BTreeMap<u32, u8>, [a, b]: [u32; 2], coarsest: u8, levels: u8, random: &mut Random) {
    let level = coarsest + random.below(2) as u8;
    if level >= levels || b - a < 4096 || random.below(5) == 0 {
        return;
    }
    let middle = (a + b) / 2;
    samples.insert(middle, level);
    // Halves may follow at the same level.
    split(samples, [a, middle], level, levels, random);
    split(samples, [middle, b], level, levels, random);
}

fn arcs(faces: &Faces, edges: &BTreeMap<[u32; 2], u32>, options: Options, random: &mut Random) -> Vec<ArcTarget> {
    let mut targets = vec![ArcTarget::default(); edges.len()];
    for (&ends, &arc) in edges {
        let mut levels = BTreeMap::new();
        split(&mut levels, [0, PARAM_END], 0, options.levels, random);
        // Of an arc's coarsest samples all or none are there above the faces.
        let coarsest = if options.heights > 0 { random.below(u64::from(options.heights) + 1) as u8 } else { 0 };
        for level in levels.values_mut() {
            *level = if *level == 0 { coarsest } else { *level + options.heights };
        }
        let [a, b] = ends.map(|end| faces.points[end as usize].map(|x| x as f64));
        let mut sample = |(param, level): (u32, u8)| {
            let t = f64::from(param) / f64::from(PARAM_END);
            let bulge = 1.0 + 0.1 * t * (1.0 - t) + random.below(50) as f64 * 1e-3;
            WantedSample { param, level, position: [0, 1, 2].map(|k| (a[k] + (b[k] - a[k]) * t) * bulge) }
        };
        targets[arc as usize] = ArcTarget { ends, samples: levels.into_iter().map(&mut sample).collect() };
    }
    targets
}

/// Where a face's vertices go without a codec's help.
struct Stay;

impl Slide for Stay {
    fn offset(&self, _vertex: u32, _point: [f64; 3], _normal: [f64; 3]) -> f64 {
        0.0
    }
}

/// A grid that is one polygon, or a fan around its middle.
struct Fan(GridShape, [f64; 3]);

impl GridTarget for Fan {
    fn shape(&self) -> GridShape {
        self.0
    }

    fn is_split(&self, _cell: GridCell) -> bool {
        false
    }

    fn position(&self, _site: GridSite) -> [f64; 3] {
        self.1
    }
}

impl crate::write::Slide<GridSite> for Fan {
    fn offset(&self, _site: GridSite, _point: [f64; 3], _normal: [f64; 3]) -> f64 {
        0.0
    }
}

/// The samples of a face's sides at a level.
fn sides(arcs: &[ArcRecord], corners: &[LatticePoint], half_arcs: &[HalfArc], level: u8) -> GridSides {
    let side = |half_arc: &HalfArc| {
        let arc = &arcs[half_arc.arc as usize];
        let mut side: Vec<(u32, LatticePoint)> = arc
            .samples
            .iter()
            .filter(|sample| sample.level <= level)
            .map(|sample| (if half_arc.reversed { PARAM_END - sample.param } else { sample.param }, sample.position))
            .collect();
        side.push((0, corners[arc.ends[usize::from(half_arc.reversed)] as usize]));
        side.sort_unstable();
        side
    };
    GridSides { sides: half_arcs.iter().map(side).collect() }
}

fn middle(border: &[LatticePoint]) -> [f64; 3] {
    [0, 1, 2].map(|k| border.iter().map(|point| point[k] as f64).sum::<f64>() / border.len() as f64)
}

/// A model, and the patch of every block of its roots.
pub(crate) fn model(faces: &Faces, options: Options) -> (Model, Vec<Vec<Option<Patch>>>) {
    let mut random = Random::new(options.seed);
    let mut edges = BTreeMap::new();
    let mut roots = Vec::new();
    for face in &faces.faces {
        let half_arc = |(&a, &b): (&u32, &u32)| {
            let next = edges.len() as u32;
            let arc = *edges.entry([a.min(b), a.max(b)]).or_insert(next);
            HalfArc { arc, reversed: a > b }
        };
        let loops = vec![face.iter().zip(face.iter().cycle().skip(1)).map(half_arc).collect()];
        let filling = if random.below(4) < options.grids_of_four { Filling::Grid } else { Filling::Irregular };
        let at = |k: usize, pick: fn(f64, f64) -> f64| {
            face.iter().map(|&v| faces.points[v as usize][k] as f64 * 1.1 / 1024.0 + 5.0).reduce(pick).unwrap()
        };
        let bounds = [[0, 1, 2].map(|k| at(k, f64::min) - 1.0), [0, 1, 2].map(|k| at(k, f64::max) + 1.0)];
        roots.push(RootRecord {
            loops,
            filling,
            bounds,
            parent: None,
            blocks: vec![None; usize::from(options.heights)],
        });
    }
    let targets = arcs(faces, &edges, options, &mut random);
    let samples = quantise_arcs(&faces.points, &targets, 2).unwrap();
    let arcs: Vec<ArcRecord> =
        targets.iter().zip(samples).map(|(target, samples)| ArcRecord { ends: target.ends, samples }).collect();

    let lattice = Lattice { origin: [5.0, 5.0, 5.0], step_log2: -10 };
    let quantisation = Quantisation { normal_shift: 0, tangent_shift: 2 };
    let mut patches = Vec::new();
    for root in &mut roots {
        let mut state = None;
        let mut root_patches = vec![None; usize::from(options.heights)];
        for level in options.heights..options.heights + options.levels {
            if level > options.heights && random.below(4) == 0 {
                root.blocks.push(None);
                root_patches.push(None);
                continue;
            }
            let sides = sides(&arcs, &faces.points, &root.loops[0], level);
            let border: Vec<LatticePoint> = sides.sides.iter().flatten().map(|&(_, position)| position).collect();
            let mut symbols = SymbolBuffer::default();
            let patch = if root.filling == Filling::Grid {
                let shape = if level < options.heights + 2 { GridShape::Polygon } else { GridShape::Fan };
                let finer = grid::encode_level(&Fan(shape, middle(&border)), state, &sides, quantisation, &mut symbols);
                let finer = finer.unwrap();
                let patch = finer.patch(&sides).unwrap();
                state = Some(finer);
                patch
            } else {
                disk(border, quantisation, &mut random, &mut symbols)
            };
            root.blocks.push(Some(block(level, &patch, symbols, &mut random)));
            root_patches.push(Some(patch));
        }
        patches.push(root_patches);
    }
    let level_count = options.heights + options.levels;
    let levels = (0..level_count)
        .map(|level| LevelInfo { tolerance: 4_f64.powi(-i32::from(level)), steps: quantisation.into() })
        .collect();
    let source = SourceInfo { triangle_count: 12, vertex_count: 8, generator: "test".into(), ..SourceInfo::default() };
    let mut model = Model {
        lattice,
        arc_tangent_shift: 2,
        levels,
        placement: None,
        source,
        corners: faces.points.clone(),
        corner_levels: Vec::new(),
        arcs,
        roots,
        channels: Vec::new(),
        overview: None,
        nodes: Vec::new(),
    };
    for height in 0..options.heights {
        add_groups(&mut model, options.heights - 1 - height, quantisation, &mut patches, &mut random);
    }
    (model, patches)
}

/// A fan around a border vertex, or around an inner one.
fn disk(
    border: Vec<LatticePoint>,
    quantisation: Quantisation,
    random: &mut Random,
    symbols: &mut SymbolBuffer,
) -> Patch {
    let count = border.len() as u32;
    let (interior, triangles) = if random.below(2) == 0 {
        (vec![], (1..count - 1).map(|i| [0, i, i + 1]).collect::<Vec<_>>())
    } else {
        (vec![middle(&border)], (0..count).map(|i| [count, i, (i + 1) % count]).collect())
    };
    let target = PatchTarget { loops: &[border], interior: &interior, triangles: &triangles };
    encode_patch(&target, quantisation, &Stay, symbols).unwrap().0
}

fn block(level: u8, patch: &Patch, symbols: SymbolBuffer, random: &mut Random) -> BlockRecord {
    let tolerance = 4_f64.powi(-i32::from(level));
    BlockRecord {
        error: tolerance * (0.5 + random.below(100) as f64 * 0.005),
        border_deviation: tolerance * random.below(3) as f64 * 0.1,
        triangle_count: patch.triangles.len() as u32,
        symbols,
        texels: Vec::new(),
        owners: Vec::new(),
    }
}

/// Adds a group for every four tops, or one for six.
fn add_groups(
    model: &mut Model,
    level: u8,
    quantisation: Quantisation,
    patches: &mut Vec<Vec<Option<Patch>>>,
    random: &mut Random,
) {
    let tops: Vec<u32> = (0..).zip(&model.roots).filter(|(_, root)| root.parent.is_none()).map(|(k, _)| k).collect();
    // Faces of a side are numbered row by row, groups likewise.
    let width = (tops.len() as f64 / 6.0).sqrt() as u32;
    let block_of = |place: u32| {
        let (side, x, y) = (place / (width * width), place % width, place / width % width);
        if width == 1 { 0 } else { (side * width / 2 + y / 2) * width / 2 + x / 2 }
    };
    let mut groups: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    (0..).zip(&tops).for_each(|(place, &top)| groups.entry(block_of(place)).or_default().push(top));
    let loops: Vec<Vec<Vec<HalfArc>>> = groups.values().map(|members| outline(model, members)).collect();
    let mut ends = vec![std::collections::BTreeSet::new(); model.corners.len()];
    for half_arc in loops.iter().flatten().flatten() {
        model.arcs[half_arc.arc as usize].ends.into_iter().for_each(|end| _ = ends[end as usize].insert(half_arc.arc));
    }
    model.corner_levels.resize(model.corners.len(), level + 1);
    for (own, ends) in model.corner_levels.iter_mut().zip(&ends) {
        let stays = ends.len() > 2 || ends.len() == 2 && random.below(3) == 0;
        *own = if *own == level + 1 && stays { level } else { *own };
    }
    for (members, mut loops) in groups.into_values().zip(loops) {
        let number = model.roots.len() as u32;
        let mut bounds = model.roots[members[0] as usize].bounds;
        for &member in &members {
            let of_member = model.roots[member as usize].bounds;
            bounds[0] = [0, 1, 2].map(|k| bounds[0][k].min(of_member[0][k]));
            bounds[1] = [0, 1, 2].map(|k| bounds[1][k].max(of_member[1][k]));
            model.roots[member as usize].parent = Some(number);
        }
        let mut symbols = SymbolBuffer::default();
        let is_kept = |corner: u32| model.corner_levels[corner as usize] <= level;
        let patch = match loops.first_mut() {
            None => {
                let interior: Vec<[f64; 3]> = tetrahedron().points.iter().map(|p| p.map(|x| x as f64 / 4.0)).collect();
                let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];
                let target = PatchTarget { loops: &[], interior: &interior, triangles: &faces };
                encode_patch(&target, quantisation, &Stay, &mut symbols).unwrap().0
            }
            Some(half_arcs) => {
                let begin = |half_arc: &HalfArc| half_arc.directed(model.arcs[half_arc.arc as usize].ends)[0];
                let first = half_arcs.iter().position(|half_arc| is_kept(begin(half_arc))).unwrap();
                half_arcs.rotate_left(first);
                let sides = sides(&model.arcs, &model.corners, half_arcs, level).sides.into_iter().zip(&*half_arcs);
                let points = sides.flat_map(|(side, half_arc)| {
                    let has_corner = is_kept(begin(half_arc));
                    side.into_iter().filter(move |&(param, _)| param > 0 || has_corner)
                });
                let border = points.map(|(_, position)| position).collect();
                disk(border, quantisation, random, &mut symbols)
            }
        };
        let mut blocks = vec![None; model.levels.len()];
        blocks[usize::from(level)] = Some(block(level, &patch, symbols, random));
        model.roots.push(RootRecord { loops, filling: Filling::Irregular, bounds, parent: None, blocks });
        patches.push((0..model.levels.len()).map(|k| (k == usize::from(level)).then(|| patch.clone())).collect());
    }
}

/// The loops around some roots that make up a disk or everything.
fn outline(model: &Model, members: &[u32]) -> Vec<Vec<HalfArc>> {
    let all: Vec<HalfArc> =
        members.iter().flat_map(|&member| model.roots[member as usize].loops.iter().flatten().copied()).collect();
    let is_outer = |half_arc: &&HalfArc| !all.contains(&HalfArc { reversed: !half_arc.reversed, ..**half_arc });
    let ends = |half_arc: &HalfArc| half_arc.directed(model.arcs[half_arc.arc as usize].ends);
    let next: BTreeMap<u32, HalfArc> =
        all.iter().filter(is_outer).map(|half_arc| (ends(half_arc)[0], *half_arc)).collect();
    let Some(&first) = next.values().next() else { return Vec::new() };
    let around =
        std::iter::successors(Some(first), |half_arc| Some(next[&ends(half_arc)[1]]).filter(|&next| next != first));
    vec![around.collect()]
}

/// Gives a model two channels. Some blocks have no texels, or none of a channel; so have all blocks of the first roots.
pub(crate) fn add_channels(model: &mut Model, seed: u64) {
    let mut random = Random::new(seed);
    let channel = |name: &str, kind, components| ChannelInfo {
        name: name.into(),
        kind,
        is_exact: false,
        is_scaled: false,
        components,
        low: 0.0,
        step: 1.0 / 255.0,
        bound: 0.01,
    };
    model.channels = vec![channel("colour", ChannelKind::Colour, 3), channel("temperature", ChannelKind::Scalar, 1)];
    let without = model.roots.len() / 4;
    for block in model.roots.iter_mut().skip(without).flat_map(|root| root.blocks.iter_mut().flatten()) {
        let mut stream = |most: u64| -> Vec<u8> {
            let length = if random.below(5) == 0 { 0 } else { random.below(most) };
            (0..length).map(|_| random.below(256) as u8).collect()
        };
        block.texels = vec![stream(20), stream(300), stream(100)];
        if random.below(6) == 0 {
            block.texels.clear();
        }
    }
}

/// The bytes of a model with two channels.
pub(crate) fn file_with_channels(faces: &Faces, options: Options) -> Vec<u8> {
    let (mut model, _) = model(faces, options);
    add_channels(&mut model, options.seed);
    let mut bytes = Vec::new();
    write_listed(&model, ListSizes::default(), &mut bytes).unwrap();
    bytes
}

/// A file with lists of few clusters.
pub(crate) fn listed_file_of(faces: &Faces, options: Options) -> Vec<u8> {
    let mut bytes = Vec::new();
    let sizes = ListSizes { entries: 2, top_clusters: 1, ..ListSizes::default() };
    write_listed(&model(faces, options).0, sizes, &mut bytes).unwrap();
    bytes
}

/// The bytes of a model.
pub(crate) fn file_of(faces: &Faces, options: Options) -> Vec<u8> {
    let mut bytes = Vec::new();
    crate::write::write_file(&model(faces, options).0, &mut bytes).unwrap();
    bytes
}
