//! Dividing a mesh that is in temporary files, and taking a region out of a divided one.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::decompose::{Decomposition, Division};
use super::gather::{Gathered, Gathering};
use super::nodes::Nodes;
use super::numbered::NumberedMesh;
use super::runs::RunFile;
use super::split::centroid;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use lodpack_import::{SpilledMesh, VALUE_NAMES, VERTICES_NAME};
use lodpack_mesh::Mesh;
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::attributes::{AttributeValues, Attributes, FileAttributes, RegionAttributes};
use lodpack_runtime::storage::memory::{attribute_bytes, region_bytes};
use lodpack_runtime::storage::{
    DAMAGED, DIVIDED_NAME, JobId, Lookup, Record, RecordReader, RecordWriter, SealedReader, SealedWriter,
    WorkDirectory, WorkError,
};

/// The regions of a mesh. They share the positions of the whole mesh.
#[derive(Debug)]
pub struct DividedMesh {
    /// Holds the files.
    pub directory: WorkDirectory,
    /// The job for which the mesh was divided.
    pub job: JobId,
    input: NumberedMesh,
    triangles: Triangles,
    values: ValueFiles,
    counts: Counts,
}

/// Where the triangles of the regions are.
#[derive(Debug)]
enum Triangles {
    /// In a file for each region.
    Files,
    /// In a file of each process that divided a share of the input.
    Runs(Arc<[RunFile]>),
}

/// The values of vertices and of corners.
#[derive(Debug)]
struct ValueFiles([Lookup; 2]);

impl AttributeValues for ValueFiles {
    fn of_vertex(&self, place: u64, values: &mut [f32]) {
        self.0[0].floats(place, values);
    }

    fn of_corner(&self, place: u64, values: &mut [f32]) {
        self.0[1].floats(place, values);
    }
}

impl ValueFiles {
    /// Those files that exist.
    fn open(directory: &WorkDirectory) -> Result<Self, WorkError> {
        let [vertices, corners] = VALUE_NAMES.map(|name| {
            let path = directory.path(name);
            if path.exists() { Lookup::open(&path) } else { Ok(Lookup::empty()) }
        });
        Ok(Self([vertices?, corners?]))
    }

    fn count(&self) -> u64 {
        self.0.iter().map(Lookup::float_count).sum()
    }
}

/// The note that says that a mesh has been divided.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Counts {
    /// Triangles of each region.
    pub triangles: Vec<u64>,
    /// Smallest and largest coordinates before repair.
    pub bounds: [DVec3; 2],
    /// Attributes, without their values.
    pub attributes: Attributes,
    /// How the surface looks.
    pub appearance: Appearance,
}

const COUNTS_KIND: [u8; 4] = *b"divd";

fn triangle_file(region: usize) -> String {
    format!("region-{region}.input")
}

/// The file of the numbers that a region's triangles have in the input. It exists where they have attributes.
fn number_file(region: usize) -> String {
    format!("region-{region}.numbers")
}

impl DividedMesh {
    /// Divides as [`super::split_mesh`] does.
    ///
    /// # Errors
    /// If files cannot be read or written.
    pub fn new(mesh: SpilledMesh, division: Division, job: JobId) -> Result<Self, WorkError> {
        let SpilledMesh { directory, vertices, vertex_file, triangle_file: all, triangle_count, bounds, .. } = mesh;
        let (attributes, appearance) = (mesh.attributes, mesh.appearance);
        let tree = if triangle_count <= division.triangles {
            Decomposition::whole()
        } else {
            Decomposition::new(bounds, division, &mut |visit| {
                RecordReader::<[u32; 3]>::open(&all)?
                    .for_each(|triangle| visit(centroid(triangle.map(|v| vertices.position(v)))))
            })?
        };
        // An interrupted division may have left some.
        for region in 0..tree.region_count() as usize {
            [triangle_file(region), number_file(region)]
                .iter()
                .for_each(|name| directory.remove(&directory.path(name)));
        }
        let mut gathering = Gathering::new(&tree, !attributes.are_empty(&appearance), 0);
        let (mut write, mut failure) = (|gathered: &mut [Gathered]| write(&directory, gathered), None);
        RecordReader::<[u32; 3]>::open(&all)?.for_each(|triangle| {
            if failure.is_none() {
                failure = gathering.push(triangle, |v| vertices.position(v), &mut write).err();
            }
        })?;
        failure.map_or(Ok(()), Err)?;
        let triangles = gathering.finish(&mut write)?;
        let counts = Counts { triangles, bounds, attributes, appearance };
        let mut writer = SealedWriter::within(&directory, DIVIDED_NAME, COUNTS_KIND, job)?;
        writer.put(&counts)?;
        writer.finish(false)?;
        directory.remove(&all);
        let values = ValueFiles::open(&directory)?;
        let input = NumberedMesh::Files { vertices, vertex_file, triangle_file: all, triangle_count };
        Ok(Self { directory, job, input, triangles: Triangles::Files, values, counts })
    }

