//! Edge collapse in the order of quadric error, under the rules of the border.
//!
//! Invariants after every step: the mesh is an oriented manifold without double edges or triangles, its Euler
//! characteristic and number of loops are unchanged, and no border vertex has moved.

use glam::DVec3;

use super::SimplifyOptions;
use super::half_edges::HalfEdges;
use super::quadric::Quadric;
use super::queue::{EdgeQueue, rank};
use crate::areas::Areas;
use crate::chart::FREE;
use lodpack_mesh::NONE;

/// The level of a vertex that is not on the border.
const INTERIOR: u16 = u16::MAX;

/// How strongly a minimum is drawn towards the edge's midpoint, relative to the trace of the quadric. Directions in
/// which the normals vary by less than about its square root (2 degrees) stay undetermined.
const DAMPING: f64 = 1e-4;

/// Weight of the squared edge length in the order of collapses, but not in the error. In flat regions, where every
/// error is zero, the shortest edges go first, which keeps triangles well-shaped.
const LENGTH_WEIGHT: f64 = 1e-5;

/// How far a collapse may change the triangles around it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tolerated {
    /// Smallest cosine between a triangle's normals before and after.
    pub cosine: f64,
    /// Smallest quality of a triangle that gets worse (mean ratio; 1 for an equilateral triangle).
    pub quality: f64,
}

/// A vertex with more neighbours is a hub: rather than walk around it, the few neighbours of the other end of an edge
/// are asked whether they are beside it.
const MOST_NEIGHBOURS: usize = 64;

/// What takes a walk around a vertex with more triangles than these is left out, because as many changes beside it
/// would each take one: its edges are not considered again, and it is not moved aside.
pub(super) const MOST_AROUND: usize = 1024;

/// For collapses by choice. A stricter quality (0.1) blocks so many collapses on scans, which are full of slivers, that
/// the error at equal triangles is half as large again.
pub(super) const STRICT: Tolerated = Tolerated { cosine: 0.2, quality: 0.01 };
/// For border vertices that must go.
pub(super) const RELAXED: Tolerated = Tolerated { cosine: 0.0, quality: 0.001 };
/// The last resort: triangles may fold over or degenerate.
pub(super) const ANY_SHAPE: Tolerated = Tolerated { cosine: -1.0, quality: 0.0 };

impl Tolerated {
    /// Whether a triangle with the doubled area vector `before` and the given squared quality may become (a, b, c).
    pub fn allows(&self, before: DVec3, squared_quality_before: f64, a: DVec3, b: DVec3, c: DVec3) -> bool {
        if self.cosine <= -1.0 {
            return true;
        }
        let after = (b - a).cross(c - a);
        let (turn, scale) = (before.dot(after), before.length_squared() * after.length_squared());
        if turn <= 0.0 || turn * turn < self.cosine * self.cosine * scale {
            return false;
        }
        let quality = squared_quality(after, a, b, c);
        quality >= self.quality * self.quality || quality >= 0.5 * squared_quality_before
    }
}

/// Square of the mean ratio, 4 sqrt(3) area / sum of squared edge lengths. The length of `area_vector` is twice the
/// area.
pub(super) fn squared_quality(area_vector: DVec3, a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let sum = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if sum > 0.0 { 12.0 * area_vector.length_squared() / (sum * sum) } else { 0.0 }
}

/// A possible collapse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub half_edge: u32,
    pub removed: u32,
    pub kept: u32,
    /// Where the kept vertex will lie.
    pub target: DVec3,
    /// Rank in the order of collapses.
    cost: f64,
    /// Mean squared distance to the planes of all merged triangles.
    pub mean: f64,
    /// Whether the removed vertex may not stay at this level.
    forced: bool,
}

impl Candidate {
    /// Rank in the order of collapses: the quadric error plus a small share of the edge's length.
    pub fn cost(&self) -> f64 {
        self.cost
    }
}

/// For each border vertex that shares its position with others, the smallest of them; otherwise [`NONE`].
fn coinciding(positions: &[DVec3], level: &[u16]) -> Vec<u32> {
    let key = |v: u32| positions[v as usize].to_array().map(f64::to_bits);
    let mut border: Vec<u32> = (0..positions.len() as u32).filter(|&v| level[v as usize] != INTERIOR).collect();
    border.sort_unstable_by_key(|&v| (key(v), v));
    let mut twins = vec![NONE; positions.len()];
    for run in border.chunk_by(|&a, &b| key(a) == key(b)).filter(|run| run.len() > 1) {
        for &v in run {
            twins[v as usize] = run[0];
        }
    }
    twins
}

