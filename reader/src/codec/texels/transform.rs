//! The transform of blocks of 8 x 8 values, in integers, so that every machine decodes the same.

/// Values along each side of a block.
pub(super) const SIDE: usize = 8;
/// Values of a block.
pub(super) const AREA: usize = SIDE * SIDE;
/// Largest absolute coefficient that the inverse takes without overflow.
pub(super) const MOST: i32 = 4095;

/// Row k is 4096 times the k-th cosine, normalised: round(4096 * a * cos((2 n + 1) k pi / 16)), where a is sqrt(1/8)
/// for k = 0, else 1/2.
const COSINES: [[i32; SIDE]; SIDE] = [
    [1448, 1448, 1448, 1448, 1448, 1448, 1448, 1448],
    [2009, 1703, 1138, 400, -400, -1138, -1703, -2009],
    [1892, 784, -784, -1892, -1892, -784, 784, 1892],
    [1703, -400, -2009, -1138, 1138, 2009, 400, -1703],
    [1448, -1448, -1448, 1448, 1448, -1448, -1448, 1448],
    [1138, -2009, 400, 1703, -1703, -400, 2009, -1138],
    [784, -1892, 1892, -784, -784, 1892, -1892, 784],
    [400, -1138, 1703, -2009, 2009, -1703, 1138, -400],
];

/// The same of four values, and of two.
const COSINES_OF_FOUR: [[i32; 4]; 4] =
    [[2048, 2048, 2048, 2048], [2676, 1108, -1108, -2676], [2048, -2048, -2048, 2048], [1108, -2676, 2676, -1108]];
const COSINES_OF_TWO: [[i32; 2]; 2] = [[2896, 2896], [2896, -2896]];

/// The same as fractions.
#[cfg(feature = "write")]
pub(super) static COSINES_OF: [[f32; SIDE]; SIDE] = {
    let (mut result, mut at) = ([[0.0; SIDE]; SIDE], 0);
    while at < AREA {
        result[at / SIDE][at % SIDE] = COSINES[at / SIDE][at % SIDE] as f32 / 4096.0;
        at += 1;
    }
    result
};

/// The order of coefficients in a block: along diagonals, so that low frequencies come first.
pub(super) const ORDER: [u8; AREA] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7, 14, 21,
    28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54,
    47, 55, 62, 63,
];

/// Sums of eight cosines with weights. Even and odd ones are symmetric, which halves the work.
#[inline(always)]
fn sums(weights: [i32; SIDE]) -> [i32; SIDE] {
    let mut result = [0; SIDE];
    for n in 0..SIDE / 2 {
        let (mut even, mut odd) = (0, 0);
        for k in 0..SIDE / 2 {
            even += weights[2 * k] * COSINES[2 * k][n];
            odd += weights[2 * k + 1] * COSINES[2 * k + 1][n];
        }
        result[n] = even + odd;
        result[SIDE - 1 - n] = even - odd;
    }
    result
}

/// The values of a block, from coefficients of at most [`MOST`] each.
pub(super) fn inverse(coefficients: &[i32; AREA]) -> [i32; AREA] {
    let mut values = [0; AREA];
    if coefficients[1..].iter().all(|&c| c == 0) {
        let value = column(coefficients[0] * COSINES[0][0]) * COSINES[0][0];
        return [row(value); AREA];
    }
    // Columns, then rows.
    for x in 0..SIDE {
        let of_column = sums(std::array::from_fn(|y| coefficients[y * SIDE + x]));
        (0..SIDE).for_each(|y| values[y * SIDE + x] = column(of_column[y]));
    }
    for y in 0..SIDE {
        let of_row = sums(std::array::from_fn(|x| values[y * SIDE + x]));
        (0..SIDE).for_each(|x| values[y * SIDE + x] = row(of_row[x]));
    }
    values
}

/// The values of a block of 1, 2, 4 or 8 values along each side that shows the same smaller, from the coefficients of
/// lowest frequency of one of 8 x 8: each at most [`MOST`].
pub(super) fn inverse_of(values: &mut [i32], side: usize) {
    if let Ok(all) = <&mut [i32; AREA]>::try_from(&mut *values) {
        *all = inverse(all);
        return;
    }
    // Rows of cosines of fewer values, and a shift for means of squares.
    let (cosines, halvings): (&[i32], u32) = match side {
        4 => (COSINES_OF_FOUR.as_flattened(), 1),
        2 => (COSINES_OF_TWO.as_flattened(), 2),
        _ => (&[4096], 3),
    };
    let sum = |values: &[i32], first: usize, by: usize, n: usize| -> i32 {
        (0..side).map(|k| values[first + k * by] * cosines[k * side + n]).sum()
    };
    let mut columns = [0; AREA / 4];
    for at in 0..side * side {
        columns[at] = column(sum(values, at % side, side, at / side));
    }
    for (at, value) in values.iter_mut().enumerate().take(side * side) {
        *value = row_of(sum(&columns, at / side * side, 1, at % side), halvings);
    }
}

fn row_of(sum: i32, halvings: u32) -> i32 {
    (sum + (1 << (14 + halvings))) >> (15 + halvings)
}

