//! All samples of a grid, rounded to steps, in memory or in a file.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use lodpack::heights::Grid;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use super::{HeightsError, nameless};

/// Steps lie within this, so that a step and the mark of a void fit into 32 bits.
const MAX_STEP: f64 = 1_000_000_000.0;

/// A sample: its height in steps times two, plus one where it has no data.
pub type Stored = i32;

/// How heights become steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    /// The height of step 0.
    pub zero: f64,
    /// The height of a step.
    pub step: f64,
}

/// About as many bytes of a file are checked together, before the first of them is used.
const BAND_BYTES: u64 = 16 << 20;

/// Where samples are kept.
#[derive(Clone, Copy, Debug)]
pub enum Keep<'a> {
    /// In memory.
    Memory,
    /// In a file of this folder that has no name once it is open.
    Nameless(&'a Path),
    /// In a file that other processes read, which know [`About`] it.
    Named(&'a Path),
}

/// What is known of all samples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Whether some of them have no data.
    pub has_voids: bool,
    /// The largest distance of a sample from its rounded height, in units of heights.
    pub error: f64,
    /// The lowest and the highest step.
    pub range: [i32; 2],
    /// XXH3 hashes of the bands of a named file, each of this many rows.
    bands: Vec<u64>,
    band_rows: u64,
}

/// The samples of a grid, row by row.
#[derive(Debug)]
pub struct Samples {
    store: Store,
    columns: u64,
    wraps: bool,
    /// What is known of all of them.
    pub about: About,
}

#[derive(Debug)]
enum Store {
    Memory(Vec<Stored>),
    File(Mutex<Disk>),
}

/// A file of samples.
#[derive(Debug)]
struct Disk {
    file: File,
    /// Of a file that another process has written: its name, and which bands are as they were.
    unchecked: Option<(PathBuf, Vec<bool>)>,
}

/// Takes rows.
pub struct Gather<'a> {
    samples: Samples,
    out: Option<BufWriter<File>>,
    /// Of the rows since the last band of a named file, and how many they are.
    hash: Option<(Xxh3, u64)>,
    grid: &'a Grid,
    scale: Scale,
    /// The row before, with its voids filled; none before the first row with data.
    last: Option<Vec<i32>>,
    /// Rows before that one.
    empty_rows: u64,
    row: Vec<Stored>,
}

impl<'a> Gather<'a> {
    /// Begins.
    pub fn new(grid: &'a Grid, scale: Scale, keep: Keep<'_>) -> Result<Self, HeightsError> {
        let [columns, rows] = grid.samples();
        let file = match keep {
            Keep::Memory => None,
            Keep::Nameless(folder) => Some(nameless(folder)?),
            Keep::Named(path) => {
                let opened = File::options().create(true).truncate(true).read(true).write(true).open(path);
                Some(opened.map_err(HeightsError::samples)?)
            }
        };
        let (store, out) = match file {
            None => (Store::Memory(Vec::with_capacity((columns * rows) as usize)), None),
            Some(file) => {
                let other = file.try_clone().map_err(HeightsError::samples)?;
                let disk = Disk { file, unchecked: None };
                (Store::File(Mutex::new(disk)), Some(BufWriter::with_capacity(1 << 20, other)))
            }
        };
        let band_rows = (BAND_BYTES / (4 * columns)).max(1);
        let range = [i32::MAX, i32::MIN];
        let about = About { has_voids: false, error: 0.0, range, bands: vec![], band_rows };
        let samples = Samples { store, columns, wraps: grid.wraps(), about };
        let hash = matches!(keep, Keep::Named(_)).then(|| (Xxh3::new(), 0));
        Ok(Self { samples, out, hash, grid, scale, last: None, empty_rows: 0, row: vec![] })
    }

