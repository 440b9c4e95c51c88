//! Coordinate reference systems, as far as a grid needs them: whether they are in degrees, and their unit.

use std::path::Path;

use super::sidecar::with_extension;

/// A coordinate reference system.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Crs {
    /// `EPSG:` and a number, or WKT; empty if unknown.
    pub name: String,
    /// What its coordinates are.
    pub kind: CrsKind,
    /// Metres in a unit of projected coordinates, where it is known.
    pub unit: Option<f64>,
}

/// What the coordinates of a system are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum CrsKind {
    /// Nobody knows.
    #[default]
    Unknown,
    /// Lengths to the east and to the north.
    Projected,
    /// Longitudes and latitudes in degrees.
    Geographic,
}

/// Metres in a US survey foot.
pub(super) const US_FOOT: f64 = 1200.0 / 3937.0;

/// Geographic systems that are in use for grids of heights. The numbers of EPSG do not tell what a system is.
const GEOGRAPHIC: [u32; 17] =
    [4326, 4979, 4269, 4258, 4283, 4617, 4674, 7844, 4167, 4612, 6668, 4490, 4148, 4019, 4047, 4267, 4055];

/// The largest `.prj` that is read.
const MAX_WKT_BYTES: u64 = 1 << 16;

impl Crs {
    /// The system of longitudes and latitudes on WGS 84.
    pub fn wgs84() -> Self {
        Self { name: "EPSG:4326".into(), kind: CrsKind::Geographic, unit: None }
    }

    /// The system with a name, of which only the name tells what it is.
    pub fn named(name: &str) -> Self {
        let code = name.strip_prefix("EPSG:").and_then(|number| number.parse::<u32>().ok());
        let word: String = name.chars().take_while(char::is_ascii_alphabetic).collect();
        let (kind, unit) = match (code, word.as_str()) {
            (Some(code), _) if GEOGRAPHIC.contains(&code) => (CrsKind::Geographic, None),
            // UTM on WGS 84 and on ETRS89, and the projection of web maps.
            (Some(32601..=32660 | 32701..=32760 | 25828..=25838 | 3857), _) => (CrsKind::Projected, Some(1.0)),
            (Some(_), _) => (CrsKind::Unknown, None),
            (None, "GEOGCS" | "GEOGCRS" | "GEODCRS") => (CrsKind::Geographic, None),
            (None, "PROJCS" | "PROJCRS") => (CrsKind::Projected, linear_unit(name)),
            // A compound system begins with its horizontal one.
            (None, "COMPD_CS" | "COMPOUNDCRS") => match (name.find("PROJC"), name.find("GEOG")) {
                (Some(_), _) => (CrsKind::Projected, None),
                (None, Some(_)) => (CrsKind::Geographic, None),
                (None, None) => (CrsKind::Unknown, None),
            },
            _ => (CrsKind::Unknown, None),
        };
        Self { name: name.to_owned(), kind, unit }
    }

    /// The system in the `.prj` beside a file. What is not there or is no WKT says nothing.
    pub fn beside(path: &Path) -> Self {
        let Some(prj) = with_extension(path, "prj") else { return Self::default() };
        let is_small = std::fs::metadata(&prj).is_ok_and(|file| file.is_file() && file.len() <= MAX_WKT_BYTES);
        let text = if is_small { std::fs::read_to_string(&prj).unwrap_or_default() } else { String::new() };
        let text = text.trim();
        match text.contains('[') && text.ends_with(']') {
            true => Self { name: epsg_of(text).unwrap_or_else(|| text.to_owned()), ..Self::named(text) },
            false => Self::default(),
        }
    }
}

/// Whether coordinates of a system, named by EPSG or in WKT, are degrees.
pub fn is_geographic(name: &str) -> bool {
    Crs::named(name).kind == CrsKind::Geographic
}

/// The unit of projected coordinates in WKT: the last one named that is no angle, for WKT 1 has it after those of its parts.
fn linear_unit(wkt: &str) -> Option<f64> {
    let mut found = None;
    for (at, word) in wkt.match_indices("UNIT[") {
        let is_angle = wkt[..at].ends_with("ANGLE") || wkt[at..].to_ascii_lowercase().starts_with("unit[\"degree");
        let mut fields = wkt[at + word.len()..].split([',', ']']);
        let metres = fields.nth(1).and_then(|number| number.trim().parse::<f64>().ok());
        if let Some(metres) = metres.filter(|&metres| !is_angle && metres > 0.0 && metres.is_finite()) {
            found = Some(metres);
        }
    }
    found
}

/// The number of EPSG at the end of WKT, which is that of the whole system.
fn epsg_of(wkt: &str) -> Option<String> {
    let tail = wkt.rsplit_once("AUTHORITY[\"EPSG\",").or_else(|| wkt.rsplit_once("ID[\"EPSG\","))?.1;
    let number: String = tail.chars().filter(char::is_ascii_digit).collect();
    // Only the brackets of the number and of the whole may follow.
    let rest: String = tail.chars().filter(|c| !c.is_ascii_digit() && !c.is_whitespace() && *c != '"').collect();
    (rest == "]]" && number.parse::<u32>().is_ok()).then(|| format!("EPSG:{number}"))
}
