//! Plates: neighbouring triangles that lie nearly in one plane and have a nearly convex outline, such as the cap of a
//! cylinder.
//!
//! Two triangulations of a cap cross each other many times, and each crossing would take a cut. A plate settles a
//! triangle beside it as one triangle would: by three distances.
//!
//! # Why the bound holds
//!
//! The outline is the boundary of all triangles of the plate together, modulo two, and one closed curve. Look at it
//! from above. Its corners on the convex hull come in the order of the hull, and between two of them it stays within
//! the *dent* of the hull's edge. So it can be moved onto the hull without leaving these strips, and every point of the
//! hull outside of them is enclosed an odd number of times, which means that a triangle lies over it. A point of a
//! strip has a point of the outline within the dent, since the outline passes along the whole edge. So every point of
//! the hull has a point of the plate within the dent beside it, at one of the plate's heights. A point's distance from
//! the hull, plus the dent, and the most that its height differs from one of these, are two sides of a right triangle
//! whose third side bounds its distance from the plate. All of this is convex, so over a triangle it is largest at a
//! corner.

use glam::{DVec2, DVec3};

use super::bvh::TriangleBvh;
use lodpack_mesh::{Adjacency, NONE};

/// Surfaces of more triangles get no plates: they are for small parts, of which there are many.
const MOST_TRIANGLES: usize = 512;
/// Fewer triangles are no plate.
const FEWEST: usize = 4;
/// The least cosine between normals of neighbours in a plate. Slivers of a quantised cap may be steep.
const ALIKE: f64 = 0.8;

/// The plates of a surface.
pub(super) struct Plates {
    /// For each slot the number of its plate, [`NONE`] for none.
    of_slot: Vec<u32>,
    plates: Vec<Plate>,
}

struct Plate {
    /// A point and three axes, the last one along the normal.
    origin: DVec3,
    axes: [DVec3; 3],
    /// The least and the largest height of a vertex.
    heights: [f64; 2],
    /// Corners of the hull, counter-clockwise.
    hull: Vec<DVec2>,
    dent: f64,
}

impl Plates {
    /// Finds plates no thicker than this. Positions are relative to the origin of the surface.
    pub fn new(surface: &TriangleBvh, thickness: f64) -> Self {
        let count = surface.triangles.len();
        let mut this = Self { of_slot: vec![NONE; count], plates: vec![] };
        if count > MOST_TRIANGLES {
            return this;
        }
        let positions: Vec<DVec3> = surface.positions.iter().map(|&p| p - surface.origin).collect();
        let doubled = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|v| positions[v as usize]);
            (b - a).cross(c - a)
        };
        let areas: Vec<DVec3> = surface.triangles.iter().map(doubled).collect();
        let Adjacency { opposite } = Adjacency::new(&surface.triangles, positions.len());
        let (across, _) = opposite.as_chunks::<3>();
        let mut is_taken = vec![false; count];
        for start in 0..count {
            if std::mem::replace(&mut is_taken[start], true) {
                continue;
            }
            let normal = areas[start].normalize_or_zero();
            let (mut slots, mut at) = (vec![start], 0);
            while let Some(&slot) = slots.get(at) {
                at += 1;
                for next in across[slot].into_iter().filter(|&next| next != NONE).map(|next| next as usize / 3) {
                    if !is_taken[next] && areas[next].dot(normal) > ALIKE * areas[next].length() {
                        is_taken[next] = true;
                        slots.push(next);
                    }
                }
            }
            if slots.len() < FEWEST {
                continue;
            }
            let sum: DVec3 = slots.iter().map(|&slot| areas[slot]).sum();
            // Most sets of triangles are bent: they are told from plates before anything is sorted.
            let up = sum.normalize_or_zero();
            let base = positions[surface.triangles[start][0] as usize];
            let mut heights = [0.0_f64; 2];
            for &v in slots.iter().flat_map(|&slot| &surface.triangles[slot]) {
                let height = (positions[v as usize] - base).dot(up);
                heights = [heights[0].min(height), heights[1].max(height)];
            }
            if heights[1] - heights[0] > thickness {
                continue;
            }
            let Some(outline) = outline(surface, across, &slots) else { continue };
            let outline: Vec<DVec3> = outline.into_iter().map(|v| positions[v as usize]).collect();
            let inside = slots.iter().flat_map(|&slot| surface.triangles[slot]).map(|v| positions[v as usize]);
            if let Some(plate) = Plate::new(sum, &outline, inside, thickness) {
                slots.iter().for_each(|&slot| this.of_slot[slot] = this.plates.len() as u32);
                this.plates.push(plate);
            }
        }
        this
    }

    /// Bounds the squared distance of a triangle from the plate with this slot, if there is one.
    pub fn bound(&self, slot: u32, corners: &[DVec3; 3]) -> Option<f64> {
        let plate = self.plates.get(self.of_slot[slot as usize] as usize)?;
        Some(corners.iter().map(|&corner| plate.distance_squared(corner)).fold(0.0, f64::max))
    }
}

