//! The georeference of a GeoTIFF (OGC 19-008r4): where its pixels are, and in which system.

use std::path::Path;

use super::affine::Affine;
use super::crs::{Body, Crs, CrsKind, Vertical, length, unknown};
use super::{Parsed, grid_error, lengths};

// Numbers of keys, for those who write them, too.
/// The kind of system: projected, geographic or geocentric.
pub const MODEL_TYPE: u16 = 1024;
/// Whether coordinates are of the middles of pixels or of their corners.
pub const RASTER_TYPE: u16 = 1025;
pub(super) const CITATION: u16 = 1026;
/// The code of the geographic system.
pub const GEODETIC_CRS: u16 = 2048;
/// The name of the geographic system.
pub const GEODETIC_CITATION: u16 = 2049;
/// The code of the unit of angles.
pub const ANGULAR_UNITS: u16 = 2054;
/// The code of the datum.
pub const GEODETIC_DATUM: u16 = 2050;
/// The code of the ellipsoid.
pub const ELLIPSOID: u16 = 2056;
/// The longer half axis of the ellipsoid.
pub const SEMI_MAJOR_AXIS: u16 = 2057;
const SEMI_MINOR_AXIS: u16 = 2058;
/// The inverse flattening of the ellipsoid.
pub const INVERSE_FLATTENING: u16 = 2059;
/// The code of the projected system.
pub const PROJECTED_CRS: u16 = 3072;
/// The name of the projected system.
pub const PROJECTED_CITATION: u16 = 3073;
pub(super) const PROJECTION: u16 = 3074;
pub(super) const METHOD: u16 = 3075;
/// The code of the unit of lengths.
pub const LINEAR_UNITS: u16 = 3076;
/// The unit of lengths in metres.
pub const LINEAR_UNIT_SIZE: u16 = 3077;
/// The code of the system of heights.
pub const VERTICAL_CRS: u16 = 4096;
/// The code of the unit of heights.
pub const VERTICAL_UNITS: u16 = 4099;
/// The value of a code that is defined by further keys.
pub const USER_DEFINED: u16 = 32767;
/// The tag with the numbers of keys.
pub const GEO_DOUBLES: u16 = 34736;
/// The tag of the keys' texts.
pub const GEO_TEXTS: u16 = 34737;
/// The tag with what GDAL knows beyond them.
pub const GDAL_METADATA: u16 = 42112;
/// What a citation begins with that has a whole system behind it, as ArcGIS writes it and GDAL reads it.
pub const WKT_CITATION: &str = "ESRI PE String = ";
/// Codes of heights before EPSG had systems of them: ellipsoids and vertical datums of GeoTIFF 1.0, in metres.
const OLD_VERTICAL: std::ops::RangeInclusive<u16> = 5001..=5199;

/// The tags of a GeoTIFF, as they are stored.
#[derive(Debug, Default)]
pub(super) struct GeoTags {
    /// Widths and heights of pixels.
    pub pixel_scale: Vec<f64>,
    /// Pixels and their places, six numbers each.
    pub tiepoints: Vec<f64>,
    /// A matrix of four rows from pixels to places.
    pub transformation: Vec<f64>,
    /// Keys, four numbers each; the first four are a header.
    pub keys: Vec<u16>,
    /// Numbers that keys name.
    pub doubles: Vec<f64>,
    /// Texts that keys name, each with `|` at its end.
    pub texts: String,
}

impl GeoTags {
    fn entry(&self, wanted: u16) -> Option<[u16; 3]> {
        let (entries, _) = self.keys.as_chunks::<4>();
        entries
            .iter()
            .skip(1)
            .find(|[key, ..]| *key == wanted)
            .map(|&[_, location, count, value]| [location, count, value])
    }

    /// The short value of a key; none where it is stored elsewhere or there is none.
    pub(super) fn key(&self, wanted: u16) -> Option<u16> {
        let [location, count, value] = self.entry(wanted)?;
        (location == 0 && count == 1).then_some(value)
    }

    pub(super) fn number(&self, wanted: u16) -> Option<f64> {
        let [location, _, at] = self.entry(wanted)?;
        self.doubles.get(usize::from(at)).copied().filter(|_| location == GEO_DOUBLES)
    }

