//! What a cut looks like, given to a mesh that was made from it.
//!
//! A reduced cut has no texels of its own. It is a patch like any other, so it gets a map and images: not from the
//! input, which is not at hand, but from the images of the cut.

use glam::DVec3;
use lodpack::decode::texels::Map;
use lodpack::decode::{ChannelImage, Texture, TexturedMesh};
use lodpack::index::{ChannelInfo, ChannelKind};
use lodpack::write::texel_size;
use lodpack::{Lattice, Mesh};
use rayon::prelude::*;

use super::cells::Sampled;
use super::colour_weights::{Compared, Recollapse, has_very_few};
use super::cut_areas::areas_of_cut;
use super::finish::{Finished, finished_ways};
use super::shown_colours::sampled;
use super::ways::Ways;
use lodpack_mesh::NONE;
use lodpack_stage::areas::{Areas, ColourAreas};
use lodpack_stage::bake::{
    BakedPatch, Baker, Images, Located, MAX_EXPONENT, MAX_TEXELS_OF_CUT, Points, Source, Storage, Stored, exponent_of,
    growth_over, larger,
};

/// The step of quantisation of images that are not stored.
const STEP: u8 = 1;

/// Mean squares of colours that are off by less than this, of 255, are rounding.
const UNSEEN: f64 = 1e-4;
/// Where colours jump, texels may be finer than those of the cut, as a power of the root of two: lines lie across them.
const FINER: u32 = 4;
/// Their number is bounded by about this.
const FINE_TEXELS: f64 = 4_194_304.0;
/// So many texels are no more than a small file can hold. Where colours jump, lines between them may have these.
const FEW_TEXELS: f64 = 65_536.0;
/// Sizes of texels that differ by less are alike.
const MORE: f64 = 1.01;
/// A reduced cut gets larger texels if its area is this many times that of the cut.
const MUCH_LARGER: f64 = 2.0;
/// A reduced cut may be this many times as far off as the nearest one, if it shows more.
const FARTHER: f64 = 3.0;
/// About how many cells of a reduced cut are compared.
const CELLS: f64 = 131_072.0;
/// The same where vertices are moved again.
const FINE_CELLS: f64 = 524_288.0;

/// What gives reduced cuts the look of the cut that they were made from.
pub struct CutPainter<'a> {
    cut: &'a TexturedMesh,
    channels: &'a [&'a ChannelInfo],
    lattice: &'a Lattice,
    storage: Storage,
    /// Where colours of the cut jump, if they do.
    areas: Option<ColourAreas>,
    /// The side of its smallest texels, lattice units.
    smallest: f64,
    /// The size of texels.
    exponent: u32,
}

/// How many texels a reduced cut gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// As fine as those of the cut, and finer where its colours jump.
    All,
    /// Fewer, by how many triangles fewer than the cut it has.
    Needed,
}

/// The units in which a reduced cut is painted: those of the lattice, or somewhat smaller ones. Sides of texels are
/// powers of the root of two in them, and so of any length in the world.
#[derive(Clone, Copy)]
struct Units {
    /// How many there are to a lattice step: 1, up to the root of two.
    per_step: f64,
    /// The size of texels.
    exponent: u32,
}

impl Units {
    /// For texels of a side, lattice units.
    fn of(side: f64) -> Self {
        let exponent = (0..=MAX_EXPONENT).find(|&exponent| texel_size(exponent) >= side).unwrap_or(MAX_EXPONENT);
        let per_step = texel_size(exponent) / side;
        Self { per_step: per_step.clamp(1.0, std::f64::consts::SQRT_2), exponent }
    }
}

/// A reduced cut in its units.
struct Target<'a> {
    points: Vec<[i64; 3]>,
    finished: &'a Finished,
    reach: f64,
    areas: Option<Areas<'a>>,
}

impl Target<'_> {
    fn patch(&self) -> BakedPatch<'_> {
        BakedPatch {
            positions: &self.points,
            triangles: &self.finished.triangles,
            reach: self.reach,
            areas: self.areas,
            finer: 0,
            is_sharp: true,
        }
    }
}