impl Plate {
    /// None if the triangles are no plate. `doubled_area` is the sum of theirs, `vertices` are all of theirs.
    fn new(
        doubled_area: DVec3,
        outline: &[DVec3],
        vertices: impl Iterator<Item = DVec3>,
        thickness: f64,
    ) -> Option<Self> {
        let normal = doubled_area.try_normalize()?;
        let (right, up) = normal.any_orthonormal_pair();
        let mut this = Self {
            origin: outline[0],
            axes: [right, up, normal],
            heights: [f64::INFINITY, f64::NEG_INFINITY],
            hull: vec![],
            dent: 0.0,
        };
        for vertex in vertices {
            let (_, height) = this.place(vertex);
            this.heights = [this.heights[0].min(height), this.heights[1].max(height)];
        }
        let flat: Vec<DVec2> = outline.iter().map(|&p| this.place(p).0).collect();
        let mut hull = convex_hull(&flat);
        // In the order of the outline, from its first corner on.
        let first = (0..hull.len()).min_by_key(|&i| hull[i])?;
        hull.rotate_left(first);
        if hull.len() < 3 || !hull.is_sorted() || this.heights[1] - this.heights[0] > thickness {
            return None;
        }
        for (i, &start) in hull.iter().enumerate() {
            let end = hull.get(i + 1).copied().unwrap_or(hull[0] + flat.len());
            let edge = [flat[start], flat[end % flat.len()]];
            for k in start + 1..end {
                this.dent = this.dent.max(distance_from_segment(flat[k % flat.len()], edge));
            }
        }
        this.hull = hull.into_iter().map(|i| flat[i]).collect();
        (this.dent <= thickness).then_some(this)
    }

    /// Where a point is seen from above, and its height.
    fn place(&self, point: DVec3) -> (DVec2, f64) {
        let [x, y, height] = self.axes.map(|axis| (point - self.origin).dot(axis));
        (DVec2::new(x, y), height)
    }

    fn distance_squared(&self, point: DVec3) -> f64 {
        let (place, height) = self.place(point);
        let count = self.hull.len();
        let edges = || (0..count).map(|i| [self.hull[i], self.hull[(i + 1) % count]]);
        let is_inside = edges().all(|[a, b]| (b - a).perp_dot(place - a) >= 0.0);
        let beside = match is_inside {
            true => 0.0,
            false => edges().map(|edge| distance_from_segment(place, edge)).fold(f64::INFINITY, f64::min),
        };
        let (beside, above) = (beside + self.dent, (height - self.heights[0]).max(self.heights[1] - height));
        beside * beside + above * above
    }
}

/// The vertices around some triangles, in order; none unless their boundary is one closed curve that passes each of its
/// vertices once. `across` has the half-edge on the other side of each edge.
fn outline(surface: &TriangleBvh, across: &[[u32; 3]], slots: &[usize]) -> Option<Vec<u32>> {
    let mut sorted = slots.to_vec();
    sorted.sort_unstable();
    let mut edges: Vec<[u32; 2]> = vec![];
    for &slot in slots {
        let corners = surface.triangles[slot];
        for k in 0..3 {
            let other = across[slot][k];
            if other == NONE || sorted.binary_search(&(other as usize / 3)).is_err() {
                edges.push([corners[k], corners[(k + 1) % 3]]);
            }
        }
    }
    edges.sort_unstable();
    if edges.windows(2).any(|pair| pair[0][0] == pair[1][0]) {
        return None;
    }
    let start = edges.first()?[0];
    let (mut outline, mut at) = (vec![], start);
    loop {
        outline.push(at);
        let next = edges.binary_search_by_key(&at, |edge| edge[0]).ok()?;
        at = edges[next][1];
        if at == start {
            break;
        }
        if outline.len() > edges.len() {
            return None;
        }
    }
    (outline.len() == edges.len()).then_some(outline)
}

