//! Undoes folds where border vertices were removed whatever that cost ([`super::forced`]): edges between two triangles
//! that lie on each other are flipped, and inner vertices beyond the border are moved to the middle of their
//! neighbours, as long as that leaves fewer of such edges.

use glam::DVec3;

use super::collapse::Collapser;
use lodpack_mesh::{NONE, previous_half_edge};

/// Two triangles lie on each other if the cosine of the angle between their normals is below this.
const FOLDED: f64 = -0.3;
/// How often all folds are looked at.
const ROUNDS: usize = 4;

impl Collapser<'_> {
    /// Undoes what folds it can around vertices at which the border was forced, which are forgotten.
    pub fn unfold(&mut self) {
        let mut vertices = std::mem::take(&mut self.forced);
        vertices.sort_unstable();
        vertices.dedup();
        let mut ring = vec![];
        for _ in 0..ROUNDS {
            let mut changed = vec![];
            for v in std::mem::take(&mut vertices) {
                if !self.mesh.is_alive(v) {
                    continue;
                }
                self.mesh.ring(v, &mut ring);
                for edge in ring.iter().map(|&other| [v, other]) {
                    let Some(h) = self.mesh.between(edge[0], edge[1]).filter(|&h| self.is_folded(h)) else { continue };
                    let ends = self.around(h);
                    if self.unfold_by_flip(h) || ends.into_iter().any(|end| self.unfold_by_move(end)) {
                        changed.extend(ends);
                    }
                }
            }
            changed.sort_unstable();
            changed.dedup();
            if changed.is_empty() {
                break;
            }
            vertices = changed;
        }
    }

    /// The ends of an inner edge, and the vertices opposite of it.
    fn around(&self, h: u32) -> [u32; 4] {
        let opposite = [h, self.mesh.twin(h)].map(|g| self.mesh.origin(previous_half_edge(g)));
        [self.mesh.origin(h), self.mesh.target(h), opposite[0], opposite[1]]
    }

    fn normal(&self, h: u32) -> DVec3 {
        let [a, b, c] = [self.mesh.origin(h), self.mesh.target(h), self.mesh.origin(previous_half_edge(h))]
            .map(|v| self.positions[v as usize]);
        (b - a).cross(c - a).normalize_or_zero()
    }

    fn is_folded(&self, h: u32) -> bool {
        let twin = self.mesh.twin(h);
        twin != NONE && self.normal(h).dot(self.normal(twin)) < FOLDED
    }

    /// How many folded edges leave some vertices; those between two of them count twice.
    fn folds_at(&self, vertices: &[u32]) -> usize {
        let folds = |&v: &u32| self.mesh.fan(v).filter(|&h| self.is_folded(h)).count();
        vertices.iter().map(folds).sum()
    }

    fn unfold_by_flip(&mut self, h: u32) -> bool {
        let ends = self.around(h);
        let [_, _, c, d] = ends;
        if c == d || self.mesh.between(c, d).is_some() || self.coincide(c, d) || self.jumps_at(h) {
            return false;
        }
        let before = self.folds_at(&ends);
        self.mesh.flip(h);
        if self.folds_at(&ends) < before {
            return true;
        }
        // The same two triangles again, each in the other's place.
        self.mesh.flip(h);
        false
    }

    /// Whether colours jump at an edge, which has to stay then.
    fn jumps_at(&self, h: u32) -> bool {
        self.areas.is_some_and(|areas| areas.jump(h as usize / 3, self.mesh.twin(h) as usize / 3))
    }

    fn unfold_by_move(&mut self, vertex: u32) -> bool {
        if self.mesh.is_border(vertex) {
            return false;
        }
        let mut star = vec![];
        self.mesh.ring(vertex, &mut star);
        let middle = star.iter().map(|&v| self.positions[v as usize]).sum::<DVec3>() / star.len().max(1) as f64;
        star.push(vertex);
        let before = self.folds_at(&star);
        let place = std::mem::replace(&mut self.positions[vertex as usize], middle);
        if self.folds_at(&star) < before {
            return true;
        }
        self.positions[vertex as usize] = place;
        false
    }
}
