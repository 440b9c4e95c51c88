//! Bounds by laying the finer surface onto the coarser: a continuous map that moves no point far.
//!
//! Every vertex of the finer surface gets a *foot* on the coarser one, whose triangles are the *tiles* here; a border vertex
//! gets it on the border edge that stands for its stretch of border. A triangle whose feet lie in one tile is mapped to it
//! linearly. One that reaches over several tiles is divided where its edges pass over the edges between these (the two points
//! nearest to each other are matched), and, if the ways of its edges lead around a tile's vertex, at the point nearest to that; each part is mapped linearly
//! into one tile. (Where several such points of an edge coincide, the map stands for one with points a hair apart.) The length by which points move is convex on each part, so that it is largest at the parts' corners, and few
//! points have to be looked at.
//!
//! *What moves by at most t lies within t of the coarser surface. But it also covers it:* the map takes the border of one
//! surface once around the border of the other, so that, counted modulo two, the image of the whole surface is the whole
//! coarser surface (a relative 2-cycle of a connected surface with a border is none or all of it, and its boundary tells
//! which). So every point of the coarser surface is the image of some point, which is within the length of its move.
//!
//! Where a triangle moves by more than asked for, or is not mapped at all, it is left to branch and bound, and so are the
//! tiles that its image touches: all other tiles' points are covered by what moves little. Triangles that are not mapped need
//! some image within the tiles along their edges' ways (see `Unmapped`); where there may be none, all tiles are left over.

use glam::DVec3;

use super::bound::Search;
use super::tiles::Tiles;
use super::tree::Surface;
use super::{Bound, CertifyOptions};
use crate::mesh::NONE;

/// A border vertex of the finer surface, as the caller numbers vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeamVertex {
    /// Vertex of the finer surface.
    pub fine: u32,
    /// The border vertex of the coarser surface that stands for it, if there is one.
    pub coarse: Option<u32>,
}

/// All border loops of the finer surface. Between two vertices with a partner in the coarser surface, neighbours in its loop,
/// stands one border edge of that.
pub type Seam = Vec<Vec<SeamVertex>>;

/// This share of the triangles may stay unmapped before branch and bound alone is the better way, and so many anyway.
const UNMAPPED_SHARE: usize = 16;
const UNMAPPED_ANYWAY: usize = 16;

/// Where a vertex is laid: at the nearest point of a tile, or on the border.
#[derive(Clone, Copy, Debug)]
struct Foot {
    /// Squared distance from the vertex.
    square: f64,
    /// [`NONE`] until found.
    tile: u32,
    /// The tile's vertex that the foot is fixed to, or [`NONE`].
    anchor: u32,
}

/// How often vertices may get another foot so that their triangles lie in one tile.
const GATHERINGS: usize = 2;

/// Where a foot may not be moved to a nearer place.
const FREE: u32 = NONE;
const ON_BORDER: u32 = NONE - 1;

struct Drape<'a> {
    fine: &'a Surface,
    coarse: &'a Surface,
    tiles: Tiles<'a>,
    feet: Vec<Foot>,
    /// Vertices of the coarser surface relative to its origin.
    corners: Vec<DVec3>,
}

