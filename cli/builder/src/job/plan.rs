//! Planning a job, and building all of it in one process.

use std::io::Write;
use std::ops::Range;
use std::path::Path;

use super::add::EarlierJob;
use super::file_name::product_name;
use super::input::read_input;
use super::merge::PartProducts;
use super::part::{PartHead, PartReader, part_name};
use super::planned::write_part;
use super::stage::even_runs;
use super::{BuildError, BuildOptions, JobError, Manifest, PartEntry, heights};
use crate::pipeline::summary::{BuildSummary, Stopwatch, Times};
use crate::pipeline::{PipelineError, Plan, Prepared, RegionSize, Scale, join, prepare};
use crate::region::{DividedMesh, RegionDirectory, RegionError, RegionStore, Regions, settle_objects};
use lodpack_import::{Imported, Overflow, Room, SpilledMesh};
use lodpack_runtime::machine::return_free_memory;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::least_bytes;
use lodpack_runtime::storage::{JobId, PLAN_NAME, RecordReader, SealedReader, SealedWriter, WorkDirectory, WorkError};

/// The option that limits the memory of each part.
const PART_MEMORY_OPTION: &str = "--part-memory";

const PLAN_KIND: [u8; 4] = *b"plan";

/// How a job is divided into parts.
#[derive(Clone, Copy, Debug, Default)]
pub struct PartOptions {
    /// The number of parts; by default one for each region.
    pub count: Option<u32>,
    /// Bytes of memory that each part will have. A plan with a part that needs more is refused.
    pub memory: Option<u64>,
    /// The least bytes of input that are worth a task of their own, where planning is divided.
    pub range_bytes: Option<u64>,
}

impl PartOptions {
    /// Refuses parts that would need more memory than they will have.
    pub(super) fn refuse_below(&self, least: u64) -> Result<(), RegionError> {
        match self.memory.filter(|&memory| memory < least) {
            Some(memory) => Err(RegionError::Memory { option: PART_MEMORY_OPTION, memory, least }),
            None => Ok(()),
        }
    }
}

/// A job that this process plans, or builds as a whole. It holds the directory's lock, so no other process does so
/// meanwhile.
#[derive(Debug)]
pub struct Job {
    pub(super) directory: WorkDirectory,
    pub(super) manifest: Manifest,
    /// The job to which this one adds.
    earlier: Option<EarlierJob>,
}

impl Job {
    /// Begins a job in a new directory.
    pub(super) fn begin(directory: WorkDirectory, options: &BuildOptions) -> Result<Self, JobError> {
        let manifest = Manifest::of(options)?;
        manifest.write(directory.folder())?;
        Ok(Self { directory, manifest, earlier: None })
    }

    /// Resumes a job of the same inputs and options.
    pub(super) fn resume(path: &Path, options: &BuildOptions) -> Result<Self, JobError> {
        let directory = WorkDirectory::open(path)?;
        let now = Manifest::of(options)?;
        match Manifest::read(path) {
            Ok(manifest) if manifest.stages.is_some() => {
                let what = "its planning is divided into stages: continue it with `lodpack work`, or with --workers if that began it".into();
                Err(JobError::Changed { path: path.to_owned(), what })
            }
            Ok(manifest) => match manifest.difference(&now) {
                None => Ok(Self { directory, manifest, earlier: None }),
                Some(what) => Err(JobError::Changed { path: path.to_owned(), what }),
            },
            // The earlier process ended before it had read its input.
            Err(JobError::NoJob { .. }) => {
                now.write(path)?;
                Ok(Self { directory, manifest: now, earlier: None })
            }
            Err(error) => Err(error),
        }
    }