    pub(super) fn text(&self, wanted: u16) -> Option<&str> {
        let [location, count, at] = self.entry(wanted)?;
        let text = self.texts.get(usize::from(at)..)?;
        let text = text.get(..usize::from(count)).unwrap_or(text);
        (location == GEO_TEXTS).then(|| text.trim_end_matches(['|', '\0', ' ']))
    }

    /// A code of EPSG; none where further keys define the system.
    pub(super) fn code(&self, wanted: u16) -> Option<u16> {
        self.key(wanted).filter(|&code| code != 0 && code != USER_DEFINED)
    }

    /// From columns and rows to places; none if the file does not say.
    pub fn place(&self, path: &Path) -> Parsed<Option<Affine>> {
        let (corner, column, row) = match (&self.transformation[..], &self.pixel_scale[..], &self.tiepoints[..]) {
            ([a, b, _, d, e, f, _, h, ..], ..) => ([*d, *h], [*a, *e], [*b, *f]),
            // Rows run to the south whatever the sign of their height, as GDAL has it.
            (_, [x, y, ..], [i, j, _, at_x, at_y, ..]) => {
                let y = y.abs();
                ([at_x - i * x, at_y + j * y], [*x, 0.0], [0.0, -y])
            }
            (_, [], []) => return Ok(None),
            _ => {
                let problem = "is placed by points alone or by incomplete tags; rectify it first, with `gdalwarp`";
                return Err(grid_error(path, problem));
            }
        };
        // A pixel is an area, and its sample lies in the middle, unless the file says that pixels are points.
        let is_point = self.key(RASTER_TYPE) == Some(2);
        let shift = if is_point { 0.0 } else { 0.5 };
        let first = [0, 1].map(|axis| corner[axis] + shift * column[axis] + shift * row[axis]);
        Ok(Some(Affine { first, column, row }))
    }

    /// The system, and what it says about heights.
    pub fn crs(&self, path: &Path) -> Parsed<Crs> {
        let refused = |problem: String| grid_error(path, &problem);
        let mut crs = match self.key(MODEL_TYPE) {
            Some(1) => self.projected(),
            Some(2) => self.geographic(),
            Some(USER_DEFINED) => self.described(),
            Some(3) => Err("is in geocentric coordinates, which are no grid; warp it first, with `gdalwarp`".into()),
            _ => Ok(Crs::default()),
        }
        .map_err(refused)?;
        if let Some(vertical) = self.vertical(&mut crs.remarks).map_err(refused)? {
            crs.vertical = Some(vertical);
        }
        Ok(crs)
    }

    /// A system whose kind no key tells, but maybe WKT.
    fn described(&self) -> Result<Crs, String> {
        let wkt = [PROJECTED_CITATION, CITATION].iter().find_map(|&key| self.text(key)?.strip_prefix(WKT_CITATION));
        let crs =
            wkt.map(Crs::of_wkt).transpose().map_err(|error| format!("has a CRS that cannot be read: {error}"))?;
        let crs = crs.unwrap_or_default();
        Ok(Crs { unit: self.linear_unit()?.or(crs.unit), ..crs })
    }

    fn projected(&self) -> Result<Crs, String> {
        let mut crs = self.system(PROJECTED_CRS, CrsKind::Projected, &[PROJECTED_CITATION, CITATION])?;
        if crs.name.is_empty()
            && let Some(wkt) = self.projected_wkt()
        {
            crs = Crs::of_wkt(&wkt)?;
        } else if crs.name.is_empty()
            && [PROJECTED_CITATION, CITATION, PROJECTION, METHOD].iter().any(|&key| self.entry(key).is_some())
        {
            let name = self.text(PROJECTED_CITATION).or(self.text(CITATION)).unwrap_or("no name");
            let name: String = name.chars().take(80).collect();
            crs.remarks.push(format!(
                "its projected CRS ({name}) has no number, and will be lost; --crs gives it one, or WKT"
            ));
        }
        crs.unit = self.linear_unit()?.or(crs.unit);
        Ok(crs)
    }

    /// Metres in a unit of the coordinates, which may be another one than that of the system.
    pub(super) fn linear_unit(&self) -> Result<Option<f64>, String> {
        Ok(match (self.key(LINEAR_UNITS), self.number(LINEAR_UNIT_SIZE)) {
            (Some(USER_DEFINED), Some(metres)) => Some(length(metres)?),
            (None | Some(0 | USER_DEFINED), _) => None,
            (Some(code), _) => {
                let unknown = || format!("is in EPSG unit {code}, which is no length that is known here");
                Some(lengths::of_code(code).ok_or_else(unknown)?)
            }
        })
    }

