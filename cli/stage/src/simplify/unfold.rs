//! Undoes folds where border vertices were removed whatever that cost ([`super::forced`]): edges between two triangles
//! that lie on each other are flipped, and inner vertices beyond the border are moved to the middle of their
//! neighbours, as long as that leaves fewer of such edges.

use glam::DVec3;

use super::collapse::Collapser;
use lodpack_mesh::{NONE, next_half_edge, previous_half_edge};

/// Two triangles lie on each other if the cosine of the angle between their normals is below this.
const FOLDED: f64 = -0.3;
/// How often all folds are looked at.
const ROUNDS: usize = 4;
/// The most neighbours of a vertex that is moved: whether that helps is asked for each fold beside it.
const MOST_NEIGHBOURS: usize = 128;

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

    /// How many edges of the two triangles at an inner edge are folded: a flip changes no others.
    fn folds_beside(&self, h: u32) -> usize {
        let twin = self.mesh.twin(h);
        let outer = [h, twin].map(|side| [next_half_edge(side), previous_half_edge(side)]);
        outer.as_flattened().iter().chain([&h]).filter(|&&edge| self.is_folded(edge)).count()
    }

    /// How many edges of the triangles around an inner vertex are folded: moving it changes no others.
    fn folds_around(&self, vertex: u32) -> usize {
        self.mesh.fan(vertex).flat_map(|h| [h, next_half_edge(h)]).filter(|&edge| self.is_folded(edge)).count()
    }

    fn unfold_by_flip(&mut self, h: u32) -> bool {
        let ends = self.around(h);
        let [_, _, c, d] = ends;
        if c == d || self.mesh.between(c, d).is_some() || self.coincide(c, d) || self.jumps_at(h) {
            return false;
        }
        let before = self.folds_beside(h);
        self.mesh.flip(h);
        if self.folds_beside(h) < before {
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
        if self.mesh.fan(vertex).nth(MOST_NEIGHBOURS).is_some() {
            return false;
        }
        let ring = || self.mesh.fan(vertex).map(|h| self.mesh.target(h));
        let middle = ring().map(|v| self.positions[v as usize]).sum::<DVec3>() / ring().count().max(1) as f64;
        let before = self.folds_around(vertex);
        let place = std::mem::replace(&mut self.positions[vertex as usize], middle);
        if self.folds_around(vertex) < before {
            return true;
        }
        self.positions[vertex as usize] = place;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::super::SimplifyOptions;
    use super::super::half_edges::HalfEdges;
    use super::*;

    /// Reproducible points in the cube -1..1.
    struct Random(u32);

    impl Random {
        fn point(&mut self) -> DVec3 {
            let mut next = || {
                self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                f64::from(self.0 >> 8) / f64::from(1 << 23) - 1.0
            };
            DVec3::new(next(), next(), next())
        }
    }

    /// A wavy grid of `n` by `n` vertices, many of whose edges are folded.
    fn folded(n: u32, random: &mut Random) -> (HalfEdges, Vec<DVec3>) {
        let place = |i: u32| f64::from(i) / f64::from(n);
        let positions = (0..n * n).map(|v| DVec3::new(place(v % n), place(v / n), 0.0) + 0.15 * random.point());
        let positions: Vec<DVec3> = positions.collect();
        let corners = (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| j * n + i));
        let triangles: Vec<[u32; 3]> = corners.flat_map(|a| [[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]).collect();
        (HalfEdges::new(&triangles, positions.len()).expect("a manifold"), positions)
    }

    /// How many folded edges leave some vertices; those between two of them count twice.
    fn folds_at(collapser: &Collapser, vertices: &[u32]) -> usize {
        let folds = |&v: &u32| collapser.mesh.fan(v).filter(|&h| collapser.is_folded(h)).count();
        vertices.iter().map(folds).sum()
    }

    #[test]
    fn the_edges_beside_a_change_decide_as_all_edges_of_its_vertices_do() {
        let mut random = Random(3);
        let (mesh, positions) = folded(12, &mut random);
        let mut collapser = Collapser::new(mesh, positions, std::iter::empty(), &SimplifyOptions::default());
        let (mut flips, mut moves) = (0, 0);
        for edge in 0..collapser.mesh.edge_count() as u32 {
            let h = collapser.mesh.half_edge(edge).expect("nothing is collapsed");
            if collapser.mesh.twin(h) == NONE {
                continue;
            }
            let ends = collapser.around(h);
            if collapser.mesh.between(ends[2], ends[3]).is_none() {
                let before = folds_at(&collapser, &ends);
                let changed = collapser.unfold_by_flip(h);
                let after = folds_at(&collapser, &ends);
                assert!(if changed { after < before } else { after == before });
                if !changed {
                    collapser.mesh.flip(h);
                    assert!(folds_at(&collapser, &ends) >= before);
                    collapser.mesh.flip(h);
                }
                flips += usize::from(changed);
            }
            for vertex in ends {
                let mut star = vec![];
                collapser.mesh.ring(vertex, &mut star);
                star.push(vertex);
                let before = folds_at(&collapser, &star);
                let changed = collapser.unfold_by_move(vertex);
                let after = folds_at(&collapser, &star);
                assert!(if changed { after < before } else { after == before });
                moves += usize::from(changed);
            }
        }
        assert!(flips > 10 && moves > 10, "{flips} {moves}");
    }

    #[test]
    fn an_edge_is_found_from_the_side_with_fewer_triangles_as_it_is_from_the_other() {
        let count = 300;
        let triangles: Vec<[u32; 3]> = (0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]).collect();
        let open = &triangles[..200];
        let grid = folded(7, &mut Random(5)).0;
        let hub = |triangles: &[[u32; 3]]| HalfEdges::new(triangles, count as usize + 1).expect("a manifold");
        for mesh in [grid, hub(&triangles), hub(open)] {
            let mut vertices: Vec<u32> = mesh.triangles().flatten().collect();
            vertices.sort_unstable();
            vertices.dedup();
            for (&a, &b) in vertices.iter().flat_map(|a| vertices.iter().map(move |b| (a, b))).filter(|(a, b)| a != b) {
                let slow = mesh.fan(a).find_map(|h| {
                    let back = previous_half_edge(h);
                    if mesh.target(h) == b { Some(h) } else { Some(back).filter(|&back| mesh.origin(back) == b) }
                });
                assert_eq!(mesh.between(a, b), slow, "{a} {b}");
            }
        }
    }
}
