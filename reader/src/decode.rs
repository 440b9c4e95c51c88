//! Decoding: from the blocks that are wanted to the pages they need, and from these to patches.
//!
//! A block needs the blocks before it in its stream, a grid's block also that of the grid's next coarser level; each needs
//! the samples of its root's arcs, which lie in the arc parts of the clusters that own the arcs; and an arc part needs the
//! corners at its arcs' ends, which lie at the beginning of level 0 of the clusters that own these. Everything is found
//! from the index, read in few requests, and decoded once, coarse to fine.

use std::collections::{BTreeMap, BTreeSet, btree_map::Entry};

use crate::{
    arc::{PARAM_END, Path, decode_corner},
    entropy::{Decoder, Position},
    error::{Error, Result},
    fetch::Piece,
    file::File,
    grid::{self, GridSides, GridState},
    index::{ClusterIndex, RootEntry},
    irregular::{PatchLimits, decode_patch},
    limits::within,
    model::Filling,
    patch::{LatticePoint, Patch},
    sections::{Cluster, Part},
    source::ReadAt,
};

/// Which vertex of the whole surface a border vertex is; equal for all roots that touch it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum BorderKey {
    /// A corner.
    Corner(u32),
    /// A sample of an arc.
    Sample {
        /// The arc.
        arc: u32,
        /// The sample's parameter in 1/65536.
        param: u32,
    },
}

/// A border vertex of a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BorderVertex {
    /// Which vertex it is.
    pub key: BorderKey,
    /// Where it is.
    pub position: LatticePoint,
}

/// A block to be decoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Wanted {
    pub root: u32,
    /// A level that the root has.
    pub level: u8,
    /// Up to which level the root's arcs are wanted; at least `level`.
    pub arc_level: u8,
}

/// A part of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum PartKey {
    Arcs { level: u8, cluster: u32 },
    Blocks { level: u8, cluster: u32 },
}

impl PartKey {
    pub(crate) fn place(self) -> String {
        match self {
            Self::Arcs { level, cluster } => format!("arc part of level {level}, cluster {cluster}"),
            Self::Blocks { level, cluster } => format!("block part of level {level}, cluster {cluster}"),
        }
    }
}

/// Blocks at the beginning of a stream, up to the last one that is needed.
#[derive(Clone, Debug)]
struct Run {
    cluster: u32,
    /// Index in the cluster's streams.
    stream: usize,
    /// Last root of the run, counted from the cluster's first.
    last: u32,
}

/// What has to be read and decoded.
#[derive(Debug, Default)]
struct Needs {
    /// Per level, by cluster and stream.
    runs: Vec<Vec<Run>>,
    /// Per cluster that owns an arc, the finest level needed.
    arcs: BTreeMap<u32, u8>,
    /// Clusters whose corners are needed.
    corners: BTreeSet<u32>,
}

/// Arcs and patches.
#[derive(Debug)]
pub(crate) struct Decoded<'f, S> {
    file: &'f File<S>,
    /// Per cluster its arcs.
    paths: BTreeMap<u32, Vec<Path>>,
    patches: BTreeMap<(u32, u8), Patch>,
}

impl<'f, S: ReadAt> Decoded<'f, S> {
    /// Reads and decodes blocks.
    pub(crate) fn new(file: &'f File<S>, wanted: &[Wanted]) -> Result<Self> {
        let needs = find_needs(file, wanted)?;
        let parts = file.read_pages(find_parts(file, &needs)?, &PartKey::place)?;
        let parts = parts.iter().map(|(key, bytes)| (*key, bytes.as_slice())).collect();
        Self::from_parts(file, wanted, &needs, &parts)
    }

    /// Decodes blocks from the parts that [`parts_of`] says; reads nothing.
    pub(crate) fn of_parts(file: &'f File<S>, wanted: &[Wanted], parts: &BTreeMap<PartKey, &[u8]>) -> Result<Self> {
        Self::from_parts(file, wanted, &find_needs(file, wanted)?, parts)
    }

    fn from_parts(
        file: &'f File<S>,
        wanted: &[Wanted],
        needs: &Needs,
        parts: &BTreeMap<PartKey, &[u8]>,
    ) -> Result<Self> {
        let paths = decode_arcs(file, needs, parts)?;
        let mut decoded = Self { file, paths, patches: BTreeMap::new() };
        let wanted: BTreeSet<(u32, u8)> = wanted.iter().map(|wanted| (wanted.root, wanted.level)).collect();
        let mut grids = BTreeMap::new();
        for (level, runs) in (0..).zip(&needs.runs) {
            for run in runs {
                let key = PartKey::Blocks { level, cluster: run.cluster };
                let bytes = parts.get(&key).copied().unwrap_or(&[]);
                decoded.decode_run(level, run, bytes, &wanted, &mut grids).map_err(|error| error.at(|| key.place()))?;
            }
        }
        Ok(decoded)
    }

