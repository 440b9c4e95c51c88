//! Rectangles of the image over the heights: which texels a part of the grid needs, and where they are.

use super::section::Drape;
use crate::codec::texels::Image;

/// How far beyond the image something may reach and still count as within, in texels.
const ROUNDING: f64 = 1e-6;

/// Texels of the image over the heights, halved some times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrapeWindow {
    /// How often the image is halved along each side: 0 for all that there is.
    pub halvings: u8,
    /// Column and row of its first texel. One before the image, or behind it, is transparent.
    pub first: [i64; 2],
    /// Texels in a row, and rows.
    pub size: [u32; 2],
}

/// A piece of the image over the heights, and where it is.
#[derive(Clone, Debug, PartialEq)]
pub struct DrapeImage {
    /// Red, green and blue as screens show them (sRGB), and straight opacity as a fourth component where a part of it
    /// is not covered.
    pub image: Image<u8>,
    /// Where the corner of its first texel is, in columns and rows of samples.
    pub first: [f64; 2],
    /// Columns and rows of samples from a texel to the next one.
    pub spacing: [f64; 2],
}

impl DrapeImage {
    /// The place in texels of a place in columns and rows: the first texel lies between 0 and 1.
    pub fn place(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (place[axis] - self.first[axis]) / self.spacing[axis])
    }

    /// The colour at a place in columns and rows, interpolated, over another one where it is not opaque.
    pub fn over(&self, place: [f64; 2], below: [u8; 3]) -> [u8; 3] {
        let shown = self.image.interpolated(self.place(place));
        let opacity = if self.image.components == 4 { shown[3] / 255.0 } else { 1.0 };
        [0, 1, 2].map(|k| (shown[k] * opacity + f64::from(below[k]) * (1.0 - opacity) + 0.5) as u8)
    }
}

impl Drape {
    /// The texels that show a part of the grid, given by its first and last column and row, when they are interpolated;
    /// none if the image does not cover any of it. Where it covers a part, a border of transparent texels is among
    /// them.
    pub fn window(&self, columns: [f64; 2], rows: [f64; 2], halvings: u8) -> Option<DrapeWindow> {
        let halvings = halvings.min(self.most_halvings());
        let (scale, size) = ((1_u64 << halvings) as f64, self.size_at(halvings));
        let (mut first, mut counts) = ([0; 2], [0; 2]);
        for (axis, ends) in [columns, rows].into_iter().enumerate() {
            let [from, to] = ends.map(|at| (at - self.first[axis]) / self.spacing[axis] + 0.5);
            let whole = self.size[axis] as f64;
            // Not as numbers that are not finite.
            if !(from <= to && to > 0.0 && from < whole) {
                return None;
            }
            let last = size[axis] as i64 - 1;
            // Numbers beyond what an integer holds become its ends.
            let mut low = ((from / scale - 0.5).floor() as i64).clamp(0, last);
            let mut high = ((to / scale - 0.5).floor() as i64).saturating_add(1).clamp(low, last);
            low -= i64::from(from < -ROUNDING);
            high += i64::from(to > whole + ROUNDING);
            (first[axis], counts[axis]) = (low, u32::try_from(high - low + 1).ok()?);
        }
        Some(DrapeWindow { halvings, first, size: counts })
    }

    /// As [`Self::window`], with as few halvings as leave at most `most` texels, and two more, along each side.
    pub fn window_of_size(&self, columns: [f64; 2], rows: [f64; 2], most: u32) -> Option<DrapeWindow> {
        let texels = [(columns, 0), (rows, 1)].map(|([from, to], axis): ([f64; 2], usize)| {
            let within =
                |at: f64| ((at - self.first[axis]) / self.spacing[axis] + 0.5).clamp(0.0, self.size[axis] as f64);
            within(to) - within(from)
        });
        let texels = texels[0].max(texels[1]);
        let fits = |halvings: &u8| texels / (1_u64 << halvings) as f64 <= f64::from(most.max(1));
        let halvings = (0..=self.most_halvings()).find(fits).unwrap_or(self.most_halvings());
        self.window(columns, rows, halvings)
    }

    /// How often the image may be halved so that its texels are at most as large as this, in columns and rows of
    /// samples.
    pub fn halvings_for(&self, texel: f64) -> u8 {
        let own = self.spacing[0].max(self.spacing[1]);
        let fits = |halvings: &u8| own * (1_u64 << halvings) as f64 <= texel;
        (0..=self.most_halvings()).rev().find(fits).unwrap_or(0)
    }

    /// Where the texels of a window are.
    pub(super) fn place(&self, window: &DrapeWindow, image: Image<u8>) -> DrapeImage {
        let scale = (1_u64 << window.halvings.min(62)) as f64;
        let spacing = self.spacing.map(|x| x * scale);
        let first =
            [0, 1].map(|axis| self.first[axis] - 0.5 * self.spacing[axis] + window.first[axis] as f64 * spacing[axis]);
        DrapeImage { image, first, spacing }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_have_what_interpolation_takes_and_a_border_where_the_image_ends() {
        let drape = Drape { size: [100, 80], first: [0.0, 0.0], spacing: [0.5, 0.5], components: 3, side_log2: 3 };
        // Texel 20 has its centre at column 10, where only it counts; the next one is there for what lies behind.
        let window = drape.window([10.0, 20.0], [0.0, 5.25], 0).unwrap();
        assert_eq!(window, DrapeWindow { halvings: 0, first: [20, 0], size: [22, 12] });
        let window = drape.window([10.0, 20.0], [-1.0, 60.0], 0).unwrap();
        assert_eq!((window.first, window.size), ([20, -1], [22, 82]));
        let window = drape.window([10.0, 20.0], [0.0, 39.5], 1).unwrap();
        assert_eq!((window.first, window.size), ([9, 0], [12, 40]));
        assert_eq!(drape.window([60.0, 70.0], [0.0, 5.0], 0), None);
        assert_eq!(drape.window([f64::NAN, 70.0], [0.0, 5.0], 0), None);
        assert_eq!(drape.window([-1e300, 1e300], [0.0, 5.0], 0).unwrap().size, [102, 12]);
        assert_eq!(drape.window_of_size([0.0, 49.5], [0.0, 39.5], 30).unwrap().halvings, 2);
        assert_eq!([0.4, 0.5, 1.1, 1e9].map(|texel| drape.halvings_for(texel)), [0, 0, 1, 9]);
    }

    #[test]
    fn places_are_those_of_the_grid() {
        let drape = Drape { size: [100, 80], first: [3.0, -2.0], spacing: [0.25, 0.5], components: 3, side_log2: 3 };
        for halvings in 0..4 {
            let window = drape.window([10.0, 20.0], [1.0, 7.0], halvings).unwrap();
            let placed = drape.place(&window, Image::filled(window.size, &[0, 0, 0]));
            let [x, y] = placed.place([12.5, 3.0]);
            let of = |at: f64, first: f64, spacing: f64| ((at - first) / spacing + 0.5) / f64::from(1 << halvings);
            assert!((x + window.first[0] as f64 - of(12.5, 3.0, 0.25)).abs() < 1e-12);
            assert!((y + window.first[1] as f64 - of(3.0, -2.0, 0.5)).abs() < 1e-12);
        }
    }
}
