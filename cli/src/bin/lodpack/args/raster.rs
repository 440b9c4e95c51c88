//! What can be said about rasters of heights.

use super::values::{Bounds, parse_choice, parse_length};
use clap::Args;
use lodpack_cli::import::raster::{HeightCode, Nodata, Ramp, RasterOptions, SurfaceKind};
use lodpack_cli::mesh::tolerance::Unit;
use std::path::PathBuf;

/// Where these options stand in the help.
pub const HEADING: &str = "Rasters of heights";

/// How a grid of heights becomes a surface.
#[derive(Args, Debug)]
#[command(next_help_heading = HEADING)]
pub struct RasterArgs {
    /// What a grid of heights is laid on.
    #[arg(long, default_value_t, value_parser = parse_choice(SurfaceKind::ALL))]
    pub surface: SurfaceKind,
    /// Radius of --surface sphere in metres, as 1737400 for the Moon. By default the mean radius of the earth.
    #[arg(long, value_name = "METRES", value_parser = parse_length)]
    pub radius: Option<f64>,
    /// Unit of the heights (m, ft, cm, ...). By default what the file says, else that of its coordinates or, in
    /// degrees, the metre.
    #[arg(long, value_name = "UNIT")]
    pub vertical_unit: Option<Unit>,
    /// The value of samples without data, in place of what the file says; none if all are heights. NaN never is one.
    #[arg(long, value_name = "V|none", allow_hyphen_values = true)]
    pub nodata: Option<Nodata>,
    /// Distance of samples, for files that do not say where they are.
    #[arg(long, value_name = "LENGTH", value_parser = parse_length)]
    pub spacing: Option<f64>,
    /// Edges of the grid in its CRS, half a sample outside of its first and last samples, for files that do not say
    /// where they are: -180,-90,180,90 for all of a globe.
    #[arg(long, value_name = "W,S,E,N", allow_hyphen_values = true)]
    pub bounds: Option<Bounds>,
    /// What the pixels of a PNG mean.
    #[arg(long, default_value_t, value_parser = parse_choice(HeightCode::ALL))]
    pub height_code: HeightCode,
    /// An image over the grid, which becomes its colour: a GeoTIFF where it says it is, another image over the whole
    /// grid. Over heights it keeps its own pixels, and may be transparent in parts.
    #[arg(long, value_name = "IMAGE", conflicts_with = "ramp")]
    pub drape: Option<PathBuf>,
    /// A grid of how far the geoid lies above the ellipsoid (.gtx or GeoTIFF, as egm96_15.gtx), for heights above the
    /// sea: they become heights above the ellipsoid.
    #[arg(long, value_name = "GRID")]
    pub geoid: Option<PathBuf>,
    /// Colours by height: earth (seas blue, lowlands green, mountains brown and white, with the shore at height 0),
    /// grey (black to white) or viridis (violet to yellow); or a file of lines 'height red green blue', as gdaldem
    /// color-relief takes it.
    #[arg(long, value_name = "NAME|FILE")]
    pub ramp: Option<Ramp>,
}

impl RasterArgs {
    /// What was typed.
    pub fn options(&self) -> RasterOptions {
        let &Self { surface, radius, vertical_unit, nodata, spacing, height_code, .. } = self;
        let (bounds, ramp) = (self.bounds.map(|bounds| bounds.0), self.ramp.clone());
        let (drape, geoid) = (self.drape.clone(), self.geoid.clone());
        RasterOptions {
            surface,
            radius,
            vertical_unit,
            nodata,
            spacing,
            bounds,
            height_code,
            drape,
            geoid,
            ramp,
            ..RasterOptions::default()
        }
    }
}
