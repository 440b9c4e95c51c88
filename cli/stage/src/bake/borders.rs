//! Borders of the pieces of a map: texels beside a piece are seen there, and nowhere else.
//!
//! A patch with a finer neighbour is drawn up to that neighbour's border, which runs a little beside its own: so it is
//! seen there, too.

use glam::DVec3;
use lodpack::LatticePoint;
use lodpack::decode::texels::Map;
use lodpack::write::{Seen, SeenPoint};

use super::BakedPatch;
use super::projection::{Projection, projections};
use super::rim::{OnOutline, Outline, lattice_point};
use super::triangles::neighbours;
use crate::certify::Hint;
use lodpack_mesh::NONE;

/// Points for each texel along a border. Where colours are wanted, half as many.
const FINENESS: f64 = 2.0;
/// The most points of an edge.
const MOST_POINTS: f64 = 65_536.0;
/// How far inside of its side a point is looked for, in texels: the source may jump at the border, and each side shows
/// its own.
const INWARDS: f64 = 0.05;
/// The same as a share of the triangle, at most.
const MOST_INWARDS: f64 = 0.3;
/// The border of finer patches is not looked for further away than the patch may be off, and this many texels.
const MOST_BESIDE: f64 = 2.0;
/// Where that border lies more than this many texels beside a point, it is looked at by itself. With 0 as many points
/// differ, for more work.
const FAR: f64 = 0.25;

/// A place between four texels.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// The first of them; the others are beside and below it.
    texel: u32,
    right: f32,
    down: f32,
}

impl Place {
    fn new(projection: &Projection, point: DVec3, width: usize) -> Self {
        let place = projection.place(point);
        let [low, high] = projection.range;
        let at = [0, 1].map(|k| place[k].clamp(low[k], high[k]) - 0.5);
        // The conversions saturate.
        let first = [0, 1].map(|k| (at[k] as u32).min((high[k] - 1.5).max(0.0) as u32));
        let [right, down] = [0, 1].map(|k| (at[k] - f64::from(first[k])) as f32);
        Self { texel: first[1] * width as u32 + first[0], right, down }
    }

    /// In the middle between two places of a piece that are at most a texel apart.
    pub fn middle(one: Self, other: Self, width: usize) -> Self {
        let [ones, others] = [one, other].map(|place| [place.texel as usize % width, place.texel as usize / width]);
        let parts = [[one.right, other.right], [one.down, other.down]];
        let [(column, right), (row, down)] = [0, 1].map(|k| {
            let first = ones[k].min(others[k]);
            let middle = 0.5 * ((ones[k] - first) as f32 + parts[k][0] + (others[k] - first) as f32 + parts[k][1]);
            // Beyond the last texels of a piece there is none.
            let steps = (middle as usize).min(ones[k].max(others[k]) - first);
            (first + steps, middle - steps as f32)
        });
        Self { texel: (row * width + column) as u32, right, down }
    }

    /// In the middle between four texels.
    #[cfg(test)]
    pub fn between(texel: u32) -> Self {
        Self { texel, right: 0.5, down: 0.5 }
    }

    /// The four texels with their shares.
    #[inline]
    pub fn texels(&self, width: usize) -> [(usize, f32); 4] {
        let (first, [left, up]) = (self.texel as usize, [1.0 - self.right, 1.0 - self.down]);
        [
            (first, left * up),
            (first + 1, self.right * up),
            (first + width, left * self.down),
            (first + width + 1, self.right * self.down),
        ]
    }
}

/// An edge of a patch beyond which there is another piece, or nothing.
pub(super) struct Edge {
    /// Relative to the patch's origin.
    ends: [DVec3; 2],
    /// How many steps lead from one end to the other, an even number.
    steps: u32,
    /// The triangles on both sides; [`NONE`] for nothing beyond.
    pub triangles: [u32; 2],
    /// What lies on each side.
    sides: [Side; 2],
    /// The shorter side of the smaller texels beside it.
    pub size: f64,
}

