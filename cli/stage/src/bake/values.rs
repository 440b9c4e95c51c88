//! Means over texels of what points of a surface carry.

use super::storage::{Storage, Stored};
use crate::nearest::SHARE_OF_OPPOSITE;

/// The weight of a point.
#[derive(Clone, Copy, Default)]
pub(super) struct Weight {
    pub all: f32,
    /// The weight of its directions.
    pub directions: f32,
}

impl Weight {
    /// The same weight for all and for directions.
    pub fn even(weight: f32) -> Self {
        Self { all: weight, directions: weight }
    }

    /// Both, times a factor.
    pub fn times(self, factor: f32) -> Self {
        Self { all: self.all * factor, directions: self.directions * factor }
    }

    /// That of a point whose closest triangle faces the other way, given how its values are stored.
    pub fn of_opposite(storage: &Storage) -> Self {
        // Directions and measured numbers of the other side say nothing.
        Self { all: if storage.is_look() { SHARE_OF_OPPOSITE } else { 0.0 }, directions: 0.0 }
    }
}

/// Counts a vote for a label (Boyer and Moore 1981, "MJRTY"): what has more than half of the weight wins, whatever the
/// order.
fn vote(winner: &mut f32, lead: &mut f32, label: f32, weight: f32) {
    if *winner == label {
        *lead += weight;
    } else if *lead > weight {
        *lead -= weight;
    } else {
        (*winner, *lead) = (label, weight - *lead);
    }
}

/// Weighted sums of values by texel. Colours are weighted with their opacity, missing scalars do not count, and labels
/// are voted for.
pub(super) struct Sums<'a> {
    pub storage: &'a Storage,
    pub kept: Kept,
}

/// What is known of texels. Its memory serves one map after another.
#[derive(Default)]
pub(super) struct Kept {
    /// Of each texel its values, then its weights.
    pub sums: Vec<f32>,
    /// Whether it has values, once they are means.
    pub known: Vec<bool>,
}

impl<'a> Sums<'a> {
    /// `kept` is what earlier sums were kept in.
    pub fn new(texels: usize, storage: &'a Storage, mut kept: Kept) -> Self {
        kept.sums.clear();
        kept.sums.resize(texels * storage.stride(), 0.0);
        Self { storage, kept }
    }

    /// Adds the values of points, of each of which the texel is given.
    pub fn add_all(&mut self, texels: &[u32], values: &[f32], weight: Weight) {
        if self.storage.is_plain {
            let of_texels = self.kept.sums.as_chunks_mut().0;
            for (&texel, &[red, green, blue]) in texels.iter().zip(values.as_chunks().0) {
                let of_texel = &mut of_texels[texel as usize];
                *of_texel = plus(*of_texel, [red, green, blue, 1.0], weight.all);
            }
            return;
        }
        for (&texel, values) in texels.iter().zip(values.chunks_exact(self.storage.count)) {
            self.add_others(texel as usize, values, weight);
        }
    }

    /// Adds the values of a packed point; `values` is memory for them.
    #[inline]
    pub fn add_packed(&mut self, texel: usize, packed: &[u8], weight: Weight, values: &mut Vec<f32>) {
        if let (true, &[a, b, c, d, e, f]) = (self.storage.is_plain, packed) {
            let share = |pair| f32::from(u16::from_le_bytes(pair)) * (1.0 / 65535.0);
            let of_texel = &mut self.kept.sums.as_chunks_mut().0[texel];
            *of_texel = plus(*of_texel, [share([a, b]), share([c, d]), share([e, f]), 1.0], weight.all);
            return;
        }
        self.storage.unpack(packed, values);
        self.add_others(texel, values, weight);
    }

