//! Where a sample is in space: on a plane, on a sphere or on the ellipsoid of WGS 84.
//!
//! Sines and cosines are those of the crate `libm`, which computes them by the same additions and multiplications on
//! every machine, so that files have the same bytes everywhere.

use glam::DVec3;
use lodpack::heights;

use super::crs::{Body, Crs, CrsKind};
use super::header::Georeference;
use super::mosaic::Mosaic;
use super::options::{RasterOptions, SurfaceKind};
use super::{Parsed, grid_error};
use lodpack_mesh::tolerance::Unit;
use lodpack_runtime::progress::Progress;

/// Half axis of the ellipsoid at the equator, metres, and the square of its eccentricity.
const WGS84_A: f64 = 6_378_137.0;
const WGS84_F: f64 = 1.0 / 298.257_223_563;
const WGS84_E2: f64 = WGS84_F * (2.0 - WGS84_F);
/// Mean radius of the earth, (2 a + b) / 3.
const MEAN_RADIUS: f64 = 6_371_008.771_4;
/// A plane of longitudes and latitudes may stretch lengths to the east by this share at its northern and southern edge.
const MOST_STRETCH: f64 = 0.05;
/// A row this close to a pole, in rows, lies on it: files round their corners.
const AT_POLE: f64 = 0.01;

/// Where samples are in space.
pub(super) struct Surface {
    shape: Shape,
    /// The first row's coordinate, and how much each row adds.
    rows: [f64; 2],
    /// What heights are multiplied by.
    height_scale: f64,
    unit: Option<Unit>,
    /// What is taken off positions.
    shift: DVec3,
    /// What has to be added to get coordinates of the CRS.
    origin: [f64; 3],
    is_of_degrees: bool,
}

enum Shape {
    Plane {
        /// The first column's coordinate, and how much each column adds.
        columns: [f64; 2],
    },
    Ellipsoid {
        /// Half axis at the equator, and the square of the eccentricity.
        axis: f64,
        eccentricity: f64,
        /// Sine and cosine of the longitude of each column.
        columns: Vec<[f64; 2]>,
        /// Whether the grid ends at a pole that it has no row for: before the first row, and behind the last one.
        caps: [bool; 2],
    },
}

/// A row of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum RowPlace {
    /// Its y.
    Plane(f64),
    /// Sine and cosine of its latitude.
    Latitude([f64; 2]),
    /// All of it is one point: the north pole (1) or the south pole (-1).
    Pole(f64),
}

impl Surface {
    /// Lays a grid on what was chosen, and says where it lies.
    pub fn new(mosaic: &Mosaic, options: &RasterOptions, progress: &dyn Progress) -> Parsed<Self> {
        let note = |text: &str| progress.note(&format!("{}: {text}", mosaic.path().display()));
        let spacing = mosaic.place.spacing;
        let [columns, rows] = mosaic.size;
        note_crs(&mosaic.crs, note);
        let crs = if mosaic.crs.name.is_empty() { "no CRS" } else { &mosaic.crs.name };
        let crs: String = crs.chars().take(60).collect();
        note(&format!("a grid of {columns} x {rows} samples, {} x {} apart, in {crs}", spacing[0], spacing[1]));
        if options.surface != SurfaceKind::Sphere && options.radius.is_some() {
            return Err(grid_error(mosaic.path(), "gets a --radius, which only --surface sphere has"));
        }
        if let Some(geoid) = &mosaic.geoid {
            note(&format!("its heights above the geoid become heights above the ellipsoid, by {}", geoid.display()));
        }
        match options.surface {
            SurfaceKind::Plane if mosaic.crs.kind == CrsKind::Geographic => Self::of_degrees(mosaic, options, note),
            SurfaceKind::Plane => Self::plane(mosaic, options, note),
            SurfaceKind::Sphere => {
                let own = mosaic.crs.body().map_or(MEAN_RADIUS, |body| body.mean_radius());
                Self::globe(mosaic, options, [options.radius.unwrap_or(own), 0.0])
            }
            SurfaceKind::Wgs84 => {
                if let Some(Body { axis, .. }) = mosaic.crs.body() {
                    let problem = format!(
                        "is on a globe with a half axis of {axis} m, not on the earth; pass --surface sphere, which then has its mean radius"
                    );
                    return Err(grid_error(mosaic.path(), &problem));
                }
                match &mosaic.geoid {
                    Some(_) => {}
                    None => note(
                        "its heights are taken as above the ellipsoid of WGS 84; if they are above the geoid, pass a grid of it as --geoid",
                    ),
                }
                Self::globe(mosaic, options, [WGS84_A, WGS84_E2])
            }
        }
        .inspect(|surface| {
            if !mosaic.is_placed {
                note(&format!(
                    "does not say where it is or how far its samples are apart: they are {} units apart (--spacing, --bounds and --crs say it)",
                    surface.rows[1].abs()
                ));
            }
        })
    }

