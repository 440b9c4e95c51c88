//! Where importers put vertices and triangles: in memory as long as it is enough, then in temporary files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::attributes::AttributeSink;
use super::error::Parsed;
use super::objects::ObjectSink;
use super::polygon::Triangulator;
use super::source::Source;
use super::{ImportError, ImportOptions, check_size};
use lodpack_mesh::Mesh;
#[cfg(doc)]
use lodpack_mesh::NONE;
use lodpack_mesh::appearance::Appearance;
use lodpack_mesh::attributes::{AttributeLayout, Attributes, ObjectNode, Surface};
use lodpack_runtime::storage::memory::{attribute_bytes, mesh_bytes, texel_bytes};
use lodpack_runtime::storage::{Lookup, RecordWriter, WorkDirectory, WorkError};

/// File name of the positions.
pub const VERTICES_NAME: &str = "vertices";
/// File name of the triangles.
pub const TRIANGLES_NAME: &str = "triangles";
/// File names of the values of vertices and of corners.
pub const VALUE_NAMES: [&str; 2] = ["vertex-values", "corner-values"];
/// Vertices or triangles collected before they are written.
const CHUNK: usize = 1 << 16;

/// How much memory an import may use, and where it goes beyond that.
#[derive(Clone, Debug)]
pub struct Room {
    /// Bytes that a build of the mesh in memory may use.
    pub memory: u64,
    /// Where a mesh goes that needs more.
    pub overflow: Overflow,
}

/// Where a mesh goes that does not fit in memory.
#[derive(Clone, Debug)]
pub enum Overflow {
    /// To a new directory of this name, if the mesh does not fit.
    New(PathBuf),
    /// To this directory, whether the mesh would fit or not.
    Into(WorkDirectory),
}

impl Room {
    /// Unlimited memory.
    pub fn memory_alone() -> Self {
        Self { memory: u64::MAX, overflow: Overflow::New(PathBuf::new()) }
    }

    /// Whether a mesh of this size may stay in memory, beside other bytes.
    fn has(&self, vertices: u64, triangles: u64, others: u64) -> bool {
        matches!(self.overflow, Overflow::New(_))
            && mesh_bytes(vertices, triangles).saturating_add(others) <= self.memory
    }
}

/// A mesh in temporary files.
#[derive(Debug)]
pub struct SpilledMesh {
    /// The directory that holds the files.
    pub directory: WorkDirectory,
    /// The positions.
    pub vertices: Lookup,
    /// The file of positions.
    pub vertex_file: PathBuf,
    /// The file of triangles.
    pub triangle_file: PathBuf,
    /// Number of triangles.
    pub triangle_count: u64,
    /// Smallest and largest coordinates.
    pub bounds: [DVec3; 2],
    /// Attributes, without their values.
    pub attributes: Attributes,
    /// The files of values of vertices and of corners; there are none without attributes.
    pub value_files: Option<[PathBuf; 2]>,
    /// What the attributes mean.
    pub appearance: Appearance,
}

/// An imported mesh, wherever it is.
#[derive(Debug)]
pub enum Imported {
    /// The mesh fits in memory.
    Memory(Surface),
    /// The mesh is in temporary files.
    Spilled(SpilledMesh),
}

impl Imported {
    /// Takes a surface that is in memory, and moves it to disk if it must.
    ///
    /// # Errors
    ///
    /// If temporary files cannot be written.
    pub fn new(surface: impl Into<Surface>, room: &Room) -> Result<Self, WorkError> {
        let surface = surface.into();
        let Surface { mesh, mut attributes, appearance } = surface;
        let (vertices, triangles) = (mesh.positions.len() as u64, mesh.triangles.len() as u64);
        let values = [std::mem::take(&mut attributes.vertex_values), std::mem::take(&mut attributes.corner_values)];
        let others = attribute_bytes(values.iter().map(|values| values.len() as u64).sum(), triangles);
        let others = others.saturating_add(texel_bytes(appearance.texels, room.memory));
        if room.has(vertices, triangles, others) {
            [attributes.vertex_values, attributes.corner_values] = values;
            return Ok(Self::Memory(Surface { mesh, attributes, appearance }));
        }
        let mut spill = Spill::new(&room.overflow)?;
        spill.push(&mesh.positions, &mesh.triangles)?;
        spill.push_values(values)?;
        spill.finish(attributes, appearance)
    }
}

/// Two files that grow.
struct Spill {
    directory: WorkDirectory,
    vertices: RecordWriter<DVec3>,
    triangles: RecordWriter<[u32; 3]>,
    /// Values of vertices and of corners, once there are some.
    values: Option<[RecordWriter<f32>; 2]>,
    vertex_count: u64,
    triangle_count: u64,
    bounds: [DVec3; 2],
}