/// A chart while it is being simplified.
pub(super) struct Collapser<'a> {
    pub mesh: HalfEdges,
    pub positions: Vec<DVec3>,
    pub quadrics: Vec<Quadric>,
    /// The part of them that stays: lines that are to stay where they are. Empty where there are none.
    pub lines: Vec<Quadric>,
    /// The factor on the planes of each vertex: the largest of all that have been merged into it.
    pub importance: Vec<f32>,
    /// The areas of the triangles, if colours jump between some.
    pub areas: Option<Areas<'a>>,
    /// Level of each border vertex, or [`INTERIOR`].
    level: Vec<u16>,
    /// For each border vertex with which others coincide, the smallest of them; otherwise [`NONE`]. Such vertices are a
    /// corner that the chart touches in several fans: one vertex of the stitched mesh.
    twins: Vec<u32>,
    /// The level being made, and the largest mean squared distance that it allows.
    current_level: u16,
    threshold: f64,
    pub min_triangles: usize,
    /// See [`SimplifyOptions::stops`].
    pub stops: &'a [f64],
    /// Vertices around which border vertices were removed whatever that cost, since the last level.
    pub forced: Vec<u32>,
    queue: EdgeQueue,
    /// Vertices whose mark equals the generation are neighbours of the vertex in question.
    mark: Vec<u32>,
    generation: u32,
    /// The neighbours of the two vertices in question.
    rings: [Vec<u32>; 2],
    edges: Vec<u32>,
}

impl<'a> Collapser<'a> {
    /// `border` holds (vertex, level) of every border vertex of the mesh.
    pub fn new(
        mesh: HalfEdges,
        positions: Vec<DVec3>,
        border: impl Iterator<Item = (u32, u8)>,
        options: &SimplifyOptions<'a>,
    ) -> Self {
        let mut level = vec![INTERIOR; positions.len()];
        for (v, l) in border {
            level[v as usize] = u16::from(l);
        }
        let twins = coinciding(&positions, &level);
        let mut importance = options.importance.unwrap_or_default().to_vec();
        importance.resize(positions.len(), 1.0);
        let mut collapser = Self {
            twins,
            forced: vec![],
            queue: EdgeQueue::new(mesh.edge_count()),
            mark: vec![0; positions.len()],
            generation: 0,
            rings: Default::default(),
            edges: Vec::new(),
            current_level: INTERIOR,
            threshold: 0.0,
            mesh,
            positions,
            quadrics: vec![],
            lines: vec![],
            importance,
            areas: options.areas,
            level,
            min_triangles: options.min_triangles,
            stops: options.stops,
        };
        collapser.find_lines();
        collapser.renew_planes();
        collapser
    }

    /// Whether a border vertex may go or stay at any level.
    pub fn is_free(&self, vertex: u32) -> bool {
        self.level[vertex as usize] == u16::from(FREE)
    }

    /// Whether two vertices are one in the stitched mesh, where an edge between them would have no length.
    pub fn coincide(&self, a: u32, b: u32) -> bool {
        self.twins[a as usize] != NONE && self.twins[a as usize] == self.twins[b as usize]
    }

    /// Turns to the next coarser level and queues the collapses that it allows.
    pub fn begin_level(&mut self, level: u8, threshold: f64) {
        self.current_level = u16::from(level);
        self.threshold = threshold;
        for edge in 0..self.mesh.edge_count() as u32 {
            self.consider(edge);
        }
    }

    /// Whether a vertex lies on the border and may not stay there at the current level.
    pub fn must_go(&self, vertex: u32) -> bool {
        let level = self.level[vertex as usize];
        level != INTERIOR && level != u16::from(FREE) && level > self.current_level
    }

    /// Whether a border vertex may go at the current level.
    fn may_go(&self, vertex: u32) -> bool {
        self.is_free(vertex) || self.must_go(vertex)
    }

    /// Collapses the queued edges, cheapest first, until the queue is empty.
    pub fn drain(&mut self) {
        while let Some((old_rank, edge)) = self.queue.pop() {
            let Some(best) = self.evaluate(edge).filter(|c| self.is_eligible(c)) else { continue };
            let new_rank = rank(best.cost);
            if new_rank > old_rank && self.queue.top_rank().is_some_and(|top| new_rank > top) {
                self.queue.push(new_rank, edge);
                continue;
            }
            if !self.collapse(&best, STRICT) && self.mesh.is_border(best.removed) && self.may_go(best.kept) {
                let reverse = self.onto_border(best.half_edge, best.kept, best.removed);
                self.collapse(&reverse, STRICT);
            }
        }
    }

