//! Where a window of a grid of heights is, in the reference system that its file names and in that system's own units,
//! and the keys of GeoTIFF 1.1 (OGC 19-008r4) that say so.

use lodpack::ReadAt;
use lodpack::heights::{Base, Heights};

use super::window::RasterWindow;
use lodpack_import::raster::geokeys::{
    ANGULAR_UNITS, ELLIPSOID, GEO_DOUBLES, GEO_TEXTS, GEODETIC_CITATION, GEODETIC_CRS, GEODETIC_DATUM,
    INVERSE_FLATTENING, LINEAR_UNIT_SIZE, LINEAR_UNITS, MODEL_TYPE, PROJECTED_CITATION, PROJECTED_CRS, RASTER_TYPE,
    SEMI_MAJOR_AXIS, USER_DEFINED, VERTICAL_CRS, VERTICAL_UNITS, WKT_CITATION,
};
use lodpack_import::raster::lengths::code_of;
use lodpack_import::raster::{Body, Crs, CrsKind, metres_in_degree};

/// The EPSG code of a degree.
const DEGREE: u16 = 9102;

/// Where a window is.
#[derive(Clone, Debug, PartialEq)]
pub struct Georeference {
    /// The first sample, in the units of the system.
    pub first: [f64; 2],
    /// Both positive; rows go to the south.
    pub spacing: [f64; 2],
    /// What heights of the file lack to those of the window: what was taken off as the origin.
    pub zero: f64,
    /// What samples are multiplied by to be metres, if their unit has no number.
    pub(super) metres: Option<f64>,
    pub(super) keys: Keys,
    /// What the window does not say.
    pub notes: Vec<String>,
}

/// Keys of a GeoTIFF, with the numbers and texts that they name.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Keys {
    entries: Vec<[u16; 4]>,
    pub doubles: Vec<f64>,
    pub texts: String,
}

impl Keys {
    fn short(&mut self, key: u16, value: u16) {
        self.entries.push([key, 0, 1, value]);
    }

    fn double(&mut self, key: u16, value: f64) {
        self.entries.push([key, GEO_DOUBLES, 1, self.doubles.len() as u16]);
        self.doubles.push(value);
    }

    /// False if there is no room for it: a `|` ends a text, and places are counted with 16 bits.
    fn text(&mut self, key: u16, text: &str) -> bool {
        let (Ok(at), Ok(count)) = (u16::try_from(self.texts.len()), u16::try_from(text.chars().count() + 1)) else {
            return false;
        };
        if text.contains(['|', '\0']) || self.texts.len() + text.len() >= usize::from(u16::MAX) {
            return false;
        }
        self.entries.push([key, GEO_TEXTS, count, at]);
        // TIFF has no other letters. What a system means does not stand in its names.
        self.texts.extend(text.chars().map(|c| if c.is_ascii() { c } else { '_' }));
        self.texts.push('|');
        true
    }

    /// The numbers of the tag: a header, and the keys in their order.
    pub fn directory(&self) -> Vec<u16> {
        let mut entries = self.entries.clone();
        entries.sort_unstable();
        let mut numbers = vec![1, 1, 0, entries.len() as u16];
        numbers.extend(entries.as_flattened());
        numbers
    }
}

impl Georeference {
    /// That of a window of a file.
    pub fn of<S: ReadAt>(file: &Heights<S>, window: &RasterWindow) -> Self {
        let (surface, stride) = (file.surface(), window.stride as f64);
        let placement = file.placement().cloned().unwrap_or_default();
        let mut place = Self {
            first: [0, 1].map(|axis| surface.first[axis] + surface.spacing[axis] * stride * window.first[axis] as f64),
            spacing: surface.spacing.map(|spacing| spacing.abs() * stride),
            zero: 0.0,
            metres: None,
            keys: Keys::default(),
            notes: vec![],
        };
        // A sample is a point.
        place.keys.short(RASTER_TYPE, 2);
        let origin = placement.origin;
        let crs = match surface.base {
            Base::Ellipsoid { axis, eccentricity } => {
                // Longitudes beyond the date line count from the west.
                if place.first[0] >= 180.0 {
                    place.first[0] -= 360.0;
                }
                globe(axis, eccentricity)
            }
            Base::Plane => {
                let crs = match (placement.crs.as_str(), Crs::named(&placement.crs)) {
                    ("", _) => Crs::default(),
                    (_, Ok(crs)) => crs,
                    (name, Err(problem)) => {
                        place.notes.push(problem);
                        Crs { name: name.to_owned(), code: code_in(name), ..Crs::default() }
                    }
                };
                let unit = placement.unit.unwrap_or(1.0);
                // Metres on a plane around a point become degrees again.
                let (own, moved, unit) = match crs.kind {
                    CrsKind::Geographic => (metres_in_degree(crs.body(), origin[1]), [origin[0], origin[1]], 1.0),
                    _ => ([1.0; 2], [origin[0] / unit, origin[1] / unit], unit),
                };
                place.first = [0, 1].map(|k| place.first[k] / own[k] + moved[k]);
                place.spacing = [0, 1].map(|k| place.spacing[k] / own[k]);
                place.zero = origin[2] / (unit * surface.height_scale);
                crs
            }
        };
        // Lengths on a globe, and beside degrees, are metres.
        let is_metric = surface.is_globe() || crs.kind == CrsKind::Geographic;
        let unit = if is_metric { Some(1.0) } else { placement.unit };
        place.put_crs(&crs, if is_metric { None } else { placement.unit });
        if let Some(unit) = unit {
            place.put_heights(&crs, unit * surface.height_scale);
        }
        place
    }