impl Spill {
    fn new(overflow: &Overflow) -> Result<Self, WorkError> {
        let directory = match overflow {
            Overflow::New(path) => WorkDirectory::create(path)?,
            Overflow::Into(directory) => directory.clone(),
        };
        Ok(Self {
            vertices: RecordWriter::create(&directory, VERTICES_NAME)?,
            triangles: RecordWriter::create(&directory, TRIANGLES_NAME)?,
            values: None,
            directory,
            vertex_count: 0,
            triangle_count: 0,
            bounds: Mesh::default().bounds(),
        })
    }

    fn push(&mut self, positions: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), WorkError> {
        self.vertices.push_all(positions)?;
        self.triangles.push_all(triangles)?;
        self.vertex_count += positions.len() as u64;
        self.triangle_count += triangles.len() as u64;
        for &p in positions {
            self.bounds = [self.bounds[0].min(p), self.bounds[1].max(p)];
        }
        Ok(())
    }

    fn push_values(&mut self, [of_vertices, of_corners]: [Vec<f32>; 2]) -> Result<(), WorkError> {
        if self.values.is_none() && !(of_vertices.is_empty() && of_corners.is_empty()) {
            let [first, second] = VALUE_NAMES.map(|name| RecordWriter::create(&self.directory, name));
            self.values = Some([first?, second?]);
        }
        if let Some([vertices, corners]) = &mut self.values {
            vertices.push_all(&of_vertices)?;
            corners.push_all(&of_corners)?;
        }
        Ok(())
    }

    /// The positions so far, for lookup.
    fn lookup(&mut self) -> Result<Lookup, WorkError> {
        self.vertices.flush()?;
        Lookup::open(self.vertices.path())
    }

    fn finish(self, attributes: Attributes, appearance: Appearance) -> Result<Imported, WorkError> {
        let vertex_file = self.vertices.finish()?;
        let finished = self.values.map(|[vertices, corners]| Ok([vertices.finish()?, corners.finish()?]));
        let value_files = finished.transpose()?;
        Ok(Imported::Spilled(SpilledMesh {
            vertices: Lookup::open(&vertex_file)?,
            vertex_file,
            triangle_file: self.triangles.finish()?,
            directory: self.directory,
            triangle_count: self.triangle_count,
            bounds: self.bounds,
            attributes,
            value_files,
            appearance,
        }))
    }
}

/// Collects the vertices and triangles of one file after the other. Parsers number vertices per file.
pub struct MeshSink {
    room: Room,
    /// The whole mesh or, once there are temporary files, the part not yet written.
    mesh: Mesh,
    /// Length of either list of `mesh` at which it must be checked or written.
    full: usize,
    spill: Option<Spill>,
    /// The positions so far, while polygons look them up.
    lookup: Option<Lookup>,
    /// First vertex of the current file.
    first_vertex: u64,
    first_triangle: u64,
    /// Bytes that the parser of the current file holds.
    held: u64,
    polygon: Vec<[u32; 3]>,
    /// What the surface carries.
    pub attributes: AttributeSink,
    objects: ObjectSink,
    /// What the files contain beside their surface.
    left_out: BTreeSet<&'static str>,
    /// What a user should know of the files that have ended.
    pub(super) notes: Vec<String>,
}

impl MeshSink {
    pub(super) fn new(room: Room, options: &ImportOptions) -> Self {
        Self {
            room,
            mesh: Mesh::default(),
            full: CHUNK,
            spill: None,
            lookup: None,
            first_vertex: 0,
            first_triangle: 0,
            held: 0,
            polygon: vec![],
            attributes: AttributeSink::new(&options.channels),
            objects: ObjectSink::new(options.objects),
            left_out: BTreeSet::new(),
            notes: vec![],
        }
    }

    /// Remembers that a file contains something beside its surface, such as "normals".
    pub(super) fn leave_out(&mut self, what: &'static str) {
        self.left_out.insert(what);
    }

    /// A sentence about everything that the files contain beside their surface, if there is anything.
    pub(super) fn left_out(&self) -> Option<String> {
        let all: Vec<&str> = self.left_out.iter().copied().collect();
        let advice = if all.contains(&"normals") { "; --channels all keeps normals" } else { "" };
        (!all.is_empty()).then(|| format!("{} of the input are left out{advice}", all.join(", ")))
    }

    /// A sentence about the channels that the files have, if they have any.
    pub(super) fn channels(&self) -> Option<String> {
        self.attributes.found()
    }

    /// Reserves memory for vertices and triangles that are known to come.
    pub fn reserve(&mut self, vertices: usize, triangles: usize) -> Parsed<()> {
        let (all_vertices, all_triangles) = self.counts();
        if !self.room.has(all_vertices + vertices as u64, all_triangles + triangles as u64, self.others()) {
            return self.spill();
        }
        self.mesh.positions.reserve(vertices);
        self.mesh.triangles.reserve(triangles);
        Ok(())
    }

