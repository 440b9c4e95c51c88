//! The steps of baking in their order, with memory that serves one patch after another.

use lodpack::decode::texels::Map;
use lodpack::write::{encode_map, texel_size};

use super::borders::Borders;
use super::closest::{Means, show_closest};
use super::coarser::gather_surfels;
use super::coded::Steps;
use super::fill::finished;
use super::gather::gather;
use super::located::Located;
use super::pieces::{Pieces, divide};
use super::raster::Drawn;
use super::rim::{Outline, Rim};
use super::sharpen::sharpen;
use super::shown::{Scratch, Shown};
use super::sizes::{Sizes, area_of_texel, covered_area};
use super::storage::Storage;
use super::surfels::Surfels;
use super::values::{Kept, Sums};
use super::wanted::Wanted;
use super::{Baked, BakedPatch, Coarse, MAX_EXPONENT, MAX_TEXELS, MAX_TEXELS_OF_CUT, Source};

/// Texels of a reduced cut that are larger than those of the cut by this power of the root of two, or by less, show
/// about as much.
const LITTLE_LARGER: u32 = 1;
/// Bytes of a texel of a patch as its map shows it.
const DRAWN_BYTES: usize = 16;
/// The same of its number among the texels of its borders.
const NUMBER_BYTES: usize = 4;
/// How much larger steps of quantisation are where texels are [`sharpen`]ed. As many bytes show more then: a city's
/// tile has 3.36 MB and 32.2 dB in place of 3.37 MB and 29.9 dB, a bunny with a photograph 326 kB and 40.8 dB in place
/// of 365 kB and 40.5 dB.
const STEPS_WHERE_SHARP: f64 = 9.0 / 7.0;
/// How much larger steps are in coarser images, of opaque colours and of all else: a quarter larger than those of the
/// finest. A texel of them costs twice as many bytes as one of the finest. A sphere with a photograph of 8,192 x 8,192
/// texels takes 8.2 MB in place of 10.1, and as good an image at its finest level.
const STEPS_OF_COARSER: [f64; 2] = [1.25 * STEPS_WHERE_SHARP, 1.25];
/// How often a patch is divided further because pieces overlap themselves.
const MAX_ROUNDS: usize = 3;

/// Bytes of memory that baking a map takes, given its texels: the depth and slope of each and how it is used, sums with
/// their weights, which of its borders' texels it is, the image, and what is handed on.
pub fn baking_bytes(texels: u64, storage: &Storage) -> u64 {
    texels * (DRAWN_BYTES + NUMBER_BYTES + 4 * storage.stride() + 2 * storage.packed_bytes()) as u64
}

/// Gives patches images, one after another, and reuses its memory for the next one: a build has billions of texels, and
/// the system clears each page that it hands out.
pub struct Baker<'s> {
    storage: &'s Storage,
    drawn: Drawn,
    kept: Kept,
    scratch: Scratch,
    image: Vec<u8>,
}

impl<'s> Baker<'s> {
    /// For images that are stored like this.
    pub fn new(storage: &'s Storage) -> Self {
        Self { storage, drawn: Drawn::default(), kept: Kept::default(), scratch: Scratch::default(), image: vec![] }
    }

    /// Bytes of memory that it keeps.
    pub fn bytes(&self) -> u64 {
        let of_texels = DRAWN_BYTES * self.drawn.depth.capacity() + 4 * self.kept.sums.capacity();
        (of_texels + self.scratch.bytes() + self.image.capacity()) as u64
    }

    /// The images of a patch, with texels of 2^(exponent / 2) lattice units, or as many of several sizes. None if
    /// nothing can be projected.
    pub fn bake<S: Source>(&mut self, patch: &BakedPatch<'_>, source: &mut Located<S>, exponent: u32) -> Option<Baked> {
        let sizes = Sizes::of_source(patch, source);
        let exponent = sizes.exponent(patch, exponent, || patch.whole_area() / area_of_texel(exponent));
        let mapped = self.mapped(patch, (exponent, Room::Usual), sizes, None)?;
        let sums = Sums::new(self.drawn.depth.len(), self.storage, std::mem::take(&mut self.kept));
        let sums = gather(patch, &mapped.map, (&self.drawn, &[]), &mut source.source, sums);
        self.kept = finished(sums, patch, &mapped.map, &self.drawn);
        let mut surfels = self.surfels(patch, &mapped);
        let is_full = mapped.is_full;
        let streams;
        (streams, surfels.rim) =
            self.streams(patch, mapped, [1.0; 2], |map, shown| shown.of_source(patch, map, source));
        Some(Baked { streams, surfels, is_full })
    }

