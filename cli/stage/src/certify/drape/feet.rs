//! Feet: the points on the coarser surface onto which the vertices of the finer one are laid.

use std::sync::Arc;

use glam::DVec3;

use super::super::bound::Search;
use super::super::bvh::TriangleBvh;
use super::hold::Hold;
use super::parts::Parts;
use super::tiles::Tiles;
use super::{BorderPairing, Drape, nearest_on_segment};
use lodpack_mesh::NONE;

/// How often vertices may get another foot so that their triangles lie in one tile.
const GATHERINGS: usize = 2;

/// The foot of a vertex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// Squared distance from the vertex.
    pub square: f64,
    /// [`NONE`] until found.
    pub tile: u32,
    pub hold: Hold,
}

impl Drape {
    /// Lays the border: each stretch of it along its border edge, from end to end. None unless the pairing covers the
    /// whole border of both surfaces and passes every vertex once.
    pub(super) fn new(fine: &Arc<TriangleBvh>, coarse: &Arc<TriangleBvh>, pairing: &BorderPairing) -> Option<Self> {
        let fine_vertex = |v: u32| fine.vertex_of.get(v as usize).copied().filter(|&v| v != NONE);
        let coarse_vertex = |v: u32| coarse.vertex_of.get(v as usize).copied().filter(|&v| v != NONE);
        // For every border edge of the coarser surface: its ends, and the vertices of the finer one from the first end
        // to the second.
        let (mut border, mut stretches): (Vec<[u32; 2]>, Vec<Vec<u32>>) = (vec![], vec![]);
        let mut border_sum = 0u64;
        for ring in pairing {
            let first = ring.iter().position(|v| v.coarse.is_some())?;
            let mut start = coarse_vertex(ring[first].coarse?)?;
            let mut stretch = vec![fine_vertex(ring[first].fine)?];
            for vertex in ring[first + 1..].iter().chain(&ring[..=first]) {
                let last = stretch[stretch.len() - 1];
                stretch.push(fine_vertex(vertex.fine)?);
                border_sum ^= edge_hash(last, stretch[stretch.len() - 1]);
                if let Some(end) = vertex.coarse {
                    let end = coarse_vertex(end)?;
                    border.push([start, end]);
                    stretches.push(std::mem::replace(&mut stretch, vec![fine_vertex(vertex.fine)?]));
                    start = end;
                }
            }
        }
        // The edges of all triangles together, modulo two, are the border, and must be the paired border.
        let all = fine.triangles.iter().map(|&[a, b, c]| edge_hash(a, b) ^ edge_hash(b, c) ^ edge_hash(c, a));
        if all.fold(0, |sum, hash| sum ^ hash) != border_sum {
            return None;
        }

        let (tiles, at_border) = Tiles::new(coarse, &border)?;
        let points: Vec<DVec3> = fine.positions.iter().map(|&p| p - coarse.origin).collect();
        let corners: Vec<DVec3> = coarse.positions.iter().map(|&p| p - coarse.origin).collect();
        let unknown = Foot { square: f64::INFINITY, tile: NONE, hold: Hold::Free };
        let mut feet = vec![unknown; points.len()];
        for (((number, &ends), stretch), &tile) in (0..).zip(&border).zip(&stretches).zip(&at_border) {
            for (index, &v) in stretch[..stretch.len() - 1].iter().enumerate() {
                let hold = if index == 0 { Hold::Vertex(ends[0]) } else { Hold::Edge(number) };
                let [start, end] = ends.map(|v| corners[v as usize]);
                let at = points[v as usize];
                let point = if index == 0 { start } else { nearest_on_segment(at, start, end) };
                let foot = &mut feet[v as usize];
                if foot.tile != NONE {
                    return None;
                }
                *foot = Foot { square: at.distance_squared(point), tile, hold };
            }
        }
        let [fine, coarse] = [fine, coarse].map(Arc::clone);
        let drape = Self { fine, coarse, tiles, border, anchors: vec![], feet, points, corners };
        // The border must stay on the border: ways from tile to tile pass through the vertex between two border edges.
        let mut way = vec![];
        for ((&[_, end], stretch), &tile) in drape.border.iter().zip(&stretches).zip(&at_border) {
            let next = drape.feet[stretch[stretch.len() - 1] as usize];
            for [from, to] in [[tile, next.tile], [next.tile, tile]] {
                way.clear();
                let found = drape.tiles.way(from, to, &mut way);
                let passes =
                    |pair: &[u32]| drape.tiles.edge_between(pair[0], pair[1]).is_some_and(|e| e.contains(&end));
                if !found || next.hold != Hold::Vertex(end) || !way.windows(2).all(passes) {
                    return None;
                }
            }
        }
        Some(drape)
    }

