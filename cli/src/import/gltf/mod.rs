//! glTF 2.0 and GLB: reads every triangle primitive of the default scene, expands instances, and applies node
//! transforms in f64.
//!
//! The `gltf` crate parses and validates the JSON. Buffers and accessors are read here: images are not opened yet,
//! external buffers are memory-mapped, and every offset and count is checked.

mod accessor;
mod attributes;
mod buffers;
mod document;
mod extras;
mod materials;
mod smooth;

use std::borrow::Cow;
use std::path::PathBuf;

use ::gltf::mesh::Mode;
use ::gltf::scene::Transform;
use ::gltf::{Document, Node, Primitive};
use glam::{DMat4, DQuat, DVec3, Vec4};

use super::beside::Beside;
use super::error::{ImportError, Location, Parsed};
use super::sink::MeshSink;
use super::source::Source;

use accessor::{location_of, read_indices, read_positions};
use attributes::{SceneAttributes, is_surface};
use buffers::Buffers;
use document::{check_surface_extensions, document_bytes, parse_document};

/// Reads a binary container.
pub(super) fn read_glb(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let bytes = source.bytes;
    let word = |at: usize| bytes.get(at..at + 4).and_then(|b| b.try_into().ok()).map(u32::from_le_bytes);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(source.truncated(Location::Byte(0), "a GLB file has at least 12 bytes"));
    };
    if version != 2 {
        return Err(source.unsupported(format!("glTF version {version}"), "convert it to glTF 2.0"));
    }
    if length as usize > bytes.len() {
        let missing = format!("the header announces {length} bytes, {} are there", bytes.len());
        return Err(source.truncated(Location::Byte(8), missing));
    }
    source.note_skipped((bytes.len() - length as usize) as u64, "bytes after the announced end were ignored");
    let (mut json, mut binary) = (None, None);
    let mut at = 12;
    while at + 8 <= length as usize {
        let (size, kind) = (word(at).unwrap_or(0) as usize, word(at + 4).unwrap_or(0));
        let Some(chunk) = bytes[..length as usize].get(at + 8..at + 8 + size) else {
            return Err(source.truncated(Location::Byte(at as u64), format!("a chunk of {size} bytes does not fit")));
        };
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(chunk),
            b"BIN\0" if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at += 8 + size;
    }
    let Some(json) = json else {
        return Err(source.syntax(Location::Byte(12), "the file has no JSON chunk; it is damaged"));
    };
    read_document(source, json, binary, sink)
}

/// Reads a JSON file, with its buffers beside it or embedded.
pub(super) fn read_gltf(source: &Source, sink: &mut MeshSink) -> Parsed<()> {
    let json = source.bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(source.bytes);
    read_document(source, json, None, sink)
}

fn read_document<'a>(source: &Source<'a>, json: &'a [u8], binary: Option<&'a [u8]>, sink: &mut MeshSink) -> Parsed<()> {
    sink.hold(source, document_bytes(json))?;
    let document = parse_document(source, json)?;
    source.drop_pages();
    check_surface_extensions(source, &document, binary.is_some())?;
    let buffers = Buffers::open(source, &document, binary)?;
    let attributes = SceneAttributes::of_document(source, &document, &buffers, sink)?;
    let mut scene = SceneReader { source, buffers: &buffers, attributes, sink, skipped_primitive_count: 0 };
    scene.read_nodes(&document)?;
    scene.attributes.note(source);
    source.note_skipped(scene.skipped_primitive_count, "point or line primitives were left out");
    source.note_skipped(document.skins().len() as u64, "skins were ignored: the mesh is taken in its bind pose");
    let what = "meshes have morph targets with weights, which were ignored: the mesh is taken in its base shape";
    source.note_skipped(morphed_count(&document), what);
    Ok(())
}

/// The images that a file names.
pub(super) fn files_beside(source: &Source) -> Vec<PathBuf> {
    #[derive(serde::Deserialize)]
    struct Names {
        #[serde(default)]
        images: Vec<Name>,
    }
    #[derive(serde::Deserialize)]
    struct Name {
        uri: Option<String>,
    }
    let bytes = source.bytes;
    // The first chunk of a GLB file is its JSON.
    let json = match bytes.get(12..16).filter(|_| bytes.starts_with(b"glTF")).and_then(|size| size.try_into().ok()) {
        Some(size) => {
            bytes.get(20..).and_then(|rest| rest.get(..u32::from_le_bytes(size) as usize)).unwrap_or_default()
        }
        None => bytes,
    };
    let names = serde_json::from_slice(json).unwrap_or(Names { images: vec![] });
    let uris = names.images.into_iter().filter_map(|image| image.uri).filter(|uri| !buffers::has_scheme(uri));
    uris.filter_map(|uri| {
        let name = buffers::decode_percent(&uri).unwrap_or(Cow::Borrowed(&uri));
        Beside::new(source).find("image", name.as_bytes())
    })
    .collect()
}

