//! Texels around points of borders that do not show what they should, found for many points together.
//!
//! [`Shown::show_all`] makes one point right after another. Points share texels: where colours along a border are steep, what is done for one
//! undoes what was done for the one before, and between points anything may come of it. Here the texels around such points are found at once, by
//! least squares: those with which all points around, up to four for each texel along the border, are nearest to what they should show while texels
//! stay near to what they are. Differences count as screens show them.

use super::borders::Place;
use super::shown::{Alike, Shown, Wanted, bounded, colour_at};
use crate::mesh::srgb::srgb_byte;

/// Sides of a border that differ by more than this, of 255, are found together, with what is around them.
const MOST_BETWEEN: u8 = 5;
/// And a side that is off by more than this from what both sides of a border should show.
const MOST_OFF: u8 = 3;
/// Points that are off by less than this, in linear light, are not looked at closely: at their darkest they differ by less than two of 255.
const SAME: f32 = 0.0005;
/// What the square of a point that is off counts beside that of a texel that changes.
const WEIGHT: f32 = 40.0;
/// By how much that grows where a point is still off.
const GROWTH: f32 = 4.0;
/// How often texels are found.
const ROUNDS: usize = 3;
/// Steps of conjugate gradients for each of these.
const STEPS: usize = 30;
/// They end where the square of the gradient has fallen to this share.
const ENOUGH: f32 = 1e-4;
/// Colours that are darker than this, in linear light, differ as much to the eye as this.
const DARK: f32 = 0.003;

/// A point of a border.
#[derive(Clone, Copy)]
struct Joint {
    /// The texels of one side, then those of the other.
    texels: [u32; 8],
    /// How much of each is shown. Those of the other side are negative, and zero where that is not at hand.
    shares: [f32; 8],
    /// By how much one side should show more than the other. Where the other is not at hand, what the one should show.
    wanted: [f32; 3],
    /// By how much that may be off, of 255.
    most: u8,
}

impl Joint {
    fn new(places: &[Place], width: usize, wanted: [f32; 3], most: u8) -> Self {
        let mut this = Self { texels: [0; 8], shares: [0.0; 8], wanted, most };
        let texels =
            places.iter().zip([1.0, -1.0]).flat_map(|(place, sign)| place.texels(width).map(|texel| (texel, sign)));
        for (k, ((texel, share), sign)) in texels.enumerate() {
            (this.texels[k], this.shares[k]) = (texel as u32, sign * share);
        }
        this
    }

    /// The texels of which anything is shown.
    fn shown_texels(&self) -> impl Iterator<Item = u32> {
        self.texels.into_iter().zip(self.shares).filter(|(_, share)| *share != 0.0).map(|(texel, _)| texel)
    }

    /// What one side shows, and by how much that is more than wanted.
    fn shown(&self, of: &Shown<'_>, first: usize) -> [[f32; 3]; 2] {
        let (mut one, mut excess) = ([0.0; 3], self.wanted.map(|wanted| -wanted));
        for (at, (texel, share)) in self.texels.into_iter().zip(self.shares).enumerate() {
            let colour = of.texel(texel, first).map(|value| share * value);
            (0..3).for_each(|k| excess[k] += colour[k]);
            if at < 4 {
                (0..3).for_each(|k| one[k] += colour[k]);
            }
        }
        [one, excess]
    }

    fn is_off(&self, of: &Shown<'_>, first: usize) -> bool {
        let [one, excess] = self.shown(of, first);
        let is_off = |k: usize| srgb_byte(one[k]).abs_diff(srgb_byte(one[k] - excess[k])) > self.most;
        excess.iter().any(|excess| excess.abs() >= SAME) && (0..3).any(is_off)
    }
}

