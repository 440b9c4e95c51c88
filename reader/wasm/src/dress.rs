//! The images of tiles of heights, packed for the GPU: normals, and colours if they are shown.

use std::{collections::BTreeMap, sync::Arc};

use lodpack::{
    heights::SIDE,
    stream::{DrawnRoot, TileImages},
};

use crate::answer::put_all;

/// Texels along a side of an image: one a sample, and one more on each side, where whoever interpolates may read a
/// little beyond the border.
pub const TEXELS: usize = SIDE + 2;

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

/// Packs places in an image (f32) and its rectangle (u16), vertex by vertex.
pub fn put_places(output: &mut Vec<u8>, drawn: &DrawnRoot) {
    let places: Vec<[f32; 2]> = drawn.places().collect();
    put_all(output, &places, |bytes: &mut [u8; 8], place| {
        // In the middle of its texel, behind the first one.
        bytes.as_chunks_mut::<4>().0.iter_mut().zip(place).for_each(|(to, x)| *to = (x + 1.5).to_le_bytes());
    });
    put_all(output, &places, |bytes: &mut [u8; 8], _| {
        let sides = [1, 1, SIDE as u16 + 1, SIDE as u16 + 1];
        bytes.as_chunks_mut::<2>().0.iter_mut().zip(sides).for_each(|(to, x)| *to = x.to_le_bytes());
    });
}

/// Packs images: colours (red, green, blue, opacity) if they are shown, and normals (half floats, from 0 to 1, with a
/// 1).
pub fn put_images(output: &mut Vec<u8>, images: &TileImages, shows_colours: bool) {
    let inside = |texel: usize| texel.saturating_sub(1).min(SIDE - 1);
    let samples: Vec<usize> =
        (0..TEXELS * TEXELS).map(|texel| inside(texel / TEXELS) * SIDE + inside(texel % TEXELS)).collect();
    if let Some(colours) = images.colours.as_ref().filter(|_| shows_colours) {
        put_all(output, &samples, |bytes: &mut [u8; 4], &at| {
            let [r, g, b] = colours.get(images.texel_of(at)).copied().unwrap_or_default();
            *bytes = [r, g, b, 255];
        });
    }
    let normals = images.half_floats([0.0, 1.0]);
    let (normals, _) = normals.as_chunks::<4>();
    put_all(output, &samples, |bytes: &mut [u8; 8], &at| {
        let numbers = normals.get(at).copied().unwrap_or_default();
        bytes.as_chunks_mut::<2>().0.iter_mut().zip(numbers).for_each(|(to, number)| *to = number.to_le_bytes());
    });
}