    /// Takes the patch of a wanted block.
    pub(crate) fn take_patch(&mut self, root: u32, level: u8) -> Result<Patch> {
        self.patches.remove(&(root, level)).ok_or_else(|| Error::format("a block does not exist"))
    }

    /// An arc and the corners at its ends.
    pub(crate) fn arc(&self, arc: u32) -> Result<(&Path, [u32; 2])> {
        let owner = self.file.owner(arc, |cluster| cluster.first_arc)?;
        let local = (arc - self.file.cluster(owner)?.first_arc) as usize;
        let path = self.paths.get(&owner).and_then(|paths| paths.get(local));
        let ends = self.file.index(owner)?.arc_ends.get(local);
        path.zip(ends.copied()).ok_or_else(|| Error::format("an arc does not exist"))
    }

    /// The border vertices of a root at a level, loop after loop.
    pub(crate) fn border(&self, root: &RootEntry, level: u8) -> Result<Vec<Vec<BorderVertex>>> {
        let sides = self.sides(root, level)?;
        Ok(sides.into_iter().map(|sides| sides.into_iter().flatten().map(|(_, vertex)| vertex).collect()).collect())
    }

    /// Per loop and half-arc the border vertices of a root, its first corner included, with the parameters along the side.
    fn sides(&self, root: &RootEntry, level: u8) -> Result<Vec<Vec<Side>>> {
        root.loops.iter().map(|half_arcs| self.loop_sides(half_arcs, level)).collect()
    }

    fn loop_sides(&self, half_arcs: &[crate::HalfArc], level: u8) -> Result<Vec<Side>> {
        let mut sides = Vec::with_capacity(half_arcs.len());
        let mut corners = Vec::with_capacity(half_arcs.len());
        for half_arc in half_arcs {
            let (path, mut ends) = self.arc(half_arc.arc)?;
            let mut positions = path.end_positions();
            if half_arc.reversed {
                ends.reverse();
                positions.reverse();
            }
            let mut side = vec![(0, BorderVertex { key: BorderKey::Corner(ends[0]), position: positions[0] })];
            let samples = path.samples().iter().filter(|knot| knot.level <= level);
            side.extend(samples.map(|knot| {
                let key = BorderKey::Sample { arc: half_arc.arc, param: knot.param };
                let along = if half_arc.reversed { PARAM_END - knot.param } else { knot.param };
                (along, BorderVertex { key, position: knot.position })
            }));
            if half_arc.reversed {
                side[1..].reverse();
            }
            sides.push(side);
            corners.push(ends);
        }
        if (0..corners.len()).any(|i| corners[i][1] != corners[(i + 1) % corners.len()][0]) {
            return Err(Error::format("a half-arc does not end where the next one begins"));
        }
        Ok(sides)
    }

    fn decode_run(
        &mut self,
        level: u8,
        run: &Run,
        part: &[u8],
        wanted: &BTreeSet<(u32, u8)>,
        grids: &mut BTreeMap<u32, GridState>,
    ) -> Result<()> {
        let file = self.file;
        let (cluster, index) = (file.cluster(run.cluster)?, file.index(run.cluster)?);
        let stream = &index.streams[run.stream];
        let bytes = part.get(stream.bytes.start as usize..stream.bytes.end as usize);
        let bytes = bytes.ok_or_else(|| Error::format("a stream leaves its page"))?;
        let mut symbols = Decoder::new(file.tables(), bytes)?;
        for local in stream.roots.start..=run.last {
            let entry = &index.roots[local as usize];
            let Some(block) = entry.blocks.iter().find(|block| block.level == level) else { continue };
            let root = cluster.first_root + local;
            let sides = self.sides(entry, level)?;
            let border_count: usize = sides.iter().flatten().map(Vec::len).sum();
            let vertex_limit = file.limits().root_vertex_count;
            within(vertex_limit, border_count as u64, "number of border vertices of a root")?;
            let is_wanted = wanted.contains(&(root, level));
            let patch = match entry.filling {
                Filling::Irregular => {
                    let position = |side: Side| side.into_iter().map(|(_, vertex)| vertex.position);
                    let loops: Vec<Vec<LatticePoint>> =
                        sides.into_iter().map(|sides| sides.into_iter().flat_map(position).collect()).collect();
                    let limits = PatchLimits { vertices: vertex_limit, triangles: u64::from(block.triangle_count) };
                    let quantisation = file.levels().levels[usize::from(level)].quantisation;
                    Some(decode_patch(&mut symbols, &loops, quantisation, limits)?)
                }
                Filling::Grid => {
                    let sides = grid_sides(sides)?;
                    let quantisation = file.levels().grid_quantisation;
                    let limits = grid::GridLimits { vertex_count: vertex_limit };
                    let state = grid::decode_level(&mut symbols, grids.remove(&root), &sides, quantisation, limits)?;
                    let patch = if is_wanted { Some(state.patch(&sides)?) } else { None };
                    grids.insert(root, state);
                    patch
                }
            };
            if let Some(patch) = patch {
                check_patch(&patch, border_count, block.triangle_count)?;
                if is_wanted {
                    self.patches.insert((root, level), patch);
                }
            }
        }
        if run.last + 1 == stream.roots.end { symbols.finish() } else { Ok(()) }
    }
}

