//! What the tasks of each stage do.
//!
//! The steps are those of [`super::Job`], which does all of them in one process, so the plan is the same.

use std::cell::OnceCell;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::content::{self, Contents};
use super::encoded::BuiltJob;
use super::input::read_input;
use super::plan::{part_entries, write_plan};
use super::stage::{TaskFiles, even_runs, run_file};
use super::{BuildError, JobError, Manifest, Stage, Stages};
use crate::pipeline::{ChartCount, Found, Scale, Whole, seams_of};
use crate::region::{
    Agreement, BoundarySketch, CellCounts, Counts, Decomposition, DividedMesh, Division, Matching, Nodes, NumberedMesh,
    RegionDirectory, RegionStats, Reversed, RunFile, RunList, at_once, centroid, remove_shared, repair_regions,
    settle_objects,
};
use lodpack_import::{
    Imported, Objects, Overflow, RangedMesh, Room, TRIANGLES_NAME, TextCounts, TextFile, TextFiles, TextPiece,
    TextSink, VALUE_NAMES, VERTICES_NAME, Ways, remove_text_files,
};
use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::attributes::Attributes;
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::memory::region_bytes;
use lodpack_runtime::storage::{SealedReader, SealedWriter, WorkDirectory, WorkError};

/// A task that this process does.
pub(super) struct Task<'a> {
    pub directory: &'a WorkDirectory,
    pub manifest: &'a Manifest,
    pub stages: Stages,
    pub task: u32,
    pub memory: u64,
    /// The runs of all regions, once this process has needed them.
    pub runs: &'a OnceCell<AllRuns>,
}

/// The triangles that all tasks of [`Stage::Divide`] have sent to the regions.
#[derive(Clone, Debug)]
pub(super) struct AllRuns {
    runs: Arc<[RunFile]>,
    /// Triangles of each region.
    triangles: Vec<u64>,
}

pub(super) const KIND: [u8; 4] = *b"task";
const PAIRS_NAME: &str = "pairs";
const PAIRS_KIND: [u8; 4] = *b"pair";

/// What an import knows beside positions, triangles and values.
#[derive(Default, Serialize, Deserialize)]
struct ImportProduct {
    attributes: Attributes,
    appearance: Appearance,
    bounds: [DVec3; 2],
    triangles: u64,
    /// The hashes of all ranges of the inputs.
    hashes: Vec<Vec<u64>>,
}

/// What a range of the inputs has.
#[derive(Serialize, Deserialize)]
struct ScanProduct {
    bounds: [DVec3; 2],
    hashes: Vec<u64>,
    /// Of each text what the range has; [`Stage::Import`] alone reads these.
    texts: Vec<TextPiece>,
}

/// For each piece of a range, with the number of its file, what begins in it.
#[derive(Serialize, Deserialize)]
struct LinesProduct(Vec<(u32, TextCounts)>);

/// How space is cut into regions.
#[derive(Serialize, Deserialize)]
struct CutProduct {
    bounds: [DVec3; 2],
    tree: Decomposition,
    /// Of all inputs.
    content: u64,
    /// Whether the objects of the input were joined.
    are_joined: bool,
}

/// What the regions are as a whole.
#[derive(Serialize, Deserialize)]
struct MatchProduct {
    whole: Whole,
    /// The regions of each task of [`Stage::Segment`].
    shares: Vec<Range<u32>>,
    /// Their triangles.
    triangles: Vec<u64>,
    regions: u32,
    /// Regions with components that have to be reversed before they are cut into charts, and which these are.
    reversed: BTreeMap<u32, Reversed>,
}

impl MatchProduct {
    /// For each region up to the end of a range what is reversed of it.
    fn reversed(&self, regions: &Range<usize>) -> Vec<Reversed> {
        (0..regions.end as u32).map(|region| self.reversed.get(&region).cloned().unwrap_or_default()).collect()
    }
}

/// What is only of interest once all regions are cut into charts.
#[derive(Serialize, Deserialize)]
struct Pairs {
    matching: Matching,
    found: Found,
}

