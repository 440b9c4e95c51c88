//! The stage **resample**: the solid that a closed surface bounds, drawn anew on a lattice of cells of a stated size.
//!
//! Edge collapse keeps every handle, so a closed surface of many handles cannot get below about fifty triangles per
//! handle. Sampled on a lattice, handles, cavities and parts thinner than a cell vanish, and what remains is simplified
//! further. A lattice point lies inside where the surface winds around it, so the surface may intersect itself; between
//! points inside and outside the new surface runs through the tetrahedra of the lattice (Doi and Koide, "An Efficient
//! Method of Triangulating Equi-Valued Surfaces by Using Tetrahedral Cells", 1991), which always gives a closed,
//! oriented manifold.
//!
//! Nothing here promises how far the result is from the surface: a certificate says that.

mod inside;
mod tetrahedra;

use glam::DVec3;

use crate::certify::{Hint, TriangleBvh};
use lodpack_mesh::Mesh;
use lodpack_mesh::union_find::count_components;

use inside::Inside;
use tetrahedra::{Crossing, triangulate};

/// Cells along the longest side of the box, at most: a lattice of 16 million points.
const MAX_CELLS: usize = 256;
/// A new vertex moves to the closest point of the surface where that is no farther than this share of a cell: farther
/// away lies what closes a handle, which has no surface to move to.
const SNAP: f64 = 0.75;
/// New vertices keep this share of a lattice edge from both of its ends.
const MARGIN: f64 = 0.05;

/// A lattice over a closed surface, with what lies inside it.
pub struct Solid<'a> {
    mesh: &'a Mesh,
    inside: Inside,
    /// The new surface: where its vertices lie, and its triangles.
    crossings: Vec<Crossing>,
    triangles: Vec<[u32; 3]>,
}

/// What the new surface would be like, before any distance is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Triangles before simplification.
    pub triangles: usize,
    /// Closed surfaces that do not touch.
    pub components: usize,
    /// Handles of all of them.
    pub handles: usize,
}

impl<'a> Solid<'a> {
    /// Finds what lies inside a closed surface, on a lattice of `cells` cells along the longest side of its box (2 to
    /// 256). None if the surface has no extent, or nothing lies inside.
    pub fn new(mesh: &'a Mesh, cells: usize) -> Option<Self> {
        let inside = Inside::new(mesh, cells.clamp(2, MAX_CELLS))?;
        let (crossings, triangles) = triangulate(&inside);
        Some(Self { mesh, inside, crossings, triangles })
    }

    /// What the surface of the solid is like.
    pub fn shape(&self) -> Shape {
        let Self { crossings, triangles, .. } = self;
        let components = count_components(crossings.len(), triangles);
        // Vertices - edges + triangles, with three half-edges a triangle.
        let characteristic = crossings.len() as i64 - (triangles.len() / 2) as i64;
        let handles = (components as i64 - characteristic / 2).max(0);
        Shape { triangles: triangles.len(), components, handles: handles as usize }
    }

    /// The surface of the solid: a closed, oriented manifold whose vertices lie on the original surface wherever that
    /// is near.
    pub fn surface(self) -> Mesh {
        let Self { ref crossings, mut triangles, .. } = self;
        let original = TriangleBvh::new(&self.mesh.positions, &self.mesh.triangles);
        let mut hint = Hint::default();
        let mut place = |crossing: &Crossing| {
            let [inner, outer] = crossing.ends.map(|node| self.inside.position(node));
            let [before, beyond] = [inner, outer].map(|p| original.closest(p, &mut hint).distance);
            let share = if before + beyond > 0.0 { before / (before + beyond) } else { 0.5 };
            let between: DVec3 = inner.lerp(outer, share.clamp(MARGIN, 1.0 - MARGIN));
            let closest = original.closest(between, &mut hint);
            if closest.distance <= SNAP * self.inside.cell() { closest.point } else { between }
        };
        let positions = crossings.iter().map(&mut place).collect();
        if self.inside.is_inside_out() {
            triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        Mesh { positions, triangles }
    }
}

#[cfg(test)]
mod tests;
