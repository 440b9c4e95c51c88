//! Removes the border vertices that remain when a level's queue is empty, although they are not samples of its arcs.
//!
//! The remedies, in order of preference: collapse with less strict shapes; retriangulate the fan; move aside the
//! interior vertex beyond the new border edge; flip the chord that the new border edge would double; and finally all of
//! these without regard to shape, because a fold can be measured, while a wrong border is a crack.

use glam::DVec3;

use super::collapse::{ANY_SHAPE, Collapser, MOST_AROUND, RELAXED, STRICT, Tolerated, squared_quality};
use lodpack_mesh::{NONE, previous_half_edge};

/// The most interior vertices that are moved aside for one border vertex.
const MAX_OBSTACLES: usize = 12;

/// Larger polygons are not filled: finding the ears of one takes up to the cube of its corners.
const MOST_CORNERS: usize = 128;

impl Collapser<'_> {
    /// Removes as many of the given border vertices as it can. Returns whether it removed any.
    pub fn force_border(&mut self, remaining: &[u32]) -> bool {
        [RELAXED, ANY_SHAPE].into_iter().any(|tolerated| {
            let mut removed_any = false;
            for &vertex in remaining {
                if !self.mesh.is_alive(vertex) {
                    continue;
                }
                let mut ring = vec![];
                if tolerated == ANY_SHAPE {
                    self.mesh.ring(vertex, &mut ring);
                }
                if self.force_vertex(vertex, tolerated) {
                    removed_any = true;
                    self.forced.append(&mut ring);
                }
            }
            removed_any
        })
    }

    fn force_vertex(&mut self, vertex: u32, tolerated: Tolerated) -> bool {
        if self.remove_border_vertex(vertex, tolerated) {
            return true;
        }
        if tolerated == RELAXED {
            for _ in 0..MAX_OBSTACLES {
                if !self.clear_obstacle(vertex) {
                    break;
                }
                if self.remove_border_vertex(vertex, tolerated) {
                    return true;
                }
            }
        }
        self.flip_chord(vertex, tolerated) && self.remove_border_vertex(vertex, tolerated)
    }

    fn remove_border_vertex(&mut self, vertex: u32, tolerated: Tolerated) -> bool {
        self.collapse_along_border(vertex, tolerated) || self.retriangulate_fan(vertex, tolerated)
    }

    fn collapse_along_border(&mut self, vertex: u32, tolerated: Tolerated) -> bool {
        let mut fan = self.mesh.fan(vertex);
        let Some(forward) = fan.next() else { return false };
        let backward = previous_half_edge(fan.last().unwrap_or(forward));
        let mut ways = [(forward, self.mesh.target(forward)), (backward, self.mesh.origin(backward))]
            .map(|(h, kept)| self.onto_border(h, vertex, kept));
        if ways[1].cost() < ways[0].cost() {
            ways.swap(0, 1);
        }
        ways.iter().any(|way| self.collapse(way, tolerated))
    }

    /// Removes a border vertex and fills the polygon of its fan, if it finds a triangulation of tolerable triangles.
    fn retriangulate_fan(&mut self, vertex: u32, tolerated: Tolerated) -> bool {
        let mut ring = Vec::new();
        self.mesh.ring(vertex, &mut ring);
        if ring.len() > MOST_CORNERS {
            return false;
        }
        let last = ring.len() - 1;
        let connected = self.mesh.between(ring[0], ring[last]);
        let filling = if last == 1 {
            // An ear can go; a lone triangle must stay.
            if connected.is_none_or(|h| self.mesh.twin(h) == NONE) {
                return false;
            }
            Vec::new()
        } else {
            if connected.is_some() {
                return false;
            }
            let Some(filling) = self.clip_ears(vertex, &ring, tolerated) else { return false };
            filling
        };
        self.mesh.replace_fan(vertex, &filling);
        let p = self.positions[vertex as usize];
        let [to_next, to_previous] = [ring[0], ring[last]].map(|v| p.distance_squared(self.positions[v as usize]));
        self.merge_planes(vertex, if to_next <= to_previous { ring[0] } else { ring[last] });
        for v in ring {
            self.consider_around(v);
        }
        true
    }

    /// Triangulates the polygon of a fan, the best ear first, without edges that already exist elsewhere.
    fn clip_ears(&self, vertex: u32, ring: &[u32], tolerated: Tolerated) -> Option<Vec<[usize; 3]>> {
        let at = |i: usize| self.positions[ring[i] as usize];
        let normal = self.fan_normal(vertex).normalize_or_zero();
        let score = |polygon: &[usize], corners: [usize; 3]| -> Option<f64> {
            let [a, b, c] = corners.map(at);
            let [from, to] = [corners[0], corners[2]].map(|i| ring[i]);
            if polygon.len() > 3 && (self.mesh.between(from, to).is_some() || self.coincide(from, to)) {
                return None;
            }
            let area = (b - a).cross(c - a);
            let quality = squared_quality(area, a, b, c);
            let turn = normal.dot(area);
            if tolerated != ANY_SHAPE {
                let side = |from: DVec3, to: DVec3, p: DVec3| normal.dot((to - from).cross(p - from)) > 0.0;
                let covers = |p: DVec3| side(a, b, p) && side(b, c, p) && side(c, a, p);
                let covers_another = polygon.iter().any(|i| !corners.contains(i) && covers(at(*i)));
                if turn <= tolerated.cosine * area.length()
                    || quality < tolerated.quality * tolerated.quality
                    || covers_another
                {
                    return None;
                }
            }
            Some(if turn > 0.0 { quality } else { -1.0 })
        };
        let mut polygon: Vec<usize> = (0..ring.len()).collect();
        let mut filling = Vec::with_capacity(ring.len() - 2);
        while polygon.len() >= 3 {
            let n = polygon.len();
            let mut best: Option<(f64, usize)> = None;
            for i in 0..n {
                let corners = [polygon[(i + n - 1) % n], polygon[i], polygon[(i + 1) % n]];
                if let Some(score) = score(&polygon, corners)
                    && best.is_none_or(|(highest, _)| score > highest)
                {
                    best = Some((score, i));
                }
            }
            let (_, i) = best?;
            filling.push([polygon[(i + n - 1) % n], polygon[i], polygon[(i + 1) % n]]);
            polygon.remove(i);
        }
        Some(filling)
    }

    /// The sum of the doubled area vectors of a fan.
    fn fan_normal(&self, vertex: u32) -> DVec3 {
        let p = self.positions[vertex as usize];
        self.mesh.fan(vertex).fold(DVec3::ZERO, |sum, h| {
            let a = self.positions[self.mesh.target(h) as usize];
            let b = self.positions[self.mesh.origin(previous_half_edge(h)) as usize];
            sum + (a - p).cross(b - p)
        })
    }

    /// Collapses the interior neighbour that lies farthest beyond the border edge that will replace a border vertex.
    fn clear_obstacle(&mut self, vertex: u32) -> bool {
        let mut ring = Vec::new();
        self.mesh.ring(vertex, &mut ring);
        let [next, previous] = [ring[0], ring[ring.len() - 1]].map(|v| self.positions[v as usize]);
        let inwards = self.fan_normal(vertex).cross(next - previous);
        let mut obstacles: Vec<(f64, u32)> = ring
            .into_iter()
            .filter(|&v| !self.mesh.is_border(v))
            .map(|v| (inwards.dot(self.positions[v as usize] - previous), v))
            .collect();
        obstacles.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        obstacles.into_iter().any(|(_, obstacle)| self.collapse_anywhere(obstacle))
    }

    /// Collapses an interior vertex into whichever neighbour costs least, however much that is.
    fn collapse_anywhere(&mut self, vertex: u32) -> bool {
        if self.mesh.fan(vertex).nth(MOST_AROUND).is_some() {
            return false;
        }
        let mut ways: Vec<_> = self.mesh.fan(vertex).map(|h| self.inward(h, vertex, self.mesh.target(h))).collect();
        ways.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        [STRICT, RELAXED].into_iter().any(|tolerated| ways.iter().any(|way| self.collapse(way, tolerated)))
    }

    /// Flips the inner edge between the two border neighbours of a vertex, if there is one.
    fn flip_chord(&mut self, vertex: u32, tolerated: Tolerated) -> bool {
        let mut ring = Vec::new();
        self.mesh.ring(vertex, &mut ring);
        let Some(h) = self.mesh.between(ring[0], ring[ring.len() - 1]) else { return false };
        let t = self.mesh.twin(h);
        if t == NONE {
            return false;
        }
        let [u, v] = [h, t].map(|g| self.mesh.origin(g));
        let [c, d] = [h, t].map(|g| self.mesh.origin(previous_half_edge(g)));
        if c == vertex || d == vertex || self.mesh.between(c, d).is_some() || self.coincide(c, d) {
            return false;
        }
        let [pu, pv, pc, pd] = [u, v, c, d].map(|x| self.positions[x as usize]);
        let before = (pv - pu).cross(pc - pu) + (pu - pv).cross(pd - pv);
        if !tolerated.allows(before, f64::INFINITY, pd, pv, pc) || !tolerated.allows(before, f64::INFINITY, pu, pd, pc)
        {
            return false;
        }
        self.mesh.flip(h);
        for x in [u, v, c, d] {
            self.consider_around(x);
        }
        true
    }
}
