//! Dividing a mesh that is in temporary files.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::path::PathBuf;

use super::decompose::{Decomposition, Division};
use super::split::centroid;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::import::{SpilledMesh, VALUE_NAMES, VERTICES_NAME};
use crate::mesh::Mesh;
use crate::mesh::appearance::Appearance;
use crate::mesh::attributes::{AttributeValues, Attributes, FileAttributes, RegionAttributes};
use crate::storage::memory::{attribute_bytes, region_bytes};
use crate::storage::{
    DAMAGED, JobId, Lookup, Record, RecordReader, RecordWriter, SealedReader, SealedWriter, WorkDirectory, WorkError,
};

/// Triangles to gather before they are written to the files of their regions: 12 MiB.
const GATHERED: usize = 1 << 20;

/// The regions of a mesh, each a file of triangles. They share the positions of the whole mesh.
#[derive(Debug)]
pub struct DividedMesh {
    /// Holds the files.
    pub directory: WorkDirectory,
    /// The job for which the mesh was divided.
    pub job: JobId,
    vertices: Lookup,
    vertex_file: PathBuf,
    values: ValueFiles,
    counts: Counts,
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
#[derive(Debug, Serialize, Deserialize)]
struct Counts {
    /// Triangles of each region.
    triangles: Vec<u64>,
    bounds: [DVec3; 2],
    /// Attributes, without their values.
    attributes: Attributes,
    appearance: Appearance,
}

const COUNTS_NAME: &str = "divided";
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
        let has_attributes = !appearance.is_empty();
        let tree = if triangle_count <= division.triangles {
            Decomposition::whole()
        } else {
            Decomposition::new(bounds, division, &mut |visit| {
                RecordReader::<[u32; 3]>::open(&all)?
                    .for_each(|triangle| visit(centroid(triangle.map(|v| vertices.position(v)))))
            })?
        };
        let mut triangle_counts = vec![0; tree.region_count() as usize];
        // An interrupted division may have left some.
        for region in 0..triangle_counts.len() {
            [triangle_file(region), number_file(region)]
                .iter()
                .for_each(|name| directory.remove(&directory.path(name)));
        }
        let mut gathered = vec![Gathered::default(); triangle_counts.len()];
        let (mut count, mut failure, mut number) = (0, None, 0);
        RecordReader::<[u32; 3]>::open(&all)?.for_each(|triangle| {
            let region = tree.region_of(centroid(triangle.map(|v| vertices.position(v)))) as usize;
            gathered[region].triangles.push(triangle);
            if has_attributes {
                gathered[region].numbers.push(number);
                number += 1;
            }
            triangle_counts[region] += 1;
            count += 1;
            if count == GATHERED && failure.is_none() {
                failure = write(&directory, &mut gathered).err();
                count = 0;
            }
        })?;
        failure.map_or(Ok(()), Err)?;
        write(&directory, &mut gathered)?;
        let counts = Counts { triangles: triangle_counts, bounds, attributes, appearance };
        let mut writer = SealedWriter::within(&directory, COUNTS_NAME, COUNTS_KIND, job)?;
        writer.put(&counts)?;
        writer.finish(false)?;
        directory.remove(&all);
        let values = ValueFiles::open(&directory)?;
        Ok(Self { directory, job, vertices, vertex_file, values, counts })
    }

    /// Opens a mesh that an earlier process has divided.
    ///
    /// # Errors
    /// If there is none, or its files are damaged.
    pub fn open(directory: &WorkDirectory, job: JobId) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open_of_job(&directory.path(COUNTS_NAME), COUNTS_KIND, job)?;
        let counts: Counts = reader.get()?;
        reader.finish()?;
        let vertex_file = directory.path(VERTICES_NAME);
        // Positions are removed once all regions are repaired.
        let vertices = if vertex_file.exists() { Lookup::open(&vertex_file)? } else { Lookup::empty() };
        let values = ValueFiles::open(directory)?;
        Ok(Self { directory: directory.clone(), job, vertices, vertex_file, values, counts })
    }

    /// How the surface looks.
    pub fn appearance(&self) -> &Appearance {
        &self.counts.appearance
    }

    /// Triangles before repair.
    pub fn triangle_count(&self) -> u64 {
        self.counts.triangles.iter().sum()
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
        region_bytes(share(self.vertices.count()), triangles) + attribute_bytes(share(self.values.count()), triangles)
    }

    /// The mesh of a region: its triangles in the order of the input, its vertices in the order in which these first use them. A single
    /// region has the input's vertices.
    ///
    /// # Errors
    /// If files cannot be read.
    pub fn take(&self, region: usize) -> Result<(Mesh, RegionAttributes), WorkError> {
        let path = self.directory.path(&triangle_file(region));
        // A region without triangles has no file.
        if self.counts.triangles[region] == 0 {
            return Ok(Default::default());
        }
        let mut triangles = RecordReader::<[u32; 3]>::open(&path)?.read_all()?;
        // A file that grows has no hash, but its length and its vertex numbers can be checked.
        let highest = triangles.iter().flatten().max().map_or(0, |&v| u64::from(v) + 1);
        if triangles.len() as u64 != self.counts.triangles[region] || highest > self.vertices.count() {
            return Err(WorkError::damaged(&path, DAMAGED));
        }
        let own = self.attributes_of(region, &triangles)?;
        if self.region_count() == 1 {
            return Ok((Mesh { positions: RecordReader::open(&self.vertex_file)?.read_all()?, triangles }, own));
        }
        let mut numbers: HashMap<u32, u32, BuildHasherDefault<VertexHasher>> = HashMap::default();
        let mut positions = vec![];
        for vertex in triangles.iter_mut().flatten() {
            *vertex = *numbers.entry(*vertex).or_insert_with(|| {
                positions.push(self.vertices.position(*vertex));
                positions.len() as u32 - 1
            });
        }
        Ok((Mesh { positions, triangles }, own))
    }

    /// The attributes of a region's triangles, which are given by their vertices in the input.
    fn attributes_of(&self, region: usize, triangles: &[[u32; 3]]) -> Result<RegionAttributes, WorkError> {
        let Counts { attributes, appearance, .. } = &self.counts;
        if appearance.is_empty() {
            return Ok(RegionAttributes::default());
        }
        let path = self.directory.path(&number_file(region));
        let numbers = RecordReader::<u32>::open(&path)?.read_all()?;
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
            return Err(WorkError::damaged(&path, DAMAGED));
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
        self.directory.remove(&self.vertex_file);
        VALUE_NAMES.iter().for_each(|name| self.directory.remove(&self.directory.path(name)));
    }
}

/// Triangles of a region, and their numbers where they have attributes.
#[derive(Clone, Default)]
struct Gathered {
    triangles: Vec<[u32; 3]>,
    numbers: Vec<u32>,
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
