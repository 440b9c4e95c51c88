//! The last stages of a job in stages: the order of the file, and clusters as bytes. What is left for a merge is to put
//! these together.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::path::{Path, PathBuf};

use lodpack::write::{EncodedCluster, Encoder, EncoderHead, EncoderShare, Piece};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::merge::PartProducts;
use super::part::{PartReader, part_name};
use super::plan::read_plan;
use super::planned::PARTS_NAME;
use super::stage::{TaskFiles, encoder_file};
use super::tasks::KIND;
use super::{BuildError, JobError, Manifest, Stage, Stages};
use crate::pipeline::summary::{BuildSummary, Times};
use crate::pipeline::{Arranged, PipelineError, Sums, arrange, join_encoded};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::{JobId, SealedReader, SealedWriter, WorkError};
use lodpack_runtime::text::shell;

const ENCODER_KIND: [u8; 4] = *b"encd";

/// What is known of a file once its parts are ordered.
#[derive(Serialize, Deserialize)]
struct ArrangeProduct {
    head: EncoderHead,
    sums: Sums,
    /// For each cluster the task of [`Stage::Encode`] that encodes it.
    tasks: Vec<u32>,
}

/// A job whose parts are built.
pub(super) struct BuiltJob<'a> {
    pub folder: &'a Path,
    pub manifest: &'a Manifest,
    pub stages: Stages,
}

