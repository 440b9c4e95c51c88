use super::*;

fn of_format(image: &DynamicImage, format: ImageFormat) -> u64 {
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, format).unwrap();
    bytes.rewind().unwrap();
    let encoded = bytes.get_ref().len() as u64;
    decoding_bytes(bytes).unwrap().saturating_sub(encoded)
}

#[test]
fn what_is_decoded_as_a_whole_is_counted_by_format() {
    let image = DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(40, 30, image::Rgb([1, 2, 3])));
    assert_eq!(of_format(&image, ImageFormat::Png), 0);
    assert_eq!(of_format(&image.to_rgba16().into(), ImageFormat::Png), 0);
    assert_eq!(of_format(&image, ImageFormat::Jpeg), 3 * 1200);
    assert_eq!(of_format(&image.to_rgba8().into(), ImageFormat::Tiff), 8 * 1200);
    assert_eq!(of_format(&image.to_rgb16().into(), ImageFormat::Tiff), 16 * 1200);
}

#[test]
fn images_of_one_colour_are_found_in_every_format() {
    let only = |image: &DynamicImage, format: ImageFormat| {
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).unwrap();
        bytes.rewind().unwrap();
        only_colour(bytes, [0..image.width(), 0..image.height()], u64::MAX).unwrap()
    };
    let mut image = image::RgbaImage::from_pixel(90, 70, image::Rgba([40, 80, 120, 160]));
    let fine = [40, 80, 120, 160].map(|value| 257 * value);
    let opaque = [fine[0], fine[1], fine[2], u16::MAX];
    let one = DynamicImage::from(image.clone());
    assert_eq!(only(&one, ImageFormat::Png), Some(fine));
    assert_eq!(only(&one.to_rgba16().into(), ImageFormat::Png), Some(fine));
    assert_eq!(only(&one.to_rgb8().into(), ImageFormat::Png), Some(opaque));
    assert_eq!(only(&one.to_rgb8().into(), ImageFormat::WebP), Some(opaque));
    let grey = DynamicImage::ImageLuma8(image::GrayImage::from_pixel(300, 200, image::Luma([77])));
    assert_eq!(only(&grey, ImageFormat::Png), Some([77 * 257, 77 * 257, 77 * 257, u16::MAX]));
    assert_eq!(only(&grey, ImageFormat::Jpeg), Some([77 * 257, 77 * 257, 77 * 257, u16::MAX]));
    image[(89, 69)].0[3] = 161;
    let other = DynamicImage::from(image);
    for format in [ImageFormat::Png, ImageFormat::WebP] {
        assert_eq!(only(&other, format), None);
        // The rest of it is all alike.
        let mut bytes = Cursor::new(vec![]);
        other.write_to(&mut bytes, format).unwrap();
        bytes.rewind().unwrap();
        assert_eq!(only_colour(bytes, [0..90, 5..69], u64::MAX), Ok(Some(fine)));
    }
}

#[test]
fn images_of_more_than_8_bits_are_told_by_their_header() {
    let image = DynamicImage::ImageRgb8(image::ImageBuffer::from_pixel(4, 3, image::Rgb([1, 2, 3])));
    let is_finer = |image: DynamicImage, format: ImageFormat| {
        let mut bytes = Cursor::new(vec![]);
        image.write_to(&mut bytes, format).unwrap();
        bytes.rewind().unwrap();
        is_finer_than_bytes(bytes)
    };
    for format in [ImageFormat::Png, ImageFormat::Tiff, ImageFormat::Jpeg, ImageFormat::WebP] {
        assert_eq!(is_finer(image.clone(), format), Ok(false));
    }
    for format in [ImageFormat::Png, ImageFormat::Tiff] {
        assert_eq!(is_finer(image.to_rgb16().into(), format), Ok(true));
        assert_eq!(is_finer(image.to_luma16().into(), format), Ok(true));
    }
    assert_eq!(is_finer(image.to_rgb32f().into(), ImageFormat::OpenExr), Ok(true));
}

