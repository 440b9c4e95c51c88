//! Drawing a cut: the patches of its roots, joined without cracks whatever their levels (SPEC.md, "Stitching").
//!
//! Every arc is drawn with the samples of the finest level that any of its roots in the cut has. A root that is coarser gets
//! the extra samples inserted into the triangles at its border: a triangle with a border edge becomes a fan from the vertex
//! opposite that edge. Where a triangle has several border edges with extra samples, the fan over the first of these edges
//! is made; the other edges now belong to the first and the last triangle of that fan, which become fans in turn. So every
//! extra sample adds one triangle, and no edge appears twice in the same direction.

use std::collections::HashMap;

use crate::{
    codec::patch::Patch,
    decode::{BorderVertex, Decoded, Decoding, Wanted, own_bytes},
    error::{Error, Result},
    format::{index_block::RootEntry, model::Lattice, sections::Cluster},
    index::resident::Index,
    select::{Cut, Node},
    source::fetched::Fetched,
};

/// Triangles of a cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// World positions; what several roots share is there once.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For every triangle the index of its node in the cut.
    pub triangle_nodes: Vec<u32>,
}

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

impl Index {
    /// Decodes and joins the triangles of a cut. The result is watertight where the whole surface is: every edge
    /// has as many triangles as in the model.
    ///
    /// # Errors
    /// [`Error::Missing`] until everything needed has been read; [`Error::Query`] where a node does not exist or a root is
    /// there twice, [`Error::Format`], [`Error::Limit`].
    pub fn extract(&self, cut: &Cut, fetched: &Fetched) -> Result<Mesh> {
        let drawn = Drawn::new(self, &cut.nodes)?;
        let mut decoding = Decoding::new(self, fetched, &drawn.wanted)?;
        let mut stitcher = Stitcher { lattice: self.lattice(), ..Stitcher::default() };
        stitcher.reserve(decoding.triangle_estimate()?);
        // Clusters ascend, and so do their roots.
        let mut nodes = (0..).zip(&drawn.wanted).peekable();
        for cluster in decoding.clusters() {
            let Cluster { first_root, root_count, .. } = *self.cluster(cluster)?;
            let decoded = decoding.decode_cluster(cluster)?;
            while let Some((node, wanted)) =
                nodes.next_if(|(_, wanted)| wanted.root < first_root.saturating_add(root_count))
            {
                let patch = decoded.take_patch(wanted.root, wanted.level)?;
                let entry = self.root_entry(wanted.root)?;
                stitcher
                    .add_root(node, entry, wanted.level, &patch, &drawn, decoded)
                    .map_err(|error| error.at(|| format!("root {}, level {}", wanted.root, wanted.level)))?;
            }
        }
        Ok(stitcher.mesh)
    }

    /// How many bytes of index blocks and pages a cut needs: the least that has to be read for it, without what opening
    /// brings. What is read may be more: an eighth where near ranges are joined, half where more than ten requests would be
    /// needed otherwise, and index blocks that selecting looks at.
    ///
    /// # Errors
    /// [`Error::Missing`] until the index blocks needed have been supplied; [`Error::Query`] as [`Index::extract`].
    pub fn own_bytes(&self, cut: &Cut) -> Result<u64> {
        own_bytes(self, &Drawn::new(self, &cut.nodes)?.wanted)
    }

    /// Decodes one root at a level, or the next coarser one that it has.
    ///
    /// # Errors
    /// As [`Index::extract`].
    pub fn decode_root(&self, root: u32, level: u8, fetched: &Fetched) -> Result<RootPatch> {
        let drawn = Drawn::new(self, &[Node { root, level }])?;
        let mut decoded = Decoded::new(self, fetched, &drawn.wanted)?;
        let level = drawn.wanted.first().map_or(0, |wanted| wanted.level);
        let loops = decoded.border(self.root_entry(root)?, level)?;
        Ok(RootPatch { level, patch: decoded.take_patch(root, level)?, loops })
    }
}

/// At which level everything is drawn.
struct Drawn {
    wanted: Vec<Wanted>,
    /// Level of each arc of these roots.
    arc_levels: HashMap<u32, u8>,
}

