//! Weights of interpolation between uneven lines (SPEC.md, "Predicted heights").

/// Weights are multiples of 1 / 4096.
pub(super) const WEIGHT_BITS: u32 = 12;
/// Distances of lines are brought below this power of two, so that products of three fit.
const DISTANCE_BITS: u32 = 16;

/// Up to four lines, and how much each counts. Unused entries have weight 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Stencil {
    /// Index coordinates.
    pub at: [usize; 4],
    /// In 1/4096; the sum is 4096.
    pub weights: [i64; 4],
}

impl Stencil {
    /// The polynomial through the lines at index coordinates `near`, at the line `middle`. Lines on which another one lies that comes
    /// before them are left out, and none lies on `middle`.
    pub fn new(lines: &[u64], middle: usize, near: impl IntoIterator<Item = usize>) -> Self {
        let (mut this, mut distances, mut count) = (Self::default(), [0_i64; 4], 0);
        for at in near {
            let distance = lines[at] as i64 - lines[middle] as i64;
            if count < 4 && distance != 0 && !distances[..count].contains(&distance) {
                (this.at[count], distances[count]) = (at, distance);
                count += 1;
            }
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
    #[inline]
    pub fn apply(&self, value: impl Fn(usize) -> i64) -> i64 {
        let [a, b, c, d] = self.at.map(value);
        let [i, j, k, l] = self.weights;
        a * i + b * j + c * k + d * l
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn polynomials_are_met() {
        let even: Vec<u64> = (0..7).map(|k| k << 28).collect();
        for lines in [vec![0, 1, 2, 3, 4, 5, 6], even] {
            let stencil = Stencil::new(&lines, 3, [2, 4, 0, 6]);
            assert_eq!(stencil, Stencil { at: [2, 4, 0, 6], weights: [2304, 2304, -256, -256] });
        }
        let lines = [10, 11, 11, 13, 14, 17];
        let stencil = Stencil::new(&lines, 3, [2, 4, 1, 5]);
        assert_eq!((stencil.at, stencil.weights[3]), ([2, 4, 5, 0], 0));
        let square = stencil.apply(|k| (lines[k] * lines[k]) as i64 * 1000);
        assert!((square - 169_000 * 4096).abs() < 4096 * 300, "{square}");
        assert_eq!(Stencil::new(&lines, 3, [4]).weights, [4096, 0, 0, 0]);
        assert_eq!(Stencil::new(&lines, 1, [2, 0]).at[0], 0);
    }
}
