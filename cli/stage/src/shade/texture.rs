//! An image in linear light, with coarser and coarser averages of it.

use std::sync::OnceLock;

use super::decode::decode;
use super::level::{Level, Texels, coarser_size, straight};
use super::meaning::{Meaning, TextureError};
use super::texels::Place;
use lodpack_mesh::appearance::Wrap;
use lodpack_mesh::images::{EncodedImage, image_size, texels_of, unreadable};
use lodpack_mesh::srgb::brightness;

/// An image and its averages, each of half the size, down to one texel.
pub(super) struct Texture {
    finest: Level,
    /// The size of each average, and the average once it is known.
    coarser: Vec<([u32; 2], OnceLock<Level>)>,
    /// Whether what it says of opacity is its brightness: nothing of it is transparent.
    is_mask: bool,
}

impl Texture {
    /// Decodes an image. Without alpha, its colours count as they are wherever it is transparent. Levels that `place`
    /// has no memory for are in files: then the averages are made at once, because nobody could be told later that a
    /// file cannot be written.
    pub(super) fn decode(
        mut encoded: impl EncodedImage,
        meaning: Meaning,
        place: &Place,
    ) -> Result<Self, TextureError> {
        let size = image_size(&mut encoded)?;
        encoded.rewind().map_err(|error| unreadable(&error))?;
        let texels = decode(encoded, size, meaning, place)?;
        let coarser = std::iter::successors(coarser_size(size), |&size| coarser_size(size));
        let coarser = coarser.map(|size| (size, OnceLock::new())).collect();
        let is_mask = meaning == Meaning::Opacity && texels.are_opaque();
        let this = Self { finest: Level { size, texels }, coarser, is_mask };
        let mut level = &this.finest;
        for (size, coarser) in &this.coarser {
            if !place.is_file(texels_of(*size) * level.averaged_bytes()) {
                break;
            }
            let made = level.coarser_at(place)?;
            level = coarser.get_or_init(|| made);
        }
        Ok(this)
    }

    /// Drops what of it files still have.
    pub(super) fn drop_pages(&self) {
        self.finest.texels.bytes().drop_pages();
        self.coarser.iter().filter_map(|(_, level)| level.get()).for_each(|level| level.texels.bytes().drop_pages());
    }

    /// The opacity that a colour of it stands for.
    pub(super) fn opacity(&self, [red, green, blue, alpha]: [f32; 4]) -> f32 {
        if self.is_mask { brightness([red, green, blue]) } else { alpha }
    }

    /// Columns and rows.
    pub(super) fn size(&self) -> [u32; 2] {
        self.finest.size
    }

    /// Bytes of memory that it takes, with all its averages.
    pub(super) fn bytes(&self) -> u64 {
        let each = self.finest.averaged_bytes();
        let of_level = |(size, level): &([u32; 2], OnceLock<Level>)| match level.get() {
            Some(level) => level.texels.bytes().in_memory(),
            None => each * texels_of(*size),
        };
        self.finest.texels.bytes().in_memory() + self.coarser.iter().map(of_level).sum::<u64>()
    }

    /// Level 0 is the image. Averages are made when they are needed: where texels of the result are as fine as the
    /// image, nobody does.
    fn level(&self, number: usize) -> &Level {
        let mut level = &self.finest;
        for (_, coarser) in &self.coarser[..number.min(self.coarser.len())] {
            level = coarser.get_or_init(|| level.coarser());
        }
        level
    }

    /// What gives averages over a width in texels.
    pub(super) fn filter(&self, width: f32) -> Filter<'_> {
        let (mut level, mut width, last) = (0, if width.is_finite() { width } else { 1.0 }, self.coarser.len());
        while width >= 2.0 && level < last {
            (level, width) = (level + 1, width / 2.0);
        }
        let share = if level < last { (width - 1.0).max(0.0) } else { 0.0 };
        let coarse = (share > 0.0).then(|| self.level(level + 1));
        Filter { fine: self.level(level), coarse, share }
    }
}

/// Two levels of a texture, and the share of the coarser one.
#[derive(Clone, Copy)]
pub(super) struct Filter<'t> {
    fine: &'t Level,
    coarse: Option<&'t Level>,
    share: f32,
}

impl Filter<'_> {
    /// The average around a place that counts in images.
    #[inline]
    pub(super) fn sample(&self, at: [f64; 2], wrap: [Wrap; 2]) -> [f32; 4] {
        let fine = self.fine.sample(at, wrap);
        let Some(coarse) = self.coarse else { return straight(fine) };
        let coarse = coarse.sample(at, wrap);
        straight([0, 1, 2, 3].map(|i| fine[i] + self.share * (coarse[i] - fine[i])))
    }

    /// The colours around places in a row, without alpha: the first one, and what is added from each to the next.
    pub(super) fn sample_row(&self, at: [f64; 2], step: [f64; 2], wrap: [Wrap; 2], colours: &mut [[f32; 3]]) {
        if self.coarse.is_none()
            && let Texels::Opaque(texels) = &self.fine.texels
            && let Some(row) = self.fine.row(at, step, wrap, colours.len())
        {
            return row.sample(texels.as_chunks().0, colours);
        }
        for (k, colour) in colours.iter_mut().enumerate() {
            let [red, green, blue, _] = self.sample([0, 1].map(|axis| at[axis] + k as f64 * step[axis]), wrap);
            *colour = [red, green, blue];
        }
    }
}