    /// Finds a foot for every vertex that has none, by going downhill from that of a neighbour.
    pub(super) fn find_feet(&mut self) {
        // Where no border shows the way, the first vertex is near the right tile, and the others follow it.
        let mut last = match (self.border.is_empty(), self.fine.triangles.first()) {
            (true, Some(&[first, ..])) => {
                let square = |tile: u32| self.coarse.distance_squared(self.points[first as usize], tile);
                let tiles = 0..self.coarse.triangle_count() as u32;
                tiles.min_by(|&a, &b| square(a).total_cmp(&square(b))).unwrap_or(0)
            }
            _ => 0,
        };
        let fine = Arc::clone(&self.fine);
        for corners in &fine.triangles {
            for &v in corners {
                if self.feet[v as usize].tile != NONE {
                    last = self.feet[v as usize].tile;
                }
            }
            for &v in corners {
                if self.feet[v as usize].tile == NONE {
                    self.feet[v as usize] = self.walk(self.points[v as usize], last);
                    last = self.feet[v as usize].tile;
                }
            }
        }
    }

    /// Moves feet to a vertex of their tiles where that is within a threshold. Where the vertices of both surfaces are
    /// nearly the same, most triangles lie in one tile then, and their ways around vertices need not be followed.
    pub(super) fn snap_feet(&mut self, threshold: f64) {
        let is_plain = self.tiles.plain_vertices();
        for (foot, &at) in self.feet.iter_mut().zip(&self.points) {
            if foot.hold != Hold::Free || foot.tile == NONE {
                continue;
            }
            let corners = self.coarse.triangles[foot.tile as usize];
            let squares = corners.map(|corner| self.corners[corner as usize].distance_squared(at));
            let nearest = (0..3).min_by(|&a, &b| squares[a].total_cmp(&squares[b])).unwrap_or(0);
            if squares[nearest] <= threshold && is_plain[corners[nearest] as usize] {
                *foot = Foot { square: squares[nearest], hold: Hold::Corner(corners[nearest]), ..*foot };
            }
        }
    }

    fn walk(&self, at: DVec3, start: u32) -> Foot {
        let (mut tile, mut before) = (start, NONE);
        let mut square = self.coarse.distance_squared(at, tile);
        loop {
            let here = tile;
            for next in self.tiles.across(here) {
                if next != NONE && next != before {
                    let there = self.coarse.distance_squared(at, next);
                    if there < square {
                        (square, tile) = (there, next);
                    }
                }
            }
            if tile == here {
                return Foot { square, tile, hold: Hold::Free };
            }
            before = here;
        }
    }

    /// Asks the hierarchy about vertices that move far: either they really are far, or there is a better foot. Marks
    /// those that get one.
    pub(super) fn improve_feet(&mut self, search: &mut Search, changed: &mut [bool]) {
        let farthest = (0..self.feet.len()).max_by(|&a, &b| self.feet[a].square.total_cmp(&self.feet[b].square));
        for v in farthest.into_iter().chain(0..self.feet.len()) {
            if self.feet[v].square > search.threshold() {
                let (square, tile) = search.query_vertex_nearly(v as u32);
                if self.feet[v].hold.is_loose() && square < self.feet[v].square {
                    self.feet[v] = Foot { square, tile, hold: Hold::Free };
                    changed[v] = true;
                }
            }
        }
    }

    /// The position of a foot, relative to the origin of the coarser surface.
    pub(super) fn foot(&self, vertex: u32) -> DVec3 {
        let (foot, at) = (&self.feet[vertex as usize], self.points[vertex as usize]);
        match foot.hold {
            Hold::Free => self.coarse.closest_in(at, foot.tile),
            Hold::Vertex(corner) | Hold::Corner(corner) => self.corners[corner as usize],
            Hold::Edge(edge) => {
                let [start, end] = self.border[edge as usize].map(|v| self.corners[v as usize]);
                nearest_on_segment(at, start, end)
            }
        }
    }

