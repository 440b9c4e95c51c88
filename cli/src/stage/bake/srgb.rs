//! sRGB and linear light, by arithmetic that is the same on every machine.

use std::sync::LazyLock;

/// Linear light of a byte.
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| std::array::from_fn(|byte| exact(byte as f64 / 255.0) as f32));

/// The least linear light of each byte but 0.
static LEAST: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|byte| exact((byte as f64 + 0.5) / 255.0) as f32));

/// Linear light of an encoded value from 0 to 1.
fn exact(encoded: f64) -> f64 {
    if encoded <= 0.04045 {
        return encoded / 12.92;
    }
    let base = (encoded + 0.055) / 1.055;
    // x^2.4 = x^2 * (x^2)^(1/5), and the root by Newton's method.
    let square = base * base;
    let mut root = 1.0;
    for _ in 0..40 {
        root = (4.0 * root + square / (root * root * root * root)) / 5.0;
    }
    square * root
}

/// Linear light of a byte.
pub fn to_linear(byte: u8) -> f32 {
    LINEAR[usize::from(byte)]
}

/// Linear light of an encoded value, which is clamped to 0 to 1.
pub fn value_to_linear(encoded: f32) -> f32 {
    exact(f64::from(encoded.clamp(0.0, 1.0))) as f32
}

/// The byte nearest to linear light, as the eye counts.
pub fn from_linear(linear: f32) -> u8 {
    LEAST.partition_point(|&least| least <= linear) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::disallowed_methods, reason = "the test compares with the definition")]
    fn bytes_come_back_and_agree_with_the_definition() {
        for byte in 0..=255 {
            assert_eq!(from_linear(to_linear(byte)), byte);
            let encoded = f64::from(byte) / 255.0;
            let linear = if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(to_linear(byte)) - linear).abs() < 1e-7);
            assert!((value_to_linear(encoded as f32) - to_linear(byte)).abs() < 1e-6);
        }
        assert_eq!((from_linear(-1.0), from_linear(f32::NAN), from_linear(2.0)), (0, 0, 255));
    }
}