    /// Opens a mesh that an earlier process has divided.
    ///
    /// # Errors
    /// If there is none, or its files are damaged.
    pub fn open(directory: &WorkDirectory, job: JobId) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open_of_job(&directory.path(DIVIDED_NAME), COUNTS_KIND, job)?;
        let counts: Counts = reader.get()?;
        reader.finish()?;
        let input = NumberedMesh::in_directory(directory, counts.triangles.iter().sum())?;
        let values = ValueFiles::open(directory)?;
        Ok(Self { directory: directory.clone(), job, input, triangles: Triangles::Files, values, counts })
    }

    /// A mesh that several processes have divided.
    ///
    /// # Errors
    /// If the files of values cannot be read.
    pub fn of_runs(
        directory: &WorkDirectory,
        job: JobId,
        input: NumberedMesh,
        runs: Arc<[RunFile]>,
        counts: Counts,
    ) -> Result<Self, WorkError> {
        let values = ValueFiles::open(directory)?;
        Ok(Self { directory: directory.clone(), job, input, triangles: Triangles::Runs(runs), values, counts })
    }

    /// How the surface looks.
    pub fn appearance(&self) -> &Appearance {
        &self.counts.appearance
    }

    /// Takes out what the input names, as far as it is kept.
    pub fn take_nodes(&mut self) -> Nodes {
        Nodes::taken(&mut self.counts.attributes)
    }

    /// Triangles before repair.
    pub fn triangle_count(&self) -> u64 {
        self.counts.triangles.iter().sum()
    }

    /// Triangles of a region before repair.
    pub fn triangles_of(&self, region: usize) -> u64 {
        self.counts.triangles.get(region).copied().unwrap_or(0)
    }

    /// Smallest and largest coordinates before repair.
    pub fn bounds(&self) -> [DVec3; 2] {
        self.counts.bounds
    }

    /// The number of regions.
    pub fn region_count(&self) -> usize {
        self.counts.triangles.len()
    }

    /// Bytes of memory that the largest region takes.
    pub fn largest_region_bytes(&self) -> u64 {
        let triangles = self.counts.triangles.iter().copied().max().unwrap_or(0);
        let all_triangles: u64 = self.counts.triangles.iter().sum();
        // Its share of the vertices is estimated from its triangles.
        let share = |count: u64| (count as f64 * triangles as f64 / all_triangles.max(1) as f64) as u64;
        let of_objects =
            if self.counts.attributes.objects.is_empty() { 0 } else { size_of::<u32>() as u64 * triangles };
        region_bytes(share(self.input.vertex_count()), triangles)
            + attribute_bytes(share(self.values.count()), triangles)
            + of_objects
    }

    /// The mesh of a region: its triangles in the order of the input, its vertices in the order in which these first
    /// use them. A single region has the input's vertices.
    ///
    /// # Errors
    /// If files cannot be read, or the input has changed since it was divided.
    pub fn take(&self, region: usize) -> Result<(Mesh, RegionAttributes), WorkError> {
        // A region without triangles has no file.
        if self.counts.triangles.get(region).is_none_or(|&count| count == 0) {
            return Ok(Default::default());
        }
        let (path, Gathered { mut triangles, numbers }) = match &self.triangles {
            Triangles::Files => self.read(region)?,
            Triangles::Runs(runs) => {
                let mut all = Gathered::default();
                runs.iter().try_for_each(|run| run.read(region as u32, &mut all))?;
                (self.directory.folder().to_owned(), all)
            }
        };
        // What is read has no hash of its own, but its length and its vertex numbers can be checked.
        let highest = triangles.iter().flatten().max().map_or(0, |&v| u64::from(v) + 1);
        if triangles.len() as u64 != self.counts.triangles[region] || highest > self.input.vertex_count() {
            return Err(WorkError::damaged(&path, DAMAGED));
        }
        let own = self.attributes_of(&path, &triangles, numbers)?;
        let positions = match self.region_count() {
            1 => self.input.all_positions()?,
            _ => {
                let (mut numbers, mut positions) = (VertexNumbers::default(), vec![]);
                for vertex in triangles.iter_mut().flatten() {
                    *vertex = *numbers.entry(*vertex).or_insert_with(|| {
                        positions.push(self.input.position(*vertex));
                        positions.len() as u32 - 1
                    });
                }
                positions
            }
        };
        if !positions.iter().all(|position| position.is_finite()) {
            return Err(WorkError::damaged(&path, "the input has changed since it was divided"));
        }
        Ok((Mesh { positions, triangles }, own))
    }

    fn read(&self, region: usize) -> Result<(PathBuf, Gathered), WorkError> {
        let path = self.directory.path(&triangle_file(region));
        let triangles = RecordReader::<[u32; 3]>::open(&path)?.read_all()?;
        let Counts { attributes, appearance, .. } = &self.counts;
        let numbers = match attributes.are_empty(appearance) {
            true => vec![],
            false => RecordReader::<u32>::open(&self.directory.path(&number_file(region)))?.read_all()?,
        };
        Ok((path, Gathered { triangles, numbers }))
    }

    /// The attributes of a region's triangles, which are given by their vertices and their numbers in the input.
    fn attributes_of(
        &self,
        path: &Path,
        triangles: &[[u32; 3]],
        numbers: Vec<u32>,
    ) -> Result<RegionAttributes, WorkError> {
        let Counts { attributes, appearance, .. } = &self.counts;
        if attributes.are_empty(appearance) {
            return Ok(RegionAttributes::default());
        }
        let all: u64 = self.counts.triangles.iter().sum();
        let highest = numbers.iter().max().map_or(0, |&number| u64::from(number) + 1);
        let values = |place: fn(&FileAttributes) -> (u64, usize), count: u64| {
            attributes.files.iter().map(place).all(|(first, stride)| stride == 0 || first < count)
        };
        let is_sound = numbers.len() == triangles.len()
            && highest <= all
            && values(|file| (file.first_vertex_value, file.vertex_stride), self.values.0[0].float_count())
            && values(|file| (file.first_corner_value, file.corner_stride), self.values.0[1].float_count());
        if !is_sound {
            return Err(WorkError::damaged(path, DAMAGED));
        }
        let numbered = numbers.into_iter().zip(triangles.iter().copied());
        Ok(RegionAttributes::gather(attributes, appearance, &self.values, numbered))
    }

    /// Removes the files of a region.
    pub fn discard(&self, region: usize) {
        for name in [triangle_file(region), number_file(region)] {
            self.directory.remove(&self.directory.path(&name));
        }
    }

    /// Removes the positions and values that all regions share.
    pub fn finish(self) {
        remove_shared(&self.directory);
    }
}

