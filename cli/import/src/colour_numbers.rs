//! Colours as numbers whose range their file does not say: from 0 to 1, or from 0 to 255.

/// What the colours of a file have in common, as far as they have been seen.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ColourNumbers {
    largest: f64,
    largest_alpha: f64,
    /// Whether some number is not whole, below 0, or above 255.
    has_others: bool,
}

/// What the numbers of colours and of alpha are when they are full.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ColourRange {
    pub colour: f64,
    pub alpha: f64,
}

impl Default for ColourRange {
    fn default() -> Self {
        Self { colour: 1.0, alpha: 1.0 }
    }
}

impl ColourRange {
    /// Whether numbers go up to 255.
    pub fn are_bytes(self) -> bool {
        self.colour > 1.0
    }
}

/// What is noted where they do.
pub(super) const ARE_BYTES: &str = "colours are whole numbers up to 255: they are read as numbers of 8 bits";

impl ColourNumbers {
    /// Adds red, green, blue and alpha, or some of them.
    pub fn add(&mut self, colour: &[f64]) {
        for (place, &value) in colour.iter().take(4).enumerate() {
            let largest = if place < 3 { &mut self.largest } else { &mut self.largest_alpha };
            *largest = largest.max(value);
            // Alpha may be a share beside bytes.
            self.has_others |= !(value.fract() == 0.0 || place == 3) || !(0.0..=255.0).contains(&value);
        }
    }

    /// Whether the numbers go up to 1, whatever follows.
    pub fn are_shares(&self) -> bool {
        self.has_others
    }

    /// The largest number, alpha included.
    pub fn largest(&self) -> f64 {
        self.largest.max(self.largest_alpha)
    }

    /// The range of the numbers.
    pub fn range(&self) -> ColourRange {
        let full = |largest: f64| if largest > 1.0 { 255.0 } else { 1.0 };
        if self.has_others || self.largest <= 1.0 {
            return ColourRange::default();
        }
        ColourRange { colour: 255.0, alpha: full(self.largest_alpha) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_numbers_beyond_1_are_bytes() {
        for (colours, [colour, alpha]) in [
            (&[[0.0, 0.0, 0.0, 0.0], [128.0, 64.0, 32.0, 255.0]][..], [255.0, 255.0]),
            (&[[128.0, 64.0, 32.0, 0.5], [1.0, 1.0, 1.0, 1.0]], [255.0, 1.0]),
            (&[[1.0, 0.0, 1.0, 1.0]], [1.0, 1.0]),
            (&[[128.0, 64.0, 32.5, 255.0]], [1.0, 1.0]),
            (&[[256.0, 64.0, 32.0, 255.0]], [1.0, 1.0]),
            (&[[-1.0, 64.0, 32.0, 255.0]], [1.0, 1.0]),
            (&[[f64::NAN, 64.0, 32.0, 255.0]], [1.0, 1.0]),
        ] {
            let mut numbers = ColourNumbers::default();
            colours.iter().for_each(|colour| numbers.add(colour));
            assert_eq!(numbers.range(), ColourRange { colour, alpha }, "{colours:?}");
        }
    }
}
