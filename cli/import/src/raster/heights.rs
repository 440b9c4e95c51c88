//! Rasters as a grid of heights, for files that keep the grid.

use std::path::PathBuf;

use lodpack::heights::{Grid, RampStop, Surface as HeightSurface};
use lodpack::index::{Placement, UpAxis};

use super::mosaic::Mosaic;
use super::options::{RasterOptions, SurfaceKind};
use super::over_heights::HeightDrape;
use super::surface::Surface;
use super::{are_rasters, grid_error};
use crate::ImportError;
use lodpack_mesh::tolerance::Unit;
use lodpack_runtime::progress::Progress;

/// Rasters that are one grid of heights.
pub struct HeightSource {
    mosaic: Mosaic,
    options: RasterOptions,
    /// Rows that the grid has before and behind those of the files: poles.
    caps: [bool; 2],
    /// Where its samples are among its tiles.
    pub grid: Grid,
    /// Where they are in space.
    pub surface: HeightSurface,
    /// What is added to heights.
    pub zero: f64,
    /// The unit of coordinates, where it is known.
    pub unit: Option<Unit>,
    /// Where the surface is in the world.
    pub placement: Placement,
    /// The image over it.
    pub drape: Option<HeightDrape>,
}

impl HeightSource {
    /// Opens rasters, and says where they lie; none if the inputs are meshes.
    ///
    /// # Errors
    /// If a raster cannot be read, rasters do not fit together, or they are mixed with meshes.
    pub fn open(
        paths: &[PathBuf],
        options: &RasterOptions,
        progress: &dyn Progress,
    ) -> Result<Option<Self>, ImportError> {
        if !are_rasters(paths)? {
            return Ok(None);
        }
        let mosaic = Mosaic::open(paths, options)?;
        if options.surface != SurfaceKind::Plane && options.origin.is_some_and(|origin| origin != [0.0; 3]) {
            let problem = "is laid on a globe, around whose centre a file of heights always lies; omit --origin";
            return Err(*grid_error(mosaic.path(), problem));
        }
        let surface = Surface::new(&mosaic, options, progress)?;
        let (place, zero) = surface.of_heights(&mosaic);
        let caps = surface.caps().map(|cap| cap.is_some());
        let north = u64::from(caps[0]);
        let drape = options.drape.as_ref().map(|drape| HeightDrape::open(&mosaic, drape, north, progress));
        let drape = drape.transpose()?;
        let [columns, rows] = mosaic.size;
        let wraps = mosaic.is_closed;
        let rows = rows - 1 + caps.iter().map(|&cap| u64::from(cap)).sum::<u64>();
        let grid = Grid::new([columns - u64::from(!wraps), rows], wraps, surface.poles(&mosaic));
        let grid = grid.map_err(|error| *grid_error(mosaic.path(), &format!("is too large: {error}")))?;
        let unit = surface.unit();
        let (crs, origin) = surface.crs_and_origin(&mosaic);
        let placement = Placement { up: UpAxis::Z, unit: unit.map(|unit| unit.metres), origin, crs };
        let options = options.clone();
        Ok(Some(Self { mosaic, options, caps, grid, surface: place, zero, unit, placement, drape }))
    }

    /// Colours by height, for heights in this range, and their name.
    ///
    /// # Errors
    /// [`lodpack::Error::Model`] if the ramp does not fit.
    pub fn ramp(&self, range: [f64; 2]) -> lodpack::Result<Option<(lodpack::heights::Ramp, String)>> {
        let Some(ramp) = &self.options.ramp else { return Ok(None) };
        let metres = self.mosaic.metres_of_heights();
        // Heights in the file are those of the raster with `zero` added.
        let over = ramp.over(range.map(|height| height - self.zero), metres)?;
        let moved = over.stops().iter().map(|stop| RampStop { height: stop.height + self.zero, ..*stop });
        Ok(Some((lodpack::heights::Ramp::new(moved.collect())?, ramp.name.clone())))
    }

