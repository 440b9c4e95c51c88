//! What a raster cannot say itself, or what somebody wants otherwise.

use std::path::PathBuf;

use lodpack::heights::Base;
use lodpack::index::Placement;
use serde::{Deserialize, Serialize};

use super::ramp::Ramp;
use crate::named::named;
use lodpack_mesh::tolerance::Unit;

/// How rasters become surfaces.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct RasterOptions {
    /// What the grid is laid on.
    pub surface: SurfaceKind,
    /// Radius of the sphere in metres. By default the mean radius of the earth.
    pub radius: Option<f64>,
    /// Unit of the heights. By default what the file says, else that of the coordinates or, in degrees, the metre.
    pub vertical_unit: Option<Unit>,
    /// Unit of the coordinates, where the file does not say it.
    pub unit: Option<Unit>,
    /// Which value means that a sample has no data, in place of what the file says.
    pub nodata: Option<Nodata>,
    /// Distance of samples in files that do not say where they are.
    pub spacing: Option<f64>,
    /// West, south, east and north edge of files that do not say where they are.
    pub bounds: Option<[f64; 4]>,
    /// The coordinate reference system, in place of what the file says.
    pub crs: Option<String>,
    /// What is taken off coordinates; for degrees on a plane, where it touches the globe.
    pub origin: Option<[f64; 3]>,
    /// What the pixels of a PNG mean.
    pub height_code: HeightCode,
    /// An image over the surface.
    pub drape: Option<PathBuf>,
    /// A grid of how far the geoid, which heights are above, lies above the ellipsoid.
    pub geoid: Option<PathBuf>,
    /// Colours by height.
    pub ramp: Option<Ramp>,
    /// Whether the inputs are rasters. A build finds out; nobody has to say it.
    pub is_used: bool,
}

impl RasterOptions {
    /// Whether everything is as rasters say it.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Completed by what a file says that was built from rasters, so that they become the same coordinates again.
    pub fn like_file(self, placement: Option<&Placement>) -> Self {
        let Some(Placement { unit, origin, crs, .. }) = placement else { return self };
        let is_earth = crs == "EPSG:4978" && self.surface == SurfaceKind::Plane;
        let surface = if is_earth { SurfaceKind::Wgs84 } else { self.surface };
        let is_plane = surface == SurfaceKind::Plane;
        Self {
            surface,
            crs: self.crs.or(Some(crs.clone()).filter(|crs| is_plane && !crs.is_empty())),
            origin: self.origin.or(Some(*origin).filter(|origin| *origin != [0.0; 3])),
            unit: self.unit.or(unit.map(|metres| Unit { metres })),
            ..self
        }
    }
}

impl RasterOptions {
    /// [`Self::like_file`] for a file of heights, which says what it is laid on.
    pub fn like_heights(self, surface: &lodpack::heights::Surface, placement: Option<&Placement>) -> Self {
        let kind = match surface.base {
            Base::Plane => SurfaceKind::Plane,
            Base::Ellipsoid { eccentricity: 0.0, .. } => SurfaceKind::Sphere,
            Base::Ellipsoid { .. } => SurfaceKind::Wgs84,
        };
        Self { surface: kind, ..self }.like_file(placement)
    }
}

/// What a grid is laid on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum SurfaceKind {
    /// A plane: x to the east, y to the north, z up.
    #[default]
    Plane,
    /// A sphere around the origin.
    Sphere,
    /// The ellipsoid of WGS 84 around the origin.
    Wgs84,
}

/// What rasters become.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RasterForm {
    /// Heights, unless something is asked for that only meshes have.
    #[default]
    Auto,
    /// A file of heights: the grid stays.
    Heights,
    /// Triangles.
    Mesh,
}

/// Which value means that a sample has no data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Nodata {
    /// This one.
    Value(f64),
    /// None: whatever the file says, all are heights.
    None,
}

/// What the pixels of a PNG mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum HeightCode {
    /// Shades of grey are heights.
    #[default]
    Grey,
    /// 256 x red + green + blue / 256 - 32768 metres, as in Terrarium tiles.
    Terrarium,
}

impl SurfaceKind {
    /// Name, kind and description of each.
    pub const ALL: [(&str, Self, &str); 3] = [
        ("plane", Self::Plane, "A plane in the units of the CRS; degrees become metres to the east and the north"),
        ("sphere", Self::Sphere, "A sphere, in metres from its centre"),
        ("wgs84", Self::Wgs84, "The ellipsoid of WGS 84, in metres from the centre of the earth (EPSG:4978)"),
    ];
}

impl RasterForm {
    /// Name, form and description of each.
    pub const ALL: [(&str, Self, &str); 3] = [
        ("auto", Self::Auto, "Heights, unless an option is typed that only meshes have"),
        ("heights", Self::Heights, "A height for each sample: smaller, and built many times faster"),
        ("mesh", Self::Mesh, "Irregular triangles: fewer of them for the same error"),
    ];
}

impl HeightCode {
    /// Name, code and description of each.
    pub const ALL: [(&str, Self, &str); 2] = [
        ("grey", Self::Grey, "Shades of grey, 8 or 16 bits"),
        ("terrarium", Self::Terrarium, "Colours: 256 x red + green + blue / 256 - 32768 metres"),
    ];
}

named!(SurfaceKind, HeightCode, RasterForm);

impl std::str::FromStr for Nodata {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.trim() {
            "none" => Ok(Self::None),
            number => match number.parse::<f64>() {
                Ok(value) => Ok(Self::Value(value)),
                Err(_) => Err(format!("write a number such as -9999, or none, not '{text}'")),
            },
        }
    }
}
