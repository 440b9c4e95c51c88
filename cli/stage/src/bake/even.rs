//! Patches whose triangles are each of one colour, as those of most designed parts: nothing but a palette is stored.
//!
//! All triangles that look alike are one piece of a map whose texels are larger than any surface, so that each of its
//! points lies in the same texel. A part of a machine takes some ten bytes in place of kilobytes, and its colours end
//! where its triangles do.

use std::collections::{BTreeMap, HashMap};

use lodpack::write::{PieceShape, Seen, encode_map};

use super::coded::Steps;
use super::storage::{Storage, Stored};
use super::{BakedPatch, MAX_EXPONENT, MAX_TEXELS};

/// Palettes are small, so hardly anything of their colours may be lost.
const FINE: Steps = Steps { opaque_colours: 0.0, are_finer_in_grain: false, others: 0.0 };

/// What the triangles of a patch show, each one thing.
pub struct Palette<'s> {
    storage: &'s Storage,
    /// The entry of what is stored of a texel.
    entries: HashMap<Vec<u8>, u16>,
    /// Of each entry its values, and as many weights as texels have.
    values: Vec<f32>,
    /// The entry of each triangle.
    labels: Vec<u16>,
}

impl<'s> Palette<'s> {
    fn empty(storage: &'s Storage) -> Self {
        Self { storage, entries: HashMap::new(), values: vec![], labels: vec![] }
    }

    /// Of a patch of whose triangles the looks are known. `values` are those of a point of each look. None if a look is
    /// not among them, or if something would be lost.
    pub fn of_looks(looks: &[u32], values: &BTreeMap<u32, Vec<f32>>, storage: &'s Storage) -> Option<Self> {
        let mut palette = Self::empty(storage);
        let (mut known, mut bytes) = (HashMap::new(), vec![]);
        let mut texel = vec![0.0; storage.stride()];
        for look in looks {
            let label = match known.get(look) {
                Some(&label) => label,
                None => {
                    texel[..storage.count()].copy_from_slice(values.get(look)?);
                    storage.write_texel(&texel, 0, &mut bytes);
                    let label = palette.entry(&bytes, &texel)?;
                    known.insert(*look, label);
                    label
                }
            };
            palette.labels.push(label);
        }
        Self::fits(palette.entries.len(), storage).then_some(palette)
    }

    /// The entry of a texel of which these bytes are stored. None if there are too many.
    fn entry(&mut self, bytes: &[u8], texel: &[f32]) -> Option<u16> {
        if let Some(&entry) = self.entries.get(bytes) {
            return Some(entry);
        }
        let entry = u16::try_from(self.entries.len()).ok().filter(|&entry| entry < u16::MAX)?;
        self.entries.insert(bytes.to_vec(), entry);
        self.values.extend_from_slice(texel);
        Some(entry)
    }

    /// Whether images of so many colours come back as they are, whatever size they are read at: smaller images of
    /// several colours would mix them.
    pub fn fits(colours: usize, storage: &Storage) -> bool {
        let is_number = |channel: &Stored| matches!(channel, Stored::Scalar { .. } | Stored::Label { .. });
        let is_whole = |channel: &Stored| is_number(channel) || channel.is_exact();
        colours == 1 || colours < usize::from(u16::MAX) && storage.channels().iter().all(is_whole)
    }

