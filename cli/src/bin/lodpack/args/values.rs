//! Values of options as people type them.

use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use lodpack_cli::import::raster::is_known_epsg;
use std::str::FromStr;

/// A box in input units: its smaller corner, then its larger one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoundingBox(pub [[f64; 3]; 2]);

impl FromStr for BoundingBox {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse::<f64>()).collect();
        let numbers = numbers.map_err(|_| "a box is six numbers: x0,y0,z0,x1,y1,z1".to_string())?;
        let &[x0, y0, z0, x1, y1, z1] = numbers.as_slice() else {
            return Err(format!("a box is six numbers, not {}: x0,y0,z0,x1,y1,z1", numbers.len()));
        };
        // Also refuses NaN.
        if !(x0 <= x1 && y0 <= y1 && z0 <= z1) {
            return Err("a box has its smaller corner first: x0,y0,z0,x1,y1,z1".into());
        }
        Ok(Self([[x0, y0, z0], [x1, y1, z1]]))
    }
}

/// West, south, east and north edge of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds(pub [f64; 4]);

impl FromStr for Bounds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').map_while(|number| number.trim().parse().ok()).collect();
        match numbers[..] {
            [west, south, east, north] if text.matches(',').count() == 3 => {
                let is_finite = numbers.iter().all(|number| number.is_finite());
                match is_finite && west < east && south < north {
                    true => Ok(Self([west, south, east, north])),
                    false => Err("edges are west, south, east and north: the west must be below the east, and the south below the north".into()),
                }
            }
            _ => Err("edges are four numbers: W,S,E,N".into()),
        }
    }
}

/// How many texels images have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TexelsChoice {
    /// By the number of triangles.
    Auto,
    /// As many as there are.
    All,
    /// At most so many.
    Most(u64),
}

/// The least number of texels that can be asked for: images of fewer show nothing.
const LEAST_TEXELS: u64 = 1024;

impl FromStr for TexelsChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            "all" => Ok(Self::All),
            _ => match parse_count(text) {
                Ok(most) if most >= LEAST_TEXELS => Ok(Self::Most(most)),
                Ok(_) => Err(format!("images need at least {LEAST_TEXELS} texels")),
                Err(_) => Err("write auto, all, or a whole number of texels, such as 1048576".into()),
            },
        }
    }
}

/// A length above zero.
pub fn parse_length(text: &str) -> Result<f64, String> {
    match text.trim().parse::<f64>() {
        Ok(length) if length.is_finite() && length > 0.0 => Ok(length),
        _ => Err("write a number above zero".into()),
    }
}

/// A place in a coordinate reference system.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Place(pub [f64; 3]);

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Vec<f64> = text.split(',').map_while(|number| number.trim().parse().ok()).collect();
        match numbers[..] {
            [x, y, z] if text.matches(',').count() == 2 && numbers.iter().all(|x| x.is_finite()) => Ok(Self([x, y, z])),
            _ => Err("a place is three numbers: x,y,z".into()),
        }
    }
}

/// A coordinate reference system: a number of EPSG, or WKT.
pub fn parse_crs(text: &str) -> Result<String, String> {
    let text = text.trim();
    let is_epsg = text.get(..5).is_some_and(|start| start.eq_ignore_ascii_case("EPSG:"));
    // WKT 1 and 2 begin with a word in capitals and a bracket.
    let is_wkt = text
        .split_once('[')
        .is_some_and(|(word, _)| word.len() > 3 && word.bytes().all(|b| b.is_ascii_uppercase() || b == b'_'));
    match text.get(5..).map(parse_count::<u32>) {
        Some(Ok(number)) if is_epsg && is_known_epsg(number) => Ok(format!("EPSG:{number}")),
        Some(Ok(number)) if is_epsg => {
            Err(format!("EPSG has no system with the number {number}; check it, or write the system as WKT"))
        }
        _ if is_wkt && text.ends_with(']') => Ok(text.to_owned()),
        _ => Err("write a number of EPSG as EPSG:32632, or WKT".into()),
    }
}

/// The axis that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum UpAxis {
    /// As in glTF, and in most scans and models.
    Y,
    /// As in maps, and in most surveys.
    Z,
}

impl UpAxis {
    pub fn axis(self) -> lodpack::index::UpAxis {
        match self {
            Self::Y => lodpack::index::UpAxis::Y,
            Self::Z => lodpack::index::UpAxis::Z,
        }
    }
}

/// Numbers of parts: one, or the first and the last of several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartRange {
    pub first: u32,
    pub last: u32,
}

impl FromStr for PartRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number =
            |text: &str| text.parse::<u32>().map_err(|_| "write one part as 3, several as 0-15; the first is 0");
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        let range = Self { first: number(first)?, last: number(last)? };
        if range.first <= range.last { Ok(range) } else { Err("the first part must not be above the last".into()) }
    }
}