/// Something that has many colours.
fn encoded(format: ImageFormat) -> Vec<u8> {
    let texel = |x: u32, y: u32| image::Rgb([(x * x * 7 + y * 13) as u8, (x * 9 + y * y) as u8, 9]);
    let image = DynamicImage::ImageRgb8(image::ImageBuffer::from_fn(70, 50, texel));
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// Reads all rows of a PNG.
fn rows(bytes: &[u8]) -> Result<u32, String> {
    let mut rows = rows_of_png(Cursor::new(bytes))?.expect("it is a PNG");
    let (mut row, mut count) = (vec![], 0);
    while rows.next_row(&mut row)? {
        count += 1;
    }
    Ok(count)
}

#[test]
fn checksums_of_pngs_count() {
    let bytes = encoded(ImageFormat::Png);
    assert_eq!(rows(&bytes), Ok(50));
    let data = bytes.windows(4).position(|four| four == b"IDAT").unwrap();
    let length = u32::from_be_bytes(bytes[data - 4..data].try_into().unwrap()) as usize;
    let checksum = data + 4 + length;
    let mut damaged = bytes.clone();
    damaged[checksum] ^= 1;
    let problem = rows(&damaged).unwrap_err();
    assert!(problem.contains("it is damaged (CRC error") && problem.contains("export it again"), "{problem}");
    // The checksum of the rows themselves, under one of the chunk that fits.
    damaged = bytes.clone();
    damaged[checksum - 1] ^= 1;
    let fitting = crc32fast::hash(&damaged[data..checksum]).to_be_bytes();
    damaged[checksum..checksum + 4].copy_from_slice(&fitting);
    assert!(rows(&damaged).unwrap_err().contains("it is damaged"));
    // All rows are there, and nothing says that they are wrong.
    assert_eq!(rows(&bytes[..checksum]), Ok(50));
    assert_eq!(rows(&bytes[..checksum + 4]), Ok(50));
    assert!(rows(&bytes[..bytes.len() / 2]).unwrap_err().contains("it is damaged (unexpected end of file)"));
}

#[test]
fn a_jpeg_that_is_cut_or_cannot_hold_its_texels_is_damaged() {
    let bytes = encoded(ImageFormat::Jpeg);
    assert!(decode_image(Cursor::new(&bytes)).is_ok());
    let problem = decode_image(Cursor::new(&bytes[..bytes.len() / 2])).unwrap_err();
    assert_eq!(problem, "it is damaged (its data end too early): copy or export it again");
    let mut large = bytes;
    let frame = large.windows(2).position(|two| two == [0xFF, 0xC0]).unwrap();
    large[frame + 5..frame + 9].copy_from_slice(&[0x3E, 0x80, 0x3E, 0x80]);
    let problem = image_size(Cursor::new(&large)).unwrap_err();
    assert!(problem.contains("bytes cannot hold 16000 x 16000 texels"), "{problem}");
}

#[test]
fn formats_that_are_not_read_are_named_with_those_that_are() {
    for (start, expected) in [
        (&b"GIF89a\x01\0\x01\0"[..], "its format (Gif) is not read"),
        (b"BM", "its format (Bmp) is not read"),
        (b"noise", "its format is unknown"),
    ] {
        let problem = image_size(Cursor::new(start)).unwrap_err();
        assert_eq!(problem, format!("{expected}: convert it to PNG, JPEG, WebP, TIFF or EXR"));
    }
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP, ImageFormat::Tiff] {
        let bytes = encoded(format);
        for end in 0..bytes.len().min(700) {
            let problem = image_size(Cursor::new(&bytes[..end])).err().unwrap_or_default();
            assert!(!problem.contains('\n'), "{problem}");
        }
    }
}

#[test]
fn a_damaged_exr_ends_in_one_sentence() {
    let image = DynamicImage::ImageRgba32F(image::ImageBuffer::from_pixel(9, 7, image::Rgba([0.25, 1.0, 0.5, 1.0])));
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
    let bytes = bytes.into_inner();
    assert_eq!(decode_image(Cursor::new(&bytes)), Ok(image));
    let problem_of = |bytes: &[u8]| {
        let _ = decoding_bytes(Cursor::new(bytes));
        decode_image(Cursor::new(bytes)).err().unwrap_or_default()
    };
    for place in 0..bytes.len() {
        assert!(!problem_of(&bytes[..place]).contains('\n'), "{place}");
        for change in [1, 0x7F, 0x80, 0xFF] {
            let mut changed = bytes.clone();
            changed[place] ^= change;
            assert!(!problem_of(&changed).contains('\n'), "{place} {change}");
        }
    }
}