    fn plane(mosaic: &Mosaic, options: &RasterOptions, note: impl Fn(&str)) -> Parsed<Self> {
        let Georeference { first, spacing } = mosaic.place;
        let (unit, origin) = (mosaic.crs.unit, options.origin.unwrap_or_default());
        let height_scale = match (mosaic.vertical, unit) {
            (Some(vertical), Some(unit)) => vertical / unit,
            (Some(_), None) if options.vertical_unit.is_some() => {
                let problem =
                    "does not say the unit of its coordinates, so --vertical-unit cannot be applied; pass --unit, too";
                return Err(grid_error(mosaic.path(), problem));
            }
            (Some(vertical), None) if vertical != 1.0 => {
                note(&format!(
                    "its heights are in units of {vertical} m, and nobody says what its coordinates are in: both count as the same unit (--unit says it)"
                ));
                1.0
            }
            _ => 1.0,
        };
        Ok(Self {
            shape: Shape::Plane { columns: [first[0], spacing[0]] },
            rows: [first[1], -spacing[1]],
            height_scale,
            unit: unit.map(|metres| Unit { metres }),
            shift: if mosaic.is_local { DVec3::ZERO } else { DVec3::from_array(origin) / unit.unwrap_or(1.0) },
            origin,
            is_of_degrees: false,
        })
    }

    /// A plane of metres to the east and to the north of the middle. Lengths are right along the parallel and the
    /// meridian of the middle.
    fn of_degrees(mosaic: &Mosaic, options: &RasterOptions, note: impl Fn(&str)) -> Parsed<Self> {
        let Georeference { first, spacing } = mosaic.place;
        let [columns, rows] = mosaic.size.map(|count| (count - 1) as f64);
        let centre = [first[0] + 0.5 * columns * spacing[0], first[1] - 0.5 * rows * spacing[1]];
        let middle = options.origin.map_or(centre, |[longitude, latitude, _]| [longitude, latitude]);
        let (_, cos) = sin_cos_degrees(middle[1]);
        let of_edge = |latitude: f64| (sin_cos_degrees(latitude).1 / cos - 1.0).abs();
        let stretch = of_edge(first[1]).max(of_edge(first[1] - rows * spacing[1]));
        // Also refuses a middle at a pole, where the share is infinite or none.
        if !(stretch <= MOST_STRETCH && columns * spacing[0] * cos <= 30.0) {
            let problem = format!(
                "is in degrees and reaches over {:.1} x {:.1} of them, which no plane shows; pass --surface wgs84, or project it first, with \
                 `gdalwarp -t_srs`",
                columns * spacing[0],
                rows * spacing[1]
            );
            return Err(grid_error(mosaic.path(), &problem));
        }
        let [to_east, to_north] = metres_in_degree(mosaic.crs.body(), middle[1]);
        let reach = (0.5 * columns * spacing[0] * to_east, 0.5 * rows * spacing[1] * to_north);
        let drop =
            (reach.0 * reach.0 + reach.1 * reach.1) / (2.0 * mosaic.crs.body().map_or(WGS84_A, |body| body.axis));
        note(&format!(
            "degrees become metres on a plane around {:.6}, {:.6}; at its edge lengths to the east are off by {:.2} %, and a globe lies {drop:.1} m \
             below (--surface wgs84 is exact)",
            middle[0],
            middle[1],
            100.0 * stretch
        ));
        let height = options.origin.map_or(0.0, |[.., height]| height);
        let [dx, dy] = [spacing[0] * to_east, spacing[1] * to_north];
        Ok(Self {
            shape: Shape::Plane { columns: [(first[0] - middle[0]) * to_east, dx] },
            rows: [(first[1] - middle[1]) * to_north, -dy],
            height_scale: mosaic.vertical.unwrap_or(1.0),
            unit: Some(Unit { metres: 1.0 }),
            shift: DVec3::new(0.0, 0.0, height),
            origin: [middle[0], middle[1], height],
            is_of_degrees: true,
        })
    }

