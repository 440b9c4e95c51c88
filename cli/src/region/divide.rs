//! Dividing a mesh that is in temporary files.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::path::PathBuf;

use super::decompose::{Decomposition, Division};
use super::split::centroid;
use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::import::{SpilledMesh, VERTICES_NAME};
use crate::mesh::Mesh;
use crate::storage::memory::region_bytes;
use crate::storage::{
    DAMAGED, JobId, Lookup, RecordReader, RecordWriter, SealedReader, SealedWriter, WorkDirectory, WorkError,
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
    counts: Counts,
}

/// The note that says that a mesh has been divided.
#[derive(Debug, Serialize, Deserialize)]
struct Counts {
    /// Triangles of each region.
    triangles: Vec<u64>,
    bounds: [DVec3; 2],
}

const COUNTS_NAME: &str = "divided";
const COUNTS_KIND: [u8; 4] = *b"divd";

fn triangle_file(region: usize) -> String {
    format!("region-{region}.input")
}

impl DividedMesh {
    /// Divides as [`super::split_mesh`] does.
    ///
    /// # Errors
    /// If files cannot be read or written.
    pub fn new(mesh: SpilledMesh, division: Division, job: JobId) -> Result<Self, WorkError> {
        let SpilledMesh { directory, vertices, vertex_file, triangle_file: all, triangle_count, bounds } = mesh;
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
        (0..triangle_counts.len()).for_each(|region| directory.remove(&directory.path(&triangle_file(region))));
        let mut gathered = vec![vec![]; triangle_counts.len()];
        let (mut count, mut failure) = (0, None);
        RecordReader::<[u32; 3]>::open(&all)?.for_each(|triangle| {
            let region = tree.region_of(centroid(triangle.map(|v| vertices.position(v)))) as usize;
            gathered[region].push(triangle);
            triangle_counts[region] += 1;
            count += 1;
            if count == GATHERED && failure.is_none() {
                failure = write(&directory, &mut gathered).err();
                count = 0;
            }
        })?;
        failure.map_or(Ok(()), Err)?;
        write(&directory, &mut gathered)?;
        let counts = Counts { triangles: triangle_counts, bounds };
        let mut writer = SealedWriter::within(&directory, COUNTS_NAME, COUNTS_KIND, job)?;
        writer.put(&counts)?;
        writer.finish(false)?;
        directory.remove(&all);
        Ok(Self { directory, job, vertices, vertex_file, counts })
    }

    /// Opens a mesh that an earlier process has divided.
    ///
    /// # Errors
    /// If there is none, or its files are damaged.
    pub fn open(directory: &WorkDirectory, job: JobId) -> Result<Self, WorkError> {
        let mut reader = SealedReader::open_of_job(&directory.path(COUNTS_NAME), COUNTS_KIND, job)?;
        let counts = reader.get()?;
        reader.finish()?;
        let vertex_file = directory.path(VERTICES_NAME);
        // Positions are removed once all regions are repaired.
        let vertices = if vertex_file.exists() { Lookup::open(&vertex_file)? } else { Lookup::empty() };
        Ok(Self { directory: directory.clone(), job, vertices, vertex_file, counts })
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
        let vertices = self.vertices.count() as f64 * triangles as f64 / all_triangles.max(1) as f64;
        region_bytes(vertices as u64, triangles)
    }

    /// The mesh of a region: its triangles in the order of the input, its vertices in the order in which these first use them. A single
    /// region has the input's vertices.
    ///
    /// # Errors
    /// If files cannot be read.
    pub fn take(&self, region: usize) -> Result<Mesh, WorkError> {
        let path = self.directory.path(&triangle_file(region));
        // A region without triangles has no file.
        if self.counts.triangles[region] == 0 {
            return Ok(Mesh::default());
        }
        let mut triangles = RecordReader::<[u32; 3]>::open(&path)?.read_all()?;
        // A file that grows has no hash, but its length and its vertex numbers can be checked.
        let highest = triangles.iter().flatten().max().map_or(0, |&v| u64::from(v) + 1);
        if triangles.len() as u64 != self.counts.triangles[region] || highest > self.vertices.count() {
            return Err(WorkError::damaged(&path, DAMAGED));
        }
        if self.region_count() == 1 {
            return Ok(Mesh { positions: RecordReader::open(&self.vertex_file)?.read_all()?, triangles });
        }
        let mut numbers: HashMap<u32, u32, BuildHasherDefault<VertexHasher>> = HashMap::default();
        let mut positions = vec![];
        for vertex in triangles.iter_mut().flatten() {
            *vertex = *numbers.entry(*vertex).or_insert_with(|| {
                positions.push(self.vertices.position(*vertex));
                positions.len() as u32 - 1
            });
        }
        Ok(Mesh { positions, triangles })
    }

    /// Removes the file of a region.
    pub fn discard(&self, region: usize) {
        self.directory.remove(&self.directory.path(&triangle_file(region)));
    }

    /// Removes the positions that all regions share.
    pub fn finish(self) {
        self.directory.remove(&self.vertex_file);
    }
}

/// Appends the gathered triangles to the files of their regions, one file at a time.
fn write(directory: &WorkDirectory, gathered: &mut [Vec<[u32; 3]>]) -> Result<(), WorkError> {
    for (region, triangles) in gathered.iter_mut().enumerate().filter(|(_, triangles)| !triangles.is_empty()) {
        let mut writer = RecordWriter::append(directory, &triangle_file(region))?;
        writer.push_all(triangles)?;
        writer.finish()?;
        triangles.clear();
    }
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