    /// The streams of the map of the patch, and of the image of each channel.
    pub fn streams(&self, patch: &BakedPatch<'_>) -> Option<Vec<Vec<u8>>> {
        let Self { storage, values, labels, .. } = self;
        let shapes = vec![PieceShape { axis: [0, 0, 1], ..PieceShape::default() }; self.entries.len()];
        let (positions, triangles) = (patch.positions, patch.triangles);
        let (map, bytes) = encode_map(positions, triangles, MAX_EXPONENT, &shapes, labels, MAX_TEXELS).ok()?;
        let (stride, width) = (storage.stride(), map.size[0] as usize);
        let mut is_used = vec![false; width * map.size[1] as usize];
        let mut texels = vec![0.0; is_used.len() * stride];
        for (&piece, &entry) in map.labels.iter().zip(labels) {
            let [[left, top], [right, bottom]] =
                map.pieces[usize::from(piece)].range().map(|corner| corner.map(|x| x as usize));
            if is_used[top * width + left] {
                continue;
            }
            let own = &values[usize::from(entry) * stride..][..stride];
            for texel in (top..=bottom).flat_map(|row| (left..=right).map(move |column| row * width + column)) {
                is_used[texel] = true;
                texels[texel * stride..][..stride].copy_from_slice(own);
            }
        }
        let seen = Seen::new(&is_used, map.size, []);
        let mut streams = vec![bytes];
        streams.extend(storage.encode(&map, &texels, &is_used, &seen, FINE, &mut vec![]));
        Some(streams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack::LatticePoint;
    use lodpack::decode::ChannelImage;
    use lodpack::decode::texels::Map;

    /// Triangles all over the lattice.
    fn scattered(count: u32) -> (Vec<LatticePoint>, Vec<[u32; 3]>) {
        let at = |number: i64, k: i64| {
            ((number * 7919 + k * 104_729) % 2_000_003 - 1_000_001) * [1, 500_000][number as usize % 2]
        };
        let positions = (0..3 * i64::from(count)).map(|number| [at(number, 1), at(number, 2), at(number, 3)]).collect();
        (positions, (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
    }

    fn patch<'a>(positions: &'a [LatticePoint], triangles: &'a [[u32; 3]]) -> BakedPatch<'a> {
        BakedPatch { positions, triangles, reach: 0.0, areas: None, finer: 0, is_sharp: false }
    }

    /// What a place of an image shows.
    fn numbers(image: &ChannelImage, [x, y]: [f64; 2]) -> Vec<u16> {
        let (x, y) = (x as u32, y as u32);
        match image {
            ChannelImage::Colours(image) | ChannelImage::Factors(image) | ChannelImage::Normals(image) => {
                image.texel(x, y).iter().map(|&byte| byte.into()).collect()
            }
            ChannelImage::Values(image) => image.texel(x, y).to_vec(),
        }
    }

    #[test]
    fn each_triangle_shows_its_look_wherever_it_is_read() {
        let channels =
            vec![Stored::Colour { components: 3, step: 0 }, Stored::Factor { step: 0 }, Stored::Label { low: 2.0 }];
        let storage = Storage::new(channels);
        // The last two differ by less than what is stored.
        let values = BTreeMap::from([
            (4, vec![1.0, 0.0, 0.0, 1.0, 7.0]),
            (9, vec![0.0, 1.0, 0.0, 0.2, 2.0]),
            (11, vec![0.0, 1.0, 1e-9, 0.2, 2.0]),
        ]);
        let expected = |look: u32| match look {
            4 => [vec![255, 0, 0], vec![255], vec![5]],
            _ => [vec![0, 255, 0], vec![51], vec![0]],
        };
        let (positions, triangles) = scattered(60);
        let looks: Vec<u32> = (0..60).map(|t| [4, 9, 11, 9][t % 4]).collect();
        let patch = patch(&positions, &triangles);
        let streams = Palette::of_looks(&looks, &values, &storage).unwrap().streams(&patch).unwrap();
        let map = Map::decode(&streams[0], &positions, &triangles, 1000).unwrap();
        assert!(map.is_palette() && map.smallest_texel().is_none() && map.pieces.len() == 2);
        let bytes: usize = streams.iter().map(Vec::len).sum();
        assert!(bytes < 80, "{bytes}");
        let images: Vec<ChannelImage> = storage
            .by_channel(&streams[1..])
            .map(|(channel, streams)| channel.decode(streams, &map).unwrap())
            .collect();
        for (number, (corners, &look)) in triangles.iter().zip(&looks).enumerate() {
            for place in corners.map(|corner| map.piece(number).place(positions[corner as usize])) {
                for away in [[-0.5, -0.5], [0.49, -0.5], [-0.5, 0.49], [0.49, 0.49]] {
                    let place = [0, 1].map(|k| place[k] + away[k]);
                    let found: Vec<Vec<u16>> = images.iter().map(|image| numbers(image, place)).collect();
                    assert_eq!(found, expected(look), "{number} {place:?}");
                }
            }
        }
    }

    #[test]
    fn images_that_may_lose_something_have_one_colour_or_no_palette() {
        let storage = Storage::new(vec![Stored::Colour { components: 3, step: 9 }]);
        let values = BTreeMap::from([(0, vec![0.3, 0.2, 0.1]), (1, vec![0.9, 0.2, 0.1])]);
        assert!(Palette::of_looks(&[0, 1], &values, &storage).is_none());
        assert!(Palette::of_looks(&[0, 2], &values, &storage).is_none());
        let (positions, triangles) = scattered(5);
        let palette = Palette::of_looks(&[1; 5], &values, &storage).unwrap();
        let streams = palette.streams(&patch(&positions, &triangles)).unwrap();
        let map = Map::decode(&streams[0], &positions, &triangles, 100).unwrap();
        for scale in 1..=4 {
            let image = lodpack::decode::texels::Image::decode_scaled(&streams[1..1 + scale], map.size, 3).unwrap();
            let [red, green, blue] = [0, 1, 2].map(|k| i32::from(image.data[k]));
            let is_near = (red - 243).abs() < 3 && (green - 124).abs() < 3 && (blue - 89).abs() < 3;
            assert!(is_near && image.data.chunks(3).all(|texel| texel == &image.data[..3]), "{:?}", image.data);
        }
    }
}
