//! Parts of which most is drawn as it is, up to the rounding of coordinates: in a scene of small parts that is nearly
//! all.
//!
//! A triangle whose vertices are those of a drawn one moves by at most as much as these do, and so does every point of
//! the drawn one. What is triangulated otherwise lies where it was, before its vertices moved ([`Flat`]). What is left
//! of both parts is bounded by itself: that holds whatever is near it, since it leaves out only what might be nearer.

use std::cell::OnceCell;

use glam::DVec3;

use super::bound::inflated;
use super::bvh::{Hint, TriangleBvh};
use super::closest::PreparedTriangle;
use super::flat::Flat;
use super::surface::Surface;
use super::{Bound, CertifyOptions, two_sided};
use lodpack_mesh::NONE;

/// If more than this share of the drawn triangles are others and not flat, a map of all is faster.
const MOST_CHANGED: f64 = 0.02;

/// The most vertices of which it is asked where else they were.
const MOST_OTHERS: usize = 16;

/// Two parts without a border, and how their vertices correspond.
pub(super) struct Corresponding<'a> {
    pub fine: Surface<'a>,
    pub coarse: Surface<'a>,
    /// Of each vertex of the coarser one which one of the finer it was; [`NONE`] if none.
    pub was: Vec<u32>,
}

impl Corresponding<'_> {
    /// Of each vertex of the coarser part which one of the finer it is, at a squared distance of at most `enough`, and
    /// the largest of these.
    fn same_vertices(&self, enough: f64) -> (Vec<u32>, f64) {
        let mut moved = 0.0f64;
        let mut is_at = |was: u32, position: &DVec3| {
            let square = self.fine.positions.get(was as usize).map_or(f64::INFINITY, |p| p.distance_squared(*position));
            let is_same = square <= enough;
            moved = if is_same { moved.max(square) } else { moved };
            is_same
        };
        let known = self.was.iter().zip(self.coarse.positions);
        let mut is: Vec<u32> = known.map(|(&was, position)| if is_at(was, position) { was } else { NONE }).collect();
        // Of two vertices that became one, it may lie where the other one was.
        let others: Vec<usize> = (0..is.len()).filter(|&v| is[v] == NONE).take(MOST_OTHERS + 1).collect();
        if (1..=MOST_OTHERS).contains(&others.len()) {
            let mut is_gone = vec![true; self.fine.positions.len()];
            is.iter().filter(|&&was| was != NONE).for_each(|&was| is_gone[was as usize] = false);
            for v in others {
                let position = &self.coarse.positions[v];
                let gone = (0..).zip(&is_gone).filter(|(_, is_gone)| **is_gone).map(|(was, _)| was);
                let distance = |was: u32| self.fine.positions[was as usize].distance_squared(*position);
                let nearest = gone.min_by(|&one, &other| distance(one).total_cmp(&distance(other)));
                if let Some(was) = nearest.filter(|&was| is_at(was, position)) {
                    is[v] = was;
                    is_gone[was as usize] = false;
                }
            }
        }
        (is, moved)
    }
}

/// What is drawn as it is.
pub(super) struct Unchanged {
    /// Of each vertex of the coarser part which one of the finer it is; [`NONE`] if none.
    is: Vec<u32>,
    /// The triangles of the coarser part that are not among the finer one's.
    changed: Vec<[u32; 3]>,
}

