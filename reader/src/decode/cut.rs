//! From a cut to its triangles, and the bytes that this takes.

use std::collections::HashMap;

use super::{
    BorderVertex, Decoded, Decoding,
    stitch::{Mesh, Stitcher},
};
use crate::{
    codec::patch::{LatticePoint, Patch},
    error::{Error, Result},
    format::clusters::Cluster,
    index::{
        Index,
        needs::{self, Wanted},
    },
    objects::ObjectState,
    select::{Cut, Node},
    source::Fetched,
};

/// One root at one level.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RootPatch {
    /// The level of the block: the finest that the root has and that is not finer than what was asked for.
    pub level: u8,
    /// The triangles.
    pub patch: Patch,
    /// The patch's border vertices, loop after loop.
    pub loops: Vec<Vec<BorderVertex>>,
}

/// Decodes and joins the triangles of a cut: see [`Cut`] for how. The mesh is watertight where the whole surface is:
/// every edge has as many triangles as in the model.
///
/// # Errors
/// [`Error::Missing`] until everything needed has been read; [`Error::Query`] if the cut is one of another file, a node
/// does not exist, or a root occurs twice;
/// [`Error::Format`], [`Error::Limit`].
pub fn extract(index: &Index, cut: &Cut, fetched: &Fetched) -> Result<Mesh> {
    Ok(joined(index, cut, 0, fetched, None)?.0)
}

/// [`extract`] with every arc drawn with its samples up to `border_level` at least, as if each root of the cut had
/// neighbours of that level. So pieces of a surface that are drawn apart, at any levels up to this one, meet without a
/// crack: tiles that another program puts together, for instance. A node's error is that of its block and its border
/// deviation added to it.
///
/// # Errors
/// As [`extract`].
pub fn extract_with_borders(index: &Index, cut: &Cut, border_level: u8, fetched: &Fetched) -> Result<Mesh> {
    Ok(joined(index, cut, border_level, fetched, None)?.0)
}

/// What is done with each root of a cut: it is given the number of its node, its level, and its patch with the
/// positions of all vertices.
pub(super) type Visit<'v> = dyn FnMut(Node, &Patch, Vec<LatticePoint>) -> Result<()> + 'v;

/// As [`extract_with_borders`]. With a function, this is called for each root, and the triangles of the patches are
/// returned in which the mesh's lie.
pub(super) fn joined(
    index: &Index,
    cut: &Cut,
    border_level: u8,
    fetched: &Fetched,
    mut visit: Option<&mut Visit<'_>>,
) -> Result<(Mesh, Vec<u32>)> {
    index.id().check_cut(cut.file)?;
    let filter = cut.objects.as_deref();
    filter.map_or(Ok(()), |filter| index.id().check_filter(filter.file))?;
    let border_level = border_level.min(index.level_count().saturating_sub(1) as u8);
    let mut drawn = Drawn::new(index, &cut.nodes, border_level)?;
    let mut decoding = Decoding::new(index, fetched, &drawn.wanted)?;
    if index.has_tree() {
        drawn.corner_levels = decoding.corner_levels(&drawn.wanted, border_level)?;
    }
    let mut stitcher = Stitcher::new(index.lattice(), decoding.triangle_estimate()?);
    if visit.is_some() || filter.is_some() {
        stitcher = stitcher.with_origins();
    }
    // Clusters ascend, and so do their roots.
    let mut nodes = (0..).zip(&drawn.wanted).peekable();
    for cluster in decoding.clusters() {
        let Cluster { first_root, root_count, .. } = *index.cluster(cluster)?;
        let decoded = decoding.decode_cluster(cluster)?;
        while let Some((node, wanted)) =
            nodes.next_if(|(_, wanted)| wanted.root < first_root.saturating_add(root_count))
        {
            let patch = decoded.take_patch(wanted.root, wanted.level)?;
            let entry = index.root_entry(wanted.root)?;
            if let Some(visit) = &mut visit {
                let border = decoded.border(entry, wanted.level)?;
                let border = border.into_iter().flatten().map(|vertex| vertex.position);
                let node = Node { root: wanted.root, level: wanted.level };
                visit(node, &patch, border.chain(patch.interior.iter().copied()).collect())?;
            }
            let (location, before) =
                (|| format!("root {}, level {}", wanted.root, wanted.level), stitcher.triangle_count());
            stitcher
                .add_root(node, entry, wanted.level, &patch, &drawn, decoded)
                .map_err(|error| error.at(location))?;
            if let Some(filter) = filter {
                let states = filter.states(wanted.root, wanted.level, &patch.triangles);
                let states = states.map_err(|error| error.at(location))?;
                stitcher.retain(before, |triangle| states.of(triangle) != ObjectState::Hidden);
            }
        }
    }
    if let Some(filter) = filter {
        filter.is_there();
        stitcher.drop_unused();
    }
    let origins = stitcher.take_origins();
    Ok((stitcher.finish(), origins))
}