#[test]
#[cfg(unix)]
fn only_files_are_opened() {
    for path in ["/dev/zero", "/"] {
        let image = ImageSource::File { path: path.into(), range: None };
        let problem = image.open(None).err().map(|error| unreadable(&error));
        assert!(problem.is_some_and(|problem| problem.contains("not a file: put an image there")), "{path}");
    }
}

#[test]
fn long_names_are_shown_without_their_middle() {
    assert_eq!(shown_name("a\nb\u{e9}.png"), "a b\u{e9}.png");
    let shown = shown_name(&format!("{}\u{e9}{}.png", "a".repeat(500), "b".repeat(500)));
    assert_eq!(shown, format!("{}...{}.png", "a".repeat(100), "b".repeat(96)));
}

#[test]
fn progressive_images_are_told_by_their_frame() {
    let is_progressive = |bytes: &[u8]| jpeg::is_progressive(&mut Cursor::new(bytes)).ok();
    // A comment of two letters, a table, and a frame.
    let with = |frame: u8| [&b"\xFF\xD8\xFF\xFE\0\x04ab\xFF\xC4\0\x02\xFF"[..], &[frame]].concat();
    assert_eq!([0xC0, 0xC1, 0xC2].map(|frame| is_progressive(&with(frame))), [Some(false), Some(false), Some(true)]);
    assert_eq!(is_progressive(b"RIFF"), Some(false));
    assert_eq!(is_progressive(b"\xFF\xD8\xFF"), None);
}

/// A TIFF whose tiles of 64 x 64 texels are JPEG of luma and chroma, in the order of the machine that it is for, with
/// its tables apart or not.
fn ycbcr(image: &image::RgbImage, has_tables: bool, is_big_endian: bool) -> Vec<u8> {
    use lodpack_tests::tiff::{Image, Values, file};
    let (columns, rows) = image.dimensions();
    let (mut pieces, mut tables) = (vec![], vec![]);
    for [x, y] in (0..rows.div_ceil(64)).flat_map(|y| (0..columns.div_ceil(64)).map(move |x| [x, y])) {
        let within = |dx: u32, dy: u32| *image.get_pixel((64 * x + dx).min(columns - 1), (64 * y + dy).min(rows - 1));
        let mut jpeg = vec![];
        image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 95)
            .encode_image(&image::RgbImage::from_fn(64, 64, within))
            .unwrap();
        if has_tables {
            jpeg = without_tables(&jpeg, &mut tables);
        }
        pieces.push(jpeg);
    }
    let tags = Image::grey([columns, rows], 8, 1, vec![]);
    let mut image = Image { pieces, ..tags };
    image.tags.retain(|(tag, _)| !matches!(tag, 278));
    for (tag, values) in [
        (258, Values::Short(vec![8; 3])),
        (259, Values::Short(vec![7])),
        (262, Values::Short(vec![6])),
        (277, Values::Short(vec![3])),
        (339, Values::Short(vec![1; 3])),
        (322, Values::Long(vec![64])),
        (323, Values::Long(vec![64])),
        (530, Values::Short(vec![2, 2])),
    ] {
        image = image.with(tag, values);
    }
    if has_tables {
        image = image.with(347, Values::Bytes(tables));
    }
    file(&[image], is_big_endian)
}

/// A JPEG without its tables, which become a JPEG of nothing else.
fn without_tables(jpeg: &[u8], tables: &mut Vec<u8>) -> Vec<u8> {
    let (mut rest, mut at) = (vec![0xFF, 0xD8], 2);
    *tables = vec![0xFF, 0xD8];
    while jpeg[at + 1] != 0xDA {
        let end = at + 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
        let is_table = matches!(jpeg[at + 1], 0xC4 | 0xDB);
        if is_table { &mut *tables } else { &mut rest }.extend(&jpeg[at..end]);
        at = end;
    }
    tables.extend([0xFF, 0xD9]);
    rest.extend(&jpeg[at..]);
    rest
}

