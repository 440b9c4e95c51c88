//! The colours in which the values of a channel are shown, so that all viewers show the same.

use super::ChannelImage;
use crate::index::{ChannelInfo, ChannelKind};

/// Red, green, blue and opacity, as screens show them (sRGB).
type Rgba = [u8; 4];

/// Colours of growing brightness, which stay apart for those who do not see all colours: viridis.
const RAMP: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];
/// The largest number of an image.
const LARGEST: f64 = 65535.0;

/// How values become colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// They are colours, or factors, which are grey.
    Colours,
    /// They are directions. As colours, components from -1 to 1 become 1 to 255.
    Directions,
    /// They are numbers. The first one gets a colour of the ramp.
    Ramp,
    /// They are classes. Each has a colour of its own, and nothing lies between two.
    Classes,
}

/// How a channel is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    kind: ChannelKind,
    low: f64,
    step: f64,
    /// The numbers of images that have the first and the last colour of the ramp.
    pub range: [f64; 2],
}

impl Appearance {
    /// That of a channel, with a ramp for all numbers that there could be.
    pub fn new(channel: &ChannelInfo) -> Self {
        Self { kind: channel.kind, low: channel.low, step: channel.step, range: [0.0, LARGEST] }
    }

    /// How values become colours.
    pub fn look(&self) -> Look {
        match self.kind {
            ChannelKind::Colour | ChannelKind::Factor => Look::Colours,
            ChannelKind::Normal => Look::Directions,
            ChannelKind::Label | ChannelKind::Drawing => Look::Classes,
            _ => Look::Ramp,
        }
    }

    /// The values of the ends of the ramp; none if there is no ramp.
    pub fn values(&self) -> Option<[f64; 2]> {
        (self.look() == Look::Ramp).then(|| self.range.map(|number| self.low + number * self.step))
    }

    /// Gives the ends of the ramp these values.
    pub fn set_values(&mut self, values: [f64; 2]) {
        self.range = values.map(|value| (value - self.low) / self.step);
    }

    /// Gives the ends of the ramp the smallest and the largest first number of these images. Without two different ones
    /// it stays.
    pub fn fit<'i>(&mut self, images: impl IntoIterator<Item = &'i ChannelImage>) {
        let (mut low, mut high) = (LARGEST, 0.0_f64);
        for image in images {
            if let ChannelImage::Values(image) = image {
                for &number in image.data.iter().step_by(usize::from(image.components.max(1))) {
                    (low, high) = (low.min(number.into()), high.max(number.into()));
                }
            }
        }
        if low < high {
            self.range = [low, high];
        }
    }

    /// The colour of a texel whose numbers are these. Colours of fewer than three components are grey; opacity is left
    /// out.
    pub fn colour(&self, numbers: &[f64]) -> Rgba {
        let first = numbers.first().copied().unwrap_or(0.0);
        match self.kind {
            ChannelKind::Colour | ChannelKind::Normal | ChannelKind::Factor => {
                let byte = |k: usize| numbers.get(k).copied().unwrap_or(first).round() as u8;
                [byte(0), byte(1), byte(2), 255]
            }
            ChannelKind::Label | ChannelKind::Drawing => class_colour(first as u16),
            _ => self.ramp(first),
        }
    }

    fn ramp(&self, number: f64) -> Rgba {
        let [low, high] = self.range;
        let share = (number - low) / (high - low).max(1e-6);
        // What is no number is dark.
        let x = if share > 0.0 { share.min(1.0) } else { 0.0 } * (RAMP.len() - 1) as f64;
        let before = (x as usize).min(RAMP.len() - 2);
        let t = x - before as f64;
        let byte = |k: usize| (RAMP[before][k] * (1.0 - t) + RAMP[before + 1][k] * t).round() as u8;
        [byte(0), byte(1), byte(2), 255]
    }

    /// Appends the colours of an image, texel after texel.
    pub fn paint(&self, image: &ChannelImage, out: &mut Vec<u8>) {
        match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                self.paint_all(&image.data, image.components, out)
            }
            ChannelImage::Values(image) => self.paint_all(&image.data, image.components, out),
        }
    }

    fn paint_all<T: Copy + Into<f64>>(&self, data: &[T], components: u8, out: &mut Vec<u8>) {
        let components = usize::from(components.max(1));
        out.reserve(data.len() / components * 4);
        let mut numbers = [0.0; 4];
        for texel in data.chunks_exact(components) {
            numbers.iter_mut().zip(texel).for_each(|(to, &number)| *to = number.into());
            out.extend(self.colour(numbers.get(..components).unwrap_or(&numbers)));
        }
    }
}

/// Neighbouring numbers have colours far apart: the golden ratio of the circle.
fn class_colour(number: u16) -> Rgba {
    let h = (f64::from(number) * 0.618_034).fract() * 6.0;
    let part = |shift: f64| {
        let x = (((h + shift) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
        (255.0 * (0.35 + 0.6 * x)) as u8
    };
    [part(0.0), part(4.0), part(2.0), 255]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::texels::Image;

    fn appearance(kind: ChannelKind) -> Appearance {
        Appearance::new(&ChannelInfo {
            name: "x".into(),
            kind,
            is_exact: false,
            is_scaled: false,
            components: 1,
            low: -1.0,
            step: 0.5,
            bound: 0.0,
        })
    }

    #[test]
    fn numbers_go_up_the_ramp_and_stay_within_it() {
        let mut shown = appearance(ChannelKind::Scalar);
        let image = |data: &[u16]| ChannelImage::Values(Image { size: [3, 1], components: 2, data: data.into() });
        shown.fit([&image(&[10, 0, 20, 0, 30, 900])]);
        assert_eq!((shown.range, shown.values()), ([10.0, 30.0], Some([4.0, 14.0])));
        assert_eq!(shown.colour(&[10.0]), [68, 1, 84, 255]);
        assert_eq!(shown.colour(&[20.0]), [33, 145, 140, 255]);
        assert_eq!([shown.colour(&[-5.0]), shown.colour(&[f64::NAN])], [shown.colour(&[10.0]); 2]);
        assert_eq!(shown.colour(&[99.0]), [253, 231, 37, 255]);
        let mut painted = vec![];
        shown.paint(&image(&[10, 7, 20, 7, 30, 7]), &mut painted);
        assert_eq!(painted, [68, 1, 84, 255, 33, 145, 140, 255, 253, 231, 37, 255]);
        shown.set_values([0.0, 1.0]);
        assert_eq!(shown.range, [2.0, 4.0]);
        // One number has no range.
        shown.fit([&image(&[7; 6])]);
        assert_eq!(shown.range, [2.0, 4.0]);
    }

    #[test]
    fn colours_stay_and_directions_and_classes_get_some() {
        assert_eq!(appearance(ChannelKind::Colour).colour(&[1.0, 2.0, 3.0, 4.0]), [1, 2, 3, 255]);
        assert_eq!(appearance(ChannelKind::Colour).colour(&[10.0]), [10, 10, 10, 255]);
        assert_eq!(appearance(ChannelKind::Normal).colour(&[4.0, 2.0, 9.0]), [4, 2, 9, 255]);
        assert_ne!(appearance(ChannelKind::Label).colour(&[1.0]), appearance(ChannelKind::Label).colour(&[2.0]));
        assert_eq!(appearance(ChannelKind::Label).values(), None);
    }
}
