//! SRTM `.hgt`: a square degree of big-endian 16-bit heights in metres, rows from the north. The name says where it is.

use std::fs::File;
use std::path::Path;

use super::crs::Crs;
use super::flat::{FlatRows, Number};
use super::header::{Georeference, Header, HeightRows};
use super::{ImportError, Parsed, grid_error};

/// The value of samples without data.
const VOID: f64 = -32768.0;

pub(super) fn open(path: &Path) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let file = File::open(path).map_err(|source| ImportError::Io { path: path.to_owned(), source })?;
    let bytes = file.metadata().map_err(|source| ImportError::Io { path: path.to_owned(), source })?.len();
    let Some([longitude, latitude]) = path.file_stem().and_then(|stem| corner(&stem.to_string_lossy())) else {
        let problem = "does not say where it is: an .hgt file is named after its south-western corner, as N47E008.hgt";
        return Err(grid_error(path, problem));
    };
    // One and three seconds, and one second by two seconds of longitude near the poles.
    let sizes = [[3601, 3601], [1201, 1201], [1801, 3601]];
    let Some(size) = sizes.into_iter().find(|[columns, rows]| 2 * columns * rows == bytes) else {
        let problem = format!(
            "has {bytes} bytes, but an .hgt file has 3601 x 3601, 1801 x 3601 or 1201 x 1201 samples of 2 bytes; copy it again"
        );
        return Err(grid_error(path, &problem));
    };
    let mut header = Header::new(size.map(|size| size as u32));
    let spacing = size.map(|size| 1.0 / (size - 1) as f64);
    header.place = Some(Georeference { first: [longitude, latitude + 1.0], spacing });
    (header.nodata, header.crs, header.vertical) = (Some(VOID), Crs::wgs84(), Some(1.0));
    header.is_integer = true;
    let rows = FlatRows::new(path, file, header.size, Number::HEIGHT);
    Ok((header, Box::new(rows)))
}

/// The corner that a name like `N47E008` says.
fn corner(stem: &str) -> Option<[f64; 2]> {
    let (latitude, longitude) = (stem.get(..3)?, stem.get(3..7)?);
    let number = |text: &str, positive: &str, negative: &str| -> Option<f64> {
        let degrees: f64 = text.get(1..)?.parse::<u32>().ok()?.into();
        match text.get(..1)? {
            side if side.eq_ignore_ascii_case(positive) => Some(degrees),
            side if side.eq_ignore_ascii_case(negative) => Some(-degrees),
            _ => None,
        }
    };
    Some([number(longitude, "E", "W")?, number(latitude, "N", "S")?])
}
