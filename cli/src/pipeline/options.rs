//! What a build is asked for, and why it may fail.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::geometry_images::AtlasError;
use crate::geometry_images::atlas_build::InputError;
use crate::import::{ImportError, Overflow, Room, is_gltf};
use crate::job::JobError;
use crate::mesh::tolerance::{Tolerance, Unit};
use crate::region::{Division, REGION_TRIANGLES, RegionError};
use crate::storage::WorkError;

/// How much a build may try.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Effort {
    /// Smaller charts, looser certificates.
    Fast,
    /// Charts as large as pays, tight certificates.
    #[default]
    Default,
    /// Larger charts, and on every disk a grid is tried.
    Best,
}

/// Which fillings a build may use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Fillings {
    /// Per chart the one that is smaller at equal error, as far as the effort allows to find out.
    #[default]
    Auto,
    /// No grids. For comparisons.
    IrregularOnly,
    /// Grids wherever a chart can be one within the tolerance, whatever they cost. For tests and comparisons.
    GridWherePossible,
}

/// What a build is asked for.
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// Input files, or one atlas directory.
    pub inputs: Vec<PathBuf>,
    /// Bound on the certified error of the finest level.
    pub tolerance: Tolerance,
    /// Unit of the input's coordinates, where known. Inputs that are all glTF are in metres without it.
    pub unit: Option<Unit>,
    /// Run time against bytes.
    pub effort: Effort,
    /// Fillings that may be used.
    pub fillings: Fillings,
    /// Input triangles per chart aimed at, up to the automatic tolerance; a coarser one gets larger charts. None: as many as
    /// the effort and the smoothness of the surface suggest. Smaller charts lose bytes to borders, larger ones stream coarsely.
    pub chart_triangles: Option<u32>,
    /// Triangles per region at most; see [`crate::region`].
    pub region_triangles: u64,
    /// Whether regions, lattice and charts should stay as they are when something is added to the input ([`crate::job::Job::add`]). It
    /// takes a tolerance that does not depend on the input.
    pub extensible: bool,
    /// Bytes of memory that the build may take; where it needs more, it uses temporary files. The result does not depend on it.
    pub memory: u64,
    /// The directory that a build works in where that is necessary: it is made, and removed at the end unless there is something
    /// to go on with.
    pub work: PathBuf,
    /// Goes on with what an earlier build of the same inputs and options has left in `work`, if anything.
    pub resume: bool,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            inputs: vec![],
            tolerance: Tolerance::Auto,
            unit: None,
            effort: Effort::Default,
            fillings: Fillings::Auto,
            chart_triangles: None,
            region_triangles: REGION_TRIANGLES,
            extensible: false,
            memory: u64::MAX,
            work: std::env::temp_dir().join(format!("lodpack-{}.building", std::process::id())),
            resume: false,
        }
    }
}

impl BuildOptions {
    /// Checks what can be known before anything is built, and finds the unit where a tolerance needs it: glTF is in metres.
    pub(crate) fn checked(&self) -> Result<Self, BuildError> {
        self.check()?;
        // What does not depend on the unit stays the same job whatever the unit is.
        let unit = match self.tolerance {
            Tolerance::Metres(_) if self.unit.is_none() => self.unit_of_inputs()?,
            _ => self.unit,
        };
        Ok(Self { unit, ..self.clone() })
    }

    /// Metres, if all inputs are glTF.
    fn unit_of_inputs(&self) -> Result<Option<Unit>, BuildError> {
        let mut others = vec![];
        for input in &self.inputs {
            // Atlases have no unit.
            if input.is_dir() || !is_gltf(input)? {
                others.push(input);
            }
        }
        match others.first() {
            None if self.inputs.is_empty() => Ok(None),
            None => Ok(Some(Unit { metres: 1.0 })),
            Some(other) => {
                let what = match others.len() == self.inputs.len() {
                    true => "the tolerance has a unit but the input has none; pass --unit mm (or m, cm, ...) to say what the \
                             coordinates are in, or give the tolerance without a unit"
                        .into(),
                    false => format!(
                        "the tolerance has a unit, and glTF is in metres, but {} does not say what it is in; pass --unit m if it \
                         is in metres too, or give the tolerance without a unit",
                        other.display()
                    ),
                };
                Err(BuildError::Tolerance { what })
            }
        }
    }

