//! Tiles in which triangles that are not mapped could have an image.
//!
//! The edges of such a triangle do have images, on the ways from tile to tile. Triangles whose ways have tiles in common form
//! a group; together they have an image (a chain of parts of tiles, counted modulo two) within the group's tiles if the loops
//! of their edges bound there. Loops may be slid about within tiles without leaving them until nothing of them is left but
//! which edges between tiles they cross, modulo two; so they bound if they cross every edge an even number of times. And all
//! loops bound where the tiles have no holes.

use super::{Drape, ordered};

/// Triangles that are not mapped, with tiles in common from one to the next.
#[derive(Default)]
struct Group {
    /// Ascending, each once.
    tiles: Vec<u32>,
    /// Neighbouring tiles between which the ways cross an odd number of times.
    crossed: Vec<[u32; 2]>,
}

impl Group {
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

impl Drape<'_> {
    /// Tiles, ascending, in which some triangles that are not mapped could be.
    pub(super) fn tiles_around(&self, slots: &[u32]) -> Vec<u32> {
        let mut way = vec![];
        let mut groups: Vec<Group> = vec![];
        for &slot in slots {
            let v = self.fine.triangles[slot as usize];
            let mut group = Group::default();
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
        let mut all = vec![];
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