/// Bounds the Hausdorff distance as [`super::two_sided`] does; none where the finer surface cannot be laid onto the coarser.
/// Neither may be empty.
pub(super) fn two_sided(fine: &Surface, coarse: &Surface, seam: &Seam, options: &CertifyOptions) -> Option<Bound> {
    let mut forward = Search::new(fine, coarse, options);
    let mut drape = Drape::new(fine, coarse, seam, forward.points())?;
    drape.find_feet(forward.points());
    forward.seed();
    drape.improve_feet(&mut forward);

    let moves = drape.moves(forward.points(), forward.threshold());
    let unmapped = moves.iter().filter(|&&square| square == f64::INFINITY).count();
    if unmapped > UNMAPPED_ANYWAY + fine.triangle_count() / UNMAPPED_SHARE {
        return None;
    }
    let mut moved = 0.0f64;
    // What moves too far, with the square of how far.
    let mut far: Vec<(f64, u32)> = moves.into_iter().zip(0..).collect();
    // Both searches know of all distances that occur, so that fewer are too far.
    let mut settle = |far: &mut Vec<(f64, u32)>, threshold: f64| {
        far.retain(|&(square, _)| {
            let open = square > threshold;
            if !open {
                moved = moved.max(square);
            }
            open
        });
    };
    settle(&mut far, forward.threshold());
    let mut backward = Search::new(coarse, fine, options);
    if !far.is_empty() {
        backward.seed();
        forward.know(backward.lower());
        settle(&mut far, forward.threshold());
    }
    let forward = forward.run_on(far.iter().map(|&(_, slot)| slot));
    backward.know(forward.lower * forward.lower);
    settle(&mut far, backward.threshold());
    let touched = drape.touched(&far);
    let backward = backward.run_on(touched.into_iter());
    let bound = forward.or_worse(backward);
    Some(Bound { upper: bound.upper.max(Search::inflate(moved, fine, coarse)), ..bound })
}

impl<'a> Drape<'a> {
    /// Lays the border.
    fn new(fine: &'a Surface, coarse: &'a Surface, seam: &Seam, points: &[DVec3]) -> Option<Self> {
        let fine_vertex = |v: u32| fine.vertex_of.get(v as usize).copied().filter(|&v| v != NONE);
        let coarse_vertex = |v: u32| coarse.vertex_of.get(v as usize).copied().filter(|&v| v != NONE);
        // For every border edge of the coarser surface: its ends, and the vertices of the finer from its first to its second.
        let (mut edges, mut stretches): (Vec<[u32; 2]>, Vec<Vec<u32>>) = (vec![], vec![]);
        let mut border_sum = 0u64;
        for border in seam {
            let first = border.iter().position(|v| v.coarse.is_some())?;
            let mut start = coarse_vertex(border[first].coarse?)?;
            let mut stretch = vec![fine_vertex(border[first].fine)?];
            for vertex in border[first + 1..].iter().chain(&border[..=first]) {
                let last = stretch[stretch.len() - 1];
                stretch.push(fine_vertex(vertex.fine)?);
                border_sum ^= edge_hash(last, stretch[stretch.len() - 1]);
                if let Some(end) = vertex.coarse {
                    let end = coarse_vertex(end)?;
                    edges.push([start, end]);
                    stretches.push(std::mem::replace(&mut stretch, vec![fine_vertex(vertex.fine)?]));
                    start = end;
                }
            }
        }
        // The seam has to be the whole border: every other edge has two triangles.
        let all = fine.triangles.iter().map(|&[a, b, c]| edge_hash(a, b) ^ edge_hash(b, c) ^ edge_hash(c, a));
        if all.fold(0, |sum, hash| sum ^ hash) != border_sum {
            return None;
        }

        let (tiles, at_border) = Tiles::new(coarse, &edges)?;
        let corners: Vec<DVec3> = coarse.positions.iter().map(|&p| p - coarse.origin).collect();
        let unknown = Foot { square: f64::INFINITY, tile: NONE, anchor: FREE };
        let mut feet = vec![unknown; points.len()];
        for ((edge, stretch), &tile) in edges.iter().zip(&stretches).zip(&at_border) {
            let [start, end] = edge.map(|v| corners[v as usize]);
            for (index, &v) in stretch[..stretch.len() - 1].iter().enumerate() {
                let at = points[v as usize];
                let (point, anchor) =
                    if index == 0 { (start, edge[0]) } else { (nearest_on_segment(at, start, end), ON_BORDER) };
                feet[v as usize] = Foot { square: at.distance_squared(point), tile, anchor };
            }
        }
        let drape = Self { fine, coarse, tiles, feet, corners };
        // The border has to stay on the border: ways from tile to tile pass through the vertex between two border edges.
        let mut way = vec![];
        for ((&[_, end], stretch), &tile) in edges.iter().zip(&stretches).zip(&at_border) {
            let next = drape.feet[stretch[stretch.len() - 1] as usize];
            for [from, to] in [[tile, next.tile], [next.tile, tile]] {
                way.clear();
                let found = drape.tiles.way(from, to, &mut way);
                let passes =
                    |pair: &[u32]| drape.tiles.edge_between(pair[0], pair[1]).is_some_and(|e| e.contains(&end));
                if !found || next.anchor != end || !way.windows(2).all(passes) {
                    return None;
                }
            }
        }
        Some(drape)
    }

