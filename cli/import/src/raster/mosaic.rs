//! Files whose grids agree, as one grid. Tiles may continue each other or share rows and columns, where their heights
//! must agree; what no tile covers has no data.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use super::crs::{Crs, CrsKind};
use super::geoid::Geoid;
use super::header::{Georeference, Header, HeightRows, MAX_COLUMNS};
use super::options::{RasterOptions, SurfaceKind};
use super::{ImportError, Parsed, grid_error, open};

/// How far grids may be off from each other, in samples: files round their corners, and half a sample is the seam of
/// files that do not agree on whether a pixel is an area or a point.
const ALIGNED: f64 = 0.05;
/// How far heights of two tiles may differ where both have the same sample, as a share.
const AGREE: f64 = 1e-6;

/// A file in the mosaic.
struct Tile {
    path: PathBuf,
    header: Header,
    /// Its north-western sample, in samples of the mosaic.
    at: [u64; 2],
}

/// A tile whose rows are being read.
struct OpenTile {
    number: usize,
    rows: Box<dyn HeightRows>,
}

/// All files as one grid.
pub(super) struct Mosaic {
    tiles: Vec<Tile>,
    /// Columns and rows.
    pub size: [u64; 2],
    /// Where its samples are. Files that do not say it have a spacing of 1.
    pub place: Georeference,
    /// Whether the file or somebody has said how far samples are apart.
    pub is_placed: bool,
    /// Whether coordinates begin at the south-western sample, because nobody has said where that is.
    pub is_local: bool,
    /// The system of all files.
    pub crs: Crs,
    /// Metres in a unit of the heights, where it is known.
    pub vertical: Option<f64>,
    /// Whether the last column is followed by the first one: the grid goes around the globe.
    pub is_closed: bool,
    /// The grid of the geoid that heights are above.
    pub geoid: Option<PathBuf>,
}

/// Samples of a mosaic that have no heights, by reason.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Absent {
    /// Those that no file covers.
    pub uncovered: u64,
    /// Those that a file covers, without data.
    pub nodata: u64,
}

impl Mosaic {
    /// Reads the headers of all files, and puts them together.
    pub fn open(paths: &[PathBuf], options: &RasterOptions) -> Parsed<Self> {
        let headers = paths.iter().map(|path| Ok((path.clone(), open(path, options)?.0)));
        let mut headers = headers.collect::<Parsed<Vec<_>>>()?;
        // From the west, so that the order in which files are named does not matter.
        headers.sort_by(|(_, a), (_, b)| {
            let key = |header: &Header| header.place.map_or([0.0; 2], |place| [place.first[0], -place.first[1]]);
            let ([a, b], [c, d]) = (key(a), key(b));
            a.total_cmp(&c).then(b.total_cmp(&d))
        });
        let Some((path, first)) = headers.first() else { return Err(ImportError::NoInput.into()) };
        if let [_, (second, _), ..] = &headers[..]
            && let Some((path, _)) = headers.iter().find(|(_, header)| header.place.is_none())
        {
            let other = if path == second { &headers[0].0 } else { second };
            let problem = format!(
                "does not say where it is, so it cannot be joined with {}; build a file of each",
                other.display()
            );
            return Err(grid_error(path, &problem));
        }
        let is_placed = first.place.is_some();
        let place = first.place.unwrap_or_else(|| {
            // The south-western sample is the origin.
            Georeference { first: [0.0, f64::from(first.size[1] - 1)], spacing: [1.0; 2] }
        });
        let (mut crs, vertical, is_local) = (first.crs.clone(), first.vertical, first.is_local);
        let around = around(&crs, place.spacing[0]);
        let offsets = headers.iter().map(|(other, header)| {
            check_alike([path, other], [first, header])?;
            offset([path, other], place, header, around)
        });
        let mut offsets = offsets.collect::<Parsed<Vec<[i64; 2]>>>()?;
        let widths: Vec<i64> = headers.iter().map(|(_, header)| i64::from(header.size[0])).collect();
        let is_globe = options.surface != SurfaceKind::Plane;
        let mut columns = None;
        if let Some(around) = around {
            let gap = largest_gap(&offsets, &widths, around);
            if gap.1 == 0 && is_globe {
                columns = Some(around);
            }
            // Begin behind the largest gap, so that tiles on both sides of the date line lie beside each other.
            offsets.iter_mut().for_each(|[column, _]| *column = (*column - gap.0).rem_euclid(around));
        }
        let west = if columns.is_some() { 0 } else { offsets.iter().map(|[column, _]| *column).min().unwrap_or(0) };
        let north = offsets.iter().map(|[_, row]| *row).min().unwrap_or(0);
        let east = offsets.iter().zip(&widths).map(|([column, _], width)| column + width).max().unwrap_or(0);
        let south =
            offsets.iter().zip(&headers).map(|([_, row], (_, of))| row + i64::from(of.size[1])).max().unwrap_or(0);
        let size = [columns.unwrap_or(east - west) as u64, (south - north) as u64];
        if size[0] > MAX_COLUMNS || size[1] > u64::from(u32::MAX) {
            let problem = format!(
                "with all files the grid has {} columns and {} rows, but at most {MAX_COLUMNS} columns can be read: files that lie far \
                 apart need a build of their own",
                size[0], size[1]
            );
            return Err(grid_error(path, &problem));
        }
        let mut spacing = place.spacing;
        if columns.is_some() {
            // Rounded as files have it, the last column would not meet the first one.
            spacing[0] = 360.0 / size[0] as f64;
        }
        // The offset of the first file says where the mosaic begins.
        let [column, row] = [offsets[0][0] - west, offsets[0][1] - north].map(|count| count as f64);
        let begin = [place.first[0] - column * spacing[0], place.first[1] + row * spacing[1]];
        let tiles = headers.into_iter().zip(&offsets).map(|((path, header), [column, row])| Tile {
            path,
            header,
            at: [(column - west) as u64, (row - north) as u64],
        });
        let mut tiles: Vec<Tile> = tiles.collect();
        for remark in tiles.iter().flat_map(|tile| &tile.header.crs.remarks) {
            if !crs.remarks.contains(remark) {
                crs.remarks.push(remark.clone());
            }
        }
        tiles.sort_by_key(|tile| tile.at[1]);
        let place = Georeference { first: begin, spacing };
        let (is_closed, geoid) = (columns.is_some(), options.geoid.clone());
        let mosaic = Self { tiles, size, place, is_placed, is_local, crs, vertical, is_closed, geoid };
        mosaic.open_geoid()?;
        Ok(mosaic)
    }

