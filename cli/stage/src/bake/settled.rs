//! Texels around points of borders that do not show what they should, found for many points together.
//!
//! [`Shown::show_all`](super::shown::Shown::show_all) makes one point right after another. Points share texels: where
//! colours along a border are steep, what is done for one undoes what was done for the one before, and between points
//! anything may come of it. Here the texels around such points are found at once, by least squares: those with which
//! all points around, up to four for each texel along the border, are nearest to what they should show while texels
//! stay near to what they are. Differences count as screens show them.

use super::strip::{Strip, Vector, bounded};
use super::values::plus;
use lodpack_mesh::srgb::srgb_byte;

/// Sides of a border that differ by more than this, of 255, are found together, with what is around them.
const MOST_BETWEEN: u8 = 5;
/// And a side that is off by more than this from what both sides of a border should show.
const MOST_OFF: u8 = 3;
/// Points that are off by less than this, in linear light, are not looked at closely: at their darkest they differ by
/// less than two of 255.
const SAME: f32 = 0.0005;
/// Weight of a border point's squared error relative to a texel's squared change.
const WEIGHT: f32 = 40.0;
/// Rounds in which texels are found, each from what they are by then. If points that are still off count four times as
/// much in each, these rounds do not suffice, and more points are off in the end.
const ROUNDS: usize = 3;
/// Steps of conjugate gradients for each of these. With 30 files are as large, and borders no better.
const STEPS: usize = 15;
/// They end where the square of the gradient has fallen to this share.
const ENOUGH: f32 = 1e-3;
/// Colours that are darker than this, in linear light, differ as much to the eye as this.
const DARK: f32 = 0.003;

/// A point of a border.
#[derive(Clone, Copy)]
pub(super) struct Joint {
    /// The texels of one side, then those of the other.
    texels: [u32; 8],
    /// How much of each is shown. Those of the other side are negative, and zero where that is not at hand.
    shares: [f32; 8],
    /// Where the other side is not at hand, what the one should show; else zero.
    wanted: Vector,
    /// By how much both may differ, of 255.
    most: u8,
}

impl Joint {
    /// Where both sides show what they should if they show the same.
    pub fn pair([one, other]: [[(u32, f32); 4]; 2]) -> Self {
        let (one, other) = (one.iter().copied(), other.iter().map(|&(texel, share)| (texel, -share)));
        Self::new(one.chain(other), Vector::default(), MOST_BETWEEN)
    }

    /// What one side should show, where the other is not at hand.
    pub fn alone(one: [(u32, f32); 4], [red, green, blue]: [f32; 3]) -> Self {
        Self::new(one.into_iter().chain([(one[0].0, 0.0); 4]), [red, green, blue, 0.0], MOST_OFF)
    }

    fn new(parts: impl Iterator<Item = (u32, f32)>, wanted: Vector, most: u8) -> Self {
        let mut this = Self { texels: [0; 8], shares: [0.0; 8], wanted, most };
        for (k, part) in parts.enumerate() {
            (this.texels[k], this.shares[k]) = part;
        }
        this
    }

    /// The texels, and how much is shown of each.
    fn parts(&self) -> impl Iterator<Item = (usize, f32)> {
        self.texels.into_iter().zip(self.shares).map(|(texel, share)| (texel as usize, share))
    }

    fn all_texels(&self) -> impl Iterator<Item = usize> {
        self.texels.into_iter().map(|texel| texel as usize)
    }

    /// What both sides show. Of a side that is not at hand, what it should.
    fn shown(&self, values: &[Vector]) -> [Vector; 2] {
        let (mut one, mut other) = (Vector::default(), self.wanted);
        // As loops, of which compilers make vectors.
        for k in 0..4 {
            one = plus(one, values[self.texels[k] as usize], self.shares[k]);
            other = plus(other, values[self.texels[k + 4] as usize], -self.shares[k + 4]);
        }
        [one, other]
    }

    /// Whether the other side is at hand.
    fn is_pair(&self) -> bool {
        self.shares[4..] != [0.0; 4]
    }

    /// How much of what is missing the one side has to make up for.
    fn part_of_one(&self) -> f32 {
        if self.is_pair() { 0.5 } else { 1.0 }
    }

