//! What a file tells about its grid before any height is read, completed by what was typed.

use std::path::Path;

use super::crs::{Crs, CrsKind};
use super::options::{Nodata, RasterOptions, SurfaceKind};
use super::{Parsed, grid_error};

/// The most columns of a grid: a row of them and what is made from it take 270 MB. The earth at a second of arc has
/// 1,296,000.
pub(super) const MAX_COLUMNS: u64 = 1 << 22;

/// A grid, as its file describes it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Header {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Where the samples are; none if the file does not say.
    pub place: Option<Georeference>,
    /// Whether the file has its columns from the east, and its rows from the south.
    pub turned: [bool; 2],
    /// Whether coordinates begin at the south-western sample, because nobody knows where that is.
    pub is_local: bool,
    /// The value of samples without data.
    pub nodata: Option<f64>,
    /// Whether somebody said that every number is a height.
    pub are_all_heights: bool,
    /// The coordinate reference system.
    pub crs: Crs,
    /// Metres in a unit of the heights, where it is known.
    pub vertical: Option<f64>,
    /// What the stored numbers are multiplied by, and what is added then.
    pub scale: [f64; 2],
    /// Whether the stored numbers have 32 bits, so that the value of samples without data is rounded like them.
    pub is_f32: bool,
    /// Whether the stored numbers are integers.
    pub is_integer: bool,
}

/// Where the samples of a grid are, in the units of its CRS. Rows go from north to south.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Georeference {
    /// The north-western sample. Where a pixel stands for an area, its sample is in the middle.
    pub first: [f64; 2],
    /// Distances of columns and of rows, both positive.
    pub spacing: [f64; 2],
}

impl Georeference {
    /// Refuses places and distances that no raster has.
    pub fn check(&self, path: &Path) -> Parsed<()> {
        let Self { first, spacing } = self;
        let reach = first.iter().chain(spacing).fold(0.0, |reach: f64, value| reach.max(value.abs()));
        if first.iter().all(|x| x.is_finite()) && spacing.iter().all(|&x| x > 0.0 && x.is_finite()) && reach < 1e12 {
            return Ok(());
        }
        let problem = format!(
            "has a wrong georeference: its first sample is at {first:?}, and samples are {spacing:?} apart; correct it, for \
             example with `gdal_edit -a_ullr`"
        );
        Err(grid_error(path, &problem))
    }
}

/// The rows of a file.
pub(super) trait HeightRows {
    /// Reads a row, as it is stored. Rows are asked for from north to south, each at most once.
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()>;
}

impl Header {
    /// A grid of which nothing else is known.
    pub fn new(size: [u32; 2]) -> Self {
        let crs = Crs::default();
        Self {
            size,
            place: None,
            turned: [false; 2],
            is_local: false,
            nodata: None,
            are_all_heights: false,
            crs,
            vertical: None,
            scale: [1.0, 0.0],
            is_f32: false,
            is_integer: false,
        }
    }

