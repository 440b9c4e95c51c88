//! Texels of groups above regions: means of those of the tops of regions, since the input is not at hand where regions
//! are joined.

use std::collections::BTreeMap;

use glam::DVec3;
use lodpack::decode::texels::{Map, Piece};
use lodpack::write::RootRecord;

use super::super::drawn::DrawnBlocks;
use super::Node;
use lodpack_stage::bake::exponent_of;
use lodpack_stage::bake::{
    BakedPatch, Baker, Images, Located, MAX_EXPONENT, MAX_TEXELS, Palette, Points, Source, Storage,
};
use lodpack_stage::certify::{Hint, Surface};

/// Texels for each triangle that is of one colour.
const TEXELS_OF_EVEN: f64 = 4.0;

/// Where triangles are looked at: this far from the middle to each corner.
const NEAR_CORNERS: f64 = 0.8;
/// Groups have palettes if at most one in so many triangles shows more than one thing.
const MOST_UNEVEN: usize = 20;

/// Twice the area of each triangle.
fn doubled_areas(positions: &[DVec3], triangles: &[[u32; 3]]) -> impl Iterator<Item = f64> {
    let corners = |&corners: &[u32; 3]| corners.map(|vertex| positions[vertex as usize]);
    triangles.iter().map(corners).map(|[a, b, c]| (b - a).cross(c - a).length())
}

/// A top whose texels are known.
pub(super) struct KnownTop {
    /// Lattice units.
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    map: Map,
    /// The size of the texels of each piece, lattice units.
    sizes: Vec<f64>,
    images: Images,
}

impl KnownTop {
    /// Decodes the streams of a top. None if it has none.
    pub fn new(node: &Node, streams: &[Vec<u8>], storage: &Storage, step: f64) -> Option<Self> {
        let (map, streams) = streams.split_first().filter(|(map, _)| !map.is_empty())?;
        let positions: Vec<DVec3> = node.surface.positions.iter().map(|&point| (point / step).round()).collect();
        let lattice: Vec<[i64; 3]> = positions.iter().map(|point| point.to_array().map(|x| x as i64)).collect();
        let map = Map::decode(map, &lattice, &node.surface.triangles, MAX_TEXELS).ok()?;
        let images = storage.by_channel(streams).map(|(channel, streams)| channel.decode(streams, &map));
        let images = images.collect::<Option<Vec<_>>>()?;
        let images = Images::new(storage, images);
        let triangles = node.surface.triangles.clone();
        // A palette is shown by so many texels.
        let area = 0.5 * doubled_areas(&positions, &triangles).sum::<f64>();
        let even = (area / (TEXELS_OF_EVEN * triangles.len() as f64)).sqrt();
        let size = |piece: &Piece| if piece.is_even() { even } else { piece.texel_size() };
        let sizes = map.pieces.iter().map(size).collect();
        Some(Self { positions, triangles, map, sizes, images })
    }

    /// The size of the texels of a triangle, lattice units.
    fn texel_size(&self, triangle: usize) -> f64 {
        self.sizes[usize::from(self.map.labels[triangle])]
    }

    /// The size of its texels if all were alike and there were as many.
    fn mean_size(&self) -> f64 {
        let (mut area, mut texels) = (0.0, 0.0);
        for (triangle, doubled) in doubled_areas(&self.positions, &self.triangles).enumerate() {
            let size = self.texel_size(triangle);
            (area, texels) = (area + doubled, texels + doubled / (size * size));
        }
        if texels > 0.0 { (area / texels).sqrt() } else { self.sizes.first().copied().unwrap_or(1.0) }
    }

    /// Appends the values at a point of a triangle.
    fn sample(&self, triangle: usize, point: DVec3, footprint: f64, values: &mut Vec<f32>) {
        let piece = self.map.piece(triangle);
        let place = piece.unbounded(point.to_array());
        self.images.sample(place, piece.range(), footprint / self.texel_size(triangle), values);
    }
}

