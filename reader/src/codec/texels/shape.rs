//! Shapes of pieces of a map: along which axis they are projected, and what texels they have.

use super::binary::BitDecoder;
#[cfg(feature = "write")]
use super::binary::BitEncoder;
#[cfg(feature = "write")]
use crate::codec::vector::dot;
use crate::{
    codec::{
        local_frame::LocalFrame,
        vector::{Vec3, add, scale, sub},
    },
    error::{Error, Result},
};

/// Largest exponent of a texel's size.
pub(super) const MAX_EXPONENT: u32 = 127;
/// Axes have coordinates of at most this.
const AXIS_LIMIT: i32 = 31;
/// Stands before the axis of a piece with larger texels, and twice before that of one whose texels are longer than
/// wide.
const LARGER: u32 = 63;
/// Texels of a piece are larger by at most this power of the root of two.
#[cfg(feature = "write")]
const MOST_LARGER: u8 = 31;
/// They are longer than wide by at most this power of the root of two.
#[cfg(feature = "write")]
const MOST_LONGER: u8 = 15;
/// Cosine and sine of the turns of a piece in its plane: k / 8 of a right angle.
const TURNS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [0.980_785_280_403_230_4, 0.195_090_322_016_128_27],
    [0.923_879_532_511_286_7, 0.382_683_432_365_089_8],
    [0.831_469_612_302_545_2, 0.555_570_233_019_602_2],
    [std::f64::consts::FRAC_1_SQRT_2, 0.707_106_781_186_547_5],
    [0.555_570_233_019_602_3, 0.831_469_612_302_545_2],
    [0.382_683_432_365_089_8, 0.923_879_532_511_286_7],
    [0.195_090_322_016_128_33, 0.980_785_280_403_230_4],
];
/// Those of the turns of long texels beyond that: k / 64 of a right angle.
const FINE_TURNS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [0.999_698_818_696_204_2, 0.024_541_228_522_912_288],
    [0.998_795_456_205_172_4, 0.049_067_674_327_418_015],
    [0.997_290_456_678_690_2, 0.073_564_563_599_667_43],
    [0.995_184_726_672_196_9, 0.098_017_140_329_560_6],
    [0.992_479_534_598_71, 0.122_410_675_199_216_2],
    [0.989_176_509_964_781, 0.146_730_474_455_361_75],
    [0.985_277_642_388_941_2, 0.170_961_888_760_301_22],
];

/// Axis, turn and texels of a piece.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    axis: [i32; 3],
    turn: u8,
    /// How much larger its texels are than those of the map, as a power of the root of two.
    larger: u8,
    long: Option<Long>,
}

/// How texels are longer than wide.
#[derive(Clone, Copy, Debug)]
struct Long {
    /// By how much, as a power of the root of two.
    longer: u8,
    /// Whether they are so along columns of the image, else along rows.
    is_down: bool,
    /// A turn beyond that of the piece.
    turn: u8,
}

impl Shape {
    pub fn decode(bits: &mut BitDecoder<'_>) -> Result<Self> {
        let (mut first, mut larger, mut long) = (bits.raw(6), 0, None);
        if first == LARGER {
            (larger, first) = (bits.raw(5) as u8, bits.raw(6));
        }
        if first == LARGER {
            let [longer, down, turn] = [4, 1, 3].map(|count| bits.raw(count) as u8);
            (long, first) = (Some(Long { longer, is_down: down == 1, turn }), bits.raw(6));
        }
        let axis = [first, bits.raw(6), bits.raw(6)].map(|x| x as i32 - AXIS_LIMIT);
        if axis == [0; 3] || axis.iter().any(|&x| x > AXIS_LIMIT) {
            return Err(Error::format("a piece of a map has no axis"));
        }
        Ok(Self { axis, turn: bits.raw(3) as u8, larger, long })
    }

    #[cfg(feature = "write")]
    pub fn encode(self, bits: &mut BitEncoder) {
        if self.larger > 0 || self.long.is_some() {
            bits.raw(6, LARGER);
            bits.raw(5, u32::from(self.larger));
        }
        if let Some(Long { longer, is_down, turn }) = self.long {
            bits.raw(6, LARGER);
            bits.raw(4, u32::from(longer));
            bits.raw(1, u32::from(is_down));
            bits.raw(3, u32::from(turn));
        }
        self.axis.iter().for_each(|&x| bits.raw(6, (x + AXIS_LIMIT) as u32));
        bits.raw(3, u32::from(self.turn));
    }

