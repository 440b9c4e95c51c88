//! Building units, and joining them to a file.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use lodpack::heights::{CELLS, Drape, DrapeWriter, TileEncoder, TileId};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::above::{Above, Seen};
use super::basis::Basis;
use super::drape::DrapeSummary;
use super::facets::Judge;
use super::samples::Samples;
use super::spill::Spill;
use super::tile::Setting;
use super::unit::{Below, Finished, Unit};
use super::{HeightsError, HeightsSummary};
use crate::pipeline::summary::Stopwatch;
use lodpack_runtime::machine::peak_memory_bytes;
use lodpack_runtime::progress::Progress;

/// A unit as it was built: its tiles, and what the tiles above have to know of it; none if it has no drawn cell.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct BuiltUnit {
    said: Option<Below>,
    tiles: Vec<Finished>,
}

/// Builds some of the units of a grid. It keeps what these have seen of the tiles above them.
pub struct Builder<'a> {
    basis: &'a Basis,
    setting: Setting<'a>,
    encoder: TileEncoder,
    above: Above,
}

impl<'a> Builder<'a> {
    /// A builder for some units.
    ///
    /// # Errors
    /// [`HeightsError`] if the basis is damaged.
    pub fn new(basis: &'a Basis, units: &[TileId]) -> Result<Self, HeightsError> {
        let setting = basis.setting();
        let above = Above::new(&setting, &basis.tops, units)?;
        Ok(Self { basis, setting, encoder: TileEncoder::of_tables(&basis.tables)?, above })
    }

    /// Builds units, and hands them on in their order.
    ///
    /// # Errors
    /// [`HeightsError`], and those of `with`.
    pub fn build<E: From<HeightsError>>(
        &mut self,
        samples: &Samples,
        units: &[TileId],
        progress: &dyn Progress,
        mut with: impl FnMut(BuiltUnit) -> Result<(), E>,
    ) -> Result<(), E> {
        // Units are taken in bunches, so that few wait for their turn to be joined.
        for bunch in units.chunks(4 * rayon::current_num_threads()) {
            let done = bunch.par_iter().map(|&root| self.built(samples, root, progress)).collect::<Vec<_>>();
            for done in done {
                let (unit, seen) = done?;
                self.above.join(seen);
                with(unit)?;
            }
        }
        Ok(())
    }

    fn built(
        &self,
        samples: &Samples,
        root: TileId,
        progress: &dyn Progress,
    ) -> Result<(BuiltUnit, Seen), HeightsError> {
        let Self { setting, above, encoder, .. } = self;
        let unit = Unit::read(setting, samples, root)?;
        let (cells, falls) = (CELLS << (setting.grid.depth() - root.depth), (root.column + root.row).is_multiple_of(2));
        let judge = Judge::new((&unit.window, cells, falls), setting.scale, setting.surface, setting.highest);
        let seen = above.seen(root, &judge);
        let Some(values) = unit.values(root) else { return Ok((BuiltUnit { said: None, tiles: vec![] }, seen)) };
        let (said, tiles) = unit.finish(encoder, &judge, root, above.parent(root), values)?;
        let [[west, east], [north, south]] = [unit.window.columns, unit.window.rows];
        progress.advance((east - west) * (south - north));
        Ok((BuiltUnit { said: Some(said), tiles }, seen))
    }

    /// What all of its units have seen.
    pub fn seen(&self) -> Seen {
        self.above.all_seen()
    }

    /// Takes over what another builder's units have seen.
    pub fn join(&mut self, seen: Seen) {
        self.above.join(seen);
    }
}

/// Units that are joined to a file.
pub struct Joint {
    said: Vec<Below>,
    spill: Spill,
}

impl Joint {
    /// Blocks go to a file of this folder that has no name once it is open.
    ///
    /// # Errors
    /// [`HeightsError::Work`].
    pub fn new(folder: &Path) -> Result<Self, HeightsError> {
        Ok(Self { said: vec![], spill: Spill::new(folder)? })
    }

    /// Takes a unit.
    ///
    /// # Errors
    /// [`HeightsError::Work`].
    pub fn put(&mut self, unit: BuiltUnit) -> Result<(), HeightsError> {
        self.said.extend(unit.said);
        self.spill.put(unit.tiles)
    }

    /// Whether none of the units has a drawn cell.
    pub fn is_empty(&self) -> bool {
        self.said.is_empty()
    }

    /// Makes the tiles above the units, and writes the file, with an image over it and the step that it was coded with.
    /// The builder has seen all units.
    ///
    /// # Errors
    /// [`HeightsError`].
    pub fn finish(
        self,
        builder: &Builder<'_>,
        drape: Option<(DrapeWriter<File>, u8)>,
        out: &mut impl Write,
        progress: &dyn Progress,
        mut watch: Stopwatch,
    ) -> Result<HeightsSummary, HeightsError> {
        let Builder { basis, setting, encoder, above } = builder;
        if self.is_empty() {
            return Err(HeightsError::Empty);
        }
        above.finish(setting, encoder, self.said, &self.spill)?;
        watch.lap("tiles");
        progress.begin("write", 0);
        let image = drape.as_ref().map(|(writer, step)| (*writer.drape(), *step));
        let written = self.spill.write(basis, encoder, drape.map(|(writer, _)| writer), out)?;
        let (drape_bytes, samples) = (written.drape_bytes, setting.grid.samples().iter().product::<u64>());
        let drape = image.map(|(Drape { size, components, .. }, step)| DrapeSummary {
            size,
            components,
            step,
            bytes: drape_bytes,
        });
        watch.lap("write");
        let (wall, cpu) = watch.total();
        Ok(HeightsSummary {
            samples,
            cells: setting.grid.cells(),
            tiles: written.tiles,
            depth: setting.grid.depth(),
            triangles: written.triangles,
            tolerance: basis.tolerance,
            sample_error: setting.error,
            certified_error: written.error,
            bytes: written.bytes,
            drape,
            bits_per_sample: 8.0 * (written.bytes - drape_bytes) as f64 / samples as f64,
            stages: watch.stages,
            wall_seconds: wall.as_secs_f64(),
            cpu_seconds: cpu.as_secs_f64(),
            peak_memory_bytes: peak_memory_bytes(),
        })
    }
}
