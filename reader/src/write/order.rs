//! The order of a file: roots along a Hilbert curve; arcs and corners as their first root uses them.

use crate::{
    error::{Error, Result},
    model::Model,
};

/// Bits an axis of the Hilbert curve.
const CURVE_BITS: u32 = 16;
const UNSET: u32 = u32::MAX;

/// The order of everything, and the numbers that follow from it.
pub(super) struct Order {
    /// Model root of each file root.
    pub roots: Vec<u32>,
    /// Model arc of each file arc, and the inverse.
    pub arcs: Vec<u32>,
    pub arc_ids: Vec<u32>,
    /// Model corner of each file corner, and the inverse.
    pub corners: Vec<u32>,
    pub corner_ids: Vec<u32>,
}

impl Order {
    /// Orders a checked model: whatever a cluster of roots is the first to use gets a run of numbers.
    pub(super) fn new(model: &Model) -> Result<Self> {
        let roots = along_curve(model);
        let (mut arcs, mut arc_ids) = (Vec::new(), vec![UNSET; model.arcs.len()]);
        for &root in &roots {
            for half_arc in model.roots[root as usize].loops.iter().flatten() {
                number(half_arc.arc, &mut arcs, &mut arc_ids);
            }
        }
        let (mut corners, mut corner_ids) = (Vec::new(), vec![UNSET; model.corners.len()]);
        for &arc in &arcs {
            model.arcs[arc as usize].ends.iter().for_each(|&corner| number(corner, &mut corners, &mut corner_ids));
        }
        match corner_ids.iter().position(|&id| id == UNSET) {
            Some(corner) => Err(Error::model(format!("corner {corner} is the end of no arc"))),
            None => Ok(Self { roots, arcs, arc_ids, corners, corner_ids }),
        }
    }
}

/// Gives a thing the next number if it has none.
fn number(thing: u32, order: &mut Vec<u32>, ids: &mut [u32]) {
    let id = &mut ids[thing as usize];
    if *id == UNSET {
        *id = order.len() as u32;
        order.push(thing);
    }
}

/// Roots by the place of their boxes' centres on a Hilbert curve through a cube around all of them.
fn along_curve(model: &Model) -> Vec<u32> {
    let centre = |root: u32| {
        let [low, high] = model.roots[root as usize].bounds;
        [0, 1, 2].map(|axis| low[axis] * 0.5 + high[axis] * 0.5)
    };
    let mut roots: Vec<u32> = (0..model.roots.len() as u32).collect();
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for &root in &roots {
        for (axis, x) in centre(root).into_iter().enumerate() {
            low[axis] = low[axis].min(x);
            high[axis] = high[axis].max(x);
        }
    }
    let extent = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let cells = f64::from(1_u32 << CURVE_BITS);
    roots.sort_by_cached_key(|&root| {
        let point = centre(root);
        // Converting saturates, so that the far side and an extent of zero need no care.
        let cell =
            [0, 1, 2].map(|axis| (((point[axis] - low[axis]) / extent * cells) as u32).min((1 << CURVE_BITS) - 1));
        (hilbert_key(cell), root)
    });
    roots
}

/// Place of a cell on the Hilbert curve (J. Skilling, "Programming the Hilbert curve", 2004).
fn hilbert_key(cell: [u32; 3]) -> u64 {
    let mut x = cell;
    let mut q = 1 << (CURVE_BITS - 1);
    while q > 1 {
        let p = q - 1;
        for axis in 0..3 {
            if x[axis] & q != 0 {
                x[0] ^= p;
            } else {
                let t = (x[0] ^ x[axis]) & p;
                x[0] ^= t;
                x[axis] ^= t;
            }
        }
        q >>= 1;
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let mut t = 0;
    let mut q = 1 << (CURVE_BITS - 1);
    while q > 1 {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
        q >>= 1;
    }
    let x = x.map(|x| x ^ t);
    (0..CURVE_BITS).rev().fold(0, |key, bit| x.iter().fold(key, |key, x| (key << 1) | u64::from((x >> bit) & 1)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_on_the_curve_are_neighbours_in_space() {
        // The lowest bits of the curve fill a cube of 8^3 cells, in steps to face neighbours.
        let mut cells: Vec<[u32; 3]> = (0..512).map(|i| [i % 8, i / 8 % 8, i / 64]).collect();
        cells.sort_by_key(|&cell| hilbert_key(cell));
        for pair in cells.windows(2) {
            let distance: u32 = (0..3).map(|axis| pair[0][axis].abs_diff(pair[1][axis])).sum();
            assert_eq!(distance, 1);
        }
    }
}