    fn geographic(&self) -> Result<Crs, String> {
        if let Some(unit) = self.key(ANGULAR_UNITS).filter(|unit| ![0, 9102, 9122, USER_DEFINED].contains(unit)) {
            return Err(format!(
                "is in angles of EPSG unit {unit}; only degrees (9102) can be read: warp it first, with `gdalwarp`"
            ));
        }
        let crs = self.system(GEODETIC_CRS, CrsKind::Geographic, &[PROJECTED_CITATION, GEODETIC_CITATION, CITATION])?;
        match self.body()? {
            Some(body) if crs.name.is_empty() => {
                let name = self.text(GEODETIC_CITATION).or(self.text(CITATION)).unwrap_or("Unnamed");
                Ok(Crs { remarks: crs.remarks, ..Crs::of_degrees(name, body) })
            }
            _ => Ok(crs),
        }
    }

    /// The system of a code or, where it has none, of WKT in a citation; without a name if there is neither.
    fn system(&self, key: u16, kind: CrsKind, citations: &[u16]) -> Result<Crs, String> {
        if let Some(code) = self.code(key) {
            return Ok(match Crs::of_code(code.into())? {
                Some(known) if known.kind == kind => known,
                _ if kind == CrsKind::Geographic => return Err(format!("is in {}", unknown(code.into()))),
                // The dataset grows, and lengths are lengths.
                _ => Crs { name: format!("EPSG:{code}"), kind, remarks: vec![unknown(code.into())], ..Crs::default() },
            });
        }
        let wkt = citations.iter().find_map(|&key| self.text(key)?.strip_prefix(WKT_CITATION));
        match wkt.map(Crs::of_wkt) {
            Some(Ok(crs)) if crs.kind == kind => Ok(crs),
            Some(Err(error)) => {
                Ok(Crs { kind, remarks: vec![format!("its CRS cannot be read: {error}")], ..Crs::default() })
            }
            _ => Ok(Crs { kind, ..Crs::default() }),
        }
    }

    /// The ellipsoid that keys describe.
    pub(super) fn body(&self) -> Result<Option<Body>, String> {
        let Some(axis) = self.number(SEMI_MAJOR_AXIS) else { return Ok(None) };
        let inverse_flattening = match (self.number(INVERSE_FLATTENING), self.number(SEMI_MINOR_AXIS)) {
            (Some(inverse), _) => inverse,
            (None, Some(minor)) if minor < axis => axis / (axis - minor),
            _ => 0.0,
        };
        Body { axis, inverse_flattening }.checked().map(Some)
    }

    /// The system of heights. Its unit may stand beside it.
    fn vertical(&self, remarks: &mut Vec<String>) -> Result<Option<Vertical>, String> {
        let known = self.code(VERTICAL_CRS).and_then(|code| Vertical::of_code(code.into()));
        let metres = match self.code(VERTICAL_UNITS) {
            None => None,
            Some(unit) => {
                let metres = lengths::of_code(unit);
                if metres.is_none() {
                    remarks.push(format!(
                        "its heights are in EPSG unit {unit}, which is no length that is known; --vertical-unit says it"
                    ));
                }
                metres
            }
        };
        if let Some(code) =
            self.code(VERTICAL_CRS).filter(|code| known.is_none() && metres.is_none() && !OLD_VERTICAL.contains(code))
        {
            remarks.push(format!("EPSG:{code}, which its heights are in, is not among the systems that are known here; --vertical-unit says their unit"));
        }
        Ok(match (known, metres) {
            // As GDAL has it, the system's own unit counts.
            (Some(known), Some(metres)) if known.metres.is_some_and(|own| own != metres) => {
                remarks.push(format!(
                    "says that its heights are in {}, and that their unit has {metres} m; the former counts, and --vertical-unit says otherwise",
                    known.name
                ));
                Some(known)
            }
            (Some(known), metres) => Some(Vertical { metres: known.metres.or(metres), ..known }),
            (None, Some(_)) => Some(Vertical { metres, ..Vertical::default() }),
            (None, None) => None,
        })
    }
}