/// Bytes, with or without a unit.
pub fn parse_size(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, u64); 8] = [
        ("kib", 1 << 10),
        ("mib", 1 << 20),
        ("gib", 1 << 30),
        ("tib", 1 << 40),
        ("kb", 1_000),
        ("mb", 1_000_000),
        ("gb", 1_000_000_000),
        ("tb", 1_000_000_000_000),
    ];
    let lower = text.trim().to_ascii_lowercase();
    let unit = UNITS.iter().find_map(|&(unit, bytes)| Some((lower.strip_suffix(unit)?, bytes)));
    let (number, bytes) = unit.unwrap_or((lower.strip_suffix('b').unwrap_or(&lower), 1));
    let size: f64 = number.trim_end().parse().map_err(|_| "write a size as 512MiB or 2GB")?;
    if size.is_finite() && size > 0.0 {
        Ok((size * bytes as f64) as u64)
    } else {
        Err("a size must be above zero".into())
    }
}

/// A whole number, from 0.
pub fn parse_count<T: TryFrom<u64>>(text: &str) -> Result<T, String> {
    let whole = !text.is_empty() && text.bytes().all(|digit| digit.is_ascii_digit());
    match text.parse::<u64>().ok().and_then(|count| count.try_into().ok()) {
        Some(count) => Ok(count),
        None if whole => Err("this number is too large".into()),
        None => Err("write a whole number, 0 or above".into()),
    }
}

/// More threads than cores only take memory, and the system refuses them at some number.
const MAX_THREADS: usize = 1024;

pub fn parse_threads(text: &str) -> Result<usize, String> {
    match parse_count(text)? {
        number if number <= MAX_THREADS => Ok(number),
        _ => Err(format!("at most {MAX_THREADS} threads are possible; 0 takes all cores")),
    }
}

/// A share between 0 and 1, exclusive: 0.01 or 1%.
pub fn parse_share(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let number = match text.strip_suffix('%') {
        Some(percent) => percent.trim().parse::<f64>().map(|percent| percent / 100.0),
        None => text.parse(),
    };
    match number {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(share),
        _ => Err("write a share between 0 and 1, as 0.01 or 1%".into()),
    }
}

/// Which levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LevelChoice {
    All,
    Finest,
    Number(u32),
}

impl FromStr for LevelChoice {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "all" => Ok(Self::All),
            "finest" => Ok(Self::Finest),
            _ => parse_count(text).map(Self::Number).map_err(|_| "write all, finest, or the number of a level".into()),
        }
    }
}

/// Reads a choice by the names that the library gives, with the library's word on each in the help.
pub fn parse_choice<T, const N: usize>(all: [(&'static str, T, &'static str); N]) -> impl TypedValueParser<Value = T>
where
    T: Clone + FromStr<Err = String> + Send + Sync + 'static,
{
    let values = all.map(|(name, _, help)| PossibleValue::new(name).help(help));
    PossibleValuesParser::new(values).try_map(|name| name.parse::<T>())
}

/// How progress is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressStyle {
    /// Bars on a terminal, lines elsewhere.
    #[default]
    Auto,
    /// One JSON object per line on stderr: stage, percent, remaining seconds (null while unknown), memory and disk;
    /// also notes, and the error if the command fails.
    Json,
    /// No progress.
    None,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_take_decimal_and_binary_units() {
        for (text, bytes) in [("512MiB", 512 << 20), ("2gb", 2_000_000_000), ("1.5 kB", 1500), ("77", 77), ("8B", 8)] {
            assert_eq!(parse_size(text), Ok(bytes), "{text}");
        }
        for bad in ["", "much", "-1MB", "0", "inf", "MiB", "1 parsec"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn systems_are_numbers_or_wkt_and_places_three_numbers() {
        assert_eq!(parse_crs("epsg:32632"), Ok("EPSG:32632".into()));
        assert_eq!(parse_crs(" PROJCRS[\"x\",1] "), Ok("PROJCRS[\"x\",1]".into()));
        for known in ["EPSG:4978", "EPSG:4979", "EPSG:25832", "EPSG:2230"] {
            assert_eq!(parse_crs(known).as_deref(), Ok(known));
        }
        for bad in
            ["", "EPSG:", "EPSG:x", "EPSG:1", "EPSG:99999", "EPSG:99999999999", "WGS84", "32632", "PROJCRS[", "a[b]"]
        {
            assert!(parse_crs(bad).is_err(), "{bad}");
        }
        assert_eq!("7.5,-50,1e3".parse(), Ok(Place([7.5, -50.0, 1000.0])));
        for bad in ["", "1,2", "1,2,3,4", "1,2,x", "1,2,inf", "1,2,3,"] {
            assert!(bad.parse::<Place>().is_err(), "{bad}");
        }
    }

    #[test]
    fn parts_are_one_or_a_range() {
        assert_eq!("3".parse(), Ok(PartRange { first: 3, last: 3 }));
        assert_eq!("0-15".parse(), Ok(PartRange { first: 0, last: 15 }));
        for bad in ["", "-", "3-", "5-2", "1-2-3", "x"] {
            assert!(bad.parse::<PartRange>().is_err(), "{bad}");
        }
    }
}
