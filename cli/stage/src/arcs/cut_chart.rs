//! Cuts one chart out of the mesh, as a mesh of its own.

use super::Atlas;
use super::cut_edges::is_cut;
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};

/// A chart cut out of the mesh along its loops. Where it touches a mesh vertex in two separate fans, that vertex
/// becomes two local ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LocalChart {
    /// Mesh vertex of each local vertex: first those on the border, loop after loop, then the inner ones in the order
    /// in which the triangles use them.
    pub mesh_vertex: Vec<u32>,
    /// Local vertices of the chart's triangles, in the chart's order.
    pub triangles: Vec<[u32; 3]>,
    /// The border loops in the order and direction of [`super::Chart::loops`]. Each half-arc contributes all of its
    /// vertices but the last.
    pub loops: Vec<Vec<LoopVertex>>,
}

/// A vertex on the border of a [`LocalChart`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopVertex {
    /// Index into [`LocalChart::mesh_vertex`].
    pub local_vertex: u32,
    /// Index of the half-arc in its loop.
    pub side: u32,
    /// Index into the arc's path as stored. It falls along a side that runs against its arc.
    pub path_index: u32,
}

/// Cuts chart `chart_index` out of the mesh, in time proportional to its size. `labels` are those given to
/// [`super::trace_arcs`].
pub fn cut_chart(mesh: &Mesh, adjacency: &Adjacency, atlas: &Atlas, labels: &[u32], chart_index: u32) -> LocalChart {
    let chart = &atlas.charts[chart_index as usize];
    let border_count: usize = chart.loops.iter().flatten().map(|s| atlas.arcs[s.arc as usize].edge_count()).sum();
    let mut local = LocalChart { triangles: Vec::with_capacity(chart.triangles.len()), ..LocalChart::default() };
    // A manifold with loops has at most (triangles + border edges) / 2 + 1 vertices. Should there be more, the table
    // grows.
    let mut numbers = VertexNumbers::with_capacity((chart.triangles.len() + border_count) / 2 + 2);

    // Vertices that are on the border more than once, each with the vertex that follows on the loop: that edge
    // identifies the fan.
    let mut split: Vec<(u32, u32, u32)> = Vec::new();
    // For each border vertex, the vertex that follows on its loop.
    let mut followings: Vec<u32> = Vec::with_capacity(border_count);
    for sides in &chart.loops {
        let mut vertices = Vec::new();
        for (side, half_arc) in sides.iter().enumerate() {
            let path = &atlas.arcs[half_arc.arc as usize].path;
            for (path_index, next) in half_arc.path_indices(atlas).zip(half_arc.path_indices(atlas).skip(1)) {
                let (v, following) = (path[path_index as usize], path[next as usize]);
                let local_vertex = local.mesh_vertex.len() as u32;
                let first = numbers.find_or_insert(v, local_vertex);
                if first != local_vertex {
                    split.push((v, following, local_vertex));
                    split.push((v, followings[first as usize], first));
                }
                followings.push(following);
                local.mesh_vertex.push(v);
                vertices.push(LoopVertex { local_vertex, side: side as u32, path_index });
            }
        }
        local.loops.push(vertices);
    }
    split.sort_unstable();
    split.dedup();

    for &t in &chart.triangles {
        let corners = [0, 1, 2].map(|k| {
            let v = mesh.triangles[t as usize][k as usize];
            let next_number = local.mesh_vertex.len() as u32;
            let number = numbers.find_or_insert(v, next_number);
            if number == next_number {
                local.mesh_vertex.push(v);
            }
            if split.is_empty() || (number as usize) >= border_count {
                return number;
            }
            let same = split.partition_point(|&(w, ..)| w < v);
            if split.get(same).is_none_or(|&(w, ..)| w != v) {
                return number;
            }
            // Rotate to the half-edge by which the loop leaves this fan.
            let mut h = 3 * t + k;
            while !is_cut(adjacency, labels, h) {
                h = next_half_edge(adjacency.opposite[h as usize]);
            }
            let end = next_half_edge(h);
            let following = mesh.triangles[end as usize / 3][end as usize % 3];
            let slot = split.partition_point(|&(w, f, _)| (w, f) < (v, following));
            split.get(slot).map_or(number, |&(.., number)| number)
        });
        local.triangles.push(corners);
    }
    local
}

/// Numbers mesh vertices: a hash table with open addressing that grows as needed.
struct VertexNumbers {
    /// Vertex and number; [`NONE`] marks a free slot. The length is a power of two.
    slots: Vec<(u32, u32)>,
    used: usize,
}

impl VertexNumbers {
    fn with_capacity(vertex_count: usize) -> Self {
        Self { slots: vec![(NONE, 0); (2 * vertex_count).next_power_of_two().max(4)], used: 0 }
    }

    /// The number of a vertex; `number` if it had none.
    fn find_or_insert(&mut self, vertex: u32, number: u32) -> u32 {
        if 4 * self.used > 3 * self.slots.len() {
            let mut larger = Self::with_capacity(self.slots.len());
            for &(vertex, number) in self.slots.iter().filter(|slot| slot.0 != NONE) {
                larger.find_or_insert(vertex, number);
            }
            *self = larger;
        }
        let mask = self.slots.len() - 1;
        // Fibonacci hashing: the product's upper bits depend on all bits of the vertex.
        let mut at = (u64::from(vertex).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32) as usize & mask;
        loop {
            let slot = &mut self.slots[at];
            if slot.0 == vertex {
                return slot.1;
            }
            if slot.0 == NONE {
                *slot = (vertex, number);
                self.used += 1;
                return number;
            }
            at = (at + 1) & mask;
        }
    }
}
