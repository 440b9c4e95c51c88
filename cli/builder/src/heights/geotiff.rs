//! Windows of a grid of heights as GeoTIFF: the samples as they are, or every second, fourth ... of them.

use std::io::{Seek, Write};

use flate2::write::ZlibEncoder;
use lodpack::heights::{CELLS, Heights, HeightsQuery, SIDE, TileId, TileValues};
use lodpack::{Error, ReadAt, Result};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind, TiffKindBig, TiffKindStandard};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, Tag};

use super::beyond::error_beyond;
use super::georeference::Georeference;
use super::tile::touches;
use super::window::RasterWindow;
use lodpack_import::raster::geokeys::GDAL_METADATA;
use lodpack_runtime::progress::Progress;

/// Rows that are compressed together.
const STRIP_ROWS: u32 = 64;
/// TIFF counts bytes with 32 bits; beyond this many, BigTIFF does with 64.
const PLAIN_BYTES: u64 = 3_900_000_000;

/// The window of the samples that a box touches, as few of them as the tolerance allows.
///
/// # Errors
/// [`Error::Query`] if there are none; those of reading the index.
pub fn window_of<S: ReadAt>(
    file: &Heights<S>,
    bounds: Option<[[f64; 2]; 2]>,
    tolerance: Option<f64>,
) -> Result<RasterWindow> {
    window_at(file, bounds, tolerance, 0)
}

/// The same of samples that are at least those of a depth.
fn window_at<S: ReadAt>(
    file: &Heights<S>,
    bounds: Option<[[f64; 2]; 2]>,
    tolerance: Option<f64>,
    least_depth: u32,
) -> Result<RasterWindow> {
    let (grid, surface) = (file.grid(), file.surface());
    let cells = grid.cells();
    let cut = file.cut(&HeightsQuery { bounds, tolerance, max_triangles: None })?;
    if cut.tiles.is_empty() {
        return Err(Error::Query { what: "nothing touches the box".into() });
    }
    // Tiles drawn at less than all their samples are no finer than with all.
    let mut depth = match tolerance {
        Some(tolerance) if tolerance > 0.0 => cut.tiles.iter().map(|tile| tile.id.depth).max().unwrap_or(0),
        _ => grid.depth(),
    };
    depth = depth.max(least_depth);
    let stride_at = |depth: u32| 1u64 << (grid.depth() - depth);
    // Around a globe the samples have to be evenly spaced, too.
    while grid.wraps() && !cells[0].is_multiple_of(stride_at(depth)) && depth < grid.depth() {
        depth += 1;
    }
    let stride = stride_at(depth);
    let last = [cells[0] / stride - u64::from(grid.wraps()), cells[1] / stride];
    let ends = |axis: usize, low: f64, high: f64| {
        let line = |at: f64| (at - surface.first[axis]) / surface.spacing[axis] / stride as f64;
        let (from, to) = (line(low).min(line(high)), line(low).max(line(high)));
        // The conversion saturates.
        [from.floor().max(0.0) as u64, to.ceil().max(0.0) as u64]
    };
    let mut range = [[0, last[0]], [0, last[1]]];
    if let Some([low, high]) = bounds {
        range = [0, 1].map(|axis| {
            let [from, to] = ends(axis, low[axis], high[axis]);
            [from.min(last[axis]), to.min(last[axis])]
        });
        if grid.wraps() {
            let turn = cells[0] / stride;
            let around = 360.0;
            let west = surface.first[0] + (low[0] - surface.first[0]).rem_euclid(around);
            let width =
                if high[0] >= low[0] { (high[0] - low[0]).min(around) } else { (high[0] - low[0]).rem_euclid(around) };
            // All of it begins where the grid does.
            if width < around {
                let [from, to] = ends(0, west, west + width);
                range[0] = [from.min(turn - 1), to.min(from.min(turn - 1) + turn - 1)];
            } else {
                range[0] = [0, turn - 1];
            }
        }
    }
    let size = range.map(|[from, to]| to - from + 1);
    Ok(RasterWindow { depth, stride, first: range.map(|[from, _]| from), size, error: cut.error })
}