    /// Plans a job in a directory of its own until its parts can be built.
    ///
    /// # Errors
    /// As for builds; with `resume`, also [`JobError::Changed`] if the directory holds a job of other inputs or
    /// options.
    pub fn plan(
        path: &Path,
        parts: PartOptions,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Manifest, BuildError> {
        Self::plan_after(None, path, parts, options, progress)
    }

    /// As [`Self::plan`], taking over from an earlier job whatever has not changed since.
    pub(super) fn plan_after(
        earlier: Option<EarlierJob>,
        path: &Path,
        parts: PartOptions,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<Manifest, BuildError> {
        if options.heights {
            return heights::plan(path, parts, options, progress);
        }
        let options = &options.checked(progress)?;
        let refuse_below = |least: u64| parts.refuse_below(least);
        // Less than the smallest part takes is refused before anything is made.
        refuse_below(least_bytes(0))?;
        let mut job = match options.resume && path.exists() {
            true => Self::resume(path, options)?,
            false => Self::begin(WorkDirectory::create(path)?, options)?,
        };
        // The user named the directory, and the job can be resumed from it, unless no second attempt can mend the
        // error.
        job.directory.keep(true);
        job.earlier = earlier;
        progress.begin("import", 0);
        let (plan, sizes) =
            job.planned(None, options, progress, &mut Stopwatch::default()).inspect_err(|error| match error {
                BuildError::Pipeline(PipelineError::Region(RegionError::Work(_))) => {}
                _ => job.directory.keep(options.resume),
            })?;
        // The plan is kept: with more memory for the parts it need not be made again.
        refuse_below(sizes.iter().map(RegionSize::memory).max().unwrap_or(0))?;
        job.manifest.parts = part_entries(&sizes, parts.count.unwrap_or(plan.regions));
        job.manifest.output = product_name(path, &options.inputs);
        job.manifest.write(path)?;
        Ok(job.manifest)
    }

    /// Plans, builds all regions and joins them. `mesh` is the input, where it has just been imported.
    pub(super) fn build(
        self,
        options: &BuildOptions,
        mesh: Option<SpilledMesh>,
        out: &mut impl Write,
        progress: &dyn Progress,
        watch: Stopwatch,
    ) -> Result<BuildSummary, BuildError> {
        let built = self.build_parts(options, mesh, out, progress, watch);
        // More space, or just another attempt, can mend these errors, so the job can be resumed.
        let is_worth_keeping = matches!(
            &built,
            Err(BuildError::Pipeline(PipelineError::Region(RegionError::Work(_)) | PipelineError::Write(_)))
        );
        self.directory.keep(is_worth_keeping);
        built.map(|summary| BuildSummary { temporary_bytes: self.directory.most_bytes(), ..summary })
    }

    fn build_parts(
        &self,
        options: &BuildOptions,
        mesh: Option<SpilledMesh>,
        out: &mut impl Write,
        progress: &dyn Progress,
        mut watch: Stopwatch,
    ) -> Result<BuildSummary, BuildError> {
        self.directory.keep(true);
        let (plan, sizes) = self.planned(mesh, options, progress, &mut watch)?;
        return_free_memory();
        let (job, count) = (self.manifest.id(), plan.regions);
        let regions = RegionDirectory::charted(self.directory.clone(), job, count as usize);
        let mut times = Times::default();
        progress.begin("roots", plan.charts);
        for region in 0..count {
            let path = self.directory.path(&part_name(region));
            if PartReader::open(&path).and_then(PartReader::finish).is_ok() {
                progress.skip(sizes[region as usize].charts);
                continue;
            }
            let head = PartHead::new([region, count], region..region + 1, &plan);
            let (bytes, took) = write_part(&regions, job, &head, &path, false, options.memory, progress)?;
            times.add(&took);
            self.directory.count(bytes);
            regions.remove_charted(region as usize);
            return_free_memory();
        }
        let paths = (0..count).map(|region| self.directory.path(&part_name(region)));
        let products = PartProducts { paths: paths.collect() };
        Ok(join(&plan, &products, self.directory.folder(), out, progress, watch, times)?)
    }

    /// The plan, as far as an earlier process has made it, and from there on.
    fn planned(
        &self,
        mesh: Option<SpilledMesh>,
        options: &BuildOptions,
        progress: &dyn Progress,
        watch: &mut Stopwatch,
    ) -> Result<(Plan, Vec<RegionSize>), BuildError> {
        if let Ok(plan) = read_plan(self.directory.folder(), self.manifest.id()) {
            return Ok(plan);
        }
        let divided = self.divided(mesh, options, progress)?;
        return_free_memory();
        watch.lap("divide");
        let earlier = self.earlier.as_ref().map(EarlierJob::regions);
        let input_triangles = divided.triangle_count();
        Scale::check_size(divided.bounds())?;
        progress.begin("repair", input_triangles);
        let regions = Regions::on_disk(divided, options.memory, options.model.extensible, earlier, progress)?;
        watch.lap("repair");
        return_free_memory();
        let Prepared { store, plan, sizes, seams } =
            prepare(regions, input_triangles, &options.model, earlier, progress)
                .map_err(|error| BuildError::of_inputs(error, &options.inputs))?;
        if let RegionStore::Directory(regions) = store {
            seams.iter().enumerate().try_for_each(|(region, seams)| regions.put_seams(region, seams))?;
            if let Some(earlier) = &self.earlier {
                earlier.hand_over(&plan, &regions)?;
            }
        }
        write_plan(&self.directory, self.manifest.id(), &plan, &sizes)?;
        watch.lap("segment");
        Ok((plan, sizes))
    }

    fn divided(
        &self,
        mesh: Option<SpilledMesh>,
        options: &BuildOptions,
        progress: &dyn Progress,
    ) -> Result<DividedMesh, BuildError> {
        let job = self.manifest.id();
        let mesh = match mesh {
            Some(mesh) => mesh,
            None => {
                if let Ok(divided) = DividedMesh::open(&self.directory, job) {
                    return Ok(divided);
                }
                let room = Room { memory: options.memory, overflow: Overflow::Into(self.directory.clone()) };
                match read_input(&options.inputs, &room, &options.model, progress)? {
                    Imported::Spilled(mesh) => mesh,
                    Imported::Memory(_) => unreachable!("a directory takes a mesh of any size"),
                }
            }
        };
        let division = options.model.division(mesh.triangle_count, &mesh.appearance);
        let mesh = settled(mesh, options, progress)?;
        Ok(DividedMesh::new(mesh, division, job)?)
    }
}

/// Keeps the objects of a mesh in files, or joins them.
fn settled(mut mesh: SpilledMesh, options: &BuildOptions, progress: &dyn Progress) -> Result<SpilledMesh, WorkError> {
    let SpilledMesh { vertices, triangle_file, triangle_count, attributes, .. } = &mut mesh;
    let choice = options.model.kept_objects();
    settle_objects(choice, attributes, *triangle_count, options.memory, progress, &mut |visit| {
        RecordReader::<[u32; 3]>::open(triangle_file)?
            .for_each(|triangle| visit(triangle.map(|vertex| vertices.position(vertex))))
    })?;
    Ok(mesh)
}

pub(super) fn write_plan(
    directory: &WorkDirectory,
    job: JobId,
    plan: &Plan,
    sizes: &[RegionSize],
) -> Result<u64, WorkError> {
    let mut writer = SealedWriter::within(directory, PLAN_NAME, PLAN_KIND, job)?;
    writer.put(plan)?;
    writer.put(&sizes)?;
    writer.finish(true)
}

pub(super) fn read_plan(directory: &Path, job: JobId) -> Result<(Plan, Vec<RegionSize>), WorkError> {
    let path = directory.join(PLAN_NAME);
    let mut reader = SealedReader::open_of_job(&path, PLAN_KIND, job)?;
    let (plan, sizes): (Plan, Vec<RegionSize>) = (reader.get()?, reader.get()?);
    reader.finish()?;
    if sizes.len() != plan.regions as usize {
        return Err(WorkError::damaged(&path, "it does not have a size for each region"));
    }
    Ok((plan, sizes))
}

/// Divides the regions into runs of about equally many triangles. Some runs are empty where there are fewer regions
/// than parts.
pub(super) fn part_entries(sizes: &[RegionSize], parts: u32) -> Vec<PartEntry> {
    let runs = even_runs(sizes.iter().map(|size| size.triangles), parts);
    let entry = |run: Range<u32>| {
        let of_part = &sizes[run.start as usize..run.end as usize];
        PartEntry {
            first_region: run.start,
            regions: run.len() as u32,
            triangles: of_part.iter().map(|size| size.triangles).sum(),
            memory: of_part.iter().map(RegionSize::memory).max().unwrap_or(0),
        }
    };
    runs.into_iter().map(entry).collect()
}