impl Drawn {
    fn new(file: &Index, nodes: &[Node]) -> Result<Self> {
        if nodes.windows(2).any(|pair| pair[0].root >= pair[1].root) {
            return Err(Error::Query { what: "the nodes of a cut have to be sorted by root, each root once".into() });
        }
        let mut owners = Vec::with_capacity(nodes.len());
        for node in nodes {
            if node.root >= file.root_count() || usize::from(node.level) >= file.level_count() {
                let (roots, levels) = (file.root_count(), file.level_count());
                let what = format!("node {node:?} does not exist: the file has {roots} roots and {levels} levels");
                return Err(Error::Query { what });
            }
            owners.push(file.owner(node.root, |cluster| cluster.first_root)?);
        }
        file.load_indices(owners)?;
        let mut wanted = Vec::with_capacity(nodes.len());
        let mut arc_levels = HashMap::new();
        for node in nodes {
            let entry = file.root_entry(node.root)?;
            let level = entry.blocks[entry.block_at(node.level)].level;
            wanted.push(Wanted { root: node.root, level, arc_level: level });
            for half_arc in entry.half_arcs() {
                let drawn = arc_levels.entry(half_arc.arc).or_insert(level);
                *drawn = level.max(*drawn);
            }
        }
        for wanted in &mut wanted {
            let arcs = file.root_entry(wanted.root)?.half_arcs();
            wanted.arc_level = arcs.filter_map(|half_arc| arc_levels.get(&half_arc.arc).copied()).max().unwrap_or(0);
            wanted.arc_level = wanted.arc_level.max(wanted.level);
        }
        Ok(Self { wanted, arc_levels })
    }
}

/// The mesh so far, and which of its vertices are shared.
#[derive(Default)]
struct Stitcher {
    lattice: Lattice,
    mesh: Mesh,
    corners: HashMap<u32, u32>,
    /// First vertex of each arc's samples.
    arcs: HashMap<u32, u32>,
    /// Memory for the samples of a half-arc: vertex and level.
    numbered: Vec<(u32, u8)>,
}

/// A root's border in the mesh's vertices.
#[derive(Default)]
struct Border {
    /// Mesh vertex of each border vertex of the patch.
    vertices: Vec<u32>,
    /// The border vertex that follows in the loop.
    next: Vec<u32>,
    /// Mesh vertices to be inserted into the edges to the next ones, one edge after the other.
    extra: Vec<u32>,
    /// Where each edge's begin.
    extra_start: Vec<usize>,
}

impl Border {
    fn push(&mut self, vertex: u32) {
        self.next.push(self.vertices.len() as u32 + 1);
        self.vertices.push(vertex);
        self.extra_start.push(self.extra.len());
    }

    fn extra_after(&self, vertex: u32) -> &[u32] {
        let start = self.extra_start[vertex as usize];
        let end = self.extra_start.get(vertex as usize + 1).copied().unwrap_or(self.extra.len());
        &self.extra[start..end]
    }
}

impl Stitcher {
    fn add_root(
        &mut self,
        node: u32,
        entry: &RootEntry,
        level: u8,
        patch: &Patch,
        drawn: &Drawn,
        decoded: &Decoded<'_>,
    ) -> Result<()> {
        let border = self.border(entry, level, drawn, decoded)?;
        let border_count = border.vertices.len();
        if border_count != patch.border_count as usize {
            return Err(Error::format("a patch has another border than its root"));
        }
        let first_interior = self.vertex_count()?;
        self.mesh.positions.extend(patch.interior.iter().map(|&point| self.lattice.world(point)));
        self.vertex_count()?;
        let mut seen = vec![false; border_count];
        let (border_vertices, inner_offset) = (border_count as u32, first_interior.wrapping_sub(border_count as u32));
        for triangle in &patch.triangles {
            // All three at once: where a border runs cannot be foreseen.
            if triangle.iter().fold(true, |is_inner, &vertex| is_inner & (vertex >= border_vertices)) {
                self.mesh.triangles.push(triangle.map(|vertex| inner_offset.wrapping_add(vertex)));
                continue;
            }
            // Again without branches: most of these triangles only touch the border.
            let nearest = |k: usize| triangle[k].min(border_vertices - 1) as usize;
            let known = [nearest(0), nearest(1), nearest(2)];
            let corner = |k: usize| {
                let inner = inner_offset.wrapping_add(triangle[k]);
                if triangle[k] < border_vertices { border.vertices[known[k]] } else { inner }
            };
            let is_border_edge =
                |k: usize| (triangle[k] < border_vertices) & (border.next[known[k]] == triangle[(k + 1) % 3]);
            let corners = [corner(0), corner(1), corner(2)];
            let edges = [is_border_edge(0), is_border_edge(1), is_border_edge(2)];
            if !(edges[0] | edges[1] | edges[2]) {
                self.mesh.triangles.push(corners);
                continue;
            }
            let mut extra: [&[u32]; 3] = [&[]; 3];
            for k in (0..3).filter(|&k| edges[k]) {
                if std::mem::replace(&mut seen[known[k]], true) {
                    return Err(Error::format("a border edge has two triangles"));
                }
                extra[k] = border.extra_after(triangle[k]);
            }
            insert_samples(corners, extra, &mut self.mesh.triangles);
        }
        self.mesh.triangle_nodes.resize(self.mesh.triangles.len(), node);
        if seen.contains(&false) {
            return Err(Error::format("a border edge has no triangle"));
        }
        Ok(())
    }