    /// The first file, for messages.
    pub fn path(&self) -> &Path {
        self.tiles.first().map_or(Path::new(""), |tile| &tile.path)
    }

    /// Metres in a unit of the heights, as far as it is known.
    pub fn metres_of_heights(&self) -> Option<f64> {
        self.vertical.or(if self.crs.kind == CrsKind::Geographic { Some(1.0) } else { self.crs.unit })
    }

    fn open_geoid(&self) -> Parsed<Option<Geoid>> {
        self.geoid.as_ref().map(|path| Geoid::open(path, self)).transpose()
    }

    /// Whether all heights are integers.
    pub fn is_integer(&self) -> bool {
        self.geoid.is_none() && self.tiles.iter().all(|tile| tile.header.is_integer && tile.header.scale == [1.0, 0.0])
    }

    /// Hands on the rows from north to south, with NaN where there are no heights. Runs of rows without a file are
    /// handed on as one row of NaN, with the row's number.
    pub fn for_each_row(
        &self,
        options: &RasterOptions,
        mut with: impl FnMut(u64, &mut [f64]) -> Parsed<()>,
    ) -> Parsed<Absent> {
        let columns = self.size[0] as usize;
        let (mut all, mut own) = (vec![f64::NAN; columns], vec![]);
        let mut covered = vec![false; columns];
        let mut waiting: VecDeque<usize> = (0..self.tiles.len()).collect();
        let mut current: Vec<OpenTile> = vec![];
        let mut absent = Absent::default();
        let mut geoid = self.open_geoid()?;
        let mut row = 0;
        while row < self.size[1] {
            current.retain(|tile| row < self.end_of(tile.number));
            while let Some(&number) = waiting.front().filter(|&&number| self.tiles[number].at[1] <= row) {
                waiting.pop_front();
                let (_, rows) = open(&self.tiles[number].path, options)?;
                current.push(OpenTile { number, rows });
            }
            all.fill(f64::NAN);
            if current.is_empty() {
                let next = waiting.front().map_or(self.size[1], |&number| self.tiles[number].at[1]);
                absent.uncovered += (next - row) * self.size[0];
                with(row, &mut all)?;
                row = next;
                continue;
            }
            covered.fill(false);
            current.sort_by_key(|tile| tile.number);
            for tile in &mut current {
                let Tile { header, at, .. } = &self.tiles[tile.number];
                own.resize(header.size[0] as usize, 0.0);
                tile.rows.read((row - at[1]) as u32, &mut own)?;
                clean(header, &mut own);
                self.put(tile.number, row, &own, &mut all, &mut covered)?;
            }
            let uncovered = covered.iter().filter(|&&is_covered| !is_covered).count() as u64;
            absent.uncovered += uncovered;
            absent.nodata += all.iter().filter(|height| height.is_nan()).count() as u64 - uncovered;
            if let Some(geoid) = &mut geoid {
                geoid.add(row, &mut all)?;
            }
            with(row, &mut all)?;
            row += 1;
        }
        Ok(absent)
    }

