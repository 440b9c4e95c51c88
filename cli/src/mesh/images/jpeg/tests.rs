use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb};

use super::*;

/// Something like noise, which fills blocks.
fn jpeg(is_grey: bool) -> Vec<u8> {
    let value = |x: u32, y: u32| (x * x * 7 + y * 13 + x * y) as u8;
    let image: DynamicImage = match is_grey {
        true => ImageBuffer::from_fn(83, 61, |x, y| Luma([value(x, y)])).into(),
        false => ImageBuffer::from_fn(83, 61, |x, y| Rgb([value(x, y), value(y, x), 9])).into(),
    };
    let mut bytes = std::io::Cursor::new(vec![]);
    image.write_to(&mut bytes, ImageFormat::Jpeg).unwrap();
    bytes.into_inner()
}

/// The place of the first scan's bits.
fn start_of_scan(bytes: &[u8]) -> usize {
    let at = bytes.windows(2).position(|two| two == [0xFF, 0xDA]).unwrap() + 2;
    at + usize::from(u16::from_be_bytes([bytes[at], bytes[at + 1]]))
}

#[test]
fn what_is_complete_is_sound_even_without_its_end() {
    for bytes in [jpeg(true), jpeg(false), digits(PROGRESSIVE)] {
        assert_eq!(check_jpeg(&bytes), Ok(()));
        assert_eq!(check_jpeg(&bytes[..bytes.len() - 2]), Ok(()));
        assert_eq!(check_jpeg(&[&bytes[..], &[7; 99]].concat()), Ok(()));
        assert_eq!(check_jpeg(&[&bytes[..bytes.len() - 2], &[0; 3]].concat()), Ok(()));
    }
}

#[test]
fn what_is_cut_anywhere_ends_too_early() {
    for bytes in [jpeg(true), jpeg(false), digits(PROGRESSIVE)] {
        for end in start_of_scan(&bytes)..bytes.len() - 3 {
            assert_eq!(check_jpeg(&bytes[..end]), Err(SHORT), "{end} of {}", bytes.len());
        }
    }
}

#[test]
fn overwritten_data_are_found_unless_they_hold_as_many_blocks() {
    for is_grey in [true, false] {
        let bytes = jpeg(is_grey);
        let places: Vec<usize> = (start_of_scan(&bytes)..bytes.len() - 300).step_by(97).collect();
        let is_found = |at: &&usize| {
            let mut damaged = bytes.clone();
            damaged[**at..**at + 200].fill(0x55);
            check_jpeg(&damaged).is_err()
        };
        let found = places.iter().filter(is_found).count();
        assert!(4 * found > 3 * places.len(), "{found} of {}", places.len());
    }
}

#[test]
fn an_image_without_a_bit_for_each_block_is_cut() {
    let mut bytes = jpeg(false);
    let frame = bytes.windows(2).position(|two| two == [0xFF, 0xC0]).unwrap();
    bytes[frame + 5..frame + 9].copy_from_slice(&[0x3E, 0x80, 0x3E, 0x80]);
    assert_eq!(check_jpeg(&bytes), Err(SHORT));
}

#[test]
fn any_bytes_are_read_without_panic() {
    for bytes in [jpeg(true), jpeg(false), digits(PROGRESSIVE), digits(RESTARTED)] {
        for at in 0..bytes.len().min(900) {
            for value in [0, 0xFF, bytes[at] ^ 1, bytes[at] ^ 0x10] {
                let mut damaged = bytes.clone();
                damaged[at] = value;
                let _ = check_jpeg(&damaged);
            }
        }
        for end in 0..bytes.len() {
            let _ = check_jpeg(&bytes[..end]);
        }
    }
}

#[test]
fn intervals_between_restarts_are_checked_each() {
    let bytes = digits(RESTARTED);
    assert_eq!(check_jpeg(&bytes), Ok(()));
    let restart = start_of_scan(&bytes);
    let restart = restart + bytes[restart..].windows(2).position(|two| two == [0xFF, 0xD0]).unwrap();
    let mut damaged = bytes.clone();
    damaged.splice(restart..restart, [0x5A; 9]);
    assert_eq!(check_jpeg(&damaged), Err(BROKEN));
    damaged = bytes;
    damaged.drain(restart - 3..restart);
    assert_eq!(check_jpeg(&damaged), Err(SHORT));
}

fn digits(text: &str) -> Vec<u8> {
    let digits: Vec<_> = text.chars().filter_map(|digit| digit.to_digit(16)).collect();
    digits.chunks(2).map(|pair| (pair[0] * 16 + pair[1]) as u8).collect()
}

/// 24 x 20 texels of three components in ten scans.
const PROGRESSIVE: &str = "ffd8ffe000104a46494600010100000100010000ffdb004300140e0f120f0d14121012171514181e32211e1c1c1e3d2c2e243249404c4b47 \
     404645505a736250556d5645466488656d777b8182814e608d978c7d96737e817cffdb0043011517171e1a1e3b21213b7c5346537c7c7c7c \
     7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7c7cffc20011080014001803 \
     012200021101031101ffc4001800010101010100000000000000000000000003040102ffc400170100030100000000000000000000000000 \
     00020304ffda000c03010002100310000001c3aa9e723d102a76e04052dfffc4001b10000203010101000000000000000000000102001112 \
     032122ffda000801010001050245f00b8b2824d813e9a646828ae9d083ffc4001c1101000201050000000000000000000000010002031121 \
     313281ffda0008010301013f015d76215ad7bb323cfb1a93ffc400191100020301000000000000000000000000000102111231ffda000801 \
     0201013f0172d70cd9220951ffc4001b10000203000300000000000000000000000001101121223141ffda0008010100063f028df0d38ab3 \
     470d2aecffc4001b100003000301010000000000000000000000011121314151a1ffda0008010100013f2180e4f0ac2d03595a5d1cc98df3 \
     43cdc78b42d470a842249b0fffda000c03010002000300000010fbf0fcffc4001a1101010002030000000000000000000000010011214161 \
     91ffda0008010301013f104d1ea339bd933b46b942ffc4001911010101000300000000000000000000000100112131b1ffda000801020101 \
     3f104e42cf664f92b697ffc4001f10010002020202030000000000000000000100112131415171816191b1ffda0008010100013f1044e150 \
     f39951ca94a57ce3f65a30335b8d7729192f37281c1cc5c0680a56541ef70ba5405aabdbbd731a2e953ea1d4111dfb610629459a17bf13ff \
     d9";

/// The same texels in one scan, with a restart marker after every two units.
const RESTARTED: &str = "ffd8ffe000104a46494600010100000100010000ffdb00430050373c463c32504641465a55505f78c882786e6e78f5afb991c8ffffffffff \
     ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffdb004301555a5a786978eb8282ebffffffffffffffff \
     ffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffffc00011080014001803 \
     012200021101031101ffc40017000101010100000000000000000000000000020301ffc4001e100002020202030000000000000000000000 \
     01021103122131415171ffc40017010003010000000000000000000000000001020300ffc4001b1101010002030100000000000000000000 \
     01000211213251d1ffdd00040002ffda000c03010002110311003f00c211e0d62afa29c630ad9a5e4e3c9154a29b649771df9546f84fa408 \
     7bcaefaf48035000ecdfffd09505b3f85a82a60116d97da3264926e2a9734001b1389d0bffd9";
