//! Texels between which readers interpolate with less error.
//!
//! A sample at the middle of a texel is exact there, and what readers interpolate between two samples lies on the
//! chord: off by up to an eighth of the second difference, always to the same side. Texels that are best in the mean
//! square over whole cells are those samples less a twelfth of their second differences, exactly so where the surface
//! shows a parabola.

use lodpack::decode::texels::Map;

use super::storage::Storage;

/// What is taken of a second difference: the mean of x (1 - x) / 2 over a cell.
const SHARE: f32 = 1.0 / 12.0;

/// Corrects colours without opacity along rows and columns, where the texels on both sides are covered by the patch,
/// too: what lies beyond is a guess, and the piece on the other side of a border makes another one.
pub(super) fn sharpen(map: &Map, is_covered: &[bool], values: &mut [f32], storage: &Storage) {
    let (width, stride) = (map.size[0] as usize, storage.stride());
    let colours = storage.opaque_colours();
    // The row above and this one as they were, and where both sides of this one's texels are covered.
    let (mut above, mut this, mut sides): (Vec<f32>, Vec<f32>, Vec<[bool; 2]>) = (vec![], vec![], vec![]);
    for piece in &map.pieces {
        let [[left, top], [right, bottom]] = piece.range().map(|corner| corner.map(|x| x as usize));
        let count = right - left + 1;
        for y in top..=bottom {
            let first = y * width + left;
            both_sides(is_covered, [first, width, count], y > top && y < bottom, &mut sides);
            let (rows, after) = values.split_at_mut((first + count) * stride);
            let row = &mut rows[first * stride..];
            this.clear();
            this.extend_from_slice(row);
            // None after the last row of the image, where nothing is asked of it.
            let below =
                after.get((width - count) * stride..).and_then(|row| row.get(..count * stride)).unwrap_or(&this);
            if y == top {
                above.clone_from(&this);
            }
            if storage.is_plain() {
                correct(row, [&above, &this, below], &sides);
            } else {
                for (x, &sides) in sides.iter().enumerate().filter(|(_, sides)| **sides != [false; 2]) {
                    for at in colours.iter().flat_map(|&first| (0..3).map(move |k| x * stride + first + k)) {
                        let beside = if sides[0] { [this[at - stride], this[at + stride]] } else { [this[at]; 2] };
                        let column = if sides[1] { [above[at], below[at]] } else { [this[at]; 2] };
                        row[at] = corrected(this[at], beside, column);
                    }
                }
            }
            std::mem::swap(&mut above, &mut this);
        }
    }
}

/// Of each texel of a row whether it is covered and both beside it are, and both above and below it.
fn both_sides(is_covered: &[bool], [first, width, count]: [usize; 3], is_inner: bool, sides: &mut Vec<[bool; 2]>) {
    let row = &is_covered[first..first + count];
    sides.clear();
    sides.resize(count, [false; 2]);
    for (sides, three) in sides.iter_mut().skip(1).zip(row.windows(3)) {
        sides[0] = three[0] & three[1] & three[2];
    }
    if is_inner {
        let [above, below] = [first - width, first + width].map(|first| &is_covered[first..first + count]);
        for (((sides, this), above), below) in sides.iter_mut().zip(row).zip(above).zip(below) {
            sides[1] = this & above & below;
        }
    }
}

/// A row of texels of four numbers, which are corrected at once: the last one is a weight, which counts no more.
fn correct(row: &mut [f32], rows: [&[f32]; 3], sides: &[[bool; 2]]) {
    let [above, this, below] = rows.map(|row| row.as_chunks::<4>().0);
    let row = row.as_chunks_mut::<4>().0;
    let columns = row.iter_mut().zip(this).zip(above.iter().zip(below)).zip(sides);
    for (x, (((texel, this_one), (above, below)), &[along, down])) in columns.enumerate() {
        let beside = match this.get(x.wrapping_sub(1)..x.wrapping_add(2)) {
            Some(&[before, _, after]) if along => [before, after],
            _ => [*this_one; 2],
        };
        let column = if down { [*above, *below] } else { [*this_one; 2] };
        *texel = std::array::from_fn(|k| corrected(this_one[k], beside.map(|one| one[k]), column.map(|one| one[k])));
    }
}

/// A value less a share of its second differences.
#[inline(always)]
fn corrected(value: f32, beside: [f32; 2], column: [f32; 2]) -> f32 {
    let twice = 2.0 * value;
    value - SHARE * ((beside[0] + beside[1] - twice) + (column[0] + column[1] - twice))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lies_between_texels_of_a_parabola_is_right_in_the_mean() {
        let square = |x: f32| x * x;
        let before: Vec<f32> = (0..9).flat_map(|x| [square(x as f32); 4]).collect();
        let mut sides = vec![];
        both_sides(&[true; 27], [9, 9, 9], true, &mut sides);
        assert_eq!((sides[0], sides[1], sides[8]), ([false, true], [true; 2], [false, true]));
        let mut row = before.clone();
        correct(&mut row, [&before, &before, &before], &sides);
        let error = |row: &[f32], first: usize| {
            let [a, b] = [row[4 * first], row[4 * first + 4]];
            let of = |k: i32| {
                let x = (k as f32 + 0.5) / 64.0;
                a * (1.0 - x) + b * x - square(first as f32 + x)
            };
            (0..64).map(of).sum::<f32>() / 64.0
        };
        for first in 1..7 {
            assert!(error(&before, first) > 0.16 && error(&row, first).abs() < 1e-3, "{first}: {}", error(&row, first));
        }
        assert_eq!([row[0], row[32]], [before[0], before[32]]);
    }

    #[test]
    fn texels_beside_what_nothing_covers_stay() {
        let mut sides = vec![];
        let covered = [true, true, true, true, true, false, true, true, true];
        both_sides(&covered, [3, 3, 3], true, &mut sides);
        assert_eq!(sides, [[false, true], [false, true], [false, false]]);
        both_sides(&covered, [0, 3, 3], false, &mut sides);
        assert_eq!(sides, [[false, false], [true, false], [false, false]]);
    }
}
