//! Maps: where each triangle of a patch lies in the images over it.

use std::collections::HashMap;

#[cfg(feature = "write")]
use super::binary::BitEncoder;
#[cfg(feature = "write")]
use super::shape::{MAX_EXPONENT, PieceShape};
use super::{
    binary::{BitDecoder, Chance, NumberChances},
    shape::Shape,
};
use crate::{
    codec::{
        patch::LatticePoint,
        vector::{Vec3, cross, dot, scale, to_f64},
    },
    error::{Error, Result},
    limits::within,
};

/// Texels between a piece and the edges of its rectangle.
const GUTTER: f64 = 1.0;
/// Largest number of texels along each side of an image.
pub(super) const LONGEST: u32 = 1 << 14;
/// Texels of this side, in lattice units, are larger than any surface: coordinates go to 2^40.
const BEYOND: f64 = (1_u64 << 60) as f64;

/// A part of a patch, projected along an axis onto a rectangle of the image.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Piece {
    /// A place in the image is the product of a lattice point with each of these, plus `offset`; in texels.
    across: [Vec3; 2],
    offset: [f64; 2],
    /// Smallest and largest place: half a texel within the rectangle.
    range: [[f64; 2]; 2],
}

impl Piece {
    /// Where a point of the surface lies in the image, in texels. The point may be one of a finer border, beside the
    /// patch.
    pub fn place(&self, point: LatticePoint) -> [f64; 2] {
        let place = self.unbounded(to_f64(point));
        [0, 1].map(|k| place[k].clamp(self.range[0][k], self.range[1][k]))
    }

    /// Where any point lies, in lattice units, though it may be beside the rectangle.
    pub fn unbounded(&self, point: [f64; 3]) -> [f64; 2] {
        [0, 1].map(|k| dot(point, self.across[k]) + self.offset[k])
    }

    /// With what each coordinate of a point is multiplied to get each coordinate of its place, but for a constant.
    pub fn across(&self) -> [[f64; 3]; 2] {
        self.across
    }

    /// Its smallest and largest place in the image.
    pub fn range(&self) -> [[f64; 2]; 2] {
        self.range
    }

    /// The length and the width of a texel, lattice units: along a row of the image, and along a column.
    pub fn texel(&self) -> [f64; 2] {
        let [length, width] = self.across.map(|across| 1.0 / dot(across, across).sqrt());
        // What differs by less was rounded.
        [length, if (width / length - 1.0).abs() < 1e-9 { length } else { width }]
    }

    /// Whether all of it looks the same: its texels are larger than any surface.
    pub fn is_even(&self) -> bool {
        self.texel().iter().all(|&side| side >= BEYOND)
    }

    /// The directions of a row and of a column of texels, and that of its axis; all of length 1.
    pub fn frame(&self) -> [[f64; 3]; 3] {
        let [a, b] = self.across;
        let [length, width] = self.texel();
        [scale(a, length), scale(b, width), scale(cross(a, b), length * width)]
    }

    /// The size of a texel, lattice units: the side of a square of its area.
    pub fn texel_size(&self) -> f64 {
        let [length, width] = self.texel();
        if length == width { length } else { (length * width).sqrt() }
    }
}

/// The size of an image after it has been halved so many times along each side.
pub(crate) fn halved(size: [u32; 2], times: u8) -> [u32; 2] {
    size.map(|length| u64::from(length).div_ceil(1 << times.min(31)) as u32)
}

/// The map of a patch.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Map {
    /// Texels in a row of its images, and rows.
    pub size: [u32; 2],
    /// Its pieces.
    pub pieces: Vec<Piece>,
    /// The piece of each triangle.
    pub labels: Vec<u16>,
}

/// Smallest and largest products of the corners of each piece's triangles. None for a piece without triangles.
fn extents(
    across: &[[Vec3; 2]],
    labels: &[u16],
    positions: &[LatticePoint],
    triangles: &[[u32; 3]],
) -> Vec<Option<[[f64; 2]; 2]>> {
    let mut extents = vec![None; across.len()];
    for (corners, &label) in triangles.iter().zip(labels) {
        let across = &across[usize::from(label)];
        let [low, high] = extents[usize::from(label)].get_or_insert([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]]);
        for &corner in corners {
            let point = to_f64(positions[corner as usize]);
            for k in 0..2 {
                let product = dot(point, across[k]);
                (low[k], high[k]) = (low[k].min(product), high[k].max(product));
            }
        }
    }
    extents
}

