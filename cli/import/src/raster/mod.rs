//! Rasters: grids of heights become triangles. Rows are read from north to south and handed on, so memory holds a few
//! of them whatever the size of the grid.
//!
//! `header` says what a file tells about its grid; a file a format (`tiff`, `hgt`, `asc`, `bil`, `envi`, `png`, `exr`,
//! `lerc`, `gtx`) reads headers and rows; `affine`, `crs`, `mask` and `pam` read what lies beside it. `mosaic` joins
//! files whose grids agree, `surface` knows where a sample is on a plane, a sphere or the ellipsoid, and `triangulate`
//! makes vertices and triangles. `drape` adds colours (`over_heights` to
//! heights that stay a grid), and `geoid` the height of the geoid.

mod affine;
mod asc;
mod bil;
mod crs;
mod drape;
mod envi;
mod exr;
mod flat;
mod geoid;
pub mod geokeys;
mod gtx;
mod header;
mod heights;
mod hgt;
mod keyed;
pub mod lengths;
mod lerc;
mod lines;
mod mask;
mod mosaic;
mod options;
mod over_heights;
mod pam;
mod png;
mod ramp;
mod sidecar;
mod surface;
mod tiff;
mod triangulate;
mod wkt;

use std::path::{Path, PathBuf};

use lodpack::index::{Placement, UpAxis};

use super::error::{ImportError, Parsed};
use super::sink::MeshSink;
use super::source::FileBytes;
use lodpack_mesh::images::tiff_directory::is_tiff;
use lodpack_mesh::tolerance::Unit;
use lodpack_runtime::progress::{Progress, Silent};

use affine::{Turned, of_world_file, placed};
pub use crs::{Body, Crs, CrsKind, is_known_epsg};
use header::{Header, HeightRows};
pub use heights::HeightSource;
use mosaic::Mosaic;
pub use options::{HeightCode, Nodata, RasterForm, RasterOptions, SurfaceKind};
pub use over_heights::{HeightDrape, Pixels};
use pam::Pam;
pub use ramp::Ramp;
use surface::Surface;
pub use surface::metres_in_degree;

/// Formats of rasters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RasterFormat {
    Tiff,
    Hgt,
    Asc,
    /// Rows of numbers beside a header in a text file.
    Bil,
    Png,
    Exr,
    Lerc,
    Gtx,
}

/// What a raster says about the coordinates that it becomes.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterPlace {
    /// The unit of the coordinates, where it is known.
    pub unit: Option<Unit>,
    /// Where the surface is in the world.
    pub placement: Placement,
}

/// The format of a raster by its first bytes or, where these can be anything, by its name.
pub(super) fn detect(path: &Path, bytes: &[u8]) -> Option<RasterFormat> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    match bytes {
        _ if is_tiff(bytes) => return Some(RasterFormat::Tiff),
        [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => return Some(RasterFormat::Png),
        [0x76, 0x2f, 0x31, 1, ..] => return Some(RasterFormat::Exr),
        _ if lerc::MAGICS.iter().any(|magic| bytes.starts_with(magic)) => return Some(RasterFormat::Lerc),
        _ => {}
    }
    match extension.as_str() {
        "tif" | "tiff" => Some(RasterFormat::Tiff),
        "png" => Some(RasterFormat::Png),
        "exr" => Some(RasterFormat::Exr),
        "lerc" | "lerc1" | "lerc2" | "lrc" => Some(RasterFormat::Lerc),
        "gtx" => Some(RasterFormat::Gtx),
        "hgt" => Some(RasterFormat::Hgt),
        "asc" => Some(RasterFormat::Asc),
        "bil" | "bip" | "bsq" | "flt" | "dem" | "raw" => Some(RasterFormat::Bil),
        // Other programs have these extensions, too.
        "img" | "dat" if envi::is_beside(path) => Some(RasterFormat::Bil),
        _ if asc::looks_like_asc(bytes) => Some(RasterFormat::Asc),
        _ => None,
    }
}

/// The format of a file that is a raster; none for other files and for what is no file.
pub(super) fn format_of(path: &Path) -> Option<RasterFormat> {
    let bytes = FileBytes::open(path).ok()?;
    // What names itself a mesh is one, whatever its extension says.
    if bytes.starts_with(b"ply") || bytes.starts_with(b"glTF") || bytes.starts_with(&lodpack::Opener::MAGIC) {
        return None;
    }
    detect(path, &bytes)
}

/// The header files and projections that belong to a raster.
pub(super) fn files_beside(path: &Path, format: RasterFormat) -> Vec<PathBuf> {
    let header = (format == RasterFormat::Bil).then(|| flat::header_of(path)).flatten();
    header.into_iter().chain(sidecars(path)).collect()
}

