//! Colours along the borders of pieces: the texels on both sides are made to show the same there.
//!
//! A reader interpolates between four texels, and on a border some of them lie beside the patch. What these show is
//! seen nowhere but along the border, so they may have any value. They get those with which the border shows what the
//! source has at it, and so do those of the piece beyond it, in this patch or in its neighbour. Where there is no
//! source, both sides of a border within the patch show the mean of both, and the outer border shows what finer patches
//! do ([`Outline`]).
//!
//! Point after point does not get everything right. Where both sides of a border within the patch want the same and
//! still differ, or the outer border is still off, texels are found together with what is around them (`settled`).

use lodpack::decode::texels::Map;

use super::borders::{Borders, Edge, Place};
use super::gather::barycentric;
use super::located::Located;
use super::rim::Outline;
use super::settled::{Joint, settle};
use super::storage::Storage;
use super::strangers::Strangers;
use super::strip::{Strip, Vector, bounded, colour_at};
use super::wanted::{Alike, Wanted};
use super::{BakedPatch, Points, Source};
use crate::certify::Hint;
use lodpack_mesh::{NONE, srgb::srgb_byte};

/// How often each point is made right: points share texels.
const SWEEPS: usize = 3;
/// Both sides of a border want the same if their colours differ by at most this, of 255. Where the input jumps along a
/// border, each side keeps its own: one colour for both costs `hp-mixed-reality` a quarter of a decibel.
const ALIKE: u8 = 4;
/// How strongly covered texels change, relative to those of which nothing else is seen, where borders show what a
/// source does.
const COVERED: f32 = 0.15;
/// The same where they show the mean of both sides, which is a guess, or what finer patches show. With .15 images take
/// a quarter more of what means cost, and as many points of outer borders differ.
const COVERED_WITHOUT_SOURCE: f32 = 0.5;
/// A triangle of the source that is as close to a point, in texels, is close enough.
const CLOSE: f64 = 0.02;

/// Texels whose colours without opacity are changed.
pub(super) struct Shown<'a> {
    pub storage: &'a Storage,
    pub values: &'a mut [f32],
    pub is_covered: &'a [bool],
    pub borders: &'a Borders,
}

/// Whether colours jump at an edge.
fn jump(patch: &BakedPatch<'_>, edge: &Edge) -> bool {
    patch.areas.is_some_and(|areas| {
        let [one, other] = edge.triangles.map(|triangle| areas.of_triangles.get(triangle as usize));
        matches!((one, other), (Some(&one), Some(&other)) if areas.jumps.are_between(one, other))
    })
}