    fn differs(&self, values: &[Vector]) -> bool {
        let [one, other] = self.shown(values);
        let differs = |k: usize| srgb_byte(one[k]).abs_diff(srgb_byte(other[k])) > self.most;
        (0..3).any(|k| (one[k] - other[k]).abs() >= SAME) && (0..3).any(differs)
    }
}

/// Changes texels where borders are still off. Points of which both sides are at hand come first, as
/// [`Shown`](super::shown::Shown) adds them.
pub(super) fn settle(joints: &[Joint], values: &mut [Vector]) {
    let Some(mut around) = Around::new(joints, values, |texel| (texel as u32, true)) else { return };
    for round in 1.. {
        around.settle();
        for (&place, &value) in around.places.iter().zip(&around.values) {
            values[place as usize] = value;
        }
        // What is still off then would not be looked at.
        if round == ROUNDS {
            break;
        }
        let place = |texel: usize| (around.places[texel], around.may_change[texel]);
        match Around::new(&around.joints, &around.values, place) {
            Some(still_off) => around = still_off,
            None => break,
        }
    }
}

/// Points of borders that are off and what is around them: all that show texels of these or of those beside them, which
/// are what may change.
struct Around {
    /// Their texels are numbers in the lists below. Points of which both sides are at hand come first.
    joints: Vec<Joint>,
    /// Where each texel was.
    places: Vec<u32>,
    values: Vec<Vector>,
    may_change: Vec<bool>,
}

impl Around {
    /// None if no point is off. `place` says of a texel what place to remember, and whether it may change.
    fn new(joints: &[Joint], values: &[Vector], place: impl Fn(usize) -> (u32, bool)) -> Option<Self> {
        let mut is_near = vec![false; values.len()];
        let mut is_any = false;
        for joint in joints.iter().filter(|joint| joint.differs(values)) {
            joint.all_texels().for_each(|texel| is_near[texel] = true);
            is_any = true;
        }
        if !is_any {
            return None;
        }
        let shows = |joint: &Joint, texels: &[bool]| joint.all_texels().any(|texel| texels[texel]);
        let are_shown = is_near.clone();
        for joint in joints.iter().filter(|joint| shows(joint, &are_shown)) {
            joint.all_texels().for_each(|texel| is_near[texel] = true);
        }
        let mut strip = Strip::default();
        strip.clear(values.len());
        let near = joints.iter().filter(|joint| shows(joint, &is_near));
        let numbered = |joint: &Joint| Joint { texels: joint.texels.map(|texel| strip.number(texel)), ..*joint };
        let joints = near.map(numbered).collect();
        let texels = || strip.texels().iter().map(|&texel| texel as usize);
        let near_place = |texel: usize| {
            let (place, may_change) = place(texel);
            (place, may_change && is_near[texel])
        };
        let (places, may_change) = texels().map(near_place).unzip();
        Some(Self { joints, places, values: texels().map(|texel| values[texel]).collect(), may_change })
    }

