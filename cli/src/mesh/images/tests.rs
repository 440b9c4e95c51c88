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