impl Shown<'_> {
    /// What a source shows at the borders, of which values are means over texels. Each side wants its own.
    pub fn of_source(&self, patch: &BakedPatch<'_>, map: &Map, source: &mut Located<impl Source>) -> Wanted {
        let Self { storage, borders, .. } = self;
        let (source, bvh) = source.parts();
        let mut wanted = Wanted::default();
        if bvh.is_empty() {
            return wanted;
        }
        let strangers = Strangers::new(patch, map, &source.areas_beyond());
        let mut hints = [Hint::default(); 2];
        let (mut points, mut values, mut inner_points) = (vec![], vec![], vec![]);
        // Where points begin that lie one after another on an edge.
        let mut runs = vec![];
        for (side, hint) in borders.edges().iter().flat_map(|edge| borders.sides(edge).zip(0..)) {
            let size = side.edge().size;
            // No other patch shows what is handed up of the boundary of the mesh.
            let is_outer = side.edge().is_outer() && !source.ends_along(side.edge().start(patch));
            if is_outer {
                wanted.add_edge(side.edge());
            }
            runs.push(wanted.places.len());
            // Points of one triangle are shaded together.
            let mut of = None;
            for (place, [point, inside]) in side.places().zip(side.insides()) {
                let triangle = bvh.close(inside + patch.origin(), CLOSE * size, &mut hints[hint]) as usize;
                let is_stranger = strangers.has(side.piece(), source.area(triangle));
                let number = if is_stranger { NONE } else { wanted.places.len() as u32 };
                if is_outer {
                    wanted.outer_points.push(number);
                } else if !side.edge().is_outer() {
                    inner_points.push(number);
                }
                if is_stranger {
                    runs.push(wanted.places.len());
                    continue;
                }
                if let Some(before) = of.replace(triangle).filter(|&before| before != triangle) {
                    source.shade(before, &points, size as f32, &mut values);
                    points.clear();
                }
                let weights = barycentric(source.corners(triangle), point + patch.origin());
                let sum: f64 = weights.iter().sum();
                points.push(Points::one(weights.map(|weight| weight / sum)));
                wanted.places.push((place, COVERED));
            }
            if let Some(last) = of {
                source.shade(last, &points, size as f32, &mut values);
                points.clear();
            }
            if is_outer {
                wanted.add_alone(side);
            }
        }
        let colours = storage.opaque_colours();
        let of_point = |values| colours.iter().map(move |&first| colour_at(values, first));
        wanted.colours = values.chunks_exact(storage.count()).flat_map(of_point).collect();
        runs.push(wanted.places.len());
        for ends in runs.windows(2) {
            smooth(&mut wanted.colours[ends[0] * colours.len()..ends[1] * colours.len()], colours.len());
        }
        self.add_alike(&inner_points, &mut wanted);
        wanted
    }

    /// Notes where both sides of inner edges want the same. Given are the points of each edge and each of its sides.
    fn add_alike(&self, mut points: &[u32], wanted: &mut Wanted) {
        let channels = self.storage.opaque_colours().len();
        let is_alike = |wanted: &Wanted, one: u32, other: u32| {
            let of_points = [one, other].map(|point| wanted.colours.get(point as usize * channels..)?.get(..channels));
            let [Some(one), Some(other)] = of_points else { return false };
            let both = one.as_flattened().iter().zip(other.as_flattened());
            both.into_iter().all(|(&one, &other)| srgb_byte(one).abs_diff(srgb_byte(other)) <= ALIKE)
        };
        for edge in self.borders.edges().iter().filter(|edge| !edge.is_outer()) {
            let count = edge.points().count();
            let Some((of_edge, others)) = points.split_at_checked(2 * count) else { break };
            points = others;
            let (one, other) = of_edge.split_at(count);
            let are_alike: Vec<bool> =
                one.iter().zip(other).map(|(&one, &other)| is_alike(wanted, one, other)).collect();
            // Between two points, if both are.
            wanted.add_pairs(self.borders.pairs(edge), |step| are_alike[step / 2] && are_alike[step.div_ceil(2)]);
        }
    }

    /// What both sides of inner borders show in the mean, but where colours jump.
    pub fn means(&self, patch: &BakedPatch<'_>) -> Wanted {
        let (colours, mut wanted) = (self.storage.opaque_colours(), Wanted::default());
        for edge in self.borders.edges().iter().filter(|edge| !jump(patch, edge)) {
            let mut sides = self.borders.sides(edge);
            let (Some(one), Some(other)) = (sides.next(), sides.next()) else { continue };
            wanted.add_pairs(self.borders.pairs(edge), |_| true);
            for places in one.places().zip(other.places()).map(|(one, other)| [one, other]) {
                let mean = |&first: &usize| {
                    let [one, other] = places.map(|place| self.shown(place, first));
                    std::array::from_fn(|k| 0.5 * (one[k] + other[k]))
                };
                for place in places {
                    wanted.places.push((place, COVERED_WITHOUT_SOURCE));
                    wanted.colours.extend(colours.iter().map(mean));
                }
            }
        }
        wanted
    }

    /// As [`Shown::means`], and at the outer border what was handed up.
    pub fn of_outline(&self, patch: &BakedPatch<'_>, outline: &Outline<'_>) -> Wanted {
        let (mut wanted, borders) = (self.means(patch), self.borders);
        if outline.is_empty() {
            return wanted;
        }
        let mut beside = borders.beside().iter();
        for edge in borders.edges().iter().filter(|edge| edge.is_outer()) {
            wanted.add_edge(edge);
            for side in borders.sides(edge) {
                for (place, beside) in side.places().zip(beside.by_ref()) {
                    let is_known =
                        beside.is_some_and(|beside| outline.means(beside.on, beside.size, &mut wanted.colours));
                    wanted.outer_points.push(if is_known { wanted.places.len() as u32 } else { NONE });
                    if is_known {
                        wanted.places.push((place, COVERED_WITHOUT_SOURCE));
                    }
                }
                wanted.add_alone(side);
            }
        }
        wanted
    }

    /// Adds what is seen of the patch beside finer neighbours, along the border that these have.
    pub fn add_beside_finer(&self, outline: &Outline<'_>, wanted: &mut Wanted) {
        for beside in self.borders.far_beside() {
            if outline.means(beside.on, beside.size, &mut wanted.colours) {
                wanted.alone.push(wanted.places.len() as u32);
                wanted.places.push((beside.place, COVERED_WITHOUT_SOURCE));
            }
        }
    }

    /// Changes texels so that places show what is wanted.
    pub fn show_all(&mut self, wanted: &Wanted, Scratch { strip, spreads, joints }: &mut Scratch) {
        strip.clear(self.is_covered.len());
        spreads.clear();
        spreads.extend(wanted.places.iter().map(|&(place, covered)| self.spread(place, covered, strip)));
        let colours = self.storage.opaque_colours();
        for (number, &first) in colours.iter().enumerate() {
            joints.clear();
            self.add_joints(wanted, number, strip, joints);
            let mut values = strip.read(self.values, self.storage, first);
            for _ in 0..SWEEPS {
                let of_places = wanted.colours.iter().skip(number).step_by(colours.len());
                spreads.iter().zip(of_places).for_each(|(spread, &colour)| spread.show(colour, &mut values));
            }
            settle(joints, &mut values);
            strip.write(&values, self.values, self.storage, first);
        }
    }

    /// Which texels a place shows, and how a change is spread over them.
    fn spread(&self, place: Place, covered: f32, strip: &mut Strip) -> Spread {
        let texels = place.texels(self.borders.width);
        let gains = texels.map(|(texel, share)| if self.is_covered[texel] { covered * share } else { share });
        let sum: f32 = gains.iter().zip(texels).map(|(gain, (_, share))| gain * share).sum();
        Spread {
            texels: strip.of_place(texels).map(|(texel, _)| texel),
            shares: texels.map(|(_, share)| share),
            gains: gains.map(|gain| gain / sum),
        }
    }

    /// The colour at a place.
    pub(super) fn shown(&self, place: Place, first: usize) -> [f32; 3] {
        let mut sums = [0.0; 3];
        for (texel, share) in place.texels(self.borders.width) {
            let colour = colour_at(self.values, texel * self.storage.stride() + first);
            (0..3).for_each(|k| sums[k] += share * colour[k]);
        }
        sums
    }
}