    fn globe(mosaic: &Mosaic, options: &RasterOptions, [axis, eccentricity]: [f64; 2]) -> Parsed<Self> {
        let Georeference { first, spacing } = mosaic.place;
        if mosaic.crs.kind != CrsKind::Geographic {
            let problem = match mosaic.is_placed {
                true => {
                    "is not in degrees, so it cannot be laid on a globe; bring it into EPSG:4326 first, with `gdalwarp -t_srs EPSG:4326`"
                }
                false => {
                    "does not say where it is on the globe; pass --bounds W,S,E,N in degrees, as --bounds -180,-90,180,90"
                }
            };
            return Err(grid_error(mosaic.path(), problem));
        }
        if mosaic.crs.meridian != 0.0 {
            let problem = format!(
                "counts longitudes from {:.6} east of Greenwich; bring it into EPSG:4326 first, with `gdalwarp -t_srs EPSG:4326`",
                mosaic.crs.meridian
            );
            return Err(grid_error(mosaic.path(), &problem));
        }
        let origin = options.origin.unwrap_or_default();
        let column = |column: u64| {
            let (sin, cos) = sin_cos_degrees(first[0] + column as f64 * spacing[0]);
            [sin, cos]
        };
        let south = first[1] - (mosaic.size[1] - 1) as f64 * spacing[1];
        // A row of areas ends half a row before the pole.
        let is_cap = |distance: f64| {
            mosaic.is_closed && distance > AT_POLE * spacing[1] && distance < (1.0 + AT_POLE) * spacing[1]
        };
        Ok(Self {
            shape: Shape::Ellipsoid {
                axis,
                eccentricity,
                columns: (0..mosaic.size[0]).map(column).collect(),
                caps: [is_cap(90.0 - first[1]), is_cap(90.0 + south)],
            },
            rows: [first[1], -spacing[1]],
            height_scale: mosaic.vertical.unwrap_or(1.0),
            unit: Some(Unit { metres: 1.0 }),
            shift: DVec3::from_array(origin),
            origin,
            is_of_degrees: false,
        })
    }

    /// The unit of positions.
    pub fn unit(&self) -> Option<Unit> {
        self.unit
    }

    /// The system of positions, and what is added to them there.
    pub fn crs_and_origin(&self, mosaic: &Mosaic) -> (String, [f64; 3]) {
        let crs = match &self.shape {
            // The place of a file in degrees needs a system that people know.
            Shape::Plane { .. } if self.is_of_degrees && mosaic.crs.name.is_empty() => "EPSG:4326".to_owned(),
            Shape::Plane { .. } => mosaic.crs.name.clone(),
            Shape::Ellipsoid { eccentricity, .. } if *eccentricity > 0.0 => "EPSG:4978".to_owned(),
            Shape::Ellipsoid { .. } => String::new(),
        };
        (crs, self.origin)
    }

    /// The surface as files of heights describe it, and what is added to heights. Rows begin at the northern cap, if
    /// there is one.
    pub fn of_heights(&self, mosaic: &Mosaic) -> (heights::Surface, f64) {
        let [mut first, mut step] = self.rows;
        let (base, columns) = match &self.shape {
            Shape::Plane { columns: [first, step] } => (heights::Base::Plane, [first - self.shift.x, *step]),
            &Shape::Ellipsoid { axis, eccentricity, caps: [north, _], .. } => {
                let last = first + (mosaic.size[1] - 1) as f64 * step;
                let [is_north, is_south] = [first, last].map(|row| 90.0 - row.abs() <= AT_POLE * step.abs());
                if is_north {
                    first = 90.0;
                }
                if is_south {
                    step = -(90.0 + first) / (mosaic.size[1] - 1) as f64;
                }
                if north {
                    first -= step;
                }
                (heights::Base::Ellipsoid { axis, eccentricity }, [mosaic.place.first[0], mosaic.place.spacing[0]])
            }
        };
        let is_plane = base == heights::Base::Plane;
        let north = if is_plane { first - self.shift.y } else { first };
        let surface = heights::Surface {
            base,
            first: [columns[0], north],
            spacing: [columns[1], step],
            height_scale: self.height_scale,
        };
        (surface, if is_plane { -self.shift.z / self.height_scale } else { 0.0 })
    }

