//! Which part of an image a surface shows.

use std::ops::Range;

use lodpack_mesh::appearance::{TextureUse, Wrap};

/// The range of the texture coordinates of a file's records, of one set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvBounds {
    low: [f32; 2],
    high: [f32; 2],
    /// Whether some record has none. Then nothing is known.
    has_missing: bool,
}

impl Default for UvBounds {
    fn default() -> Self {
        Self { low: [f32::INFINITY; 2], high: [f32::NEG_INFINITY; 2], has_missing: false }
    }
}

impl UvBounds {
    /// Where records are missing.
    pub const UNKNOWN: Self = Self { low: [0.0; 2], high: [0.0; 2], has_missing: true };

    /// Adds the coordinates of a record.
    #[inline]
    pub fn add(&mut self, uv: [f32; 2]) {
        for k in 0..2 {
            self.low[k] = self.low[k].min(uv[k]);
            self.high[k] = self.high[k].max(uv[k]);
        }
        self.has_missing |= !(uv[0].is_finite() && uv[1].is_finite());
    }

    /// The columns and rows of texels that these places show, with those that they are blended with. None if they may
    /// be anywhere.
    pub fn texels(&self, texture: &TextureUse, size: [u32; 2]) -> Option<[Range<u32>; 2]> {
        if self.has_missing || self.low[0] > self.high[0] {
            return None;
        }
        let [low, high] = [self.low, self.high].map(|uv| uv.map(f64::from));
        let rows = texture.transform.unwrap_or([1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).map(f64::from);
        let mut ranges = [0..size[0], 0..size[1]];
        for (axis, range) in ranges.iter_mut().enumerate() {
            let [a, b, c] = [rows[3 * axis], rows[3 * axis + 1], rows[3 * axis + 2]];
            let ends = [a * low[0], a * high[0], b * low[1], b * high[1]];
            let first = c + ends[0].min(ends[1]) + ends[2].min(ends[3]);
            let last = c + ends[0].max(ends[1]) + ends[2].max(ends[3]);
            *range = shown([first, last], size[axis], texture.wrap[axis])?;
        }
        Some(ranges)
    }
}

/// The texels that places between two show along an axis; a texel more at each end, for whatever rounding does.
fn shown([first, last]: [f64; 2], count: u32, wrap: Wrap) -> Option<Range<u32>> {
    let length = f64::from(count);
    let whole = match wrap {
        Wrap::Clamp => 0.0,
        // One copy of the image, or all of it.
        Wrap::Repeat | Wrap::Mirror => first.floor(),
    };
    let [first, last] = match wrap {
        Wrap::Mirror if whole.rem_euclid(2.0) != 0.0 => [1.0 - (last - whole), 1.0 - (first - whole)],
        _ => [first - whole, last - whole],
    };
    let [low, high] = [first * length - 1.5, last * length + 1.5];
    if !(low.is_finite() && high.is_finite()) {
        return None;
    }
    let reaches_beyond = low < 0.0 || high > length;
    if reaches_beyond && wrap == Wrap::Repeat || last > 1.0 && wrap == Wrap::Mirror {
        return Some(0..count);
    }
    let last_texel = count.saturating_sub(1);
    // A negative number becomes 0.
    Some((low as u32).min(last_texel)..(high.ceil() as u32).clamp(1, count))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_show_the_texels_around_them() {
        assert_eq!(shown([0.5, 0.5], 100, Wrap::Repeat), Some(48..52));
        assert_eq!(shown([7.5, 7.6], 100, Wrap::Repeat), Some(48..62));
        assert_eq!(shown([-0.5, -0.4], 100, Wrap::Mirror), Some(38..52));
        assert_eq!(shown([0.5, 1.5], 100, Wrap::Mirror), Some(0..100));
        // Beside a border lies the other one, or nothing else.
        assert_eq!(shown([0.01, 0.02], 100, Wrap::Repeat), Some(0..100));
        assert_eq!(shown([0.01, 0.02], 100, Wrap::Mirror), Some(0..4));
        assert_eq!(shown([-3.0, -2.0], 100, Wrap::Clamp), Some(0..1));
        assert_eq!(shown([2.0, 3.0], 100, Wrap::Clamp), Some(99..100));
        assert_eq!(shown([f64::NEG_INFINITY, 3.0], 100, Wrap::Clamp), None);
    }

    #[test]
    fn transforms_come_first_and_missing_places_are_anywhere() {
        let mut texture = TextureUse { image: 0, uv_set: 0, wrap: [Wrap::Repeat; 2], transform: None };
        let mut bounds = UvBounds::default();
        assert_eq!(bounds.texels(&texture, [100; 2]), None);
        bounds.add([0.25, 0.5]);
        bounds.add([0.5, 0.5]);
        assert_eq!(bounds.texels(&texture, [100; 2]), Some([23..52, 48..52]));
        texture.transform = Some([0.0, 0.5, 0.0, -1.0, 0.0, 1.0]);
        assert_eq!(bounds.texels(&texture, [100; 2]), Some([23..27, 48..77]));
        bounds.add([f32::NAN, 0.5]);
        assert_eq!(bounds.texels(&texture, [100; 2]), None);
    }
}