/// How many meshes are not in their base shape.
fn morphed_count(document: &Document) -> u64 {
    let root = document.as_json();
    let weights_of = |mesh: usize| root.meshes.get(mesh).and_then(|mesh| mesh.weights.as_deref());
    let has_targets = |mesh: usize| {
        let primitives = root.meshes.get(mesh).map_or(&[][..], |mesh| &mesh.primitives);
        primitives.iter().any(|primitive| primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty()))
    };
    // The weights of a node stand in place of those of its mesh.
    let of_nodes = root.nodes.iter().filter_map(|node| {
        let mesh = node.mesh?.value();
        Some((mesh, node.weights.as_ref().map(|weights| &weights[..]).or(weights_of(mesh))))
    });
    let of_meshes = (0..root.meshes.len()).filter(|_| root.nodes.is_empty()).map(|mesh| (mesh, weights_of(mesh)));
    let is_morphed = |weights: Option<&[f32]>| weights.unwrap_or_default().iter().any(|&weight| weight != 0.0);
    of_nodes.chain(of_meshes).filter(|&(mesh, weights)| is_morphed(weights) && has_targets(mesh)).count() as u64
}

struct SceneReader<'a> {
    source: &'a Source<'a>,
    buffers: &'a Buffers<'a>,
    attributes: SceneAttributes,
    sink: &'a mut MeshSink,
    skipped_primitive_count: u64,
}