/// What lies on a side of an edge.
#[derive(Clone, Copy, Default)]
struct Side {
    piece: u16,
    /// The middle of the triangle.
    middle: DVec3,
    /// Where its places begin.
    first: u32,
}

/// The edges along which the pieces of a map end.
#[derive(Default)]
pub(super) struct Borders {
    edges: Vec<Edge>,
    /// The places of all points along each edge, on each of its sides.
    places: Vec<Place>,
    /// For each point along edges of the outer border, what lies beside it on the border of finer patches, if these are
    /// known.
    beside: Vec<Option<Beside>>,
    /// Texels in a row.
    pub width: usize,
}

/// Where finer patches end beside a point of the outer border. Beside a finer neighbour this is where the border is
/// seen.
#[derive(Clone, Copy)]
pub(super) struct Beside {
    pub on: OnOutline,
    /// Where it is seen.
    pub place: Place,
    /// Whether it is so far from the point that it makes a difference.
    is_far: bool,
    /// The shorter side of a texel of the patch there.
    pub size: f64,
}

/// A side of an edge.
#[derive(Clone, Copy)]
pub(super) struct EdgeSide<'a> {
    borders: &'a Borders,
    edge: &'a Edge,
    side: &'a Side,
}

impl Borders {
    /// The borders of a patch; `outline` is that of the finer patches from which it is made, if it is.
    pub fn new(patch: &BakedPatch<'_>, map: &Map, outline: Option<&Outline<'_>>) -> Self {
        let (projections, width) = (projections(patch, map), map.size[0] as usize);
        let (mut edges, mut places, mut found, mut hint) = (vec![], vec![], vec![], Hint::default());
        let middle = |triangle: u32| {
            patch.triangles[triangle as usize].iter().map(|&corner| patch.position(corner)).sum::<DVec3>() / 3.0
        };
        let piece = |triangle: u32| map.labels[triangle as usize];
        let size = |triangle: u32| projections[usize::from(piece(triangle))].shorter;
        for ((number, corners), beside) in (0..).zip(patch.triangles).zip(neighbours(patch.triangles)) {
            for (edge, &other) in beside.iter().enumerate() {
                // Each edge once.
                if other != NONE && (other < number || piece(other) == piece(number)) {
                    continue;
                }
                let size = if other == NONE { size(number) } else { size(number).min(size(other)) };
                let ends = [edge, (edge + 1) % 3].map(|k| patch.position(corners[k]));
                let steps = (ends[0].distance(ends[1]) / size * FINENESS).ceil().clamp(1.0, MOST_POINTS) as u32;
                let steps = steps.next_multiple_of(2);
                let mut edge = Edge { ends, steps, triangles: [number, other], sides: [Side::default(); 2], size };
                for k in 0..edge.count() {
                    let triangle = edge.triangles[k];
                    let (piece, first) = (piece(triangle), places.len() as u32);
                    let of_point = |step| Place::new(&projections[usize::from(piece)], edge.point(step), width);
                    places.extend((0..=steps).map(of_point));
                    edge.sides[k] = Side { piece, middle: middle(triangle), first };
                }
                if let Some(outline) = outline.filter(|_| edge.is_outer()) {
                    let projection = &projections[usize::from(edge.sides[0].piece)];
                    let most = patch.reach + MOST_BESIDE * size;
                    found.extend(edge.points().map(|point| {
                        let on = outline.closest(point + patch.origin(), edge.ends[1] - edge.ends[0], &mut hint)?;
                        let beside = on.point - patch.origin();
                        let distance = beside.distance(point);
                        // What lies beyond an end of the outline is not on it.
                        let most = if on.is_end { FAR * size } else { most };
                        let place = Place::new(projection, beside, width);
                        (distance <= most).then_some(Beside { on, place, is_far: distance > FAR * size, size })
                    }));
                }
                edges.push(edge);
            }
        }
        Self { edges, places, beside: found, width }
    }