    /// As [`Baker::bake`], of a patch that may be far from a source: texels show what lies closest to them, and borders
    /// what the source does.
    pub fn bake_closest<S: Source>(
        &mut self,
        patch: &BakedPatch<'_>,
        source: &mut Located<S>,
        exponent: u32,
    ) -> Option<Baked> {
        let mapped =
            self.closest(patch, &mut source.source, (exponent, Room::Usual), Sizes::default(), Means::Light)?;
        let is_full = mapped.is_full;
        let (streams, _) = self.streams(patch, mapped, [1.0; 2], |map, shown| shown.of_source(patch, map, source));
        // No coarser images are made of them.
        Some(Baked { streams, surfels: Surfels::default(), is_full })
    }

    /// As [`Baker::bake_closest`], of a cut that is looked at as closely as its source, but both sides of borders show
    /// the mean of what both do. `finer` is how much finer its texels are than those of the source, as a power of the
    /// root of two.
    pub fn bake_cut<S: Source>(
        &mut self,
        patch: &BakedPatch<'_>,
        source: &mut Located<S>,
        exponent: u32,
        finer: u32,
    ) -> Option<Baked> {
        let sizes = Sizes::of_source(patch, source);
        let mapped = self.closest(patch, &mut source.source, (exponent, Room::OfCut { finer }), sizes, Means::Roots)?;
        let is_full = mapped.is_full;
        let (streams, _) = self.streams(patch, mapped, [1.0; 2], |_, shown| shown.means(patch));
        Some(Baked { streams, surfels: Surfels::default(), is_full })
    }

    /// Gives texels what lies closest to them.
    fn closest(
        &mut self,
        patch: &BakedPatch<'_>,
        source: &mut impl Source,
        (exponent, room): (u32, Room),
        sizes: Sizes,
        means: Means,
    ) -> Option<Mapped> {
        let mapped = self.mapped(patch, (exponent, room), sizes, None)?;
        let mut sums = Sums::new(self.drawn.depth.len(), self.storage, std::mem::take(&mut self.kept));
        let taken = show_closest(patch, &mapped.map, &self.drawn, source, &mut sums, means);
        let sums = gather(patch, &mapped.map, (&self.drawn, &taken), source, sums);
        self.kept = finished(sums, patch, &mapped.map, &self.drawn);
        Some(mapped)
    }