    /// Finds a foot for every vertex that has none, going downhill from that of a neighbour.
    fn find_feet(&mut self, points: &[DVec3]) {
        let mut last = 0;
        for corners in &self.fine.triangles {
            for &v in corners {
                if self.feet[v as usize].tile != NONE {
                    last = self.feet[v as usize].tile;
                }
            }
            for &v in corners {
                if self.feet[v as usize].tile == NONE {
                    self.feet[v as usize] = self.walk(points[v as usize], last);
                    last = self.feet[v as usize].tile;
                }
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
                return Foot { square, tile, anchor: FREE };
            }
            before = here;
        }
    }

    /// Asks the tree about vertices that move far: either they are far indeed, or there is a better foot.
    fn improve_feet(&mut self, search: &mut Search) {
        let farthest = (0..self.feet.len()).max_by(|&a, &b| self.feet[a].square.total_cmp(&self.feet[b].square));
        for v in farthest.into_iter().chain(0..self.feet.len()) {
            if self.feet[v].square > search.threshold() {
                let (square, tile) = search.query_vertex_nearly(v as u32);
                if self.feet[v].anchor == FREE && square < self.feet[v].square {
                    self.feet[v] = Foot { square, tile, anchor: FREE };
                }
            }
        }
    }

    /// For each triangle the square of how far its points move at most; infinity where it is not mapped.
    fn moves(&mut self, points: &[DVec3], threshold: f64) -> Vec<f64> {
        let mut scratch = Scratch::default();
        let slots = 0..self.fine.triangle_count() as u32;
        let mut squares: Vec<f64> =
            slots.map(|slot| self.move_of(slot, points, &mut scratch).unwrap_or(f64::INFINITY)).collect();
        for _ in 0..GATHERINGS {
            let far: Vec<u32> = (0..).zip(&squares).filter(|(_, s)| **s > threshold).map(|(slot, _)| slot).collect();
            let mut changed = vec![false; if far.is_empty() { 0 } else { self.feet.len() }];
            let mut any = false;
            for slot in far {
                any |= self.gather(slot, points, threshold, &mut changed)
                    || squares[slot as usize] == f64::INFINITY
                        && self.straighten(slot, points, threshold, &mut changed, &mut scratch);
            }
            if !any {
                break;
            }
            for (slot, corners) in self.fine.triangles.iter().enumerate() {
                if corners.iter().any(|&v| changed[v as usize]) {
                    squares[slot] = self.move_of(slot as u32, points, &mut scratch).unwrap_or(f64::INFINITY);
                }
            }
        }
        squares
    }

    /// Lays a triangle into the nearest of its corners' tiles, if none of its points moves too far then.
    fn gather(&mut self, slot: u32, points: &[DVec3], threshold: f64, changed: &mut [bool]) -> bool {
        let v = self.fine.triangles[slot as usize];
        let tiles = v.map(|v| self.feet[v as usize].tile);
        if tiles[0] == tiles[1] && tiles[1] == tiles[2] {
            return false;
        }
        let mut best = (threshold, [0.0; 3], NONE);
        for tile in tiles {
            let squares = [0, 1, 2].map(|k| {
                let foot = &self.feet[v[k] as usize];
                match (foot.tile == tile, foot.anchor == FREE) {
                    (true, _) => foot.square,
                    (false, true) => self.coarse.distance_squared(points[v[k] as usize], tile),
                    (false, false) => f64::INFINITY,
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
                    (foot.square, foot.tile) = (squares[k], tile);
                    changed[v[k] as usize] = true;
                }
            }
        }
        tile != NONE
    }

    /// Looks for another foot of one corner near that of another, by which a triangle is mapped.
    fn straighten(
        &mut self,
        slot: u32,
        points: &[DVec3],
        threshold: f64,
        changed: &mut [bool],
        scratch: &mut Scratch,
    ) -> bool {
        let v = self.fine.triangles[slot as usize].map(|v| v as usize);
        for (moving, other) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
            let before = self.feet[v[moving]];
            let foot = self.walk(points[v[moving]], self.feet[v[other]].tile);
            if before.anchor != FREE || foot.tile == before.tile || foot.square > threshold {
                continue;
            }
            self.feet[v[moving]] = foot;
            if self.move_of(slot, points, scratch).is_some_and(|square| square <= threshold) {
                changed[v[moving]] = true;
                return true;
            }
            self.feet[v[moving]] = before;
        }
        false
    }

