//! Powers of two and logarithms with the same bits on all machines. Mathematics libraries differ in the last bit, so
//! nothing that the bytes of a file depend on may call them; `clippy.toml` lists their functions.

/// 2^exponent, exactly, for exponents from -1022 to 1023.
pub fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// The largest exponent whose power of two is not above a positive number; -1023 for subnormal numbers, 1024 for
/// infinity.
pub fn floor_log2(number: f64) -> i32 {
    (number.to_bits() >> 52) as i32 - 1023
}

/// `least` times the power of two that comes nearest to a number in ratio, but `least` itself for smaller numbers.
pub fn power_of_two_near(number: f64, least: f64) -> f64 {
    let mut power = least;
    while power * std::f64::consts::SQRT_2 < number {
        power *= 2.0;
    }
    power
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logarithms_step_exactly_at_powers_of_two() {
        for exponent in -1022..=1023 {
            let power = power_of_two(exponent);
            assert_eq!(power.log2(), f64::from(exponent));
            let around = [power.next_down(), power, power.next_up(), power * 1.5];
            assert_eq!(around.map(floor_log2), [exponent - 1, exponent, exponent, exponent]);
        }
    }

    #[test]
    fn the_nearest_power_of_two_is_nearest_in_ratio() {
        assert_eq!([0.1, 1.4, 1.42, 2.8, 2.83, 100.0].map(|x| power_of_two_near(x, 1.0)), [1., 1., 2., 2., 4., 128.]);
        assert_eq!(power_of_two_near(f64::from(1 << 20), 3.0), 3.0 * f64::from(1 << 18));
    }
}
