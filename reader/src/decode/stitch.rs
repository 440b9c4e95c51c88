//! Stitching: joins the patches of a cut without cracks, whatever their levels (SPEC.md, "Stitching").
//!
//! Every arc is drawn with the samples of the finest level that any of its roots in the cut has. A root that is coarser
//! gets the extra samples inserted into the triangles at its border: a triangle with a border edge becomes a fan from
//! the vertex opposite that edge. Where a triangle has several border edges with extra samples, the fan over the first
//! of these edges is made; the other edges now belong to the first and the last triangle of that fan, which become fans
//! in turn. So every extra sample adds one triangle, and no edge appears twice in the same direction.

use std::collections::HashMap;

use super::{
    Decoded,
    border::{BorderEdges, first_is_none},
    cut::Drawn,
};
use crate::{
    codec::patch::Patch,
    error::{Error, Result},
    format::index_block::RootEntry,
    lattice::{Lattice, LatticePoint},
};

/// Triangles of a cut.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// World positions. Vertices that several roots share occur once.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// For each triangle the index of its node in the cut.
    pub triangle_nodes: Vec<u32>,
}

/// The mesh so far, and its shared vertices.
#[derive(Default)]
pub(super) struct Stitcher {
    lattice: Lattice,
    mesh: Mesh,
    corners: HashMap<u32, u32>,
    /// First vertex of each arc's samples.
    arcs: HashMap<u32, u32>,
    /// For each triangle of the mesh the one of its patch in which it lies, if that is asked for.
    origins: Option<Vec<u32>>,
}

/// A root's border in the mesh's vertices.
#[derive(Default)]
struct Border {
    /// Mesh vertex of each border vertex of the patch.
    vertices: Vec<u32>,
    /// How many border vertices each loop has.
    loop_lengths: Vec<usize>,
    /// Mesh vertices to be inserted into the edges to the next ones, one edge after the other.
    extra: Vec<u32>,
    /// Where each edge's begin.
    extra_start: Vec<usize>,
}

