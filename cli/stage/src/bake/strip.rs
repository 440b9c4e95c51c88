//! The texels of a map that its borders show, side by side: in the map they lie far apart, and they are looked at many
//! times.

use super::storage::Storage;
use lodpack_mesh::NONE;

/// One number for each colour component; the last one is not used, but vectors have four.
pub(super) type Vector = [f32; 4];

/// These texels. Its memory serves one map after another.
#[derive(Default)]
pub(super) struct Strip {
    /// Of each texel of the map its number here; [`NONE`] of those that are not.
    numbers: Vec<u32>,
    texels: Vec<u32>,
}

impl Strip {
    /// Empties it, for a map of `count` texels.
    pub fn clear(&mut self, count: usize) {
        self.texels.drain(..).for_each(|texel| self.numbers[texel as usize] = NONE);
        self.numbers.resize(count.max(self.numbers.len()), NONE);
    }

    /// The number of a texel of the map, which is new if it was not there yet.
    #[inline]
    pub fn number(&mut self, texel: u32) -> u32 {
        let number = &mut self.numbers[texel as usize];
        if *number == NONE {
            *number = self.texels.len() as u32;
            self.texels.push(texel);
        }
        *number
    }

    /// The numbers of the four texels of a place, of each of which its share is given. Those of which nothing is shown
    /// are any of the others.
    #[inline]
    pub fn of_place(&mut self, texels: [(usize, f32); 4]) -> [(u32, f32); 4] {
        let shown = texels.iter().find(|(_, share)| *share != 0.0).map_or(texels[0].0, |(texel, _)| *texel);
        texels.map(|(texel, share)| (self.number(if share == 0.0 { shown } else { texel } as u32), share))
    }

    /// All of them, by number.
    pub fn texels(&self) -> &[u32] {
        &self.texels
    }

    /// The colours of a channel, of which the first number of a texel is given.
    pub fn read(&self, values: &[f32], storage: &Storage, first: usize) -> Vec<Vector> {
        let colour_of = |&texel: &u32| {
            let [red, green, blue] = colour_at(values, texel as usize * storage.stride() + first);
            [red, green, blue, 0.0]
        };
        self.texels.iter().map(colour_of).collect()
    }

    /// Puts such colours back.
    pub fn write(&self, colours: &[Vector], values: &mut [f32], storage: &Storage, first: usize) {
        for (&texel, colour) in self.texels.iter().zip(colours) {
            let at = texel as usize * storage.stride() + first;
            values[at..at + 3].copy_from_slice(&colour[..3]);
        }
    }

    /// Bytes of memory that it keeps.
    pub fn bytes(&self) -> usize {
        4 * (self.numbers.capacity() + self.texels.capacity())
    }
}

/// Comparisons that vectors have.
#[inline(always)]
pub(super) fn bounded(value: f32, low: f32, high: f32) -> f32 {
    let value = if value > low { value } else { low };
    if value < high { value } else { high }
}

pub(super) fn colour_at(values: &[f32], first: usize) -> [f32; 3] {
    [values[first], values[first + 1], values[first + 2]]
}

#[cfg(test)]
mod tests {
    use super::super::Stored;
    use super::super::borders::Place;
    use super::*;

    #[test]
    fn texels_lie_side_by_side_and_come_back() {
        let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
        let before: Vec<f32> = (0..32).map(|k| k as f32).collect();
        let (mut strip, mut values) = (Strip::default(), before.clone());
        for _ in 0..2 {
            strip.clear(8);
            assert_eq!([5, 2, 5, 7].map(|texel| strip.number(texel)), [0, 1, 0, 2]);
            let mut colours = strip.read(&values, &storage, 0);
            assert_eq!(colours[1], [8.0, 9.0, 10.0, 0.0]);
            colours[1][2] = 0.5;
            strip.write(&colours, &mut values, &storage, 0);
            let changed: Vec<usize> = (0..32).filter(|&k| values[k] != before[k]).collect();
            assert_eq!((changed, values[10]), (vec![10], 0.5));
            values[10] = before[10];
        }
    }

    #[test]
    fn texels_of_which_nothing_is_shown_need_not_be_there() {
        let mut strip = Strip::default();
        strip.clear(4);
        let texels = strip.of_place(Place::middle(Place::between(0), Place::between(1), 2).texels(2));
        assert_eq!(texels.map(|(_, share)| share), [0.5, 0.0, 0.5, 0.0]);
        assert_eq!(strip.texels(), [1, 3]);
    }
}