/// Border vertices of one half-arc with their parameters along it.
type Side = Vec<(u32, BorderVertex)>;

fn grid_sides(mut loops: Vec<Vec<Side>>) -> Result<GridSides> {
    match (loops.pop(), loops.is_empty()) {
        (Some(sides), true) => {
            let plain = |side: Side| side.into_iter().map(|(param, vertex)| (param, vertex.position)).collect();
            Ok(GridSides { sides: sides.into_iter().map(plain).collect() })
        }
        _ => Err(Error::format("a grid has other than one loop")),
    }
}

/// Checks what everything after decoding relies on.
pub(crate) fn check_patch(patch: &Patch, border_count: usize, triangle_count: u32) -> Result<()> {
    if patch.border_count as usize != border_count || patch.triangles.len() != triangle_count as usize {
        return Err(Error::format("a patch has other counts than its index says"));
    }
    let vertex_count = border_count + patch.interior.len();
    if patch.triangles.iter().flatten().any(|&vertex| vertex as usize >= vertex_count) {
        return Err(Error::format("a triangle names a vertex that does not exist"));
    }
    Ok(())
}

/// The parts that blocks are decoded from.
pub(crate) fn parts_of<S: ReadAt>(file: &File<S>, wanted: &[Wanted]) -> Result<Vec<Piece<PartKey>>> {
    find_parts(file, &find_needs(file, wanted)?)
}

fn find_parts<S: ReadAt>(file: &File<S>, needs: &Needs) -> Result<Vec<Piece<PartKey>>> {
    let mut keys = BTreeSet::new();
    keys.extend(needs.corners.iter().map(|&cluster| PartKey::Arcs { level: 0, cluster }));
    for (&cluster, &finest) in &needs.arcs {
        keys.extend((0..=finest).map(|level| PartKey::Arcs { level, cluster }));
    }
    for (level, runs) in (0..).zip(&needs.runs) {
        keys.extend(runs.iter().map(|run| PartKey::Blocks { level, cluster: run.cluster }));
    }
    keys.into_iter().map(|key| Ok(Piece { key, part: part_of(file, key)? })).collect()
}

/// Where a part lies within the section PAGES.
pub(crate) fn part_of<S: ReadAt>(file: &File<S>, key: PartKey) -> Result<Part> {
    let (PartKey::Arcs { level, cluster } | PartKey::Blocks { level, cluster }) = key;
    let level = file.cluster(cluster)?.levels.get(usize::from(level));
    let level = level.ok_or_else(|| Error::format("a level does not exist"))?;
    Ok(if matches!(key, PartKey::Arcs { .. }) { level.arcs } else { level.blocks })
}

fn find_needs<S: ReadAt>(file: &File<S>, wanted: &[Wanted]) -> Result<Needs> {
    let mut needs = Needs { runs: vec![Vec::new(); file.level_count()], ..Needs::default() };
    let mut roots = vec![BTreeSet::new(); file.level_count()];
    let mut root_arcs: BTreeMap<u32, u8> = BTreeMap::new();
    for wanted in wanted {
        let level = roots.get_mut(usize::from(wanted.level.max(wanted.arc_level)));
        level.ok_or_else(|| Error::format("a level does not exist"))?;
        roots[usize::from(wanted.level)].insert(wanted.root);
        raise(&mut root_arcs, wanted.root, wanted.arc_level);
    }
    for level in (0..file.level_count()).rev() {
        let mut last_roots: BTreeMap<(u32, usize), u32> = BTreeMap::new();
        for &root in &roots[level] {
            let owner = file.owner(root, |cluster| cluster.first_root)?;
            let (cluster, index) = (file.cluster(owner)?, file.index(owner)?);
            let stream = find_stream(index, level as u8, root - cluster.first_root)?;
            // Roots ascend, so that the last one counts.
            last_roots.insert((owner, stream), root - cluster.first_root);
        }
        for ((owner, stream), last) in last_roots {
            let (cluster, index) = (file.cluster(owner)?, file.index(owner)?);
            for local in index.streams[stream].roots.start..=last {
                let entry = &index.roots[local as usize];
                let block = entry.block_at(level as u8);
                if usize::from(entry.blocks[block].level) != level {
                    continue;
                }
                raise(&mut root_arcs, cluster.first_root + local, level as u8);
                if entry.filling == Filling::Grid && block > 0 {
                    roots[usize::from(entry.blocks[block - 1].level)].insert(cluster.first_root + local);
                }
            }
            needs.runs[level].push(Run { cluster: owner, stream, last });
        }
    }
    for (root, level) in root_arcs {
        let owner = file.owner(root, |cluster| cluster.first_root)?;
        let entry = &file.index(owner)?.roots[(root - file.cluster(owner)?.first_root) as usize];
        for half_arc in entry.half_arcs() {
            raise(&mut needs.arcs, file.owner(half_arc.arc, |cluster| cluster.first_arc)?, level);
        }
    }
    file.load_indices(needs.arcs.keys().copied())?;
    for &owner in needs.arcs.keys() {
        for &corner in file.index(owner)?.arc_ends.iter().flatten() {
            needs.corners.insert(file.owner(corner, |cluster| cluster.first_corner)?);
        }
    }
    Ok(needs)
}