/// Gives groups texels. The first records are those of nodes, `count` of them, of which each node names its own;
/// `drawn` is what the blocks of all records decode to.
pub(super) fn paint_above(
    records: &mut [RootRecord],
    count: usize,
    drawn: &[DrawnBlocks],
    tops: &[(u32, Option<KnownTop>)],
    [bottom, step]: [f64; 2],
    storage: &Storage,
) {
    let mut below: Vec<Vec<u32>> = vec![vec![]; records.len()];
    (0..).zip(tops).for_each(|(top, (record, _))| below[*record as usize].push(top));
    for record in 0..records.len() {
        if let Some(parent) = records[record].parent {
            let members = below[record].clone();
            below[parent as usize].extend(members);
        }
    }
    let mut baker = Baker::new(storage);
    for (number, record) in records.iter_mut().enumerate().skip(count) {
        let known: Vec<&KnownTop> = below[number].iter().filter_map(|&top| tops[top as usize].1.as_ref()).collect();
        let size = known.iter().map(|top| top.mean_size()).fold(f64::INFINITY, f64::min);
        if !size.is_finite() {
            continue;
        }
        let even = EvenTops::of(&known, storage);
        let own = (0..).zip(&known).flat_map(|(top, known)| (0..known.triangles.len() as u32).map(move |t| [top, t]));
        let mut source = Located::new(TopSource { own: own.collect(), known: &known });
        for (level, (block, drawn)) in record.blocks.iter_mut().zip(&drawn[number]).enumerate() {
            let (Some(block), Some(drawn)) = (block, drawn) else { continue };
            let patch = BakedPatch {
                positions: &drawn.positions,
                triangles: &drawn.triangles,
                reach: block.error / step,
                areas: None,
                finer: 0,
                is_sharp: false,
            };
            if let Some(streams) = even.as_ref().and_then(|even| even.streams(&patch, storage)) {
                block.texels = streams;
                continue;
            }
            let steps = (bottom - level as f64).max(0.0) as u32;
            let exponent = (exponent_of(size) + 2 * steps).min(MAX_EXPONENT);
            let baked = baker.bake_closest(&patch, &mut source, exponent);
            block.texels = baked.map_or(vec![], |baked| baked.streams);
        }
    }
}

/// The triangles of several tops of which each has a palette.
struct EvenTops {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The look of each triangle, and the values of each look.
    looks: Vec<u32>,
    values: BTreeMap<u32, Vec<f32>>,
}

impl EvenTops {
    /// None if one of them is no palette.
    fn of(known: &[&KnownTop], storage: &Storage) -> Option<Self> {
        let mut all = Self { positions: vec![], triangles: vec![], looks: vec![], values: BTreeMap::new() };
        for top in known {
            if !top.map.is_palette() {
                return None;
            }
            let (first, first_look) = (all.positions.len() as u32, all.values.len() as u32);
            all.positions.extend_from_slice(&top.positions);
            all.triangles.extend(top.triangles.iter().map(|corners| corners.map(|vertex| first + vertex)));
            all.looks.extend(top.map.labels.iter().map(|&label| first_look + u32::from(label)));
            for (look, piece) in (first_look..).zip(&top.map.pieces) {
                let mut values = Vec::with_capacity(storage.count());
                let [[left, above], [right, below]] = piece.range();
                top.images.sample([0.5 * (left + right), 0.5 * (above + below)], piece.range(), 0.0, &mut values);
                all.values.insert(look, values);
            }
        }
        Some(all)
    }

    /// The streams of a patch whose triangles look like what is nearest to their middles. None if many show more than
    /// one thing: a coarse triangle may lie over several parts.
    fn streams(&self, patch: &BakedPatch<'_>, storage: &Storage) -> Option<Vec<Vec<u8>>> {
        let surface = Surface::new(&self.positions, &self.triangles);
        let mut hint = Hint::default();
        let mut look_at =
            |point: DVec3| self.looks.get(surface.bvh().closest(point, &mut hint).triangle as usize).copied();
        let (mut looks, mut uneven) = (Vec::with_capacity(patch.triangles.len()), 0);
        for corners in patch.triangles {
            let points = corners.map(|vertex| DVec3::from(patch.positions[vertex as usize].map(|x| x as f64)));
            let middle = points.iter().sum::<DVec3>() / 3.0;
            let look = look_at(middle)?;
            let is_even = points.into_iter().all(|point| look_at(middle.lerp(point, NEAR_CORNERS)) == Some(look));
            uneven += usize::from(!is_even);
            looks.push(look);
        }
        if uneven * MOST_UNEVEN > looks.len() {
            return None;
        }
        Palette::of_looks(&looks, &self.values, storage)?.streams(patch)
    }
}

/// The triangles of several tops.
struct TopSource<'a> {
    /// Top and triangle.
    own: Vec<[u32; 2]>,
    known: &'a [&'a KnownTop],
}

impl TopSource<'_> {
    fn at(&self, triangle: usize) -> (&KnownTop, usize) {
        let [top, triangle] = self.own[triangle];
        (self.known[top as usize], triangle as usize)
    }
}

impl Source for TopSource<'_> {
    fn triangle_count(&self) -> usize {
        self.own.len()
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        let (top, triangle) = self.at(triangle);
        top.triangles[triangle].map(|vertex| top.positions[vertex as usize])
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        let corners = self.corners(triangle);
        let (top, triangle) = self.at(triangle);
        for weights in points.iter().flat_map(|points| points.weights()) {
            let point = (0..3).map(|k| corners[k] * f64::from(weights[k])).sum();
            top.sample(triangle, point, f64::from(footprint), values);
        }
    }
}
