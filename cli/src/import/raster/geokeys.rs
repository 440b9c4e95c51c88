//! The georeference of a GeoTIFF (OGC 19-008r4): where its pixels are, and in which system.

use std::path::Path;

use super::affine::Affine;
use super::crs::{Crs, CrsKind, US_FOOT};
use super::{Parsed, grid_error};

/// Numbers of keys.
const MODEL_TYPE: u16 = 1024;
const RASTER_TYPE: u16 = 1025;
const GEODETIC_CRS: u16 = 2048;
const ANGULAR_UNITS: u16 = 2054;
const PROJECTED_CRS: u16 = 3072;
const LINEAR_UNITS: u16 = 3076;
const VERTICAL_UNITS: u16 = 4099;
/// The value of a code that is defined by further keys.
const USER_DEFINED: u16 = 32767;

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
}

impl GeoTags {
    /// The short value of a key; none where it is stored elsewhere or there is none.
    fn key(&self, wanted: u16) -> Option<u16> {
        let (entries, _) = self.keys.as_chunks::<4>();
        let found =
            entries.iter().skip(1).find(|[key, location, count, _]| *key == wanted && *location == 0 && *count == 1);
        found.map(|&[.., value]| value)
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

    /// The system.
    pub fn crs(&self, path: &Path) -> Parsed<Crs> {
        let code = |key| self.key(key).filter(|&code| code != 0 && code != USER_DEFINED);
        let name = |code: Option<u16>| code.map_or(String::new(), |code| format!("EPSG:{code}"));
        match self.key(MODEL_TYPE) {
            Some(1) => {
                let unit = self.key(LINEAR_UNITS).and_then(metres_of);
                let named = Crs::named(&name(code(PROJECTED_CRS)));
                Ok(Crs { kind: CrsKind::Projected, unit: unit.or(named.unit), ..named })
            }
            Some(2) => match self.key(ANGULAR_UNITS) {
                None | Some(0 | 9102 | USER_DEFINED) => {
                    Ok(Crs { name: name(code(GEODETIC_CRS)), kind: CrsKind::Geographic, unit: None })
                }
                Some(unit) => {
                    let problem = format!(
                        "is in angles of EPSG unit {unit}; only degrees (9102) can be read: warp it first, with `gdalwarp`"
                    );
                    Err(grid_error(path, &problem))
                }
            },
            Some(3) => {
                Err(grid_error(path, "is in geocentric coordinates, which are no grid; warp it first, with `gdalwarp`"))
            }
            _ => Ok(Crs::default()),
        }
    }

    /// Metres in a unit of the heights, where it is known.
    pub fn vertical(&self) -> Option<f64> {
        self.key(VERTICAL_UNITS).and_then(metres_of)
    }
}

/// Metres in a unit of EPSG.
fn metres_of(unit: u16) -> Option<f64> {
    match unit {
        9001 => Some(1.0),
        9002 => Some(0.3048),
        9003 => Some(US_FOOT),
        9036 => Some(1000.0),
        _ => None,
    }
}
