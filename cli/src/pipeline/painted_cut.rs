//! What a cut looks like, given to a mesh that was made from it.
//!
//! A reduced cut has no texels of its own. It is a patch like any other, so it gets a map and images: not from the input, which is not at
//! hand, but from the images of the cut.

use glam::DVec3;
use lodpack::decode::{ChannelImage, Patch, Texture, TexturedMesh};
use lodpack::index::{ChannelInfo, ChannelKind, TexelBytes};
use lodpack::{Lattice, Mesh};

use super::finish::Finished;
use super::texels::exponent_of;
use crate::mesh::NONE;
use crate::stage::areas::{Areas, ColourAreas};
use crate::stage::bake::{BakedPatch, Baker, Images, MAX_TEXELS, Points, Source, Storage, Stored};

/// The step of quantisation of images that are not stored.
const STEP: u8 = 1;

/// A reduced cut with images of the channels that the cut has: `channels` are those. None if nothing can be projected.
pub fn painted(
    cut: &TexturedMesh,
    channels: &[&ChannelInfo],
    areas: Option<&ColourAreas>,
    finished: &Finished,
    lattice: &Lattice,
) -> Option<TexturedMesh> {
    let flags = std::env::var("LPT").unwrap_or("cb".into());
    let has = |c: char| flags.contains(c);
    let storage = storage(channels)?;
    let on_lattice = |&position: &[f64; 3]| lattice.units(position).map(|units| units.round() as i64);
    let points: Vec<[i64; 3]> = finished.positions.iter().map(on_lattice).collect();
    let mut source = CutSource::new(cut, &storage, areas.filter(|_| has('b')), lattice);
    let sizes = cut.textures.iter().filter_map(|texture| Some(texture.map.as_ref()?.pieces.first()?.frame().1));
    let exponent = exponent_of(sizes.fold(f64::INFINITY, f64::min));
    let exponent = exponent.saturating_sub(flags.chars().filter(|&c| c == 'f').count() as u32);
    let exponent = exponent + flags.chars().filter(|&c| c == 'g').count() as u32;
    let reach = finished.error / lattice.step();
    let patch = BakedPatch {
        positions: &points,
        triangles: &finished.triangles,
        reach,
        areas: if has('b') { areas.and_then(|areas| Areas::of(&finished.areas, Some(&areas.jumps))) } else { None },
        finer: 0,
        is_sharp: !has('n'),
    };
    let mut baker = Baker::new(&storage);
    let baked = if has('c') {
        baker.bake_closest(&patch, &mut source, exponent)?
    } else {
        baker.bake(&patch, &mut source, exponent)?
    };
    let mut streams = baked.streams.into_iter();
    let bytes = TexelBytes { level: 0, map: streams.next()?, images: streams.collect() };
    let whole = Patch { triangles: finished.triangles.clone(), ..Patch::default() };
    let texture = Texture::decode(&bytes, channels, &points, &whole, MAX_TEXELS).ok()?;
    let map = texture.map.as_ref()?;
    let place = |(number, corners): (usize, &[u32; 3])| {
        corners.map(|corner| map.piece(number).place(points[corner as usize]).map(|x| x as f32))
    };
    Some(TexturedMesh {
        places: finished.triangles.iter().enumerate().map(place).collect(),
        mesh: Mesh {
            positions: finished.positions.clone(),
            triangle_nodes: vec![0; finished.triangles.len()],
            triangles: finished.triangles.clone(),
        },
        textures: vec![texture],
    })
}

/// How these channels are stored. None if one of them is of a kind that nothing is known of.
fn storage(channels: &[&ChannelInfo]) -> Option<Storage> {
    let of = |channel: &&ChannelInfo| match channel.kind {
        ChannelKind::Colour => Some(Stored::Colour { components: channel.components, step: STEP }),
        ChannelKind::Normal => Some(Stored::Normal { step: STEP }),
        ChannelKind::Factor if channel.components == 1 => Some(Stored::Factor { step: STEP }),
        ChannelKind::Label if channel.components == 1 && channel.step == 1.0 => {
            Some(Stored::Label { low: channel.low })
        }
        ChannelKind::Drawing => Some(Stored::Label { low: 0.0 }),
        ChannelKind::Scalar if channel.components == 1 => Some(Stored::Scalar { low: channel.low, step: channel.step }),
        _ => None,
    };
    Some(Storage::new(channels.iter().map(of).collect::<Option<_>>()?))
}

/// The images of a node, the size of a texel in lattice units, and the middle of the first and the last texel.
struct PaintedNode {
    images: Images,
    size: f64,
    range: [[f64; 2]; 2],
}

/// The triangles of a cut that have images.
struct CutSource<'a> {
    cut: &'a TexturedMesh,
    /// Their numbers.
    own: Vec<u32>,
    /// Lattice units.
    positions: Vec<DVec3>,
    nodes: Vec<Option<PaintedNode>>,
    /// The area of each triangle of the cut; empty if colours jump nowhere.
    areas: &'a [u32],
}

impl<'a> CutSource<'a> {
    fn new(cut: &'a TexturedMesh, storage: &Storage, areas: Option<&'a ColourAreas>, lattice: &Lattice) -> Self {
        let node = |texture: &Texture| {
            let map = texture.map.as_ref()?;
            let images: Vec<ChannelImage> = texture.images.iter().cloned().collect::<Option<_>>()?;
            let range = [[0.5; 2], map.size.map(|length| f64::from(length) - 0.5)];
            Some(PaintedNode { images: Images::new(storage, images), size: map.pieces.first()?.frame().1, range })
        };
        let nodes: Vec<_> = cut.textures.iter().map(node).collect();
        let is_known = |&number: &u32| {
            let node = cut.mesh.triangle_nodes[number as usize] as usize;
            nodes.get(node).is_some_and(Option::is_some)
        };
        Self {
            own: (0..cut.mesh.triangles.len() as u32).filter(is_known).collect(),
            positions: cut.mesh.positions.iter().map(|&p| DVec3::from(lattice.units(p))).collect(),
            cut,
            nodes,
            areas: areas.map_or(&[], |areas| &areas.of_triangles),
        }
    }
}

impl Source for CutSource<'_> {
    fn triangle_count(&self) -> usize {
        self.own.len()
    }

    fn area(&self, triangle: usize) -> u32 {
        self.areas.get(self.own[triangle] as usize).copied().unwrap_or(NONE)
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.cut.mesh.triangles[self.own[triangle] as usize].map(|vertex| self.positions[vertex as usize])
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        let number = self.own[triangle] as usize;
        let node = self.cut.mesh.triangle_nodes[number] as usize;
        let Some(Some(PaintedNode { images, size, range })) = self.nodes.get(node) else { return };
        let places = self.cut.places[number];
        for weights in points.iter().flat_map(|points| points.weights()) {
            let place = [0, 1].map(|axis| (0..3).map(|k| f64::from(places[k][axis] * weights[k])).sum());
            images.sample(place, *range, f64::from(footprint) / size, values);
        }
    }
}