fn raise(levels: &mut BTreeMap<u32, u8>, key: u32, level: u8) {
    let entry = levels.entry(key).or_insert(level);
    *entry = level.max(*entry);
}

/// Index of the stream that holds the block of a root, counted from the cluster's first, at a level.
pub(crate) fn find_stream(index: &ClusterIndex, level: u8, root: u32) -> Result<usize> {
    let after = index.streams.partition_point(|stream| (stream.level, stream.roots.start) <= (level, root));
    let stream = after.checked_sub(1).and_then(|last| index.streams.get(last));
    match stream.filter(|stream| stream.level == level && stream.roots.contains(&root)) {
        Some(_) => Ok(after - 1),
        None => Err(Error::format("a block does not exist")),
    }
}

/// Decodes the corners, then the arcs, of all clusters that are needed.
fn decode_arcs<S: ReadAt>(
    file: &File<S>,
    needs: &Needs,
    parts: &BTreeMap<PartKey, &[u8]>,
) -> Result<BTreeMap<u32, Vec<Path>>> {
    let part = |level, cluster| parts.get(&PartKey::Arcs { level, cluster }).copied().unwrap_or(&[]);
    let mut corners: BTreeMap<u32, (Vec<LatticePoint>, Position)> = BTreeMap::new();
    for &number in needs.corners.iter().chain(needs.arcs.keys()) {
        if let Entry::Vacant(entry) = corners.entry(number) {
            let decoded = decode_corners(file, file.cluster(number)?, part(0, number));
            entry.insert(decoded.map_err(|e| e.at(|| PartKey::Arcs { level: 0, cluster: number }.place()))?);
        }
    }
    let corner = |id: u32| -> Result<LatticePoint> {
        let owner = file.owner(id, |cluster| cluster.first_corner)?;
        let local = (id - file.cluster(owner)?.first_corner) as usize;
        let found = corners.get(&owner).and_then(|(positions, _)| positions.get(local)).copied();
        found.ok_or_else(|| Error::format("a corner does not exist"))
    };
    let shift = file.levels().arc_tangent_shift;
    let mut paths = BTreeMap::new();
    for (&number, &finest) in &needs.arcs {
        let index = file.index(number)?;
        let mut cluster_paths = Vec::with_capacity(index.arc_ends.len());
        for ends in &index.arc_ends {
            cluster_paths.push(Path::new([corner(ends[0])?, corner(ends[1])?]));
        }
        for level in 0..=finest {
            let bytes = part(level, number);
            let mut read = || -> Result<()> {
                let mut symbols = match corners.get(&number) {
                    Some((_, after)) if level == 0 => Decoder::resume(file.tables(), bytes, *after),
                    _ => Decoder::new(file.tables(), bytes)?,
                };
                for (arc, path) in (0..).zip(&mut cluster_paths) {
                    let count = index.new_sample_count(arc, level);
                    if count > 0 {
                        path.decode_level(level, shift, count, &mut symbols)?;
                    }
                }
                symbols.finish()
            };
            read().map_err(|error| error.at(|| PartKey::Arcs { level, cluster: number }.place()))?;
        }
        paths.insert(number, cluster_paths);
    }
    Ok(paths)
}

fn decode_corners<S: ReadAt>(file: &File<S>, cluster: &Cluster, part: &[u8]) -> Result<(Vec<LatticePoint>, Position)> {
    let mut symbols = Decoder::new(file.tables(), part)?;
    let mut before = cluster.bounds[0];
    let mut positions = Vec::new();
    for _ in 0..cluster.corner_count {
        before = decode_corner(before, &mut symbols)?;
        positions.push(before);
    }
    Ok((positions, symbols.position()))
}