impl Shown<'_> {
    fn texel(&self, texel: u32, first: usize) -> [f32; 3] {
        colour_at(self.values, texel as usize * self.storage.stride() + first)
    }

    /// Changes texels where borders are still off in a channel, of which the number and the first value of a texel are given.
    pub(super) fn settle(&mut self, wanted: &Wanted, number: usize, first: usize) {
        let mut found = Around::new(self, first, || self.joints(wanted, number), |_| true);
        let mut weight = WEIGHT;
        for round in 1..=ROUNDS {
            let Some(around) = found else { break };
            for (&texel, value) in around.texels.iter().zip(around.settled(self, first, weight)) {
                let colour = &mut self.values[texel as usize * self.storage.stride() + first..][..3];
                (0..3).for_each(|k| colour[k] = bounded(value[k], 0.0, 1.0));
            }
            // Nobody would look at what is still off.
            if round == ROUNDS {
                break;
            }
            weight *= GROWTH;
            let may_change = |texel: u32| around.numbers[texel as usize] != 0;
            found = Around::new(self, first, || around.joints.iter().copied(), may_change);
        }
    }

    /// All points of borders where somebody else has to show the same: four for each texel along them within the patch, two beside other patches.
    fn joints(&self, wanted: &Wanted, number: usize) -> impl Iterator<Item = Joint> {
        let (width, channels) = (self.borders.width, self.storage.opaque_colours().len());
        let pair = move |places: [Place; 2]| Joint::new(&places, width, [0.0; 3], MOST_BETWEEN);
        let alike = wanted.alike.iter().map(move |alike| pair(alike.places));
        let between = wanted.alike.windows(2).filter_map(move |two| match two {
            [Alike { places: one, .. }, Alike { places: other, follows: true }] => {
                Some(pair([0, 1].map(|k| Place::middle(one[k], other[k], width))))
            }
            _ => None,
        });
        let colour = move |point: u32| wanted.colours[point as usize * channels + number];
        let single = move |place: Place, colour: [f32; 3]| Joint::new(&[place], width, colour, MOST_OFF);
        let alone = wanted.alone.iter().map(move |&point| single(wanted.places[point as usize].0, colour(point)));
        let alone_between = wanted.alone_between.iter().map(move |&(place, ends)| {
            let [one, other] = ends.map(colour);
            single(place, std::array::from_fn(|k| 0.5 * (one[k] + other[k])))
        });
        alike.chain(between).chain(alone).chain(alone_between)
    }
}

/// What is around the points that are off.
struct Around {
    /// All points that show any of the texels.
    joints: Vec<Joint>,
    /// Which of them are off.
    are_off: Vec<bool>,
    /// The texels that may change.
    texels: Vec<u32>,
    /// Of each texel its number among these, counted from one; zero for what stays as it is.
    numbers: Vec<u32>,
    /// The numbers of what each point shows. What stays as it is has the number after the last one, and a share of zero.
    unknowns: Vec<([u32; 8], [f32; 8])>,
}

/// One number for each colour component; the last one is not used, but vectors have four.
type Vector = [f32; 4];

impl Around {
    /// The texels of points that are off, and those of all points that show any of these, as far as they may change. None if no point is off.
    fn new<J: Iterator<Item = Joint>>(
        of: &Shown<'_>,
        first: usize,
        all: impl Fn() -> J,
        may_change: impl Fn(u32) -> bool,
    ) -> Option<Self> {
        let mut is_near = vec![];
        for joint in all().filter(|joint| joint.is_off(of, first)) {
            is_near.resize(of.is_covered.len(), false);
            joint.shown_texels().for_each(|texel| is_near[texel as usize] = true);
        }
        if is_near.is_empty() {
            return None;
        }
        let shows = |joint: &Joint, texels: &[bool]| joint.shown_texels().any(|texel| texels[texel as usize]);
        let are_off = is_near.clone();
        for joint in all().filter(|joint| shows(joint, &are_off)) {
            joint.shown_texels().for_each(|texel| is_near[texel as usize] = true);
        }
        let joints: Vec<Joint> = all().filter(|joint| shows(joint, &is_near)).collect();
        let (mut texels, mut numbers) = (vec![], vec![0; is_near.len()]);
        for texel in joints.iter().flat_map(Joint::shown_texels) {
            let number = &mut numbers[texel as usize];
            if *number == 0 && is_near[texel as usize] && may_change(texel) {
                texels.push(texel);
                *number = texels.len() as u32;
            }
        }
        let none = texels.len() as u32;
        let unknowns_of = |joint: &Joint| {
            let (mut unknowns, mut shares) = ([none; 8], [0.0; 8]);
            for (k, (&texel, share)) in joint.texels.iter().zip(joint.shares).enumerate() {
                let number = numbers[texel as usize];
                if number != 0 && share != 0.0 {
                    (unknowns[k], shares[k]) = (number - 1, share);
                }
            }
            (unknowns, shares)
        };
        let are_off = joints.iter().map(|joint| joint.is_off(of, first)).collect();
        let unknowns = joints.iter().map(unknowns_of).collect();
        Some(Self { joints, are_off, texels, numbers, unknowns })
    }

