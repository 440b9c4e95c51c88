//! Where regions are between the stages: in memory, or on disk.

use std::ops::Range;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::boundary::{RegionBoundary, components, reverse_components};
use super::extent::Extent;
use super::packed::{
    get_labels, get_opposites, get_positions, get_triangles, put_labels, put_opposites, put_positions, put_triangles,
};
use lodpack_mesh::attributes::RegionAttributes;
use lodpack_mesh::{Adjacency, Mesh};
use lodpack_runtime::progress::Progress;
use lodpack_runtime::storage::{DAMAGED, JobId, SealedReader, SealedWriter, WorkDirectory, WorkError};
use lodpack_runtime::trace;
use lodpack_stage::arcs::Seams;
use lodpack_stage::repair::RepairReport;

/// A region after repair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// Its triangles.
    pub mesh: Mesh,
    /// Which half-edges of the region are opposite each other.
    pub adjacency: Adjacency,
    /// The chart of each triangle; empty until it is cut into charts.
    pub labels: Vec<u32>,
    /// What its triangles carry beside their shape.
    pub attributes: RegionAttributes,
}

impl Region {
    /// Reverses the winding of connected components.
    pub(super) fn reverse(&mut self, reversed: &[bool]) {
        if reversed.contains(&true) {
            let components = components(&self.adjacency);
            reverse_components(&mut self.mesh, &mut self.adjacency, &components, reversed);
            let is_reversed = |component: &u32| reversed[*component as usize];
            let corners = self.attributes.corners.iter_mut().zip(&components);
            corners.filter(|(_, component)| is_reversed(component)).for_each(|(corners, _)| corners.swap(1, 2));
        }
    }
}

/// What stays in memory of a repaired region.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RegionStats {
    /// Its boundary; empty where there is only one region.
    pub boundary: RegionBoundary,
    /// Its size.
    pub extent: Extent,
    /// What repair did.
    pub repairs: RepairReport,
    /// Hash of the mesh that was repaired; 0 where no later job will look for it.
    pub input: u64,
    /// Bytes of memory that its attributes take.
    pub attribute_bytes: u64,
}

/// All regions.
#[derive(Debug)]
pub enum RegionStore {
    /// In memory.
    Memory(Vec<Region>),
    /// On disk.
    Directory(RegionDirectory),
}

/// Regions in a work directory. Each stage reads the files of the one before it and writes its own, so it can be
/// resumed after any region: regions whose files exist are not worked on again.
#[derive(Debug)]
pub struct RegionDirectory {
    directory: WorkDirectory,
    job: JobId,
    count: usize,
    /// The most regions in memory at a time; at least one.
    at_once: usize,
    /// Which components of each region are reversed between repair and charts.
    reversed: Vec<Reversed>,
    /// Whether files get their names only once they have reached the disk, for others may go on from them.
    sync: bool,
}

/// For each connected component of a region whether it is reversed.
pub type Reversed = Vec<bool>;

/// The names and kinds of the files of a region.
const REPAIRED: (&str, [u8; 4]) = ("repaired", *b"mesh");
const STATS: (&str, [u8; 4]) = ("stats", *b"stat");
const CHARTED: (&str, [u8; 4]) = ("charted", *b"chrt");
const REVERSED: (&str, [u8; 4]) = ("reversed", *b"turn");
const KNOWN: (&str, [u8; 4]) = ("known", *b"know");
const SEAMS: (&str, [u8; 4]) = ("seams", *b"seam");
const PRODUCT: (&str, [u8; 4]) = ("product", *b"prod");

impl RegionStore {
    /// The number of regions.
    pub fn count(&self) -> usize {
        match self {
            Self::Memory(regions) => regions.len(),
            Self::Directory(regions) => regions.count,
        }
    }

    /// Cuts all regions into charts with a function that also returns what has to be known of the charts. Progress is
    /// in triangles.
    ///
    /// # Errors
    /// If regions on disk cannot be read or written.
    pub fn set_labels<T: Send + Serialize + DeserializeOwned>(
        &mut self,
        stats: &[RegionStats],
        progress: &dyn Progress,
        charts: impl Fn(&Region, &RegionStats) -> (Vec<u32>, T) + Sync,
    ) -> Result<Vec<T>, WorkError> {
        match self {
            Self::Memory(regions) => {
                let _all = trace::parallel("regions");
                Ok(regions.par_iter_mut().zip(stats).map(labelled(&charts, progress)).collect())
            }
            Self::Directory(regions) => regions.set_labels(0..regions.count, stats, progress, charts),
        }
    }