    /// Adds a vertex.
    #[inline]
    pub fn push_vertex(&mut self, position: DVec3) -> Parsed<()> {
        self.mesh.positions.push(position);
        if self.mesh.positions.len() >= self.full { self.make_room() } else { Ok(()) }
    }

    /// Adds a triangle. Its vertices may follow later, but in the same file.
    #[inline]
    pub fn push_triangle(&mut self, triangle: [u32; 3]) -> Parsed<()> {
        // If there are too many vertices, the end of the file refuses them.
        self.mesh.triangles.push(triangle.map(|v| v.wrapping_add(self.first_vertex as u32)));
        if self.mesh.triangles.len() >= self.full { self.make_room() } else { Ok(()) }
    }

    /// Triangulates a polygon, all of whose vertices must have been pushed.
    pub(super) fn push_polygon(&mut self, polygon: &[u32], faces: &mut Triangulator) -> Parsed<()> {
        self.push_polygon_with(polygon, &[], faces)
    }

    /// As [`Self::push_polygon`], with the records of the polygon's corners.
    pub(super) fn push_polygon_with(
        &mut self,
        polygon: &[u32],
        records: &[f32],
        faces: &mut Triangulator,
    ) -> Parsed<()> {
        if let &[a, b, c] = polygon {
            let stride = self.attributes.corner_stride();
            if stride > 0 {
                records.chunks_exact(stride).for_each(|record| self.attributes.push_corner(record));
            }
            return self.push_triangle([a, b, c]);
        }
        if self.spill.is_some() && (self.lookup.is_none() || !self.mesh.positions.is_empty()) {
            self.spill()?;
            self.lookup = self.spill.as_mut().map(Spill::lookup).transpose().map_err(ImportError::from)?;
        }
        let first = self.first_vertex as u32;
        let mut triangles = std::mem::take(&mut self.polygon);
        match &self.lookup {
            Some(lookup) => faces.push_polygon(polygon, |v| lookup.position(first.wrapping_add(v)), &mut triangles),
            None => faces.push_polygon(polygon, |v| self.mesh.positions[(first + v) as usize], &mut triangles),
        }
        let stride = self.attributes.corner_stride();
        let pushed = triangles.iter().try_for_each(|&corners| {
            for corner in corners {
                let record = records.get(corner as usize * stride..).and_then(|rest| rest.get(..stride));
                record.into_iter().for_each(|record| self.attributes.push_corner(record));
            }
            self.push_triangle(corners.map(|corner| polygon[corner as usize]))
        });
        triangles.clear();
        self.polygon = triangles;
        pushed
    }

    /// Sets the material of the triangles that follow.
    pub fn set_material(&mut self, material: usize) {
        let (_, triangles) = self.counts();
        self.attributes.set_material(material, triangles);
    }

    /// Sets the chart of the triangles that follow. Inputs whose charts are kept say it before their first triangle.
    pub fn set_chart(&mut self, chart: u32) {
        let (_, triangles) = self.counts();
        self.attributes.set_chart(chart, triangles);
    }

    /// Sentences about objects that are not kept as they are.
    pub(super) fn about_objects(&self) -> Vec<String> {
        self.objects.about()
    }

    /// Whether the objects that the input names may be kept.
    pub(super) fn wants_objects(&self) -> bool {
        self.objects.are_wanted()
    }

    /// Adds an object or an assembly that the file names; its parent was added before. Returns its number.
    pub fn add_node(&mut self, node: ObjectNode) -> u32 {
        self.objects.add(node)
    }

    /// Sets the object of the triangles that follow: the number of a node of the file, or [`NONE`].
    pub fn set_object(&mut self, node: u32) {
        let (_, triangles) = self.counts();
        self.objects.set(node, triangles);
    }

    /// Declares the record of every vertex of the file; those that are already there get a blank one.
    pub(super) fn set_vertex_layout(&mut self, layout: AttributeLayout) {
        let vertices = self.vertex_count();
        self.attributes.set_vertex_layout(layout, vertices);
    }

    /// Declares the record of every corner of the file; those of triangles that are already there get a blank one.
    pub fn set_corner_layout(&mut self, layout: AttributeLayout) {
        let triangles = self.triangle_count();
        self.attributes.set_corner_layout(layout, triangles);
    }

    /// Declares how many bytes the document of the current file takes; refuses files for which there is not enough
    /// memory.
    pub(super) fn hold(&mut self, source: &Source, bytes: u64) -> Parsed<()> {
        let what = "its JSON text, embedded buffers included,";
        self.hold_or_refuse(source, bytes, what, "export it as GLB or with a .bin file, convert it to PLY")
    }

