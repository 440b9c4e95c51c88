//! What is read of a JPEG beside its decoder.

use std::io;

use super::EncodedImage;

/// The marker of tables of quantisation.
const TABLES: u8 = 0xDB;
/// The marker of a scan.
const SCAN: u8 = 0xDA;
/// That of the end.
const END: u8 = 0xD9;

/// Reads the markers before the first scan and what stands behind them, until `is_wanted` says that one of them is
/// enough: returns that one. None of what is no JPEG.
fn find_marker(encoded: &mut impl EncodedImage, is_wanted: impl Fn(u8) -> bool) -> io::Result<Option<u8>> {
    let mut two = [0; 2];
    encoded.read_exact(&mut two)?;
    if two != [0xFF, 0xD8] {
        return Ok(None);
    }
    loop {
        encoded.read_exact(&mut two)?;
        let [0xFF, marker] = two else { return Ok(None) };
        if is_wanted(marker) {
            return Ok(Some(marker));
        }
        encoded.read_exact(&mut two)?;
        encoded.seek_relative(i64::from(u16::from_be_bytes(two)).max(2) - 2)?;
    }
}

/// Whether a marker is that of a frame: 0xC0 to 0xCF, but for three of tables.
fn is_frame(marker: u8) -> bool {
    (0xC0..=0xCF).contains(&marker) && ![0xC4, 0xC8, 0xCC].contains(&marker)
}

/// Whether the first frame of a JPEG is progressive.
pub(super) fn is_progressive(encoded: &mut impl EncodedImage) -> io::Result<bool> {
    Ok(find_marker(encoded, is_frame)?.is_some_and(|marker| marker & 3 == 2))
}

/// Columns and rows of the first frame of a JPEG.
pub(super) fn frame_size(encoded: &mut impl EncodedImage) -> io::Result<Option<[u32; 2]>> {
    if find_marker(encoded, is_frame)?.is_none() {
        return Ok(None);
    }
    // Two bytes of length and one of depth come first.
    let mut frame = [0; 7];
    encoded.read_exact(&mut frame)?;
    let [_, _, _, a, b, c, d] = frame;
    Ok(Some([u16::from_be_bytes([c, d]), u16::from_be_bytes([a, b])].map(u32::from)))
}

/// How many of the lowest frequencies say how much a table of quantisation loses: most of what images have.
const LOWEST: usize = 10;

/// The root mean square of the steps by which a JPEG has quantised the lowest frequencies of its first table, that of
/// brightness; none of what is no JPEG, or has no table.
pub(super) fn brightness_step(encoded: &mut impl EncodedImage) -> io::Result<Option<f64>> {
    if find_marker(encoded, |marker| [TABLES, SCAN].contains(&marker))? != Some(TABLES) {
        return Ok(None);
    }
    // Two bytes of length and one of precision come first; frequencies follow from low to high.
    let mut start = [0; 3];
    encoded.read_exact(&mut start)?;
    let is_wide = start[2] >> 4 > 0;
    let mut bytes = [0; 2 * LOWEST];
    let bytes = &mut bytes[..LOWEST * if is_wide { 2 } else { 1 }];
    encoded.read_exact(bytes)?;
    let square = |step: u16| f64::from(step) * f64::from(step);
    let sum: f64 = match is_wide {
        true => bytes.as_chunks().0.iter().map(|&pair| square(u16::from_be_bytes(pair))).sum(),
        false => bytes.iter().map(|&step| square(step.into())).sum(),
    };
    Ok(Some((sum / LOWEST as f64).sqrt()))
}

/// Whether something is a JPEG without the marker of its end: its decoder fills what is missing with grey, and says
/// nothing.
pub(super) fn is_cut(encoded: &mut impl EncodedImage) -> io::Result<bool> {
    if find_marker(encoded, |marker| marker == SCAN)?.is_none() {
        return Ok(false);
    }
    let mut before = 0;
    loop {
        let bytes = encoded.fill_buf()?;
        let Some(&last) = bytes.last() else { return Ok(true) };
        if (before, bytes[0]) == (0xFF, END) || bytes.windows(2).any(|two| two == [0xFF, END]) {
            return Ok(false);
        }
        before = last;
        let length = bytes.len();
        encoded.consume(length);
    }
}
