//! Dividing a mesh that is in temporary files.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::path::PathBuf;

use super::decompose::Decomposition;
use super::split::centroid;
use crate::import::SpilledMesh;
use crate::memory::region_bytes;
use crate::mesh::Mesh;
use crate::temporary::{Lookup, RecordReader, RecordWriter, TemporaryDirectory, TemporaryError};

/// Triangles that are gathered before they are written to the files of their regions: 12 MiB.
const GATHERED: usize = 1 << 20;

/// The regions of a mesh, each a file of triangles; the positions are those of the whole mesh.
pub(super) struct DividedMesh {
    pub directory: TemporaryDirectory,
    vertices: Lookup,
    vertex_file: PathBuf,
    /// Triangles of each region.
    triangle_counts: Vec<u64>,
}

fn triangle_file(region: usize) -> String {
    format!("region-{region}.input")
}

impl DividedMesh {
    /// Divides as [`super::split_mesh`] does.
    pub fn new(mesh: SpilledMesh, limit: u64) -> Result<Self, TemporaryError> {
        let SpilledMesh { directory, vertices, vertex_file, triangle_file: all, triangle_count, bounds } = mesh;
        let tree = if triangle_count <= limit {
            Decomposition::whole()
        } else {
            Decomposition::new(bounds, limit, &mut |visit| {
                RecordReader::<[u32; 3]>::open(&all)?
                    .for_each(|triangle| visit(centroid(triangle.map(|v| vertices.position(v)))))
            })?
        };
        let mut triangle_counts = vec![0; tree.region_count() as usize];
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
        directory.remove(&all);
        Ok(Self { directory, vertices, vertex_file, triangle_counts })
    }

    pub fn region_count(&self) -> usize {
        self.triangle_counts.len()
    }

    /// Memory that the largest region takes.
    pub fn largest_region_bytes(&self) -> u64 {
        let triangles = self.triangle_counts.iter().copied().max().unwrap_or(0);
        let all_triangles: u64 = self.triangle_counts.iter().sum();
        // Of vertices it will have its share.
        let vertices = self.vertices.count() as f64 * triangles as f64 / all_triangles.max(1) as f64;
        region_bytes(vertices as u64, triangles)
    }

    /// Takes a region out: the triangles in the order of the input, the vertices as these use them first. Where there is but
    /// one region, it has the input's vertices.
    pub fn take(&self, region: usize) -> Result<Mesh, TemporaryError> {
        let path = self.directory.path(&triangle_file(region));
        // No triangle, no file.
        if self.triangle_counts[region] == 0 {
            return Ok(Mesh::default());
        }
        let mut triangles = RecordReader::<[u32; 3]>::open(&path)?.read_all()?;
        self.directory.remove(&path);
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

    /// Drops what all regions share.
    pub fn finish(self) -> TemporaryDirectory {
        self.directory.remove(&self.vertex_file);
        self.directory
    }
}

/// Appends what was gathered to the files, of which few are open at a time.
fn write(directory: &TemporaryDirectory, gathered: &mut [Vec<[u32; 3]>]) -> Result<(), TemporaryError> {
    for (region, triangles) in gathered.iter_mut().enumerate().filter(|(_, triangles)| !triangles.is_empty()) {
        let mut writer = RecordWriter::append(directory, &triangle_file(region))?;
        writer.push_all(triangles)?;
        writer.finish()?;
        triangles.clear();
    }
    Ok(())
}

/// Spreads vertex numbers; nobody chooses them so that they collide.
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
