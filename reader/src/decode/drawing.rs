//! How a surface is drawn: what the alpha of its colour means, whether its back is seen, and whether light falls on it
//! (SPEC.md, 21.6).

use super::ChannelImage;

/// The alpha from which on a masked surface is there, unless its drawing has another one.
pub const DEFAULT_CUTOFF: f64 = 0.5;
/// The largest number that stands for a cutoff.
const LAST_CUTOFF: u16 = 4095;

/// What the alpha of a colour means.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub enum AlphaMode {
    /// Nothing: the surface is opaque.
    #[default]
    Opaque,
    /// The surface is there where alpha is at least this.
    Mask(f64),
    /// The share of light that the surface stops.
    Blend,
}

/// How a surface is drawn. What files that do not say it are drawn like is the default: opaque, lit, seen from its
/// front.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
pub struct Drawing {
    /// What alpha means.
    pub alpha: AlphaMode,
    /// Whether its back is seen, too.
    pub is_double_sided: bool,
    /// Whether its colour is shown without light.
    pub is_unlit: bool,
}

impl Drawing {
    /// The drawing that a number of a channel of kind [`crate::index::ChannelKind::Drawing`] stands for. Every number
    /// stands for one.
    pub fn of_number(number: u16) -> Self {
        let cutoff = match number >> 4 {
            0 => DEFAULT_CUTOFF,
            thousandths => f64::from(thousandths - 1) / 1000.0,
        };
        let alpha = match number >> 2 & 3 {
            1 => AlphaMode::Mask(cutoff),
            2 => AlphaMode::Blend,
            _ => AlphaMode::Opaque,
        };
        Self { alpha, is_double_sided: number & 1 != 0, is_unlit: number & 2 != 0 }
    }

    /// The smallest number that stands for it. Cutoffs are rounded to thousandths, and end at 4.094.
    pub fn number(self) -> u16 {
        let alpha = match self.alpha {
            AlphaMode::Opaque => 0,
            AlphaMode::Mask(cutoff) if cutoff == DEFAULT_CUTOFF => 4,
            // The conversion saturates, and what is no number becomes 0.
            AlphaMode::Mask(cutoff) => {
                4 | ((cutoff * 1000.0).round() as u16).min(LAST_CUTOFF - 1).saturating_add(1) << 4
            }
            AlphaMode::Blend => 8,
        };
        alpha | u16::from(self.is_unlit) << 1 | u16::from(self.is_double_sided)
    }
}

/// Bits of a coverage: whether the surface is either there or not, which one half of the coverage decides; and whether
/// light falls on it. Otherwise the coverage is the share of light that it stops.
const IS_COMPARED: u8 = 1;
const IS_LIT: u8 = 2;

impl Drawing {
    /// How much of a texel of this opacity is there, as a byte that is never 0: 255 where it is opaque and lit. The
    /// lowest bit says that the surface is there from 128 on, and not below. Without it, the byte is the share of light
    /// that the surface stops. The next bit says that it is lit.
    pub fn coverage(self, opacity: u8) -> u8 {
        let (coverage, compared) = match self.alpha {
            AlphaMode::Opaque => (255, IS_COMPARED),
            AlphaMode::Mask(cutoff) => (compared_with(cutoff, opacity), IS_COMPARED),
            AlphaMode::Blend => (opacity, 0),
        };
        let lit = if self.is_unlit { 0 } else { IS_LIT };
        (coverage & !(IS_COMPARED | IS_LIT)).max(4) | compared | lit
    }
}

/// An opacity so that 128 stands for the cutoff. What lies between is interpolated, so that outlines between texels
/// stay where they are.
fn compared_with(cutoff: f64, opacity: u8) -> u8 {
    let opacity = f64::from(opacity) / 255.0;
    if opacity < cutoff {
        (127.0 * opacity / cutoff) as u8
    } else if cutoff < 1.0 {
        (128.0 + 127.0 * (opacity - cutoff) / (1.0 - cutoff)) as u8
    } else {
        255
    }
}

/// The coverages of all texels of colours ([`Drawing::coverage`]), given the image of drawings beside it; none unless
/// both are what they should be, and of one size.
pub fn coverages(colours: &ChannelImage, drawings: &ChannelImage) -> Option<Vec<u8>> {
    let (ChannelImage::Colours(colours), ChannelImage::Values(drawings)) = (colours, drawings) else { return None };
    let opacities = colours.data.chunks_exact(colours.components.max(1).into());
    let opacities = opacities.map(|texel| texel.get(3).copied().unwrap_or(255));
    let coverage = |(opacity, &number): (u8, &u16)| Drawing::of_number(number).coverage(opacity);
    (colours.size == drawings.size).then(|| opacities.zip(&drawings.data).map(coverage).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::texels::Image;

    #[test]
    fn every_number_stands_for_a_drawing_and_every_drawing_for_its_smallest_number() {
        for number in 0..=u16::MAX {
            let drawing = Drawing::of_number(number);
            let smallest = drawing.number();
            assert!(smallest <= number, "{number}: {drawing:?}");
            assert_eq!(Drawing::of_number(smallest), drawing, "{number}");
        }
        assert_eq!((Drawing::default().number(), Drawing::of_number(0)), (0, Drawing::default()));
    }

    #[test]
    fn coverages_say_how_texels_are_drawn() {
        let lit = Drawing::default();
        let unlit = Drawing { is_unlit: true, ..lit };
        assert_eq!([lit.coverage(0), lit.coverage(255), unlit.coverage(7)], [255, 255, 253]);
        for cutoff in [0.0, 0.2, 0.5, 0.75, 1.0, 2.0] {
            let masked = Drawing { alpha: AlphaMode::Mask(cutoff), ..lit };
            for opacity in 0..=255 {
                let coverage = masked.coverage(opacity);
                let is_there = f64::from(opacity) / 255.0 >= cutoff;
                assert_eq!((coverage >= 128, coverage & 3), (is_there, 3), "{opacity} of {cutoff}");
            }
        }
        let blended = Drawing { alpha: AlphaMode::Blend, ..unlit };
        assert_eq!([0, 3, 100, 255].map(|opacity| blended.coverage(opacity)), [4, 4, 100, 252]);
        let image = |data: &[u8]| ChannelImage::Colours(Image { size: [2, 1], components: 4, data: data.into() });
        let drawings = ChannelImage::Values(Image { size: [2, 1], components: 1, data: vec![0, 8] });
        let colours = image(&[1, 2, 3, 0, 1, 2, 3, 80]);
        assert_eq!(coverages(&colours, &drawings), Some(vec![255, 82]));
        assert_eq!(coverages(&drawings, &colours), None);
    }

    #[test]
    fn cutoffs_are_thousandths() {
        let read = |cutoff: f64| {
            let masked = Drawing { alpha: AlphaMode::Mask(cutoff), ..Drawing::default() };
            match Drawing::of_number(masked.number()).alpha {
                AlphaMode::Mask(cutoff) => cutoff,
                other => panic!("{cutoff} became {other:?}"),
            }
        };
        for (cutoff, expected) in [(0.5, 0.5), (0.0, 0.0), (0.33, 0.33), (1.0, 1.0), (1e9, 4.094), (-1.0, 0.0)] {
            assert_eq!(read(cutoff), expected);
        }
        assert_eq!(read(f64::NAN), 0.0);
    }
}