    /// Changes texels to those with which the squares of all points and of all changes count least, as screens show
    /// them. (Conjugate gradients for least squares; Hestenes, Stiefel 1952.)
    fn settle(&mut self) {
        // Changes of light for each change that is seen. What does not change has none.
        let scales = self.scales();
        // How much is left to do for each texel, and what a change of light of each point counts.
        let mut gradient = vec![Vector::default(); self.values.len()];
        let mut weights = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            let [one, other] = joint.shown(&self.values);
            let of_light = zipped(one, other, |one, other| {
                let slope = 1.0 / scale(one, other);
                WEIGHT * slope * slope
            });
            let missing = zipped(other, one, |other, one| other - one);
            spread(&mut gradient, joint, product(missing, of_light));
            weights.push(of_light);
        }
        gradient.iter_mut().zip(&scales).for_each(|(sum, &scale)| *sum = product(*sum, scale));
        let mut changes = vec![Vector::default(); gradient.len()];
        let (mut direction, mut square) = (gradient.clone(), squares(&gradient));
        let enough = square.map(|square| square * ENOUGH);
        let mut texels = vec![Trial::default(); gradient.len()];
        // Where one side alone is at hand, it alone is looked at: those lie behind the others.
        let (pairs, alone) = self.joints.split_at(self.joints.partition_point(Joint::is_pair));
        let (of_pairs, of_alone) = weights.split_at(pairs.len());
        for _ in 0..STEPS {
            if (0..3).all(|k| square[k] <= enough[k]) {
                break;
            }
            for ((texel, &direction), &scale) in texels.iter_mut().zip(&direction).zip(&scales) {
                *texel = Trial { light: product(direction, scale), sum: Vector::default() };
            }
            pairs.iter().zip(of_pairs).for_each(|(joint, &weight)| attempt::<8>(&mut texels, joint, weight));
            alone.iter().zip(of_alone).for_each(|(joint, &weight)| attempt::<4>(&mut texels, joint, weight));
            let mut curvature = Vector::default();
            for ((Trial { sum, .. }, &direction), &scale) in texels.iter_mut().zip(&direction).zip(&scales) {
                // How far a texel is from where it began counts, too.
                *sum = zipped(product(*sum, scale), direction, |sum, direction| sum + direction);
                (0..4).for_each(|k| curvature[k] += sum[k] * direction[k]);
            }
            let step = zipped(square, curvature, quotient);
            for (((change, gradient), direction), Trial { sum, .. }) in
                changes.iter_mut().zip(&mut gradient).zip(&direction).zip(&texels)
            {
                for k in 0..4 {
                    change[k] += step[k] * direction[k];
                    gradient[k] -= step[k] * sum[k];
                }
            }
            let before = std::mem::replace(&mut square, squares(&gradient));
            let share = zipped(square, before, quotient);
            for (direction, gradient) in direction.iter_mut().zip(&gradient) {
                *direction = std::array::from_fn(|k| gradient[k] + share[k] * direction[k]);
            }
        }
        for ((value, &change), &scale) in self.values.iter_mut().zip(&changes).zip(&scales) {
            let change = product(change, scale);
            (0..3).for_each(|k| value[k] = bounded(value[k] + change[k], 0.0, 1.0));
        }
    }

    /// For each texel how much its light changes with what is seen of it, between what it is and about where it will
    /// be: where its points need it to be, in the mean. Black texels and white ones would else go to black together,
    /// since near white little is seen of a change.
    fn scales(&self) -> Vec<Vector> {
        let mut needed = vec![(Vector::default(), 0.0); self.values.len()];
        for joint in &self.joints {
            let ([one, other], part) = (joint.shown(&self.values), joint.part_of_one());
            let missing = zipped(other, one, |other, one| part * (other - one));
            for (texel, share) in joint.parts() {
                let (sum, shares) = &mut needed[texel];
                (*sum, *shares) = (plus(*sum, missing, share), *shares + share.abs());
            }
        }
        let scale_of = |((&value, &(sum, shares)), &may_change): ((&Vector, &(Vector, f32)), &bool)| {
            if !may_change {
                return Vector::default();
            }
            zipped(value, sum, |value, sum| scale(value, bounded(value + sum / shares, 0.0, 1.0)))
        };
        self.values.iter().zip(&needed).zip(&self.may_change).map(scale_of).collect()
    }
}

/// What a step of conjugate gradients does to a texel.
#[derive(Clone, Copy, Default)]
struct Trial {
    /// By how much its light changes.
    light: Vector,
    /// What that counts at the points that show it.
    sum: Vector,
}

/// Adds what a step counts at a point, given the number of its texels that are looked at.
#[inline(always)]
fn attempt<const TEXELS: usize>(texels: &mut [Trial], joint: &Joint, weight: Vector) {
    // As loops, of which compilers make vectors, over numbers of which they see that they stay.
    let mut numbers = [0; TEXELS];
    for k in 0..TEXELS {
        numbers[k] = joint.texels[k] as usize;
    }
    let mut sum = Vector::default();
    for k in 0..TEXELS {
        sum = plus(sum, texels[numbers[k]].light, joint.shares[k]);
    }
    let counts = product(sum, weight);
    for k in 0..TEXELS {
        let sum = &mut texels[numbers[k]].sum;
        *sum = plus(*sum, counts, joint.shares[k]);
    }
}

/// Adds to the texels of a point what is given, as much as it shows of each.
fn spread(sums: &mut [Vector], joint: &Joint, value: Vector) {
    for k in 0..8 {
        let sum = &mut sums[joint.texels[k] as usize];
        *sum = plus(*sum, value, joint.shares[k]);
    }
}

