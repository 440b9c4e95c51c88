//! Where the colours of the input jump: edges of the mesh at which charts of its textures, its materials or colours of
//! its corners meet, and at which both sides show something else, or are drawn in another way.
//!
//! Triangles that continue each other form an *area*. Between two areas colours jump if, over all edges at which they
//! meet, what one side shows differs from what the other one does by more than quantisation hides. An image that lies
//! across such an edge blurs it over a texel.
//!
//! Materials without images look alike everywhere, and are areas as a whole, as each colour of a palette is, and of
//! vertices that have the colour of their part: parts of a building or a machine often share no edge, and texels that
//! are larger than a part would show what lies near it.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use super::{Face, Painter};
use crate::areas::{ColourAreas, Differences, INWARDS, MOST_INWARDS, OF_DRAWINGS};
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::srgb::{share_byte, srgb_byte};
use lodpack_mesh::union_find::{find, unite};
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};

/// Differences below this many steps of quantisation are no jump: where one is blurred over a texel, the root mean
/// square error there is a quarter of it, and that of quantisation up to a third of a step.
const STEPS: f64 = 4.0;
/// Areas with fewer texels of the input are left out: a piece of a map takes more for itself. With 16, the textured
/// bunny of pymeshlab's tests had 31.1 instead of 33.7 dB; with less than 2, each square of a mesh with a colour per
/// face would be one.
const FEWEST_TEXELS: f64 = 2.0;
/// Of more looks than this only those that meet are told apart.
const MOST_LOOKS: usize = 1000;
/// An image of which triangles show more colours than this is no palette, and a material whose vertices have more is of
/// no parts.
const MOST_COLOURS: usize = 256;
/// Where colours of vertices change at more edges than this many for each triangle, they are noise: where each four
/// triangles have another colour, six edges are around them, each of two sides. Pieces for less would keep all their
/// edges at all levels: a sphere whose triangles have colours at random would have 20,464 in place of 2,430, and take
/// 48 times as long.
const MOST_CHANGES: f64 = 0.75;
/// The middle of a triangle.
const MIDDLE: [f32; 3] = [1.0 / 3.0; 3];
/// Places along an edge at which colours are compared.
const PLACES: [f32; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];

/// What triangles show that have one colour each, and are those of a material of which all have.
#[derive(Default)]
struct EvenLooks {
    /// The first triangle of each material and colour.
    firsts: BTreeMap<(u16, [u8; 4]), u32>,
    /// Of each triangle the first one that looks like it; [`NONE`] for none.
    of_triangles: Vec<u32>,
}

impl EvenLooks {
    /// Whether all triangles have one.
    fn are_all(&self) -> bool {
        !self.of_triangles.is_empty() && !self.of_triangles.contains(&NONE)
    }
}