    /// Makes room for a closed surface: growing would copy everything time and again.
    fn reserve(&mut self, triangle_count: usize) {
        self.mesh.positions.reserve(triangle_count / 2 + triangle_count / 64);
        self.mesh.triangles.reserve(triangle_count);
        self.mesh.triangle_nodes.reserve(triangle_count);
    }

    /// Vertices so far; the mesh's indices have to suffice.
    fn vertex_count(&self) -> Result<u32> {
        u32::try_from(self.mesh.positions.len())
            .map_err(|_| Error::Query { what: "the cut has more than 2^32 vertices; ask for less".into() })
    }

    fn border(&mut self, entry: &RootEntry, level: u8, drawn: &Drawn, decoded: &Decoded<'_>) -> Result<Border> {
        let mut border = Border::default();
        for half_arcs in &entry.loops {
            let loop_start = border.vertices.len() as u32;
            for half_arc in half_arcs {
                let (path, ends) = decoded.arc(half_arc.arc)?;
                let arc_level = drawn.arc_levels.get(&half_arc.arc).copied().unwrap_or(level);
                let end = usize::from(half_arc.reversed);
                border.push(self.corner(ends[end], path.end_positions()[end])?);
                let samples = path.samples().iter().filter(|knot| knot.level <= arc_level);
                let next_vertex = self.vertex_count()?;
                let first = *self.arcs.entry(half_arc.arc).or_insert(next_vertex);
                if first == next_vertex {
                    self.mesh.positions.extend(samples.clone().map(|knot| self.lattice.world(knot.position)));
                    self.vertex_count()?;
                }
                let mut visit = |(vertex, knot_level): (u32, u8)| {
                    if knot_level <= level { border.push(vertex) } else { border.extra.push(vertex) }
                };
                self.numbered.clear();
                self.numbered.extend((first..).zip(samples.map(|knot| knot.level)));
                if half_arc.reversed {
                    self.numbered.reverse();
                }
                self.numbered.iter().copied().for_each(&mut visit);
            }
            if let Some(last) = border.next.last_mut() {
                *last = loop_start;
            }
        }
        Ok(border)
    }

    fn corner(&mut self, corner: u32, position: crate::LatticePoint) -> Result<u32> {
        let next_vertex = self.vertex_count()?;
        let vertex = *self.corners.entry(corner).or_insert(next_vertex);
        if vertex == next_vertex {
            self.mesh.positions.push(self.lattice.world(position));
        }
        Ok(vertex)
    }
}

/// Appends a triangle into whose edges samples are to be inserted; `extra[k]` go between corner k and the next.
pub(crate) fn insert_samples(corners: [u32; 3], extra: [&[u32]; 3], triangles: &mut Vec<[u32; 3]>) {
    let Some(base) = (0..3).find(|&k| !extra[k].is_empty()) else {
        triangles.push(corners);
        return;
    };
    let [from, to, apex] = [0, 1, 2].map(|k| corners[(base + k) % 3]);
    let [on_base, after_base, before_base] = [0, 1, 2].map(|k| extra[(base + k) % 3]);
    let (first, last) = (on_base[0], on_base[on_base.len() - 1]);
    fan(first, apex, before_base, from, triangles);
    for pair in on_base.windows(2) {
        triangles.push([apex, pair[0], pair[1]]);
    }
    fan(last, to, after_base, apex, triangles);
}

/// Triangles from `apex` to the chain `from`, `between`, `to`.
fn fan(apex: u32, from: u32, between: &[u32], to: u32, triangles: &mut Vec<[u32; 3]>) {
    let mut before = from;
    for &vertex in between.iter().chain([&to]) {
        triangles.push([apex, before, vertex]);
        before = vertex;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_inserted_sample_adds_a_triangle_and_edges_stay_paired() {
        for counts in (0..64).map(|i| [i % 4, i / 4 % 4, i / 16]) {
            let mut next = 3;
            let samples = counts.map(|count| {
                next += count;
                (next - count..next).collect::<Vec<u32>>()
            });
            let mut triangles = Vec::new();
            insert_samples([0, 1, 2], [0, 1, 2].map(|k| samples[k].as_slice()), &mut triangles);
            assert_eq!(triangles.len() as u32, 1 + counts.iter().sum::<u32>());
            let edges: Vec<[u32; 2]> =
                triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
            for (i, edge) in edges.iter().enumerate() {
                assert!(!edges[i + 1..].contains(edge), "{counts:?}");
            }
            // What is not paired inside is the outline with all samples.
            let outline: usize = edges.iter().filter(|&&[a, b]| !edges.contains(&[b, a])).count();
            assert_eq!(outline as u32, 3 + counts.iter().sum::<u32>());
            for k in 0..3 {
                let chain: Vec<u32> =
                    [k as u32].into_iter().chain(samples[k].clone()).chain([(k as u32 + 1) % 3]).collect();
                assert!(chain.windows(2).all(|pair| edges.contains(&[pair[0], pair[1]])));
            }
        }
    }
}
