//! A half-edge structure that shrinks by edge collapse, edge flip and removal of a border vertex with its fan.
//!
//! Half-edges are numbered as in [`lodpack_mesh::Adjacency`]. Nothing is ever renumbered: dead elements keep their
//! slots. Undirected edges have numbers of their own, which survive when two edges are glued into one.

use lodpack_mesh::{Adjacency, NONE, next_half_edge as next, previous_half_edge as previous};

/// One side of an edge.
#[derive(Clone, Copy, Debug)]
struct HalfEdge {
    /// The vertex at which it starts; [`NONE`] once its triangle is gone.
    origin: u32,
    /// The half-edge on the other side; [`NONE`] on the border.
    twin: u32,
    edge: u32,
}

/// Connectivity of an oriented manifold mesh, with or without border, while it is being simplified.
#[derive(Debug)]
pub(super) struct HalfEdges {
    /// Those of a triangle beside each other: a walk around a vertex asks for all of them.
    half_edges: Vec<HalfEdge>,
    /// A half-edge of each edge; [`NONE`] once the edge is gone.
    half_edge_of: Vec<u32>,
    /// A half-edge that starts at the vertex; on the border, the one that runs along it. [`NONE`] once the vertex is
    /// gone.
    first: Vec<u32>,
    border: Vec<bool>,
    triangle_count: usize,
}

impl HalfEdges {
    /// Builds the structure. `None` if the triangles are not an oriented manifold, in which every vertex has one fan.
    pub fn new(triangles: &[[u32; 3]], vertex_count: usize) -> Option<Self> {
        let opposite = Adjacency::new(triangles, vertex_count).opposite;
        let mut half_edges: Vec<HalfEdge> = triangles
            .as_flattened()
            .iter()
            .zip(opposite)
            .map(|(&origin, twin)| HalfEdge { origin, twin, edge: NONE })
            .collect();
        let mut first = vec![NONE; vertex_count];
        let mut border = vec![false; vertex_count];
        let mut half_edge_of = Vec::with_capacity(half_edges.len() / 2 + 1);
        for h in 0..half_edges.len() as u32 {
            let HalfEdge { origin, twin, .. } = half_edges[h as usize];
            let v = origin as usize;
            if twin == NONE {
                if border[v] {
                    return None;
                }
                border[v] = true;
                first[v] = h;
            } else if !border[v] {
                first[v] = h;
            }
            if twin > h {
                half_edges[h as usize].edge = half_edge_of.len() as u32;
                if twin != NONE {
                    half_edges[twin as usize].edge = half_edge_of.len() as u32;
                }
                half_edge_of.push(h);
            }
        }
        let mesh = Self { half_edges, half_edge_of, first, border, triangle_count: triangles.len() };
        // A vertex with two fans has half-edges that no fan reaches.
        let reached: usize = (0..vertex_count as u32).map(|v| mesh.fan(v).count()).sum();
        (reached == mesh.half_edges.len()).then_some(mesh)
    }

    pub fn edge_count(&self) -> usize {
        self.half_edge_of.len()
    }

    /// Number of triangles that remain.
    pub fn triangle_count(&self) -> usize {
        self.triangle_count
    }