    fn check(&self) -> Result<(), BuildError> {
        let is_length = matches!(self.tolerance, Tolerance::InputUnits(_) | Tolerance::Metres(_));
        if self.extensible && !is_length {
            let what =
                "a job to which more can be added needs a tolerance that stays the same: pass --tolerance as a length";
            return Err(BuildError::Tolerance { what: what.into() });
        }
        match self.inputs.iter().find(|input| self.extensible && input.is_dir()) {
            Some(atlas) => Err(JobError::Extend {
                path: atlas.clone(),
                what: "nothing can be added to an atlas; add to the mesh that it was made from".into(),
            }
            .into()),
            None => Ok(()),
        }
    }

    pub(crate) fn division(&self) -> Division {
        Division { triangles: self.region_triangles, is_fixed: self.extensible }
    }

    pub(crate) fn room(&self) -> Room {
        Room { memory: self.memory, overflow: Overflow::New(self.work.clone()) }
    }
}

/// Why a build failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// An input is unusable.
    #[error(transparent)]
    Import(#[from] ImportError),
    /// An atlas directory is unusable.
    #[error(transparent)]
    Atlas(#[from] AtlasError),
    /// The tolerance does not fit the input.
    #[error("{what}")]
    Tolerance {
        /// What is wrong and what would do.
        what: String,
    },
    /// Lengths that cannot be computed with.
    #[error(
        "the model reaches over {size:e} units: only sizes from {smallest:e} to {largest:e} can be built; scale its coordinates"
    )]
    Size {
        /// Extent, or distance from the origin.
        size: f64,
        /// Smallest possible extent.
        smallest: f64,
        /// Largest possible coordinate.
        largest: f64,
    },
    /// Nothing is left of the input.
    #[error(
        "{input}: no triangle with an area is left after repair ({dropped} degenerate or duplicate triangles were dropped)"
    )]
    Empty {
        /// The first input.
        input: String,
        /// How many triangles were dropped.
        dropped: u64,
    },
    /// The memory or the disk space does not do.
    #[error(transparent)]
    Region(#[from] RegionError),
    /// What an earlier build has left, or others have made, is of no use.
    #[error(transparent)]
    Job(#[from] JobError),
    /// The format layer refused the model.
    #[error("cannot write the file: {0}")]
    Write(#[from] lodpack::Error),
}

impl BuildError {
    /// The file of a build's state, or of temporary ones, that cannot be used, if that is what is wrong.
    pub fn work(&self) -> Option<&WorkError> {
        match self {
            Self::Region(RegionError::Work(error))
            | Self::Import(ImportError::Work(error))
            | Self::Job(JobError::Work(error)) => Some(error),
            _ => None,
        }
    }

    /// Whether another try, perhaps with more space, can go on from where this one stopped.
    pub fn can_be_resumed(&self) -> bool {
        match self {
            Self::Region(RegionError::Work(error)) => error.source.kind() != std::io::ErrorKind::WouldBlock,
            Self::Write(_) => true,
            _ => false,
        }
    }
}

impl From<InputError> for BuildError {
    fn from(error: InputError) -> Self {
        match error {
            InputError::Import(error) => Self::Import(error),
            InputError::Atlas(error) => Self::Atlas(error),
            InputError::Work(error) => Self::Region(error.into()),
        }
    }
}

impl From<WorkError> for BuildError {
    fn from(error: WorkError) -> Self {
        Self::Region(error.into())
    }
}