    /// The same with what is decompressed at once.
    pub(super) fn hold_decompressed(&mut self, source: &Source, bytes: u64) -> Parsed<()> {
        let what = "its JSON text, with its buffers decompressed,";
        self.hold_or_refuse(source, bytes, what, "convert it to PLY, or to GLB without compression")
    }

    /// Declares how many bytes the surface of the current file takes before it is handed on; refuses files for which
    /// there is not enough memory.
    pub(super) fn hold_whole(&mut self, source: &Source, bytes: u64) -> Parsed<()> {
        self.hold_or_refuse(source, bytes, "its surface", "extract a PLY file from it")
    }

    fn hold_or_refuse(&mut self, source: &Source, bytes: u64, what: &'static str, remedy: &'static str) -> Parsed<()> {
        let (least, memory) = (mesh_bytes(0, 0).saturating_add(bytes), self.room.memory);
        // Holding nothing is never too much: whether there is memory for a build at all is not checked here.
        if bytes > 0 && least > memory {
            return Err(ImportError::Memory { path: source.path.to_owned(), what, remedy, least, memory }.into());
        }
        self.held = bytes;
        self.make_room()
    }

    /// Declares how many bytes the parser of the current file holds, beside what it holds in any case.
    pub(super) fn hold_beside(&mut self, bytes: u64) {
        self.held = bytes;
    }

    /// Number of vertices of the current file.
    pub(super) fn vertex_count(&self) -> u64 {
        self.counts().0 - self.first_vertex
    }

    /// Number of triangles of the current file.
    pub(super) fn triangle_count(&self) -> u64 {
        self.counts().1 - self.first_triangle
    }

    /// Ends a file, and refuses the mesh so far if it cannot be numbered.
    pub(super) fn end_file(&mut self, path: &Path) -> Parsed<()> {
        let (vertices, triangles) = self.counts();
        check_size(path, vertices, triangles)?;
        let own = [vertices - self.first_vertex, triangles - self.first_triangle];
        let notes = self.attributes.end_file(own, [vertices, triangles], self.room.memory / 2);
        self.notes.extend(notes.into_iter().map(|note| format!("{}: {note}", path.display())));
        self.objects.end_file(path, self.first_triangle..triangles);
        (self.first_vertex, self.first_triangle) = (vertices, triangles);
        self.lookup = None;
        self.held = 0;
        Ok(())
    }

    /// How much memory there is.
    pub(super) fn room(&self) -> Room {
        self.room.clone()
    }

    pub(super) fn finish(mut self) -> Parsed<Imported> {
        self.make_room()?;
        if self.spill.is_some() {
            self.spill()?;
        }
        self.attributes.check_names()?;
        self.attributes.check_count()?;
        let (mut attributes, appearance) = self.attributes.finish();
        self.objects.finish(&mut attributes);
        match self.spill {
            Some(spill) => Ok(spill.finish(attributes, appearance).map_err(ImportError::from)?),
            None => Ok(Imported::Memory(Surface { mesh: self.mesh, attributes, appearance })),
        }
    }

    /// Bytes in memory beside the mesh.
    fn others(&self) -> u64 {
        let (_, triangles) = self.counts();
        let objects = self.objects.bytes(triangles);
        self.held.saturating_add(attribute_bytes(self.attributes.value_count(), triangles)).saturating_add(objects)
    }

    fn counts(&self) -> (u64, u64) {
        let (vertices, triangles) =
            self.spill.as_ref().map_or((0, 0), |spill| (spill.vertex_count, spill.triangle_count));
        (vertices + self.mesh.positions.len() as u64, triangles + self.mesh.triangles.len() as u64)
    }

    #[cold]
    fn make_room(&mut self) -> Parsed<()> {
        let (vertices, triangles) = self.counts();
        if self.spill.is_some() || !self.room.has(vertices, triangles, self.others()) {
            return self.spill();
        }
        // Check again after another chunk of either.
        self.full = self.mesh.positions.len().max(self.mesh.triangles.len()) + CHUNK;
        Ok(())
    }

    /// Writes everything so far, and from now on everything that follows.
    #[cold]
    fn spill(&mut self) -> Parsed<()> {
        if self.spill.is_none() {
            self.spill = Some(Spill::new(&self.room.overflow).map_err(ImportError::from)?);
        }
        if let Some(spill) = &mut self.spill {
            spill.push(&self.mesh.positions, &self.mesh.triangles).map_err(ImportError::from)?;
            spill.push_values(self.attributes.take_values()).map_err(ImportError::from)?;
        }
        if !self.mesh.positions.is_empty() {
            self.lookup = None;
        }
        self.full = CHUNK;
        let was_large = self.mesh.positions.capacity().max(self.mesh.triangles.capacity()) > 2 * CHUNK;
        if was_large {
            self.mesh = Mesh::default();
        }
        self.mesh.positions.clear();
        self.mesh.triangles.clear();
        Ok(())
    }
}