    /// The square of how far the points of a triangle move at most; none where it is not mapped.
    fn move_of(&self, slot: u32, points: &[DVec3], scratch: &mut Scratch) -> Option<f64> {
        let v = self.fine.triangles[slot as usize];
        let feet = v.map(|v| &self.feet[v as usize]);
        let mut square = feet[0].square.max(feet[1].square).max(feet[2].square);
        let tiles = feet.map(|foot| foot.tile);
        if tiles[0] == tiles[1] && tiles[1] == tiles[2] {
            return Some(square);
        }
        // The tiles around, and what is left of them when ways there and back are taken out.
        let Scratch { way, all, reduced } = scratch;
        all.clear();
        reduced.clear();
        reduced.push(tiles[0]);
        for k in 0..3 {
            let ends = ordered(v[k], v[(k + 1) % 3]);
            way.clear();
            if !self.tiles.way(self.feet[ends[0] as usize].tile, self.feet[ends[1] as usize].tile, way) {
                return None;
            }
            square = square.max(self.move_along(ends, way, points)?);
            if ends[0] != v[k] {
                way.reverse();
            }
            all.extend_from_slice(way);
            for &tile in &way[1..] {
                if reduced.len() > 1 && reduced[reduced.len() - 2] == tile {
                    reduced.pop();
                } else {
                    reduced.push(tile);
                }
            }
        }
        // If nothing is left, every crossing of an edge between tiles is matched by one of the same edge on another side of
        // the triangle, and the parts are strips between such pairs. Else all parts meet in one point.
        if reduced.len() > 1 {
            let target = self.corners[self.tiles.shared_vertex(all)? as usize];
            let shift = self.coarse.origin - self.fine.origin;
            let point = self.fine.closest_in(target + shift, slot) - shift;
            square = square.max(point.distance_squared(target));
        }
        Some(square)
    }

    /// The square of how far points of an edge move where it passes from tile to tile.
    fn move_along(&self, ends: [u32; 2], way: &[u32], points: &[DVec3]) -> Option<f64> {
        let feet = ends.map(|v| &self.feet[v as usize]);
        let ends = ends.map(|v| points[v as usize]);
        let (mut share, mut square) = (0.0, 0.0f64);
        for pair in way.windows(2) {
            let edge = self.tiles.edge_between(pair[0], pair[1])?;
            // The edge of the finer surface passes through its end's own tile vertex.
            if share == 0.0 && edge.contains(&feet[0].anchor) {
                continue;
            }
            if edge.contains(&feet[1].anchor) {
                share = 1.0;
                continue;
            }
            let edge = edge.map(|v| self.corners[v as usize]);
            // Never backward along the edge.
            share = nearest_share(ends, edge).max(share);
            let point = ends[0].lerp(ends[1], share);
            square = square.max(point.distance_squared(nearest_on_segment(point, edge[0], edge[1])));
        }
        Some(square)
    }