    /// The directions of rows and columns.
    fn directions(self) -> [Vec3; 2] {
        let axis = self.axis.map(f64::from);
        let mut least = 0;
        for k in 1..3 {
            if axis[k].abs() < axis[least].abs() {
                least = k;
            }
        }
        let mut direction = [0.0; 3];
        direction[least] = 1.0;
        let frame = LocalFrame::new(axis, direction);
        let turned = |[along, across]: [Vec3; 2], [cosine, sine]: [f64; 2]| {
            [add(scale(along, cosine), scale(across, sine)), sub(scale(across, cosine), scale(along, sine))]
        };
        let directions = turned([frame.along, frame.across], TURNS[usize::from(self.turn) % TURNS.len()]);
        match self.long {
            Some(long) => turned(directions, FINE_TURNS[usize::from(long.turn) % FINE_TURNS.len()]),
            None => directions,
        }
    }

    /// What a lattice point is multiplied with.
    pub fn across(self, exponent: u32) -> [Vec3; 2] {
        let inverse = |larger: u8| 1.0 / texel_size((exponent + u32::from(larger)).min(MAX_EXPONENT));
        let longer = |is_so: bool| self.long.map_or(0, |long| if long.is_down == is_so { long.longer } else { 0 });
        let [u, v] = self.directions();
        [scale(u, inverse(self.larger + longer(false))), scale(v, inverse(self.larger + longer(true)))]
    }
}

/// The size of a texel in lattice units: 2^(exponent / 2).
pub fn texel_size(exponent: u32) -> f64 {
    let whole = (1_u64 << (exponent / 2).min(63)) as f64;
    if exponent % 2 == 1 { whole * std::f64::consts::SQRT_2 } else { whole }
}

/// The shape of a piece before it has a place.
#[cfg(feature = "write")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PieceShape {
    /// The direction along which it is projected: from -31 to 31 each, not all 0.
    pub axis: [i8; 3],
    /// How much larger its texels are than those of the map, as a power of the root of two: at most 31.
    pub larger: u8,
    /// How they are longer than wide, if they are.
    pub long: Option<LongTexels>,
}

/// Texels that are longer than wide.
#[cfg(feature = "write")]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LongTexels {
    /// The direction across them, along which they are finer: about at right angles to the piece's axis, of any length
    /// but 0.
    pub across: [i8; 3],
    /// By how much they are finer in that direction, as a power of the root of two.
    pub finer: u8,
    /// By how much they are coarser in the other one. Together at most 15.
    pub coarser: u8,
}

#[cfg(feature = "write")]
impl PieceShape {
    /// How much finer than those of the map texels are along one direction.
    pub(super) fn finer(&self) -> u8 {
        self.long.map_or(0, |long| long.finer.min(MOST_LONGER)).saturating_sub(self.larger)
    }

    /// The shapes among which the one with the smallest rectangle is taken, where texels of the map are so much finer
    /// than they were to be. Long texels leave one alone.
    pub(super) fn candidates(&self, finer: u8) -> Vec<Shape> {
        let larger = self.larger.min(MOST_LARGER) + finer;
        let axis = self.axis.map(i32::from);
        let turns = 0..TURNS.len() as u8;
        let Some(LongTexels { across, finer, coarser }) = self.long else {
            return turns.map(|turn| Shape { axis, turn, larger: larger.min(MOST_LARGER), long: None }).collect();
        };
        let longest = larger.saturating_add(coarser);
        let larger = larger.saturating_sub(finer).min(MOST_LARGER);
        let longer = (longest - larger).min(MOST_LONGER);
        let across = across.map(f64::from);
        let fine_turns = 0..FINE_TURNS.len() as u8;
        let longs: Vec<Long> =
            fine_turns.flat_map(|turn| [false, true].map(|is_down| Long { longer, is_down, turn })).collect();
        let all = turns.flat_map(|turn| longs.iter().map(move |&long| Shape { axis, turn, larger, long: Some(long) }));
        // The direction that is not the long one.
        let fitness = |shape: &Shape| {
            let [u, v] = shape.directions();
            dot(if shape.long.is_some_and(|long| long.is_down) { u } else { v }, across).abs()
        };
        all.max_by(|one, other| fitness(one).total_cmp(&fitness(other))).into_iter().collect()
    }
}