    /// Brings `squares` up to date, where feet have changed: for each triangle the square of the most that its points
    /// move; infinity if it is not mapped. Feet may be moved for the sake of triangles that move by more than the
    /// threshold.
    pub(super) fn lay_all(&mut self, threshold: f64, squares: &mut [f64], mut changed: Vec<bool>) {
        let mut parts = Parts::default();
        for gatherings in 0..=GATHERINGS {
            for (slot, corners) in self.fine.triangles.iter().enumerate() {
                if corners.iter().any(|&v| changed[v as usize]) {
                    squares[slot] = self.lay(slot as u32, &mut parts, None).unwrap_or(f64::INFINITY);
                }
            }
            if gatherings == GATHERINGS {
                break;
            }
            changed.fill(false);
            let far: Vec<u32> = (0..).zip(&*squares).filter(|(_, s)| **s > threshold).map(|(slot, _)| slot).collect();
            let mut any = false;
            for slot in far {
                any |= self.gather(slot, threshold, &mut changed)
                    || squares[slot as usize] == f64::INFINITY
                        && self.straighten(slot, threshold, &mut changed, &mut parts);
            }
            if !any {
                break;
            }
        }
    }

    /// Lays a triangle into the nearest of its corners' tiles, unless one of its points would then move too far.
    fn gather(&mut self, slot: u32, threshold: f64, changed: &mut [bool]) -> bool {
        let v = self.fine.triangles[slot as usize];
        let tiles = v.map(|v| self.feet[v as usize].tile);
        if tiles[0] == tiles[1] && tiles[1] == tiles[2] {
            return false;
        }
        let mut best = (threshold, [0.0; 3], NONE);
        for tile in tiles {
            let squares = v.map(|v| {
                let foot = &self.feet[v as usize];
                match foot.hold {
                    _ if foot.tile == tile => foot.square,
                    Hold::Corner(corner) if self.tiles.has(tile, corner) => foot.square,
                    Hold::Free | Hold::Corner(_) => self.coarse.distance_squared(self.points[v as usize], tile),
                    Hold::Edge(_) | Hold::Vertex(_) => f64::INFINITY,
                }
            });
            let square = squares[0].max(squares[1]).max(squares[2]);
            if square < best.0 {
                best = (square, squares, tile);
            }
        }
        let (_, squares, tile) = best;
        if tile != NONE {
            for k in 0..3 {
                let foot = &mut self.feet[v[k] as usize];
                if foot.tile != tile {
                    let stays = matches!(foot.hold, Hold::Corner(corner) if self.tiles.has(tile, corner));
                    *foot = Foot { square: squares[k], tile, hold: if stays { foot.hold } else { Hold::Free } };
                    changed[v[k] as usize] = true;
                }
            }
        }
        tile != NONE
    }

    /// Looks for another foot of one corner, near that of another, with which the triangle is mapped.
    fn straighten(&mut self, slot: u32, threshold: f64, changed: &mut [bool], parts: &mut Parts) -> bool {
        let v = self.fine.triangles[slot as usize].map(|v| v as usize);
        for (moving, other) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
            let before = self.feet[v[moving]];
            let foot = self.walk(self.points[v[moving]], self.feet[v[other]].tile);
            if !before.hold.is_loose() || foot.tile == before.tile || foot.square > threshold {
                continue;
            }
            self.feet[v[moving]] = foot;
            if self.lay(slot, parts, None).is_some_and(|square| square <= threshold) {
                changed[v[moving]] = true;
                return true;
            }
            self.feet[v[moving]] = before;
        }
        false
    }
}

/// A number for an edge such that the sums (modulo two) of other edges' numbers do not equal it by chance.
fn edge_hash(a: u32, b: u32) -> u64 {
    let mut hash = (u64::from(a.min(b)) << 32 | u64::from(a.max(b))).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    hash = (hash ^ hash >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    hash ^ hash >> 32
}