    /// Reverses the winding of connected components of the regions.
    pub(super) fn reverse(&mut self, reversed: Vec<Vec<bool>>) {
        match self {
            Self::Memory(regions) => {
                regions.par_iter_mut().zip(&reversed).for_each(|(region, reversed)| region.reverse(reversed));
            }
            Self::Directory(regions) => regions.reversed = reversed,
        }
    }
}

/// What cuts a region into charts, and returns what has to be known of them.
fn labelled<T>(
    charts: &(impl Fn(&Region, &RegionStats) -> (Vec<u32>, T) + Sync),
    progress: &dyn Progress,
) -> impl Fn((&mut Region, &RegionStats)) -> T + Sync {
    move |(region, stats)| {
        let _pass = trace::pass("cut");
        let (labels, known) = charts(region, stats);
        region.labels = labels;
        progress.advance(stats.extent.triangles);
        known
    }
}

impl RegionDirectory {
    pub(super) fn new(directory: WorkDirectory, job: JobId, count: usize, at_once: usize) -> Self {
        Self { directory, job, count, at_once: at_once.max(1), reversed: vec![], sync: false }
    }

    /// The regions of a job that several processes plan. This one may have `at_once` of them in memory at a time.
    pub fn shared(directory: WorkDirectory, job: JobId, count: usize, at_once: usize) -> Self {
        Self { sync: true, ..Self::new(directory, job, count, at_once) }
    }

    /// The regions of a job that has been planned.
    pub fn charted(directory: WorkDirectory, job: JobId, count: usize) -> Self {
        Self::new(directory, job, count, 1)
    }

    /// Repairs those regions of a range that are not repaired yet, as many at a time as memory allows. `take` reads a
    /// region, and `discard` removes it when it is no longer needed.
    pub(super) fn repair(
        &self,
        range: Range<usize>,
        take: impl Fn(usize) -> Result<(Mesh, RegionAttributes), WorkError>,
        repair: impl Fn((Mesh, RegionAttributes)) -> (Region, RegionStats) + Sync,
        discard: impl Fn(usize),
    ) -> Result<Vec<RegionStats>, WorkError> {
        let work = |range: Range<usize>| {
            let meshes = range.clone().map(&take).collect::<Result<Vec<_>, _>>()?;
            let of_all = trace::parallel("regions");
            let repaired: Vec<(Region, RegionStats)> = meshes.into_par_iter().map(&repair).collect();
            drop(of_all);
            let saved = range.zip(repaired).map(|(index, (region, stats))| {
                self.save(index, &region)?;
                Ok(stats)
            });
            saved.collect()
        };
        self.in_turn(STATS, range, work, discard)
    }

    /// Cuts a range of regions into charts, as [`RegionStore::set_labels`] does. `stats` are those of the range.
    ///
    /// # Errors
    /// If regions cannot be read or written.
    pub fn set_labels<T: Send + Serialize + DeserializeOwned>(
        &self,
        all: Range<usize>,
        stats: &[RegionStats],
        progress: &dyn Progress,
        charts: impl Fn(&Region, &RegionStats) -> (Vec<u32>, T) + Sync,
    ) -> Result<Vec<T>, WorkError> {
        let set = labelled(&charts, progress);
        let work = |range: Range<usize>| {
            let loaded = range.clone().map(|index| {
                let mut region = self.load(index)?;
                self.reversed.get(index).inspect(|reversed| region.reverse(reversed));
                Ok(region)
            });
            let mut held = loaded.collect::<Result<Vec<Region>, _>>()?;
            let of_range = &stats[range.start - all.start..range.end - all.start];
            let of_all = trace::parallel("regions");
            let known: Vec<T> = held.par_iter_mut().zip(of_range).map(&set).collect();
            drop(of_all);
            for (index, region) in range.zip(&held) {
                self.save_labels(index, &region.labels)?;
                self.put(index, REVERSED, &self.reversed.get(index))?;
            }
            Ok(known)
        };
        self.in_turn(KNOWN, all.clone(), work, |_| {})
    }

    /// Runs a stage on those regions of a range for which it is not done yet, some at a time. `work` writes files of
    /// its own and returns what has to be known of each region; that is stored last and so marks the region as done.
    /// `done` is then told that the region no longer needs the files of the stage before.
    fn in_turn<T: Serialize + DeserializeOwned>(
        &self,
        kind: (&str, [u8; 4]),
        range: Range<usize>,
        work: impl Fn(Range<usize>) -> Result<Vec<T>, WorkError>,
        done: impl Fn(usize),
    ) -> Result<Vec<T>, WorkError> {
        let mut all = vec![];
        while all.len() < range.len() {
            let first = range.start + all.len();
            if let Some(known) = self.get(first, kind) {
                done(first);
                all.push(known);
                continue;
            }
            let end = range.end.min(first + self.at_once);
            let end = (first + 1..end).find(|&region| self.path(region, kind.0).exists()).unwrap_or(end);
            for (region, known) in (first..).zip(work(first..end)?) {
                self.put(region, kind, &known)?;
                done(region);
                all.push(known);
            }
        }
        Ok(all)
    }