impl Unchanged {
    /// Which triangles of two parts are the same, and a bound of their distance; none if too few are. No vertex counts
    /// as the same that moves by more than `options` allow without a closer look.
    pub(super) fn new(parts: &Corresponding<'_>, options: &CertifyOptions) -> Option<(Self, Bound)> {
        let Corresponding { fine, coarse, .. } = parts;
        let enough = options.floor.max(options.target.unwrap_or(0.0)).max(options.lower);
        let (is, moved) = parts.same_vertices(enough * enough);
        let most = MOST_CHANGED * coarse.triangles.len() as f64;
        let is_other = |corners: &&[u32; 3]| corners.iter().any(|&v| is[v as usize] == NONE);
        if coarse.triangles.iter().filter(is_other).count() as f64 > most {
            return None;
        }
        let mut known: Vec<([u32; 3], usize)> =
            fine.triangles.iter().map(|&corners| from_least(corners)).zip(0..).collect();
        known.sort_unstable();
        let mut is_drawn = vec![false; known.len()];
        let mut changed = vec![];
        for corners in coarse.triangles {
            let own = corners.map(|v| is[v as usize]);
            let found = known.binary_search_by_key(&from_least(own), |&(corners, _)| corners);
            match found.ok().filter(|_| !own.contains(&NONE)) {
                Some(index) => is_drawn[known[index].1] = true,
                None => changed.push(*corners),
            }
        }
        let left = without(fine.triangles, &is_drawn);
        // Where the vertices of what changed were before they moved; new ones are where they are.
        let count = fine.positions.len() as u32;
        let was = |v: u32| if is[v as usize] == NONE { count + v } else { is[v as usize] };
        let place = |v: u32| match v.checked_sub(count) {
            Some(new) => coarse.positions[new as usize],
            None => fine.positions[v as usize],
        };
        let moved = moved.sqrt();
        let before: Vec<[u32; 3]> = changed.iter().map(|corners| corners.map(was)).collect();
        let flat = Flat::new([&left, &before], place, enough - moved);
        let [left, others] = [without(&left, &flat.is_flat[0]), without(&changed, &flat.is_flat[1])];
        if others.len() as f64 > most {
            return None;
        }
        let reach = |positions: &[DVec3]| positions.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        let far = moved + flat.height;
        let of_same = inflated(far * far, reach(fine.positions) + reach(coarse.positions));
        let mut bound = Bound { lower: 0.0, upper: of_same, worst: DVec3::ZERO, work: 0 };
        if !left.is_empty() || !others.is_empty() {
            let [left, others] =
                [(fine, &left), (coarse, &others)].map(|(all, some)| TriangleBvh::new(all.positions, some));
            let of_rest = two_sided(&left, &others, options);
            // What is left of one part may be nearer to what is not left of the other, so this distance need not occur.
            bound = Bound { upper: of_rest.upper.max(of_same), work: of_rest.work, ..bound };
        }
        Some((Self { is, changed }, bound))
    }

