//! The few triangles that may be closest to points which lie together: found once, they alone are looked at for each
//! point.

use glam::{DVec3, Vec4};

use super::{Closest, EMPTY, Hint, INNER, SLACK, STACK, STEADY, TriangleBvh};

/// The most triangles of an [`Around`].
pub const AROUND: usize = 24;

/// A few triangles among which the closest one is.
#[derive(Clone, Copy, Debug, Default)]
pub struct Around {
    slots: [u32; AROUND],
    count: usize,
}

impl Around {
    /// Says whether there was room for it.
    fn add(&mut self, slot: u32) -> bool {
        let Some(free) = self.slots.get_mut(self.count) else { return false };
        *free = slot;
        self.count += 1;
        true
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Where the triangles are.
    pub(super) fn slots(&self) -> &[u32] {
        &self.slots[..self.count]
    }
}

impl TriangleBvh {
    /// The triangles that may be closest to a point within a radius of one; none if there are too many.
    pub fn around(&self, point: DVec3, radius: f64, hint: &mut Hint) -> Option<Around> {
        let local = point - self.origin;
        let (square, slot) = self.nearest(local, hint.0, 0.0);
        hint.0 = slot;
        let farthest = square.sqrt() + radius / STEADY;
        let mut around = Around::default();
        let is_few = self.for_each_within(local, farthest * farthest, |slot| around.add(slot));
        (is_few && around.count > 0).then_some(around)
    }

    /// Those of some triangles that may be closest to a point within a radius of one, if one of them is.
    pub fn narrowed(&self, around: &Around, point: DVec3, radius: f64) -> Around {
        let local = point - self.origin;
        let mut squares = [f64::INFINITY; AROUND];
        for (square, &slot) in squares.iter_mut().zip(around.slots()) {
            *square = self.distance_squared(local, slot);
        }
        let squares = &squares[..around.count];
        let farthest = squares.iter().copied().fold(f64::INFINITY, f64::min).sqrt() + radius / STEADY;
        let mut narrowed = Around::default();
        for (&slot, _) in around.slots().iter().zip(squares).filter(|(_, square)| **square <= farthest * farthest) {
            narrowed.add(slot);
        }
        narrowed
    }

    /// As [`closest`](Self::closest), of some triangles alone.
    pub fn closest_of(&self, around: &Around, point: DVec3) -> Closest {
        let local = point - self.origin;
        let mut best = (f64::INFINITY, around.slots[0]);
        if around.count > 1 {
            for &slot in around.slots() {
                let square = self.distance_squared(local, slot);
                if square < best.0 {
                    best = (square, slot);
                }
            }
        }
        let closest = self.closest_in(local, best.1);
        let triangle = self.original[best.1 as usize];
        Closest { point: closest + self.origin, distance: closest.distance(local), triangle }
    }

    /// The numbers of some triangles.
    pub fn numbers(&self, around: &Around) -> impl Iterator<Item = u32> {
        around.slots.into_iter().take(around.count).filter_map(|slot| self.original.get(slot as usize).copied())
    }

    /// Calls a function for the slots of triangles within a squared distance of a point, relative to `origin`, until it
    /// returns false; says whether it never did.
    fn for_each_within(&self, local: DVec3, square: f64, mut visit: impl FnMut(u32) -> bool) -> bool {
        if self.nodes.is_empty() {
            return true;
        }
        let limit = (square * self.scale * self.scale * SLACK) as f32;
        let q = (local * self.scale).as_vec3();
        let q = [Vec4::splat(q.x), Vec4::splat(q.y), Vec4::splat(q.z)];
        let mut stack = [0_u32; STACK];
        let mut top = 1;
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            let squares = node.squares(q).to_array();
            for lane in 0..4 {
                let (first, count) = (node.child[lane], node.count[lane]);
                if squares[lane] > limit || count == EMPTY {
                    continue;
                }
                if count == INNER {
                    stack[top] = first;
                    top += 1;
                    continue;
                }
                for slot in first..first + u32::from(count) {
                    if self.distance_squared(local, slot) <= square && !visit(slot) {
                        return false;
                    }
                }
            }
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::soup;
    use super::*;
    use crate::certify::tests::Random;

    #[test]
    fn the_closest_triangle_is_one_of_those_around() {
        let (positions, triangles) = soup(300, &mut Random(9), 0.2);
        let surface = TriangleBvh::new(&positions, &triangles);
        let (mut random, mut few, mut only) = (Random(5), 0, 0);
        for _ in 0..300 {
            let (middle, radius) = (random.point(), 0.1 * random.point().x.abs());
            let Some(around) = surface.around(middle, radius, &mut Hint::default()) else { continue };
            few += 1;
            let inner = middle + DVec3::X * (0.5 * radius);
            let narrowed = surface.narrowed(&around, inner, 0.5 * radius);
            only += u32::from(surface.numbers(&narrowed).count() == 1);
            for _ in 0..20 {
                let step = random.point().clamp_length_max(1.0) * (0.5 * radius);
                let alone = surface.closest(inner + step, &mut Hint::default());
                for around in [&around, &narrowed] {
                    assert!((surface.closest_of(around, inner + step).distance - alone.distance).abs() < 1e-12);
                }
            }
        }
        assert!(few > 50 && only > 10, "{few} {only}");
        assert!(TriangleBvh::new(&[], &[]).around(DVec3::ONE, 1.0, &mut Hint::default()).is_none());
    }
}