fn column(sum: i32) -> i32 {
    (sum + (1 << 8)) >> 9
}

fn row(sum: i32) -> i32 {
    (sum + (1 << 14)) >> 15
}

/// Four values that are transformed together.
#[cfg(feature = "write")]
type Four = [f32; SIDE / 2];

/// The coefficients of a block, column by column. Columns are transformed four at a time, so that compilers use
/// vectors, and nothing depends on which.
#[cfg(feature = "write")]
pub(super) fn forward(values: &[f32; AREA]) -> [f32; AREA] {
    let halves = std::array::from_fn(|k| [values[4 * k], values[4 * k + 1], values[4 * k + 2], values[4 * k + 3]]);
    let (mut sums, mut result) = ([[0.0; SIDE / 2]; AREA / 4], [0.0; AREA]);
    of_columns(&halves, 0, &mut sums);
    of_columns(&halves, 1, &mut sums);
    let halves = transposed(&sums);
    of_columns(&halves, 0, &mut sums);
    of_columns(&halves, 1, &mut sums);
    result.copy_from_slice(sums.as_flattened());
    result
}

/// The sums of four columns with cosines; rows are two halves each. Those of even rows are symmetric and those of odd
/// ones antisymmetric, and half of the even ones are symmetric again.
#[cfg(feature = "write")]
#[inline(always)]
fn of_columns(halves: &[Four; AREA / 4], half: usize, sums: &mut [Four; AREA / 4]) {
    let plus = |a: Four, b: Four| -> Four { [a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]] };
    let minus = |a: Four, b: Four| -> Four { [a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]] };
    let times = |a: Four, factor: f32| -> Four { [a[0] * factor, a[1] * factor, a[2] * factor, a[3] * factor] };
    let two = |a: Four, b: Four, k: usize, n: usize| plus(times(a, COSINES_OF[k][n]), times(b, COSINES_OF[k][n + 1]));
    let row = |n: usize| halves[2 * n + half];
    let even = [plus(row(0), row(7)), plus(row(1), row(6)), plus(row(2), row(5)), plus(row(3), row(4))];
    let odd = [minus(row(0), row(7)), minus(row(1), row(6)), minus(row(2), row(5)), minus(row(3), row(4))];
    let outer = [plus(even[0], even[3]), plus(even[1], even[2])];
    let inner = [minus(even[0], even[3]), minus(even[1], even[2])];
    let of_odd = |k: usize| plus(two(odd[0], odd[1], k, 0), two(odd[2], odd[3], k, 2));
    sums[half] = two(outer[0], outer[1], 0, 0);
    sums[8 + half] = two(outer[0], outer[1], 4, 0);
    sums[4 + half] = two(inner[0], inner[1], 2, 0);
    sums[12 + half] = two(inner[0], inner[1], 6, 0);
    for k in [1, 3, 5, 7] {
        sums[2 * k + half] = of_odd(k);
    }
}

/// Rows and columns exchanged.
#[cfg(feature = "write")]
#[inline(always)]
fn transposed(halves: &[Four; AREA / 4]) -> [Four; AREA / 4] {
    let mut result = [[0.0; SIDE / 2]; AREA / 4];
    for (y, x) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let row = |k: usize| halves[2 * (4 * y + k) + x];
        let (a, b, c, d) = (row(0), row(1), row(2), row(3));
        for k in 0..4 {
            result[2 * (4 * x + k) + y] = [a[k], b[k], c[k], d[k]];
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_constants_are_cosines_and_the_order_visits_all() {
        for (k, of_k) in COSINES.iter().enumerate() {
            let scale: f64 = if k == 0 { 0.125_f64.sqrt() } else { 0.5 };
            for (n, &c) in of_k.iter().enumerate() {
                let exact = 4096.0 * scale * ((2 * n + 1) as f64 * k as f64 * std::f64::consts::PI / 16.0).cos();
                assert_eq!(f64::from(c), exact.round());
            }
        }
        let mut all = ORDER.to_vec();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..AREA as u8));
    }

    #[test]
    fn extreme_coefficients_do_not_overflow() {
        for sign in [1, -1] {
            inverse(&[sign * MOST; AREA]);
            let alternating = std::array::from_fn(|k| if k % 3 == 0 { sign * MOST } else { -sign * MOST });
            inverse(&alternating);
        }
    }

    #[cfg(feature = "write")]
    #[test]
    fn blocks_come_back() {
        let values: [f32; AREA] = std::array::from_fn(|k| ((k * 37 + k * k * 11) % 255) as f32 - 128.0);
        let coefficients = forward(&values);
        let coefficients = std::array::from_fn(|at| coefficients[at % SIDE * SIDE + at / SIDE].round() as i32);
        let back = inverse(&coefficients);
        for (a, b) in values.iter().zip(back) {
            assert!((a - b as f32).abs() <= 2.0, "{a} {b}");
        }
        let flat = forward(&[77.0; AREA]).map(|c| c.round() as i32);
        assert_eq!(inverse(&flat), [77; AREA]);
    }
}