impl Border {
    fn push(&mut self, vertex: u32) {
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
    /// An empty mesh with room for a closed surface of about this many triangles, because growing would copy it again
    /// and again.
    pub fn new(lattice: Lattice, triangle_count: usize) -> Self {
        let mut mesh = Mesh::default();
        mesh.positions.reserve(triangle_count / 2 + triangle_count / 64);
        mesh.triangles.reserve(triangle_count);
        mesh.triangle_nodes.reserve(triangle_count);
        Self { lattice, mesh, ..Self::default() }
    }

    /// The same, which also remembers in which triangle of its patch each triangle lies.
    pub fn with_origins(self) -> Self {
        Self { origins: Some(vec![]), ..self }
    }

    pub fn finish(self) -> Mesh {
        self.mesh
    }

    /// How many triangles there are so far.
    pub fn triangle_count(&self) -> usize {
        self.mesh.triangles.len()
    }

    /// Takes out those triangles of the last roots, from one on, that lie in some of their patches. Needs what
    /// [`Self::with_origins`] remembers.
    pub fn retain(&mut self, from: usize, keeps: impl Fn(u32) -> bool) {
        let Some(origins) = &mut self.origins else { return };
        let mut end = from;
        for at in from..origins.len().min(self.mesh.triangles.len()) {
            if keeps(origins[at]) {
                (origins[end], self.mesh.triangles[end]) = (origins[at], self.mesh.triangles[at]);
                self.mesh.triangle_nodes[end] = self.mesh.triangle_nodes[at];
                end += 1;
            }
        }
        origins.truncate(end);
        self.mesh.triangles.truncate(end);
        self.mesh.triangle_nodes.truncate(end);
    }

    /// Takes out vertices that no triangle has.
    pub fn drop_unused(&mut self) {
        const UNUSED: u32 = u32::MAX;
        let mut numbers = vec![UNUSED; self.mesh.positions.len()];
        self.mesh.triangles.iter().flatten().for_each(|&vertex| numbers[vertex as usize] = 0);
        let mut next = 0;
        for (vertex, number) in numbers.iter_mut().enumerate().filter(|(_, number)| **number != UNUSED) {
            self.mesh.positions[next as usize] = self.mesh.positions[vertex];
            *number = next;
            next += 1;
        }
        self.mesh.positions.truncate(next as usize);
        self.mesh.triangles.iter_mut().flatten().for_each(|vertex| *vertex = numbers[*vertex as usize]);
    }

    /// Takes what [`Self::with_origins`] remembers.
    pub fn take_origins(&mut self) -> Vec<u32> {
        self.origins.take().unwrap_or_default()
    }

    /// Adds a root, which is node number `node` of the cut.
    pub fn add_root(
        &mut self,
        node: u32,
        entry: &RootEntry,
        level: u8,
        patch: &Patch,
        drawn: &Drawn,
        decoded: &Decoded<'_>,
    ) -> Result<()> {
        let border = self.border(entry, level, drawn, decoded)?;
        let mut border_edges = BorderEdges::new(border.loop_lengths.iter().copied(), patch)?;
        let border_count = border.vertices.len();
        let first_interior = self.vertex_count()?;
        self.mesh.positions.extend(patch.interior.iter().map(|&point| self.lattice.world(point)));
        self.vertex_count()?;
        let (border_vertices, inner_offset) = (border_count as u32, first_interior.wrapping_sub(border_count as u32));
        for (number, triangle) in (0..).zip(&patch.triangles) {
            if let Some(origins) = &mut self.origins {
                // What the triangle before has become.
                origins.resize(self.mesh.triangles.len(), number - u32::from(number > 0));
            }
            // All three are compared without branches, which could not be predicted here.
            if triangle.iter().fold(true, |is_inner, &vertex| is_inner & (vertex >= border_vertices)) {
                self.mesh.triangles.push(triangle.map(|vertex| inner_offset.wrapping_add(vertex)));
                continue;
            }
            // Again without branches, because most of these triangles only touch the border.
            let nearest = |k: usize| triangle[k].min(border_vertices - 1) as usize;
            let known = [nearest(0), nearest(1), nearest(2)];
            let corner = |k: usize| {
                let inner = inner_offset.wrapping_add(triangle[k]);
                if triangle[k] < border_vertices { border.vertices[known[k]] } else { inner }
            };
            let is_border_edge =
                |k: usize| (triangle[k] < border_vertices) & (border_edges.next(known[k]) == triangle[(k + 1) % 3]);
            let corners = [corner(0), corner(1), corner(2)];
            let edges = [is_border_edge(0), is_border_edge(1), is_border_edge(2)];
            if !(edges[0] | edges[1] | edges[2]) {
                self.mesh.triangles.push(corners);
                continue;
            }
            let mut extra: [&[u32]; 3] = [&[]; 3];
            for k in (0..3).filter(|&k| edges[k]) {
                border_edges.add_triangle(known[k])?;
                extra[k] = border.extra_after(triangle[k]);
            }
            insert_samples(corners, extra, &mut self.mesh.triangles);
        }
        if let Some(origins) = &mut self.origins {
            origins.resize(self.mesh.triangles.len(), patch.triangles.len().saturating_sub(1) as u32);
        }
        self.mesh.triangle_nodes.resize(self.mesh.triangles.len(), node);
        border_edges.finish()
    }

    /// Number of vertices so far, checked against the range of the mesh's indices.
    fn vertex_count(&self) -> Result<u32> {
        u32::try_from(self.mesh.positions.len()).map_err(|_| Error::Query {
            what: "the cut has more than 2^32 vertices; ask for a larger error or a smaller volume".into(),
        })
    }

    fn border(&mut self, entry: &RootEntry, level: u8, drawn: &Drawn, decoded: &Decoded<'_>) -> Result<Border> {
        let mut border = Border::default();
        for half_arcs in &entry.loops {
            let before = border.vertices.len();
            decoded.walk_loop(half_arcs, |side| {
                let corner_level = drawn.corner_levels.get(&side.corner).copied().unwrap_or(level);
                if side.corner_level <= corner_level {
                    let vertex = self.corner(side.corner, side.corner_position)?;
                    if side.corner_level <= level { border.push(vertex) } else { border.extra.push(vertex) }
                }
                if border.vertices.len() == before {
                    return Err(first_is_none());
                }
                let arc = side.half_arc.arc;
                let arc_level = drawn.arc_levels.get(&arc).copied().unwrap_or(level);
                let samples = side.path.samples().iter().filter(|knot| knot.level <= arc_level);
                let next_vertex = self.vertex_count()?;
                let first = *self.arcs.entry(arc).or_insert(next_vertex);
                if first == next_vertex {
                    self.mesh.positions.extend(samples.clone().map(|knot| self.lattice.world(knot.position)));
                    self.vertex_count()?;
                }
                // The samples of an arc are numbered in its own direction.
                let mut vertices = first..first + samples.count() as u32;
                side.visit_samples(arc_level, |knot| {
                    let vertex = if side.half_arc.reversed { vertices.next_back() } else { vertices.next() };
                    let Some(vertex) = vertex else { return };
                    if knot.level <= level { border.push(vertex) } else { border.extra.push(vertex) }
                });
                Ok(())
            })?;
            border.loop_lengths.push(border.vertices.len() - before);
        }
        Ok(border)
    }

    fn corner(&mut self, corner: u32, position: LatticePoint) -> Result<u32> {
        let next_vertex = self.vertex_count()?;
        let vertex = *self.corners.entry(corner).or_insert(next_vertex);
        if vertex == next_vertex {
            self.mesh.positions.push(self.lattice.world(position));
        }
        Ok(vertex)
    }
}

/// Appends a triangle with samples inserted into its edges; `extra[k]` lie between corner k and the next.
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
