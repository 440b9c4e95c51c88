//! Weights of interpolation between uneven lines (SPEC.md, "Predicted heights").

/// Weights are multiples of 1 / 4096.
pub(super) const WEIGHT_BITS: u32 = 12;
/// Distances of lines are brought below this power of two, so that products of three fit.
const DISTANCE_BITS: u32 = 16;

/// The weights of four even lines.
const EVEN: [i64; 4] = [2304, 2304, -256, -256];

/// Up to four lines, and how much each counts. Unused entries have weight 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Stencil {
    /// Index coordinates.
    pub at: [usize; 4],
    /// In 1/4096; the sum is 4096.
    pub weights: [i64; 4],
}

impl Stencil {
    /// The polynomial through lines at index coordinates, at the line `middle`: the `near` ones on both sides, and
    /// those `far` ones that are at least twice as far away as the near one on their side. Others are too close to it:
    /// what they differ by would count too much.
    pub fn new(lines: &[u64], middle: usize, near: [usize; 2], far: impl IntoIterator<Item = usize>) -> Self {
        let distance = |at: usize| lines[at] as i64 - lines[middle] as i64;
        let (mut this, mut distances, mut count) = (Self::default(), [0_i64; 4], 2);
        for k in 0..2 {
            (this.at[k], distances[k]) = (near[k], distance(near[k]));
        }
        for at in far {
            let distance = distance(at);
            if count < 4 && distance.abs() >= 2 * distances[usize::from(distance > 0)].abs() {
                (this.at[count], distances[count]) = (at, distance);
                count += 1;
            }
        }
        let gap = distances[1];
        if distances == [-gap, gap, -3 * gap, 3 * gap] {
            return Self { weights: EVEN, ..this };
        }
        let distances = &mut distances[..count];
        let widest = distances.iter().map(|distance| distance.unsigned_abs()).max().unwrap_or(0);
        let shift = (u64::BITS - widest.leading_zeros()).saturating_sub(DISTANCE_BITS);
        distances.iter_mut().for_each(|distance| *distance >>= shift);
        for (k, &own) in distances.iter().enumerate() {
            let (mut above, mut below) = (1_i64, 1_i64);
            for (_, &other) in distances.iter().enumerate().filter(|&(other, _)| other != k) {
                above *= -other;
                below *= own - other;
            }
            if below < 0 {
                (above, below) = (-above, -below);
            }
            this.weights[k] = ((above << (WEIGHT_BITS + 1)) + below).div_euclid(2 * below.max(1));
        }
        // Rounding is made up for at the nearest line.
        this.weights[0] += (1 << WEIGHT_BITS) - this.weights.iter().sum::<i64>();
        this
    }

    /// The value, times 4096, from those at the lines.
    #[inline(always)]
    pub fn apply(&self, value: impl Fn(usize) -> i64) -> i64 {
        let ([a, b, c, d], [i, j, k, l]) = (self.at, self.weights);
        value(a) * i + value(b) * j + value(c) * k + value(d) * l
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_met() {
        let even: Vec<u64> = (0..7).map(|k| k << 28).collect();
        for lines in [vec![0, 1, 2, 3, 4, 5, 6], even] {
            let stencil = Stencil::new(&lines, 3, [2, 4], [0, 6]);
            assert_eq!(stencil, Stencil { at: [2, 4, 0, 6], weights: EVEN });
        }
        let lines = [10, 11, 12, 13, 14, 15];
        assert_eq!(Stencil::new(&lines, 1, [0, 2], [4]).weights, [1536, 3072, -512, 0]);
        // The last line is no further from the one before it than that from the middle.
        let lines = [0, 1, 2, 3, 4, 5, 5];
        let stencil = Stencil::new(&lines, 3, [2, 4], [0, 6]);
        assert_eq!((stencil.at, stencil.weights), ([2, 4, 0, 6], [2048, 3072, -205, -819]));
        let square = stencil.apply(|k| (lines[k] * lines[k]) as i64 * 1000);
        assert!((square - 9000 * 4096).abs() < 4096 * 30, "{square}");
        let lines = [0, 1000, 2000, 3000, 4000, 4999, 4999].map(|line| line << 20);
        assert_eq!(Stencil::new(&lines, 3, [2, 4], [0, 6]).weights[3], 0);
        let lines = [0, 1 << 20, 2 << 20, 3 << 20, (3 << 20) + 1];
        assert_eq!(Stencil::new(&lines, 3, [2, 4], [0]).weights, [0, 4096, 0, 0]);
    }
}
