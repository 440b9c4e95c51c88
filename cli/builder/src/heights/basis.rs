//! What all units of a grid have in common.

use std::collections::HashMap;

use lodpack::heights::{CELLS, Grid, HeightsInfo, LevelErrors, Ramp, TileEncoder, TileId, TileValues};
use lodpack::index::Placement;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::HeightsError;
use super::above::{Top, symbols_of_tops, tops};
use super::samples::{Gather, Keep, Samples, Scale};
use super::tile::Setting;
use super::unit::Unit;
use crate::pipeline::summary::Stopwatch;
use lodpack_import::ImportError;
use lodpack_import::raster::HeightSource;
use lodpack_mesh::tolerance::Tolerance;
use lodpack_runtime::progress::Progress;

/// Depths within a unit, of which the finest tiles have 64 cells along a side: 1,024 cells.
const UNIT_DEPTHS: u32 = 4;
/// Units are taken larger rather than that more tiles than this lie above them.
const MAX_ABOVE: u64 = 700;
/// The symbols of this many units say how often each symbol occurs.
const SAMPLED_UNITS: usize = 64;
/// Of more units than this, not all tiles are taken, but for this many depths one of four.
const FEW_UNITS: usize = 4;
const THINNED_DEPTHS: u32 = 2;
/// `auto` is this share of how far samples are from the middle of their neighbours on average.
const AUTO_BEND: f64 = 0.5;
/// No step is larger, in units of heights.
const MAX_STEP: f64 = 1e12;
/// `auto` of a flat grid, as a share of its spacing.
const AUTO_FLAT: f64 = 0.01;

/// What all units of a grid have in common. With it and the samples of a unit, any process can build the unit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Basis {
    pub(super) info: HeightsInfo,
    pub(super) ramp: Option<Ramp>,
    pub(super) placement: Placement,
    /// In units of coordinates.
    pub(super) tolerance: f64,
    /// The highest sample, in units of coordinates.
    highest: f64,
    /// The tiles above all units.
    pub(super) tops: Vec<Top>,
    /// How often each symbol occurs.
    pub(super) tables: Vec<u8>,
}

impl Basis {
    /// Reads rasters.
    ///
    /// # Errors
    /// [`HeightsError`].
    pub fn new(
        source: &HeightSource,
        tolerance: Tolerance,
        keep: Keep<'_>,
        progress: &dyn Progress,
        watch: &mut Stopwatch,
    ) -> Result<(Self, Samples), HeightsError> {
        let [columns, rows] = source.grid.samples();
        progress.begin("import", columns * rows);
        let (scale, tolerance) = scale_of(source, tolerance)?;
        let samples = gather(source, scale, keep, progress)?;
        watch.lap("import");
        let height_scale = source.surface.height_scale;
        let [lowest, highest] = samples.about.range.map(|steps| scale.zero + f64::from(steps) * scale.step);
        let ramp = source.ramp([lowest, highest])?;
        let info = HeightsInfo {
            grid: source.grid.clone(),
            surface: source.surface,
            zero: scale.zero,
            step: scale.step,
            sample_error: samples.about.error,
            unit: source.unit.map(|unit| unit.metres * height_scale),
            ramp: ramp.as_ref().map_or_else(String::new, |(_, name)| name.clone()),
        };
        let mut basis = Self {
            info,
            ramp: ramp.map(|(ramp, _)| ramp),
            placement: source.placement.clone(),
            tolerance,
            highest: highest * height_scale,
            tops: vec![],
            tables: vec![],
        };
        let units = basis.units();
        basis.tops = tops(&basis.setting(), &samples, &units)?;
        basis.tables = encoder(&basis.setting(), &samples, &units, &basis.tops)?.tables();
        watch.lap("tables");
        Ok((basis, samples))
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.info.grid
    }

    /// What all tiles share.
    pub(super) fn setting(&self) -> Setting<'_> {
        let HeightsInfo { grid, surface, zero, step, sample_error, .. } = &self.info;
        Setting {
            grid,
            surface,
            scale: Scale { zero: *zero, step: *step },
            error: sample_error * surface.height_scale,
            level: LevelErrors::new(grid, surface, *sample_error),
            highest: self.highest,
        }
    }

    /// The tiles in which the finest ones are worked on together, row by row.
    pub fn units(&self) -> Vec<TileId> {
        let grid = &self.info.grid;
        let [columns, rows] = grid.roots();
        let above = |depth: u32| columns * rows * ((1u64 << (2 * depth)) - 1) / 3;
        let mut depth = grid.depth().saturating_sub(UNIT_DEPTHS);
        while above(depth) > MAX_ABOVE {
            depth -= 1;
        }
        let all = (0..rows << depth).flat_map(|row| (0..columns << depth).map(move |column| (column, row)));
        let tiles = all.map(|(column, row)| TileId { depth, column, row });
        tiles.filter(|&id| grid.has(id)).collect()
    }

    /// Cells of a unit that lie in the grid.
    pub fn cells_of(&self, unit: TileId) -> u64 {
        let lines =
            |axis: usize, tile: u64| [0, 1].map(|k| self.info.grid.line(axis, unit.depth, (tile + k) * CELLS as u64));
        let [[west, east], [north, south]] = [lines(0, unit.column), lines(1, unit.row)];
        (east - west) * (south - north)
    }
}