    /// Whether all heights are integers.
    pub fn is_integer(&self) -> bool {
        // A pole has the mean of its row.
        self.mosaic.is_integer() && self.grid.poles() == [false; 2]
    }

    /// The first file, for messages.
    pub fn path(&self) -> &std::path::Path {
        self.mosaic.path()
    }

    /// Hands on all rows from north to south, less the height of the origin, with NaN where there are no heights; poles
    /// have one height. Returns how many samples no file covers, and how many have no data.
    ///
    /// # Errors
    /// If a file cannot be read, or what `with` returns.
    pub fn for_each_row<E: From<ImportError>>(
        &self,
        mut with: impl FnMut(u64, &[f64]) -> Result<(), E>,
    ) -> Result<[u64; 2], E> {
        let columns = self.mosaic.size[0] as usize;
        let [north, south] = self.caps;
        let empty = vec![f64::NAN; columns];
        let (mut next, mut last, mut failure) = (0, vec![], None);
        let shift = u64::from(north);
        let is_pole = self.grid.poles();
        let last_row = self.grid.cells()[1];
        let mut moved = vec![];
        let mut hand_on = |row: u64, heights: &[f64]| {
            let at_pole = row == 0 && is_pole[0] || row == last_row && is_pole[1];
            if !at_pole && self.zero == 0.0 {
                return with(row, heights);
            }
            moved.clear();
            match at_pole {
                true => moved.resize(columns, mean(heights) + self.zero),
                false => moved.extend(heights.iter().map(|height| height + self.zero)),
            }
            with(row, &moved)
        };
        let absent = self.mosaic.for_each_row(&self.options, |number, heights| {
            let mut rows = || {
                if number == 0 && north {
                    hand_on(0, heights)?;
                }
                while next < number {
                    hand_on(next + shift, &empty)?;
                    next += 1;
                }
                next = number + 1;
                if south && number + 1 == self.mosaic.size[1] {
                    last = heights.to_vec();
                }
                hand_on(number + shift, heights)
            };
            rows().map_err(|error| {
                failure = Some(error);
                grid_error(self.mosaic.path(), "is not read further")
            })
        });
        if let Some(failure) = failure {
            return Err(failure);
        }
        let absent = absent.map_err(|error| *error)?;
        while next < self.mosaic.size[1] {
            hand_on(next + shift, &empty)?;
            next += 1;
        }
        if south {
            hand_on(next + shift, &last)?;
        }
        Ok([absent.uncovered, absent.nodata])
    }

    /// What is wrong if no cell can be drawn.
    pub fn without_cells(&self) -> ImportError {
        *grid_error(self.path(), "has no cell whose four samples have data; check --nodata")
    }

    /// Says what is missing.
    ///
    /// # Errors
    /// If everything is.
    pub fn note_absent(&self, [uncovered, nodata]: [u64; 2], progress: &dyn Progress) -> Result<(), ImportError> {
        let total = self.mosaic.size[0] * self.mosaic.size[1];
        let note = |text: String| progress.note(&format!("{}: {text}", self.path().display()));
        if uncovered + nodata == total {
            return Err(*grid_error(self.path(), "has no data in any sample; check --nodata"));
        }
        if uncovered > 0 {
            note(format!("{uncovered} of {total} samples of the grid are in no file: gaps stay open"));
        }
        if nodata > 0 {
            note(format!("{nodata} of {total} samples have no data, and no cell touches them"));
        }
        Ok(())
    }
}

/// The mean of the heights that there are; NaN if there are none.
fn mean(heights: &[f64]) -> f64 {
    let known = heights.iter().filter(|height| !height.is_nan());
    let (sum, count) = known.fold((0.0, 0u64), |(sum, count), height| (sum + height, count + 1));
    if count > 0 { sum / count as f64 } else { f64::NAN }
}