    /// The number of regions.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Sets the most regions in memory at a time.
    pub fn set_at_once(&mut self, at_once: usize) {
        self.at_once = at_once.max(1);
    }

    /// Bytes of the repaired regions of a range on disk.
    pub fn repaired_bytes(&self, regions: Range<usize>) -> u64 {
        self.bytes(regions, REPAIRED)
    }

    /// Bytes of their charts on disk.
    pub fn charted_bytes(&self, regions: Range<usize>) -> u64 {
        self.bytes(regions, CHARTED)
    }

    fn bytes(&self, regions: Range<usize>, kind: (&str, [u8; 4])) -> u64 {
        let sizes = regions.filter_map(|region| self.path(region, kind.0).metadata().ok());
        sizes.map(|metadata| metadata.len()).sum()
    }

    /// The folder of the files.
    pub fn folder(&self) -> &Path {
        self.directory.folder()
    }

    /// What is known of a region since its repair, before any component was reversed. None if the file is missing or
    /// damaged.
    pub fn stats(&self, region: usize) -> Option<RegionStats> {
        self.get(region, STATS)
    }

    /// As [`Self::stats`], for all regions of a range.
    ///
    /// # Errors
    /// If a file is missing or damaged.
    pub fn stats_of(&self, regions: Range<usize>) -> Result<Vec<RegionStats>, WorkError> {
        regions.map(|region| self.need(region, STATS)).collect()
    }

    /// What is known of the charts of a range of regions, from [`Self::set_labels`].
    ///
    /// # Errors
    /// If a file is missing or damaged.
    pub fn known_of<T: DeserializeOwned>(&self, regions: Range<usize>) -> Result<Vec<T>, WorkError> {
        regions.map(|region| self.need(region, KNOWN)).collect()
    }

    /// Sets for each region which of its components are to be reversed before it is cut into charts, for
    /// [`Self::set_labels`].
    pub fn set_reversed(&mut self, reversed: Vec<Reversed>) {
        self.reversed = reversed;
    }

    /// Which components of a region were reversed before it was cut into charts.
    pub(super) fn reversed(&self, region: usize) -> Option<Reversed> {
        self.get::<Option<Reversed>>(region, REVERSED).map(Option::unwrap_or_default)
    }

