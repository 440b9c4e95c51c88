//! Where a new vertex is expected, in which frame its residual is coded, and which statistics fit the shape of the
//! loop.
//!
//! All contexts follow from decoded positions: angles predict operations, and lengths predict the size of residuals.
//! Since tables are static, this replaces adaptive coding. The numbers below were fitted to simplified scans.

use super::{
    connectivity::{Machine, NONE, Vertex},
    contexts::{self, SIZES},
};
use crate::codec::{
    entropy::context::Context,
    local_frame::LocalFrame,
    patch::LatticePoint,
    vector::{Vec3, add, cross, dot, scale, sub, to_f64},
};

/// Bounds of the classes of the angle at the gate's end, the sharpest one nearby. They are quantiles of the
/// pseudo-angle.
const END_BOUNDS: [Angle; 7] = Angle::all([0.1, 0.25, 0.45, 0.65, 0.9, 1.2, 1.5]);
/// Bounds of the classes of the angle at the gate's start.
const START_BOUNDS: [Angle; 3] = Angle::all([1.9, 2.2, 3.0]);
/// Bounds of the classes of size, in steps: octaves and their middles, written out so that no power function is needed.
const SIZE_BOUNDS: [f64; 8] = [2.0, 2.8, 4.0, 5.7, 8.0, 11.3, 16.0, 22.6];

/// sqrt(3) / 2.
const SIN_60: f64 = 0.866_025_403_784_438_6;
/// The pseudo-angle (about 150 degrees) from which a corner is expected to take more than two triangles.
const WIDE: Angle = Angle::of(1.875);

/// A pseudo-angle as an integer, in the order of [`f64::total_cmp`]. The next gate and its context wait for comparisons
/// of angles, and integers are compared in one cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Angle(i64);

impl Angle {
    const fn of(value: f64) -> Self {
        let bits = value.to_bits() as i64;
        Self(bits ^ ((bits >> 63) as u64 >> 1) as i64)
    }

    const fn all<const N: usize>(values: [f64; N]) -> [Self; N] {
        let mut angles = [Self(0); N];
        let mut k = 0;
        while k < N {
            angles[k] = Self::of(values[k]);
            k += 1;
        }
        angles
    }
}

/// The class of `x`: how many bounds it reaches.
#[inline(always)]
fn class<T: PartialOrd + Copy>(x: T, bounds: &[T]) -> Context {
    bounds.iter().map(|&bound| Context::from(x >= bound)).sum()
}

/// The number of [`SIZE_BOUNDS`] that a size reaches. Its sign and exponent give the octave, so one comparison is left.
#[inline]
fn size_class(size: f64) -> Context {
    let octave = ((size.to_bits() as i64 >> 52) - 1023).clamp(0, 4) as usize;
    match octave.checked_sub(1) {
        Some(below) => 2 * below as Context + 1 + Context::from(size >= SIZE_BOUNDS[2 * below + 1]),
        None => 0,
    }
}

/// Twice the area vector of a closed polygon (Newell), summed relative to its first vertex.
pub(super) fn polygon_area_vector(polygon: &[LatticePoint]) -> Vec3 {
    let mut sum = [0.0; 3];
    let Some(&first) = polygon.first() else { return sum };
    let first = to_f64(first);
    for edge in polygon.windows(2) {
        sum = add(sum, cross(sub(to_f64(edge[0]), first), sub(to_f64(edge[1]), first)));
    }
    sum
}

/// The angle at a slot on the unknown side, from the edge that leaves the slot (to `next`) to the edge that enters it
/// (from `previous`): 1 - cos up to a straight angle (0 to 2), and 3 + cos beyond (2 to 4). It is 2 where an edge has
/// no length.
#[inline]
pub(super) fn pseudo_angle(at: &Vertex, next: &Vec3, previous: &Vec3) -> Angle {
    let leaving = sub(*next, at.position);
    let entering = sub(*previous, at.position);
    let squares = dot(leaving, leaving) * dot(entering, entering);
    if squares == 0.0 {
        return Angle::of(2.0);
    }
    let cosine = dot(leaving, entering) / squares.sqrt();
    let turn = dot(cross(leaving, entering), at.normal);
    Angle::of(if turn >= 0.0 { 1.0 - cosine } else { 3.0 + cosine })
}

/// The context of the operation at a gate.
#[inline]
pub(super) fn operation_context(machine: &Machine, gate: u32) -> Context {
    let start = &machine.slots[gate as usize];
    let end = &machine.slots[start.next as usize];
    contexts::OPERATION + class(end.angle, &END_BOUNDS) * 4 + class(start.angle, &START_BOUNDS)
}

