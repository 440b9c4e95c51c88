//! Which texels a patch covers, and values for the others.
//!
//! Between the pieces of an image lie texels that nothing was stored for. Interpolation at full size never reads them;
//! who draws a patch smaller than its image has texels, and takes means of several, does. So these get the value of the
//! nearest texel that is used.

use std::collections::VecDeque;

use super::ChannelImage;
use crate::codec::{
    patch::LatticePoint,
    texels::{Image, Map, halved},
};

/// How far from what a patch covers texels of an image at its full size are stored, because images are interpolated and
/// borders of finer neighbours reach further. A smaller one may have nothing beside the texels that a patch covers: a
/// block of the full size is there if any of its texels is.
const STORED_RINGS: u8 = 2;
/// How far from it texels get a value.
const RINGS: u8 = 12;

/// The texels of a map's images.
pub(crate) struct Covered {
    /// Whether a triangle covers the texel's centre, or has a corner in it.
    is_covered: Vec<bool>,
    /// Texels that were not stored, each with the one whose value it gets.
    copies: Vec<[u32; 2]>,
}

impl Covered {
    /// Finds out which triangle covers which texel, of images that the file has at a smaller size, or at this one.
    pub fn new(map: &Map, positions: &[LatticePoint], triangles: &[[u32; 3]], is_smaller: bool) -> Self {
        let [width, height] = map.size.map(|length| length as usize);
        let mut is_covered = vec![false; width * height];
        for (number, corners) in triangles.iter().enumerate() {
            let piece = map.piece(number);
            let places = corners.map(|corner| piece.place(positions[corner as usize]));
            for [x, y] in places.map(|place| [0, 1].map(|k| (place[k] as u32).min(map.size[k] - 1) as usize)) {
                is_covered[y * width + x] = true;
            }
            for_each_centre(places, map.size, |texel| is_covered[texel] = true);
        }
        let copies = copies(map, &is_covered, if is_smaller { 0 } else { STORED_RINGS });
        Self { is_covered, copies }
    }

    /// Gives texels that were not stored the values of others.
    fn fill<T: Copy>(&self, image: &mut Image<T>) {
        let components = usize::from(image.components);
        for &[to, from] in &self.copies {
            let from = from as usize * components;
            image.data.copy_within(from..from + components, to as usize * components);
        }
    }

    /// An image halved so many times along each side: means of squares, of the texels that the patch covers if it
    /// covers any; or one of these texels, if nothing lies between their values.
    fn halved<T: Copy + Default + Into<f64>>(
        &self,
        image: &Image<T>,
        times: u8,
        is_mean: bool,
        rounded: impl Fn(f64) -> T,
    ) -> Image<T> {
        let (side, components) = (1_u32 << times, usize::from(image.components));
        let mut result = Image::filled(halved(image.size, times), &vec![T::default(); components]);
        let width = result.size[0] as usize;
        for (number, texel) in result.data.chunks_exact_mut(components).enumerate() {
            let [left, top] = [number % width, number / width].map(|place| place as u32 * side);
            let square = || {
                (top..(top + side).min(image.size[1]))
                    .flat_map(|y| (left..(left + side).min(image.size[0])).map(move |x| [x, y]))
            };
            let is_covered = |[x, y]: [u32; 2]| self.is_covered[y as usize * image.size[0] as usize + x as usize];
            let has_covered = square().any(is_covered);
            let shown =
                square().filter(|&at| !has_covered || is_covered(at)).take(if is_mean { usize::MAX } else { 1 });
            let (mut sums, mut count) = ([0.0; 4], 0.0);
            for [x, y] in shown {
                sums.iter_mut().zip(image.texel(x, y)).for_each(|(sum, &value)| *sum += value.into());
                count += 1.0;
            }
            texel.iter_mut().zip(sums).for_each(|(value, sum)| *value = rounded(sum / f64::max(count, 1.0)));
        }
        result
    }

    /// The image of a channel, halved so many times along each side. `is_mean` says whether something lies between its
    /// values.
    pub fn halved_image(&self, image: &ChannelImage, times: u8, is_mean: bool) -> ChannelImage {
        let byte = |x: f64| (x + 0.5) as u8;
        match image {
            ChannelImage::Colours(image) => ChannelImage::Colours(self.halved(image, times, is_mean, byte)),
            ChannelImage::Factors(image) => ChannelImage::Factors(self.halved(image, times, is_mean, byte)),
            ChannelImage::Values(image) => {
                ChannelImage::Values(self.halved(image, times, is_mean, |x| (x + 0.5) as u16))
            }
            ChannelImage::Normals(image) => {
                let mut image = self.halved(image, times, is_mean, byte);
                image.data.as_chunks_mut::<3>().0.iter_mut().for_each(|texel| *texel = with_length(*texel));
                ChannelImage::Normals(image)
            }
        }
    }

    /// Gives texels that were not stored the values of others. Returns the mean.
    pub fn fill_image(&self, image: &mut ChannelImage) -> [f64; 4] {
        match image {
            ChannelImage::Colours(image) | ChannelImage::Normals(image) | ChannelImage::Factors(image) => {
                self.fill(image);
                self.mean(image)
            }
            ChannelImage::Values(image) => {
                self.fill(image);
                self.mean(image)
            }
        }
    }