    /// Stores the product of a region, where it is known before the region is built.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn put_product<T: Serialize>(&self, region: usize, product: &T) -> Result<(), WorkError> {
        self.put(region, PRODUCT, product)
    }

    /// Whether the product of a region is stored.
    pub fn has_product(&self, region: usize) -> bool {
        self.path(region, PRODUCT.0).exists()
    }

    /// The stored product of a region.
    pub fn product<T: DeserializeOwned>(&self, region: usize) -> Option<T> {
        self.get(region, PRODUCT)
    }

    /// Stores the seams of a region.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn put_seams(&self, region: usize, seams: &Seams) -> Result<(), WorkError> {
        self.put(region, SEAMS, seams)
    }

    /// Loads a region with its charts, and its seams.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn load_charted(&self, region: usize) -> Result<(Region, Seams), WorkError> {
        let mut reader = self.open(region, SEAMS)?;
        let seams = reader.get()?;
        reader.finish()?;
        Ok((self.load_labelled(region)?, seams))
    }

    /// Removes a region that is no longer needed.
    pub fn remove_charted(&self, region: usize) {
        self.remove(region, CHARTED);
        self.remove(region, REPAIRED);
    }

    fn remove(&self, region: usize, kind: (&str, [u8; 4])) {
        self.directory.remove(&self.path(region, kind.0));
    }

    /// Stores a repaired region.
    fn save(&self, region: usize, what: &Region) -> Result<(), WorkError> {
        let mut writer = self.create(region, REPAIRED)?;
        let (positions, triangles) = (&what.mesh.positions, &what.mesh.triangles);
        writer.put(&[positions.len() as u64, triangles.len() as u64])?;
        let mut bytes = vec![];
        put_positions(&mut bytes, positions);
        put_triangles(&mut bytes, triangles);
        put_opposites(&mut bytes, &what.adjacency.opposite);
        writer.put_bytes(&bytes)?;
        let RegionAttributes { corners, records, materials, charts, objects } = &what.attributes;
        if !(corners.is_empty() && materials.is_empty() && charts.is_empty() && objects.is_empty()) {
            writer.put_records(corners)?;
            writer.put_records(records)?;
            writer.put_records(materials)?;
            for labels in [charts, objects] {
                bytes.clear();
                put_labels(&mut bytes, labels);
                writer.put_bytes(&bytes)?;
            }
        }
        writer.finish(self.sync).map(drop)
    }

    /// Loads a repaired region.
    fn load(&self, region: usize) -> Result<Region, WorkError> {
        let damaged = || WorkError::damaged(&self.path(region, REPAIRED.0), DAMAGED);
        let mut reader = self.open(region, REPAIRED)?;
        let [vertices, triangles]: [u64; 2] = reader.get()?;
        let [vertices, triangles] = [vertices, triangles].map(|count| count as usize);
        let bytes = reader.get_bytes()?;
        let unpack = |mut rest: &[u8]| {
            let mesh = Mesh {
                positions: get_positions(&mut rest, vertices)?,
                triangles: get_triangles(&mut rest, triangles)?,
            };
            let opposite = get_opposites(&mut rest, triangles.checked_mul(3)?)?;
            rest.is_empty().then_some((mesh, Adjacency { opposite }))
        };
        let (mesh, adjacency) = unpack(&bytes).ok_or_else(damaged)?;
        let mut attributes = RegionAttributes::default();
        if !reader.is_at_end() {
            attributes.corners = reader.get_records()?;
            attributes.records = reader.get_records()?;
            attributes.materials = reader.get_records()?;
            for labels in [&mut attributes.charts, &mut attributes.objects] {
                let bytes = reader.get_bytes()?;
                let count = if bytes.is_empty() { 0 } else { triangles };
                *labels = get_labels(&mut &bytes[..], count).ok_or_else(damaged)?;
            }
        }
        reader.finish()?;
        match attributes.fits(mesh.triangles.len()) {
            true => Ok(Region { mesh, adjacency, labels: vec![], attributes }),
            false => Err(damaged()),
        }
    }

    /// Stores the charts of a region. The region itself stays where it was put when it was repaired.
    fn save_labels(&self, region: usize, labels: &[u32]) -> Result<(), WorkError> {
        let mut writer = self.create(region, CHARTED)?;
        writer.put(&self.reversed.get(region))?;
        let mut bytes = vec![];
        put_labels(&mut bytes, labels);
        writer.put_bytes(&bytes)?;
        writer.finish(self.sync).map(drop)
    }

    /// Loads a region with its charts.
    fn load_labelled(&self, region: usize) -> Result<Region, WorkError> {
        let mut reader = self.open(region, CHARTED)?;
        let (reversed, bytes): (Option<Reversed>, Vec<u8>) = (reader.get()?, reader.get_bytes()?);
        reader.finish()?;
        let mut loaded = self.load(region)?;
        loaded.reverse(&reversed.unwrap_or_default());
        let labels = get_labels(&mut &bytes[..], loaded.mesh.triangles.len());
        loaded.labels = labels.ok_or_else(|| WorkError::damaged(&self.path(region, CHARTED.0), DAMAGED))?;
        Ok(loaded)
    }

    fn put<T: Serialize>(&self, region: usize, kind: (&str, [u8; 4]), value: &T) -> Result<(), WorkError> {
        let mut writer = self.create(region, kind)?;
        writer.put(value)?;
        writer.finish(self.sync).map(drop)
    }

    fn create(&self, region: usize, kind: (&str, [u8; 4])) -> Result<SealedWriter, WorkError> {
        SealedWriter::within(&self.directory, &name(region, kind.0), kind.1, self.job)
    }

    /// A stored value, if it exists and is undamaged.
    fn get<T: DeserializeOwned>(&self, region: usize, kind: (&str, [u8; 4])) -> Option<T> {
        self.need(region, kind).ok()
    }

    /// A stored value.
    fn need<T: DeserializeOwned>(&self, region: usize, kind: (&str, [u8; 4])) -> Result<T, WorkError> {
        let mut reader = self.open(region, kind)?;
        let value = reader.get()?;
        reader.finish()?;
        Ok(value)
    }

    fn open(&self, region: usize, kind: (&str, [u8; 4])) -> Result<SealedReader, WorkError> {
        SealedReader::open_of_job(&self.path(region, kind.0), kind.1, self.job)
    }

    fn path(&self, region: usize, what: &str) -> PathBuf {
        self.directory.path(&name(region, what))
    }
}

fn name(region: usize, what: &str) -> String {
    format!("region-{region}.{what}")
}