/// The bytes of index blocks and pages that a cut needs: the least to read for it after opening. Reading takes more: up
/// to an eighth where near ranges are joined, up to half where more than ten requests would be needed otherwise, and
/// the index blocks that selecting looks at.
///
/// # Errors
/// [`Error::Missing`] until the index blocks needed have been supplied; [`Error::Query`] as [`extract`].
pub fn own_bytes(index: &Index, cut: &Cut) -> Result<u64> {
    index.id().check_cut(cut.file)?;
    needs::own_bytes(index, &Drawn::new(index, &cut.nodes, 0)?.wanted)
}

/// Decodes one root at a level, or at the next coarser level that it has.
///
/// # Errors
/// As [`extract`].
pub fn decode_root(index: &Index, root: u32, level: u8, fetched: &Fetched) -> Result<RootPatch> {
    let drawn = Drawn::new(index, &[Node { root, level }], 0)?;
    let mut decoded = Decoded::new(index, fetched, &drawn.wanted)?;
    let level = drawn.wanted.first().map_or(0, |wanted| wanted.level);
    let loops = decoded.border(index.root_entry(root)?, level)?;
    Ok(RootPatch { level, patch: decoded.take_patch(root, level)?, loops })
}

/// The levels at which roots and arcs are drawn.
pub(super) struct Drawn {
    wanted: Vec<Wanted>,
    /// Level of each arc of these roots.
    pub arc_levels: HashMap<u32, u8>,
    /// Level of each of their corners, except those that are vertices at every level.
    pub corner_levels: HashMap<u32, u8>,
}

impl Drawn {
    /// `border_level` is the coarsest level at which an arc is drawn.
    fn new(index: &Index, nodes: &[Node], border_level: u8) -> Result<Self> {
        if nodes.windows(2).any(|pair| pair[0].root >= pair[1].root) {
            return Err(Error::Query { what: "the nodes of a cut must be sorted by root, each root once".into() });
        }
        for node in nodes {
            if node.root >= index.root_count() || usize::from(node.level) >= index.level_count() {
                let (roots, levels) = (index.root_count(), index.level_count());
                let what = format!("node {node:?} does not exist: the file has {roots} roots and {levels} levels");
                return Err(Error::Query { what });
            }
        }
        index.load_indices(index.owners(nodes.iter().map(|node| node.root), Cluster::roots)?)?;
        let mut wanted = Vec::with_capacity(nodes.len());
        let mut arc_levels = HashMap::new();
        for node in nodes {
            let entry = index.root_entry(node.root)?;
            let level = entry.blocks[entry.block_at(node.level)].level;
            wanted.push(Wanted { root: node.root, level, arc_level: level });
            for half_arc in entry.half_arcs() {
                let drawn = arc_levels.entry(half_arc.arc).or_insert(border_level);
                *drawn = level.max(*drawn);
            }
        }
        for wanted in &mut wanted {
            let arcs = index.root_entry(wanted.root)?.half_arcs();
            wanted.arc_level = arcs.filter_map(|half_arc| arc_levels.get(&half_arc.arc).copied()).max().unwrap_or(0);
            wanted.arc_level = wanted.arc_level.max(wanted.level);
        }
        Ok(Self { wanted, arc_levels, corner_levels: HashMap::new() })
    }
}
