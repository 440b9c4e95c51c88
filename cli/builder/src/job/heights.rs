//! Jobs that make files of heights: the grid is divided among parts, whole units at a time.
//!
//! The process that plans reads the rasters once, puts their samples in steps into one file, and finds what all units
//! have in common. A part reads the samples of its units, and checks them. It hands on their tiles, and what they have
//! seen of the tiles above them, which are made by the merge.

use std::collections::HashSet;
use std::io::Write;
use std::ops::Range;
use std::path::Path;

use lodpack::heights::TileId;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::merge::{FoundPart, Parts};
use super::plan::{Job, PartOptions};
use super::stage::even_runs;
use super::{BuildError, BuildOptions, Manifest, PartEntry, file_name, typed_raster};
use crate::heights::{About, Basis, Builder, BuiltUnit, HeightsError, HeightsSummary, Joint, Keep, Samples, Seen};
use crate::pipeline::PipelineError;
use crate::pipeline::summary::Stopwatch;
use lodpack_import::raster::HeightSource;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::least_bytes;
use lodpack_runtime::storage::{DAMAGED, JobId, PLAN_NAME, SealedReader, SealedWriter, WorkDirectory, WorkError};

/// The samples of all rasters, in steps.
const SAMPLES_NAME: &str = "samples";
const PLAN_KIND: [u8; 4] = *b"hpln";
const PART_KIND: [u8; 4] = *b"hprt";
/// Units of a part, where nobody says how many parts there are: 16 million samples.
const UNITS_PER_PART: usize = 16;
/// Memory for each sample of a unit that is worked on, with the tables of its squares.
const SAMPLE_BYTES: u64 = 40;
/// Memory for a tile above the units: 1.0 MB were measured.
const TOP_BYTES: u64 = 5 << 18;
/// Threads whose units are counted.
const THREADS: u64 = 2;

/// A planned job of heights.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct HeightsPlan {
    basis: Basis,
    about: About,
}

/// Plans a job in a directory of its own until its parts can be built.
pub(super) fn plan(
    path: &Path,
    parts: PartOptions,
    options: &BuildOptions,
    progress: &dyn Progress,
) -> Result<Manifest, BuildError> {
    let source = HeightSource::open(&options.inputs, &typed_raster(&options.model), progress)?.ok_or_else(|| {
        let what = "--as heights is for rasters of heights, and the inputs are none; omit it";
        PipelineError::Tolerance { what: what.into() }
    })?;
    parts.refuse_below(least_bytes(0))?;
    let mut job = match options.resume && path.exists() {
        true => Job::resume(path, options)?,
        false => Job::begin(WorkDirectory::create(path)?, options)?,
    };
    job.directory.keep(true);
    let id = job.manifest.id();
    let plan = match HeightsPlan::read(path, id) {
        Ok(plan) => plan,
        Err(_) => HeightsPlan::make(&source, &job, options, progress).inspect_err(|error| {
            // More space can mend these errors, so the directory stays.
            let is_worth_keeping =
                matches!(error, BuildError::Heights(HeightsError::Samples { .. }) | BuildError::Job(_));
            job.directory.keep(is_worth_keeping || options.resume);
        })?,
    };
    let entries = plan.part_entries(parts.count);
    parts.refuse_below(entries.iter().map(|entry| entry.memory).max().unwrap_or(0))?;
    job.manifest.parts = entries;
    job.manifest.output = file_name::product_name(path, &options.inputs);
    job.manifest.write(path)?;
    Ok(job.manifest)
}

impl HeightsPlan {
    fn make(
        source: &HeightSource,
        job: &Job,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Self, BuildError> {
        let samples = job.directory.path(SAMPLES_NAME);
        let tolerance = options.model.tolerance;
        let mut watch = Stopwatch::default();
        // Nothing is read of samples without a plan that knows them.
        let (basis, samples) = Basis::new(source, tolerance, Keep::Named(&samples), progress, &mut watch)?;
        let plan = Self { basis, about: samples.about };
        let mut writer = SealedWriter::within(&job.directory, PLAN_NAME, PLAN_KIND, job.manifest.id())?;
        writer.put(&plan)?;
        writer.finish(true)?;
        Ok(plan)
    }

    /// Reads the plan of a job.
    pub fn read(job: &Path, id: JobId) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open_of_job(&job.join(PLAN_NAME), PLAN_KIND, id)?;
        let plan = reader.get()?;
        reader.finish()?;
        Ok(plan)
    }

    /// Divides the units into runs of about equally many cells. Some runs are empty where there are fewer units than
    /// parts.
    fn part_entries(&self, parts: Option<u32>) -> Vec<PartEntry> {
        let units = self.basis.units();
        let cells: Vec<u64> = units.iter().map(|&unit| self.basis.cells_of(unit)).collect();
        let parts = parts.unwrap_or(units.len().div_ceil(UNITS_PER_PART) as u32);
        let of_unit = SAMPLE_BYTES * THREADS * cells.iter().max().unwrap_or(&0);
        let entry = |run: Range<u32>| {
            let run = run.start as usize..run.end as usize;
            PartEntry {
                first_region: run.start as u32,
                regions: run.len() as u32,
                triangles: 2 * cells[run.clone()].iter().sum::<u64>(),
                memory: least_bytes(of_unit + TOP_BYTES * tops_above(&units[run]) as u64),
            }
        };
        even_runs(cells.iter().copied(), parts).into_iter().map(entry).collect()
    }