#[test]
fn tiffs_of_luma_and_chroma_have_the_colours_of_their_jpegs() {
    let texel = |x: u32, y: u32| image::Rgb([(x * 2) as u8, (200 - y) as u8, (60 + x / 2 + y / 2) as u8]);
    let image = image::RgbImage::from_fn(100, 70, texel);
    for (has_tables, is_big_endian) in [(false, false), (true, false), (true, true)] {
        let bytes = ycbcr(&image, has_tables, is_big_endian);
        assert_eq!(image_size(Cursor::new(&bytes)), Ok([100, 70]));
        assert_eq!(is_finer_than_bytes(Cursor::new(&bytes)), Ok(false));
        assert_eq!(has_opacity(Cursor::new(&bytes)), Ok(false));
        assert_eq!(decoding_bytes(Cursor::new(&bytes)).unwrap(), bytes.len() as u64 + 6 * 7000);
        let decoded = decode_image(Cursor::new(&bytes)).unwrap().into_rgb8();
        let off = decoded.iter().zip(image.iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off <= Some(8), "{off:?}");
    }
}

#[test]
fn damaged_tiffs_of_luma_and_chroma_are_refused_and_allocate_nothing() {
    let image = image::RgbImage::from_fn(80, 30, |x, y| image::Rgb([x as u8, y as u8, 77]));
    let bytes = ycbcr(&image, true, false);
    for at in 0..bytes.len() {
        for value in [0xFF, bytes[at] ^ 1] {
            let mut damaged = bytes.clone();
            damaged[at] = value;
            // Whatever is said, nothing panics and nothing large is allocated.
            if image_size(Cursor::new(&damaged)).is_ok_and(|size| texels_of(size) < 1 << 20) {
                let _ = decode_image(Cursor::new(&damaged));
            }
        }
    }
    let problem = decode_image(Cursor::new(&bytes[..bytes.len() - 100])).unwrap_err();
    assert!(problem.contains("it is damaged (its data end too early)"), "{problem}");
    // A tile that says it has 65535 x 65535 texels.
    let frame = bytes.windows(2).rposition(|two| two == [0xFF, 0xC0]).unwrap();
    let mut lying = bytes.clone();
    lying[frame + 5..frame + 9].fill(0xFF);
    let problem = decode_image(Cursor::new(&lying)).unwrap_err();
    assert!(problem.contains("declares 65535 x 65535 texels"), "{problem}");
}

#[test]
fn compressions_that_are_not_read_are_named() {
    use lodpack_tests::tiff::{Image, Values, file};
    let image = |number| Image::grey([4, 4], 8, 1, vec![0; 16]).with(259, Values::Short(vec![number]));
    for (number, name) in [(34925, "LZMA (34925)"), (34887, "LERC"), (6, "JPEG of TIFF 6.0"), (1, "")] {
        let bytes = file(&[image(number)], false);
        let problem = image_size(Cursor::new(&bytes)).err().unwrap_or_default();
        assert_eq!(problem.contains(&format!("its compression {name}")), number != 1, "{problem}");
    }
    let mut exr = encoded_exr();
    assert!(image_size(Cursor::new(&exr)).is_ok());
    let at = exr.windows(24).position(|bytes| bytes == b"compression\0compression\0").unwrap() + 28;
    exr[at] = 13;
    assert!(image_size(Cursor::new(&exr)).unwrap_err().contains("its compression ZSTD is not read"));
    for at in 0..exr.len() {
        let _ = unread_exr_compression(&exr[..at]);
    }
}

fn encoded_exr() -> Vec<u8> {
    let image = DynamicImage::ImageRgb32F(image::ImageBuffer::from_pixel(4, 4, image::Rgb([0.5; 3])));
    let mut bytes = Cursor::new(vec![]);
    image.write_to(&mut bytes, ImageFormat::OpenExr).unwrap();
    bytes.into_inner()
}