    /// The lowest and the highest height.
    pub fn range(&self, options: &RasterOptions) -> Parsed<[f64; 2]> {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        self.for_each_row(options, |_, heights| {
            // A comparison with NaN is false.
            range = heights.iter().fold(range, |[low, high], height| [low.min(*height), high.max(*height)]);
            Ok(())
        })?;
        Ok(range)
    }

    fn end_of(&self, tile: usize) -> u64 {
        let Tile { header, at, .. } = &self.tiles[tile];
        at[1] + u64::from(header.size[1])
    }

    /// Puts a row of a tile where it belongs. What another tile or, around the globe, the same one has put there
    /// already must agree.
    fn put(&self, tile: usize, row: u64, own: &[f64], all: &mut [f64], covered: &mut [bool]) -> Parsed<()> {
        let first = self.tiles[tile].at[0] as usize;
        let here = first..first + own.len();
        if covered.get(here.clone()).is_some_and(|covered| covered.iter().all(|&is_covered| !is_covered)) {
            all[here.clone()].copy_from_slice(own);
            covered[here].fill(true);
            return Ok(());
        }
        for (column, &height) in own.iter().enumerate() {
            let at = match first + column {
                at if at < all.len() => at,
                at => at % all.len(),
            };
            if !covered[at] || all[at].is_nan() {
                (all[at], covered[at]) = (height, true);
            } else if !height.is_nan() && (height - all[at]).abs() > AGREE * height.abs().max(1.0) {
                return Err(self.disagreement(tile, [at as u64, row], [all[at], height]));
            }
        }
        Ok(())
    }

    #[cold]
    fn disagreement(&self, tile: usize, [column, row]: [u64; 2], [there, here]: [f64; 2]) -> Box<ImportError> {
        let has = |&(number, other): &(usize, &Tile)| {
            let [from, width] = [other.at[0], u64::from(other.header.size[0])];
            let behind = if column < from { column + self.size[0] - from } else { column - from };
            number != tile && behind < width && (other.at[1]..self.end_of(number)).contains(&row)
        };
        let other = self.tiles.iter().enumerate().find(has).map_or(&self.tiles[tile].path, |(_, other)| &other.path);
        let Georeference { first, spacing } = self.place;
        let (x, y) = (first[0] + column as f64 * spacing[0], first[1] - row as f64 * spacing[1]);
        let problem = format!(
            "disagrees with {} where both have the sample at {x:.6}, {y:.6}: {here} here, {there} there; cut the files so that they do not \
             overlap, or make them agree",
            other.display()
        );
        grid_error(&self.tiles[tile].path, &problem)
    }
}

/// Columns around the globe, if it is a whole number of them.
fn around(crs: &Crs, spacing: f64) -> Option<i64> {
    let count = 360.0 / spacing;
    let whole = count.round();
    let is_whole = (count - whole).abs() < ALIGNED && (3.0..1e9).contains(&whole);
    (crs.kind == CrsKind::Geographic && is_whole).then_some(whole as i64)
}

/// The first column behind the widest gap between intervals on a circle, and how wide it is.
fn largest_gap(offsets: &[[i64; 2]], widths: &[i64], around: i64) -> (i64, i64) {
    let mut intervals: Vec<[i64; 2]> =
        offsets.iter().zip(widths).map(|([column, _], width)| [column.rem_euclid(around), *width]).collect();
    intervals.sort_unstable();
    let mut end = intervals.iter().map(|[start, width]| start + width).max().unwrap_or(0) - around;
    let mut widest = (intervals.first().map_or(0, |[start, _]| *start), 0);
    for [start, width] in intervals {
        if start - end > widest.1 {
            widest = (start, start - end);
        }
        end = end.max(start + width);
    }
    widest
}