/// As [`window_of`]. Where a grid does not end with one of the samples, the surface of these ends before it, and what
/// lies beyond counts, too: there are as many samples as that takes.
///
/// # Errors
/// [`Error::Query`] if there are no samples; those of reading the file.
pub fn raster_window_of<S: ReadAt>(
    file: &Heights<S>,
    bounds: Option<[[f64; 2]; 2]>,
    tolerance: Option<f64>,
) -> Result<RasterWindow> {
    let mut least = 0;
    loop {
        let mut window = without_poles(file, window_at(file, bounds, tolerance, least)?)?;
        let most = tolerance.unwrap_or(0.0).max(window.error);
        // With all samples nothing lies beyond.
        if let Some(beyond) = error_beyond(file, &window, most)? {
            window.error = window.error.max(beyond);
            return Ok(window);
        }
        least = window.depth + 1;
    }
}

/// A window without rows beyond the poles: where a grid of areas ends half a row before a pole, its file has a row
/// for the pole itself, which closes the surface again when it is built from the window.
///
/// # Errors
/// [`Error::Query`] if there are no samples; those of reading the index.
fn without_poles<S: ReadAt>(file: &Heights<S>, mut window: RasterWindow) -> Result<RasterWindow> {
    let surface = file.surface();
    if surface.is_globe() {
        let step = surface.spacing[1] * window.stride as f64;
        let is_beyond = |row: u64| (surface.first[1] + step * row as f64).abs() > 90.0 + 1e-6 * step.abs();
        while window.size[1] > 0 && is_beyond(window.first[1]) {
            (window.first[1], window.size[1]) = (window.first[1] + 1, window.size[1] - 1);
        }
        while window.size[1] > 0 && is_beyond(window.first[1] + window.size[1] - 1) {
            window.size[1] -= 1;
        }
        if window.size[1] == 0 {
            return Err(Error::Query { what: "nothing but a pole touches the box".into() });
        }
    }
    Ok(window)
}

/// Writes a window, and returns how many samples have no data.
///
/// # Errors
/// Those of reading the file, as [`std::io::Error`] with their text, and those of the writer.
pub fn write_geotiff<S: ReadAt>(
    file: &Heights<S>,
    window: &RasterWindow,
    out: impl Write + Seek,
    progress: &dyn Progress,
) -> std::io::Result<u64> {
    let place = Georeference::of(file, window);
    let is_large = window.size[0].saturating_mul(window.size[1]).saturating_mul(4) > PLAIN_BYTES;
    let kind = kind_of(file, place.zero).map_err(std::io::Error::other)?;
    let job = Job { file, window, place, kind, progress };
    let written = match is_large {
        true => job.write::<_, TiffKindBig>(out),
        false => job.write::<_, TiffKindStandard>(out),
    };
    written.map_err(std::io::Error::other)
}

/// How samples of a file are stored, to which something is added.
fn kind_of<S: ReadAt>(file: &Heights<S>, zero: f64) -> Result<Kind> {
    let info = file.info();
    let is_whole = info.sample_error == 0.0 && [info.zero, info.step, zero].iter().all(|x| x.fract() == 0.0);
    let range = range_of(file)?.map(|height| height + zero);
    let fits = |low: f64, high: f64| is_whole && range[0] > low && range[1] <= high;
    Ok(match (fits(f64::from(i16::MIN), f64::from(i16::MAX)), fits(f64::from(i32::MIN), f64::from(i32::MAX))) {
        (true, _) => Kind::Short,
        (_, true) => Kind::Long,
        _ => Kind::Float,
    })
}

/// How far samples of a window are moved where they are written in single precision, in units of space.
///
/// # Errors
/// Those of reading the index.
pub fn rounding_of<S: ReadAt>(file: &Heights<S>, window: &RasterWindow) -> Result<f64> {
    let zero = Georeference::of(file, window).zero;
    let most = range_of(file)?.into_iter().fold(0.0, |most: f64, height| most.max((height + zero).abs()));
    let is_rounded = kind_of(file, zero)? == Kind::Float;
    Ok(if is_rounded { 0.5 * f64::from(f32::EPSILON) * most * file.surface().height_scale } else { 0.0 })
}

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    /// Whole numbers of 16 bits.
    Short,
    /// Whole numbers of 32 bits.
    Long,
    /// Single precision.
    Float,
}

impl Kind {
    /// Bits, the format of samples (2: whole numbers, 3: floats), and the predictor (2: differences, 3: of the bytes of
    /// floats).
    fn tags(self) -> [u16; 3] {
        match self {
            Self::Short => [16, 2, 2],
            Self::Long => [32, 2, 2],
            Self::Float => [32, 3, 3],
        }
    }

    /// The number of samples without data.
    fn nodata(self) -> f64 {
        match self {
            Self::Short => f64::from(i16::MIN),
            Self::Long => f64::from(i32::MIN),
            Self::Float => f64::NAN,
        }
    }

