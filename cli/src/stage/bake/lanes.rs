//! Points by the row: texels of finer patches are moved to the map of a coarser one sixteen at a time, in loops that compilers turn into
//! vectors. Each point comes out as it would alone ([`Drawn::closest`]), so nothing depends on which of them do.

use super::projection::Projection;
use super::raster::{Drawn, MAX_STEP};

/// The most points at a time.
pub(super) const LANES: usize = 16;

/// A number of each point.
pub(super) type Lane = [f32; LANES];

/// No texel.
pub(super) const OUTSIDE: u32 = u32::MAX;

/// Points whose columns and depths differ: the place of the first one, and what a column and a step of depth add to it.
pub(super) struct Row {
    pub start: [f32; 3],
    pub beside: [f32; 3],
    pub deeper: [f32; 3],
}

/// The texels of a piece, on which points may fall.
pub(super) struct Window<'a> {
    drawn: &'a Drawn,
    width: u32,
    /// Smallest place within, and the smallest beyond.
    low: [f32; 2],
    high: [f32; 2],
    reach: f32,
}

impl<'a> Window<'a> {
    /// Of a piece in an image so many texels wide.
    pub fn new(drawn: &'a Drawn, width: usize, projection: &Projection) -> Self {
        let [low, high] = projection.range.map(|place| place.map(|x| x as f32));
        let (low, high) = (low.map(|x| x - 0.5), high.map(|x| x + 0.5));
        Self { drawn, width: width as u32, low, high, reach: projection.reach }
    }

    /// The texel on which each point of a row falls after it has moved to the patch; [`OUTSIDE`] if it falls on none, or lies too far from
    /// the patch there.
    #[inline]
    pub fn texels(&self, row: &Row, columns: &Lane, depths: &Lane) -> [u32; LANES] {
        let of = |axis: usize| -> Lane {
            let [start, beside, deeper] = [row.start[axis], row.beside[axis], row.deeper[axis]];
            std::array::from_fn(|k| start + beside * columns[k] + deeper * depths[k])
        };
        let [mut x, mut y, mut z] = [of(0), of(1), of(2)];
        let first = self.under(&x, &y);
        if first == [OUTSIDE; LANES] {
            return first;
        }
        let (mut depth, mut along, mut down) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for k in 0..LANES {
            let texel = first[k] as usize;
            depth[k] = self.drawn.depth.get(texel).copied().unwrap_or(f32::NAN);
            [along[k], down[k]] = self.drawn.slope.get(texel).copied().unwrap_or_default();
        }
        for k in 0..LANES {
            let away = z[k] - (depth[k] + along[k] * (x[k] - middle(x[k])) + down[k] * (y[k] - middle(y[k])));
            let step = away / (1.0 + along[k] * along[k] + down[k] * down[k]);
            let [right, below] = [along[k] * step, down[k] * step];
            // Comparisons with NaN are false.
            let is_moved = (away.abs() <= self.reach) & (right.abs() <= MAX_STEP) & (below.abs() <= MAX_STEP);
            x[k] += if is_moved { right } else { 0.0 };
            y[k] += if is_moved { below } else { 0.0 };
            z[k] -= if is_moved { step } else { 0.0 };
        }
        let mut texels = self.under(&x, &y);
        for k in 0..LANES {
            let depth = self.drawn.depth.get(texels[k] as usize).copied().unwrap_or(f32::NAN);
            let is_near = first[k] != OUTSIDE && (depth - z[k]).abs() <= self.reach;
            texels[k] = if is_near { texels[k] } else { OUTSIDE };
        }
        texels
    }

    /// The texels in which points lie.
    #[inline(always)]
    fn under(&self, x: &Lane, y: &Lane) -> [u32; LANES] {
        std::array::from_fn(|k| {
            let is_within =
                (self.low[0] <= x[k]) & (x[k] < self.high[0]) & (self.low[1] <= y[k]) & (y[k] < self.high[1]);
            let texel = whole(y[k]).wrapping_mul(self.width).wrapping_add(whole(x[k]));
            if is_within { texel } else { OUTSIDE }
        })
    }
}

/// Where flags are set. Most are not, and are passed over together.
pub(super) fn set(flags: &[bool]) -> impl Iterator<Item = usize> {
    fn of_some(first: usize, some: &[bool]) -> impl Iterator<Item = usize> {
        some.iter().enumerate().filter(|(_, flag)| **flag).map(move |(at, _)| first + at)
    }
    let (lanes, rest) = flags.as_chunks::<LANES>();
    let with_any = lanes.iter().enumerate().filter(|(_, lane)| **lane != [false; LANES]);
    with_any.flat_map(|(number, lane)| of_some(number * LANES, lane)).chain(of_some(lanes.len() * LANES, rest))
}

/// The least of numbers that are none of them NaN.
#[inline(always)]
pub(super) fn least(mut lane: Lane) -> f32 {
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            lane[k] = if lane[k] < lane[k + half] { lane[k] } else { lane[k + half] };
        }
    }
    lane[0]
}

/// The largest whole number that is not greater, of a number from 0 to 2^22; otherwise anything. Conversions saturate, which takes vectors long.
#[inline(always)]
pub(super) fn whole(x: f32) -> u32 {
    let rounded = x + SHIFT;
    (rounded.to_bits() & 0x007f_ffff).wrapping_sub(u32::from(rounded - SHIFT > x))
}

/// The middle between that number and the next.
#[inline(always)]
fn middle(x: f32) -> f32 {
    let rounded = (x + SHIFT) - SHIFT;
    rounded + if rounded > x { -0.5 } else { 0.5 }
}

/// Numbers of single precision have no fraction from here to twice as much.
const SHIFT: f32 = (1 << 23) as f32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_found_where_they_are_set() {
        let flags: Vec<bool> = (0..100).map(|at| at % 37 == 5 || at == 99).collect();
        assert!(set(&flags).eq([5, 42, 79, 99]));
        assert_eq!(set(&[]).count(), 0);
    }

    #[test]
    fn whole_parts_are_those_of_conversions() {
        for number in (0..=1 << 22).step_by(13) {
            for x in [number as f32 / 256.0, number as f32, number as f32 + 0.5] {
                assert_eq!(whole(x), x as u32, "{x}");
                assert_eq!(middle(x), x.floor() + 0.5, "{x}");
            }
        }
        let below = f32::from_bits(1.0_f32.to_bits() - 1);
        assert_eq!([whole(0.0), whole(below), whole(1.0)], [0, 0, 1]);
    }
}
