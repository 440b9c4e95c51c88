//! Which drawn roots meet where: along arcs, and at corners that are not vertices at every level.

use super::drawn_surface::DrawnSurface;
use crate::sorted::SortedSet;

/// No root.
const NONE: u32 = u32::MAX;

/// The drawn roots beside each arc and around each corner.
#[derive(Clone, Debug, Default)]
pub(super) struct Users {
    /// By arc. No root is drawn together with one above it, so there are at most two.
    arcs: Vec<[u32; 2]>,
    /// Corners that are not vertices at every level, each with a root. Files without a tree have none.
    corners: SortedSet<(u32, u32)>,
}

impl Users {
    /// Adds a root that is drawn from now on.
    pub fn add(&mut self, surface: &DrawnSurface) {
        for half_arc in surface.half_arcs() {
            let arc = half_arc.arc as usize;
            if arc >= self.arcs.len() {
                self.arcs.resize(arc + 1, [NONE; 2]);
            }
            if let Some(free) = self.arcs[arc].iter_mut().find(|user| **user == NONE) {
                *free = surface.root;
            }
        }
        self.corners.extend(surface.raised_corners().iter().map(|corner| (corner.corner, surface.root)));
    }

    /// Removes a root that is no longer drawn.
    pub fn remove(&mut self, surface: &DrawnSurface) {
        for half_arc in surface.half_arcs() {
            if let Some(users) = self.arcs.get_mut(half_arc.arc as usize) {
                users.iter_mut().filter(|user| **user == surface.root).for_each(|user| *user = NONE);
            }
        }
        surface.raised_corners().iter().for_each(|corner| _ = self.corners.remove(&(corner.corner, surface.root)));
    }

    /// The other root beside an arc.
    pub fn across(&self, root: u32, arc: u32) -> Option<u32> {
        let users = self.arcs.get(arc as usize)?;
        users.iter().copied().find(|&user| user != NONE && user != root)
    }

    /// The roots around a corner that is not a vertex at every level.
    pub fn around(&self, corner: u32) -> impl Iterator<Item = u32> + '_ {
        self.corners.range((corner, 0)..=(corner, u32::MAX)).map(|&(_, root)| root)
    }
}