    /// The values of texels with which the squares of all points and of all changes count least, as screens show them. `weight` is what the square of a
    /// point that is off counts. (Conjugate gradients for least squares; Hestenes, Stiefel 1952.)
    fn settled(&self, of: &Shown<'_>, first: usize, weight: f32) -> Vec<Vector> {
        let padded = |[red, green, blue]: [f32; 3]| [red, green, blue, 0.0];
        let mut values: Vec<Vector> = self.texels.iter().map(|&texel| padded(of.texel(texel, first))).collect();
        // Changes of light for each change that is seen.
        let scales: Vec<Vector> = values.iter().map(|value| value.map(|light| 1.0 / slope(light))).collect();
        // How much of each point is left to do, and what a change of its light counts.
        let (mut left, mut slopes) = (vec![], vec![]);
        for (joint, is_off) in self.joints.iter().zip(&self.are_off) {
            let [one, excess] = joint.shown(of, first).map(padded);
            let root = if *is_off { weight } else { WEIGHT }.sqrt();
            let of_light = one.map(|light| root * slope(light));
            left.push(product(excess.map(|excess| -excess), of_light));
            slopes.push(of_light);
        }
        // What is still to do for each texel. How far it is from where it began counts, too.
        let count = values.len();
        let gathered = |left: &[Vector], changes: &[Vector]| {
            let mut sums = vec![Vector::default(); count + 1];
            for (((unknowns, shares), slope), left) in self.unknowns.iter().zip(&slopes).zip(left) {
                let left = product(*left, *slope);
                for (&unknown, &share) in unknowns.iter().zip(shares) {
                    let sum = &mut sums[unknown as usize];
                    (0..4).for_each(|k| sum[k] += share * left[k]);
                }
            }
            let of_texels = sums.iter().zip(&scales).zip(changes);
            of_texels.map(|((sum, scale), change)| difference(product(*sum, *scale), *change)).collect::<Vec<Vector>>()
        };
        let mut changes = vec![Vector::default(); count];
        let mut gradient = gathered(&left, &changes);
        let (mut direction, mut square) = (gradient.clone(), squares(&gradient));
        let enough = square.map(|square| square * ENOUGH);
        for _ in 0..STEPS {
            if (0..3).all(|k| square[k] <= enough[k]) {
                break;
            }
            let mut light: Vec<Vector> = direction.iter().zip(&scales).map(|(a, b)| product(*a, *b)).collect();
            light.push(Vector::default());
            let of_joints: Vec<Vector> = self
                .unknowns
                .iter()
                .zip(&slopes)
                .map(|((unknowns, shares), slope)| {
                    let mut sum = Vector::default();
                    for (&unknown, share) in unknowns.iter().zip(shares) {
                        let light = &light[unknown as usize];
                        (0..4).for_each(|k| sum[k] += share * light[k]);
                    }
                    product(sum, *slope)
                })
                .collect();
            let [of_squares, own] = [squares(&of_joints), squares(&direction)];
            let step = std::array::from_fn(|k| quotient(square[k], of_squares[k] + own[k]));
            add(&mut changes, step, &direction);
            add(&mut left, step.map(|step| -step), &of_joints);
            gradient = gathered(&left, &changes);
            let before = std::mem::replace(&mut square, squares(&gradient));
            let share: Vector = std::array::from_fn(|k| quotient(square[k], before[k]));
            for (direction, gradient) in direction.iter_mut().zip(&gradient) {
                (0..4).for_each(|k| direction[k] = gradient[k] + share[k] * direction[k]);
            }
        }
        for ((value, change), scale) in values.iter_mut().zip(&changes).zip(&scales) {
            (0..3).for_each(|k| value[k] += change[k] * scale[k]);
        }
        values
    }
}

fn product(one: Vector, other: Vector) -> Vector {
    std::array::from_fn(|k| one[k] * other[k])
}

fn difference(one: Vector, other: Vector) -> Vector {
    std::array::from_fn(|k| one[k] - other[k])
}