    /// Queues an edge that may now be collapsed, unless it is queued already.
    fn consider(&mut self, edge: u32) {
        if !self.queue.contains(edge)
            && let Some(best) = self.evaluate(edge)
            && self.is_eligible(&best)
        {
            self.queue.push(rank(best.cost), edge);
        }
    }

    /// Considers the edges of a vertex again after its surroundings have changed.
    pub fn consider_around(&mut self, vertex: u32) {
        if self.mesh.fan(vertex).nth(MOST_AROUND).is_some() {
            return;
        }
        let mut edges = std::mem::take(&mut self.edges);
        self.mesh.edges(vertex, &mut edges);
        for &edge in &edges {
            self.consider(edge);
        }
        self.edges = edges;
    }

    fn is_eligible(&self, candidate: &Candidate) -> bool {
        candidate.forced || candidate.mean <= self.threshold && self.mesh.triangle_count() > self.min_triangles
    }

    /// The better collapse of an edge; `None` if the edge is gone or its ends must stay apart.
    fn evaluate(&self, edge: u32) -> Option<Candidate> {
        let h = self.mesh.half_edge(edge)?;
        let (u, v) = (self.mesh.origin(h), self.mesh.target(h));
        match (self.mesh.is_border(u), self.mesh.is_border(v)) {
            (false, false) => Some(self.to_minimum(h, u, v)),
            (false, true) => Some(self.onto_border(h, u, v)),
            (true, false) => Some(self.onto_border(h, v, u)),
            // Collapsing a chord would pinch the chart.
            (true, true) if self.mesh.twin(h) != NONE => None,
            (true, true) => match (self.may_go(u), self.may_go(v)) {
                (false, false) => None,
                (true, false) => Some(self.onto_border(h, u, v)),
                (false, true) => Some(self.onto_border(h, v, u)),
                (true, true) => {
                    let (one, other) = (self.onto_border(h, u, v), self.onto_border(h, v, u));
                    Some(if one.cost <= other.cost { one } else { other })
                }
            },
        }
    }

    /// The collapse of two interior vertices, to the minimum of their common quadric.
    pub fn to_minimum(&self, half_edge: u32, removed: u32, kept: u32) -> Candidate {
        let (a, b) = (self.positions[removed as usize], self.positions[kept as usize]);
        let quadric = self.quadrics[removed as usize] + self.quadrics[kept as usize];
        let middle = 0.5 * (a + b);
        let length = a.distance_squared(b);
        let step = quadric.step_to_minimum(middle, DAMPING);
        let mut target = middle + step;
        let mut error = quadric.error(target);
        // A minimum far away comes from planes that are nearly parallel.
        if step.length_squared() > 4.0 * length {
            (target, error) = [middle, a, b]
                .map(|p| (p, quadric.error(p)))
                .into_iter()
                .reduce(|best, other| if other.1 < best.1 { other } else { best })
                .unwrap_or((target, error));
        }
        Candidate {
            half_edge,
            removed,
            kept,
            target,
            cost: error + LENGTH_WEIGHT * quadric.weight * length,
            mean: quadric.mean(error),
            forced: false,
        }
    }

    /// The collapse of any vertex into a border vertex, which does not move.
    pub fn onto_border(&self, half_edge: u32, removed: u32, kept: u32) -> Candidate {
        let target = self.positions[kept as usize];
        let (q, p) = (&self.quadrics[removed as usize], &self.quadrics[kept as usize]);
        let error = q.error(target) + p.error(target);
        let weight = q.weight + p.weight;
        let length = target.distance_squared(self.positions[removed as usize]);
        Candidate {
            half_edge,
            removed,
            kept,
            target,
            cost: error + LENGTH_WEIGHT * weight * length,
            mean: if weight > 0.0 { error / weight } else { 0.0 },
            forced: self.must_go(removed),
        }
    }

    /// The collapse of the interior vertex `removed` over one of its half-edges.
    pub fn inward(&self, half_edge: u32, removed: u32, kept: u32) -> Candidate {
        if self.mesh.is_border(kept) {
            self.onto_border(half_edge, removed, kept)
        } else {
            self.to_minimum(half_edge, removed, kept)
        }
    }