fn zipped(one: Vector, other: Vector, of: impl Fn(f32, f32) -> f32) -> Vector {
    std::array::from_fn(|k| of(one[k], other[k]))
}

fn product(one: Vector, other: Vector) -> Vector {
    zipped(one, other, |one, other| one * other)
}

/// Zero where there is nothing to divide by: a component in which nothing is off.
fn quotient(one: f32, other: f32) -> f32 {
    if other > 0.0 { one / other } else { 0.0 }
}

fn squares(values: &[Vector]) -> Vector {
    values.iter().fold(Vector::default(), |sum, &value| zipped(sum, value, |sum, value| sum + value * value))
}

/// How much linear light changes with what screens show, in the mean between two colours: a change that is seen is
/// about one of the square root.
fn scale(one: f32, other: f32) -> f32 {
    0.5 * (one.max(DARK).sqrt() + other.max(DARK).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::borders::{Borders, Place};
    use super::super::shown::Shown;
    use super::super::wanted::{Alike, Wanted};
    use super::super::{Storage, Stored};
    use super::*;

    /// Two pieces of two by two texels, of which red differs, after they are settled: which of their texels have
    /// changed, and what places show.
    fn after(reds: [f32; 2], wanted: &Wanted, places: &[Place]) -> (Vec<usize>, Vec<[f32; 3]>) {
        let (storage, mut strip) = (Storage::new(vec![Stored::Colour { components: 3, step: 1 }]), Strip::default());
        let mut borders = Borders::default();
        borders.width = 4;
        let before: Vec<f32> = (0..8).flat_map(|texel| [reds[texel % 4 / 2], 0.3, 0.6, 1.0]).collect();
        let mut values = before.clone();
        let shown = Shown { storage: &storage, values: &mut values, is_covered: &[true; 8], borders: &borders };
        strip.clear(8);
        let mut joints = vec![];
        shown.add_joints(wanted, 0, &mut strip, &mut joints);
        let mut colours = strip.read(shown.values, &storage, 0);
        settle(&joints, &mut colours);
        strip.write(&colours, shown.values, &storage, 0);
        let colours = places.iter().map(|&place| shown.shown(place, 0)).collect();
        let changed = (0..8).filter(|&texel| values[4 * texel..][..4] != before[4 * texel..][..4]).collect();
        (changed, colours)
    }

    #[test]
    fn sides_that_want_the_same_show_the_same_in_the_end() {
        let places = [0, 2].map(Place::between);
        let wanted = Wanted { alike: vec![Alike { places, follows: false }], ..Wanted::default() };
        for reds in [[0.4, 0.5], [0.5, 0.4], [0.0, 1.0]] {
            let (changed, colours) = after(reds, &wanted, &places);
            assert_eq!(changed, [0, 1, 2, 3, 4, 5, 6, 7]);
            let [one, other] = [colours[0], colours[1]].map(|colour| colour.map(srgb_byte));
            assert!(one[0].abs_diff(other[0]) <= MOST_BETWEEN, "{one:?} {other:?}");
            // In the middle, as screens show it.
            let middle = reds.map(|red| f32::from(srgb_byte(red))).iter().sum::<f32>() / 2.0;
            assert!((f32::from(one[0]) - middle).abs() < 20.0, "{one:?} {other:?} {middle}");
            // Colours that are the same stay.
            assert_eq!(one[1..], [0.3, 0.6].map(srgb_byte));
            assert_eq!(other[1..], [0.3, 0.6].map(srgb_byte));
        }
    }

    #[test]
    fn what_somebody_beyond_shows_as_well_is_shown_and_nothing_else_changes() {
        let place = Place::between(0);
        let of_point = |colour| {
            let (places, colours, alone) = (vec![(place, 1.0)], vec![colour], vec![0]);
            Wanted { places, colours, alone, ..Wanted::default() }
        };
        let (changed, colours) = after([0.4, 0.5], &of_point([0.2, 0.4, 0.6]), &[place]);
        assert_eq!(changed, [0, 1, 4, 5]);
        let off = |k: usize| srgb_byte(colours[0][k]).abs_diff(srgb_byte([0.2, 0.4, 0.6][k]));
        assert!((0..3).all(|k| off(k) <= MOST_OFF), "{colours:?}");
        assert_eq!(after([0.4, 0.5], &of_point([0.4, 0.3, 0.6]), &[]).0, [0; 0]);
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