/// Removes the positions and values of an input that were in temporary files.
pub fn remove_shared(directory: &WorkDirectory) {
    [VERTICES_NAME].iter().chain(&VALUE_NAMES).for_each(|name| directory.remove(&directory.path(name)));
}

/// Appends the gathered triangles to the files of their regions, one file at a time.
fn write(directory: &WorkDirectory, gathered: &mut [Gathered]) -> Result<(), WorkError> {
    for (region, of_region) in gathered.iter_mut().enumerate().filter(|(_, some)| !some.triangles.is_empty()) {
        append(directory, &triangle_file(region), &mut of_region.triangles)?;
        append(directory, &number_file(region), &mut of_region.numbers)?;
    }
    Ok(())
}

fn append<R: Record>(directory: &WorkDirectory, name: &str, records: &mut Vec<R>) -> Result<(), WorkError> {
    if records.is_empty() {
        return Ok(());
    }
    let mut writer = RecordWriter::append(directory, name)?;
    writer.push_all(records)?;
    writer.finish()?;
    records.clear();
    Ok(())
}

/// The numbers that vertices of the input have in a region.
type VertexNumbers = HashMap<u32, u32, BuildHasherDefault<VertexHasher>>;

/// A fast hash that spreads vertex numbers.
#[derive(Default)]
struct VertexHasher(u64);

impl Hasher for VertexHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_u32(u32::from(byte)));
    }

    fn write_u32(&mut self, number: u32) {
        let spread = (self.0 ^ u64::from(number)).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        self.0 = spread ^ spread >> 32;
    }
}