    /// Adds the values of a point of any channels.
    fn add_others(&mut self, texel: usize, values: &[f32], Weight { all: weight, directions }: Weight) {
        let stride = self.storage.stride();
        let (sums, weights) = self.kept.sums[texel * stride..][..stride].split_at_mut(self.storage.count);
        weights[0] += weight;
        let (mut at, mut scalar) = (0, 1);
        for channel in &self.storage.channels {
            match channel {
                Stored::Colour { components: 4, .. } => {
                    let share = weight * values[at + 3];
                    (0..3).for_each(|k| sums[at + k] += values[at + k] * share);
                    sums[at + 3] += share;
                }
                Stored::Colour { .. } => (at..at + 3).for_each(|k| sums[k] += values[k] * weight),
                Stored::Normal { .. } => (at..at + 3).for_each(|k| sums[k] += values[k] * directions),
                Stored::Factor { .. } => sums[at] += values[at] * weight,
                Stored::Scalar { .. } => {
                    if !values[at].is_nan() {
                        sums[at] += values[at] * weight;
                        weights[scalar] += weight;
                    }
                    scalar += 1;
                }
                Stored::Label { .. } => {
                    if !values[at].is_nan() {
                        vote(&mut sums[at], &mut weights[scalar], values[at], weight);
                    }
                    scalar += 1;
                }
            }
            at += channel.values();
        }
    }

    /// Replaces sums of square roots of colours without opacity by those of colours whose mean has the mean of the
    /// roots.
    pub fn square_means(&mut self) {
        let Storage { count, .. } = *self.storage;
        let colours = self.storage.opaque_colours();
        for texel in self.kept.sums.chunks_exact_mut(self.storage.stride()) {
            let weight = texel[count];
            if weight > 0.0 {
                for &first in &colours {
                    texel[first..first + 3].iter_mut().for_each(|sum| *sum *= *sum / weight);
                }
            }
        }
    }

    /// Where the labels lie among the values of a texel.
    pub fn labels(&self) -> Vec<usize> {
        self.storage.labels()
    }

    /// Numbers of a texel.
    pub fn stride(&self) -> usize {
        self.storage.stride()
    }

    /// Whether anything was added to a texel.
    #[inline]
    pub fn has(&self, texel: usize) -> bool {
        self.kept.sums[texel * self.storage.stride() + self.storage.count] > 0.0
    }

    /// Replaces the sums by means, and notes of which texels there are any.
    pub fn divide(&mut self) {
        let Storage { channels, count, is_plain, .. } = self.storage;
        let Kept { sums, known } = &mut self.kept;
        known.clear();
        if *is_plain {
            known.extend(sums.as_chunks_mut().0.iter_mut().map(|[red, green, blue, weight]| {
                let inverse = if *weight > 0.0 { 1.0 / *weight } else { 0.0 };
                (*red, *green, *blue) = (*red * inverse, *green * inverse, *blue * inverse);
                *weight > 0.0
            }));
            return;
        }
        for texel in sums.chunks_exact_mut(self.storage.stride()) {
            known.push(texel[*count] > 0.0);
            let (sums, weights) = texel.split_at_mut(*count);
            let (mut at, mut scalar) = (0, 1);
            let inverse = if weights[0] > 0.0 { 1.0 / weights[0] } else { 0.0 };
            for channel in channels {
                let own = &mut sums[at..at + channel.values()];
                match channel {
                    Stored::Colour { components: 4, .. } => {
                        let of_opacity = if own[3] > 0.0 { 1.0 / own[3] } else { 0.0 };
                        own[..3].iter_mut().for_each(|sum| *sum *= of_opacity);
                        own[3] = if weights[0] > 0.0 { own[3] * inverse } else { 1.0 };
                    }
                    Stored::Colour { .. } | Stored::Normal { .. } | Stored::Factor { .. } => {
                        own.iter_mut().for_each(|sum| *sum *= inverse);
                    }
                    Stored::Scalar { .. } => {
                        own[0] /= weights[scalar];
                        scalar += 1;
                    }
                    Stored::Label { .. } => {
                        // Nobody has voted.
                        if (own[0], weights[scalar]) == (0.0, 0.0) {
                            own[0] = f32::NAN;
                        }
                        scalar += 1;
                    }
                }
                at += channel.values();
            }
        }
    }
}

