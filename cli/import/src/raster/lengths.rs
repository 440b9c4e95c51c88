//! Units of length: as EPSG numbers them, and as files name them.

/// Metres in a US survey foot.
pub(super) const US_FOOT: f64 = 1200.0 / 3937.0;

/// Two units are the same if they differ by this share: texts round their factors.
const SAME: f64 = 1e-9;
/// No unit of a map is shorter or longer, in metres.
const RANGE: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

/// Units by their EPSG code, with metres in each.
const CODES: [(u16, f64); 45] = [
    (9001, 1.0),
    (9002, 0.3048),
    (9003, US_FOOT),
    (9005, 0.304_797_265_4),
    (9014, 1.8288),
    (9030, 1852.0),
    (9031, 1.000_013_596_5),
    (9033, 66.0 * US_FOOT),
    (9034, 0.66 * US_FOOT),
    (9035, 5280.0 * US_FOOT),
    (9036, 1000.0),
    (9037, 0.914_391_796_2),
    (9038, 20.116_619_516_4),
    (9039, 0.201_166_195_164),
    (9040, 0.914_398_414_616_029),
    (9041, 0.304_799_471_538_676),
    (9042, 20.116_765_121_552_6),
    (9043, 0.201_167_651_215_526),
    (9050, 0.914_399_2),
    (9051, 0.304_799_733_333_333),
    (9052, 20.116_782_4),
    (9053, 0.201_167_824),
    (9060, 0.914_399_204_289_812),
    (9061, 0.304_799_734_763_271),
    (9062, 20.116_782_494_375_9),
    (9063, 0.201_167_824_943_759),
    (9070, 0.304_800_833_333_333),
    (9080, 0.304_799_510_248_147),
    (9081, 0.304_798_41),
    (9082, 0.304_799_6),
    (9083, 0.304_799_5),
    (9084, 0.914_398_530_744_441),
    (9085, 0.914_395_23),
    (9086, 0.914_398_8),
    (9087, 0.914_398_5),
    (9093, 1609.344),
    (9094, 0.304_799_710_181_509),
    (9095, 0.304_800_749_1),
    (9096, 0.9144),
    (9097, 20.1168),
    (9098, 0.201_168),
    (9099, 0.914_398),
    (9300, 0.304_799_333_333_333),
    (9301, 20.116_756),
    (9302, 0.201_167_56),
];

/// Names of units as programs write them, in small letters and without what is no letter.
const NAMES: [(&str, f64); 30] = [
    ("m", 1.0),
    ("meter", 1.0),
    ("meters", 1.0),
    ("metre", 1.0),
    ("metres", 1.0),
    ("dm", 0.1),
    ("decimeter", 0.1),
    ("decimetre", 0.1),
    ("cm", 0.01),
    ("centimeter", 0.01),
    ("centimetre", 0.01),
    ("mm", 0.001),
    ("millimeter", 0.001),
    ("millimetre", 0.001),
    ("km", 1000.0),
    ("kilometer", 1000.0),
    ("kilometre", 1000.0),
    ("ft", 0.3048),
    ("foot", 0.3048),
    ("feet", 0.3048),
    ("internationalfoot", 0.3048),
    ("internationalfeet", 0.3048),
    ("footinternational", 0.3048),
    ("ussurveyfoot", US_FOOT),
    ("ussurveyfeet", US_FOOT),
    ("footus", US_FOOT),
    ("ftus", US_FOOT),
    ("usft", US_FOOT),
    ("fathom", 1.8288),
    ("yd", 0.9144),
];

/// Metres in a unit that EPSG numbers.
pub(super) fn of_code(code: u16) -> Option<f64> {
    CODES.iter().find(|(known, _)| *known == code).map(|&(_, metres)| metres)
}

/// The EPSG code of a unit, given its length in metres.
pub fn code_of(metres: f64) -> Option<u16> {
    CODES.iter().find(|(_, known)| (metres / known - 1.0).abs() < SAME).map(|&(code, _)| code)
}

/// Metres in a unit that a file names.
pub(super) fn of_name(name: &str) -> Option<f64> {
    let letters: String = name.chars().filter(char::is_ascii_alphabetic).map(|c| c.to_ascii_lowercase()).collect();
    NAMES.iter().find(|(known, _)| *known == letters).map(|&(_, metres)| metres)
}

/// A factor as a file writes it: none if no unit has it, and the exact one where the text has rounded a known unit.
pub(super) fn of_factor(metres: f64) -> Option<f64> {
    let is_possible = RANGE.contains(&metres);
    is_possible.then(|| code_of(metres).and_then(of_code).unwrap_or(metres))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_known_by_code_name_and_factor() {
        for (code, metres) in CODES {
            assert_eq!((of_code(code), code_of(metres)), (Some(metres), Some(code)));
        }
        assert_eq!(of_factor(0.304_800_609_601_219), Some(US_FOOT));
        assert_eq!(of_factor(0.304_8), Some(0.3048));
        assert_eq!(of_factor(0.25), Some(0.25));
        for name in ["US survey foot", "us-ft", "Foot_US", "ftUS"] {
            assert_eq!(of_name(name), Some(US_FOOT), "{name}");
        }
        assert_eq!((of_name("Foot"), of_name("[ft]"), of_name("m/s")), (Some(0.3048), Some(0.3048), None));
        for absurd in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e300, 1e-300] {
            assert_eq!(of_factor(absurd), None, "{absurd}");
        }
    }
}
