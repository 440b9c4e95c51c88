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
    /// In a session with light: corners, each with a root that has it as a vertex.
    lit: SortedSet<(u32, u32)>,
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
        self.lit.extend(lit_corners(surface));
    }

    /// Notes that a root is drawn at another level from now on.
    pub fn replace(&mut self, before: &DrawnSurface, after: &DrawnSurface) {
        lit_corners(before).for_each(|corner| _ = self.lit.remove(&corner));
        self.lit.extend(lit_corners(after));
    }

    /// Removes a root that is no longer drawn.
    pub fn remove(&mut self, surface: &DrawnSurface) {
        for half_arc in surface.half_arcs() {
            if let Some(users) = self.arcs.get_mut(half_arc.arc as usize) {
                users.iter_mut().filter(|user| **user == surface.root).for_each(|user| *user = NONE);
            }
        }
        surface.raised_corners().iter().for_each(|corner| _ = self.corners.remove(&(corner.corner, surface.root)));
        lit_corners(surface).for_each(|corner| _ = self.lit.remove(&corner));
    }

    /// The roots beside an arc; numbers that no root has where there are fewer than two.
    pub fn beside(&self, arc: u32) -> [u32; 2] {
        self.arcs.get(arc as usize).copied().unwrap_or([NONE; 2])
    }

    /// In a session with light: the roots that have a corner as a vertex, ascending.
    pub fn at_corner(&self, corner: u32) -> impl Iterator<Item = u32> + '_ {
        self.lit.range((corner, 0)..=(corner, u32::MAX)).map(|&(_, root)| root)
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

/// The corners that a surface has as vertices, if it has light.
fn lit_corners(surface: &DrawnSurface) -> impl Iterator<Item = (u32, u32)> + '_ {
    surface.fans.iter().flat_map(|fans| fans.border_corners()).map(|corner| (corner, surface.root))
}
