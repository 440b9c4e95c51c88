//! What a build is asked for.

use std::path::PathBuf;

use super::input::unit_of_inputs;
use super::{BuildError, JobError};
use lodpack::index::{Placement, UpAxis};

use crate::pipeline::{ModelOptions, PipelineError};
use lodpack_import::raster::{RasterOptions, RasterPlace, survey};
use lodpack_import::{Objects, Overflow, Room, survey_meshes};
use lodpack_mesh::tolerance::{Tolerance, Unit};
use lodpack_runtime::progress::{Progress, Silent};

/// `auto` for rasters, in [`Tolerance::OfBend`].
const AUTO_BENDS: f64 = 2.0;

/// What a build is asked for.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Input files, or one atlas directory.
    pub inputs: Vec<PathBuf>,
    /// The options that the bytes of the file depend on.
    pub model: ModelOptions,
    /// Bytes of memory that the build may take. Where it needs more, it uses temporary files; the file does not depend
    /// on it.
    pub memory: u64,
    /// The directory that a build works in where the input does not fit in memory. It is made when needed, and removed
    /// at the end unless the build can be resumed from it.
    pub work: PathBuf,
    /// What the ground that the mesh stands on is made of. Whoever plans a job makes the ground, and puts it into the
    /// directory ([`super::keep_ground`]); the job only remembers these.
    pub ground: Vec<PathBuf>,
    /// Keeps the grid of rasters: the job makes a file of heights ([`crate::heights`]).
    pub heights: bool,
    /// Resumes the build of the same inputs and options that an earlier process has left in `work`, if there is one.
    pub resume: bool,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            inputs: vec![],
            model: ModelOptions::default(),
            memory: u64::MAX,
            work: std::env::temp_dir().join(format!("lodpack-{}.building", std::process::id())),
            ground: vec![],
            heights: false,
            resume: false,
        }
    }
}

impl BuildOptions {
    /// Checks what can be known before anything is built, and finds the unit where the tolerance needs it.
    pub(super) fn checked(&self, progress: &dyn Progress) -> Result<Self, BuildError> {
        self.check()?;
        let inputs: &[PathBuf] = if self.inputs.iter().any(|input| input.is_dir()) { &[] } else { &self.inputs };
        let raster = typed_raster(&self.model);
        if let Some(place) = survey(inputs, &raster)? {
            return Ok(Self { model: of_raster(&self.model, raster, place), ..self.clone() });
        }
        if !self.model.raster.is_default() && !inputs.is_empty() {
            let what = "the inputs are no rasters, so options of rasters have no meaning: omit them";
            return Err(PipelineError::Tolerance { what: what.into() }.into());
        }
        let (typed, said) = (self.model.placement.as_ref(), survey_meshes(inputs, progress));
        let placement = completed(typed, said, self.model.unit);
        // Where the tolerance needs no unit, the job stays the same whatever the unit is.
        let unit = match (self.model.tolerance, placement.as_ref().and_then(|placement| placement.unit)) {
            (Tolerance::Metres(_), Some(metres)) if self.model.unit.is_none() => Some(Unit { metres }),
            (Tolerance::Metres(_), None) if self.model.unit.is_none() => unit_of_inputs(&self.inputs)?,
            _ => self.model.unit,
        };
        Ok(Self { model: ModelOptions { unit, placement, ..self.model.clone() }, ..self.clone() })
    }

    /// Where the mesh will be in the world, by what was typed and by what the inputs say of themselves.
    ///
    /// # Errors
    /// As for builds, as far as that is known before anything is built.
    pub fn place(&self) -> Result<Option<Placement>, BuildError> {
        // Whoever builds then hears the notes.
        Ok(self.checked(&Silent)?.model.placement)
    }

    fn check(&self) -> Result<(), BuildError> {
        let ModelOptions { tolerance, extensible, .. } = self.model;
        let is_length = matches!(tolerance, Tolerance::InputUnits(_) | Tolerance::Metres(_));
        if extensible && !is_length {
            let what =
                "a job to which more can be added needs a tolerance that stays the same: pass --tolerance as a length";
            return Err(PipelineError::Tolerance { what: what.into() }.into());
        }
        if extensible && self.model.objects == Objects::Keep {
            let what = "a job to which more can be added joins its objects to one surface: omit --objects keep";
            return Err(PipelineError::Tolerance { what: what.into() }.into());
        }
        match self.inputs.iter().find(|input| extensible && input.is_dir()) {
            Some(atlas) => Err(JobError::Extend {
                path: atlas.clone(),
                what: "nothing can be added to an atlas; add to the mesh that it was made from".into(),
            }
            .into()),
            None => Ok(()),
        }
    }

    /// The memory that an import may take, and where it goes beyond that.
    pub(super) fn room(&self) -> Room {
        Room { memory: self.memory, overflow: Overflow::New(self.work.clone()) }
    }
}

/// What was typed for rasters and for all inputs.
pub fn typed_raster(model: &ModelOptions) -> RasterOptions {
    let placement = model.placement.as_ref();
    RasterOptions {
        // What was typed at first says more than the name that files keep: it may name a system of heights, too.
        crs: model
            .raster
            .crs
            .clone()
            .or(placement.map(|placement| placement.crs.clone()).filter(|crs| !crs.is_empty())),
        origin: placement.map(|placement| placement.origin).filter(|origin| *origin != [0.0; 3]),
        unit: model.unit,
        ..model.raster.clone()
    }
}

/// What was typed about the place of the coordinates, and beneath it what the inputs say. A CRS that was typed has the
/// origin that was typed.
fn completed(typed: Option<&Placement>, said: Option<Placement>, unit: Option<Unit>) -> Option<Placement> {
    let (Some(typed), Some(said)) = (typed, &said) else {
        // The file says in which unit it is only beside something else.
        return typed
            .cloned()
            .or(said.map(|said| Placement { unit: unit.map(|unit| unit.metres).or(said.unit), ..said }));
    };
    let place = if typed.crs.is_empty() && typed.origin == [0.0; 3] { said } else { typed };
    let up = if typed.up == UpAxis::Unknown { said.up } else { typed.up };
    Some(Placement { up, unit: typed.unit.or(said.unit), origin: place.origin, crs: place.crs.clone() })
}

/// Completes options by what rasters say about themselves.
fn of_raster(
    model: &ModelOptions,
    raster: RasterOptions,
    RasterPlace { unit, placement }: RasterPlace,
) -> ModelOptions {
    let up = model.placement.as_ref().map(|typed| typed.up).filter(|&up| up != UpAxis::Unknown);
    let placement = Placement { up: up.unwrap_or(placement.up), ..placement };
    let raster = RasterOptions { is_used: true, ..raster };
    let tolerance = match model.tolerance {
        Tolerance::Auto => Tolerance::OfBend(AUTO_BENDS),
        other => other,
    };
    ModelOptions { tolerance, unit: unit.or(model.unit), placement: Some(placement), raster, ..model.clone() }
}
