use super::*;
use crate::codec::{
    entropy::Replay,
    vector::{dot, sub, to_f64},
};

const SHIFT: u8 = 3;
const ENDS: [LatticePoint; 2] = [[0, 0, 0], [40_000, 0, 5000]];

/// A wavy curve between the ends whose samples appear irregularly over four levels.
fn wanted() -> Vec<WantedSample> {
    let mut level_of = std::collections::BTreeMap::new();
    fn split(level_of: &mut std::collections::BTreeMap<u32, u8>, a: u32, b: u32, level: u8) {
        let middle = (a + b) / 2;
        let level = level + ((middle / 64) % 7 / 4) as u8;
        if level > 3 || b - a < 512 || (middle / 512) % 5 == 1 && b - a < 8192 {
            return;
        }
        level_of.insert(middle, level);
        split(level_of, a, middle, level);
        split(level_of, middle, b, level);
    }
    split(&mut level_of, 0, PARAM_END, 0);
    let curve = |param: u32| {
        let t = f64::from(param) / f64::from(PARAM_END);
        let bump = t * (1.0 - t);
        [40_000.0 * t + 900.0 * bump, 7000.0 * bump * (2.0 - 3.0 * t), 5000.0 * t * t]
    };
    level_of.into_iter().map(|(param, level)| WantedSample { param, level, position: curve(param) }).collect()
}

#[test]
fn quantised_samples_are_close_and_decode_bit_for_bit() {
    let wanted = wanted();
    assert!(wanted.len() > 30 && (0..4).all(|level| wanted.iter().any(|sample| sample.level == level)));
    let samples = quantise_arc(ENDS, &wanted, SHIFT).unwrap();
    for (sample, wanted) in samples.iter().zip(&wanted) {
        let off = sub(to_f64(sample.position), wanted.position);
        assert!(dot(off, off).sqrt() <= f64::from(1_u32 << SHIFT) / 2.0 + 2.0);
    }
    let mut encoder = Path::new(ENDS);
    let mut decoder = Path::new(ENDS);
    let mut skipped = Path::skipped();
    let mut repeated = Path::new(ENDS);
    for level in 0..4 {
        let mut symbols = SymbolBuffer::default();
        encoder.encode_level(level, SHIFT, &samples, &mut symbols).unwrap();
        let mut replay = Replay::new(&symbols);
        let count = samples.iter().filter(|sample| sample.level == level).count() as u32;
        let mut skipped_replay = replay.clone();
        decoder.decode_level(level, SHIFT, count, &mut replay).unwrap();
        assert_eq!(encoder, decoder);
        let mut splits = Vec::new();
        let mut recorder = skipped.clone();
        recorder.record_level(level, SHIFT, count, &mut skipped_replay.clone(), &mut splits).unwrap();
        repeated.repeat_level(level, SHIFT, &splits).unwrap();
        assert_eq!(encoder, repeated);
        // Without positions the same symbols are read.
        skipped.decode_level(level, SHIFT, count, &mut skipped_replay).unwrap();
        assert!(skipped_replay.is_at_end() && !skipped.is_placed());
    }
    let decoded: Vec<_> = decoder.samples().iter().map(|knot| (knot.param, knot.level, knot.position)).collect();
    let expected: Vec<_> = samples.iter().map(|sample| (sample.param, sample.level, sample.position)).collect();
    assert_eq!(decoded, expected);
}

#[test]
fn more_samples_than_the_symbols_have_are_an_error() {
    let samples = quantise_arc(ENDS, &wanted(), SHIFT).unwrap();
    let mut symbols = SymbolBuffer::default();
    Path::new(ENDS).encode_level(0, SHIFT, &samples, &mut symbols).unwrap();
    let count = samples.iter().filter(|sample| sample.level == 0).count() as u32;
    assert!(Path::new(ENDS).decode_level(0, SHIFT, count + 1, &mut Replay::new(&symbols)).is_err());
}

#[test]
fn samples_that_are_not_nested_are_refused() {
    let sample = |param, level| WantedSample { param, level, position: [0.0; 3] };
    assert!(quantise_arc(ENDS, &[sample(1 << 14, 0)], SHIFT).is_err());
    assert!(quantise_arc(ENDS, &[sample(1 << 14, 0), sample(1 << 15, 1)], SHIFT).is_err());
    assert!(quantise_arc(ENDS, &[sample(1 << 15, 0), sample(1 << 15, 0)], SHIFT).is_err());
    assert!(quantise_arc(ENDS, &[sample(1 << 15, 2)], SHIFT).is_ok());
}

#[test]
fn arcs_between_coinciding_corners_and_of_full_depth_survive() {
    let all: Vec<_> = (1..PARAM_END)
        .map(|param| WantedSample { param, level: 1, position: [f64::from(param % 977), 0.0, 1.0] })
        .collect();
    let ends = [[5, 5, 5]; 2];
    let samples = quantise_arc(ends, &all, 0).unwrap();
    let mut symbols = SymbolBuffer::default();
    let mut encoder = Path::new(ends);
    encoder.encode_level(0, 0, &samples, &mut symbols).unwrap();
    encoder.encode_level(1, 0, &samples, &mut symbols).unwrap();
    let mut replay = Replay::new(&symbols);
    let mut decoder = Path::new(ends);
    decoder.decode_level(0, 0, 0, &mut replay).unwrap();
    decoder.decode_level(1, 0, PARAM_END - 1, &mut replay).unwrap();
    assert_eq!(encoder, decoder);
}

#[test]
fn corners_survive_and_far_ones_are_refused() {
    let mut symbols = SymbolBuffer::default();
    encode_corner([-(1 << 40), 7, 1 << 40], [1 << 40, 0, -3], &mut symbols);
    assert_eq!(decode_corner([1 << 40, 0, -3], &mut Replay::new(&symbols)).unwrap(), [-(1 << 40), 7, 1 << 40]);
    assert!(decode_corner([-1, 0, -3], &mut Replay::new(&symbols)).is_err());
}
