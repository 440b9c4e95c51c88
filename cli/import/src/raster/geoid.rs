//! Heights above the geoid become heights above the ellipsoid: a grid says how far the geoid lies above it.
//!
//! Rows of the grid are read along with those of the heights, so that memory holds two of them.

use std::path::{Path, PathBuf};

use super::crs::CrsKind;
use super::header::{Georeference, Header, HeightRows};
use super::mosaic::{Mosaic, clean};
use super::options::RasterOptions;
use super::{ImportError, Parsed, grid_error, open};

/// Heights may lie this far outside of the grid's outermost samples, in samples: half of one is what pixels that are
/// areas leave out at a pole.
const OUTSIDE: f64 = 0.501;

/// A grid of the geoid, and where heights lie in it.
pub(super) struct Geoid {
    path: PathBuf,
    header: Header,
    place: Georeference,
    /// Columns around the globe, if there is one for each.
    around: Option<f64>,
    rows: Box<dyn HeightRows>,
    /// The row last read and the one before, with its number.
    kept: [Vec<f64>; 2],
    read: Option<u32>,
    /// Where the heights are.
    heights: Georeference,
    /// Metres in a unit of the heights.
    vertical: f64,
}

impl Geoid {
    /// Opens a grid that has to cover all heights of a mosaic.
    pub fn open(path: &Path, mosaic: &Mosaic) -> Parsed<Self> {
        if mosaic.crs.kind != CrsKind::Geographic {
            let problem = "gets a --geoid, which is a grid of degrees, and its samples are not in degrees; bring them into \
                           longitudes and latitudes first, with `gdalwarp -t_srs EPSG:4326`";
            return Err(grid_error(mosaic.path(), problem));
        }
        let (header, rows) = open(path, &RasterOptions::default())?;
        let place = match header.place {
            Some(place) if matches!(header.crs.kind, CrsKind::Geographic | CrsKind::Unknown) => place,
            _ => {
                let problem = "is no grid of a geoid: its samples have to lie in longitudes and latitudes, as those of egm96_15.gtx do";
                return Err(grid_error(path, problem));
            }
        };
        let count = 360.0 / place.spacing[0];
        let is_closed = (count - count.round()).abs() < 1e-3 && f64::from(header.size[0]) >= count.round();
        let geoid = Self {
            path: path.to_owned(),
            kept: [0, 1].map(|_| vec![f64::NAN; header.size[0] as usize]),
            around: is_closed.then_some(count.round()),
            header,
            place,
            rows,
            read: None,
            heights: mosaic.place,
            vertical: mosaic.vertical.unwrap_or(1.0),
        };
        let last = [0, 1].map(|axis| mosaic.size[axis] - 1);
        let is_covered = |column: u64, row: u64| geoid.column(column).is_some() && geoid.row(row).is_some();
        if !is_covered(0, 0) || !is_covered(last[0], last[1]) {
            let problem = format!("does not cover all of {}; name a grid of the whole globe", mosaic.path().display());
            return Err(grid_error(path, &problem));
        }
        Ok(geoid)
    }

    /// Adds the height of the geoid to a row of heights. Rows come from north to south.
    pub fn add(&mut self, row: u64, heights: &mut [f64]) -> Parsed<()> {
        let Some(at) = self.row(row) else { return Err(self.gap([0, row])) };
        let last = self.header.size[1] - 1;
        let above = (at as u32).min(last - 1);
        for wanted in [above, above + 1] {
            if self.read.is_none_or(|read| read < wanted) {
                self.kept.swap(0, 1);
                self.rows.read(wanted, &mut self.kept[1])?;
                clean(&self.header, &mut self.kept[1]);
                self.read = Some(wanted);
            }
        }
        let down = at - f64::from(above);
        let metres = self.header.vertical.unwrap_or(1.0) / self.vertical;
        for (column, height) in heights.iter_mut().enumerate().filter(|(_, height)| !height.is_nan()) {
            let missing = [column as u64, row];
            let Some([west, east, along]) = self.column(missing[0]) else { return Err(self.gap(missing)) };
            let [north, south] = [&self.kept[0], &self.kept[1]].map(|row| {
                let [west, east] = [row[west as usize], row[east as usize]];
                west + (east - west) * along
            });
            let undulation = north + (south - north) * down;
            if undulation.is_nan() {
                return Err(self.gap(missing));
            }
            *height += undulation * metres;
        }
        Ok(())
    }

    /// The rows from the first one to a row of heights; none outside of the grid.
    fn row(&self, row: u64) -> Option<f64> {
        let latitude = self.heights.first[1] - row as f64 * self.heights.spacing[1];
        let at = (self.place.first[1] - latitude) / self.place.spacing[1];
        within(at, self.header.size[1])
    }

    /// The columns to both sides of a column of heights, and how far from the first to the second it lies.
    fn column(&self, column: u64) -> Option<[f64; 3]> {
        let longitude = self.heights.first[0] + column as f64 * self.heights.spacing[0];
        let at = (longitude - self.place.first[0]).rem_euclid(360.0) / self.place.spacing[0];
        if let Some(around) = self.around {
            let west = at.floor();
            return Some([west % around, (west + 1.0) % around, at - west]);
        }
        // A little west of the first column is nearly once around.
        let before = at - 360.0 / self.place.spacing[0];
        let at = within(at, self.header.size[0]).or_else(|| within(before, self.header.size[0]))?;
        let west = at.floor().min(f64::from(self.header.size[0] - 2));
        Some([west, west + 1.0, at - west])
    }

    #[cold]
    fn gap(&self, [column, row]: [u64; 2]) -> Box<ImportError> {
        let Georeference { first, spacing } = self.heights;
        let [x, y] = [first[0] + column as f64 * spacing[0], first[1] - row as f64 * spacing[1]];
        let problem = format!(
            "says nothing of the geoid at {x:.6} east, {y:.6} north, where there is a height; name another grid"
        );
        grid_error(&self.path, &problem)
    }
}

/// A place among a number of samples, moved onto the outermost ones if it is a little outside.
fn within(at: f64, count: u32) -> Option<f64> {
    let last = f64::from(count - 1);
    (-OUTSIDE..=last + OUTSIDE).contains(&at).then(|| at.clamp(0.0, last))
}
