//! Writing of images in scales.

use super::super::{
    binary::BitEncoder,
    image::Image,
    loss::{Errors, others_off, weight_of},
    planes::{level_size, planes, step_of},
    seen::Seen,
    transform::{AREA, MOST, SIDE, forward},
};
use super::{SCALES, code::Levels};

/// Colours with a step of quantisation, or with a finer one where that is worth its bytes: the strings of all scales.
pub(in super::super) fn encode(
    image: &Image<u8>,
    is_used: &[bool],
    seen: Option<&Seen<'_>>,
    step: u8,
) -> [Vec<u8>; SCALES] {
    let mut errors = Errors::default();
    let strings = strings_of(quantised(image, is_used, seen, step, &mut errors), step);
    let length = strings.iter().map(Vec::len).sum();
    match errors.better_step(step, usize::from(image.components), length) {
        Some(better) => strings_of(quantised(image, is_used, seen, better, &mut Errors::default()), better),
        None => strings,
    }
}

/// The levels of all blocks.
fn quantised(image: &Image<u8>, is_used: &[bool], seen: Option<&Seen<'_>>, step: u8, errors: &mut Errors) -> Levels {
    let count = usize::from(image.components);
    let mut levels = Levels::new(image.size, count, SIDE);
    for block in 0..levels.columns * levels.rows {
        let first = [block % levels.columns * SIDE, block / levels.columns * SIDE];
        let planes = planes(image, is_used, first);
        levels.push(planes.is_some());
        let (Some(planes), Some(place)) = (planes, levels.place(block)) else { continue };
        let mut seen = seen.and_then(|seen| seen.block(block, first));
        let (mut constants, mut is_even) = ([0.0; 4], true);
        for (component, plane) in planes.iter().enumerate().take(count) {
            let (coefficients, step) = (forward(plane), step_of(component, count, step) as f32);
            let inverse = 1.0 / step;
            constants[component] = coefficients[0];
            errors.others += weight_of(component, count) * others_off(&coefficients, inverse);
            let limit = MOST as f32 * inverse;
            let mut own = coefficients.map(|c| level_size(c, inverse, limit).copysign(c));
            own[0] = (coefficients[0] * inverse).round();
            if let Some(seen) = &mut seen {
                seen.improve(plane, step, &mut own);
            }
            let values = &mut levels.values[place + component * AREA..][..AREA];
            for (at, level) in own.into_iter().enumerate() {
                let level = level.clamp(-limit, limit) as i16;
                values[at % SIDE * SIDE + at / SIDE] = level;
                is_even &= at == 0 || level == 0;
            }
        }
        errors.constants.push((constants, is_even));
    }
    levels
}

/// The strings of all scales. One that says nothing is empty.
fn strings_of(mut levels: Levels, step: u8) -> [Vec<u8>; SCALES] {
    let has_band = levels.bands();
    std::array::from_fn(|scale| {
        let mut bits = BitEncoder::new();
        // What is written is not changed, and breaks no rule.
        let _ = match scale {
            0 => levels.code_means(&mut bits, false),
            _ if !has_band[scale] => return vec![],
            _ => levels.code_band(&mut bits, scale),
        };
        let bytes = bits.finish();
        if scale == 0 { [&[step], bytes.as_slice()].concat() } else { bytes }
    })
}
