//! Blocks of samples and their roughness: what need not be looked at.

use super::samples::{Stored, Window};

/// Cells along a side of a block, coarse to fine. Blocks share the samples on their borders.
pub const BLOCK_SIDES: [usize; 2] = [16, 4];
/// Distances are compared in this many lanes, which do not wait for each other.
const LANES: usize = 4;

/// How rough the blocks of a window are.
pub struct Blocks {
    /// Of each size, row by row.
    roughness: [Vec<f32>; 2],
    /// Blocks in a row, of each size.
    counts: [usize; 2],
}

impl Blocks {
    /// Looks at all samples of a window.
    pub fn new(window: &Window) -> Self {
        let (stored, width) = window.all();
        let [coarse, fine] = BLOCK_SIDES;
        Self {
            roughness: [roughness::<{ BLOCK_SIDES[0] }>(stored, width), roughness::<{ BLOCK_SIDES[1] }>(stored, width)],
            counts: [coarse, fine].map(|side| (width - 1).div_ceil(side)),
        }
    }

    /// How far the samples of a block are at most from what is straight between its corners, in steps; column and row
    /// count blocks from the first sample on. None if there is no such block.
    #[inline]
    pub fn roughness(&self, size: usize, [column, row]: [usize; 2]) -> Option<f64> {
        let count = self.counts[size];
        let found = if column < count { self.roughness[size].get(row * count + column) } else { None };
        found.map(|&most| f64::from(most))
    }
}

/// The largest of some distances, one for each sample of a run: `off` gets the place in the run as a number, and the
/// sample.
#[inline(always)]
pub fn largest(run: &[Stored], least: f64, off: impl Fn(f64, Stored) -> f64) -> f64 {
    let (chunks, rest) = run.as_chunks::<LANES>();
    let mut most = [least; LANES];
    let mut at = [0.0, 1.0, 2.0, 3.0];
    for chunk in chunks {
        for ((most, at), &sample) in most.iter_mut().zip(&mut at).zip(chunk) {
            let off = off(*at, sample);
            *most = if off > *most { off } else { *most };
            *at += LANES as f64;
        }
    }
    for ((most, &at), &sample) in most.iter_mut().zip(&at).zip(rest) {
        let off = off(at, sample);
        *most = if off > *most { off } else { *most };
    }
    let of_two = |a: f64, b: f64| if a > b { a } else { b };
    of_two(of_two(most[0], most[1]), of_two(most[2], most[3]))
}

/// For each block of `SIDE` cells along a side, row by row, how far its samples are at most from what is straight
/// between its four corners, in steps and rounded up; infinite where some have no data.
fn roughness<const SIDE: usize>(stored: &[Stored], width: usize) -> Vec<f32> {
    let height = stored.len() / width.max(1);
    let mut all = vec![];
    for north in (0..height.saturating_sub(1)).step_by(SIDE) {
        let south = (north + SIDE).min(height - 1);
        for west in (0..width.saturating_sub(1)).step_by(SIDE) {
            let east = (west + SIDE).min(width - 1);
            let at = |column: usize, row: usize| f64::from(stored[row * width + column] >> 1);
            let corners = [at(west, north), at(east, north), at(west, south), at(east, south)];
            let (down, right) = (1.0 / (south - north) as f64, 1.0 / (east - west) as f64);
            let (mut most, mut voids) = (0.0f64, 0);
            for row in north..=south {
                let y = (row - north) as f64 * down;
                let first = corners[0] + (corners[2] - corners[0]) * y;
                let rise = (corners[1] + (corners[3] - corners[1]) * y - first) * right;
                let run = &stored[row * width + west..=row * width + east];
                let off = |k: f64, sample: Stored| (first + rise * k - f64::from(sample >> 1)).abs();
                // Most blocks have all of their samples, as many as the compiler knows.
                most = match run.first_chunk::<SIDE>() {
                    Some(run) => largest(run, most, off),
                    None => largest(run, most, off),
                };
                let last = off((east - west) as f64, run[run.len() - 1]);
                most = if last > most { last } else { most };
                voids |= run.iter().fold(0, |voids, sample| voids | sample);
            }
            let rounded_up = (most * (1.0 + 1e-6)) as f32 * (1.0 + 2.0 * f32::EPSILON);
            all.push(if voids & 1 == 0 { rounded_up } else { f32::INFINITY });
        }
    }
    all
}
