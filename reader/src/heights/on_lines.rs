//! Which samples of a tile are drawn, along its lines.

use super::{
    drawn::{Outline, Side},
    grid::SIDE,
    restricted::TileTriangle,
};

/// The samples that triangles of a tile use: of those in one place the first.
pub(super) struct OnLines {
    /// Of each index line the first one on the same line.
    first: [[usize; SIDE]; 2],
    /// Per index column the rows, per index row the columns.
    drawn: [[u128; SIDE]; 2],
}

impl OnLines {
    pub fn new(outline: Outline<'_>, triangles: &[TileTriangle]) -> Self {
        let first = [0, 1].map(|axis| {
            let lines = outline.lines_of(axis);
            let mut first = [0; SIDE];
            for k in 1..SIDE {
                first[k] = if lines[k] == lines[k - 1] { first[k - 1] } else { k };
            }
            first
        });
        let mut this = Self { first, drawn: [[0; SIDE]; 2] };
        for &at in triangles.iter().flatten() {
            let at = this.first(at);
            this.drawn[0][at % SIDE] |= 1 << (at / SIDE);
            this.drawn[1][at / SIDE] |= 1 << (at % SIDE);
        }
        this
    }

    /// The first sample in the place of a sample.
    pub fn first(&self, at: u16) -> usize {
        let at = usize::from(at);
        self.first[1][at / SIDE] * SIDE + self.first[0][at % SIDE]
    }

    /// All of them.
    pub fn samples(&self) -> impl Iterator<Item = usize> + '_ {
        (0..SIDE * SIDE).filter(|at| (self.drawn[1][at / SIDE] >> (at % SIDE)) & 1 != 0)
    }

    /// Those between the ends of a side, from the first end to the second. The side connects first samples.
    pub fn between(&self, Side { axis, across, ends: [from, to] }: Side) -> impl Iterator<Item = usize> + use<> {
        let (low, high) = (from.min(to), from.max(to));
        let above = if low + 1 < high { self.drawn[axis][across] >> (low + 1) } else { 0 };
        let mut left = above & ((1 << high.saturating_sub(low + 1)) - 1);
        std::iter::from_fn(move || {
            if left == 0 {
                return None;
            }
            // A side that goes back begins with the last one.
            let bit = if from < to { left.trailing_zeros() } else { u128::BITS - 1 - left.leading_zeros() };
            left &= !(1 << bit);
            let along = low + 1 + bit as usize;
            Some(if axis == 0 { along * SIDE + across } else { across * SIDE + along })
        })
    }
}
