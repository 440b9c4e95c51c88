//! Rows of binary numbers beside a text header: ESRI `.bil` and `.flt`, GTOPO30 `.dem`, and raw files with an `.hdr`.

use std::fs::File;
use std::path::Path;

use super::flat::{FlatRows, Number, header_of};
use super::header::{Header, HeightRows};
use super::lines::{Lines, place_of};
use super::{ImportError, Parsed, envi, grid_error};

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let Some(hdr) = header_of(path) else {
        let hdr = path.with_extension("hdr");
        let problem =
            format!("needs its header {}, which says how many rows and columns it has; put it there", hdr.display());
        return Err(grid_error(path, &problem));
    };
    if envi::is_header(&hdr) {
        return envi::open(path, &hdr);
    }
    let lines = Lines::read(&hdr)?;
    let mut header = Header::new([lines.needed("NCOLS")?, lines.needed("NROWS")?]);
    let is_flt = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("flt"));
    let number = number_of(&lines, is_flt)?;
    (header.is_f32, header.is_integer) = number.kind();
    header.nodata = lines.number("NODATA")?.or(lines.number("NODATA_VALUE")?);
    header.place = place_of(&lines, header.size)?;
    if lines.number::<u32>("NBANDS")?.is_some_and(|bands| bands != 1) {
        return Err(grid_error(
            path,
            "has several bands; take out the one with heights first, with `gdal_translate -b`",
        ));
    }
    let io = |source| ImportError::Io { path: path.to_owned(), source };
    let file = File::open(path).map_err(io)?;
    let mut rows = FlatRows::new(path, file, header.size, number);
    rows.first_byte = lines.number("SKIPBYTES")?.unwrap_or(0);
    let least = rows.row_bytes;
    rows.row_bytes = lines.number("TOTALROWBYTES")?.or(lines.number("BANDROWBYTES")?).unwrap_or(least).max(least);
    rows.check_length(header.size)?;
    Ok((header, Box::new(rows)))
}

/// How the header says that samples are stored: ESRI's PIXELTYPE, or the DATATYPE of others, as `INT2S`, `FLT4S` or
/// `U16`.
fn number_of(lines: &Lines, is_flt: bool) -> Parsed<Number> {
    let said = lines.text("PIXELTYPE").or(lines.text("DATATYPE")).unwrap_or_default().to_ascii_uppercase();
    let digits: String = said.chars().filter(char::is_ascii_digit).collect();
    // R counts bytes, all others bits.
    let bits_of_kind = digits.parse::<u32>().ok().map(|count| if count < 8 { 8 * count } else { count });
    let bits: u32 = lines.number("NBITS")?.or(bits_of_kind).unwrap_or(if is_flt { 32 } else { 16 });
    let kind: &str = said.trim_matches(|c: char| c.is_ascii_digit());
    let is_float = kind.starts_with(['F', 'D', 'R']) || is_flt && kind.is_empty();
    // Headers of 16 bits without a type are those of heights, which have a sign (GTOPO30).
    let is_unsigned = kind.starts_with(['B', 'U']) || kind.ends_with('U') || kind.is_empty() && bits != 16;
    let order = lines.text("BYTEORDER").unwrap_or_default().to_ascii_uppercase();
    let is_big_endian = match order.chars().next() {
        None | Some('I' | 'L' | '0') => false,
        Some('M' | 'B' | '1') => true,
        Some(_) => {
            let problem = format!("says BYTEORDER \"{order}\"; write I for Intel's or M for Motorola's");
            return Err(grid_error(&lines.path, &problem));
        }
    };
    let is_known = if is_float { matches!(bits, 32 | 64) } else { matches!(bits, 8 | 16 | 32) };
    if !is_known {
        let problem = format!(
            "says NBITS {bits} and PIXELTYPE \"{said}\"; integers of 8, 16 and 32 bits and floats of 32 and 64 can be read"
        );
        return Err(grid_error(&lines.path, &problem));
    }
    Ok(Number { bytes: (bits / 8) as usize, is_float, is_signed: !is_unsigned, is_big_endian })
}