    /// Takes the next row.
    pub fn push(&mut self, heights: &[f64]) -> Result<(), HeightsError> {
        let Self { samples, scale, last, row, .. } = self;
        if last.is_none() && heights.iter().all(|height| height.is_nan()) {
            self.empty_rows += 1;
            return Ok(());
        }
        row.clear();
        if let Some((error, range)) = round_row(heights, *scale, row) {
            samples.about.error = samples.about.error.max(error);
            let known = &mut samples.about.range;
            *known = [known[0].min(range[0]), known[1].max(range[1])];
            return self.push_row();
        }
        row.clear();
        let mut void_from = None;
        for (column, &height) in heights.iter().enumerate() {
            if height.is_nan() {
                void_from.get_or_insert(column);
                row.push(1);
                continue;
            }
            let step = nearest((height - scale.zero) / scale.step);
            // An infinite tolerance leaves no number.
            if step.is_nan() || step.abs() > MAX_STEP {
                return Err(HeightsError::TooFine { height, step: scale.step });
            }
            let error = (step * scale.step + scale.zero - height).abs();
            if error > samples.about.error {
                samples.about.error = error;
            }
            let step = step as i32;
            let range = &mut samples.about.range;
            *range = [range[0].min(step), range[1].max(step)];
            row.push(step << 1);
            if let Some(from) = void_from.take() {
                fill(row, from, column, last.as_deref());
            }
        }
        if let Some(from) = void_from {
            let end = row.len();
            fill(row, from, end, last.as_deref());
        }
        samples.about.has_voids |= row.iter().any(|sample| sample & 1 != 0);
        self.push_row()
    }

    /// Appends the row that has been rounded, and what is before it.
    fn push_row(&mut self) -> Result<(), HeightsError> {
        let row = std::mem::take(&mut self.row);
        let mut last = self.last.take().unwrap_or_default();
        last.clear();
        last.extend(row.iter().map(|sample| sample >> 1));
        self.last = Some(last);
        if self.empty_rows > 0 {
            let filled: Vec<Stored> = row.iter().map(|sample| sample | 1).collect();
            self.samples.about.has_voids = true;
            (0..std::mem::take(&mut self.empty_rows)).try_for_each(|_| self.put(&filled))?;
        }
        self.put(&row)?;
        self.row = row;
        Ok(())
    }

    /// Appends a row as it is stored.
    fn put(&mut self, row: &[Stored]) -> Result<(), HeightsError> {
        match (&mut self.samples.store, &mut self.out) {
            (Store::Memory(all), _) => all.extend_from_slice(row),
            (Store::File(_), Some(out)) => {
                let bytes: Vec<u8> = row.iter().flat_map(|sample| sample.to_le_bytes()).collect();
                out.write_all(&bytes).map_err(HeightsError::samples)?;
                if let Some((hash, rows)) = &mut self.hash {
                    hash.update(&bytes);
                    *rows += 1;
                    if *rows == self.samples.about.band_rows {
                        self.end_band();
                    }
                }
            }
            (Store::File(_), None) => {}
        }
        Ok(())
    }

    /// Notes the hash of the rows since the last one.
    fn end_band(&mut self) {
        if let Some((hash, rows)) = self.hash.replace((Xxh3::new(), 0)).filter(|(_, rows)| *rows > 0) {
            debug_assert!(rows <= self.samples.about.band_rows);
            self.samples.about.bands.push(hash.digest());
        }
    }

    /// All samples, once every row has been pushed.
    pub fn finish(mut self) -> Result<Samples, HeightsError> {
        if self.empty_rows > 0 {
            let empty = vec![1; self.samples.columns as usize];
            self.samples.about.has_voids = true;
            (0..std::mem::take(&mut self.empty_rows)).try_for_each(|_| self.put(&empty))?;
        }
        if self.hash.is_some() {
            self.end_band();
        }
        if let Some(out) = &mut self.out {
            out.flush().map_err(HeightsError::samples)?;
        }
        if let (Some(_), Store::File(disk)) = (&self.hash, &self.samples.store) {
            let disk = disk.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            disk.file.sync_all().map_err(HeightsError::samples)?;
        }
        debug_assert!(self.grid.samples()[0] == self.samples.columns);
        Ok(self.samples)
    }
}

/// One and a half times 2^52: adding it rounds a number to an integer, whose bits are then the last ones.
const SHIFT: f64 = 6_755_399_441_055_744.0;
/// The number of samples that are rounded side by side.
const LANES: usize = 4;

