//! Steps that leave every triangle an area: rounded to the lattice, vertices may coincide or come to lie on one line,
//! and whoever reads such triangles again drops them and finds openings.

use crate::codec::{
    patch::LatticePoint,
    vector::{Vec3, cross, dot, sub, to_f64},
};

/// How many steps a vertex may be moved aside in each direction.
const REACH: i64 = 2;
/// How many places that makes in each direction.
const SIDE: i64 = 2 * REACH + 1;

/// The vertices of a target that have their places on the lattice.
pub(super) struct Placed<'a> {
    /// Wanted positions of the interior vertices.
    interior: &'a [Vec3],
    /// By vertex, the border first.
    points: Vec<Option<LatticePoint>>,
}

impl<'a> Placed<'a> {
    /// Only the border has its places.
    pub(super) fn new(loops: &[Vec<LatticePoint>], interior: &'a [Vec3]) -> Self {
        let border = loops.iter().flatten().copied().map(Some);
        let points = border.chain(interior.iter().map(|_| None)).collect();
        Self { interior, points }
    }

    /// Places a vertex by a residual; `around` it are the other two vertices of each of its triangles. It is the given
    /// residual, unless a triangle whose other vertices have their places had no area then. In that case it is the
    /// nearest one with which all have an area, and as few as possible are turned over. None if the given one leads
    /// nowhere.
    pub(super) fn place(
        &mut self,
        vertex: u32,
        around: impl Iterator<Item = [u32; 2]> + Clone,
        residual: [i64; 3],
        place: impl Fn([i64; 3]) -> Option<LatticePoint>,
    ) -> Option<([i64; 3], LatticePoint)> {
        let mut best = (residual, place(residual)?);
        if !self.keeps_areas(around.clone(), best.1) {
            let wanted = self.wanted(vertex);
            let mut least = (usize::MAX, f64::INFINITY);
            for i in 0..SIDE.pow(3) {
                let steps = [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE].map(|k| k - REACH);
                let moved = [0, 1, 2].map(|k| residual[k] + steps[k]);
                let Some(point) = place(moved).filter(|&point| self.keeps_areas(around.clone(), point)) else {
                    continue;
                };
                let off = sub(to_f64(point), wanted);
                let cost = (self.turned(vertex, around.clone(), point), dot(off, off));
                if cost < least {
                    (least, best) = (cost, (moved, point));
                }
            }
        }
        self.points[vertex as usize] = Some(best.1);
        Some(best)
    }

    /// Whether the vertex at `point` coincides with no neighbour, and all complete triangles around it have an area.
    fn keeps_areas(&self, mut around: impl Iterator<Item = [u32; 2]>, point: LatticePoint) -> bool {
        around.all(|[b, c]| match [b, c].map(|v| self.points[v as usize]) {
            [Some(b), Some(c)] => has_area(point, b, c),
            [Some(other), None] | [None, Some(other)] => other != point,
            [None, None] => true,
        })
    }

    /// How many complete triangles around the vertex are turned over if it is at `point`.
    fn turned(&self, vertex: u32, around: impl Iterator<Item = [u32; 2]>, point: LatticePoint) -> usize {
        let a = self.wanted(vertex);
        let is_turned = |&[b, c]: &[u32; 2]| {
            let [Some(to_b), Some(to_c)] = [b, c].map(|v| self.points[v as usize].map(to_f64)) else { return false };
            let point = to_f64(point);
            let wanted = cross(sub(self.wanted(b), a), sub(self.wanted(c), a));
            dot(wanted, cross(sub(to_b, point), sub(to_c, point))) < 0.0
        };
        around.filter(is_turned).count()
    }

    /// Where the target wants a vertex.
    fn wanted(&self, vertex: u32) -> Vec3 {
        let border = self.points.len() - self.interior.len();
        match (vertex as usize).checked_sub(border) {
            Some(inside) => self.interior[inside],
            None => self.points[vertex as usize].map_or([0.0; 3], to_f64),
        }
    }
}

/// Whether three points are not on one line; exact.
fn has_area(a: LatticePoint, b: LatticePoint, c: LatticePoint) -> bool {
    let [u, v] = [b, c].map(|p| [0, 1, 2].map(|k| i128::from(p[k]) - i128::from(a[k])));
    (0..3).any(|k| u[(k + 1) % 3] * v[(k + 2) % 3] != u[(k + 2) % 3] * v[(k + 1) % 3])
}