    /// The mean of the texels that the patch covers; 0 for components that an image does not have.
    fn mean<T: Copy + Into<f64>>(&self, image: &Image<T>) -> [f64; 4] {
        let (mut sums, mut count) = ([0.0; 4], 0.0);
        let texels = image.data.chunks_exact(usize::from(image.components.max(1)));
        for (texel, _) in texels.zip(&self.is_covered).filter(|&(_, &is_covered)| is_covered) {
            sums.iter_mut().zip(texel).for_each(|(sum, &value)| *sum += value.into());
            count += 1.0;
        }
        sums.map(|sum| sum / f64::max(count, 1.0))
    }
}

/// A direction with length 1 again, after a mean; one without any stays.
fn with_length(texel: [u8; 3]) -> [u8; 3] {
    let direction = texel.map(|byte| f64::from(byte) - 128.0);
    let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Beside all pieces there is none.
    if length < 1.0 || texel == [0; 3] { texel } else { direction.map(|x| (128.5 + 127.0 * x / length) as u8) }
}

/// Calls a function for each texel whose centre lies in a triangle, of either winding.
fn for_each_centre(places: [[f64; 2]; 3], size: [u32; 2], mut visit: impl FnMut(usize)) {
    let [low, high] = [f64::min, f64::max]
        .map(|of: fn(f64, f64) -> f64| [0, 1].map(|k| places.iter().map(|place| place[k]).fold(places[0][k], of)));
    // The conversions saturate.
    let [left, top] = [0, 1].map(|k| (low[k] - 0.5).ceil().max(0.0) as u32);
    let [right, bottom] = [0, 1].map(|k| ((high[k] - 0.5).floor() + 1.0).max(0.0) as u32).map(|end| end.min(1 << 14));
    let [a, b, c] = places;
    let cross = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let winding = if cross(a, b, c) < 0.0 { -1.0 } else { 1.0 };
    for y in top..bottom.min(size[1]) {
        for x in left..right.min(size[0]) {
            let centre = [f64::from(x) + 0.5, f64::from(y) + 0.5];
            if [(a, b), (b, c), (c, a)].iter().all(|&(p, q)| cross(p, q, centre) * winding >= 0.0) {
                visit(y as usize * size[0] as usize + x as usize);
            }
        }
    }
}

/// For texels beyond those that are stored the nearest of these in their piece.
fn copies(map: &Map, is_covered: &[bool], stored_rings: u8) -> Vec<[u32; 2]> {
    let width = map.size[0] as usize;
    let mut ring = vec![u8::MAX; is_covered.len()];
    let mut copies = Vec::new();
    let mut pending = VecDeque::new();
    for piece in &map.pieces {
        let [[left, top], [right, bottom]] =
            piece.range().map(|place| [0, 1].map(|k| (place[k] as u32).min(map.size[k] - 1) as usize));
        for texel in (top..=bottom).flat_map(|y| (left..=right).map(move |x| y * width + x)) {
            if is_covered[texel] {
                ring[texel] = 0;
                pending.push_back((texel, texel));
            }
        }
        while let Some((texel, from)) = pending.pop_front() {
            let next = ring[texel] + 1;
            if next > RINGS {
                continue;
            }
            let [x, y] = [texel % width, texel / width];
            for v in y.saturating_sub(1).max(top)..=(y + 1).min(bottom) {
                for u in x.saturating_sub(1).max(left)..=(x + 1).min(right) {
                    let beside = v * width + u;
                    if ring[beside] > next {
                        ring[beside] = next;
                        let from = if next <= stored_rings { beside } else { from };
                        if next > stored_rings {
                            copies.push([beside as u32, from as u32]);
                        }
                        pending.push_back((beside, from));
                    }
                }
            }
        }
    }
    copies
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::*;
    use crate::write::{PieceShape, encode_map};

    #[test]
    fn what_nothing_was_stored_for_gets_the_value_of_the_nearest_texel() {
        // A triangle covers half of its rectangle.
        let (positions, triangles) = (vec![[0, 0, 0], [640, 0, 0], [0, 640, 0]], vec![[0, 1, 2]]);
        let shapes = [PieceShape { axis: [0, 0, 1], ..PieceShape::default() }];
        let (map, _) = encode_map(&positions, &triangles, 8, &shapes, &[0], 1 << 20).unwrap();
        let covered = Covered::new(&map, &positions, &triangles, false);
        let count = covered.is_covered.iter().filter(|&&is_covered| is_covered).count();
        assert!((800..=930).contains(&count), "{count} of 41 * 41 / 2");
        let mut image = Image::filled(map.size, &[0_u16]);
        let [width, height] = map.size;
        for texel in (0..image.data.len()).filter(|&texel| covered.is_covered[texel]) {
            image.data[texel] = 50;
        }
        // Two rings are stored, or none of a smaller image: then these are filled, too.
        let stored = image.clone();
        let mut smaller = image.clone();
        Covered::new(&map, &positions, &triangles, true).fill(&mut smaller);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let is_near = (-2..=2).flat_map(|v| (-2..=2).map(move |u| [u, v])).any(|[u, v]| {
                let [x, y] = [x as i32 + u, y as i32 + v];
                let is_in = (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
                is_in && stored.texel(x as u32, y as u32) == [50]
            });
            if is_near {
                image.data[(y * width + x) as usize] = 50;
            }
        }
        covered.fill(&mut image);
        assert_eq!(covered.mean(&image), [50.0, 0.0, 0.0, 0.0]);
        let filled = image.data.iter().filter(|&&value| value == 50).count();
        let all = image.data.len();
        assert!(filled > all * 3 / 4 && filled < all, "{filled} of {all}: so far and no further");
        assert_eq!(smaller, image);
    }
}
