use super::super::{encode_image, image::Image};
use super::SCALES;

/// A picture with edges and gradients.
fn picture(size: [u32; 2], components: u8) -> Image<u8> {
    let mut image = Image { size, components, data: vec![] };
    for y in 0..size[1] {
        for x in 0..size[0] {
            let inside = (x / 13 + y / 9) % 3 == 0;
            let texel = [x * 2 + y, y * 3, if inside { 200 } else { 30 + x % 7 }, 255 - x / 2];
            image.data.extend(texel[..usize::from(components)].iter().map(|&value| value.min(255) as u8));
        }
    }
    image
}

fn error(a: &Image<u8>, b: &Image<u8>, is_used: &[bool]) -> f64 {
    let count = usize::from(a.components);
    let pairs = a.data.chunks(count).zip(b.data.chunks(count)).zip(is_used).filter(|&(_, &used)| used);
    let squares: Vec<f64> =
        pairs.flat_map(|((a, b), _)| a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn images_come_back_within_their_step() {
    for size in [[1, 1], [7, 3], [8, 8], [64, 50], [100, 9], [3, 200]] {
        for components in 1..=4 {
            let image = picture(size, components);
            let used = vec![true; image.data.len() / usize::from(components)];
            for step in [1, 6, 20, 255] {
                let streams = encode_image(&image, &used, step);
                let back = Image::decode_scaled(&streams, size, components).unwrap();
                assert_eq!((back.size, back.components, back.data.len()), (size, components, image.data.len()));
                let error = error(&image, &back, &used);
                assert!(error <= 1.0 + 0.6 * f64::from(step), "{size:?} {components} {step}: {error}");
            }
        }
    }
}

#[test]
fn an_even_image_has_a_step_that_shows_it() {
    // Nearly one colour, of which the usual step would show another blue.
    let mut image = Image::filled([256, 256], &[26, 26, 28]);
    (0..60).for_each(|k| image.data[k * 37] = 27);
    let used = vec![true; 256 * 256];
    for step in [9, 12, 15] {
        let streams = encode_image(&image, &used, step);
        let found = streams[0][0];
        assert!((step.div_ceil(2)..=step).contains(&found), "{found}");
        let back = Image::decode_scaled(&streams, image.size, 3).unwrap();
        let error = error(&image, &back, &used);
        assert!(error < 1.0, "{step} {found}: {error}");
    }
    // One that is not even keeps its step.
    let image = picture([256, 256], 3);
    assert_eq!(encode_image(&image, &used, 9)[0][0], 9);
}

#[test]
fn what_is_not_used_costs_little() {
    let image = picture([128, 128], 3);
    let all = vec![true; 128 * 128];
    let half: Vec<bool> = (0..128 * 128).map(|k| k % 128 < 64).collect();
    let [all, half] = [all, half].map(|used| encode_image(&image, &used, 8).concat().len());
    assert!((half as f64) < 0.56 * all as f64, "{half} {all}");
    let none = vec![false; 128 * 128];
    assert_eq!(encode_image(&image, &none, 8).concat().len(), 4);
}

#[test]
fn smaller_images_are_means_of_larger_ones() {
    for size in [[64, 64], [37, 50], [9, 8], [1, 1], [3, 200]] {
        let image = picture(size, 3);
        let used = vec![true; image.data.len() / 3];
        let streams = encode_image(&image, &used, 4);
        let whole = Image::decode_scaled(&streams, size, 3).unwrap();
        for scales in 1..SCALES {
            let smaller = Image::decode_scaled(&streams[..scales], size, 3).unwrap();
            let side = 1 << (SCALES - scales);
            assert_eq!(smaller.size, size.map(|length: u32| length.div_ceil(side)));
            // Where all texels of a square are there; at an edge a block goes on beyond it.
            let [columns, rows] = size.map(|length| length / side);
            let (mut squares, mut count) = (0.0, 0.0);
            for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
                for k in 0..3 {
                    let all = (0..side * side).map(|at| whole.texel(x * side + at % side, y * side + at / side)[k]);
                    let mean = all.map(f64::from).sum::<f64>() / f64::from(side * side);
                    squares += (mean - f64::from(smaller.texel(x, y)[k])).powi(2);
                    count += 1.0;
                }
            }
            // What a band has of frequencies above those of a smaller image differs from means.
            assert!(count == 0.0 || squares < 36.0 * count, "{size:?} {scales} {}", squares / count);
        }
    }
}

#[test]
fn scales_that_add_nothing_are_empty_and_lies_are_refused() {
    // Brightness that differs from block to block, and not within.
    let mut image = Image::filled([64, 32], &[0; 3]);
    for (at, texel) in image.data.chunks_exact_mut(3).enumerate() {
        texel.fill((at % 64 / 8 * 20 + at / 512 * 13) as u8);
    }
    let streams = encode_image(&image, &[true; 2048], 8);
    assert_eq!([1, 2, 3].map(|scale| streams[scale].len()), [0; 3]);
    let all: [&[u8]; 4] = [&streams[0], &[], &[], &[]];
    for scales in 1..=SCALES {
        assert!(Image::decode_scaled(&all[..scales], image.size, 3).is_ok());
    }
    // Bytes where none belong, too many streams, none, and a finer scale of an image of one colour.
    let with = |scale: usize, bytes: &'static [u8]| {
        let mut changed = all.to_vec();
        changed[scale] = bytes;
        Image::decode_scaled(&changed, image.size, 3)
    };
    assert!(with(0, &[]).is_err() && with(0, &[0, 1, 2]).is_err());
    assert!(with(0, &[0, 1, 2, 3]).is_ok_and(|even| even.texel(63, 31) == [1, 2, 3]));
    let mut even: [&[u8]; 5] = [&[0, 1, 2, 3], &[], &[], &[1], &[]];
    assert!(Image::decode_scaled(&even[..4], image.size, 3).is_err());
    even[3] = &[];
    assert!(Image::decode_scaled(&even, image.size, 3).is_err());
    assert!(Image::decode_scaled::<&[u8]>(&[], image.size, 3).is_err());
    assert!(with(2, &[0xff; 64]).is_err());
}

#[test]
fn damaged_images_are_refused_or_decoded_but_never_panic() {
    let image = picture([60, 40], 4);
    let streams = encode_image(&image, &[true; 2400], 10);
    for scale in 0..SCALES {
        for at in 0..streams[scale].len() {
            for flip in [1, 0x80, 0xff] {
                let mut damaged = streams.clone();
                damaged[scale][at] ^= flip;
                let _ = Image::decode_scaled(&damaged, [60, 40], 4);
            }
            let mut shorter = streams.clone();
            shorter[scale].truncate(at);
            let _ = Image::decode_scaled(&shorter, [60, 40], 4);
        }
    }
    assert!(Image::decode_scaled(&[[1]], [u32::MAX, u32::MAX], 4).is_err());
    // A few bytes never make a large image.
    assert!(Image::decode_scaled(&[[1, 255, 255]], [16384, 16384], 4).is_err());
}
