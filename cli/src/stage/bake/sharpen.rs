//! Texels between which readers interpolate with less error.
//!
//! A sample at the middle of a texel is exact there, and what readers interpolate between two samples lies on the chord: off by up to an
//! eighth of the second difference, always to the same side. Texels that are best in the mean square over whole cells are those samples less a
//! twelfth of their second differences, exactly so where the surface shows a parabola.

use std::ops::Range;

use lodpack::decode::texels::Map;

use super::values::Storage;

/// What is taken of a second difference: the mean of x (1 - x) / 2 over a cell.
const SHARE: f32 = 1.0 / 12.0;

/// Corrects colours without opacity along rows and columns, where the texels on both sides are covered by the patch, too: what lies beyond is
/// a guess, and the piece on the other side of a border makes another one.
pub(super) fn sharpen(map: &Map, is_covered: &[bool], values: &mut [f32], storage: &Storage) {
    let (width, stride) = (map.size[0] as usize, storage.stride());
    let colours = storage.opaque_colours();
    if colours.is_empty() {
        return;
    }
    // The row above and this one as they were.
    let (mut above, mut this): (Vec<f32>, Vec<f32>) = (vec![], vec![]);
    for piece in &map.pieces {
        let [[left, top], [right, bottom]] = piece.range().map(|corner| corner.map(|x| x as usize));
        let texels = |y: usize| y * width + left..y * width + right + 1;
        let of_row = |texels: Range<usize>| texels.start * stride..texels.end * stride;
        above.clear();
        for y in top..=bottom {
            this.clear();
            this.extend_from_slice(&values[of_row(texels(y))]);
            let (rows, below) = values.split_at_mut(of_row(texels(y)).end);
            let row = &mut rows[of_row(texels(y)).start..];
            let covered = &is_covered[texels(y)];
            let [covered_above, covered_below] = [y.checked_sub(1), Some(y + 1)]
                .map(|y| y.filter(|y| (top..=bottom).contains(y)).map_or(&[][..], |y| &is_covered[texels(y)]));
            // The next row of the piece, if there is one.
            let below = below.get((width - covered.len()) * stride..).unwrap_or(&[]);
            for x in (0..covered.len()).filter(|&x| covered[x]) {
                let is_inside = |row: &[bool], x: usize| row.get(x).copied().unwrap_or(false);
                let along = x > 0 && covered[x - 1] && is_inside(covered, x + 1);
                let down = is_inside(covered_above, x) && is_inside(covered_below, x);
                for at in colours.iter().flat_map(|&first| x * stride + first..x * stride + first + 3) {
                    let twice = 2.0 * this[at];
                    let of_row = if along { this[at - stride] + this[at + stride] - twice } else { 0.0 };
                    let of_column = if down { above[at] + below[at] - twice } else { 0.0 };
                    row[at] = this[at] - SHARE * (of_row + of_column);
                }
            }
            std::mem::swap(&mut above, &mut this);
        }
    }
}