/// The size of a piece's rectangle.
fn rectangle([low, high]: [[f64; 2]; 2]) -> Result<[u32; 2]> {
    let length = |k: usize| high[k].floor() - low[k].floor() + 1.0 + 2.0 * GUTTER;
    let lengths = [length(0), length(1)];
    if lengths.iter().all(|&length| length <= f64::from(LONGEST)) {
        Ok(lengths.map(|length| length as u32))
    } else {
        Err(Error::format("a piece of a map is longer than 16384 texels"))
    }
}

/// Where rectangles lie in an image of a width: in rows from left to right, each as high as its highest. Returns the
/// height, too.
fn packed(rectangles: &[[u32; 2]], width: u32) -> Option<(Vec<[u32; 2]>, u32)> {
    let (mut places, mut left, mut top, mut height) = (vec![], 0, 0_u32, 0);
    for &[w, h] in rectangles {
        if w > width {
            return None;
        }
        if left + w > width {
            (left, top, height) = (0, top.checked_add(height)?, 0);
        }
        places.push([left, top]);
        left += w;
        height = height.max(h);
    }
    Some((places, top.checked_add(height)?))
}

/// The labels of the triangles before that share an edge with one, of which the label is known.
#[derive(Default)]
struct Neighbours {
    label_of: HashMap<[u32; 2], u16>,
}

impl Neighbours {
    /// Up to two different labels: the one that most neighbours have comes first, or that of the earliest edge.
    fn expected(&self, [a, b, c]: [u32; 3]) -> [Option<u16>; 2] {
        let labels = [[a, b], [b, c], [c, a]].map(|[p, q]| self.label_of.get(&[p.min(q), p.max(q)]).copied());
        let mut found = labels.into_iter().flatten();
        let Some(first) = found.next() else { return [None; 2] };
        let (second, third) = (found.next(), found.next());
        match (second, third) {
            (Some(second), Some(third)) if second == third && second != first => [Some(second), Some(first)],
            _ => [Some(first), second.filter(|&s| s != first).or(third.filter(|&t| t != first))],
        }
    }

    fn add(&mut self, [a, b, c]: [u32; 3], label: u16) {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            self.label_of.insert([p.min(q), p.max(q)], label);
        }
    }
}

/// How labels are coded.
#[derive(Default)]
struct LabelChances {
    is_first: [Chance; 2],
    is_second: Chance,
}

/// How many bits a label has.
fn label_bits(pieces: usize) -> u32 {
    usize::BITS - (pieces - 1).leading_zeros()
}

impl Map {
    /// Decodes the map of a patch whose vertices have these positions.
    ///
    /// # Errors
    /// If the bytes break a rule of the format, or the map has more texels than `limit`.
    pub fn decode(bytes: &[u8], positions: &[LatticePoint], triangles: &[[u32; 3]], limit: u64) -> Result<Self> {
        let mut bits = BitDecoder::new(bytes);
        let exponent = bits.raw(7);
        let mut chances = NumberChances::default();
        let count = bits.number(&mut chances)? as usize + 1;
        if count > triangles.len() || count > usize::from(u16::MAX) {
            return Err(Error::format("a map has more pieces than its patch has triangles"));
        }
        let width = bits.number(&mut NumberChances::default())?;
        let mut across = vec![];
        for _ in 0..count {
            bits.check()?;
            across.push(Shape::decode(&mut bits)?.across(exponent));
        }
        let labels = decode_labels(&mut bits, count, triangles)?;
        bits.finish()?;
        Self::new(&across, width, labels, positions, triangles, limit)
    }