    /// Appends a row, as differences.
    fn encode(self, row: &[f64], out: &mut Vec<u8>) {
        let numbers = row.iter().map(|&height| if height.is_nan() { self.nodata() } else { height });
        match self {
            Self::Short => {
                let mut before = 0i16;
                for number in numbers.map(|number| number as i16) {
                    out.extend(number.wrapping_sub(before).to_ne_bytes());
                    before = number;
                }
            }
            Self::Long => {
                let mut before = 0i32;
                for number in numbers.map(|number| number as i32) {
                    out.extend(number.wrapping_sub(before).to_ne_bytes());
                    before = number;
                }
            }
            Self::Float => {
                // First the most significant bytes of all samples, then those behind them.
                let bytes: Vec<[u8; 4]> = numbers.map(|number| (number as f32).to_be_bytes()).collect();
                let mut before = 0u8;
                for byte in (0..4).flat_map(|k| bytes.iter().map(move |sample| sample[k])) {
                    out.push(byte.wrapping_sub(before));
                    before = byte;
                }
            }
        }
    }
}

/// The lowest and the highest height of a file, as its coarsest tiles know them; the lowest is above the highest where
/// nothing is drawn.
///
/// # Errors
/// Those of reading the index.
pub fn range_of<S: ReadAt>(file: &Heights<S>) -> Result<[f64; 2]> {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    for &root in file.roots() {
        let Some(record) = file.record(root)? else { continue };
        let [low, high] = [record.lowest, record.highest].map(|steps| file.info().height(steps));
        range = [range[0].min(low), range[1].max(high)];
    }
    Ok(range)
}

struct Job<'a, S> {
    file: &'a Heights<S>,
    window: &'a RasterWindow,
    place: Georeference,
    kind: Kind,
    progress: &'a dyn Progress,
}

/// Errors of both sides.
#[derive(Debug, thiserror::Error)]
enum JobError {
    #[error(transparent)]
    File(#[from] Error),
    #[error(transparent)]
    Tiff(#[from] tiff::TiffError),
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the window has too many columns or rows for TIFF")]
    Size,
}

impl<S: ReadAt> Job<'_, S> {
    fn write<W: Write + Seek, K: TiffKind>(&self, out: W) -> std::result::Result<u64, JobError> {
        let [width, height] = self.window.size.map(u32::try_from);
        let (Ok(width), Ok(height)) = (width, height) else { return Err(JobError::Size) };
        let mut tiff = TiffEncoder::<W, K>::new_generic(out)?;
        let mut directory = tiff.image_directory()?;
        let [bits, format, predictor] = self.kind.tags();
        directory.write_tag(Tag::ImageWidth, width)?;
        directory.write_tag(Tag::ImageLength, height)?;
        directory.write_tag(Tag::BitsPerSample, bits)?;
        directory.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16())?;
        directory.write_tag(Tag::PhotometricInterpretation, PhotometricInterpretation::BlackIsZero.to_u16())?;
        directory.write_tag(Tag::SamplesPerPixel, 1u16)?;
        directory.write_tag(Tag::RowsPerStrip, STRIP_ROWS)?;
        directory.write_tag(Tag::Predictor, predictor)?;
        directory.write_tag(Tag::SampleFormat, format)?;
        self.write_tags(&mut directory)?;
        self.progress.begin("raster", height.into());
        let (mut strip, mut missing, mut row_count) = (vec![], 0, 0);
        let (mut offsets, mut lengths) = (vec![], vec![]);
        let mut raised = vec![];
        Bands::new(self.file, self.window).for_each_row(|row| {
            raised.clear();
            raised.extend(row.iter().map(|height| height + self.place.zero));
            let row = &raised[..];
            missing += row.iter().filter(|height| height.is_nan()).count() as u64;
            self.kind.encode(row, &mut strip);
            row_count += 1;
            if row_count % STRIP_ROWS == 0 || row_count == height {
                let mut encoder = ZlibEncoder::new(vec![], flate2::Compression::default());
                encoder.write_all(&strip)?;
                let bytes = encoder.finish()?;
                strip.clear();
                lengths.push(K::convert_offset(bytes.len() as u64)?);
                offsets.push(K::convert_offset(directory.write_data(&bytes[..])?)?);
            }
            self.progress.advance(1);
            Ok::<_, JobError>(())
        })?;
        directory.write_tag(Tag::StripOffsets, K::convert_slice(&offsets))?;
        directory.write_tag(Tag::StripByteCounts, K::convert_slice(&lengths))?;
        directory.finish()?;
        Ok(missing)
    }

