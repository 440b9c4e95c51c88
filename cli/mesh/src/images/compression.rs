//! Which compression an EXR or a TIFF has, where that is the reason that it cannot be read: their decoders name it by
//! its number, or not at all.

use std::io::{self, BufRead, Read, Seek};

use tiff::decoder::Decoder;
use tiff::tags::{CompressionMethod, Tag};

/// The longest header that is looked at.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// The name of the compression of an EXR, if its decoder does not have it. None of what is no EXR.
///
/// # Errors
/// If it cannot be read.
pub fn unread_exr_compression(encoded: impl BufRead) -> io::Result<Option<String>> {
    let mut encoded = encoded.take(MAX_HEADER_BYTES);
    let mut start = [0; 8];
    encoded.read_exact(&mut start)?;
    if start[..4] != [0x76, 0x2f, 0x31, 1] {
        return Ok(None);
    }
    // Attributes have a name, a kind, the size of their value in bytes, and the value; the last one has no name.
    loop {
        let (name, _kind) = (word(&mut encoded)?, word(&mut encoded)?);
        let mut length = [0; 4];
        encoded.read_exact(&mut length)?;
        let length = u64::from(u32::from_le_bytes(length));
        if name.is_empty() {
            return Ok(None);
        }
        if name == b"compression" {
            let mut number = [0];
            encoded.read_exact(&mut number)?;
            return Ok(unread_name(number[0]));
        }
        io::copy(&mut (&mut encoded).take(length), &mut io::sink())?;
    }
}

/// The name of a compression by its number, if the decoder does not have it (OpenEXR 3.5, `ImfCompression.h`).
fn unread_name(number: u8) -> Option<String> {
    Some(match number {
        0..=9 => return None,
        10 => "HTJ2K (256 lines)".into(),
        11 => "HTJ2K (32 lines)".into(),
        12 => "LJ2K".into(),
        13 => "ZSTD".into(),
        other => format!("number {other}"),
    })
}

/// The name of the compression of a TIFF, if its decoder does not have it. None of what is no TIFF.
pub(super) fn unread_tiff_compression(encoded: impl Read + Seek) -> Option<String> {
    let number = Decoder::new(encoded).ok()?.find_tag_unsigned::<u16>(Tag::Compression).ok()??;
    match CompressionMethod::from_u16_exhaustive(number) {
        CompressionMethod::None
        | CompressionMethod::Fax4
        | CompressionMethod::LZW
        | CompressionMethod::ModernJPEG
        | CompressionMethod::Deflate
        | CompressionMethod::OldDeflate
        | CompressionMethod::PackBits
        | CompressionMethod::ZSTD
        | CompressionMethod::WebP => None,
        method => Some(tiff_compression_name(method)),
    }
}

/// What people call a compression of TIFF, with its number.
pub fn tiff_compression_name(method: CompressionMethod) -> String {
    let number = method.to_u16();
    let name = match number {
        2..=4 => "CCITT",
        6 => "JPEG of TIFF 6.0",
        33003 | 33005 | 34712 => "JPEG 2000",
        34887 => "LERC",
        34925 => "LZMA",
        50002 | 52546 => "JPEG XL",
        _ => return format!("number {number}"),
    };
    format!("{name} ({number})")
}

/// The bytes before the next zero.
fn word(encoded: &mut impl BufRead) -> io::Result<Vec<u8>> {
    let mut word = vec![];
    encoded.read_until(0, &mut word)?;
    match word.pop() {
        Some(0) => Ok(word),
        _ => Err(io::ErrorKind::UnexpectedEof.into()),
    }
}