/// The step that a tolerance asks for, and the tolerance in units of coordinates.
fn scale_of(source: &HeightSource, tolerance: Tolerance) -> Result<(Scale, f64), HeightsError> {
    let height_scale = source.surface.height_scale;
    let wrong = |what: &str| HeightsError::Tolerance { what: what.to_owned() };
    let error = match tolerance {
        Tolerance::InputUnits(length) => length / height_scale,
        Tolerance::Metres(length) => {
            let unit = source.unit.ok_or_else(|| {
                wrong("the unit of the coordinates is unknown, so a tolerance with a unit has no meaning; pass --unit, too")
            })?;
            length / unit.metres / height_scale
        }
        Tolerance::Auto | Tolerance::OfBend(_) => {
            let bend = mean_bend(source)?;
            let spacing = source.surface.spacing[0].min(-source.surface.spacing[1]);
            let flat = if source.surface.is_globe() { 1.0 } else { AUTO_FLAT * spacing };
            if bend > 0.0 { AUTO_BEND * bend } else { flat / height_scale }
        }
        Tolerance::OfDiagonal(_) | Tolerance::OfMeanEdge(_) => {
            return Err(wrong("the tolerance of heights is a length, as 0.5 or 20cm, or auto"));
        }
    };
    let zero = source.zero;
    // Integers at odd steps are at most half a step off, rounded down.
    let step = match source.is_integer() && zero.fract() == 0.0 {
        true => 2.0 * error.floor() + 1.0,
        false => 2.0 * error,
    };
    if step == 0.0 {
        return Err(wrong("a tolerance of 0 keeps integers, and these heights are none; pass a small one, as 1cm"));
    }
    if step > MAX_STEP {
        return Err(wrong("the tolerance is larger than any height; pass a smaller --tolerance"));
    }
    Ok((Scale { zero, step }, error * height_scale))
}

/// How far samples are from the middle of their neighbours to the west and the east, on average.
fn mean_bend(source: &HeightSource) -> Result<f64, ImportError> {
    let (mut sum, mut count) = (0.0, 0u64);
    source.for_each_row::<ImportError>(|_, heights| {
        for run in heights.windows(3) {
            let bend = (run[1] - 0.5 * (run[0] + run[2])).abs();
            if !bend.is_nan() {
                sum += bend;
                count += 1;
            }
        }
        Ok(())
    })?;
    Ok(if count > 0 { sum / count as f64 } else { 0.0 })
}

/// Reads all samples.
fn gather(
    source: &HeightSource,
    scale: Scale,
    keep: Keep<'_>,
    progress: &dyn Progress,
) -> Result<Samples, HeightsError> {
    let mut gather = Gather::new(&source.grid, scale, keep)?;
    let columns = source.grid.samples()[0];
    let absent = source.for_each_row::<HeightsError>(|_, heights| {
        gather.push(heights)?;
        progress.advance(columns);
        Ok(())
    })?;
    source.note_absent(absent, progress)?;
    gather.finish()
}

/// The statistics of symbols, from some of the units and all tiles above them.
fn encoder(
    setting: &Setting<'_>,
    samples: &Samples,
    units: &[TileId],
    tops: &[Top],
) -> Result<TileEncoder, HeightsError> {
    let is_all = units.len() <= FEW_UNITS;
    let thinned = if is_all { 0 } else { THINNED_DEPTHS };
    let every = units.len().div_ceil(SAMPLED_UNITS).max(1);
    let above: HashMap<TileId, TileValues> = tops.iter().map(|top| (top.id, top.values())).collect();
    let sampled: Vec<_> = units.iter().skip(every / 2).step_by(every).collect();
    let symbols = sampled.par_iter().map(|&&root| -> Result<_, HeightsError> {
        let unit = Unit::read(setting, samples, root)?;
        let mut symbols = vec![];
        if let Some(values) = unit.values(root) {
            let parent = root.parent().and_then(|parent| above.get(&parent));
            unit.symbols((root, thinned), parent, &values, &mut symbols)?;
        }
        Ok(symbols)
    });
    let mut symbols = symbols.collect::<Result<Vec<_>, _>>()?.concat();
    symbols.extend(symbols_of_tops(setting, &above, tops)?);
    Ok(TileEncoder::new(&symbols, is_all))
}