    fn new(
        across: &[[Vec3; 2]],
        width: u32,
        labels: Vec<u16>,
        positions: &[LatticePoint],
        triangles: &[[u32; 3]],
        limit: u64,
    ) -> Result<Self> {
        let extents = extents(across, &labels, positions, triangles);
        let extents: Option<Vec<[[f64; 2]; 2]>> = extents.into_iter().collect();
        let extents = extents.ok_or_else(|| Error::format("a piece of a map has no triangle"))?;
        let rectangles = extents.iter().map(|&extent| rectangle(extent)).collect::<Result<Vec<_>>>()?;
        let too_large = || Error::format("the pieces of a map do not fit into its width");
        let (places, height) = packed(&rectangles, width).ok_or_else(too_large)?;
        if width.max(height) > LONGEST {
            return Err(Error::format("a map is longer than 16384 texels"));
        }
        within(limit, u64::from(width) * u64::from(height), "number of texels of a map")?;
        let pieces = (0..across.len()).map(|number| {
            let [place, size] = [places[number], rectangles[number]].map(|pair| pair.map(f64::from));
            let low = extents[number][0].map(f64::floor);
            Piece {
                across: across[number],
                offset: [0, 1].map(|k| place[k] + GUTTER - low[k]),
                range: [[0, 1].map(|k| place[k] + 0.5), [0, 1].map(|k| place[k] + size[k] - 0.5)],
            }
        });
        Ok(Self { size: [width, height], pieces: pieces.collect(), labels })
    }

    /// The map of the same images, halved so many times along each side: a texel is the mean of a square of theirs.
    pub fn halved(&self, times: u8) -> Self {
        let share = 1.0 / f64::from(1_u32 << times.min(31));
        let pieces = self.pieces.iter().map(|piece| Piece {
            across: piece.across.map(|across| scale(across, share)),
            offset: piece.offset.map(|x| x * share),
            range: piece.range.map(|place| place.map(|x| x * share)),
        });
        Self { size: halved(self.size, times), pieces: pieces.collect(), labels: self.labels.clone() }
    }

    /// Whether it is a palette: each of its pieces looks the same all over, so that its images must not be made
    /// smaller.
    pub fn is_palette(&self) -> bool {
        self.pieces.iter().all(Piece::is_even)
    }

    /// The side of the smallest texels that show more than one colour each, lattice units. None if there are none.
    pub fn smallest_texel(&self) -> Option<f64> {
        let uneven = self.pieces.iter().filter(|piece| !piece.is_even());
        uneven.map(Piece::texel_size).min_by(f64::total_cmp)
    }

    /// The piece of a triangle.
    ///
    /// # Panics
    /// If the patch does not have the triangle.
    pub fn piece(&self, triangle: usize) -> &Piece {
        &self.pieces[usize::from(self.labels[triangle])]
    }
}

fn decode_labels(bits: &mut BitDecoder<'_>, pieces: usize, triangles: &[[u32; 3]]) -> Result<Vec<u16>> {
    if pieces == 1 {
        return Ok(vec![0; triangles.len()]);
    }
    let mut chances = LabelChances::default();
    let mut neighbours = Neighbours::default();
    let mut labels = Vec::new();
    for (number, &corners) in triangles.iter().enumerate() {
        if number % 256 == 0 {
            bits.check()?;
        }
        let [first, second] = neighbours.expected(corners);
        let label = match (first, second) {
            (Some(first), _) if bits.bit(&mut chances.is_first[usize::from(second.is_some())]) => first,
            (_, Some(second)) if bits.bit(&mut chances.is_second) => second,
            _ => bits.raw(label_bits(pieces)) as u16,
        };
        if usize::from(label) >= pieces {
            return Err(Error::format("a triangle names a piece of a map that does not exist"));
        }
        neighbours.add(corners, label);
        labels.push(label);
    }
    Ok(labels)
}

