//! The triangles of the coarser surface as tiles: who lies across which edge, and ways from tile to tile.

use super::tree::Surface;
use crate::mesh::NONE;

/// Steps around a vertex after which a way counts as far.
const MAX_STEPS: i32 = 32;
/// Tiles looked at for a way between tiles that have no vertex in common.
const MAX_SEARCHED: usize = 512;

/// How to get from one tile to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Route {
    /// They are one.
    Stay,
    /// Across this edge of the first (edge `k` goes from corner `k` to the next), the only one that they share.
    Across(usize),
    /// Around the only vertex that they share; forward, leaving each tile by the edge that starts at the vertex, or backward.
    Around { vertex: u32, steps: i32 },
    /// None of these.
    Far,
}

/// Triangles of a surface (by slot) with their neighbours.
#[derive(Clone, Debug)]
pub(super) struct Tiles<'a> {
    surface: &'a Surface,
    across: Vec<[u32; 3]>,
}

/// An edge, whichever way it goes.
fn edge_key(a: u32, b: u32) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

impl<'a> Tiles<'a> {
    /// Finds neighbours, and the tile at each of the `border` edges. None unless those are exactly the edges with one tile,
    /// every other edge has two tiles of one winding, and every tile hangs together with a border edge through edges.
    pub(super) fn new(surface: &'a Surface, border: &[[u32; 2]]) -> Option<(Self, Vec<u32>)> {
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
        let tiles = Self { surface, across };
        (keys.windows(2).all(|pair| pair[0] != pair[1]) && tiles.hang_on(&at_border)).then_some((tiles, at_border))
    }

    /// Whether all tiles are reached through edges from some of them.
    fn hang_on(&self, starts: &[u32]) -> bool {
        let mut reached = vec![false; self.across.len()];
        let mut stack = starts.to_vec();
        let mut count = 0;
        while let Some(tile) = stack.pop() {
            if !std::mem::replace(&mut reached[tile as usize], true) {
                count += 1;
                stack.extend(self.across[tile as usize].iter().filter(|&&next| next != NONE));
            }
        }
        count == reached.len()
    }

    /// The tiles across the three edges, [`NONE`] at the border.
    #[inline(always)]
    pub(super) fn across(&self, tile: u32) -> [u32; 3] {
        self.across[tile as usize]
    }

    /// The ends of an edge.
    pub(super) fn edge(&self, tile: u32, k: usize) -> [u32; 2] {
        let corners = self.surface.triangles[tile as usize];
        [corners[k], corners[(k + 1) % 3]]
    }

    /// Which corner of a tile a vertex is.
    pub(super) fn corner(&self, tile: u32, vertex: u32) -> Option<usize> {
        self.surface.triangles[tile as usize].iter().position(|&v| v == vertex)
    }

    /// The edge by which a tile is left on the way around one of its vertices.
    pub(super) fn edge_around(&self, tile: u32, vertex: u32, forward: bool) -> Option<usize> {
        self.corner(tile, vertex).map(|j| if forward { j } else { (j + 2) % 3 })
    }

    fn next_around(&self, tile: u32, vertex: u32, forward: bool) -> u32 {
        if tile == NONE {
            return NONE;
        }
        self.edge_around(tile, vertex, forward).map_or(NONE, |k| self.across[tile as usize][k])
    }

    /// The way from one tile to another.
    pub(super) fn route(&self, from: u32, to: u32) -> Route {
        if from == to {
            return Route::Stay;
        }
        let others = self.surface.triangles[to as usize];
        let mut shared = self.surface.triangles[from as usize].into_iter().filter(|v| others.contains(v));
        match (shared.next(), shared.next(), shared.next()) {
            (Some(_), Some(_), None) => {
                let mut edges = (0..3).filter(|&k| self.across[from as usize][k] == to);
                match (edges.next(), edges.next()) {
                    (Some(k), None) => Route::Across(k),
                    _ => Route::Far,
                }
            }
            (Some(vertex), None, _) => {
                let (mut forth, mut back) = (from, from);
                for steps in 1..=MAX_STEPS {
                    forth = self.next_around(forth, vertex, true);
                    back = self.next_around(back, vertex, false);
                    if forth == to {
                        return Route::Around { vertex, steps };
                    }
                    if back == to {
                        return Route::Around { vertex, steps: -steps };
                    }
                    if forth == NONE && back == NONE {
                        break;
                    }
                }
                Route::Far
            }
            _ => Route::Far,
        }
    }

    /// Appends the tiles of a way, both ends among them. False where none is found.
    pub(super) fn tiles_along(&self, from: u32, to: u32, found: &mut Vec<u32>) -> bool {
        found.push(from);
        match self.route(from, to) {
            Route::Stay => {}
            Route::Across(_) => found.push(to),
            Route::Around { vertex, steps } => {
                let mut tile = from;
                for _ in 0..steps.abs() {
                    tile = self.next_around(tile, vertex, steps > 0);
                    found.push(tile);
                }
            }
            Route::Far => {
                // Breadth first; entries are tiles and the place of the entry before.
                let mut queue = vec![(from, 0)];
                let mut place = 0;
                while queue.get(place).is_some_and(|entry| entry.0 != to) && queue.len() < MAX_SEARCHED {
                    for next in self.across[queue[place].0 as usize] {
                        if next != NONE && !queue.iter().any(|entry| entry.0 == next) {
                            queue.push((next, place));
                        }
                    }
                    place += 1;
                }
                if queue.get(place).is_none_or(|entry| entry.0 != to) {
                    return false;
                }
                while place > 0 {
                    found.push(queue[place].0);
                    place = queue[place].1;
                }
            }
        }
        true
    }

    /// Whether every loop in a connected set of tiles (ascending, each once) bounds within it: its Euler characteristic is 1.
    /// (It holds no closed surface, since every tile hangs together with a border edge.)
    pub(super) fn is_simple(&self, tiles: &[u32]) -> bool {
        let (mut vertices, mut edges) = (vec![], vec![]);
        for &tile in tiles {
            for k in 0..3 {
                let [a, b] = self.edge(tile, k);
                vertices.push(a);
                edges.push(edge_key(a, b));
            }
        }
        vertices.sort_unstable();
        vertices.dedup();
        edges.sort_unstable();
        edges.dedup();
        vertices.len() + tiles.len() == edges.len() + 1
    }
}