/// The corners of the convex hull of some points, counter-clockwise (Andrew, "Another efficient algorithm for convex
/// hulls in two dimensions", 1979).
fn convex_hull(points: &[DVec2]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    let place = |i: usize| (points[i].x, points[i].y);
    order.sort_by(|&a, &b| place(a).0.total_cmp(&place(b).0).then(place(a).1.total_cmp(&place(b).1)).then(a.cmp(&b)));
    let half = |order: &mut dyn Iterator<Item = usize>| {
        let mut chain: Vec<usize> = vec![];
        for next in order {
            while let [.., a, b] = chain[..]
                && (points[b] - points[a]).perp_dot(points[next] - points[a]) <= 0.0
            {
                chain.pop();
            }
            chain.push(next);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut order.iter().copied());
    hull.extend(half(&mut order.iter().rev().copied()));
    hull
}

fn distance_from_segment(point: DVec2, [start, end]: [DVec2; 2]) -> f64 {
    let along = end - start;
    let share = (point - start).dot(along) / along.length_squared();
    // Not a number if the segment is a point.
    let nearest = if share > 0.0 { start + along * share.min(1.0) } else { start };
    point.distance(nearest)
}

#[cfg(test)]
mod tests {
    use super::super::{CertifyOptions, two_sided};
    use super::*;

    /// A prism of `count` sides and a height of 3, whose caps are fans around the corner `apex` of each, moved by what
    /// `moved` says.
    fn prism(count: u32, apex: u32, moved: impl Fn(u32) -> DVec3) -> TriangleBvh {
        // Corners of a circle without sines, which differ between machines.
        let corner = |i: u32| {
            let t = 2.0 * f64::from(i) / f64::from(count) - 1.0;
            let (t, side) = if t < 0.0 { (2.0 * t + 1.0, 1.0) } else { (1.0 - 2.0 * t, -1.0) };
            DVec2::new(-t, side * (1.0 - t * t).max(0.0).sqrt()).perp()
        };
        let positions: Vec<DVec3> =
            (0..2 * count).map(|i| corner(i % count).extend(3.0 * f64::from(i / count)) + moved(i)).collect();
        let mut triangles = vec![];
        for i in 0..count {
            let next = (i + 1) % count;
            triangles.extend([[i, i + count, next], [next, i + count, next + count]]);
            let [a, b, c] = [apex, (apex + i) % count, (apex + i + 1) % count];
            if i > 0 && i + 1 < count {
                triangles.extend([[a, b, c], [a + count, c + count, b + count]]);
            }
        }
        TriangleBvh::new(&positions, &triangles)
    }

    /// Small offsets in no order.
    fn jitter(seed: u32, size: f64) -> DVec3 {
        let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(12345);
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1 << 24) - 0.5
        };
        DVec3::new(next(), next(), next()) * size
    }

    #[test]
    fn caps_are_plates_and_sides_are_none() {
        let surface = prism(24, 0, |_| DVec3::ZERO);
        let plates = Plates::new(&surface, 1e-3);
        assert_eq!(plates.plates.len(), 2);
        assert_eq!(plates.of_slot.iter().filter(|&&plate| plate != NONE).count(), 44);
        // A cap with a corner that is pulled in has a dent; one with a corner that is lifted is too thick.
        let dented = prism(24, 0, |i| if i == 5 { jitter(1, 0.0) - DVec3::new(0.3, 0.3, 0.0) } else { DVec3::ZERO });
        assert!(Plates::new(&dented, 1e-3).plates.len() < 2);
        let lifted = prism(24, 0, |i| DVec3::Z * if i == 5 { 0.005 } else { 0.0 });
        assert_eq!(Plates::new(&lifted, 1e-3).plates.len(), 1);
    }

    #[test]
    fn plates_are_never_nearer_than_they_are() {
        for seed in 0..40 {
            let surface = prism(9 + seed % 20, seed % 5, |i| jitter(100 * seed + i, 0.05));
            let plates = Plates::new(&surface, 0.2);
            for slot in 0..surface.triangle_count() as u32 {
                for k in 0..8 {
                    let point = jitter(977 * seed + 31 * slot + k, 3.0) + DVec3::Z * f64::from(k % 4);
                    let Some(bound) = plates.bound(slot, &[point; 3]) else { continue };
                    let distance = surface.closest(point + surface.origin, &mut super::super::Hint::default()).distance;
                    assert!(distance <= bound.sqrt() + 1e-12, "{seed} {slot}: {distance} {bound}");
                }
            }
        }
    }

    #[test]
    fn other_triangulations_of_caps_take_little_work() {
        let [one, other] = [0, 7].map(|apex| prism(24, apex, |i| jitter(i + 1000 * apex, 0.002)));
        let options = CertifyOptions { floor: 0.02, ..CertifyOptions::default() };
        let bound = two_sided(&one, &other, &options);
        assert!(bound.upper <= 0.02 && bound.upper >= bound.lower, "{bound:?}");
        assert!(bound.work < 700, "{}", bound.work);
        let tight = two_sided(&one, &other, &CertifyOptions { relative_gap: 1e-3, ..CertifyOptions::default() });
        assert!(tight.lower <= bound.upper, "{tight:?} {bound:?}");
    }
}