/// Codes a map: texels of 2^(exponent / 2) lattice units where they are not larger or longer, pieces along these axes,
/// and the piece of each triangle. Pieces may get other numbers.
///
/// # Errors
/// If the pieces break a rule of the format, or have more texels than `limit`.
#[cfg(feature = "write")]
pub fn encode_map(
    positions: &[LatticePoint],
    triangles: &[[u32; 3]],
    exponent: u32,
    shapes: &[PieceShape],
    labels: &[u16],
    limit: u64,
) -> Result<(Map, Vec<u8>)> {
    if labels.len() != triangles.len() || labels.iter().any(|&label| usize::from(label) >= shapes.len()) {
        return Err(Error::model("a triangle names a piece of a map that does not exist"));
    }
    let exponent = exponent.min(MAX_EXPONENT);
    let finer = shapes.iter().map(PieceShape::finer).max().unwrap_or(0).min(exponent as u8);
    let exponent = exponent - u32::from(finer);
    // The turn whose rectangle is smallest.
    let candidates: Vec<Vec<Shape>> = shapes.iter().map(|shape| shape.candidates(finer)).collect();
    let most = candidates.iter().map(Vec::len).max().unwrap_or(0);
    let mut best: Vec<Option<(f64, Shape, [u32; 2])>> = vec![None; shapes.len()];
    for number in 0..most {
        let turned: Vec<Shape> = candidates.iter().map(|all| all[number.min(all.len() - 1)]).collect();
        let across: Vec<[Vec3; 2]> = turned.iter().map(|shape| shape.across(exponent)).collect();
        for ((extent, shape), best) in
            extents(&across, labels, positions, triangles).into_iter().zip(turned).zip(&mut best)
        {
            let Some(extent) = extent else { return Err(Error::model("a piece of a map has no triangle")) };
            let size = rectangle(extent)?;
            let area = f64::from(size[0]) * f64::from(size[1]);
            if best.as_ref().is_none_or(|best| area < best.0) {
                *best = Some((area, shape, size));
            }
        }
    }
    let best: Vec<(f64, Shape, [u32; 2])> = best.into_iter().flatten().collect();
    let mut order: Vec<usize> = (0..best.len()).collect();
    // The highest first, so that rows waste little.
    order.sort_by_key(|&piece| (std::cmp::Reverse(best[piece].2[1]), piece));
    let rectangles: Vec<[u32; 2]> = order.iter().map(|&piece| best[piece].2).collect();
    let widest = rectangles.iter().map(|size| size[0]).max().unwrap_or(1);
    let side = best.iter().map(|piece| piece.0).sum::<f64>().sqrt();
    let widths = (4..16).map(|eighths| (side * f64::from(eighths) / 8.0).ceil() as u32).chain([widest]);
    let fitting = widths.map(|width| width.max(widest));
    let measured = fitting.filter_map(|width| {
        let (_, height) = packed(&rectangles, width)?;
        (height.max(width) <= LONGEST).then_some((u64::from(width) * u64::from(height), width))
    });
    let Some((_, width)) = measured.min() else {
        return Err(Error::model("a map has no pieces, or is longer than 16384 texels"));
    };

    let mut number_of = vec![0; order.len()];
    (0..).zip(&order).for_each(|(number, &piece)| number_of[piece] = number);
    let labels: Vec<u16> = labels.iter().map(|&label| number_of[usize::from(label)]).collect();
    let shapes: Vec<Shape> = order.iter().map(|&piece| best[piece].1).collect();
    let across: Vec<[Vec3; 2]> = shapes.iter().map(|shape| shape.across(exponent)).collect();

    let mut bits = BitEncoder::new();
    bits.raw(7, exponent);
    bits.number(&mut NumberChances::default(), shapes.len() as u32 - 1);
    bits.number(&mut NumberChances::default(), width);
    for shape in &shapes {
        shape.encode(&mut bits);
    }
    encode_labels(&mut bits, shapes.len(), triangles, &labels);
    Ok((Map::new(&across, width, labels, positions, triangles, limit)?, bits.finish()))
}