impl Shown<'_> {
    /// Adds all points of borders where another piece or patch has to show the same: four for each texel along them
    /// within the patch, two beside other patches. The number of a channel is given. Points of which both sides are at
    /// hand come first.
    pub(super) fn add_joints(&self, wanted: &Wanted, number: usize, strip: &mut Strip, joints: &mut Vec<Joint>) {
        let (width, channels) = (self.borders.width, self.storage.opaque_colours().len());
        joints.reserve(2 * wanted.alike.len() + wanted.alone.len() + wanted.alone_between.len());
        let mut before: Option<&Alike> = None;
        for alike in &wanted.alike {
            if let Some(before) = before.filter(|_| alike.follows) {
                let between = [0, 1].map(|k| Place::middle(before.places[k], alike.places[k], width));
                joints.push(Joint::pair(between.map(|place| strip.of_place(place.texels(width)))));
            }
            joints.push(Joint::pair(alike.places.map(|place| strip.of_place(place.texels(width)))));
            before = Some(alike);
        }
        let colour = |point: u32| wanted.colours[point as usize * channels + number];
        for &point in &wanted.alone {
            let place = wanted.places[point as usize].0;
            joints.push(Joint::alone(strip.of_place(place.texels(width)), colour(point)));
        }
        for &(place, ends) in &wanted.alone_between {
            let [one, other] = ends.map(colour);
            let middle = std::array::from_fn(|k| 0.5 * (one[k] + other[k]));
            joints.push(Joint::alone(strip.of_place(place.texels(width)), middle));
        }
    }
}

/// Memory of what borders show, which serves one map after another.
#[derive(Default)]
pub(super) struct Scratch {
    strip: Strip,
    spreads: Vec<Spread>,
    joints: Vec<Joint>,
}

impl Scratch {
    /// How many bytes it keeps.
    pub fn bytes(&self) -> usize {
        self.strip.bytes() + size_of::<Spread>() * self.spreads.capacity() + size_of::<Joint>() * self.joints.capacity()
    }
}

/// The texels of a place.
struct Spread {
    texels: [u32; 4],
    /// How much of each is shown.
    shares: [f32; 4],
    /// By how much each grows where what is shown grows by one.
    gains: [f32; 4],
}

impl Spread {
    /// Changes texels so that the place shows a colour, as far as they stay between 0 and 1.
    #[inline]
    fn show(&self, [red, green, blue]: [f32; 3], values: &mut [Vector]) {
        let [a, b, c, d] = [0, 1, 2, 3].map(|k| values[self.texels[k] as usize].map(|value| self.shares[k] * value));
        let wanted = [red, green, blue, 0.0];
        let change: Vector = std::array::from_fn(|k| wanted[k] - (a[k] + b[k] + c[k] + d[k]));
        // Texels of which nothing is shown may be any.
        for (&texel, gain) in self.texels.iter().zip(self.gains).filter(|(_, gain)| *gain > 0.0) {
            let value = &mut values[texel as usize];
            *value = std::array::from_fn(|k| bounded(value[k] + gain * change[k], 0.0, 1.0));
        }
    }
}

/// Takes a mean over each three points that lie one after another on an edge, but not at its ends, which belong to
/// other edges, too. What changes from one point to the next texels cannot show, and both sides of a border would miss
/// it in different ways.
fn smooth(points: &mut [[f32; 3]], channels: usize) {
    let before = points.to_vec();
    for (at, point) in points.iter_mut().enumerate().skip(channels) {
        let Some(after) = before.get(at + channels) else { break };
        let last = before[at - channels];
        *point = std::array::from_fn(|k| 0.5 * before[at][k] + 0.25 * (last[k] + after[k]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_changes_from_point_to_point_is_not_wanted_but_at_ends() {
        let points = |values: [f32; 5]| values.map(|value| [value; 3]);
        let mut colours = points([0.0, 1.0, 0.0, 1.0, 0.5]);
        smooth(&mut colours, 1);
        assert_eq!(colours, points([0.0, 0.5, 0.5, 0.625, 0.5]));
        // Each channel by itself.
        let mut two = [[0.0; 3], [1.0; 3], [1.0; 3], [1.0; 3], [0.0; 3], [1.0; 3]];
        smooth(&mut two, 2);
        assert_eq!(two, [[0.0; 3], [1.0; 3], [0.5; 3], [1.0; 3], [0.0; 3], [1.0; 3]]);
    }
}