    /// The beginning of a part.
    fn head(&self, (part, parts, units): (u32, u32, Range<u32>)) -> Result<HeightsHead, WorkError> {
        Ok(HeightsHead { part, parts, units, basis: hash_of(&self.basis) })
    }

    /// Builds a part, and returns the size of its file; none if it existed already.
    pub fn build_part(
        &self,
        job: &Path,
        id: JobId,
        of: (u32, u32, Range<u32>),
        path: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<u64>, BuildError> {
        let head = self.head(of)?;
        let all = self.basis.units();
        let units = all.get(head.units.start as usize..head.units.end as usize).unwrap_or_default();
        let cells = units.iter().map(|&unit| self.basis.cells_of(unit)).sum();
        progress.begin("tiles", cells);
        if HeightsPart::open(path).is_ok_and(|there| there.job == id && there.head == head && there.finish().is_ok()) {
            progress.skip(cells);
            return Ok(None);
        }
        let samples = Samples::open(&job.join(SAMPLES_NAME), self.basis.grid(), self.about.clone())?;
        let mut writer = SealedWriter::create(path, PART_KIND, id)?;
        writer.put(&head)?;
        // The merge has all parts, so one of them is enough to know what they have in common.
        writer.put(&(head.part == 0).then_some(&self.basis))?;
        let mut builder = Builder::new(&self.basis, units)?;
        builder.build(&samples, units, progress, |unit| writer.put(&unit).map_err(BuildError::from))?;
        writer.put(&builder.seen())?;
        Ok(Some(writer.finish(!units.is_empty())?))
    }
}

/// How many tiles lie above some units.
fn tops_above(units: &[TileId]) -> usize {
    let above = units.iter().flat_map(|unit| (0..unit.depth).map(|depth| unit.ancestor(depth)));
    above.collect::<HashSet<TileId>>().len()
}

/// What tells one basis from another.
fn hash_of(basis: &Basis) -> u64 {
    // Plain data always has such a form.
    xxh3_64(&postcard::to_stdvec(basis).unwrap_or_default())
}

/// The beginning of a part's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct HeightsHead {
    /// Number of the part, from 0.
    pub part: u32,
    /// The number of parts in the job.
    pub parts: u32,
    units: Range<u32>,
    /// The hash of what all units have in common. The file of part 0 has it.
    pub basis: u64,
}

/// Reads a part, unit after unit.
pub(super) struct HeightsPart {
    reader: SealedReader,
    pub job: JobId,
    pub head: HeightsHead,
    basis: Option<Basis>,
}

impl HeightsPart {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open(path, PART_KIND)?;
        let (head, basis): (HeightsHead, Option<Basis>) = (reader.get()?, reader.get()?);
        if head.part >= head.parts || head.units.start > head.units.end || basis.is_some() != (head.part == 0) {
            return Err(WorkError::damaged(path, DAMAGED));
        }
        Ok(Self { job: reader.job, reader, head, basis })
    }

    /// What checking all of a file says about it.
    pub fn check(path: &Path) -> Result<FoundPart<u64>, WorkError> {
        let part = Self::open(path)?;
        let found = FoundPart {
            job: part.job,
            part: part.head.part,
            parts: part.head.parts,
            regions: part.head.units.len() as u32,
            all_regions: part.basis.as_ref().map(|basis| basis.units().len() as u32),
            plan: part.head.basis,
        };
        part.finish()?;
        Ok(found)
    }

    /// Whether a file is a part of a job of heights.
    pub fn is_one(path: &Path) -> bool {
        SealedReader::open(path, PART_KIND).is_ok()
    }

    /// Reads the rest and checks everything.
    pub fn finish(self) -> Result<(), WorkError> {
        self.reader.finish()
    }
}

/// Joins the parts of a job of heights to a file. Blocks wait in a file in the directory `scratch`.
///
/// # Errors
/// If a part can no longer be read, or `out` cannot be written.
pub fn merge_heights(
    parts: &Parts,
    scratch: &Path,
    out: &mut impl Write,
    progress: &dyn Progress,
) -> Result<HeightsSummary, BuildError> {
    let damaged = |path: &Path| WorkError::damaged(path, DAMAGED);
    let first = parts.files.first().ok_or_else(|| damaged(scratch))?;
    let basis = HeightsPart::open(first)?.basis.ok_or_else(|| damaged(first))?;
    let watch = Stopwatch::default();
    let units = basis.units();
    progress.begin("tiles", units.len() as u64);
    let mut builder = Builder::new(&basis, &units)?;
    let mut joint = Joint::new(scratch)?;
    let mut next = 0;
    for path in &parts.files {
        let HeightsPart { mut reader, head, .. } = HeightsPart::open(path)?;
        // A part without units is nowhere among the others.
        if !head.units.is_empty() && (head.units.start != next || head.units.end as usize > units.len()) {
            return Err(damaged(path).into());
        }
        next = next.max(head.units.end);
        for _ in head.units {
            let unit: BuiltUnit = reader.get()?;
            joint.put(unit)?;
            progress.advance(1);
        }
        let seen: Seen = reader.get()?;
        builder.join(seen);
        reader.finish()?;
    }
    if next as usize != units.len() {
        return Err(damaged(first).into());
    }
    Ok(joint.finish(&builder, None, out, progress, watch)?)
}
