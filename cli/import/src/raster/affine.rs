//! From columns and rows to places, as files say it, and world files, which say nothing else.

use std::path::{Path, PathBuf};

use super::header::{Georeference, HeightRows};
use super::sidecar::with_extension;
use super::{ImportError, Parsed, grid_error};
use crate::error::Location;

/// How far the first and the last sample of a row may be apart across it, in samples: files round their numbers.
const STRAIGHT: f64 = 1e-6;
/// The largest world file that is read.
const MAX_WORLD_BYTES: u64 = 1 << 12;

/// Where the sample of a column and a row is: the first one, and how far the next column and the next row are from it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine {
    pub first: [f64; 2],
    pub column: [f64; 2],
    pub row: [f64; 2],
}

/// Where the samples of a grid of a size are, and whether the file has its columns from the east and its rows from the
/// south.
pub(super) fn placed(affine: Option<Affine>, path: &Path, size: [u32; 2]) -> Parsed<(Option<Georeference>, [bool; 2])> {
    let Some(Affine { mut first, column, row }) = affine else { return Ok((None, [false; 2])) };
    let [columns, rows] = size.map(|count| f64::from(count.saturating_sub(1)));
    if (column[1] * columns).abs() > STRAIGHT * row[1].abs() || (row[0] * rows).abs() > STRAIGHT * column[0].abs() {
        let problem = "is rotated: its rows do not run to the east; rectify it first, with `gdalwarp`";
        return Err(grid_error(path, problem));
    }
    let turned = [column[0] < 0.0, row[1] > 0.0];
    if turned[0] {
        first[0] += columns * column[0];
    }
    if turned[1] {
        first[1] += rows * row[1];
    }
    let spacing = [column[0].abs(), row[1].abs()];
    Ok((Some(Georeference { first, spacing }), turned))
}

/// The world file of a raster or image, under any of the names that are in use: `a.tfw`, `a.tifw` and `a.wld` for
/// `a.tif`.
pub(super) fn world_file(path: &Path) -> Option<PathBuf> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    let short = extension.chars().next().zip(extension.chars().last());
    let short = short.map(|(first, last)| format!("{first}{last}w"));
    let names = short.into_iter().chain([format!("{extension}w"), "wld".to_owned()]);
    names.into_iter().find_map(|name| with_extension(path, &name))
}

/// What a world file beside a raster or image says; none where there is none.
pub(super) fn of_world_file(path: &Path) -> Parsed<Option<Affine>> {
    let Some(world) = world_file(path) else { return Ok(None) };
    let io = |source| ImportError::Io { path: world.clone(), source };
    let is_small = std::fs::metadata(&world).map_err(io)?.len() <= MAX_WORLD_BYTES;
    let text = if is_small { std::fs::read(&world).map_err(io)? } else { vec![] };
    let numbers = String::from_utf8_lossy(&text);
    let numbers: Vec<Option<f64>> = numbers.split_ascii_whitespace().map(|word| word.parse().ok()).collect();
    let [Some(a), Some(d), Some(b), Some(e), Some(c), Some(f), ..] = numbers[..] else {
        let problem = "a world file has six numbers with a point: the width of a pixel, two of a rotation, the height of a pixel, which is \
                       negative, and x and y of the first pixel's middle; correct it or remove it";
        let location = Location::Item("number", numbers.iter().take_while(|number| number.is_some()).count() as u64);
        return Err(ImportError::Syntax { path: world, location, problem: problem.into() }.into());
    };
    Ok(Some(Affine { first: [c, f], column: [a, d], row: [b, e] }))
}

/// The rows of a file that has its columns from the east or its rows from the south.
pub(super) struct Turned {
    rows: Box<dyn HeightRows>,
    turned: [bool; 2],
    count: u32,
}

impl Turned {
    /// A number of rows, from the north and the west.
    pub fn over(rows: Box<dyn HeightRows>, turned: [bool; 2], count: u32) -> Box<dyn HeightRows> {
        if turned == [false; 2] { rows } else { Box::new(Self { rows, turned, count }) }
    }
}

impl HeightRows for Turned {
    fn read(&mut self, row: u32, heights: &mut [f64]) -> Parsed<()> {
        let [from_east, from_south] = self.turned;
        self.rows.read(if from_south { self.count - 1 - row } else { row }, heights)?;
        if from_east {
            heights.reverse();
        }
        Ok(())
    }
}