    /// Corners of the triangles that remain, in the order of the input.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.slots().map(|(_, corners)| corners)
    }

    /// The places in the input of the triangles that remain, in order. One that was made anew has the place of one that
    /// it replaces.
    pub fn remaining(&self) -> impl Iterator<Item = usize> + '_ {
        self.slots().map(|(slot, _)| slot)
    }

    /// The triangles that remain, by their places in the input.
    fn slots(&self) -> impl Iterator<Item = (usize, [u32; 3])> + '_ {
        let triangles = self.half_edges.as_chunks::<3>().0.iter().map(|sides| sides.map(|side| side.origin));
        triangles.enumerate().filter(|(_, corners)| corners[0] != NONE)
    }

    pub fn is_alive(&self, vertex: u32) -> bool {
        self.first[vertex as usize] != NONE
    }

    pub fn is_border(&self, vertex: u32) -> bool {
        self.border[vertex as usize]
    }

    pub fn origin(&self, half_edge: u32) -> u32 {
        self.half_edges[half_edge as usize].origin
    }

    pub fn target(&self, half_edge: u32) -> u32 {
        self.origin(next(half_edge))
    }

    pub fn twin(&self, half_edge: u32) -> u32 {
        self.half_edges[half_edge as usize].twin
    }

    fn edge(&self, half_edge: u32) -> u32 {
        self.half_edges[half_edge as usize].edge
    }

    /// A half-edge of an edge (the only one, if the edge lies on the border); `None` once the edge is gone.
    pub fn half_edge(&self, edge: u32) -> Option<u32> {
        let h = self.half_edge_of[edge as usize];
        (h != NONE).then_some(h)
    }

    /// The half-edges that start at a vertex, counter-clockwise; for a border vertex, from border to border.
    pub fn fan(&self, vertex: u32) -> Fan<'_> {
        Fan { mesh: self, start: self.first[vertex as usize], current: self.first[vertex as usize] }
    }

    /// Collects the neighbours of a vertex, counter-clockwise.
    pub fn ring(&self, vertex: u32, ring: &mut Vec<u32>) {
        ring.clear();
        let mut last = NONE;
        for h in self.fan(vertex) {
            ring.push(self.target(h));
            last = h;
        }
        if last != NONE && self.border[vertex as usize] {
            ring.push(self.origin(previous(last)));
        }
    }

    /// Collects the edges of a vertex, counter-clockwise.
    pub fn edges(&self, vertex: u32, edges: &mut Vec<u32>) {
        edges.clear();
        let mut last = NONE;
        for h in self.fan(vertex) {
            edges.push(self.edge(h));
            last = h;
        }
        if last != NONE && self.border[vertex as usize] {
            edges.push(self.edge(previous(last)));
        }
    }

    /// A half-edge between two vertices: the one towards `a`, unless the edge is the first of `a`. It walks around both
    /// at the same time, because there may be as many triangles around one of them as there are in all.
    pub fn between(&self, a: u32, b: u32) -> Option<u32> {
        let first = self.fan(a).next()?;
        if self.target(first) == b {
            return Some(first);
        }
        let (mut around_a, mut around_b) = (self.fan(a), self.fan(b));
        loop {
            let h = around_a.next()?;
            if self.origin(previous(h)) == b {
                return Some(previous(h));
            }
            let h = around_b.next()?;
            if self.target(h) == a {
                return Some(h);
            }
            if self.origin(previous(h)) == a {
                // The other side is on the border only if the edge is the first of `a`.
                return Some(self.twin(previous(h))).filter(|&h| h != NONE);
            }
        }
    }

    /// The other end of a half-edge; none if it is gone or the vertex is no end of it.
    pub fn other_end(&self, half_edge: u32, vertex: u32) -> Option<u32> {
        if self.origin(half_edge) == NONE {
            return None;
        }
        match (self.origin(half_edge), self.target(half_edge)) {
            (from, to) if from == vertex => Some(to),
            (from, to) if to == vertex => Some(from),
            _ => None,
        }
    }

    /// Merges the vertex `removed` into the other end of `half_edge`. The link condition must hold.
    pub fn collapse(&mut self, half_edge: u32, removed: u32) {
        let (from, to) = (self.origin(half_edge), self.target(half_edge));
        let kept = if from == removed { to } else { from };
        let mut h = self.first[removed as usize];
        let start = h;
        while h != NONE {
            self.half_edges[h as usize].origin = kept;
            h = self.twin(previous(h));
            if h == start {
                break;
            }
        }
        let edge = self.edge(half_edge);
        self.half_edge_of[edge as usize] = NONE;
        let mut leaving_kept = NONE;
        for (side, starts_at_removed) in [(half_edge, from == removed), (self.twin(half_edge), from != removed)] {
            if side == NONE {
                continue;
            }
            let (n, p) = (next(side), previous(side));
            let apex = self.origin(p);
            let (after, before) = (self.twin(n), self.twin(p));
            let (mut keep, mut drop) = (self.edge(n), self.edge(p));
            if !starts_at_removed {
                std::mem::swap(&mut keep, &mut drop);
            }
            self.half_edge_of[drop as usize] = NONE;
            self.half_edge_of[keep as usize] = if after != NONE { after } else { before };
            for (one, other) in [(after, before), (before, after)] {
                if one != NONE {
                    let side = &mut self.half_edges[one as usize];
                    (side.twin, side.edge) = (other, keep);
                }
            }
            for dead in [side, n, p] {
                self.half_edges[dead as usize].origin = NONE;
            }
            self.triangle_count -= 1;
            if self.first[apex as usize] / 3 == side / 3 {
                self.set_first(apex, if after != NONE { after } else { next(before) });
            }
            leaving_kept = if before != NONE { before } else { next(after) };
        }
        self.first[removed as usize] = NONE;
        let first = self.first[kept as usize];
        if self.border[kept as usize] || self.origin(first) == NONE {
            self.set_first(kept, leaving_kept);
        }
    }

    /// Replaces an inner edge by the other diagonal of its two triangles. That diagonal must not exist yet.
    pub fn flip(&mut self, half_edge: u32) {
        let (h, t) = (half_edge, self.twin(half_edge));
        let (u, v) = (self.origin(h), self.origin(t));
        let (c, d) = (self.origin(previous(h)), self.origin(previous(t)));
        let outer = |g: u32| (self.twin(g), self.edge(g));
        let (vc, cu, ud, dv) = (outer(next(h)), outer(previous(h)), outer(next(t)), outer(previous(t)));
        self.half_edges[h as usize].origin = c;
        self.half_edges[t as usize].origin = d;
        for (g, from, (twin, edge)) in [(next(h), d, dv), (previous(h), v, vc), (next(t), c, cu), (previous(t), u, ud)]
        {
            self.half_edges[g as usize].origin = from;
            self.link(g, twin, edge);
        }
        for (vertex, leaving) in [(u, previous(t)), (v, previous(h)), (c, h), (d, t)] {
            self.set_first(vertex, leaving);
        }
    }

    /// Removes a border vertex and fills the polygon of its fan with `filling`: counter-clockwise triangles of indices
    /// into the vertex's [`ring`](Self::ring) that triangulate the polygon. None of its diagonals may exist yet, and
    /// the last vertex of the ring must not be connected to the first.
    pub fn replace_fan(&mut self, vertex: u32, filling: &[[usize; 3]]) {
        let mut ring = Vec::new();
        let mut spokes = Vec::new();
        self.ring(vertex, &mut ring);
        self.edges(vertex, &mut spokes);
        let before: Vec<u32> = ring.iter().map(|&v| self.first[v as usize]).collect();
        let fan: Vec<u32> = self.fan(vertex).collect();
        let outer: Vec<(u32, u32)> = fan.iter().map(|&h| (self.twin(next(h)), self.edge(next(h)))).collect();
        for &spoke in &spokes {
            self.half_edge_of[spoke as usize] = NONE;
        }
        for &h in &fan {
            let base = (h / 3 * 3) as usize;
            self.half_edges[base..base + 3].iter_mut().for_each(|side| side.origin = NONE);
        }
        self.first[vertex as usize] = NONE;
        self.triangle_count = self.triangle_count + filling.len() - fan.len();

        let mut free_edges = spokes.into_iter();
        // Diagonals that wait for their second triangle: (from, to, half-edge).
        let mut open: Vec<(usize, usize, u32)> = Vec::new();
        for (corners, &slot) in filling.iter().zip(&fan) {
            for k in 0..3 {
                let h = slot / 3 * 3 + k as u32;
                let (from, to) = (corners[k], corners[(k + 1) % 3]);
                self.half_edges[h as usize].origin = ring[from];
                if to == from + 1 {
                    let (twin, edge) = outer[from];
                    self.link(h, twin, edge);
                } else if let Some(found) = open.iter().position(|&(a, b, _)| (a, b) == (to, from)) {
                    let (_, _, twin) = open.swap_remove(found);
                    self.link(h, twin, self.edge(twin));
                } else {
                    // There are always enough: as many spokes as ring vertices, and two fewer new edges.
                    self.link(h, NONE, free_edges.next().unwrap_or(NONE));
                    open.push((from, to, h));
                }
                self.first[ring[from] as usize] = h;
            }
        }
        if filling.is_empty() {
            // An ear: the inner edge opposite the vertex becomes a border edge.
            let (twin, edge) = outer[0];
            self.link(twin, NONE, edge);
            self.first[ring[1] as usize] = twin;
            self.first[ring[0] as usize] = next(twin);
        }
        for (v, before) in ring.into_iter().zip(before) {
            let leaving = std::mem::replace(&mut self.first[v as usize], before);
            self.set_first(v, leaving);
        }
    }

    fn link(&mut self, half_edge: u32, twin: u32, edge: u32) {
        let side = &mut self.half_edges[half_edge as usize];
        (side.twin, side.edge) = (twin, edge);
        self.half_edge_of[edge as usize] = half_edge;
        if twin != NONE {
            let other = &mut self.half_edges[twin as usize];
            (other.twin, other.edge) = (half_edge, edge);
        }
    }

    /// Makes `leaving` the first half-edge of a vertex; on the border, the border half-edge that is found from it,
    /// unless the first one still is it: there is only one, and the way to it may be long.
    fn set_first(&mut self, vertex: u32, leaving: u32) {
        let mut h = leaving;
        if self.border[vertex as usize] {
            let first = self.first[vertex as usize];
            if first != NONE && self.origin(first) == vertex && self.twin(first) == NONE {
                return;
            }
            while self.twin(h) != NONE {
                h = next(self.twin(h));
            }
        }
        self.first[vertex as usize] = h;
    }
}

/// Iterator over the half-edges that start at a vertex; see [`HalfEdges::fan`].
pub(super) struct Fan<'a> {
    mesh: &'a HalfEdges,
    start: u32,
    current: u32,
}

impl Iterator for Fan<'_> {
    type Item = u32;

    fn next(&mut self) -> Option<u32> {
        let h = self.current;
        if h == NONE {
            return None;
        }
        self.current = self.mesh.twin(previous(h));
        if self.current == self.start {
            self.current = NONE;
        }
        Some(h)
    }
}
