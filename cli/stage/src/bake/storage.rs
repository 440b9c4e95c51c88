//! What each channel stores of a point, and how points are packed until coarser patches need them.

use super::lanes::{LANES, whole};

/// What a channel means, and how its values are stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stored {
    /// A colour in linear light: three values, or four with straight opacity. Texels have as many components, as
    /// screens encode them, quantised with a step, of 255.
    Colour {
        /// 3 or 4.
        components: u8,
        /// The step of quantisation, of 255; 0 keeps texels as they are.
        step: u8,
    },
    /// A direction of any length: three values.
    Normal {
        /// The step of quantisation, of 255; 0 keeps texels as they are.
        step: u8,
    },
    /// A number from 0 to 1: one value.
    Factor {
        /// The step of quantisation, of 255; 0 keeps texels as they are.
        step: u8,
    },
    /// A number, NaN where there is none.
    Scalar {
        /// The value of number 0.
        low: f64,
        /// What each number adds.
        step: f64,
    },
    /// The number of a class, NaN where there is none. A texel has the one that most of it has.
    Label {
        /// The smallest number.
        low: f64,
    },
}

impl Stored {
    /// Whether texels of a colour, a normal or a factor come back as they are.
    pub fn is_exact(self) -> bool {
        matches!(self, Self::Colour { step: 0, .. } | Self::Normal { step: 0 } | Self::Factor { step: 0 })
    }

    /// Values of a point.
    pub fn values(self) -> usize {
        match self {
            Self::Colour { components, .. } => usize::from(components).max(3),
            Self::Normal { .. } => 3,
            Self::Factor { .. } | Self::Scalar { .. } | Self::Label { .. } => 1,
        }
    }

    /// Bytes of packed values.
    fn packed_bytes(self) -> usize {
        match self {
            Self::Colour { components, .. } => 2 * usize::from(components),
            Self::Normal { .. } => 6,
            Self::Factor { .. } => 2,
            Self::Scalar { .. } | Self::Label { .. } => 4,
        }
    }
}

/// Channels, and where their values lie among those of a point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Storage {
    pub(super) channels: Vec<Stored>,
    /// Values of a point.
    pub(super) count: usize,
    /// Weights of a texel: that of all samples, for each scalar that of samples which have it, and for each label its
    /// lead.
    pub(super) weights: usize,
    /// Whether there is nothing but one colour without opacity, as in most files: then a texel is four numbers, which
    /// are handled at once.
    pub(super) is_plain: bool,
}

impl Storage {
    /// Of channels in their order.
    pub fn new(channels: Vec<Stored>) -> Self {
        let count = channels.iter().map(|channel| channel.values()).sum();
        let is_number = |channel: &&Stored| matches!(channel, Stored::Scalar { .. } | Stored::Label { .. });
        let weights = 1 + channels.iter().filter(is_number).count();
        let is_plain = matches!(channels[..], [Stored::Colour { components: 3, .. }]);
        Self { channels, count, weights, is_plain }
    }

    /// The channels.
    pub fn channels(&self) -> &[Stored] {
        &self.channels
    }

    /// Values of a point.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether a texel is four numbers: a colour without opacity, and a weight.
    pub(super) fn is_plain(&self) -> bool {
        self.is_plain
    }

    /// Whether it says what something looks like from both sides, and nothing that was measured.
    pub(super) fn is_look(&self) -> bool {
        let is_look = |channel: &Stored| matches!(channel, Stored::Colour { .. } | Stored::Factor { .. });
        let is_scalar = |channel: &Stored| matches!(channel, Stored::Scalar { .. });
        self.channels.iter().any(is_look) && !self.channels.iter().any(is_scalar)
    }

    /// Numbers that are kept for a texel: its values, then its weights.
    pub(super) fn stride(&self) -> usize {
        self.count + self.weights
    }

    /// Bytes of the packed values of a point.
    pub(super) fn packed_bytes(&self) -> usize {
        self.channels.iter().map(|channel| channel.packed_bytes()).sum()
    }

    /// Appends the values of texels, as [`Sums`] has them, in fewer bytes: see [`Storage::pack`].
    pub(super) fn pack_all(&self, texels: &[f32], packed: &mut Vec<u8>) {
        if !self.is_plain {
            texels.chunks_exact(self.stride()).for_each(|texel| self.pack(&texel[..self.count], packed));
            return;
        }
        let mut some = [[0; 6]; LANES];
        for texels in texels.as_chunks::<4>().0.chunks(LANES) {
            for (packed, &texel) in some.iter_mut().zip(texels) {
                let [[a, b], [c, d], [e, f], _] = texel.map(|value| share(value).to_le_bytes());
                *packed = [a, b, c, d, e, f];
            }
            packed.extend_from_slice(some[..texels.len()].as_flattened());
        }
    }