    /// Adds squared distances of some vertices of the finer part from the coarser one: from the triangles around the
    /// vertex that it is drawn as, or from those that are new.
    pub(super) fn squares(
        &self,
        [fine, coarse]: [Surface<'_>; 2],
        is_wanted: impl Fn(u32) -> bool,
        squares: &mut Vec<f64>,
    ) {
        let mut nearest = vec![f64::INFINITY; fine.positions.len()];
        for &corners in coarse.triangles {
            let wanted = corners.map(|v| Some(self.is[v as usize]).filter(|&is| is != NONE && is_wanted(is)));
            if wanted == [None; 3] {
                continue;
            }
            let triangle = PreparedTriangle::new(corners.map(|v| coarse.positions[v as usize]));
            for vertex in wanted.into_iter().flatten().map(|v| v as usize) {
                nearest[vertex] = nearest[vertex].min(triangle.distance_squared(fine.positions[vertex]));
            }
        }
        let (changed, mut hint) = (OnceCell::new(), Hint::default());
        for (v, &position) in (0..).zip(fine.positions).filter(|&(v, _)| is_wanted(v)) {
            let mut square = nearest[v as usize];
            if square.is_infinite() && !self.changed.is_empty() {
                let changed = changed.get_or_init(|| TriangleBvh::new(coarse.positions, &self.changed));
                let distance = changed.closest(position, &mut hint).distance;
                square = distance * distance;
            }
            if square.is_finite() {
                squares.push(square);
            }
        }
    }
}

/// The triangles that are not among those noted.
fn without(triangles: &[[u32; 3]], is_noted: &[bool]) -> Vec<[u32; 3]> {
    triangles.iter().zip(is_noted).filter(|(_, is_noted)| !**is_noted).map(|(&corners, _)| corners).collect()
}

/// The corners of a triangle in their order, beginning with the least.
fn from_least([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[cfg(test)]
mod tests {
    use super::super::flat::tests::{around, cap};
    use super::*;
    use crate::arcs::tests::sphere;
    use lodpack_mesh::Mesh;

    fn surface(mesh: &Mesh) -> Surface<'_> {
        Surface::new(&mesh.positions, &mesh.triangles)
    }

    fn options(floor: f64) -> CertifyOptions {
        CertifyOptions { floor, ..CertifyOptions::default() }
    }

    /// A sphere and the same one with a vertex moved by so much, with the vertices in reverse order.
    fn moved(by: f64) -> (Mesh, Mesh, Vec<u32>) {
        let fine = sphere(8);
        let last = fine.positions.len() as u32 - 1;
        let mut coarse = fine.clone();
        coarse.positions.reverse();
        coarse.positions[5] *= 1.0 + by;
        coarse.triangles.iter_mut().for_each(|corners| *corners = corners.map(|v| last - v));
        (fine, coarse, (0..=last).rev().collect())
    }

    fn bound(by: f64, floor: f64) -> (Vec<[u32; 3]>, Bound, f64) {
        let (fine, coarse, was) = moved(by);
        let parts = Corresponding { fine: surface(&fine), coarse: surface(&coarse), was };
        let (unchanged, bound) = Unchanged::new(&parts, &options(floor)).expect("hardly anything has changed");
        let mut squares = vec![];
        unchanged.squares([&fine, &coarse].map(surface), |v| v % 2 == 1, &mut squares);
        assert_eq!(squares.len(), fine.positions.len() / 2);
        let whole = two_sided(parts.fine.bvh(), parts.coarse.bvh(), &options(0.0));
        assert!(bound.upper >= whole.lower, "{bound:?} {whole:?}");
        (unchanged.changed, bound, squares.into_iter().fold(0.0, f64::max).sqrt())
    }

    #[test]
    fn what_moves_by_little_is_bounded_by_its_vertices() {
        let (changed, still, far) = bound(0.0, 0.1);
        assert!(changed.is_empty() && still.upper < 1e-12 && far < 1e-12, "{still:?}");
        let (changed, near, _) = bound(0.05, 0.1);
        assert!(changed.is_empty() && (0.05..0.050_001).contains(&near.upper), "{near:?}");
    }

    #[test]
    fn what_moves_far_is_compared_without_the_rest() {
        let (changed, far, _) = bound(0.2, 0.1);
        assert!((3..=8).contains(&changed.len()));
        assert!((0.1..0.22).contains(&far.upper), "{far:?}");
    }

    /// A prism with 24 sides whose caps are fans around their middles, and one whose caps are fans around a corner:
    /// that is where the middles have gone. Corners of the latter are moved by so much.
    fn prisms(by: f64) -> (Mesh, Mesh, Vec<u32>) {
        let (bottom, fan) = cap(24);
        let two =
            |points: &[DVec3]| [0.0, 3.0].iter().flat_map(|&z| points.iter().map(move |p| *p + DVec3::Z * z)).collect();
        let closed = |cap: &[[u32; 3]], next: u32| {
            let sides =
                (0..24).flat_map(|k| [[k, (k + 1) % 24, k + next], [(k + 1) % 24, (k + 1) % 24 + next, k + next]]);
            let caps = cap.iter().flat_map(|&[a, b, c]| [[a, c, b], [a + next, b + next, c + next]]);
            sides.chain(caps).collect::<Vec<[u32; 3]>>()
        };
        let fine = Mesh { positions: two(&bottom), triangles: closed(&fan, 25) };
        let mut coarse = Mesh { positions: two(&bottom[..24]), triangles: closed(&around(0, 24), 24) };
        coarse.positions.iter_mut().enumerate().for_each(|(v, p)| *p += DVec3::AXES[v % 3] * by);
        // Of a middle and the corner that it went to, the vertex is known as the middle.
        let was = (0..48).map(|v| if v % 24 == 0 { v / 24 * 25 + 24 } else { v / 24 * 25 + v % 24 }).collect();
        (fine, coarse, was)
    }

    #[test]
    fn caps_that_are_triangulated_otherwise_move_with_their_vertices() {
        let (fine, coarse, was) = prisms(0.01);
        let parts = Corresponding { fine: surface(&fine), coarse: surface(&coarse), was };
        let (unchanged, bound) = Unchanged::new(&parts, &options(0.02)).expect("all is flat or as it was");
        assert_eq!(unchanged.changed.len(), 44);
        assert!((0.01..0.010_001).contains(&bound.upper), "{bound:?}");
        let whole = two_sided(parts.fine.bvh(), parts.coarse.bvh(), &options(0.0));
        assert!(bound.upper >= whole.lower, "{bound:?} {whole:?}");
        let mut squares = vec![];
        unchanged.squares([&fine, &coarse].map(surface), |_| true, &mut squares);
        assert!(squares.len() == 50 && squares.iter().all(|square| square.sqrt() <= 0.01 + 1e-12), "{squares:?}");
        // Where less is allowed, much has changed.
        assert!(Unchanged::new(&parts, &options(0.005)).is_none());
    }

    #[test]
    fn parts_that_are_others_are_left_to_maps() {
        let (fine, coarse, was) = moved(0.0);
        let parts = Corresponding { fine: surface(&fine), coarse: surface(&coarse), was: vec![NONE; was.len()] };
        assert!(Unchanged::new(&parts, &options(1.0)).is_none());
    }
}