impl SceneReader<'_> {
    /// Walks the default scene; without one, the first scene; without any scene, all root nodes; without nodes, the
    /// meshes as they are.
    fn read_nodes(&mut self, document: &Document) -> Parsed<()> {
        if document.nodes().len() == 0 {
            return document.meshes().try_for_each(|mesh| self.read_mesh(&mesh, DMat4::IDENTITY));
        }
        let node_count = document.nodes().len();
        let mut is_child = vec![false; node_count];
        document
            .nodes()
            .flat_map(|n| n.children().map(|c| c.index()).collect::<Vec<_>>())
            .for_each(|i| is_child[i] = true);
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let roots: Vec<Node> = match scene {
            Some(scene) => scene.nodes().collect(),
            None => document.nodes().filter(|n| !is_child[n.index()]).collect(),
        };
        self.source.note_skipped(
            (document.scenes().len() as u64).saturating_sub(1),
            "other scenes were left out: only the default one is read",
        );
        // A list instead of recursion, and each node once: a damaged file can neither overflow the stack nor loop
        // forever.
        let mut seen = vec![false; node_count];
        let mut open: Vec<(Node, DMat4)> = roots.into_iter().rev().map(|n| (n, DMat4::IDENTITY)).collect();
        while let Some((node, world_from_parent)) = open.pop() {
            let index = node.index();
            if std::mem::replace(&mut seen[index], true) {
                let problem = "is reached twice, but nodes must form a tree; export the file again";
                return Err(self.source.syntax(Location::Item("node", index as u64), problem));
            }
            let world_from_node = world_from_parent * parent_from_node(&node);
            if !world_from_node.is_finite() {
                let problem = "has a transform that is not finite; export the file again";
                return Err(self.source.syntax(Location::Item("node", index as u64), problem));
            }
            if let Some(mesh) = node.mesh() {
                self.read_mesh(&mesh, world_from_node)?;
            }
            let children: Vec<_> = node.children().map(|child| (child, world_from_node)).collect();
            open.extend(children.into_iter().rev());
        }
        Ok(())
    }

    fn read_mesh(&mut self, mesh: &::gltf::Mesh, world_from_mesh: DMat4) -> Parsed<()> {
        for (number, primitive) in mesh.primitives().enumerate() {
            if is_surface(&primitive) {
                let location = Location::Item("mesh", mesh.index() as u64);
                self.read_primitive(&primitive, number, location, world_from_mesh)?;
            } else {
                self.skipped_primitive_count += 1;
            }
        }
        Ok(())
    }

    fn read_primitive(
        &mut self,
        primitive: &Primitive,
        number: usize,
        location: Location,
        world_from_mesh: DMat4,
    ) -> Parsed<()> {
        let Some(accessor) = primitive.get(&::gltf::Semantic::Positions) else {
            let problem = format!("primitive {number} has no positions; export the file again");
            return Err(self.source.syntax(location, problem));
        };
        for (semantic, _) in primitive.attributes() {
            match semantic {
                ::gltf::Semantic::TexCoords(set) if !self.attributes.reads_uv(set) => {
                    self.sink.leave_out("texture coordinates");
                }
                ::gltf::Semantic::Colors(set) if set > 0 || !self.attributes.reads_colour() => {
                    self.sink.leave_out("colours");
                }
                _ => {}
            }
        }
        if primitive.material().index().is_some() && !self.sink.attributes.wants_colour() {
            self.sink.leave_out("materials");
        }
        let positions = read_positions(self.source, self.buffers, &accessor)?;
        // A mirrored instance turns its triangles inside out; a renderer would turn them back (glTF 2.0, section
        // 3.7.4).
        let mirrored = world_from_mesh.determinant() < 0.0;
        let shape = Shape { mode: primitive.mode(), number, location, vertex_count: positions.len() as u64, mirrored };
        super::check_size(self.source.path, self.sink.vertex_count() + shape.vertex_count, 0)?;
        let first = self.sink.vertex_count() as u32;
        self.sink.reserve(positions.len(), 0)?;
        let identity = world_from_mesh == DMat4::IDENTITY;
        let mut records = self.attributes.of_primitive(self.source, self.buffers, primitive, world_from_mesh);
        for (vertex, position) in positions.enumerate() {
            if !position.is_finite() {
                return Err(self.source.coordinate(location_of(&accessor), vertex as u64, position));
            }
            let moved = if identity { position } else { world_from_mesh.transform_point3(position) };
            if !moved.is_finite() {
                return Err(self.source.coordinate(location, vertex as u64, moved));
            }
            if let Some(records) = &mut records {
                self.sink.attributes.push_vertex(records.next());
            }
            self.sink.push_vertex(moved)?;
        }
        if let Some(records) = records {
            self.attributes.clamped_count += records.clamped_count;
        }
        self.sink.set_material(self.attributes.material_of(primitive));
        match primitive.indices() {
            Some(accessor) => {
                let indices = read_indices(self.source, self.buffers, &accessor)?;
                self.push_triangles(indices, first, &shape)
            }
            None => self.push_triangles((0..shape.vertex_count as usize).map(|i| i as u32), first, &shape),
        }
    }

    fn push_triangles(&mut self, indices: impl ExactSizeIterator<Item = u32>, first: u32, shape: &Shape) -> Parsed<()> {
        let &Shape { mode, number, location, vertex_count, mirrored } = shape;
        let count = indices.len();
        if mode == Mode::Triangles && !count.is_multiple_of(3) {
            let problem = format!(
                "primitive {number} has {count} indices, which is not a multiple of three; export the file again"
            );
            return Err(self.source.syntax(location, problem));
        }
        let more = if mode == Mode::Triangles { count / 3 } else { count.saturating_sub(2) };
        super::check_size(self.source.path, 0, self.sink.triangle_count() + more as u64)?;
        self.sink.reserve(0, more)?;
        let (mut a, mut b) = (0, 0);
        // Which corner it is: the first or second of a triangle, or its last.
        let mut corner = 0;
        for (at, c) in indices.enumerate() {
            if u64::from(c) >= vertex_count {
                let face = if mode == Mode::Triangles { at / 3 } else { at.saturating_sub(2) } as u64;
                let (path, index) = (self.source.path.to_owned(), i64::from(c));
                return Err(ImportError::Index { path, location, face, index, vertex_count, first_vertex: 0 }.into());
            }
            let c = first + c;
            match corner {
                0 => (a, corner) = (c, 1),
                1 => (b, corner) = (c, 2),
                _ => {
                    // Every second triangle of a strip is wound the other way. Repeated vertices only join strips.
                    let strip = mode == Mode::TriangleStrip;
                    if !strip || (a != b && b != c && c != a) {
                        let mut triangle = if strip && !at.is_multiple_of(2) { [b, a, c] } else { [a, b, c] };
                        if mirrored {
                            triangle.swap(1, 2);
                        }
                        self.sink.push_triangle(triangle)?;
                    }
                    match mode {
                        Mode::TriangleStrip => (a, b) = (b, c),
                        Mode::TriangleFan => b = c,
                        _ => corner = 0,
                    }
                }
            }
        }
        Ok(())
    }
}

/// How the indices of a primitive form triangles, and how messages name it.
struct Shape {
    mode: Mode,
    number: usize,
    location: Location,
    vertex_count: u64,
    mirrored: bool,
}

/// A node's own transform, composed in f64 so that far translations keep their precision.
fn parent_from_node(node: &Node) -> DMat4 {
    match node.transform() {
        Transform::Matrix { matrix } => {
            DMat4::from_cols_array_2d(&matrix.map(|column| Vec4::from_array(column).as_dvec4().to_array()))
        }
        Transform::Decomposed { translation, rotation, scale } => {
            let rotation = DQuat::from_array(rotation.map(f64::from));
            // In f32 the norm is only near 1.
            let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
            let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
            DMat4::from_scale_rotation_translation(vector(scale), rotation, vector(translation))
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
#[cfg(test)]
mod texture_tests;