#[cfg(feature = "write")]
fn encode_labels(bits: &mut BitEncoder, pieces: usize, triangles: &[[u32; 3]], labels: &[u16]) {
    if pieces == 1 {
        return;
    }
    let mut chances = LabelChances::default();
    let mut neighbours = Neighbours::default();
    for (&corners, &label) in triangles.iter().zip(labels) {
        let [first, second] = neighbours.expected(corners);
        neighbours.add(corners, label);
        if let Some(first) = first {
            bits.bit(&mut chances.is_first[usize::from(second.is_some())], label == first);
            if label == first {
                continue;
            }
        }
        if let Some(second) = second {
            bits.bit(&mut chances.is_second, label == second);
            if label == second {
                continue;
            }
        }
        bits.raw(label_bits(pieces), u32::from(label));
    }
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::{super::shape::LongTexels, *};

    /// Two sheets of a roof, and one of the ground beneath.
    fn roof() -> (Vec<LatticePoint>, Vec<[u32; 3]>, Vec<u16>) {
        let (mut positions, mut triangles, mut labels) = (vec![], vec![], vec![]);
        for (label, slope) in [(0, 1), (1, -1), (2, 0)] {
            let first = positions.len() as u32;
            for y in 0..6 {
                for x in 0..6 {
                    let across = if label == 1 { 500 + x * 100 } else { x * 100 };
                    let height = if label == 1 { 500 - x * 100 } else { slope * x * 100 };
                    positions.push([across, y * 130, if label == 2 { -300 } else { height }]);
                }
            }
            for y in 0..5 {
                for x in 0..5 {
                    let corner = first + y * 6 + x;
                    triangles.extend([[corner, corner + 1, corner + 6], [corner + 1, corner + 7, corner + 6]]);
                    labels.extend([label; 2]);
                }
            }
        }
        (positions, triangles, labels)
    }

    #[test]
    fn maps_come_back_and_their_pieces_do_not_overlap() {
        let (positions, triangles, labels) = roof();
        let shapes = [[-7, 0, 7], [7, 0, 7], [0, 0, 1]].map(|axis| PieceShape { axis, ..PieceShape::default() });
        let (map, bytes) = encode_map(&positions, &triangles, 9, &shapes, &labels, 1 << 20).unwrap();
        assert_eq!(Map::decode(&bytes, &positions, &triangles, 1 << 20).unwrap(), map);
        assert!(bytes.len() < 30, "{}", bytes.len());
        let mut owner = vec![u16::MAX; (map.size[0] * map.size[1]) as usize];
        for (number, corners) in triangles.iter().enumerate() {
            for &corner in corners {
                let piece = map.piece(number);
                let [x, y] = piece.place(positions[corner as usize]);
                assert_eq!(piece.unbounded(to_f64(positions[corner as usize])), [x, y]);
                let texel = &mut owner[y as usize * map.size[0] as usize + x as usize];
                assert!(*texel == u16::MAX || *texel == map.labels[number]);
                *texel = map.labels[number];
            }
        }
        // A texel is as large as it says.
        let ([.., normal], size) = (map.pieces[0].frame(), map.pieces[0].texel_size());
        assert!((size - 2.0_f64.powf(4.5)).abs() < 1e-9 && (dot(normal, normal) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn no_map_is_higher_than_an_image_may_be() {
        // Strips that fill the least area in one column: 20 by 1,000 each, turned so that they are higher than wide.
        let (mut positions, mut triangles, mut labels) = (vec![], vec![], vec![]);
        for strip in 0..20 {
            let first = positions.len() as u32;
            positions.extend([[0, 0], [20, 0], [20, 1000], [0, 1000]].map(|[x, y]| [x + 40 * i64::from(strip), y, 0]));
            triangles.extend([[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|corner| first + corner)));
            labels.extend([strip; 2]);
        }
        let shapes = |across: [i8; 3]| {
            let long = Some(LongTexels { across, finer: 0, coarser: 1 });
            vec![PieceShape { axis: [0, 0, 1], larger: 0, long }; 20]
        };
        let encode = |across, limit| encode_map(&positions, &triangles, 0, &shapes(across), &labels, limit);
        for across in [[127, 0, 0], [0, 127, 0]] {
            let (map, _) = encode(across, 1 << 24).unwrap();
            assert!(map.size.iter().all(|&length| length <= LONGEST), "{:?}", map.size);
        }
    }

    #[test]
    fn pieces_have_texels_of_their_own_sizes() {
        let (positions, triangles, labels) = roof();
        let of = |larger: [u8; 3]| {
            let axes = [[-7, 0, 7], [7, 0, 7], [0, 0, 1]];
            let shapes = [0, 1, 2].map(|k| PieceShape { axis: axes[k], larger: larger[k], long: None });
            encode_map(&positions, &triangles, 9, &shapes, &labels, 1 << 20).unwrap()
        };
        let (map, bytes) = of([4, 0, 3]);
        assert_eq!(Map::decode(&bytes, &positions, &triangles, 1 << 20).unwrap(), map);
        for (triangle, exponent) in [(0, 6.5), (50, 4.5), (100, 6.0)] {
            let size = map.piece(triangle).texel_size();
            assert!((size - 2.0_f64.powf(exponent)).abs() < 1e-9, "{size}");
        }
        // What has the size of the map costs nothing, and a size of its own eleven bits.
        let (even, usual) = of([0; 3]);
        assert!(bytes.len() <= usual.len() + 4 && map.size[0] * map.size[1] < even.size[0] * even.size[1] / 2);
        // More than can be written, and more than any texel has.
        let (map, bytes) = of([255, 31, 40]);
        assert_eq!(Map::decode(&bytes, &positions, &triangles, 1 << 20).unwrap(), map);
        for at in 0..bytes.len() {
            for flipped in 1..=255 {
                let mut damaged = bytes.clone();
                damaged[at] ^= flipped;
                let _ = Map::decode(&damaged, &positions, &triangles, 1 << 20);
            }
        }
    }

    #[test]
    fn texels_may_be_longer_than_wide_in_any_direction() {
        let (positions, triangles, labels) = roof();
        let long = |across, finer, coarser| Some(LongTexels { across, finer, coarser });
        let of = |exponent: u32, larger: u8, long: Option<LongTexels>| {
            let mut shapes = [[-7, 0, 7], [7, 0, 7], [0, 0, 1]].map(|axis| PieceShape { axis, larger: 2, long: None });
            shapes[2] = PieceShape { larger, long, ..shapes[2] };
            let (map, bytes) = encode_map(&positions, &triangles, exponent, &shapes, &labels, 1 << 20).unwrap();
            assert_eq!(Map::decode(&bytes, &positions, &triangles, 1 << 20).unwrap(), map);
            for (triangle, corners) in triangles.iter().enumerate() {
                for point in corners.map(|corner| positions[corner as usize]) {
                    assert_eq!(map.piece(triangle).unbounded(to_f64(point)), map.piece(triangle).place(point));
                }
            }
            (map, bytes)
        };
        let size = |exponent: f64| 2.0_f64.powf(exponent / 2.0);
        let close = |one: f64, other: f64| (one / other - 1.0).abs() < 1e-9;
        for step in 0..36 {
            let (sine, cosine) = (f64::from(step) * std::f64::consts::PI / 36.0).sin_cos();
            let across = [cosine, sine, 0.0].map(|x| (x * 127.0).round() as i8);
            let (map, _) = of(9, 1, long(across, 3, 4));
            let ground = map.piece(100);
            assert!(close(map.piece(0).texel()[0], size(11.0)) && close(map.piece(0).texel()[1], size(11.0)));
            let [length, width] = ground.texel();
            let [u, v, axis] = ground.frame();
            let (shorter, longer, direction) = if length < width { (length, width, u) } else { (width, length, v) };
            assert!(close(shorter, size(7.0)) && close(longer, size(14.0)), "{length} {width}");
            assert!(close(ground.texel_size(), size(10.5)));
            // A turn is off by less than a degree.
            assert!(dot(direction, [cosine, sine, 0.0]).abs() > (1.0_f64).to_radians().cos(), "{direction:?} {step}");
            assert!(close(dot(axis, [0.0, 0.0, 1.0]), 1.0) && dot(u, v).abs() < 1e-12);
        }
        // No finer than the lattice, and no longer than can be written.
        let sides = |map: &Map| map.piece(100).texel();
        let [length, width] = sides(&of(2, 0, long([1, 0, 0], 5, 3)).0);
        assert!(close(length.min(width), 1.0) && close(length.max(width), size(5.0)), "{length} {width}");
        let [length, width] = sides(&of(4, 200, long([0, 90, 3], 255, 255)).0);
        assert!(length.is_finite() && width.is_finite());
        let (_, bytes) = of(9, 0, long([3, 4, 0], 2, 2));
        for at in 0..bytes.len() {
            for flipped in 1..=255 {
                let mut damaged = bytes.clone();
                damaged[at] ^= flipped;
                let _ = Map::decode(&damaged, &positions, &triangles, 1 << 20);
            }
        }
    }

    #[test]
    fn damaged_maps_are_refused_or_decoded_but_never_panic() {
        let (positions, triangles, labels) = roof();
        let shapes = [[-7, 0, 7], [7, 0, 7], [0, 0, 1]].map(|axis| PieceShape { axis, ..PieceShape::default() });
        let (_, bytes) = encode_map(&positions, &triangles, 9, &shapes, &labels, 1 << 20).unwrap();
        for at in 0..bytes.len() {
            for flip in 1..=255 {
                let mut damaged = bytes.clone();
                damaged[at] ^= flip;
                let _ = Map::decode(&damaged, &positions, &triangles, 1 << 20);
            }
            let _ = Map::decode(&bytes[..at], &positions, &triangles, 1 << 20);
        }
        let few = Map::decode(&bytes, &positions, &triangles, 10);
        assert!(matches!(few, Err(Error::Limit { .. })));
    }
}
