//! The contexts of heights (SPEC.md, "Blocks of heights").

use crate::codec::entropy::{
    SymbolBuffer,
    context::{Context, HEIGHTS},
};

/// Classes of activity.
pub(super) const CLASSES: u16 = 32;
/// Corner of a root tile.
pub(super) const CORNER: Context = HEIGHTS.first;
/// What a residual lies beyond the escape of its class.
pub(super) const BEYOND: Context = CORNER + 1;
/// Residual of the centre of four samples: one for each class.
pub(super) const CENTRE: Context = BEYOND + 1;
/// Residual of a sample between two or four others: one for each class.
pub(super) const EDGE: Context = CENTRE + CLASSES;
/// Whether a cell is drawn: the cells to the west, north-west, north and north-east as bits.
pub(super) const CELL: Context = EDGE + CLASSES;
const _: () = assert!(CELL + 16 == HEIGHTS.end);

/// The class of a measure of activity: half octaves, so that the residuals of a class are alike.
#[inline]
pub(super) fn class(measure: u64) -> u16 {
    if measure < 2 {
        return measure as u16;
    }
    let magnitude = measure.ilog2();
    let half = (measure >> (magnitude - 1)) & 1;
    (2 * magnitude as u16 + half as u16).min(CLASSES - 1)
}

/// The smallest residual, zigzag mapped, that a class codes in two symbols: about 32 times what is usual there. So a
/// table with all tokens of a class is short, and can be made before all residuals are known.
#[inline]
pub(super) fn escape(class: u16) -> u64 {
    1 << (class / 2 + 3)
}

/// Every token of every context, once.
#[cfg(feature = "write")]
pub(crate) fn anything() -> SymbolBuffer {
    let mut symbols = SymbolBuffer::default();
    // Quarters of octaves have tokens of their own.
    let up_to = |end: u64| {
        (0..16)
            .chain((4..64).flat_map(|bit| (0..4).map(move |part| (4 + part) << (bit - 2))))
            .take_while(move |&value| value <= end)
    };
    for class in 0..CLASSES {
        for first in [CENTRE, EDGE] {
            up_to(escape(class)).for_each(|value| symbols.put(first + class, value));
        }
    }
    // Heights have 32 bits, and weights of predictions three more at most.
    for context in [CORNER, BEYOND] {
        up_to(1 << 38).for_each(|value| symbols.put(context, value));
    }
    for cell in 0..16 {
        (0..2).for_each(|value| symbols.put(CELL + cell, value));
    }
    symbols
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_ascend_by_half_octaves() {
        let classes: Vec<u16> = [0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 12, 16, 24, 32].map(class).to_vec();
        assert_eq!(classes, [0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 7, 8, 9, 10]);
        assert_eq!(class(u64::MAX), 31);
    }
}