    /// As [`Baker::bake`], from the texels of finer patches.
    pub fn bake_coarser<'a, S: Source>(
        &mut self,
        patch: &BakedPatch<'_>,
        finer: impl Iterator<Item = &'a Surfels> + Clone,
        source: Option<&mut Located<S>>,
        coarse: Coarse,
    ) -> Option<Baked> {
        let outline = Outline::new(finer.clone().map(|surfels| &surfels.rim));
        let sizes = Sizes::of_surfels(patch, finer.clone());
        // A piece covers less than the surface that it shows.
        let wanted = || coarse.texels * patch.whole_area() / covered_area(finer.clone());
        let exponent = sizes.exponent(patch, coarse.exponent, wanted);
        let mapped = self.mapped(patch, (exponent, Room::Usual), sizes, Some(&outline))?;
        let sums = Sums::new(self.drawn.depth.len(), self.storage, std::mem::take(&mut self.kept));
        self.kept = gather_surfels(patch, &mapped.map, &self.drawn, finer, sums);
        let mut surfels = self.surfels(patch, &mapped);
        let is_full = mapped.is_full;
        let streams;
        (streams, surfels.rim) = self.streams(patch, mapped, STEPS_OF_COARSER, |map, shown| {
            let mut wanted = match source {
                Some(source) => shown.of_source(patch, map, source),
                None => shown.of_outline(patch, &outline),
            };
            shown.add_beside_finer(&outline, &mut wanted);
            wanted
        });
        Some(Baked { streams, surfels, is_full })
    }

    fn surfels(&self, patch: &BakedPatch<'_>, Mapped { map, usual, .. }: &Mapped) -> Surfels {
        Surfels::new(patch, (map, usual), &self.drawn, &self.kept.sums, self.storage)
    }

    /// The streams of the map and of the image of each channel, and what the outer border should show. The numbers say
    /// how much larger steps of opaque colours and of all else are, and `wanted` what borders should show, if colours
    /// have no opacity.
    fn streams(
        &mut self,
        patch: &BakedPatch<'_>,
        Mapped { map, bytes, borders, .. }: Mapped,
        [opaque_colours, others]: [f64; 2],
        wanted: impl FnOnce(&Map, &Shown<'_>) -> Wanted,
    ) -> (Vec<Vec<u8>>, Rim) {
        let Self { storage, drawn, kept: Kept { sums: values, .. }, scratch, image } = self;
        let mut streams = vec![bytes];
        let size = texel_size(patch.finer);
        let [opaque_colours, others] = [opaque_colours * size, others * size];
        let mut steps = Steps { opaque_colours, are_finer_in_grain: patch.is_sharp, others };
        if patch.is_sharp {
            sharpen(&map, &drawn.is_covered, values, storage);
            steps.opaque_colours *= STEPS_WHERE_SHARP;
        }
        let is_covered = drawn.is_covered.as_slice();
        let mut rim = Rim::default();
        let seen = if storage.opaque_colours().is_empty() {
            Borders::default().seen(&map, is_covered)
        } else {
            let mut shown = Shown { storage, values, is_covered, borders: &borders };
            let wanted = wanted(&map, &shown);
            shown.show_all(&wanted, scratch);
            rim = Rim::new(&wanted, patch.origin(), storage.opaque_colours().len());
            borders.seen(&map, is_covered)
        };
        streams.extend(storage.encode(&map, values, &drawn.is_used, &seen, steps, image));
        (streams, rim)
    }

    /// Finds a map whose pieces do not overlap themselves by much, and draws the patch on it.
    fn mapped(
        &mut self,
        patch: &BakedPatch<'_>,
        (mut exponent, room): (u32, Room),
        sizes: Sizes,
        outline: Option<&Outline<'_>>,
    ) -> Option<Mapped> {
        let BakedPatch { positions, triangles, .. } = *patch;
        let (wanted, mut most) = (exponent, MAX_TEXELS);
        let mut pieces = divide(patch, sizes);
        for round in 0.. {
            let Pieces { shapes, labels, .. } = &pieces;
            let Ok((map, bytes)) = encode_map(positions, triangles, exponent, shapes, labels, most) else {
                // Fewer texels, until they fit.
                exponent += 1;
                if let (Room::OfCut { finer }, MAX_TEXELS) = (room, most)
                    && exponent > wanted + finer + LITTLE_LARGER
                {
                    (exponent, most) = (wanted + finer, MAX_TEXELS_OF_CUT);
                }
                if exponent > MAX_EXPONENT {
                    return None;
                }
                continue;
            };
            self.drawn.draw(patch, &map);
            if round < MAX_ROUNDS && !self.drawn.hidden.is_empty() {
                pieces.separate(&self.drawn.hidden, patch);
                continue;
            }
            self.drawn.complete(patch, &map);
            let borders = Borders::new(patch, &map, outline.filter(|outline| !outline.is_empty()));
            borders.add_used(&mut self.drawn.is_used);
            let usual = pieces.usual_areas(&map, exponent);
            return Some(Mapped { map, bytes, borders, usual, is_full: exponent > wanted });
        }
        None
    }
}

/// How many texels a map may have.
#[derive(Clone, Copy)]
enum Room {
    Usual,
    /// More, if its texels would be larger than those of the source by more than a little. They are finer than these by
    /// a power of the root of two, which shows little.
    OfCut {
        finer: u32,
    },
}

/// A map, and the borders of its pieces.
struct Mapped {
    map: Map,
    /// As it is stored.
    bytes: Vec<u8>,
    borders: Borders,
    /// Of each piece the area of texels that are not longer than wide.
    usual: Vec<f64>,
    /// Whether its texels are larger than they should be, because it holds no more.
    is_full: bool,
}