impl<'a> CutPainter<'a> {
    /// `channels` are those of the cut. None if nothing is known of one of them.
    pub fn new(cut: &'a TexturedMesh, channels: &'a [&'a ChannelInfo], lattice: &'a Lattice) -> Option<Self> {
        let sizes = cut.textures.iter().filter_map(|texture| texture.map.as_ref()?.smallest_texel());
        let palettes = || (area(&cut.mesh.positions, &cut.mesh.triangles) / FEW_TEXELS).sqrt() / lattice.step();
        let smallest = sizes.min_by(f64::total_cmp).unwrap_or_else(palettes);
        Some(Self {
            storage: storage(channels)?,
            areas: areas_of_cut(cut, channels),
            exponent: exponent_of(smallest),
            smallest,
            cut,
            channels,
            lattice,
        })
    }

    /// The size of texels at which the cut has about `texels` of them.
    fn exponent_for(&self, texels: f64) -> u32 {
        let Mesh { positions, triangles, .. } = &self.cut.mesh;
        exponent_of((area(positions, triangles) / texels).sqrt() / self.lattice.step())
    }

    /// The size of texels that a reduced cut gets. A reduced cut that is much larger than the cut, as where parts that
    /// lie far apart have merged, has no more of them than the cut would have, since it has no more to show.
    fn exponent_on(&self, finished: &Finished) -> u32 {
        let (shown, cut) = (self.shown_exponent(), &self.cut.mesh);
        let spread = area(&finished.positions, &finished.triangles) / area(&cut.positions, &cut.triangles);
        if spread > MUCH_LARGER { exponent_of(texel_size(shown) * spread.sqrt()) } else { shown }
    }

    /// The size of texels that are shown.
    fn shown_exponent(&self) -> u32 {
        match self.areas {
            None => self.exponent,
            Some(_) => self.exponent.min(self.exponent_for(FINE_TEXELS)).max(self.exponent.saturating_sub(FINER)),
        }
    }

    /// The side of the smallest texels of the cut, world units.
    pub fn side_of_cut(&self) -> f64 {
        self.smallest * self.lattice.step()
    }

    /// The cut.
    pub fn cut(&self) -> &TexturedMesh {
        self.cut
    }

    /// The share of the cut's texels that a reduced cut needs: the root of its share of triangles. A smooth surface of
    /// four times the triangles is a quarter as far off: who comes as near as its error allows sees 16 times the
    /// texels, and who stays sees as many as before. Between these, images become smaller more slowly than triangles
    /// become fewer: it is for images that few triangles are looked at.
    pub fn needed(&self, finished: &Finished) -> f64 {
        let share = finished.triangles.len() as f64 / self.cut.mesh.triangles.len().max(1) as f64;
        share.min(1.0).sqrt()
    }

    fn area(&self, finished: &Finished) -> f64 {
        area(&finished.positions, &finished.triangles)
    }

    /// The side of the smallest texels that a reduced cut gets, world units.
    pub fn side(&self, finished: &Finished, detail: Detail) -> f64 {
        let shown = texel_size(self.exponent_on(finished));
        let side = match detail {
            Detail::All => shown,
            Detail::Needed => {
                let spread = self.area(finished) / area(&self.cut.mesh.positions, &self.cut.mesh.triangles);
                let needed = self.smallest * (spread.max(1.0) / self.needed(finished)).sqrt();
                let few = (self.area(finished) / FEW_TEXELS).sqrt() / self.lattice.step();
                let side = if self.areas.is_some() { needed.min(few) } else { needed };
                side.max(shown)
            }
        };
        side * self.lattice.step()
    }

    fn target<'f>(&'f self, finished: &'f Finished, units: Units) -> Target<'f> {
        let in_units = |&position: &[f64; 3]| self.lattice.units(position).map(|x| (x * units.per_step).round() as i64);
        let jumps = self.areas.as_ref().map(|areas| &areas.jumps);
        Target {
            points: finished.positions.iter().map(in_units).collect(),
            reach: finished.error / self.lattice.step() * units.per_step,
            areas: Areas::of(&finished.areas, jumps),
            finished,
        }
    }

    /// The cut reduced to at most `triangles` triangles. Of all ways that come near enough, with lines between colours
    /// and without, it is the one that shows most of what the cut does. `error` bounds the distance of the cut from the
    /// input. None if there is no surface of so few triangles.
    pub fn finished(&self, error: f64, triangles: usize) -> Option<Finished> {
        let Mesh { positions, triangles: whole, .. } = &self.cut.mesh;
        let areas = self.areas.as_ref().map(ColourAreas::all);
        self.best(
            finished_ways(positions, whole, error, Ways::Each(areas), self.lattice, triangles),
            Recollapse::new(positions, whole, error, areas, self.lattice, triangles),
        )
    }

    /// Of reduced cuts, and what they become where they are collapsed again, the one that shows most of what the cut
    /// does.
    fn best(&self, mut ways: Vec<Finished>, recollapse: Option<Recollapse<'_>>) -> Option<Finished> {
        let least = ways.iter().map(|way| way.error).fold(f64::INFINITY, f64::min);
        ways.retain(|way| way.error <= FARTHER * least);
        let Some(colour) = self.colour() else { return ways.into_iter().next() };
        let texel = texel_size(self.shown_exponent()) * self.lattice.step();
        let sampled = |cells| sampled(self.cut, colour, DVec3::from(self.lattice.origin), [texel, cells]);
        let coarse = sampled(CELLS);
        let compare = |way| self.compared(&coarse, way);
        let mut all: Vec<Compared> = ways.into_par_iter().map(compare).collect();
        // Where all looks alike, colours say nothing of cuts, and a search would not end.
        if all.iter().all(|one| one.seen.mean().is_none_or(|mean| mean < UNSEEN)) {
            return all.into_iter().next().map(|first| first.way);
        }
        all.sort_by(|one, other| one.value.total_cmp(&other.value));
        let Some(recollapse) = recollapse else { return all.into_iter().next().map(|first| first.way) };
        let best = recollapse.best_singly(recollapse.best(all, &compare), &coarse, &compare)?.way;
        if !has_very_few(&best) {
            return Some(best);
        }
        let fine = sampled(FINE_CELLS);
        let compare = |way| self.compared(&fine, way);
        Some(recollapse.or_again(compare(best), &fine, &compare).way)
    }

    /// What is seen on a reduced cut.
    fn compared(&self, sampled: &Sampled, way: Finished) -> Compared {
        let origin = DVec3::from(self.lattice.origin);
        let positions = way.positions.iter().map(|&p| DVec3::from(p) - origin).collect();
        let seen = sampled.seen(positions, &way.triangles);
        Compared { way, value: seen.value(), seen }
    }

    /// The channel of colours.
    fn colour(&self) -> Option<usize> {
        self.channels.iter().position(|channel| channel.kind == ChannelKind::Colour)
    }

    /// A reduced cut with images of the channels, whose smallest texels have a side, world units: see
    /// [`CutPainter::side`]. None if nothing can be projected.
    pub fn painted(&self, finished: &Finished, side: f64) -> Option<TexturedMesh> {
        let units = Units::of(side / self.lattice.step());
        let target = self.target(finished, units);
        let source = CutSource::new(self, units);
        let finer = source.exponent.saturating_sub(units.exponent);
        let mut source = Located::new(source);
        let baked = Baker::new(&self.storage).bake_cut(&target.patch(), &mut source, units.exponent, finer)?;
        let (map, streams) = baked.streams.split_first()?;
        let map = Map::decode(map, &target.points, &finished.triangles, MAX_TEXELS_OF_CUT).ok()?;
        let images = self.storage.by_channel(streams).map(|(channel, streams)| channel.decode(streams, &map));
        let images = images.map(|image| Some(Some(image?))).collect::<Option<Vec<_>>>()?;
        let place = |(number, corners): (usize, &[u32; 3])| {
            corners.map(|corner| map.piece(number).place(target.points[corner as usize]).map(|x| x as f32))
        };
        Some(TexturedMesh {
            places: finished.triangles.iter().enumerate().map(place).collect(),
            mesh: Mesh {
                positions: finished.positions.clone(),
                triangle_nodes: vec![0; finished.triangles.len()],
                triangles: finished.triangles.clone(),
            },
            textures: vec![Texture { level: 0, map: Some(map), images }],
        })
    }
}

fn area(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> f64 {
    let doubled = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(|vertex| DVec3::from(positions[vertex as usize]));
        (b - a).cross(c - a).length()
    };
    0.5 * triangles.iter().map(doubled).sum::<f64>()
}

/// How these channels are stored. None if one of them is of a kind that nothing is known of.
fn storage(channels: &[&ChannelInfo]) -> Option<Storage> {
    // What decodes exact channels takes nothing else.
    let step = |channel: &ChannelInfo| if channel.is_exact { 0 } else { STEP };
    let of = |channel: &&ChannelInfo| match channel.kind {
        ChannelKind::Colour => Some(Stored::Colour { components: channel.components, step: step(channel) }),
        ChannelKind::Normal => Some(Stored::Normal { step: step(channel) }),
        ChannelKind::Factor if channel.components == 1 => Some(Stored::Factor { step: step(channel) }),
        ChannelKind::Label if channel.components == 1 && channel.step == 1.0 => {
            Some(Stored::Label { low: channel.low })
        }
        ChannelKind::Drawing => Some(Stored::Label { low: 0.0 }),
        ChannelKind::Scalar if channel.components == 1 => Some(Stored::Scalar { low: channel.low, step: channel.step }),
        _ => None,
    };
    Some(Storage::new(channels.iter().map(of).collect::<Option<_>>()?))
}

/// The images of a node, the size of its smallest texels in the units of the source, and the middle of the first and
/// the last texel.
struct PaintedNode<'a> {
    images: Images<&'a ChannelImage>,
    size: f64,
    /// Whether all of them have it.
    is_even: bool,
    /// Whether some are longer than wide.
    has_long: bool,
    range: [[f64; 2]; 2],
}