    /// Carries out a collapse, unless it would break the topology or exceed the tolerated change of shape.
    pub fn collapse(&mut self, candidate: &Candidate, tolerated: Tolerated) -> bool {
        let &Candidate { half_edge, removed, kept, target, .. } = candidate;
        let is_done = self.merge(half_edge, [removed, kept], target, Some(tolerated));
        if is_done {
            self.consider_around(kept);
        }
        is_done
    }

    /// Merges the vertex `removed` into the other one, unless that would break the topology or exceed the tolerated
    /// change of shape. Neither is checked where nothing is `tolerated`, for a collapse that was carried out before
    /// where all was the same.
    pub fn merge(
        &mut self,
        half_edge: u32,
        [removed, kept]: [u32; 2],
        target: DVec3,
        tolerated: Option<Tolerated>,
    ) -> bool {
        if let Some(tolerated) = tolerated
            && (!self.keeps_topology(half_edge, removed, kept) || !self.keeps_shape(removed, kept, target, tolerated))
        {
            return false;
        }
        self.mesh.collapse(half_edge, removed);
        self.positions[kept as usize] = target;
        self.merge_planes(removed, kept);
        true
    }

    /// Adds what a vertex stands for to another one.
    pub fn merge_planes(&mut self, removed: u32, kept: u32) {
        let [removed, kept] = [removed, kept].map(|v| v as usize);
        let quadric = self.quadrics[removed];
        self.quadrics[kept] += quadric;
        if let Some(&line) = self.lines.get(removed) {
            self.lines[kept] += line;
        }
        self.importance[kept] = self.importance[kept].max(self.importance[removed]);
    }

    /// The link condition (Dey et al., "Topology Preserving Edge Contraction", 1999): the only common neighbours of the
    /// ends are the apexes of the edge's triangles, and the mesh is more than a triangle or a tetrahedron.
    fn keeps_topology(&mut self, half_edge: u32, removed: u32, kept: u32) -> bool {
        let twin = self.mesh.twin(half_edge);
        let sides = if twin == NONE { 1 } else { 2 };
        let [removed_is_hub, kept_is_hub] = [removed, kept].map(|v| self.is_hub(v));
        if removed_is_hub != kept_is_hub {
            let (hub, other) = if kept_is_hub { (kept, removed) } else { (removed, kept) };
            self.mesh.ring(other, &mut self.rings[0]);
            let is_beside = |&&v: &&u32| v != hub && self.mesh.between(v, hub).is_some();
            if self.rings[0].iter().filter(is_beside).count() != sides {
                return false;
            }
        }
        self.generation += 1;
        let [of_removed, of_kept] = &mut self.rings;
        self.mesh.ring(removed, of_removed);
        self.mesh.ring(kept, of_kept);
        let (removed_valence, kept_valence) = (of_removed.len(), of_kept.len());
        of_removed.iter().for_each(|&v| self.mark[v as usize] = self.generation);
        let common = of_kept.iter().filter(|&&v| self.mark[v as usize] == self.generation).count();
        let meets_twin =
            self.twins[kept as usize] != NONE && self.rings[0].iter().any(|&v| v != kept && self.coincide(v, kept));
        let smallest = if sides == 1 { 2 } else { 3 };
        let border = self.mesh.is_border(removed) || self.mesh.is_border(kept);
        let is_smallest_mesh = removed_valence == smallest && kept_valence == smallest && (border == (sides == 1));
        common == sides && !is_smallest_mesh && !meets_twin
    }

    fn is_hub(&self, vertex: u32) -> bool {
        self.mesh.fan(vertex).nth(MOST_NEIGHBOURS).is_some()
    }

    /// Whether no triangle changes too much. The rings are those of both vertices.
    fn keeps_shape(&self, removed: u32, kept: u32, target: DVec3, tolerated: Tolerated) -> bool {
        for ((centre, other), ring) in [(removed, kept), (kept, removed)].into_iter().zip(&self.rings) {
            let from = self.positions[centre as usize];
            if centre == kept && from == target {
                continue;
            }
            let is_closed = !self.mesh.is_border(centre);
            let pairs = ring.windows(2).map(|pair| [pair[0], pair[1]]);
            let around = is_closed.then(|| [ring[ring.len() - 1], ring[0]]);
            for [x, y] in around.into_iter().chain(pairs) {
                if x == other || y == other {
                    continue;
                }
                let (x, y) = (self.positions[x as usize], self.positions[y as usize]);
                let before = (x - from).cross(y - from);
                if !tolerated.allows(before, squared_quality(before, from, x, y), target, x, y) {
                    return false;
                }
            }
        }
        true
    }
}
