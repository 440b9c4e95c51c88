//! Tiles in which triangles that are not mapped could have an image.
//!
//! The edges of these triangles do have images, on the ways from tile to tile. They are loops, which may be moved
//! within these tiles until only one thing about them matters: which edges between tiles they cross, modulo two. Call
//! every vertex of the coarser surface *enclosed* or not, such that exactly the crossed edges have one enclosed end,
//! and such that no vertex of the border or of an anchor is enclosed. The thirds of all tiles next to enclosed vertices
//! are then bounded by just those crossings. So the loops are a boundary within the tiles that they pass and the tiles
//! around enclosed vertices: there, the triangles could have an image (a chain of parts of tiles, counted modulo two).
//!
//! Which vertices are enclosed follows from tile to tile, beginning at the border and at anchors.

use super::Drape;
use super::tiles::edge_key;
use lodpack_mesh::{NONE, ordered};

impl Drape {
    /// The tiles, ascending, in which some triangles that are not mapped could be; all tiles if nothing better is
    /// known.
    pub(super) fn tiles_around(&self, slots: &[u32]) -> Vec<u32> {
        if slots.is_empty() {
            return vec![];
        }
        self.enclosed_tiles(slots).unwrap_or_else(|| (0..self.coarse.triangle_count() as u32).collect())
    }

    fn enclosed_tiles(&self, slots: &[u32]) -> Option<Vec<u32>> {
        let (mut tiles, mut crossed) = (vec![], vec![]);
        self.visit_ways(slots.iter().copied(), |way| {
            for pair in way.windows(2) {
                let [a, b] = self.tiles.edge_between(pair[0], pair[1])?;
                crossed.push(edge_key(a, b));
            }
            tiles.extend(way);
            Some(())
        })?;
        crossed.sort_unstable();
        let odd = crossed.chunk_by(|a, b| a == b).filter(|run| run.len() % 2 == 1);
        let crossed: Vec<u64> = odd.map(|run| run[0]).collect();
        if !crossed.is_empty() {
            let enclosed = self.enclosed_vertices(&crossed)?;
            let all = (0u32..).zip(&self.coarse.triangles);
            tiles
                .extend(all.filter(|(_, corners)| corners.iter().any(|&v| enclosed[v as usize])).map(|(tile, _)| tile));
        }
        tiles.sort_unstable();
        tiles.dedup();
        Some(tiles)
    }

    /// Visits the ways of the edges of some triangles of the finer surface. None if one has no way, or the visitor ends
    /// it.
    pub(super) fn visit_ways(
        &self,
        slots: impl Iterator<Item = u32>,
        mut visit: impl FnMut(&[u32]) -> Option<()>,
    ) -> Option<()> {
        let mut way = vec![];
        for slot in slots {
            let v = self.fine.triangles[slot as usize];
            for k in 0..3 {
                way.clear();
                if !self.way(ordered([v[k], v[(k + 1) % 3]]), &mut way) {
                    return None;
                }
                visit(&way)?;
            }
        }
        Some(())
    }

    /// For each vertex of the coarser surface, whether the crossed edges (ascending) enclose it; none if that is
    /// contradictory.
    fn enclosed_vertices(&self, crossed: &[u64]) -> Option<Vec<bool>> {
        let mut is_enclosed: Vec<Option<bool>> = vec![None; self.coarse.positions.len()];
        let anchors = self.anchors.iter().map(|&anchor| &self.coarse.triangles[anchor as usize]);
        for &v in self.border.iter().flatten().chain(anchors.flatten()) {
            is_enclosed[v as usize] = Some(false);
        }
        let at_border = |tile: &u32| self.tiles.across(*tile).contains(&NONE) || self.anchors.contains(tile);
        let mut queue: Vec<u32> = (0..self.coarse.triangle_count() as u32).filter(at_border).collect();
        let mut is_queued = vec![false; self.coarse.triangle_count()];
        queue.iter().for_each(|&tile| is_queued[tile as usize] = true);
        while let Some(tile) = queue.pop() {
            let corners = self.coarse.triangles[tile as usize];
            // Every tile is reached across an edge whose ends are decided. Going around twice checks all three edges.
            for k in [0, 1, 2, 0, 1, 2] {
                let [a, b] = [corners[k], corners[(k + 1) % 3]];
                let differ = crossed.binary_search(&edge_key(a, b)).is_ok();
                match (is_enclosed[a as usize], is_enclosed[b as usize]) {
                    (Some(a), Some(b)) if (a != b) != differ => return None,
                    (Some(a), None) => is_enclosed[b as usize] = Some(a != differ),
                    (None, Some(b)) => is_enclosed[a as usize] = Some(b != differ),
                    _ => {}
                }
            }
            for next in self.tiles.across(tile) {
                if next != NONE && !std::mem::replace(&mut is_queued[next as usize], true) {
                    queue.push(next);
                }
            }
        }
        is_enclosed.into_iter().collect()
    }
}