/// What is known about a new vertex before its residual.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forecast {
    /// The expected position, without [`Forecast::bend`].
    pub point: Vec3,
    /// The frame of the residual, from the mean normal of the gate's ends and the gate's direction.
    pub frame: LocalFrame,
    /// The local edge length, which predicts the size of tangential residuals.
    length: f64,
    /// How far the known vertices around lie from the frame's plane, which predicts the size of normal residuals.
    height: f64,
    /// The gate's ends.
    ends: [Vec3; 2],
    /// The sums of area vectors there.
    normals: [Vec3; 2],
}

/// What is known about the vertex c of the triangle a, b, c to the left of the gate a -> b.
///
/// The forecast is a mean of three: with weight one half, that c halves the corner at b (or takes 60 degrees of a wide
/// one) at the mean length of the corner's edges; with weight one quarter each, the parallelograms across the gate and
/// in the corner.
#[inline]
pub(super) fn forecast(machine: &Machine, gate: u32) -> Forecast {
    let start = machine.slots[gate as usize];
    let end = machine.slots[start.next as usize];
    let (a, b) = (start.vertex as usize, end.vertex as usize);
    let n = machine.slots[end.next as usize].vertex as usize;
    let Vertex { position: pa, normal: normal_a } = machine.vertices[a];
    let Vertex { position: pb, normal: normal_b } = machine.vertices[b];
    let pn = machine.vertices[n].position;
    let gate_edge = sub(pb, pa);
    let next_edge = sub(pn, pb);
    let frame = LocalFrame::new(add(normal_a, normal_b), gate_edge);
    // The corner at b in the tangent plane: its edges lead to (-reach, 0) and (x, y).
    let reach = dot(gate_edge, frame.along);
    let (x, y) = (dot(next_edge, frame.along), dot(next_edge, frame.across));
    let span = (x * x + y * y).sqrt();
    let mut direction = [-0.5, SIN_60];
    if end.angle < WIDE && span > 0.0 {
        // (-1, 0) + (x, y) / span, times span.
        let bisector = [x - span, y];
        let size = (bisector[0] * bisector[0] + bisector[1] * bisector[1]).sqrt();
        if size > 0.0 {
            direction = [bisector[0] / size, bisector[1] / size];
        }
    }
    let length = (reach + span) * 0.5;
    let turned = frame.slide(pb, length * direction[0], length * direction[1]);
    let mut height = dot(next_edge, frame.normal).abs() + 2.0 * dot(gate_edge, frame.normal).abs();
    let point = if start.outer == NONE {
        turned
    } else {
        // (a + b - o) + (a + n - b) = (a - o) + (a + n).
        let behind = sub(pa, machine.vertices[start.outer as usize].position);
        height += dot(behind, frame.normal).abs();
        add(scale(turned, 0.5), scale(add(behind, add(pa, pn)), 0.25))
    };
    Forecast { point, frame, length, height, ends: [pa, pb], normals: [normal_a, normal_b] }
}

impl Forecast {
    /// The expected height of the surface above `point`: a quarter of the heights of the tangent planes at both ends of
    /// the gate. The parallelograms have the remaining weight. A plane that is steep in the frame counts as nothing.
    #[inline]
    pub(super) fn bend(&self, point: Vec3) -> f64 {
        0.25 * (self.plane_height(point, 0) + self.plane_height(point, 1))
    }

    #[inline]
    fn plane_height(&self, point: Vec3, end: usize) -> f64 {
        let normal = self.normals[end];
        let upright = dot(normal, self.frame.normal);
        if upright > 0.0 && upright * upright > 0.1 * dot(normal, normal) {
            let away = sub(point, self.ends[end]);
            dot(away, self.frame.normal) - dot(away, normal) / upright
        } else {
            0.0
        }
    }

    /// The contexts of the residual's components, given the normal and the tangential step.
    #[inline]
    pub(super) fn contexts(&self, (normal_step, tangent_step): (f64, f64)) -> [Context; 3] {
        // Steps are powers of two, so multiplying by the reciprocal is exact.
        let tangential = size_class(self.length * (1.0 / tangent_step));
        let normal = size_class(self.height * (1.0 / normal_step));
        [tangential, SIZES + tangential, 2 * SIZES + normal].map(|class| contexts::RESIDUAL + class)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn size_classes_count_bounds() {
        let around = SIZE_BOUNDS.iter().flat_map(|&bound| [bound.next_down(), bound, bound.next_up()]);
        let others =
            [0.0, -0.0, 1e-300, 1.0, 1.999, 3.0, 30.0, 32.0, 45.2, 1e12, 1e300, -1e-300, -2.0, -2.8, -30.0, -1e300];
        for size in around.chain(others) {
            assert_eq!(size_class(size), class(size, &SIZE_BOUNDS), "{size}");
        }
    }

    #[test]
    fn angles_are_ordered_as_their_numbers() {
        let numbers = [-1e-16, -2.2e-17, 0.0, 5e-324, 1e-16, 0.1, 0.25, 1.0, 1.875, 2.0, 3.0, 4.0];
        assert!(numbers.windows(2).all(|pair| Angle::of(pair[0]) < Angle::of(pair[1])));
    }
}