    fn write_tags<W: Write + Seek, K: TiffKind>(
        &self,
        directory: &mut DirectoryEncoder<'_, W, K>,
    ) -> std::result::Result<(), JobError> {
        let Georeference { first, spacing, keys, metres, .. } = &self.place;
        directory.write_tag(Tag::ModelPixelScaleTag, &[spacing[0], spacing[1], 0.0][..])?;
        directory.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, first[0], first[1], 0.0][..])?;
        directory.write_tag(Tag::GeoKeyDirectoryTag, &keys.directory()[..])?;
        if !keys.doubles.is_empty() {
            directory.write_tag(Tag::GeoDoubleParamsTag, &keys.doubles[..])?;
        }
        if !keys.texts.is_empty() {
            directory.write_tag(Tag::GeoAsciiParamsTag, &keys.texts[..])?;
        }
        if let Some(metres) = metres {
            let item = format!(
                "<GDALMetadata>\n<Item name=\"SCALE\" sample=\"0\" role=\"scale\">{metres}</Item>\n</GDALMetadata>\n"
            );
            directory.write_tag(Tag::Unknown(GDAL_METADATA), &item[..])?;
        }
        let text = if self.kind == Kind::Float { "nan".to_owned() } else { self.kind.nodata().to_string() };
        directory.write_tag(Tag::GdalNodata, &text[..])?;
        Ok(())
    }
}

/// Reads a window by rows of tiles. Tiles share the samples on their borders, of which only one of them may have data.
struct Bands<'a, S> {
    file: &'a Heights<S>,
    window: &'a RasterWindow,
    /// The row of tiles that comes next.
    next: u64,
    /// Row by row: those of a row of tiles, the last of which is the first one of the next.
    heights: Vec<f64>,
}

impl<'a, S: ReadAt> Bands<'a, S> {
    fn new(file: &'a Heights<S>, window: &'a RasterWindow) -> Self {
        // Data of the first row may be in the tiles above it.
        let next = window.first[1].saturating_sub(1) / CELLS as u64;
        Self { file, window, next, heights: vec![] }
    }

    /// Hands out the rows of the window, from north to south; samples without data are NaN.
    fn for_each_row<E: From<Error>>(
        mut self,
        mut with: impl FnMut(&[f64]) -> std::result::Result<(), E>,
    ) -> std::result::Result<(), E> {
        let (width, cells) = (self.window.size[0] as usize, CELLS as u64);
        let [start, end] = [self.window.first[1], self.window.first[1] + self.window.size[1]];
        self.heights.resize(width, f64::NAN);
        while self.next * cells < end {
            // The last row of the tiles before is the first one of these.
            self.heights.drain(..self.heights.len() - width);
            self.heights.resize(width * SIDE, f64::NAN);
            self.take(self.next)?;
            let first = self.next * cells;
            for (row, heights) in (first..(first + cells).min(end)).zip(self.heights.chunks(width)) {
                if row >= start {
                    with(heights)?;
                }
            }
            self.next += 1;
        }
        Ok(())
    }

    /// Takes over the samples of a row of tiles.
    fn take(&mut self, row: u64) -> Result<()> {
        let RasterWindow { depth, stride, first, size, .. } = *self.window;
        let grid = self.file.grid();
        let turn = (grid.cells()[0] / stride) as i64;
        let tiles = (turn as u64).div_ceil(CELLS as u64).max(1);
        let laps = if grid.wraps() { -1..=1 } else { 0..=0 };
        for lap in laps {
            for column in 0..tiles {
                // Where the first sample of the tile lies in the window.
                let west = (column * CELLS as u64) as i64 + lap * turn - first[0] as i64;
                let id = TileId { depth, column, row };
                if west >= size[0] as i64 || west + (CELLS as i64) < 0 || !grid.has(id) {
                    continue;
                }
                let Some(tile) = self.file.tile(id)? else { continue };
                self.take_tile(&tile, west);
            }
        }
        Ok(())
    }

    fn take_tile(&mut self, tile: &TileValues, west: i64) {
        let width = self.window.size[0] as usize;
        for (row, heights) in self.heights.chunks_mut(width).enumerate() {
            for column in 0..SIDE {
                let slot = usize::try_from(west + column as i64).ok().and_then(|at| heights.get_mut(at));
                if let Some(slot) = slot.filter(|_| touches(tile, column, row)) {
                    *slot = self.file.info().height(tile.steps[row * SIDE + column]);
                }
            }
        }
    }
}