    /// The tiles that the images of some triangles touch, ascending.
    fn touched(&self, far: &[(f64, u32)]) -> Vec<u32> {
        let mut all = vec![];
        let mut way = vec![];
        let mut groups: Vec<Unmapped> = vec![];
        for &(square, slot) in far {
            let v = self.fine.triangles[slot as usize];
            let mut group = Unmapped::default();
            for k in 0..3 {
                let [from, to] = ordered(v[k], v[(k + 1) % 3]).map(|v| self.feet[v as usize].tile);
                way.clear();
                if !self.tiles.way(from, to, &mut way) {
                    // Nothing is known about where the image would be.
                    return self.tiles.all();
                }
                group.tiles.extend_from_slice(&way);
                group.crossed.extend(way.windows(2).map(|pair| ordered(pair[0], pair[1])));
            }
            if square < f64::INFINITY {
                all.append(&mut group.tiles);
                continue;
            }
            // Groups that have a tile in common become one.
            group.tidy();
            let (touching, apart) = groups.drain(..).partition::<Vec<_>, _>(|other| other.touches(&group));
            groups = apart;
            for mut other in touching {
                group.tiles.append(&mut other.tiles);
                group.crossed.append(&mut other.crossed);
            }
            group.tidy();
            groups.push(group);
        }
        for mut group in groups {
            if !group.crossed.is_empty() && !self.tiles.is_simple(&group.tiles) {
                self.tiles.fill_holes(&mut group.tiles);
                if !self.tiles.is_simple(&group.tiles) {
                    return self.tiles.all();
                }
            }
            all.append(&mut group.tiles);
        }
        all.sort_unstable();
        all.dedup();
        all
    }
}

/// Triangles that are not mapped, with tiles in common from one to the next.
///
/// Together they have an image within the tiles of their edges' ways if the loops of these bound there: which they do if they
/// cross every edge between tiles an even number of times, or where the tiles have no hole.
#[derive(Default)]
struct Unmapped {
    tiles: Vec<u32>,
    /// Neighbouring tiles between which the ways cross an odd number of times.
    crossed: Vec<[u32; 2]>,
}

impl Unmapped {
    fn tidy(&mut self) {
        self.tiles.sort_unstable();
        self.tiles.dedup();
        self.crossed.sort_unstable();
        let odd = self.crossed.chunk_by(|a, b| a == b).filter(|run| run.len() % 2 == 1);
        self.crossed = odd.map(|run| run[0]).collect();
    }

    fn touches(&self, other: &Self) -> bool {
        self.tiles.iter().any(|tile| other.tiles.binary_search(tile).is_ok())
    }
}

/// The ends of an edge as both its triangles see them.
fn ordered(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Lists of tiles, kept for their memory.
#[derive(Default)]
struct Scratch {
    way: Vec<u32>,
    all: Vec<u32>,
    reduced: Vec<u32>,
}

/// A number for an edge that sums (modulo two) of other edges' numbers do not equal by chance.
fn edge_hash(a: u32, b: u32) -> u64 {
    let mut hash = (u64::from(a.min(b)) << 32 | u64::from(a.max(b))).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    hash = (hash ^ hash >> 32).wrapping_mul(0xd6e8_feb8_6659_fd93);
    hash ^ hash >> 32
}

fn nearest_on_segment(point: DVec3, start: DVec3, end: DVec3) -> DVec3 {
    let along = end - start;
    let share = (point - start).dot(along) / along.length_squared();
    // Not a number where the segment is a point.
    if share > 0.0 { start + along * share.min(1.0) } else { start }
}

/// The share along the first segment at which it is nearest to the second (Ericson, Real-Time Collision Detection 5.1.9).
fn nearest_share(first: [DVec3; 2], second: [DVec3; 2]) -> f64 {
    let (d1, d2, r) = (first[1] - first[0], second[1] - second[0], first[0] - second[0]);
    let (a, e, f) = (d1.length_squared(), d2.length_squared(), d2.dot(r));
    let (b, c) = (d1.dot(d2), d1.dot(r));
    // Where numbers are not finite (segments that are points, parallels) any share is right, if not the best.
    let within = |share: f64| if share > 0.0 { share.min(1.0) } else { 0.0 };
    let share = within((b * f - c * e) / (a * e - b * b));
    let other = (b * share + f) / e;
    if other < 0.0 {
        within(-c / a)
    } else if other > 1.0 {
        within((b - c) / a)
    } else {
        share
    }
}