    /// Says the system, by number if it has one.
    fn put_crs(&mut self, crs: &Crs, unit: Option<f64>) {
        let code = crs.code.filter(|&code| is_same(crs, code));
        match (crs.kind, code) {
            (CrsKind::Geographic, Some(code)) => {
                self.keys.short(MODEL_TYPE, 2);
                self.keys.short(GEODETIC_CRS, code);
            }
            // Made from an ellipsoid alone, which keys can say.
            (CrsKind::Geographic, None)
                if crs.ellipsoid.is_some_and(|body| crs.name == Crs::of_degrees(crs.title(), body).name) =>
            {
                self.keys.short(MODEL_TYPE, 2);
                self.keys.short(GEODETIC_CRS, USER_DEFINED);
                self.keys.short(GEODETIC_DATUM, USER_DEFINED);
                self.keys.short(ANGULAR_UNITS, DEGREE);
                self.keys.text(GEODETIC_CITATION, crs.title());
                if let Some(Body { axis, inverse_flattening }) = crs.ellipsoid {
                    self.keys.short(ELLIPSOID, USER_DEFINED);
                    self.keys.double(SEMI_MAJOR_AXIS, axis);
                    self.keys.double(INVERSE_FLATTENING, inverse_flattening);
                }
            }
            (_, Some(code)) => {
                self.keys.short(MODEL_TYPE, 1);
                self.keys.short(PROJECTED_CRS, code);
                self.put_unit(crs, unit);
            }
            (_, None) if crs.name.contains('[') => {
                // The kind is in the text, where GDAL looks for it, too.
                self.keys.short(MODEL_TYPE, USER_DEFINED);
                self.put_text(&crs.name);
                self.put_unit(crs, unit);
            }
            (_, None) => {
                if !crs.name.is_empty() {
                    self.lose(&crs.name);
                }
                if unit.is_some() {
                    self.keys.short(MODEL_TYPE, 1);
                    self.keys.short(PROJECTED_CRS, USER_DEFINED);
                    self.put_unit(crs, unit);
                }
            }
        }
    }

    fn put_text(&mut self, name: &str) {
        if !self.keys.text(PROJECTED_CITATION, &format!("{WKT_CITATION}{name}")) {
            self.lose(name);
        }
    }

    #[cold]
    fn lose(&mut self, name: &str) {
        let name: String = name.chars().take(60).collect();
        self.notes.push(format!(
            "GeoTIFF has no room for the CRS {name}, which is lost; name it with --crs when you build the window"
        ));
    }

    /// Says the unit of coordinates, unless the system does.
    fn put_unit(&mut self, crs: &Crs, unit: Option<f64>) {
        let Some(metres) = unit.filter(|&unit| crs.unit != Some(unit)) else { return };
        match code_of(metres) {
            Some(code) => self.keys.short(LINEAR_UNITS, code),
            None => {
                self.keys.short(LINEAR_UNITS, USER_DEFINED);
                self.keys.double(LINEAR_UNIT_SIZE, metres);
            }
        }
    }

    /// Says the unit of heights, and their system, if that is its unit.
    fn put_heights(&mut self, crs: &Crs, metres: f64) {
        let unit = code_of(metres);
        if let Some(vertical) = &crs.vertical
            && let (Some(code), Some(own)) = (vertical.code, vertical.metres)
            && code_of(own) == unit
            && unit.is_some()
        {
            self.keys.short(VERTICAL_CRS, code);
        }
        self.keys.short(VERTICAL_UNITS, unit.unwrap_or(9001));
        self.metres = Some(metres).filter(|_| unit.is_none());
    }
}

/// The number in `EPSG:` and a number, as far as GeoTIFF has room for it.
fn code_in(name: &str) -> Option<u16> {
    name.strip_prefix("EPSG:")?.parse().ok().filter(|&code| code != USER_DEFINED)
}

/// Whether a number says the same as the system that has it; what nobody knows says nothing else.
fn is_same(crs: &Crs, code: u16) -> bool {
    match Crs::of_code(code.into()) {
        // Heights without a number are in the text alone.
        Ok(Some(known)) => {
            let says_heights =
                crs.vertical.as_ref().is_none_or(|vertical| vertical.code.is_some() || known.vertical.is_some());
            known.kind == crs.kind && known.unit == crs.unit && (crs.name.starts_with("EPSG:") || says_heights)
        }
        _ => crs.name.starts_with("EPSG:"),
    }
}

/// The system of degrees on a globe: that of WGS 84 for every globe as large as the earth.
fn globe(axis: f64, eccentricity: f64) -> Crs {
    // e^2 = f (2 - f).
    let flattening = 1.0 - (1.0 - eccentricity).sqrt();
    let inverse_flattening = if flattening > 0.0 { 1.0 / flattening } else { 0.0 };
    let crs = Crs::of_degrees("Unnamed globe", Body { axis, inverse_flattening });
    if crs.body().is_some() { crs } else { Crs::wgs84() }
}