impl Painter<'_> {
    /// The areas of a region between which colours jump; none if they do nowhere. `step` is that of the quantisation of
    /// colours.
    pub fn colour_areas(&mut self, mesh: &Mesh, adjacency: &Adjacency, step: u8) -> Option<ColourAreas> {
        if !self.appearance.has_colour && !self.appearance.has_drawings {
            return None;
        }
        let borders: Vec<u32> = self.borders(adjacency);
        let even = self.even_looks(mesh, borders.len());
        if even.are_all()
            && self.shows_looks_alone()
            && let Some(areas) = self.areas_of_looks(mesh, adjacency, &even, STEPS * f64::from(step))
        {
            return Some(areas);
        }
        if borders.is_empty() && even.firsts.len() < 2 {
            return None;
        }
        let mut sets: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
        let mut next = borders.iter().peekable();
        for (half_edge, &opposite) in (0..).zip(&adjacency.opposite) {
            if next.next_if(|&&border| border == half_edge).is_none() && opposite != NONE && half_edge < opposite {
                unite(&mut sets, half_edge / 3, opposite / 3);
            }
        }
        for (triangle, &look) in (0..).zip(&even.of_triangles).filter(|(_, look)| **look != NONE) {
            unite(&mut sets, look, triangle);
        }
        let mut differences = Differences::default();
        for half_edge in borders {
            let opposite = adjacency.opposite[half_edge as usize];
            let pair = [half_edge, opposite].map(|h| find(&mut sets, h / 3));
            if pair[0] != pair[1] {
                let (square, length) = self.jump(mesh, half_edge, opposite);
                differences.add(pair, square, length);
            }
        }
        self.compare(even.firsts.values(), mesh, &mut sets, &mut differences);
        let (lines, _) = differences.divided(STEPS * f64::from(step));
        if lines.is_empty() {
            return None;
        }
        // Areas that are too small for a piece are left out, but for whole looks: those may be two triangles, as the
        // ground beneath a building.
        let looks: BTreeSet<u32> = even.firsts.values().map(|&first| find(&mut sets, first)).collect();
        let wanted: BTreeSet<u32> = lines.iter().flatten().filter(|area| !looks.contains(area)).copied().collect();
        let mut texels: BTreeMap<u32, f64> = BTreeMap::new();
        for triangle in 0..mesh.triangles.len() as u32 {
            let set = find(&mut sets, triangle);
            if wanted.contains(&set) {
                let corners = mesh.corners(triangle);
                let area = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() / 2.0;
                let density = f64::from(self.face(triangle as usize, corners).material_density());
                *texels.entry(set).or_default() += area * density * density;
            }
        }
        let is_large =
            |area: &u32| looks.contains(area) || texels.get(area).is_some_and(|&texels| texels >= FEWEST_TEXELS);
        let pairs: Vec<[u32; 2]> = lines.into_iter().filter(|pair| pair.iter().all(is_large)).collect();
        let parts = if self.appearance.layout.colour.is_some() { looks } else { BTreeSet::new() };
        (!pairs.is_empty()).then(|| ColourAreas { parts, ..ColourAreas::of_sets(&mut sets, pairs) })
    }

    /// Whether nothing is seen or measured but the looks of materials without images, and colours of parts.
    fn shows_looks_alone(&self) -> bool {
        let Appearance { materials, maps, scalars, .. } = self.appearance;
        // Images of one colour are in the list, but no material has them any more.
        let has_images = materials.iter().any(|material| material.images().next().is_some());
        scalars.is_empty() && !has_images && !maps.normal
    }

    /// The areas of a region of nothing but even looks: one for each that differs in anything that is stored. Between
    /// any two of them colours jump, so that no triangle of any level shows one in place of another. None if some that
    /// meet differ by less than `least`: edges between these are kept at no level.
    fn areas_of_looks(
        &mut self,
        mesh: &Mesh,
        adjacency: &Adjacency,
        even: &EvenLooks,
        least: f64,
    ) -> Option<ColourAreas> {
        let mut first_of: BTreeMap<[u8; 11], u32> = BTreeMap::new();
        let mut same_as: BTreeMap<u32, u32> = BTreeMap::new();
        let mut stored: BTreeMap<u32, [u8; 11]> = BTreeMap::new();
        for &first in even.firsts.values() {
            let bytes = self.stored_look(mesh, first);
            let same = *first_of.entry(bytes).or_insert(first);
            same_as.insert(first, same);
            stored.insert(same, bytes);
        }
        let of_triangles: Vec<u32> = even.of_triangles.iter().map(|look| same_as[look]).collect();
        let mut pairs: BTreeSet<[u32; 2]> = BTreeSet::new();
        for (half_edge, &opposite) in adjacency.opposite.iter().enumerate() {
            if opposite != NONE {
                let [a, b] = [of_triangles[half_edge / 3], of_triangles[opposite as usize / 3]];
                if a < b {
                    pairs.insert([a, b]);
                }
            }
        }
        let differs = |[a, b]: &[u32; 2]| {
            let (a, b) = (stored[a], stored[b]);
            a[9..] != b[9..] || a.iter().zip(&b).any(|(&a, &b)| f64::from(a.abs_diff(b)) > least)
        };
        if !pairs.iter().all(differs) {
            return None;
        }
        let looks: Vec<u32> = first_of.into_values().collect();
        // Parts that merge at coarse levels meet there, too.
        if looks.len() <= MOST_LOOKS {
            pairs.extend(looks.iter().flat_map(|&a| looks.iter().map(move |&b| [a, b])).filter(|[a, b]| a < b));
        }
        let parts = looks.iter().copied().filter(|_| self.appearance.layout.colour.is_some()).collect();
        Some(ColourAreas { parts, ..ColourAreas::of_looks(of_triangles, pairs.into_iter().collect()) })
    }

    /// What is stored of a triangle's look: base colour with alpha, emitted light, metallic and roughness, and how it
    /// is drawn in the last two bytes.
    fn stored_look(&mut self, mesh: &Mesh, triangle: u32) -> [u8; 11] {
        let face = self.face(triangle as usize, mesh.corners(triangle));
        let [red, green, blue, alpha] = face.base_colour(MIDDLE, 0.0);
        let emissive = face.emissive(MIDDLE, 0.0).map(srgb_byte);
        let factors = face.metallic_roughness(MIDDLE, 0.0).map(share_byte);
        let drawing = self.drawing(3 * triangle).to_le_bytes();
        let mut bytes = [0; 11];
        let all = [srgb_byte(red), srgb_byte(green), srgb_byte(blue), share_byte(alpha)].into_iter();
        let all = all.chain(emissive).chain(factors).chain(drawing);
        bytes.iter_mut().zip(all).for_each(|(byte, value)| *byte = value);
        bytes
    }

    /// The looks of materials of which no triangle shows more than one colour: those without images, palettes, and
    /// those of merged parts, whose vertices have the colour of their part. At `border_count` edges something else
    /// continues.
    fn even_looks(&mut self, mesh: &Mesh, border_count: usize) -> EvenLooks {
        let count = mesh.triangles.len();
        let mut looks = EvenLooks::default();
        let has_vertex_colours = self.appearance.layout.colour.is_some();
        if has_vertex_colours && border_count as f64 > MOST_CHANGES * count as f64 {
            return looks;
        }
        looks.of_triangles.resize(count, NONE);
        let numbers: BTreeSet<u16> = (0..count).map(|triangle| self.region.material(triangle)).collect();
        let has_images = |material: &u16| {
            let material = self.appearance.materials.get(usize::from(*material));
            material.is_some_and(|material| material.images().next().is_some())
        };
        let varied: BTreeSet<u16> =
            numbers.iter().copied().filter(|material| has_vertex_colours || has_images(material)).collect();
        let mut uneven = BTreeSet::new();
        let mut colour_counts: BTreeMap<u16, usize> = BTreeMap::new();
        for triangle in 0..count {
            let material = self.region.material(triangle);
            let mut colour = [0; 4];
            if varied.contains(&material) {
                if uneven.contains(&material) {
                    continue;
                }
                let face = self.face(triangle, mesh.corners(triangle as u32));
                if !face.has_one_colour() || colour_counts.get(&material).is_some_and(|&count| count > MOST_COLOURS) {
                    uneven.insert(material);
                    // As a scan with colours does at its first triangle.
                    if uneven.len() == numbers.len() {
                        return EvenLooks::default();
                    }
                    continue;
                }
                let [red, green, blue, alpha] = face.base_colour(MIDDLE, 0.0);
                colour = [srgb_byte(red), srgb_byte(green), srgb_byte(blue), share_byte(alpha)];
            }
            looks.of_triangles[triangle] = *looks.firsts.entry((material, colour)).or_insert_with(|| {
                *colour_counts.entry(material).or_default() += 1;
                triangle as u32
            });
        }
        looks.firsts.retain(|(material, _), _| !uneven.contains(material));
        for (triangle, look) in looks.of_triangles.iter_mut().enumerate() {
            if uneven.contains(&self.region.material(triangle)) {
                *look = NONE;
            }
        }
        looks
    }

    /// Adds the differences of areas that are whole looks, whose first triangles are given, as if any two of them met.
    fn compare<'a>(
        &mut self,
        firsts: impl ExactSizeIterator<Item = &'a u32>,
        mesh: &Mesh,
        sets: &mut [u32],
        differences: &mut Differences,
    ) {
        if firsts.len() > MOST_LOOKS {
            return;
        }
        let mut looks = vec![];
        for &triangle in firsts {
            let colour = self.face(triangle as usize, mesh.corners(triangle)).base_colour(MIDDLE, 0.0);
            looks.push((
                find(sets, triangle),
                self.drawing(3 * triangle),
                [0, 1, 2].map(|k| f64::from(srgb_byte(colour[k]))),
            ));
        }
        for (number, (one, drawing, colour)) in looks.iter().enumerate() {
            for (other, other_drawing, other_colour) in &looks[..number] {
                let square = if drawing == other_drawing { mean_square(colour, other_colour) } else { OF_DRAWINGS };
                differences.add([*one, *other], square, 1.0);
            }
        }
    }

    /// Half-edges beyond which something else than the triangle's own continues, each edge once, ascending.
    fn borders(&self, adjacency: &Adjacency) -> Vec<u32> {
        let edges =
            (0..).zip(&adjacency.opposite).filter(|&(half_edge, &opposite)| opposite != NONE && half_edge < opposite);
        edges.filter(|&(half_edge, &opposite)| !self.continues(half_edge, opposite)).map(|(h, _)| h).collect()
    }

    /// Whether what a triangle shows goes on in the one beyond a half-edge.
    fn continues(&self, half_edge: u32, opposite: u32) -> bool {
        let region = self.region;
        if region.material(half_edge as usize / 3) != region.material(opposite as usize / 3) {
            return false;
        }
        let Some(of_one) = region.corners.get(half_edge as usize / 3) else { return true };
        let of_other = region.corners[opposite as usize / 3];
        let side = |h: u32| [h as usize % 3, next_half_edge(h) as usize % 3];
        let ([a, b], [c, d]) = (side(half_edge), side(opposite));
        [[of_one[a], of_other[d]], [of_one[b], of_other[c]]]
            .into_iter()
            .all(|[one, other]| one == other || self.are_alike(one, other))
    }

    /// Whether two records have the same colour and coordinates. What else they have does not matter here.
    fn are_alike(&self, one: u32, other: u32) -> bool {
        let layout = &self.appearance.layout;
        let [one, other] =
            [one, other].map(|record| &self.region.records[record as usize * layout.stride..][..layout.stride]);
        let colour = layout.colour.into_iter().flat_map(|place| place..place + 4);
        let mut places = colour.chain(layout.uv.iter().flat_map(|&place| place..place + 2));
        places.all(|place| one[place].to_bits() == other[place].to_bits())
    }

    /// The mean square over the components of how much the colours on both sides of an edge differ, of 255, and the
    /// edge's length.
    fn jump(&mut self, mesh: &Mesh, half_edge: u32, opposite: u32) -> (f64, f64) {
        let square = if self.drawing(half_edge) == self.drawing(opposite) {
            let [one, other] = [half_edge, opposite].map(|h| self.colour_along(mesh, h));
            mean_square(&one, &other)
        } else {
            OF_DRAWINGS
        };
        let ends = [half_edge, next_half_edge(half_edge)]
            .map(|h| mesh.positions[mesh.triangles[h as usize / 3][h as usize % 3] as usize]);
        (square, ends[0].distance(ends[1]))
    }

    /// How the triangle of a half-edge is drawn.
    fn drawing(&self, half_edge: u32) -> u16 {
        let material = usize::from(self.region.material(half_edge as usize / 3));
        let is_kept = self.appearance.has_drawings;
        self.appearance.materials.get(material).filter(|_| is_kept).map_or(0, |material| material.drawing().number())
    }

    /// The mean colour that a triangle shows along a half-edge, of 255. The mean over an edge has little of what is in
    /// the texture.
    fn colour_along(&mut self, mesh: &Mesh, half_edge: u32) -> [f64; 3] {
        let (triangle, first) = (half_edge / 3, half_edge as usize % 3);
        let corners: [DVec3; 3] = mesh.corners(triangle);
        let face: Face = self.face(triangle as usize, corners);
        let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
        let height = (b - a).cross(c - a).length() / a.distance(b);
        let texel = 1.0 / f64::from(face.material_density());
        // The smaller of a number and none is the number: where something has no area.
        let inwards = (INWARDS * texel / height).min(MOST_INWARDS) as f32;
        let footprint = if texel.is_finite() { texel as f32 } else { 0.0 };
        let mut sum = [0.0; 3];
        for along in PLACES {
            let mut weights = [0.0; 3];
            weights[first] = (1.0 - along) * (1.0 - inwards);
            weights[(first + 1) % 3] = along * (1.0 - inwards);
            weights[(first + 2) % 3] = inwards;
            let colour = face.base_colour(weights, footprint);
            (0..3).for_each(|k| sum[k] += f64::from(srgb_byte(colour[k])));
        }
        sum.map(|sum| sum / PLACES.len() as f64)
    }
}

/// The mean over the components of squares of differences.
fn mean_square(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    (0..3).map(|k| (one[k] - other[k]) * (one[k] - other[k])).sum::<f64>() / 3.0
}