/// Zero where there is nothing to divide by: a component in which nothing is off.
fn quotient(one: f32, other: f32) -> f32 {
    if other > 0.0 { one / other } else { 0.0 }
}

fn add(sums: &mut [Vector], factor: Vector, values: &[Vector]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        (0..4).for_each(|k| sum[k] += factor[k] * value[k]);
    }
}

fn squares(values: &[Vector]) -> Vector {
    values.iter().fold(Vector::default(), |sum, value| std::array::from_fn(|k| sum[k] + value[k] * value[k]))
}

/// About how much more of what screens show there is with each change of linear light.
fn slope(light: f32) -> f32 {
    1.0 / light.max(DARK).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::borders::Borders;
    use super::super::{Storage, Stored};
    use super::*;

    /// Two pieces of two by two texels, a darker and a brighter one, after they are settled: which of their texels have changed, and what places show.
    fn after(wanted: &Wanted, places: &[Place]) -> (Vec<usize>, Vec<[f32; 3]>) {
        let storage = Storage::new(vec![Stored::Colour { components: 3, step: 1 }]);
        let mut borders = Borders::default();
        borders.width = 4;
        let before: Vec<f32> =
            (0..8).flat_map(|texel| [if texel % 4 < 2 { 0.4 } else { 0.5 }, 0.3, 0.6, 1.0]).collect();
        let mut values = before.clone();
        let mut shown = Shown { storage: &storage, values: &mut values, is_covered: &[true; 8], borders: &borders };
        shown.settle(wanted, 0, 0);
        let joints = places.iter().map(|&place| Joint::new(&[place], 4, [0.0; 3], 0));
        let colours = joints.map(|joint| joint.shown(&shown, 0)[0]).collect();
        let changed = (0..8).filter(|&texel| values[4 * texel..][..4] != before[4 * texel..][..4]).collect();
        (changed, colours)
    }

    #[test]
    fn sides_that_want_the_same_show_the_same_in_the_end() {
        let places = [0, 2].map(Place::between);
        let wanted = Wanted { alike: vec![Alike { places, follows: false }], ..Wanted::default() };
        let (changed, colours) = after(&wanted, &places);
        assert_eq!(changed, [0, 1, 2, 3, 4, 5, 6, 7]);
        let [one, other] = [colours[0], colours[1]].map(|colour| colour.map(srgb_byte));
        let [low, high] = [0.4, 0.5].map(srgb_byte);
        assert!(low < one[0] && one[0] <= other[0] && other[0] < high, "{one:?} {other:?}");
        assert!(other[0] - one[0] <= MOST_BETWEEN, "{one:?} {other:?}");
        // Colours that are the same stay.
        assert_eq!(one[1..], [0.3, 0.6].map(srgb_byte));
        assert_eq!(other[1..], [0.3, 0.6].map(srgb_byte));
    }

    #[test]
    fn what_somebody_beyond_shows_as_well_is_shown_and_nothing_else_changes() {
        let place = Place::between(0);
        let of_point = |colour| {
            let (places, colours, alone) = (vec![(place, 1.0)], vec![colour], vec![0]);
            Wanted { places, colours, alone, ..Wanted::default() }
        };
        let (changed, colours) = after(&of_point([0.2, 0.4, 0.6]), &[place]);
        assert_eq!(changed, [0, 1, 4, 5]);
        let off = |k: usize| srgb_byte(colours[0][k]).abs_diff(srgb_byte([0.2, 0.4, 0.6][k]));
        assert!((0..3).all(|k| off(k) <= MOST_OFF), "{colours:?}");
        assert_eq!(after(&of_point([0.4, 0.3, 0.6]), &[]).0, [0; 0]);
    }

    #[test]
    fn middles_lie_between_texels_of_the_same_piece() {
        let texels = |one, other| Place::middle(Place::between(one), Place::between(other), 4).texels(4);
        let shown = |one, other| texels(one, other).into_iter().filter(|(_, share)| *share > 0.0).collect::<Vec<_>>();
        assert_eq!(shown(0, 0), [(0, 0.25), (1, 0.25), (4, 0.25), (5, 0.25)]);
        assert_eq!(shown(0, 1), [(1, 0.5), (5, 0.5)]);
        assert_eq!(shown(1, 0), [(1, 0.5), (5, 0.5)]);
        assert_eq!(shown(0, 5), [(5, 1.0)]);
    }
}