impl Task<'_> {
    /// Does a task of a stage. Returns the number of bytes that it hands on.
    pub fn run(&self, stage: Stage, progress: &dyn Progress) -> Result<u64, BuildError> {
        match stage {
            Stage::Lines => self.count_lines(),
            Stage::Import if self.stages.ways == Ways::Lines => self.read_texts(),
            Stage::Import => self.import(progress),
            Stage::Scan => self.scan(),
            Stage::Count => self.count(),
            Stage::Cut => self.cut(progress),
            Stage::Divide => self.divide(),
            Stage::Repair => self.repair(progress),
            Stage::Match => self.find_pairs(progress),
            Stage::Segment => self.segment(progress),
            Stage::Seams => self.find_seams(),
            // Parts have files and reports of their own.
            Stage::Build => Ok(0),
            Stage::Arrange => self.built().arrange(),
            Stage::Encode => self.built().encode(self.task, progress),
        }
    }

    fn import(&self, progress: &dyn Progress) -> Result<u64, BuildError> {
        let room = Room { memory: self.memory, overflow: Overflow::Into(self.directory.clone()) };
        let inputs: Vec<_> = self.manifest.inputs.iter().map(|file| file.path.clone()).collect();
        let Imported::Spilled(mesh) = read_input(&inputs, &room, &self.manifest.options, progress)? else {
            unreachable!("a directory takes a mesh of any size")
        };
        let files = [VERTICES_NAME, TRIANGLES_NAME].iter().chain(&VALUE_NAMES).map(|name| self.directory.path(name));
        let mut bytes = 0;
        for path in files.filter(|path| path.exists()) {
            bytes += synced(&path)?;
        }
        let product = ImportProduct {
            attributes: mesh.attributes,
            appearance: mesh.appearance,
            bounds: mesh.bounds,
            triangles: mesh.triangle_count,
            hashes: (0..self.stages.ranges).map(|task| self.contents().hashes(task)).collect::<Result<_, _>>()?,
        };
        Ok(bytes + self.hand_on(Stage::Import, &product)?)
    }

    /// Counts what begins in a range of texts.
    fn count_lines(&self) -> Result<u64, BuildError> {
        let counts = self.contents().pieces(self.task).map(|(file, bytes)| {
            let input = TextFile::open(&self.manifest.inputs[file].path, &self.manifest.options.channels)?;
            Ok((file as u32, input.count(bytes)?))
        });
        let product = LinesProduct(counts.collect::<Result<_, BuildError>>()?);
        self.hand_on(Stage::Lines, &product)
    }

    /// Hashes a range of the inputs, and reads what begins in it.
    fn read_texts(&self) -> Result<u64, BuildError> {
        let (mut before, mut all) = (BTreeMap::new(), BTreeMap::new());
        for task in 0..self.stages.ranges {
            let LinesProduct(pieces) = self.product(Stage::Lines, task)?;
            for (file, counts) in pieces {
                if task < self.task {
                    *before.entry(file).or_insert(TextCounts::default()) += counts;
                }
                *all.entry(file).or_insert(TextCounts::default()) += counts;
            }
        }
        let contents = self.contents();
        let hashes = contents.hashes(self.task)?;
        let mut bounds = Mesh::default().bounds();
        let mut sink = TextSink::create(self.directory, self.task, self.manifest.options.kept_objects())?;
        for (number, bytes) in contents.pieces(self.task) {
            let input = TextFile::open(&self.manifest.inputs[number].path, &self.manifest.options.channels)?;
            if !input.is_text() {
                bounds = union(bounds, input.check_vertices(bytes)?);
                continue;
            }
            let file = number as u32;
            let counts = |of: &BTreeMap<u32, TextCounts>| of.get(&file).copied().unwrap_or_default();
            sink.begin(file);
            input.read(bytes, counts(&before), counts(&all), &mut sink)?;
            sink.end()?;
        }
        let (texts, paths) = sink.finish()?;
        bounds = texts.iter().fold(bounds, |bounds, piece| union(bounds, piece.bounds));
        let mut written = 0;
        for path in &paths {
            written += synced(path)?;
        }
        Ok(written + self.hand_on(Stage::Import, &ScanProduct { bounds, hashes, texts })?)
    }

    /// Hashes a range of the inputs, and measures the vertices that begin in it.
    fn scan(&self) -> Result<u64, BuildError> {
        let (mesh, contents) = (self.ranged()?, self.contents());
        let hashes = contents.hashes(self.task)?;
        let mut bounds = Mesh::default().bounds();
        for (file, bytes) in contents.pieces(self.task) {
            bounds = union(bounds, mesh.check_vertices(file, bytes)?);
        }
        // A triangle that names a vertex that is not there is found when triangles are counted or divided.
        self.hand_on(Stage::Scan, &ScanProduct { bounds, hashes, texts: vec![] })
    }

    fn count(&self) -> Result<u64, BuildError> {
        let input = self.input()?;
        let division = self.division(&input)?;
        let counts = match input.triangle_count() <= division.triangles {
            true => CellCounts::default(),
            false => {
                let cutting = division.begin(self.scanned()?.0);
                let range = self.stages.range(self.task, input.triangle_count());
                cutting.count(&mut |visit| for_each_centroid(&input, range.clone(), visit))?
            }
        };
        self.hand_on(Stage::Count, &counts)
    }

    fn cut(&self, progress: &dyn Progress) -> Result<u64, BuildError> {
        self.note_texts(progress)?;
        let (input, (bounds, hashes)) = (self.input()?, self.scanned()?);
        Scale::check_size(bounds)?;
        let (count, division) = (input.triangle_count(), self.division(&input)?);
        let tree = match count <= division.triangles {
            true => Decomposition::whole(),
            false => {
                let mut cutting = division.begin(bounds);
                let mut failure = None;
                let shares = (0..self.stages.ranges)
                    .map_while(|task| self.product(Stage::Count, task).map_err(|error| failure = Some(error)).ok());
                let is_cut = cutting.cut(shares);
                failure.map_or(Ok(()), Err)?;
                if is_cut.is_none() {
                    let path = TaskFiles::new(self.directory.folder(), Stage::Count, 0).product;
                    return Err(WorkError::damaged(&path, "its counts are of other cells").into());
                }
                // Cells with too many triangles are very rare, so one process counts these again.
                cutting.finish(&mut |visit| for_each_centroid(&input, 0..count, visit))?
            }
        };
        let are_joined = self.are_joined(&input, progress)?;
        self.hand_on(Stage::Cut, &CutProduct { bounds, tree, content: content::root(hashes), are_joined })
    }

    /// Whether the objects of the input are joined, although they may be kept.
    fn are_joined(&self, input: &NumberedMesh, progress: &dyn Progress) -> Result<bool, BuildError> {
        let (mut attributes, count) = (self.named()?.attributes, input.triangle_count());
        if attributes.nodes.is_empty() {
            return Ok(false);
        }
        let choice = self.manifest.options.kept_objects();
        settle_objects(choice, &mut attributes, count, self.memory, progress, &mut |visit| {
            input.for_each_triangle(0..count, |triangle| visit(triangle.map(|vertex| input.position(vertex))))
        })?;
        Ok(attributes.nodes.is_empty())
    }

    /// Says what was odd about texts.
    fn note_texts(&self, progress: &dyn Progress) -> Result<(), WorkError> {
        let (mut skipped, mut left_out) = (BTreeMap::new(), BTreeSet::new());
        for TextPiece { file, skipped: of_piece, left_out: beside, .. } in self.texts()?.into_iter().flatten() {
            left_out.extend(beside);
            for (what, count) in of_piece {
                *skipped.entry((file, what)).or_insert(0) += count;
            }
        }
        for ((file, what), count) in skipped {
            progress.note(&format!("{}: {count} {what}", self.manifest.inputs[file as usize].path.display()));
        }
        let left_out: Vec<String> = left_out.into_iter().collect();
        if !left_out.is_empty() {
            progress.note(&format!("{} of the input are left out", left_out.join(", ")));
        }
        Ok(())
    }

    fn divide(&self) -> Result<u64, BuildError> {
        let input = self.input()?;
        let CutProduct { tree, are_joined, .. } = self.product(Stage::Cut, 0)?;
        let ImportProduct { attributes, appearance, .. } = self.carried(are_joined)?;
        let is_numbered = !attributes.are_empty(&appearance);
        let range = self.stages.range(self.task, input.triangle_count());
        let path = run_file(self.directory.folder(), self.task);
        let (list, bytes) = RunList::write(&input, range, &tree, is_numbered, &path)?;
        Ok(bytes + self.hand_on(Stage::Divide, &list)?)
    }

    fn repair(&self, progress: &dyn Progress) -> Result<u64, BuildError> {
        let CutProduct { tree, bounds, are_joined, .. } = self.product(Stage::Cut, 0)?;
        let ImportProduct { attributes, appearance, .. } = self.carried(are_joined)?;
        let AllRuns { runs, triangles } = self.all_runs(tree.region_count())?.clone();
        let shares = even_runs(triangles.iter().copied(), self.stages.parts);
        let counts = Counts { triangles, bounds, attributes, appearance };
        let job = self.manifest.id();
        let divided = DividedMesh::of_runs(self.directory, job, self.input()?, runs, counts)?;
        let at_once = at_once(divided.largest_region_bytes(), self.memory)?;
        let store = RegionDirectory::shared(self.directory.clone(), job, divided.region_count(), at_once);
        let range = as_usize(&shares[self.task as usize]);
        progress.begin("repair", range.clone().map(|region| divided.triangles_of(region)).sum());
        let for_later = self.manifest.options.extensible;
        repair_regions(&store, &divided, range.clone(), for_later, None, progress)?;
        self.end(Stage::Repair, store.repaired_bytes(range.clone()), range)
    }

    /// The files of all tasks of [`Stage::Divide`].
    fn all_runs(&self, regions: u32) -> Result<&AllRuns, WorkError> {
        if let Some(all) = self.runs.get() {
            return Ok(all);
        }
        let (mut runs, mut triangles) = (vec![], vec![0; regions as usize]);
        for task in 0..self.stages.ranges {
            let (list, path): (RunList, _) = (self.product(Stage::Divide, task)?, self.run_file(task));
            if list.add_to(&mut triangles).is_none() {
                return Err(WorkError::damaged(&path, "it has triangles of other regions"));
            }
            runs.push(RunFile::new(path, list));
        }
        Ok(self.runs.get_or_init(|| AllRuns { runs: runs.into(), triangles }))
    }

    /// The triangles of each task of a stage of regions, where that is known.
    pub fn triangles(&self, stage: Stage) -> Option<Vec<u64>> {
        match stage {
            Stage::Repair => {
                let CutProduct { tree, .. } = self.product(Stage::Cut, 0).ok()?;
                let triangles = &self.all_runs(tree.region_count()).ok()?.triangles;
                let shares = even_runs(triangles.iter().copied(), self.stages.parts);
                Some(shares.iter().map(|share| triangles[as_usize(share)].iter().sum()).collect())
            }
            Stage::Segment => Some(self.product::<MatchProduct>(Stage::Match, 0).ok()?.triangles),
            _ => None,
        }
    }

    fn find_pairs(&self, progress: &dyn Progress) -> Result<u64, BuildError> {
        let CutProduct { tree, are_joined, .. } = self.product(Stage::Cut, 0)?;
        let regions = tree.region_count();
        let ImportProduct { mut attributes, appearance, .. } = self.carried(are_joined)?;
        let nodes = Nodes::taken(&mut attributes);
        let store = self.regions(regions, 1);
        let mut stats = store.stats_of(0..regions as usize)?;
        let Agreement { matching, doubled_vertices, repairs, reversed } = Agreement::of(&mut stats);
        let reversed = (0..).zip(reversed).filter(|(_, reversed)| reversed.contains(&true)).collect();
        let input_triangles = self.input_triangles()?;
        let whole = Whole::of(&stats, input_triangles, &appearance, &self.manifest.options);
        let whole = whole.map_err(|error| self.of_inputs(error))?;
        whole.note_repeats(progress);
        let found = Found { input_triangles, doubled_vertices, repairs, appearance, nodes };
        let pairs = SealedWriter::within(self.directory, PAIRS_NAME, PAIRS_KIND, self.manifest.id());
        let bytes = pairs.and_then(|mut writer| writer.put(&Pairs { matching, found }).and(writer.finish(true)))?;
        let shares = even_runs(stats.iter().map(|stats| stats.extent.triangles), self.stages.parts);
        let of_share = |share: &Range<u32>| stats[as_usize(share)].iter().map(|stats| stats.extent.triangles).sum();
        let triangles = shares.iter().map(of_share).collect();
        let product = MatchProduct { whole, shares, triangles, regions, reversed };
        let bytes = bytes + self.hand_on(Stage::Match, &product)?;
        self.free_input();
        Ok(bytes)
    }

    fn segment(&self, progress: &dyn Progress) -> Result<u64, BuildError> {
        let product: MatchProduct = self.product(Stage::Match, 0)?;
        let MatchProduct { whole, shares, regions, .. } = &product;
        let range = shares.get(self.task as usize).map_or(0..0, as_usize);
        let mut store = self.regions(*regions, 1);
        let mut stats = store.stats_of(range.clone())?;
        let reversed = product.reversed(&range);
        reverse(&mut stats, reversed.get(range.clone()).unwrap_or_default());
        store.set_reversed(reversed);
        let bytes =
            |stats: &RegionStats| region_bytes(stats.extent.vertices, stats.extent.triangles) + stats.attribute_bytes;
        store.set_at_once(at_once(stats.iter().map(bytes).max().unwrap_or(0), self.memory)?);
        progress.begin("segment", stats.iter().map(|stats| stats.extent.triangles).sum());
        let cutter = whole.cutter(&self.manifest.options);
        store.set_labels(range.clone(), &stats, progress, |region, stats| cutter.cut(region, None, &stats.boundary))?;
        self.end(Stage::Segment, store.charted_bytes(range.clone()), range)
    }

    fn find_seams(&self) -> Result<u64, BuildError> {
        // A process that was killed may have left something.
        self.free_input();
        let product: MatchProduct = self.product(Stage::Match, 0)?;
        let MatchProduct { whole, regions, .. } = &product;
        let store = self.regions(*regions, 1);
        let all = 0..*regions as usize;
        let mut stats = store.stats_of(all.clone())?;
        reverse(&mut stats, &product.reversed(&all));
        let known: Vec<(ChartCount, BoundarySketch)> = store.known_of(all)?;
        let (counts, sketches): (Vec<ChartCount>, Vec<BoundarySketch>) = known.into_iter().unzip();
        let pairs = self.directory.path(PAIRS_NAME);
        let Pairs { matching, found } = read(&pairs, PAIRS_KIND, self.manifest)?;
        let seams = seams_of(&stats, &matching, &sketches);
        seams.iter().enumerate().try_for_each(|(region, seams)| store.put_seams(region, seams))?;
        let (plan, sizes) = whole.plan(&stats, &counts, found, &self.manifest.options);
        let bytes = write_plan(self.directory, self.manifest.id(), &plan, &sizes)?;
        let parts = part_entries(&sizes, self.stages.parts);
        let CutProduct { content, .. } = self.product(Stage::Cut, 0)?;
        let content = Some(format!("{content:016x}"));
        Manifest { parts, content, ..self.manifest.clone() }.write(self.directory.folder())?;
        let bytes = bytes + self.hand_on(Stage::Seams, &())?;
        self.directory.remove(&pairs);
        Ok(bytes)
    }

    /// Removes what the stages until the repair have left.
    fn free_input(&self) {
        (0..self.stages.ranges).for_each(|task| self.directory.remove(&self.run_file(task)));
        remove_shared(self.directory);
        self.directory.remove(&self.directory.path(TRIANGLES_NAME));
        if self.stages.ways == Ways::Lines {
            (0..self.stages.ranges).for_each(|task| remove_text_files(self.directory, task));
        }
    }

    fn built(&self) -> BuiltJob<'_> {
        BuiltJob { folder: self.directory.folder(), manifest: self.manifest, stages: self.stages }
    }

    fn contents(&self) -> Contents<'_> {
        Contents::new(&self.manifest.inputs, self.stages)
    }

    fn of_inputs(&self, error: crate::pipeline::PipelineError) -> BuildError {
        let inputs: Vec<_> = self.manifest.inputs.iter().map(|file| file.path.clone()).collect();
        BuildError::of_inputs(error, &inputs)
    }

    fn regions(&self, count: u32, at_once: usize) -> RegionDirectory {
        RegionDirectory::shared(self.directory.clone(), self.manifest.id(), count as usize, at_once)
    }

    fn run_file(&self, task: u32) -> std::path::PathBuf {
        run_file(self.directory.folder(), task)
    }

    fn ranged(&self) -> Result<RangedMesh, BuildError> {
        let inputs: Vec<_> = self.manifest.inputs.iter().map(|file| file.path.clone()).collect();
        let pieces = self.texts()?;
        let texts = TextFiles { folder: self.directory.folder(), pieces: &pieces };
        let texts = (self.stages.ways == Ways::Lines).then_some(texts);
        let mesh = RangedMesh::open(&inputs, &self.manifest.options.channels, texts)?;
        // It had ranges when the job was begun.
        let gone = || JobError::Stale {
            path: self.directory.folder().to_owned(),
            input: inputs.first().cloned().unwrap_or_default(),
        };
        Ok(mesh.ok_or_else(gone)?)
    }

    /// Of each task what it has read of texts.
    fn texts(&self) -> Result<Vec<Vec<TextPiece>>, WorkError> {
        if self.stages.ways != Ways::Lines {
            return Ok(vec![]);
        }
        let of = |task| self.product::<ScanProduct>(Stage::Import, task).map(|product| product.texts);
        (0..self.stages.ranges).map(of).collect()
    }

    fn input(&self) -> Result<NumberedMesh, BuildError> {
        Ok(match self.stages.ways {
            Ways::Places | Ways::Lines => NumberedMesh::Ranged(self.ranged()?),
            Ways::Whole => NumberedMesh::in_directory(self.directory, self.imported()?.triangles)?,
        })
    }

    fn division(&self, input: &NumberedMesh) -> Result<Division, WorkError> {
        Ok(self.manifest.options.division(input.triangle_count(), &self.imported()?.appearance))
    }

    fn input_triangles(&self) -> Result<u64, BuildError> {
        match self.stages.ways {
            Ways::Places | Ways::Lines => Ok(self.ranged()?.triangle_count()),
            Ways::Whole => Ok(self.imported()?.triangles),
        }
    }

    /// What an import of everything has found; nothing where there was none.
    fn imported(&self) -> Result<ImportProduct, WorkError> {
        match self.stages.ways {
            Ways::Whole => self.product(Stage::Import, 0),
            Ways::Places | Ways::Lines => Ok(ImportProduct::default()),
        }
    }

    /// What triangles carry.
    fn carried(&self, are_joined: bool) -> Result<ImportProduct, BuildError> {
        let mut carried = self.named()?;
        if are_joined {
            carried.attributes.join_objects();
        }
        Ok(carried)
    }

    /// What triangles carry, with all objects that the input names unless they are joined in any case.
    fn named(&self) -> Result<ImportProduct, BuildError> {
        let mut carried = self.imported()?;
        let choice = self.manifest.options.kept_objects();
        // An import of everything has found them.
        if !matches!(self.stages.ways, Ways::Whole) && choice != Objects::Join {
            self.ranged()?.find_objects(choice, &mut carried.attributes);
        }
        Ok(carried)
    }

    /// The extent of the input, and the hashes of its ranges.
    fn scanned(&self) -> Result<([DVec3; 2], Vec<Vec<u64>>), WorkError> {
        let stage = match scanning_stage(self.stages.ways) {
            Some(stage) => stage,
            None => {
                let ImportProduct { bounds, hashes, .. } = self.imported()?;
                return Ok((bounds, hashes));
            }
        };
        let (mut all, mut hashes) = (Mesh::default().bounds(), vec![]);
        for task in 0..self.stages.ranges {
            let scanned: ScanProduct = self.product(stage, task)?;
            all = union(all, scanned.bounds);
            hashes.push(scanned.hashes);
        }
        Ok((all, hashes))
    }

    fn product<T: DeserializeOwned>(&self, stage: Stage, task: u32) -> Result<T, WorkError> {
        read(&TaskFiles::new(self.directory.folder(), stage, task).product, KIND, self.manifest)
    }

    /// Declares a task done that has worked on some regions.
    fn end(&self, stage: Stage, bytes: u64, regions: Range<usize>) -> Result<u64, BuildError> {
        // What can be made again at once need not reach the disk.
        Ok(bytes + self.write(stage, &(), !regions.is_empty())?)
    }

    /// Writes what the task hands on, and so declares it done.
    fn hand_on<T: Serialize>(&self, stage: Stage, product: &T) -> Result<u64, BuildError> {
        Ok(self.write(stage, product, true)?)
    }

    fn write<T: Serialize>(&self, stage: Stage, product: &T, sync: bool) -> Result<u64, WorkError> {
        let files = TaskFiles::new(self.directory.folder(), stage, self.task);
        let mut writer = SealedWriter::create(&files.product, KIND, self.manifest.id())?;
        writer.put(product)?;
        writer.finish(sync)
    }
}