/// Where a file begins, in samples from the first one.
fn offset([path, other]: [&Path; 2], place: Georeference, header: &Header, around: Option<i64>) -> Parsed<[i64; 2]> {
    let Some(own) = header.place else { return Ok([0, 0]) };
    let exact =
        [(own.first[0] - place.first[0]) / place.spacing[0], (place.first[1] - own.first[1]) / place.spacing[1]];
    let whole = exact.map(f64::round);
    let off = [0, 1].map(|k| (exact[k] - whole[k]).abs());
    let grown = [0, 1].map(|k| (own.spacing[k] / place.spacing[k] - 1.0).abs() * f64::from(header.size[k]));
    if grown.iter().any(|&grown| grown > ALIGNED) {
        let problem = format!(
            "has samples {:?} apart, and {} has them {:?} apart: tiles need the same spacing; resample one of them, with `gdalwarp -tr`",
            own.spacing,
            path.display(),
            place.spacing
        );
        return Err(grid_error(other, &problem));
    }
    if off.iter().any(|&off| off > ALIGNED) {
        let hint = match off.iter().all(|&off| !(ALIGNED..=0.5 - ALIGNED).contains(&off)) {
            true => {
                "; half a sample is what a pixel that is an area differs from one that is a point: one of the files says it wrongly"
            }
            false => "",
        };
        let problem = format!(
            "lies {:.2} columns and {:.2} rows off the grid of {}{hint}; resample one of them, with `gdalwarp -tap`",
            off[0],
            off[1],
            path.display()
        );
        return Err(grid_error(other, &problem));
    }
    if whole.iter().any(|whole| whole.abs() > 1e12) {
        return Err(grid_error(other, &format!("lies too far from {}; build a file of each", path.display())));
    }
    let [column, row] = whole.map(|whole| whole as i64);
    Ok([around.map_or(column, |around| column.rem_euclid(around)), row])
}

/// Refuses files of other systems and units.
fn check_alike([path, other]: [&Path; 2], [first, header]: [&Header; 2]) -> Parsed<()> {
    let name = |crs: &Crs| match (crs.name.as_str(), crs.kind) {
        ("", CrsKind::Unknown) => "no CRS".to_owned(),
        ("", kind) => format!("a CRS without a number ({})", format!("{kind:?}").to_lowercase()),
        (name, _) => name.chars().take(60).collect(),
    };
    if first.crs.bare() != header.crs.bare() {
        let problem = format!(
            "has {}, and {} has {}: files of different systems cannot be joined; bring them into one first, with `gdalwarp -t_srs`, or name \
             it with --crs if they are in the same",
            name(&header.crs),
            path.display(),
            name(&first.crs)
        );
        return Err(grid_error(other, &problem));
    }
    if first.vertical != header.vertical {
        let unit = |vertical: Option<f64>| vertical.map_or("no unit".into(), |metres| format!("units of {metres} m"));
        let problem = format!(
            "has heights in {}, and {} in {}; name the unit with --vertical-unit if they are the same",
            unit(header.vertical),
            path.display(),
            unit(first.vertical)
        );
        return Err(grid_error(other, &problem));
    }
    Ok(())
}

/// Heights as far from zero as this are no heights of anything: they are the largest numbers of their kind, which
/// programs write where they have no data.
const NO_HEIGHT: f64 = 1e30;

/// Puts NaN where there is no height, and scales the others.
pub(super) fn clean(header: &Header, heights: &mut [f64]) {
    let nodata = header.nodata.unwrap_or(f64::NAN);
    // Texts have fewer digits than numbers: two steps of these are no difference, as GDAL has it.
    let step = if header.is_f32 { f64::from(f32::EPSILON) } else { f64::EPSILON };
    let has_slack = !header.is_integer && nodata.is_finite();
    let slack = if has_slack { 4.0 * step * nodata.abs() } else { 0.0 };
    let most = if header.are_all_heights { f64::INFINITY } else { NO_HEIGHT };
    for height in heights.iter_mut() {
        let is_nodata = (*height - nodata).abs() <= slack;
        let is_height = height.abs() < most && !is_nodata;
        *height = if is_height { *height } else { f64::NAN };
    }
    let [scale, offset] = header.scale;
    if header.scale != [1.0, 0.0] {
        heights.iter_mut().for_each(|height| *height = *height * scale + offset);
    }
}
