//! The triangles of the coarser surface as tiles: their neighbours, and ways from tile to tile across edges.

use std::sync::Arc;

use super::super::bvh::TriangleBvh;
use lodpack_mesh::NONE;

/// Steps around a vertex before a way is looked for elsewhere.
const MAX_STEPS: usize = 32;
/// Tiles examined for a way between tiles without a common vertex.
const MAX_SEARCHED: usize = 256;
/// Places of a [`Seen`], several for each tile that can be in it.
const PLACES: usize = 1024;

/// The triangles of a surface, by slot, with their neighbours.
pub(super) struct Tiles {
    surface: Arc<TriangleBvh>,
    across: Vec<[u32; 3]>,
    /// The tiles of each component without a border.
    pub closed: Vec<Vec<u32>>,
}

/// A set of at most `MAX_SEARCHED + 3` tiles.
struct Seen([u32; PLACES]);

impl Seen {
    /// Adds a tile; false if it is there already.
    fn add(&mut self, tile: u32) -> bool {
        let mut place = tile.wrapping_mul(0x9e37_79b9) as usize / (1 << 22);
        while self.0[place] != NONE {
            if self.0[place] == tile {
                return false;
            }
            place = (place + 1) % PLACES;
        }
        self.0[place] = tile;
        true
    }
}

/// A key for an edge, the same in both directions.
pub(super) fn edge_key(a: u32, b: u32) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