/// For each range of a job's inputs the hashes of its pieces, where some task has read it.
pub(super) fn known_hashes(job: &Path, manifest: &Manifest) -> Vec<Option<Vec<u64>>> {
    let stages = manifest.stages.unwrap_or_default();
    let product = |stage, task| TaskFiles::new(job, stage, task).product;
    let Some(stage) = scanning_stage(stages.ways) else {
        let imported: Option<ImportProduct> = read(&product(Stage::Import, 0), KIND, manifest).ok();
        return imported.into_iter().flat_map(|imported| imported.hashes).map(Some).collect();
    };
    let scanned = |task| read::<ScanProduct>(&product(stage, task), KIND, manifest).ok();
    (0..stages.ranges).map(|task| scanned(task).map(|scanned| scanned.hashes)).collect()
}

/// The stage whose tasks measure and hash a range each; none where one process does it.
fn scanning_stage(ways: Ways) -> Option<Stage> {
    match ways {
        Ways::Places => Some(Stage::Scan),
        Ways::Lines => Some(Stage::Import),
        Ways::Whole => None,
    }
}

/// Makes sure that a file has reached the disk. Returns its size.
fn synced(path: &Path) -> Result<u64, WorkError> {
    let synced = File::open(path).and_then(|file| file.sync_all().and(file.metadata()));
    Ok(synced.map_err(|source| WorkError::new(path, "written", source))?.len())
}

fn union([low, high]: [DVec3; 2], [other_low, other_high]: [DVec3; 2]) -> [DVec3; 2] {
    [low.min(other_low), high.max(other_high)]
}

fn read<T: DeserializeOwned>(path: &Path, kind: [u8; 4], manifest: &Manifest) -> Result<T, WorkError> {
    let mut reader = SealedReader::open_of_job(path, kind, manifest.id())?;
    let value = reader.get()?;
    reader.finish()?;
    Ok(value)
}

fn for_each_centroid(
    input: &NumberedMesh,
    range: Range<u64>,
    visit: &mut dyn FnMut(DVec3),
) -> Result<(), lodpack_import::ImportError> {
    input.for_each_triangle(range, |triangle| visit(centroid(triangle.map(|vertex| input.position(vertex)))))
}

/// Reverses boundaries as components of their regions are reversed.
fn reverse(stats: &mut [RegionStats], reversed: &[Vec<bool>]) {
    for (stats, reversed) in stats.iter_mut().zip(reversed).filter(|(_, reversed)| !reversed.is_empty()) {
        stats.boundary.reverse(reversed);
    }
}

fn as_usize(range: &Range<u32>) -> Range<usize> {
    range.start as usize..range.end as usize
}
