//! Texels sixteen at a time, in loops that compilers turn into vectors. Nothing depends on which of them are handled
//! together.

/// How many texels at a time.
pub(super) const LANES: usize = 16;

/// Where flags are set. Most are not, and are passed over together.
pub(super) fn set(flags: &[bool]) -> impl Iterator<Item = usize> {
    fn of_some(first: usize, some: &[bool]) -> impl Iterator<Item = usize> {
        some.iter().enumerate().filter(|(_, flag)| **flag).map(move |(at, _)| first + at)
    }
    let (lanes, rest) = flags.as_chunks::<LANES>();
    let with_any = lanes.iter().enumerate().filter(|(_, lane)| **lane != [false; LANES]);
    with_any.flat_map(|(number, lane)| of_some(number * LANES, lane)).chain(of_some(lanes.len() * LANES, rest))
}

/// The least of some numbers, none of which is NaN.
#[inline(always)]
pub(super) fn least(mut lane: [f32; LANES]) -> f32 {
    for half in [8, 4, 2, 1] {
        for k in 0..half {
            lane[k] = if lane[k] < lane[k + half] { lane[k] } else { lane[k + half] };
        }
    }
    lane[0]
}

/// The largest whole number that is not above a number from 0 to 2^22; anything for other numbers. Conversions
/// saturate, which takes vectors long.
#[inline(always)]
pub(super) fn whole(x: f32) -> u32 {
    let rounded = x + SHIFT;
    (rounded.to_bits() & 0x007f_ffff).wrapping_sub(u32::from(rounded - SHIFT > x))
}

/// Numbers of single precision have no fraction from here to twice as much.
const SHIFT: f32 = (1 << 23) as f32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_found_where_they_are_set() {
        let flags: Vec<bool> = (0..100).map(|at| at % 37 == 5 || at == 99).collect();
        assert!(set(&flags).eq([5, 42, 79, 99]));
        assert_eq!(set(&[]).count(), 0);
    }

    #[test]
    fn whole_parts_are_those_of_conversions() {
        for number in (0..=1 << 22).step_by(13) {
            for x in [number as f32 / 256.0, number as f32, number as f32 + 0.5] {
                assert_eq!(whole(x), x as u32, "{x}");
            }
        }
        let below = f32::from_bits(1.0_f32.to_bits() - 1);
        assert_eq!([whole(0.0), whole(below), whole(1.0)], [0, 0, 1]);
    }
}