/// The triangles of a cut that have images.
struct CutSource<'a> {
    cut: &'a TexturedMesh,
    /// Their numbers.
    own: Vec<u32>,
    /// In its units.
    positions: Vec<DVec3>,
    nodes: Vec<Option<PaintedNode<'a>>>,
    /// The area of each triangle of the cut; empty if colours jump nowhere.
    areas: &'a [u32],
    /// The exponent of the smallest texels.
    exponent: u32,
}

impl<'a> CutSource<'a> {
    fn new(painter: &'a CutPainter<'a>, Units { per_step, .. }: Units) -> Self {
        let CutPainter { cut, storage, lattice, areas, .. } = painter;
        let node = |texture: &'a Texture| {
            let map = texture.map.as_ref()?;
            let images: Vec<&ChannelImage> = texture.images.iter().map(Option::as_ref).collect::<Option<_>>()?;
            let range = [[0.5; 2], map.size.map(|length| f64::from(length) - 0.5)];
            // Palettes are shown by texels of the usual size.
            let smallest = map.smallest_texel().unwrap_or(painter.smallest);
            let is_even = map.pieces.iter().all(|piece| piece.is_even() || piece.texel_size() < smallest * MORE);
            let size = smallest * per_step;
            let has_long = map.pieces.iter().any(|piece| piece.texel()[0] != piece.texel()[1]);
            Some(PaintedNode { images: Images::new(storage, images), size, is_even, has_long, range })
        };
        let nodes: Vec<_> = cut.textures.iter().map(node).collect();
        let is_known = |&number: &u32| {
            let node = cut.mesh.triangle_nodes[number as usize] as usize;
            nodes.get(node).is_some_and(Option::is_some)
        };
        Self {
            own: (0..cut.mesh.triangles.len() as u32).filter(is_known).collect(),
            positions: cut.mesh.positions.iter().map(|&p| DVec3::from(lattice.units(p)) * per_step).collect(),
            cut,
            exponent: exponent_of(painter.smallest * per_step),
            nodes,
            areas: areas.as_ref().map_or(&[], |areas| &areas.of_triangles),
        }
    }
}