    /// Appends the values of a point in fewer bytes: colours in 16 bits of linear light, which is as fine as 12 bits of
    /// sRGB where it is dark, and what lies between -1 and 1 in 16 bits. Numbers stay what they are.
    pub(super) fn pack(&self, values: &[f32], packed: &mut Vec<u8>) {
        let mut rest = values;
        for channel in &self.channels {
            let (own, others) = rest.split_at(channel.values());
            match channel {
                Stored::Colour { components, .. } => {
                    let own = &own[..usize::from(*components)];
                    packed.extend(own.iter().flat_map(|&value| share(value).to_le_bytes()));
                }
                Stored::Normal { .. } => {
                    // A direction may have any length, but how long it is beyond 1 says nothing.
                    let longest = own.iter().fold(1.0, |longest: f32, value| longest.max(value.abs()));
                    let part = |&value: &f32| (value / longest * f32::from(i16::MAX)).round() as i16;
                    packed.extend(own.iter().flat_map(|value| part(value).to_le_bytes()));
                }
                Stored::Factor { .. } => packed.extend(share(own[0]).to_le_bytes()),
                Stored::Scalar { .. } | Stored::Label { .. } => packed.extend(own[0].to_le_bytes()),
            }
            rest = others;
        }
    }

    /// Replaces values by those of a packed point.
    pub(super) fn unpack(&self, packed: &[u8], values: &mut Vec<f32>) {
        values.clear();
        let mut rest = packed;
        for channel in &self.channels {
            let (own, others) = rest.split_at(channel.packed_bytes());
            let pair = |k: usize| [own[2 * k], own[2 * k + 1]];
            let share = |k: usize| f32::from(u16::from_le_bytes(pair(k))) * (1.0 / 65535.0);
            match channel {
                Stored::Colour { components, .. } => {
                    values.extend((0..usize::from(*components)).map(share));
                }
                Stored::Normal { .. } => {
                    let part = |k: usize| f32::from(i16::from_le_bytes(pair(k))) * (1.0 / f32::from(i16::MAX));
                    values.extend([0, 1, 2].map(part));
                }
                Stored::Factor { .. } => values.push(share(0)),
                Stored::Scalar { .. } | Stored::Label { .. } => {
                    values.push(f32::from_le_bytes([own[0], own[1], own[2], own[3]]));
                }
            }
            rest = others;
        }
    }

    /// Where scalars and labels lie among the values of a point, which may have none.
    pub(super) fn numbers(&self) -> Vec<usize> {
        self.places(|channel| matches!(channel, Stored::Scalar { .. } | Stored::Label { .. }))
    }

    /// Where the labels lie among the values of a point.
    pub(super) fn labels(&self) -> Vec<usize> {
        self.places(|channel| matches!(channel, Stored::Label { .. }))
    }

    /// Where colours without opacity begin among the values of a point.
    pub(super) fn opaque_colours(&self) -> Vec<usize> {
        self.places(|channel| matches!(channel, Stored::Colour { components: 3, .. }))
    }

    /// Where the values of channels of a kind begin among those of a point.
    fn places(&self, is_wanted: impl Fn(&Stored) -> bool) -> Vec<usize> {
        let mut end = 0;
        let starts = self.channels.iter().map(|channel| {
            end += channel.values();
            (channel, end - channel.values())
        });
        starts.filter(|(channel, _)| is_wanted(channel)).map(|(_, start)| start).collect()
    }

    /// Replaces colours without opacity by their square roots.
    pub(super) fn take_roots(&self, values: &mut [f32]) {
        if self.is_plain {
            values.iter_mut().for_each(|value| *value = value.sqrt());
            return;
        }
        let colours = self.opaque_colours();
        for values in values.chunks_exact_mut(self.count) {
            for &first in &colours {
                values[first..first + 3].iter_mut().for_each(|value| *value = value.sqrt());
            }
        }
    }
}

/// A number from 0 to 1 as one of 65535.
fn share(value: f32) -> u16 {
    // NaN becomes 0.
    let number = value * 65535.0 + 0.5;
    let number = if number > 0.0 { number } else { 0.0 };
    whole(if number < 65535.0 { number } else { 65535.0 }) as u16
}