    /// Adds what was typed, and refuses what cannot be.
    pub fn complete(&mut self, path: &Path, options: &RasterOptions) -> Parsed<()> {
        let [columns, rows] = self.size.map(u64::from);
        if columns > MAX_COLUMNS {
            let problem = format!("has {columns} columns, but at most {MAX_COLUMNS} can be read; cut it into tiles");
            return Err(grid_error(path, &problem));
        }
        if columns < 2 || rows < 2 {
            let problem = format!(
                "has {columns} columns and {rows} rows, and a surface needs two of both; join it with its neighbours"
            );
            return Err(grid_error(path, &problem));
        }
        // The name that the file has itself says no more than the file.
        if let Some(crs) = options.crs.as_ref().filter(|&crs| *crs != self.crs.name) {
            let named = match (Crs::named(crs), options.unit) {
                (Ok(named), _) => named,
                // Whoever types the unit of its coordinates, too, knows what a system is that is not known here.
                (Err(remark), Some(unit)) => {
                    let remarks = vec![format!("{remark}; its coordinates are taken as lengths of {} m", unit.metres)];
                    Crs {
                        name: crs.clone(),
                        kind: CrsKind::Projected,
                        unit: Some(unit.metres),
                        remarks,
                        ..Crs::default()
                    }
                }
                (Err(problem), None) => return Err(grid_error(path, &format!("gets a --crs: {problem}"))),
            };
            let said = std::mem::replace(&mut self.crs, named);
            // A name tells less than keys do.
            self.crs.unit = self.crs.unit.or(said.unit);
            if self.crs.kind == CrsKind::Unknown {
                self.crs.kind = said.kind;
            }
            self.crs.vertical = self.crs.vertical.take().or(said.vertical);
        }
        if self.crs.unit.is_none() && self.crs.kind != CrsKind::Geographic {
            self.crs.unit = options.unit.map(|unit| unit.metres);
        }
        let of_system = self.crs.vertical.as_ref().and_then(|vertical| vertical.metres);
        self.vertical = options.vertical_unit.map(|unit| unit.metres).or(self.vertical).or(of_system);
        match options.nodata {
            Some(Nodata::Value(value)) => self.nodata = Some(value),
            Some(Nodata::None) => (self.nodata, self.are_all_heights) = (None, true),
            None => {}
        }
        if self.is_f32 {
            self.nodata = self.nodata.map(|value| f64::from(value as f32));
        }
        self.complete_place(path, options)
    }

    fn complete_place(&mut self, path: &Path, options: &RasterOptions) -> Parsed<()> {
        let typed = match (options.spacing, options.bounds) {
            (Some(_), Some(_)) => {
                return Err(grid_error(path, "gets its place by --spacing or by --bounds, not by both"));
            }
            (Some(spacing), None) => {
                let south = f64::from(self.size[1] - 1) * spacing;
                Some(("--spacing", Georeference { first: [0.0, south], spacing: [spacing; 2] }))
            }
            (None, Some([west, south, east, north])) => {
                let spacing = [(east - west) / f64::from(self.size[0]), (north - south) / f64::from(self.size[1])];
                let first = [west + 0.5 * spacing[0], north - 0.5 * spacing[1]];
                Some(("--bounds", Georeference { first, spacing }))
            }
            (None, None) => None,
        };
        match (self.place, typed) {
            (Some(_), Some((option, _))) => {
                return Err(grid_error(path, &format!("says itself where it is; omit {option}")));
            }
            (None, Some((option, place))) => (self.place, self.is_local) = (Some(place), option == "--spacing"),
            (None, None) => self.is_local = true,
            _ => {}
        }
        let Some(place @ Georeference { first, spacing }) = self.place else { return Ok(()) };
        place.check(path)?;
        if options.surface != SurfaceKind::Plane && self.crs.kind == CrsKind::Unknown && !self.is_local {
            // What is laid on a globe is in degrees; other numbers are refused below.
            self.crs.kind = CrsKind::Geographic;
        }
        if self.crs.kind == CrsKind::Geographic {
            self.check_degrees(path, first, spacing)?;
        }
        Ok(())
    }

    /// Refuses places that are not on a globe.
    fn check_degrees(&self, path: &Path, first: [f64; 2], spacing: [f64; 2]) -> Parsed<()> {
        let [east, south] =
            [first[0] + f64::from(self.size[0] - 1) * spacing[0], first[1] - f64::from(self.size[1] - 1) * spacing[1]];
        // A hundredth of a sample is rounding.
        let [slack_x, slack_y] = spacing.map(|spacing| 0.01 * spacing);
        let is_wide = east - first[0] > 360.0 + slack_x || first[0] < -540.0 || east > 900.0;
        if first[1] > 90.0 + slack_y || south < -90.0 - slack_y || is_wide {
            let problem = format!(
                "has a wrong georeference: in degrees its samples reach from {:.6} to {east:.6} east and from {south:.6} to {:.6} north, which \
                 is not on a globe; name the CRS that they are in with --crs, or correct the file",
                first[0], first[1]
            );
            return Err(grid_error(path, &problem));
        }
        Ok(())
    }
}