impl BuiltJob<'_> {
    /// Orders all parts, and writes for each task of [`Stage::Encode`] what it has to know. Returns the bytes of these
    /// files.
    pub fn arrange(&self) -> Result<u64, BuildError> {
        let (plan, _) = read_plan(self.folder, self.manifest.id())?;
        let paths: Vec<PathBuf> = (0..self.manifest.parts.len() as u32).map(|part| self.part(part)).collect();
        (0..).zip(&paths).try_for_each(|(part, path)| self.open_part(part, path).map(drop))?;
        let arranged = arrange(&plan, &PartProducts { paths }, Times::default());
        // A part whose head is damaged is not named by the pipeline.
        let Arranged { encoder, sums, above } = arranged.map_err(|error| match error {
            PipelineError::Region(crate::region::RegionError::Work(error)) => self.broken(&error),
            other => other.into(),
        })?;
        let tasks = self.tasks_of_clusters(&encoder).map_err(PipelineError::from)?;
        let mut bytes = 0;
        for task in 0..self.stages.tasks(Stage::Encode) {
            let own: Vec<usize> = (0..tasks.len()).filter(|&cluster| tasks[cluster] == task).collect();
            if own.is_empty() {
                continue;
            }
            let share = encoder.share(&own).map_err(PipelineError::from)?;
            // Few clusters have anything of the groups above regions, and these are small.
            let above = above.as_ref().filter(|_| share.pieces().contains(&plan.regions));
            let path = encoder_file(self.folder, task);
            let mut writer = SealedWriter::create(&path, ENCODER_KIND, self.id())?;
            writer.put(&share)?;
            writer.put(&above)?;
            bytes += writer.finish(true)?;
        }
        let product = ArrangeProduct { head: encoder.head(), sums, tasks };
        Ok(bytes + self.hand_on(Stage::Arrange, 0, |writer| writer.put(&product))?)
    }

    /// Gives each cluster to the task whose parts have a region with most of its roots.
    fn tasks_of_clusters(&self, encoder: &Encoder) -> lodpack::Result<Vec<u32>> {
        let (parts, tasks) = (&self.manifest.parts, self.stages.tasks(Stage::Encode));
        let of_part = |part: usize| (part as u64 * u64::from(tasks) / parts.len() as u64) as u32;
        let of_regions: Vec<u32> =
            parts.iter().enumerate().flat_map(|(part, entry)| vec![of_part(part); entry.regions as usize]).collect();
        let task = |cluster: usize| {
            // Groups above regions have the piece after those of regions.
            let mut pieces = encoder.pieces_of(cluster)?;
            pieces.retain(|&piece, _| (piece as usize) < of_regions.len());
            // The first of several that have as many.
            let most = pieces.into_iter().rev().max_by_key(|&(_, count)| count);
            Ok(most.map_or(cluster as u32 % tasks, |(piece, _)| of_regions[piece as usize]))
        };
        (0..encoder.cluster_count()).map(task).collect()
    }

    /// Encodes the clusters of a task.
    pub fn encode(&self, task: u32, progress: &dyn Progress) -> Result<u64, BuildError> {
        let path = encoder_file(self.folder, task);
        let ArrangeProduct { tasks, .. } = self.product(Stage::Arrange, 0)?;
        if !tasks.contains(&task) {
            // What can be made again at once need not reach the disk.
            return Ok(self.create(Stage::Encode, task)?.finish(false)?);
        }
        let mut reader = SealedReader::open_of_job(&path, ENCODER_KIND, self.id())?;
        let (mut share, above): (EncoderShare, Option<Piece>) = (reader.get()?, reader.get()?);
        reader.finish()?;
        let pieces = share.pieces();
        progress.begin("encode", pieces.len() as u64);
        for (part, entry) in (0..).zip(&self.manifest.parts) {
            let regions = entry.first_region..entry.first_region + entry.regions;
            if pieces.iter().any(|piece| regions.contains(piece)) {
                self.take(part, regions, &pieces, &mut share)?;
            }
        }
        if let (Some(above), Some(&last)) = (&above, pieces.last()) {
            share.take(last, above).map_err(PipelineError::from)?;
        }
        let bytes = self.hand_on(Stage::Encode, task, |writer| {
            let damaged = |error: lodpack::Error| WorkError::damaged(&path, &error.to_string());
            share.encode().map_err(damaged)?.try_for_each(|cluster| writer.put(&cluster.map_err(damaged)?))
        })?;
        Ok(bytes)
    }

    /// Takes those regions of a part that a share needs, and checks the whole part.
    fn take(&self, part: u32, regions: Range<u32>, wanted: &[u32], share: &mut EncoderShare) -> Result<(), BuildError> {
        let broken = |error: WorkError| self.broken(&error);
        let mut reader = self.open_part(part, &self.part(part))?;
        for region in regions {
            if wanted.binary_search(&region).is_err() {
                reader.pass().map_err(broken)?;
                continue;
            }
            let piece = reader.piece().map_err(broken)?;
            share.take(region, &piece).map_err(PipelineError::from)?;
        }
        reader.finish().map_err(broken)
    }

    fn part(&self, part: u32) -> PathBuf {
        self.folder.join(PARTS_NAME).join(part_name(part))
    }

    /// Opens a part, which has to be the one that the plan wants.
    fn open_part(&self, part: u32, path: &Path) -> Result<PartReader, BuildError> {
        let entry = &self.manifest.parts[part as usize];
        let regions = entry.first_region..entry.first_region + entry.regions;
        let opened = PartReader::open(path).map_err(|error| self.broken(&error))?;
        match opened.job == self.manifest.part_id() && opened.head.part == part && opened.head.regions == regions {
            true => Ok(opened),
            false => Err(self.broken(&WorkError::damaged(path, "it belongs to another plan"))),
        }
    }

    /// The error for a part that cannot be used, which says how to make it again.
    fn broken(&self, error: &WorkError) -> BuildError {
        let (job, path) = (shell(self.folder), error.path.display());
        let number = (0..self.manifest.parts.len() as u32).find(|&part| self.part(part) == error.path);
        let again = number.map(|part| format!("; `lodpack build --job {job} --part {part}` makes it"));
        let problems = vec![format!("{path}: {}{}", error.source, again.unwrap_or_default())];
        JobError::Parts { parts: self.manifest.parts.len() as u32, problems }.into()
    }

    /// Whether all clusters are encoded.
    pub fn is_encoded(&self) -> bool {
        let tasks = self.stages.tasks(Stage::Encode);
        let is_done = |task| TaskFiles::new(self.folder, Stage::Encode, task).product.exists();
        tasks > 0 && TaskFiles::new(self.folder, Stage::Arrange, 0).product.exists() && (0..tasks).all(is_done)
    }

    /// Puts the file together. An error of [`Self::is_encoded`] files leaves `out` empty.
    pub fn join(
        &self,
        scratch: &Path,
        out: &mut impl std::io::Write,
        progress: &dyn Progress,
    ) -> Result<BuildSummary, PipelineError> {
        let work = |error: WorkError| PipelineError::from(error);
        let (plan, _) = read_plan(self.folder, self.manifest.id()).map_err(work)?;
        let ArrangeProduct { head, sums, tasks } = self.product(Stage::Arrange, 0).map_err(work)?;
        let clusters = Clusters { job: self, tasks: tasks.into_iter(), readers: BTreeMap::new() };
        join_encoded(&plan, head, sums, clusters, scratch, out, progress)
    }

    fn product<T: DeserializeOwned>(&self, stage: Stage, task: u32) -> Result<T, WorkError> {
        let mut reader = self.open(stage, task)?;
        let value = reader.get()?;
        reader.finish()?;
        Ok(value)
    }

    fn open(&self, stage: Stage, task: u32) -> Result<SealedReader, WorkError> {
        SealedReader::open_of_job(&TaskFiles::new(self.folder, stage, task).product, KIND, self.id())
    }

    fn hand_on(
        &self,
        stage: Stage,
        task: u32,
        write: impl FnOnce(&mut SealedWriter) -> Result<(), WorkError>,
    ) -> Result<u64, WorkError> {
        let mut writer = self.create(stage, task)?;
        write(&mut writer)?;
        writer.finish(true)
    }

    fn create(&self, stage: Stage, task: u32) -> Result<SealedWriter, WorkError> {
        SealedWriter::create(&TaskFiles::new(self.folder, stage, task).product, KIND, self.id())
    }

    fn id(&self) -> JobId {
        self.manifest.part_id()
    }
}

/// The clusters that all tasks have encoded, in the order of the file, which is that of each task, too.
struct Clusters<'a> {
    job: &'a BuiltJob<'a>,
    /// Of the clusters that are left.
    tasks: std::vec::IntoIter<u32>,
    readers: BTreeMap<u32, SealedReader>,
}

impl Clusters<'_> {
    fn next_of(&mut self, task: u32) -> Result<EncodedCluster, WorkError> {
        let reader = match self.readers.entry(task) {
            Entry::Occupied(entry) => entry.into_mut(),
            Entry::Vacant(entry) => entry.insert(self.job.open(Stage::Encode, task)?),
        };
        reader.get()
    }
}

impl Iterator for Clusters<'_> {
    type Item = Result<EncodedCluster, PipelineError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(task) = self.tasks.next() {
            return Some(self.next_of(task).map_err(PipelineError::from));
        }
        // The hash follows the last cluster of each task.
        let readers = std::mem::take(&mut self.readers);
        let failure = readers.into_values().find_map(|reader| reader.finish().err());
        failure.map(|error| Err(error.into()))
    }
}