impl CutSource<'_> {
    /// The size of the texels of a triangle. Sizes of a node differ by powers of two, and a piece leans away from its
    /// axis by less than that.
    fn texel_size(&self, triangle: usize) -> f64 {
        let number = self.own[triangle] as usize;
        let Some(Some(node)) = self.nodes.get(self.cut.mesh.triangle_nodes[number] as usize) else { return 1.0 };
        if node.is_even {
            return node.size;
        }
        let [a, b, c] = self.cut.places[number].map(|place| place.map(f64::from));
        let texels = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
        let [a, b, c] = self.corners(triangle);
        let ratio = ((b - a).cross(c - a).length() / texels).sqrt() / node.size;
        // Without an area there is nothing to see.
        if ratio.is_finite() { node.size * texel_size(larger(ratio * MORE).into()) } else { node.size }
    }
}

impl Source for CutSource<'_> {
    fn triangle_count(&self) -> usize {
        self.own.len()
    }

    fn area(&self, triangle: usize) -> u32 {
        self.areas.get(self.own[triangle] as usize).copied().unwrap_or(NONE)
    }

    fn has_sizes(&self) -> bool {
        self.nodes.iter().flatten().any(|node| !node.is_even)
    }

    fn larger(&self, triangle: usize) -> u8 {
        larger(self.texel_size(triangle) / texel_size(self.exponent) * MORE)
    }

    fn has_long(&self) -> bool {
        self.nodes.iter().flatten().any(|node| node.has_long)
    }

    fn growth(&self, triangle: usize) -> Option<[DVec3; 2]> {
        let places = self.cut.places[self.own[triangle] as usize].map(|place| place.map(f64::from));
        let size = self.texel_size(triangle);
        Some(growth_over(self.corners(triangle), places)?.map(|growth| growth * size))
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.cut.mesh.triangles[self.own[triangle] as usize].map(|vertex| self.positions[vertex as usize])
    }

    fn shade(&mut self, triangle: usize, points: &[Points], footprint: f32, values: &mut Vec<f32>) {
        let number = self.own[triangle] as usize;
        let node = self.cut.mesh.triangle_nodes[number] as usize;
        let Some(Some(PaintedNode { images, range, .. })) = self.nodes.get(node) else { return };
        let size = self.texel_size(triangle);
        let places = self.cut.places[number];
        for weights in points.iter().flat_map(|points| points.weights()) {
            let place = [0, 1].map(|axis| (0..3).map(|k| f64::from(places[k][axis] * weights[k])).sum());
            images.sample(place, *range, f64::from(footprint) / size, values);
        }
    }
}
