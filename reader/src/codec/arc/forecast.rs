//! Predicts where the middle of an interval lies, and chooses the frame and the statistics with which its residual is
//! coded.

use super::{Path, contexts};
use crate::{
    codec::{
        entropy::context::Context,
        local_frame::{AXES, LocalFrame, to_lattice},
        patch::LatticePoint,
        vector::{Vec3, add, scale, sub, to_f64},
    },
    error::Violation,
};

/// The forecast for the middle of an interval.
pub(super) struct Forecast {
    pub param: u32,
    pub level: u8,
    pub point: Vec3,
    /// Its normal is the direction of the arc.
    pub frame: LocalFrame,
    /// The length of a step along the arc.
    pub step: f64,
    size_class: usize,
}

impl Path {
    /// The forecast for the middle of the interval after knot `i`.
    ///
    /// Let p and q be the ends of the interval, o the knot one interval width before p, and r the one after q. The
    /// middle is forecast at (9 (p + q) - (o + r)) / 16, or without r at (6 p + 3 q - o) / 8, or without o at (6 q + 3
    /// p - r) / 8, or at (p + q) / 2. The frame has its normal in the direction of q - p, and its direction is the
    /// coordinate axis along which |q - p| is smallest (the first of equals). With the residual (a, b, c), the sample
    /// lies at forecast + along * a + across * b + normal * (c * step), summed in this order, then rounded.
    ///
    /// The size class is that of the end that came later, the middle of the interval above: the end whose parameter has
    /// fewer trailing zero bits. A sample has the bit length of max(|a|, |b|), at most 6, as its class; a corner has 7.
    #[inline]
    pub(super) fn forecast(&self, i: usize, width: u32, level: u8, step: f64) -> Forecast {
        let (first, second) = (self.knots[i], self.knots[i + 1]);
        let above = if first.param.trailing_zeros() < second.param.trailing_zeros() { first } else { second };
        let (param, size_class) = (first.param + width / 2, usize::from(above.size_class));
        if !self.is_placed {
            return Forecast { param, level, point: [0.0; 3], frame: AXES, step, size_class };
        }
        let (p, q) = (to_f64(first.position), to_f64(second.position));
        // Most of these knots are neighbours in the list.
        let at = |param: Option<u32>, neighbour: Option<usize>| {
            let next = self.knots.get(neighbour?)?;
            if next.param == param? {
                return Some(to_f64(next.position));
            }
            let index = self.knots.binary_search_by_key(&param?, |knot| knot.param).ok()?;
            Some(to_f64(self.knots[index].position))
        };
        let point =
            match (at(first.param.checked_sub(width), i.checked_sub(1)), at(Some(second.param + width), Some(i + 2))) {
                (Some(o), Some(r)) => scale(sub(scale(add(p, q), 9.0), add(o, r)), 0.0625),
                (Some(o), None) => scale(sub(add(scale(p, 6.0), scale(q, 3.0)), o), 0.125),
                (None, Some(r)) => scale(sub(add(scale(q, 6.0), scale(p, 3.0)), r), 0.125),
                (None, None) => scale(add(p, q), 0.5),
            };
        let chord = sub(q, p);
        let mut flattest = 0;
        for axis in 1..3 {
            if chord[axis].abs() < chord[flattest].abs() {
                flattest = axis;
            }
        }
        // Written out: storing one number, and then loading it together with its neighbours, would stall the processor.
        let [x, y, z] = [flattest == 0, flattest == 1, flattest == 2];
        let direction = [f64::from(u8::from(x)), f64::from(u8::from(y)), f64::from(u8::from(z))];
        Forecast { param, level, point, frame: LocalFrame::new(chord, direction), step, size_class }
    }
}

impl Forecast {
    /// The lattice point at `residual` steps from the forecast.
    #[inline]
    pub(super) fn place(&self, residual: [i64; 3]) -> Result<LatticePoint, Violation> {
        let (a, b, along) = (residual[0] as f64, residual[1] as f64, residual[2] as f64);
        to_lattice(self.frame.lift(self.frame.slide(self.point, a, b), along * self.step))
            .ok_or(Violation(&"an arc leaves the lattice"))
    }

    /// The contexts of the residual's components. That of the second component depends on the first component.
    #[inline]
    pub(super) fn contexts(&self, first: i64) -> [Context; 3] {
        let second_class = size_class(first.unsigned_abs(), contexts::SIZE_CLASSES - 1);
        [
            contexts::residual(0, self.size_class),
            contexts::residual(1, second_class),
            contexts::residual(2, self.size_class),
        ]
    }
}

/// The bit length of a magnitude, at most `most`.
#[inline]
pub(super) fn size_class(magnitude: u64, most: usize) -> usize {
    (magnitude.checked_ilog2().map_or(0, |bits| bits + 1) as usize).min(most)
}