/// Four sums, and four values that count so much.
#[inline(always)]
pub(super) fn plus(sums: [f32; 4], values: [f32; 4], weight: f32) -> [f32; 4] {
    std::array::from_fn(|k| sums[k] + values[k] * weight)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_side_of_a_sheet_says_what_it_looks_like_and_no_more() {
        let [colour, factor] = [Stored::Colour { components: 3, step: 1 }, Stored::Factor { step: 1 }];
        let scalar = Stored::Scalar { low: 0.0, step: 1.0 };
        let is_look = |channels: &[Stored]| Storage::new(channels.to_vec()).is_look();
        assert!(is_look(&[colour]) && is_look(&[factor, Stored::Normal { step: 1 }]));
        assert!(!is_look(&[Stored::Normal { step: 1 }]) && !is_look(&[colour, scalar]));
        let storage = Storage::new(vec![colour, Stored::Normal { step: 1 }, factor]);
        let mut sums = Sums::new(1, &storage, Kept::default());
        sums.add_all(&[0], &[0.25, 0.5, 1.0, 0.0, 0.0, 1.0, 0.5], Weight::even(3.0));
        let of_opposite = Weight { all: 1.0 / 3.0, directions: 0.0 };
        sums.add_all(&[0], &[1.0, 0.5, 0.25, 0.0, 1.0, 0.0, 1.0], of_opposite.times(3.0));
        sums.divide();
        assert_eq!(sums.kept.sums[..7], [0.4375, 0.5, 0.8125, 0.0, 0.0, 0.75, 0.625]);
    }

    #[test]
    fn packed_values_come_back() {
        let colour = |components: u8| Stored::Colour { components, step: 1 };
        let channels = vec![
            colour(3),
            colour(4),
            Stored::Normal { step: 1 },
            Stored::Factor { step: 1 },
            Stored::Label { low: 0.0 },
        ];
        let storage = Storage::new(channels);
        let points = [
            [0.0, 1.0, 0.5, 0.001, 0.2, 0.9, 0.25, -1.0, 0.3, 0.0, 0.7, 12345.0],
            [0.3, 0.3, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0, f32::NAN],
        ];
        let mut packed = vec![];
        points.iter().for_each(|point| storage.pack(point, &mut packed));
        assert_eq!(packed.len(), 2 * storage.packed_bytes());
        let mut values = vec![];
        for (point, packed) in points.iter().zip(packed.chunks_exact(storage.packed_bytes())) {
            storage.unpack(packed, &mut values);
            assert_eq!(values.len(), point.len());
            for (a, b) in point.iter().zip(&values) {
                assert!((a - b).abs() < 5e-5 || a.is_nan() && b.is_nan(), "{a} {b}");
            }
        }
        // A longer direction keeps its direction, and what is out of range saturates.
        let wild = [2.0, -1.0, f32::NAN, 0.0, 0.0, 0.0, 7.0, 0.0, 4.0, -2.0, 1.5, f32::INFINITY];
        packed.clear();
        storage.pack(&wild, &mut packed);
        storage.unpack(&packed, &mut values);
        assert_eq!([values[0], values[1], values[2], values[6]], [1.0, 0.0, 0.0, 1.0]);
        assert!((values[9] + 0.5).abs() < 1e-4 && values[8] == 1.0 && values[10] == 1.0);
    }

    #[test]
    fn means_of_roots_are_squared_and_other_channels_stay() {
        let colour = |components: u8| Stored::Colour { components, step: 1 };
        for (channels, wanted) in [
            (vec![colour(3)], vec![0.36, 0.25, 1.0]),
            (vec![Stored::Factor { step: 1 }, colour(3)], vec![0.5, 0.36, 0.25, 1.0]),
        ] {
            let storage = Storage::new(channels);
            let first = storage.count() - 3;
            let mut sums = Sums::new(2, &storage, Kept::default());
            for (value, weight) in [(0.0, 0.4), (1.0, 0.6)] {
                let mut values = vec![0.5; first];
                values.extend([value, 0.25, 1.0]);
                storage.take_roots(&mut values);
                sums.add_all(&[1], &values, Weight::even(2.0 * weight));
            }
            sums.square_means();
            sums.divide();
            assert_eq!(sums.kept.known, [false, true]);
            let texel = &sums.kept.sums[storage.stride()..][..storage.count()];
            assert!(texel.iter().zip(&wanted).all(|(is, wanted)| (is - wanted).abs() < 1e-6), "{texel:?}");
        }
    }
}