    /// Notes all texels that borders are seen with, which triangles that are smaller than texels need not cover.
    pub fn add_used(&self, is_used: &mut [bool]) {
        let texels = self.all_places().flat_map(|place| place.texels(self.width));
        texels.filter(|(_, share)| *share > 0.0).for_each(|(texel, _)| is_used[texel] = true);
    }

    /// What is seen of the texels of a map: those that its patch covers, and its borders.
    pub fn seen<'a>(&self, map: &Map, is_covered: &'a [bool]) -> Seen<'a> {
        let points = self.all_places().map(|place| SeenPoint {
            texel: [place.texel % map.size[0], place.texel / map.size[0]],
            share: [place.right, place.down],
        });
        Seen::new(is_covered, map.size, points)
    }

    pub fn edges(&self) -> &[Edge] {
        &self.edges
    }

    /// What lies beside the points of the outer edges, one after another.
    pub fn beside(&self) -> &[Option<Beside>] {
        &self.beside
    }

    /// Those that are seen somewhere else than their points.
    pub fn far_beside(&self) -> impl Iterator<Item = &Beside> {
        self.beside.iter().flatten().filter(|beside| beside.is_far)
    }

    fn all_places(&self) -> impl Iterator<Item = &Place> {
        self.places.iter().chain(self.far_beside().map(|beside| &beside.place))
    }

    /// The places of all points of an inner edge on both sides.
    pub fn pairs<'a>(&'a self, edge: &'a Edge) -> impl Iterator<Item = [Place; 2]> + use<'a> {
        let mut sides = self.sides(edge).map(|side| side.all_places());
        let both = sides.next().zip(sides.next()).map(|(one, other)| one.zip(other));
        both.into_iter().flatten().map(|(one, other)| [one, other])
    }

    /// The sides of an edge.
    pub fn sides<'a>(&'a self, edge: &'a Edge) -> impl Iterator<Item = EdgeSide<'a>> {
        edge.sides[..edge.count()].iter().map(move |side| EdgeSide { borders: self, edge, side })
    }
}

impl Edge {
    /// How many sides it has.
    fn count(&self) -> usize {
        if self.is_outer() { 1 } else { 2 }
    }

    fn point(&self, step: u32) -> DVec3 {
        self.ends[0].lerp(self.ends[1], f64::from(step) / f64::from(self.steps))
    }

    /// Where it begins and ends, with the patch on its left.
    pub fn ends(&self) -> [DVec3; 2] {
        self.ends
    }

    /// Where it begins on the lattice.
    pub fn start(&self, patch: &BakedPatch<'_>) -> LatticePoint {
        lattice_point(self.ends[0] + patch.origin())
    }

    /// Whether nothing of the patch lies beyond.
    pub fn is_outer(&self) -> bool {
        self.triangles[1] == NONE
    }

    /// The points at which colours are wanted, relative to the patch's origin.
    pub fn points(&self) -> impl Iterator<Item = DVec3> {
        (0..=self.steps).step_by(2).map(|step| self.point(step))
    }
}

impl<'a> EdgeSide<'a> {
    pub fn piece(&self) -> usize {
        usize::from(self.side.piece)
    }

    pub fn edge(&self) -> &'a Edge {
        self.edge
    }

    /// The places of [`Edge::points`].
    pub fn places(&self) -> impl Iterator<Item = Place> + use<'a> {
        self.all_places().step_by(2)
    }

    /// These places, and another one between each two of them.
    pub fn all_places(&self) -> impl Iterator<Item = Place> + use<'a> {
        let first = self.side.first as usize;
        self.borders.places[first..=first + self.edge.steps as usize].iter().copied()
    }

    /// These points, each with one that lies a little inside of the side.
    pub fn insides(&self) -> impl Iterator<Item = [DVec3; 2]> {
        let (middle, inwards) = (self.side.middle, INWARDS * self.edge.size);
        self.edge.points().map(move |point| {
            let share = (inwards / point.distance(middle)).min(MOST_INWARDS);
            [point, point.lerp(middle, share)]
        })
    }
}