/// The files that say where a raster or an image is, and which samples of it count.
pub(super) fn sidecars(path: &Path) -> Vec<PathBuf> {
    let metadata = sidecar::with_suffix(path, pam::EXTENSION);
    [sidecar::with_extension(path, "prj"), affine::world_file(path), mask::beside(path), metadata]
        .into_iter()
        .flatten()
        .collect()
}

/// Opens a raster: what it says about its grid, and where its rows come from.
fn open(path: &Path, options: &RasterOptions) -> Parsed<(Header, Box<dyn HeightRows>)> {
    let format = format_of(path).ok_or_else(|| grid_error(path, "is no raster that can be read"))?;
    let with_masks = options.nodata != Some(Nodata::None);
    let (mut header, rows) = match format {
        RasterFormat::Tiff => tiff::open(path, with_masks)?,
        RasterFormat::Hgt => hgt::open(path)?,
        RasterFormat::Asc => asc::open(path)?,
        RasterFormat::Bil => bil::open(path)?,
        RasterFormat::Png => png::open(path, options.height_code, with_masks)?,
        RasterFormat::Exr => exr::open(path)?,
        RasterFormat::Lerc => lerc::open(path)?,
        RasterFormat::Gtx => gtx::open(path)?,
    };
    // Of a TIFF it has been added already, because there it counts more than the file's own tags.
    let pam = if format == RasterFormat::Tiff { Pam::default() } else { Pam::beside(path)? };
    pam.add_to(&mut header, false);
    if header.place.is_none() {
        (header.place, header.turned) = placed(of_world_file(path)?.or(pam.place), path, header.size)?;
    }
    if header.crs.says_nothing() {
        header.crs = header.crs.or(Crs::beside(path)?).or(pam.crs);
    }
    header.complete(path, options)?;
    if header.turned[1] && matches!(format, RasterFormat::Png | RasterFormat::Asc) {
        let problem = "has its first row in the south by its world file, and is read from its first row on; turn it over, with `gdalwarp`";
        return Err(grid_error(path, problem));
    }
    let rows = if with_masks { mask::masked(path, header.size, rows)? } else { rows };
    let rows = Turned::over(rows, header.turned, header.size[1]);
    Ok((header, rows))
}

/// What inputs that are rasters say about their coordinates; none if the inputs are meshes.
///
/// # Errors
/// If a raster cannot be read, rasters do not fit together, or they are mixed with meshes.
pub fn survey(paths: &[PathBuf], options: &RasterOptions) -> Result<Option<RasterPlace>, ImportError> {
    if !are_rasters(paths)? {
        return Ok(None);
    }
    let mosaic = Mosaic::open(paths, options)?;
    let surface = Surface::new(&mosaic, options, &Silent)?;
    let unit = surface.unit();
    let (crs, origin) = surface.crs_and_origin(&mosaic);
    let placement = Placement { up: UpAxis::Z, unit: unit.map(|unit| unit.metres), origin, crs };
    Ok(Some(RasterPlace { unit, placement }))
}

/// Whether a file is a raster.
#[must_use]
pub fn is_raster(path: &Path) -> bool {
    format_of(path).is_some()
}

/// Whether the inputs are rasters.
///
/// # Errors
/// If only some of them are.
pub(super) fn are_rasters(paths: &[PathBuf]) -> Parsed<bool> {
    let is_raster: Vec<bool> = paths.iter().map(|path| format_of(path).is_some()).collect();
    match (is_raster.iter().position(|&is| is), is_raster.iter().position(|&is| !is)) {
        (Some(_), None) => Ok(true),
        (Some(raster), Some(other)) if paths[other].exists() => Err(grid_error(
            &paths[raster],
            &format!(
                "is a raster, and {} is not: rasters and meshes cannot become one surface; build a file of each, or give the rasters with --ground, and the meshes stand on them",
                paths[other].display()
            ),
        )),
        _ => Ok(false),
    }
}

/// Reads rasters as one mosaic.
pub(super) fn read_rasters(
    paths: &[PathBuf],
    options: &RasterOptions,
    sink: &mut MeshSink,
    progress: &dyn Progress,
) -> Parsed<()> {
    let mosaic = Mosaic::open(paths, options)?;
    let surface = Surface::new(&mosaic, options, progress)?;
    triangulate::triangulate(mosaic, surface, options, sink, progress)?;
    let path = paths.first().map_or(Path::new(""), |path| path.as_path());
    if sink.triangle_count() == 0 {
        let problem = "no four neighbouring samples have heights, so there is no triangle: all are without data, or the grid is one row or \
                       column; check --nodata";
        return Err(grid_error(path, problem));
    }
    sink.end_file(path)
}

/// An error about a grid as a whole.
#[cold]
fn grid_error(path: &Path, problem: &str) -> Box<ImportError> {
    ImportError::Grid { path: path.to_owned(), problem: problem.to_owned() }.into()
}