    /// Whether the first and the last row are one point, a cap or a row of the grid's own.
    pub fn poles(&self, mosaic: &Mosaic) -> [bool; 2] {
        let is_pole = |row: u64| matches!(self.row(row), RowPlace::Pole(_));
        let [north, south] = self.caps();
        [north.is_some() || is_pole(0), south.is_some() || is_pole(mosaic.size[1] - 1)]
    }

    /// Where a row is.
    pub fn row(&self, row: u64) -> RowPlace {
        let at = self.rows[0] + row as f64 * self.rows[1];
        match &self.shape {
            Shape::Plane { .. } => RowPlace::Plane(at),
            Shape::Ellipsoid { .. } if 90.0 - at.abs() <= AT_POLE * self.rows[1].abs() => RowPlace::Pole(at.signum()),
            Shape::Ellipsoid { .. } => {
                let (sin, cos) = sin_cos_degrees(at);
                RowPlace::Latitude([sin, cos])
            }
        }
    }

    /// The poles that close the grid before its first and behind its last row, where it has no rows there.
    pub fn caps(&self) -> [Option<RowPlace>; 2] {
        match &self.shape {
            Shape::Plane { .. } => [None; 2],
            Shape::Ellipsoid { caps: [north, south], .. } => {
                [north.then_some(RowPlace::Pole(1.0)), south.then_some(RowPlace::Pole(-1.0))]
            }
        }
    }

    /// Where a sample is.
    #[inline]
    pub fn position(&self, column: usize, row: RowPlace, height: f64) -> DVec3 {
        let height = height * self.height_scale;
        let position = match (&self.shape, row) {
            (Shape::Plane { columns: [first, step] }, RowPlace::Plane(y)) => {
                DVec3::new(first + column as f64 * step, y, height)
            }
            (Shape::Ellipsoid { axis, eccentricity, columns, .. }, row) => {
                let [sin, cos] = match row {
                    RowPlace::Latitude(latitude) => latitude,
                    RowPlace::Pole(sign) | RowPlace::Plane(sign) => [sign, 0.0],
                };
                let [sin_longitude, cos_longitude] = columns[column];
                // Radius of curvature across the meridian.
                let across = axis / (1.0 - eccentricity * sin * sin).sqrt();
                let out = (across + height) * cos;
                DVec3::new(out * cos_longitude, out * sin_longitude, (across * (1.0 - eccentricity) + height) * sin)
            }
            (Shape::Plane { columns: [first, step] }, _) => DVec3::new(first + column as f64 * step, 0.0, height),
        };
        position - self.shift
    }
}

/// Says what a system's users have to know.
fn note_crs(crs: &Crs, note: impl Fn(&str)) {
    crs.remarks.iter().for_each(|remark| note(remark));
    let Some(vertical) = &crs.vertical else { return };
    let name = match vertical.code {
        Some(code) => format!("EPSG:{code} ({})", vertical.name),
        None => vertical.name.clone(),
    };
    if vertical.is_depth {
        note(&format!("its system of heights, {name}, counts downwards, and its numbers are taken as heights"));
    }
    // That of a system with both is part of its name.
    let is_named = crs.name.contains('[') || crs.name.is_empty() || vertical.name.is_empty();
    let of_name = || Crs::named(&crs.name).ok().and_then(|named| named.vertical);
    if !is_named && of_name().is_none_or(|own| own.name != vertical.name) {
        note(&format!("its heights are in {name}, of which their unit is kept, but not the name"));
    }
}

/// Metres in a degree to the east and to the north: the radius of curvature across the meridian, and along it.
pub fn metres_in_degree(body: Option<Body>, latitude: f64) -> [f64; 2] {
    let (axis, e2) = body.map_or((WGS84_A, WGS84_E2), |body| (body.axis, body.eccentricity()));
    let radians = std::f64::consts::PI / 180.0;
    let (sin, cos) = sin_cos_degrees(latitude);
    let root = (1.0 - e2 * sin * sin).sqrt();
    [axis / root * cos * radians, axis * (1.0 - e2) / (root * root * root) * radians]
}

/// Sine and cosine of an angle in degrees; exact at multiples of 90.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    let turned = degrees.rem_euclid(360.0);
    let quarter = (turned / 90.0).round();
    let rest = (turned - 90.0 * quarter) * (std::f64::consts::PI / 180.0);
    let (sin, cos) = (libm::sin(rest), libm::cos(rest));
    match quarter as i32 % 4 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}