/// Appends a row in which no sample lacks data, and returns the largest error, and the lowest and the highest step;
/// none if there is something in it that has to be looked at one by one.
fn round_row(heights: &[f64], scale: Scale, out: &mut Vec<Stored>) -> Option<(f64, [i32; 2])> {
    let (mut errors, mut lowest, mut highest) = ([0.0f64; LANES], [f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
    let mut is_number = true;
    let (chunks, rest) = heights.as_chunks::<LANES>();
    let mut round = |lane: usize, height: f64| {
        let shifted = (height - scale.zero) / scale.step + SHIFT;
        let step = shifted - SHIFT;
        let error = (step * scale.step + scale.zero - height).abs();
        errors[lane] = if error > errors[lane] { error } else { errors[lane] };
        lowest[lane] = if step < lowest[lane] { step } else { lowest[lane] };
        highest[lane] = if step > highest[lane] { step } else { highest[lane] };
        is_number &= step.abs() <= MAX_STEP;
        (shifted.to_bits() as u32).cast_signed() << 1
    };
    for chunk in chunks {
        let mut steps = [0; LANES];
        for (lane, (step, &height)) in steps.iter_mut().zip(chunk).enumerate() {
            *step = round(lane, height);
        }
        out.extend_from_slice(&steps);
    }
    for (lane, &height) in rest.iter().enumerate() {
        out.push(round(lane, height));
    }
    let range =
        [lowest.into_iter().fold(f64::INFINITY, f64::min), highest.into_iter().fold(f64::NEG_INFINITY, f64::max)];
    // What is no number compares as false.
    (is_number && !heights.is_empty()).then(|| (errors.into_iter().fold(0.0, f64::max), range.map(|step| step as i32)))
}

/// The nearest integer of a number that is not beyond 2^51: adding rounds, and is faster than a call.
fn nearest(x: f64) -> f64 {
    if x.abs() < 1e15 { (x + SHIFT) - SHIFT } else { x }
}

/// Gives samples without data the heights of those beside them, or of the row before: coarse tiles may draw cells of
/// which they are corners.
fn fill(row: &mut [Stored], from: usize, end: usize, last: Option<&[i32]>) {
    let west = from.checked_sub(1).map(|at| row[at] >> 1);
    let east = row.get(end).map(|sample| sample >> 1);
    for at in from..end {
        let step = match (west, east) {
            (Some(west), Some(east)) => {
                let (part, whole) = ((at + 1 - from) as i64, (end + 1 - from) as i64);
                (i64::from(west) + (i64::from(east) - i64::from(west)) * part / whole) as i32
            }
            (Some(step), None) | (None, Some(step)) => step,
            // There is data in some row before.
            (None, None) => last.map_or(0, |last| last[at]),
        };
        row[at] = step << 1 | 1;
    }
}

impl Disk {
    /// Checks the band of a row, unless that is done.
    fn check(&mut self, row: u64, columns: u64, about: &About) -> Result<(), HeightsError> {
        let Some((path, known)) = &mut self.unchecked else { return Ok(()) };
        let number = row / about.band_rows;
        let (Some(is_known), Some(&expected)) = (known.get_mut(number as usize), about.bands.get(number as usize))
        else {
            return Err(HeightsError::Changed { path: path.clone() });
        };
        if *is_known {
            return Ok(());
        }
        let band = 4 * columns * about.band_rows;
        self.file.seek(SeekFrom::Start(number * band)).map_err(HeightsError::samples)?;
        let (mut hash, mut left, mut buffer) = (Xxh3::new(), band, vec![0; 1 << 18]);
        loop {
            let most = left.min(buffer.len() as u64) as usize;
            let count = self.file.read(&mut buffer[..most]).map_err(HeightsError::samples)?;
            if count == 0 {
                break;
            }
            hash.update(&buffer[..count]);
            left -= count as u64;
        }
        if hash.digest() != expected {
            return Err(HeightsError::Changed { path: path.clone() });
        }
        *is_known = true;
        Ok(())
    }
}

impl Samples {
    /// Samples in a file that another process has written. What is read is checked.
    pub fn open(path: &Path, grid: &Grid, about: About) -> Result<Self, HeightsError> {
        let file = File::open(path).map_err(HeightsError::samples)?;
        let disk = Disk { file, unchecked: Some((path.to_owned(), vec![false; about.bands.len()])) };
        Ok(Self { store: Store::File(Mutex::new(disk)), columns: grid.samples()[0], wraps: grid.wraps(), about })
    }

    /// Reads samples of one row, from a column on. The last column of a grid that wraps is its first one.
    fn read(&self, row: u64, column: u64, out: &mut [Stored]) -> Result<(), HeightsError> {
        let mut column = column;
        let mut out = out;
        while !out.is_empty() {
            let here = if self.wraps { column % self.columns } else { column };
            let count = ((self.columns - here) as usize).min(out.len());
            let (now, later) = out.split_at_mut(count);
            let first = row * self.columns + here;
            match &self.store {
                Store::Memory(all) => now.copy_from_slice(&all[first as usize..first as usize + count]),
                Store::File(disk) => {
                    let mut bytes = vec![0; 4 * count];
                    let mut disk = disk.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                    disk.check(row, self.columns, &self.about)?;
                    let file = &mut disk.file;
                    let read = file.seek(SeekFrom::Start(4 * first)).and_then(|_| file.read_exact(&mut bytes));
                    read.map_err(HeightsError::samples)?;
                    drop(disk);
                    let (numbers, _) = bytes.as_chunks::<4>();
                    now.iter_mut().zip(numbers).for_each(|(sample, bytes)| *sample = i32::from_le_bytes(*bytes));
                }
            }
            column += count as u64;
            out = later;
        }
        Ok(())
    }

    /// The samples of a rectangle: from the first to the last column and row, both included.
    pub fn window(&self, columns: [u64; 2], rows: [u64; 2]) -> Result<Window, HeightsError> {
        let width = (columns[1] - columns[0] + 1) as usize;
        let height = (rows[1] - rows[0] + 1) as usize;
        let mut stored = vec![0; width * height];
        for (row, out) in (rows[0]..).zip(stored.chunks_mut(width)) {
            self.read(row, columns[0], out)?;
        }
        Ok(Window { columns, rows, width, stored, has_voids: self.about.has_voids })
    }

    /// The samples on some of the lines: columns within rows.
    pub fn at_lines(&self, columns: &[u64], rows: &[u64]) -> Result<Vec<Stored>, HeightsError> {
        let (Some(&first), Some(&last)) = (columns.first(), columns.last()) else { return Ok(vec![]) };
        let mut line = vec![0; (last - first + 1) as usize];
        let mut all = Vec::with_capacity(columns.len() * rows.len());
        let mut before = None;
        for &row in rows {
            if before != Some(row) {
                self.read(row, first, &mut line)?;
                before = Some(row);
            }
            all.extend(columns.iter().map(|column| line[(column - first) as usize]));
        }
        Ok(all)
    }
}

/// A rectangle of samples.
#[derive(Debug)]
pub struct Window {
    /// The first and the last column.
    pub columns: [u64; 2],
    /// The first and the last row.
    pub rows: [u64; 2],
    width: usize,
    stored: Vec<Stored>,
    has_voids: bool,
}

impl Window {
    /// All samples, row by row, and how many a row has.
    pub fn all(&self) -> (&[Stored], usize) {
        (&self.stored, self.width)
    }

    /// The height of a sample in steps.
    #[inline]
    pub fn step(&self, column: u64, row: u64) -> i32 {
        self.stored[self.place(column, row)] >> 1
    }

    fn place(&self, column: u64, row: u64) -> usize {
        (row - self.rows[0]) as usize * self.width + (column - self.columns[0]) as usize
    }

    /// A run of samples of a row as heights above step 0; NaN without data.
    #[inline]
    pub fn run(&self, row: u64, columns: [u64; 2]) -> &[Stored] {
        let first = self.place(columns[0], row);
        &self.stored[first..first + (columns[1] - columns[0] + 1) as usize]
    }

    /// Whether the cell whose north-western sample this is has four samples with data.
    pub fn is_drawn(&self, column: u64, row: u64) -> bool {
        if !self.has_voids {
            return true;
        }
        let at = self.place(column, row);
        let [a, b, c, d] = [at, at + 1, at + self.width, at + self.width + 1].map(|at| self.stored[at]);
        (a | b | c | d) & 1 == 0
    }

    /// Whether some of its samples have no data.
    pub fn has_voids(&self) -> bool {
        self.has_voids && self.stored.iter().any(|sample| sample & 1 != 0)
    }
}
