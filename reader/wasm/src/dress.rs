//! The images of tiles of heights, packed for the GPU: normals, and colours if they are shown.

use std::{collections::BTreeMap, sync::Arc};

use lodpack::{
    heights::CELLS,
    stream::{DrawnRoot, TileImages},
};

use crate::answer::put_all;

/// The images of tiles that the page has.
#[derive(Debug, Default)]
pub struct Dresser {
    pub shows_colours: bool,
    sent: BTreeMap<u32, Arc<TileImages>>,
}

impl Dresser {
    /// Forgets which images the page has.
    pub fn lose(&mut self) {
        self.sent.clear();
    }

    /// Forgets a tile that is no longer drawn.
    pub fn drop_root(&mut self, root: u32) {
        self.sent.remove(&root);
    }

    /// The images of a tile, if the page has others.
    pub fn images<'p>(&mut self, drawn: &'p DrawnRoot) -> Option<&'p Arc<TileImages>> {
        let (root, images) = (drawn.surface.root, drawn.images()?);
        match self.sent.insert(root, Arc::clone(images)) {
            Some(sent) if Arc::ptr_eq(&sent, images) => None,
            _ => Some(images),
        }
    }
}

/// Texels of the images of a tile for each sample, as the page gets them: it has normals and colours in one size.
fn per_sample(images: &TileImages, shows_colours: bool) -> usize {
    match &images.colours {
        // Only tiles that have none below them come with more than four.
        Some(_) if shows_colours && images.per_sample > 4 => 4,
        Some(_) if shows_colours => images.per_sample.min(2) as usize,
        _ => 1,
    }
}

/// Texels along a side of the images of a tile: so many a sample, and one more on each side, where whoever interpolates
/// may read a little beyond the border.
pub fn side_of(images: &TileImages, shows_colours: bool) -> usize {
    CELLS * per_sample(images, shows_colours) + 3
}

/// Packs places in an image (f32) and its rectangle (u16), vertex by vertex.
pub fn put_places(output: &mut Vec<u8>, drawn: &DrawnRoot, shows_colours: bool) {
    let per_sample = drawn.images().map_or(1, |images| per_sample(images, shows_colours));
    let places: Vec<[f32; 2]> = drawn.places().collect();
    put_all(output, &places, |bytes: &mut [u8; 8], place| {
        // In the middle of its texel, behind the first one.
        let places = place.iter().map(|x| x * per_sample as f32 + 1.5);
        bytes.as_chunks_mut::<4>().0.iter_mut().zip(places).for_each(|(to, x)| *to = x.to_le_bytes());
    });
    put_all(output, &places, |bytes: &mut [u8; 8], _| {
        let last = (CELLS * per_sample + 2) as u16;
        bytes.as_chunks_mut::<2>().0.iter_mut().zip([1, 1, last, last]).for_each(|(to, x)| *to = x.to_le_bytes());
    });
}

/// Packs images: colours (red, green, blue, opacity) if they are shown, and normals (half floats, from 0 to 1, with a
/// 1).
pub fn put_images(output: &mut Vec<u8>, images: &TileImages, shows_colours: bool) {
    let per_sample = per_sample(images, shows_colours);
    let (side, last) = (side_of(images, shows_colours), CELLS * per_sample);
    let inside = |texel: usize| texel.saturating_sub(1).min(last);
    let texels: Vec<[usize; 2]> = (0..side * side).map(|texel| [inside(texel % side), inside(texel / side)]).collect();
    if let Some(colours) = images.colours.as_ref().filter(|_| shows_colours) {
        let step = (images.per_sample as usize / per_sample).max(1);
        put_all(output, &texels, |bytes: &mut [u8; 4], &[x, y]| {
            let [r, g, b] = colours.get(y * step * images.colour_side() + x * step).copied().unwrap_or_default();
            *bytes = [r, g, b, 255];
        });
    }
    let normals = images.finer_half_floats([0.0, 1.0], per_sample as u32);
    let (normals, _) = normals.as_chunks::<4>();
    put_all(output, &texels, |bytes: &mut [u8; 8], &[x, y]| {
        let numbers = normals.get(y * (last + 1) + x).copied().unwrap_or_default();
        bytes.as_chunks_mut::<2>().0.iter_mut().zip(numbers).for_each(|(to, number)| *to = number.to_le_bytes());
    });
}
