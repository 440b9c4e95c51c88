//! Colours as screens encode them (IEC 61966-2-1, sRGB), and in linear light.

/// Linear light of each byte.
pub static LINEAR_OF_BYTE: [f32; 256] = {
    let (mut table, mut byte) = ([0.0; 256], 0);
    while byte < table.len() {
        table[byte] = linear_from_srgb(byte as f32 / 255.0);
        byte += 1;
    }
    table
};

/// Linear light of an encoded value from 0 to 1. It uses no function whose last bit differs between machines.
pub const fn linear_from_srgb(encoded: f32) -> f32 {
    let encoded = encoded.clamp(0.0, 1.0) as f64;
    if encoded <= 0.04045 {
        return (encoded / 12.92) as f32;
    }
    let base = (encoded + 0.055) / 1.055;
    // base^2.4 = base^2 * (base^2)^(1/5), and Newton's method finds the fifth root. It starts above the root, so it
    // comes down to it.
    let square = base * base;
    let (mut root, mut round) = (1.0, 0);
    while round < 12 {
        let fourth = root * root * root * root;
        root -= (root - square / fourth) / 5.0;
        round += 1;
    }
    (square * root) as f32
}

/// The brightness of red, green and blue (the weights of BT.709).
#[inline]
pub fn brightness([red, green, blue]: [f32; 3]) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// The least linear light of the byte after each; no number is for the last one.
static LEAST_OF_NEXT: [f32; 256] = {
    let (mut table, mut byte) = ([f32::NAN; 256], 0);
    while byte < table.len() - 1 {
        table[byte] = linear_from_srgb((byte as f32 + 0.5) / 255.0);
        byte += 1;
    }
    table
};

/// The number of parts into which linear light is divided for a first guess: enough that no part has more than two
/// bytes.
const PARTS: usize = 4096;

/// The byte at the beginning of each part.
static BYTE_OF_PART: [u8; PARTS] = {
    let (mut table, mut part, mut byte) = ([0; PARTS], 0, 0);
    while part < PARTS {
        while LEAST_OF_NEXT[byte] <= part as f32 / PARTS as f32 {
            byte += 1;
        }
        table[part] = byte as u8;
        part += 1;
    }
    table
};

/// The byte whose encoded value is nearest to that of linear light.
#[inline]
pub fn srgb_byte(linear: f32) -> u8 {
    // The conversion saturates, and NaN becomes 0.
    let byte = BYTE_OF_PART[usize::from((linear * PARTS as f32) as u16).min(PARTS - 1)];
    byte.wrapping_add(u8::from(LEAST_OF_NEXT[usize::from(byte)] <= linear))
}

/// The byte of a share from 0 to 1. The conversion saturates, and NaN becomes 0.
#[inline]
pub fn share_byte(share: f32) -> u8 {
    (share.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[expect(clippy::disallowed_methods, reason = "the power is what the function is compared with")]
    fn decoding_agrees_with_the_power_function() {
        for i in 0..=4096 {
            let encoded = i as f32 / 4096.0;
            let e = f64::from(encoded);
            let expected = if e <= 0.04045 { e / 12.92 } else { ((e + 0.055) / 1.055).powf(2.4) };
            assert!((f64::from(linear_from_srgb(encoded)) - expected).abs() < 1e-7, "{encoded}");
        }
        assert_eq!((LINEAR_OF_BYTE[0], LINEAR_OF_BYTE[255]), (0.0, 1.0));
    }

    #[test]
    fn bytes_come_back() {
        assert!((0..=255).all(|byte: u8| srgb_byte(LINEAR_OF_BYTE[usize::from(byte)]) == byte));
        for i in 0..=100_000 {
            let linear = i as f32 / 100_000.0;
            assert_eq!(usize::from(srgb_byte(linear)), LEAST_OF_NEXT.partition_point(|&least| least <= linear));
        }
        assert_eq!((srgb_byte(-1.0), srgb_byte(f32::NAN), srgb_byte(2.0)), (0, 0, 255));
    }
}