impl Tiles {
    /// Finds neighbours, and the tile at each of the `border` edges. None unless the edges with one tile are exactly
    /// these, every other edge has two tiles of one winding, and no two tiles share two edges.
    pub(super) fn new(surface: &Arc<TriangleBvh>, border: &[[u32; 2]]) -> Option<(Self, Vec<u32>)> {
        let mut edges: Vec<(u64, u32)> = Vec::with_capacity(3 * surface.triangles.len());
        for (slot, corners) in (0u32..).zip(&surface.triangles) {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                edges.push((edge_key(a, b), slot << 3 | (k as u32) << 1 | u32::from(a < b)));
            }
        }
        edges.sort_unstable();
        let mut across = vec![[NONE; 3]; surface.triangles.len()];
        let mut single = 0;
        for run in edges.chunk_by(|a, b| a.0 == b.0) {
            match run {
                [_] => single += 1,
                [(_, a), (_, b)] if (a ^ b) & 1 == 1 => {
                    across[(a >> 3) as usize][(a >> 1 & 3) as usize] = b >> 3;
                    across[(b >> 3) as usize][(b >> 1 & 3) as usize] = a >> 3;
                }
                _ => return None,
            }
        }
        if single != border.len() {
            return None;
        }
        let mut at_border = Vec::with_capacity(border.len());
        let mut keys = Vec::with_capacity(border.len());
        for &[a, b] in border {
            let key = edge_key(a, b);
            let index = edges.partition_point(|edge| edge.0 < key);
            let &(_, entry) = edges.get(index).filter(|edge| edge.0 == key)?;
            if across[(entry >> 3) as usize][(entry >> 1 & 3) as usize] != NONE {
                return None;
            }
            at_border.push(entry >> 3);
            keys.push(key);
        }
        keys.sort_unstable();
        let twice = |[a, b, c]: &[u32; 3]| a == b && *a != NONE || b == c && *b != NONE || c == a && *c != NONE;
        if across.iter().any(twice) {
            return None;
        }
        if keys.windows(2).any(|pair| pair[0] == pair[1]) {
            return None;
        }
        let mut tiles = Self { surface: Arc::clone(surface), across, closed: vec![] };
        let mut reached = vec![false; tiles.across.len()];
        tiles.reach(&at_border, &mut reached);
        for tile in 0..reached.len() as u32 {
            if !reached[tile as usize] {
                let closed = tiles.reach(&[tile], &mut reached);
                tiles.closed.push(closed);
            }
        }
        Some((tiles, at_border))
    }

    /// The tiles that can be reached across edges from those in `starts` and have not been reached yet.
    fn reach(&self, starts: &[u32], reached: &mut [bool]) -> Vec<u32> {
        let mut stack = starts.to_vec();
        let mut found = vec![];
        while let Some(tile) = stack.pop() {
            if !std::mem::replace(&mut reached[tile as usize], true) {
                found.push(tile);
                stack.extend(self.across[tile as usize].iter().filter(|&&next| next != NONE));
            }
        }
        found
    }

    /// The tiles across the three edges; [`NONE`] at the border.
    #[inline(always)]
    pub(super) fn across(&self, tile: u32) -> [u32; 3] {
        self.across[tile as usize]
    }

    /// The ends of an edge.
    fn edge(&self, tile: u32, k: usize) -> [u32; 2] {
        let corners = self.surface.triangles[tile as usize];
        [corners[k], corners[(k + 1) % 3]]
    }

    /// The ends of the edge between two neighbours.
    pub(super) fn edge_between(&self, tile: u32, next: u32) -> Option<[u32; 2]> {
        self.across[tile as usize].iter().position(|&other| other == next).map(|k| self.edge(tile, k))
    }

    /// The first vertex that all of some tiles share.
    pub(super) fn shared_vertex(&self, tiles: &[u32]) -> Option<u32> {
        let corners = |tile: u32| self.surface.triangles[tile as usize];
        corners(*tiles.first()?).into_iter().find(|v| tiles.iter().all(|&tile| corners(tile).contains(v)))
    }

    /// The tile after this one around a vertex: forward across the edge that starts there, or backward.
    fn next_around(&self, tile: u32, vertex: u32, forward: bool) -> u32 {
        if tile == NONE {
            return NONE;
        }
        let corner = self.surface.triangles[tile as usize].iter().position(|&v| v == vertex);
        corner.map_or(NONE, |j| self.across[tile as usize][if forward { j } else { (j + 2) % 3 }])
    }

    /// Appends the tiles of a way from one tile to another, both included. The way is direct between neighbours, goes
    /// around a common vertex if there is one, and is otherwise a shortest one. False if none is found.
    pub(super) fn way(&self, from: u32, to: u32, found: &mut Vec<u32>) -> bool {
        found.push(from);
        if from == to {
            return true;
        }
        if self.across[from as usize].contains(&to) {
            found.push(to);
            return true;
        }
        let Some(vertex) = self.shared_vertex(&[from, to]) else { return self.shortest_way(from, to, found) };
        self.way_around(vertex, from, to, found) || self.shortest_way(from, to, found)
    }

    /// Appends the tiles around a vertex of two tiles from one to the other, the shorter way, without the first tile.
    /// Nothing is appended where the surface does not go on around the vertex.
    pub(super) fn way_around(&self, vertex: u32, from: u32, to: u32, found: &mut Vec<u32>) -> bool {
        self.turn(vertex, from, found, |tile| tile == to)
    }

    /// Appends the tiles around a vertex from a tile of it to the nearest one that is asked for, without the first
    /// tile.
    fn turn(&self, vertex: u32, from: u32, found: &mut Vec<u32>, is_end: impl Fn(u32) -> bool) -> bool {
        let Some((_, steps, forward)) = self.look_around(vertex, from, is_end) else { return false };
        let mut tile = from;
        for _ in 0..steps {
            tile = self.next_around(tile, vertex, forward);
            found.push(tile);
        }
        true
    }

    /// The nearest tile around a vertex that is asked for, from one of its tiles on; how many steps away it is, and
    /// whether forward.
    fn look_around(&self, vertex: u32, from: u32, is_it: impl Fn(u32) -> bool) -> Option<(u32, usize, bool)> {
        let is_it = |tile| tile != NONE && is_it(tile);
        let (mut forth, mut back) = (from, from);
        for steps in 0..=MAX_STEPS {
            if is_it(forth) {
                return Some((forth, steps, true));
            }
            if is_it(back) {
                return Some((back, steps, false));
            }
            forth = self.next_around(forth, vertex, true);
            back = self.next_around(back, vertex, false);
            if forth == NONE && back == NONE {
                break;
            }
        }
        None
    }

    /// For each vertex whether all of its tiles are reached around it, whichever one is the first.
    pub(super) fn plain_vertices(&self) -> Vec<bool> {
        let mut counts: Vec<(usize, u32)> = vec![(0, NONE); self.surface.positions.len()];
        for (tile, corners) in (0..).zip(&self.surface.triangles) {
            corners.iter().for_each(|&v| counts[v as usize] = (counts[v as usize].0 + 1, tile));
        }
        let is_plain = |(vertex, (count, tile)): (u32, (usize, u32))| {
            if count == 0 || count > MAX_STEPS {
                return false;
            }
            let mut reached = 1;
            for forward in [true, false] {
                let mut next = self.next_around(tile, vertex, forward);
                while next != NONE && next != tile && reached < count {
                    reached += 1;
                    next = self.next_around(next, vertex, forward);
                }
                if next == tile {
                    break;
                }
            }
            reached == count
        };
        (0..).zip(counts).map(is_plain).collect()
    }

    /// Whether a tile has a vertex.
    pub(super) fn has(&self, tile: u32, vertex: u32) -> bool {
        self.surface.triangles[tile as usize].contains(&vertex)
    }

    /// The nearest tile around a vertex that is asked for, from one of its tiles on.
    pub(super) fn find_around(&self, vertex: u32, from: u32, is_it: impl Fn(u32) -> bool) -> Option<u32> {
        self.look_around(vertex, from, is_it).map(|(tile, ..)| tile)
    }

    /// Appends the tiles around a vertex from a tile of it to the nearest one that has another vertex, too, without the
    /// first tile.
    pub(super) fn way_to_edge(&self, vertex: u32, from: u32, other: u32, found: &mut Vec<u32>) -> bool {
        self.turn(vertex, from, found, |tile| self.has(tile, other))
    }

    /// Appends the tiles of a way with the fewest edges, without the first tile.
    fn shortest_way(&self, from: u32, to: u32, found: &mut Vec<u32>) -> bool {
        // Breadth first, beyond the ways found so far: the tiles seen, and for each the place of the one before it.
        let start = found.len();
        let mut before = [0u16; MAX_SEARCHED + 3];
        let mut seen = Seen([NONE; PLACES]);
        seen.add(from);
        found.push(from);
        let mut at = start;
        let mut end = None;
        'search: while at < found.len() && found.len() - start < MAX_SEARCHED {
            for next in self.across[found[at] as usize] {
                if next != NONE && seen.add(next) {
                    before[found.len() - start] = (at - start) as u16;
                    found.push(next);
                    if next == to {
                        end = Some(found.len() - 1 - start);
                        break 'search;
                    }
                }
            }
            at += 1;
        }
        let Some(mut at) = end else {
            found.truncate(start);
            return false;
        };
        let mut way = [0u32; MAX_SEARCHED + 3];
        let mut length = 0;
        while at > 0 {
            way[length] = found[start + at];
            length += 1;
            at = usize::from(before[at]);
        }
        found.truncate(start);
        found.extend(way[..length].iter().rev());
        true
    }
}
