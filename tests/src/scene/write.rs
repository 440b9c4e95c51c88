//! Writes scenes as GLB and OBJ.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use glam::{DAffine3, DVec3};
use serde_json::{Map, Value, json};

use super::{COLOURS, Node, Scene, Shape};

/// What nodes of a GLB have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sharing {
    /// Nodes with one shape have one mesh, and transforms.
    Meshes,
    /// Nothing, as many exporters do it: each node has a mesh of its own in the space of the world.
    Nothing,
}

/// Writes a GLB whose y axis points up, as the format wants it. Ids become `extras.id`.
///
/// # Errors
/// If the file cannot be written, or would have 4 GiB or more.
pub fn write_glb(scene: &Scene, sharing: Sharing, path: &Path) -> io::Result<()> {
    let worlds = scene.in_world();
    let mut meshes = Meshes::default();
    let shared = match sharing {
        Sharing::Meshes => scene.shapes.iter().map(|shape| meshes.add(shape, DAffine3::IDENTITY)).collect(),
        Sharing::Nothing => vec![],
    };
    let mut children: Vec<Vec<usize>> = vec![vec![]; scene.nodes.len()];
    for (number, node) in scene.nodes.iter().enumerate() {
        node.parent.into_iter().for_each(|parent| children[parent as usize].push(number));
    }
    let nodes = scene.nodes.iter().enumerate().map(|(number, node)| {
        let mut json = described(node);
        let shape = node.shape.map(|shape| shape as usize);
        let mesh = match sharing {
            Sharing::Meshes => shape.map(|shape| shared[shape]),
            Sharing::Nothing => shape.map(|shape| meshes.add(&scene.shapes[shape], worlds[number])),
        };
        mesh.into_iter().for_each(|mesh| drop(json.insert("mesh".into(), mesh.into())));
        if sharing == Sharing::Meshes {
            add_transform(&mut json, node);
        }
        if !children[number].is_empty() {
            json.insert("children".into(), children[number].clone().into());
        }
        Value::Object(json)
    });
    let mut nodes: Vec<Value> = nodes.collect();
    let roots: Vec<usize> = (0..nodes.len()).filter(|&number| scene.nodes[number].parent.is_none()).collect();
    // A quarter turn, from z up to y up.
    let turned = std::f64::consts::FRAC_1_SQRT_2;
    nodes.push(json!({ "rotation": [-turned, 0.0, 0.0, turned], "children": roots }));
    let materials = COLOURS.map(|(name, [r, g, b])| {
        json!({ "name": name, "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0 } })
    });
    let document = json!({
        "asset": { "version": "2.0", "generator": "lodpack generate" },
        "scene": 0,
        "scenes": [{ "nodes": [nodes.len() - 1] }],
        "nodes": nodes,
        "meshes": meshes.json,
        "materials": materials,
        "accessors": meshes.accessors,
        "bufferViews": meshes.views,
        "buffers": [{ "byteLength": meshes.bytes.len() }],
    });
    let mut text = serde_json::to_vec(&document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut file = BufWriter::new(File::create(path)?);
    let length =
        |length: usize| u32::try_from(length).map_err(|_| io::Error::other("more than 4 GiB")).map(u32::to_le_bytes);
    file.write_all(b"glTF\x02\0\0\0")?;
    file.write_all(&length(28 + text.len() + meshes.bytes.len())?)?;
    for (kind, chunk) in [(b"JSON", &text), (b"BIN\0", &meshes.bytes)] {
        file.write_all(&length(chunk.len())?)?;
        file.write_all(kind)?;
        file.write_all(chunk)?;
    }
    file.flush()
}

/// Name and id of a node.
fn described(node: &Node) -> Map<String, Value> {
    let mut json = Map::new();
    node.name.iter().for_each(|name| drop(json.insert("name".into(), name.as_str().into())));
    node.id.iter().for_each(|id| drop(json.insert("extras".into(), json!({ "id": id }))));
    json
}

fn add_transform(json: &mut Map<String, Value>, node: &Node) {
    let transform = node.transform;
    let parts = [
        ("translation", transform.translation.to_array().to_vec(), vec![0.0; 3]),
        ("rotation", transform.rotation.normalize().to_array().to_vec(), vec![0.0, 0.0, 0.0, 1.0]),
        ("scale", transform.scale.to_array().to_vec(), vec![1.0; 3]),
    ];
    for (name, numbers, usual) in parts {
        if numbers != usual {
            json.insert(name.into(), numbers.into());
        }
    }
}

/// Meshes of a GLB with their accessors.
#[derive(Default)]
struct Meshes {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    json: Vec<Value>,
}

impl Meshes {
    /// Adds a shape, moved, and returns the number of its mesh.
    fn add(&mut self, shape: &Shape, to: DAffine3) -> usize {
        let positions: Vec<[f32; 3]> =
            shape.positions.iter().map(|&position| to.transform_point3(position).as_vec3().to_array()).collect();
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for position in &positions {
            low = [0, 1, 2].map(|k| low[k].min(position[k]));
            high = [0, 1, 2].map(|k| high[k].max(position[k]));
        }
        let mut corners = shape.triangles.clone();
        if to.matrix3.determinant() < 0.0 {
            // What is mirrored faces outward nevertheless.
            corners.iter_mut().for_each(|corners| corners.reverse());
        }
        let numbers = positions.iter().flatten().flat_map(|x| x.to_le_bytes());
        self.view(numbers, 34962);
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": 5126, "count": positions.len(), "type": "VEC3",
            "min": low, "max": high,
        }));
        let wide = positions.len() > usize::from(u16::MAX);
        let indices = corners.iter().flatten().flat_map(|v| v.to_le_bytes().into_iter().take(if wide { 4 } else { 2 }));
        self.view(indices, 34963);
        let kind = if wide { 5125 } else { 5123 };
        self.accessors.push(json!({
            "bufferView": self.views.len() - 1, "componentType": kind, "count": 3 * corners.len(), "type": "SCALAR",
        }));
        let count = self.accessors.len();
        self.json.push(json!({ "primitives": [{
            "attributes": { "POSITION": count - 2 }, "indices": count - 1, "material": shape.colour,
        }] }));
        self.json.len() - 1
    }

    fn view(&mut self, bytes: impl Iterator<Item = u8>, target: u32) {
        let offset = self.bytes.len();
        self.bytes.extend(bytes);
        let length = self.bytes.len() - offset;
        self.views.push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target }));
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
    }
}

/// Writes an OBJ, z up, with a material file beside it. Each object has an `o`; what has no name has one without.
/// Objects are named by their path: names of assemblies and their own, with slashes.
///
/// # Errors
/// If a file cannot be written.
pub fn write_obj(scene: &Scene, path: &Path) -> io::Result<()> {
    let materials = path.with_extension("mtl");
    let mut file = BufWriter::new(File::create(&materials)?);
    for (name, [r, g, b]) in COLOURS {
        writeln!(file, "newmtl {name}\nKd {r} {g} {b}")?;
    }
    file.flush()?;
    let mut file = BufWriter::new(File::create(path)?);
    writeln!(file, "mtllib {}", materials.file_name().unwrap_or_default().to_string_lossy())?;
    let mut paths: Vec<String> = Vec::with_capacity(scene.nodes.len());
    let mut first = 1;
    for (node, to) in scene.nodes.iter().zip(scene.in_world()) {
        let above = node.parent.map_or("", |parent| paths[parent as usize].as_str());
        let separator = if above.is_empty() { "" } else { "/" };
        paths.push(node.name.as_ref().map_or_else(String::new, |name| format!("{above}{separator}{name}")));
        let Some(shape) = node.shape.map(|shape| &scene.shapes[shape as usize]) else { continue };
        writeln!(file, "o {}\nusemtl {}", paths[paths.len() - 1], COLOURS[shape.colour].0)?;
        for &position in &shape.positions {
            let DVec3 { x, y, z } = to.transform_point3(position);
            writeln!(file, "v {x:.5} {y:.5} {z:.5}")?;
        }
        let is_mirrored = to.matrix3.determinant() < 0.0;
        for &[a, b, c] in &shape.triangles {
            let corners = if is_mirrored { [c, b, a] } else { [a, b, c] };
            let [a, b, c] = corners.map(|v| v + first);
            writeln!(file, "f {a} {b} {c}")?;
        }
        first += shape.positions.len() as u32;
    }
    file.flush()
}

#[cfg(test)]
mod tests {
    use super::super::{forest, plant};
    use super::*;
    use lodpack_cli::import::import_meshes;
    use lodpack_cli::progress::Silent;

    #[test]
    fn plants_are_the_same_surface_in_each_format() {
        let scene = plant(1200);
        assert_eq!((scene.object_count(), plant(1200) == scene), (1200, true));
        let own = scene.shapes.len() - 2012;
        assert!((12..60).contains(&own), "{own}");
        let folder = std::env::temp_dir().join(format!("lodpack-plant-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let [shared, baked, obj] = ["shared.glb", "baked.glb", "plant.obj"].map(|name| folder.join(name));
        write_glb(&scene, Sharing::Meshes, &shared).unwrap();
        write_glb(&scene, Sharing::Nothing, &baked).unwrap();
        write_obj(&scene, &obj).unwrap();
        let volumes = [&shared, &baked, &obj].map(|path| {
            let mesh = import_meshes(std::slice::from_ref(path), &Silent).unwrap();
            assert_eq!(mesh.triangles.len() as u64, scene.triangle_count());
            let corners = mesh.triangles.iter().map(|corners| corners.map(|v| mesh.positions[v as usize]));
            corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum::<f64>()
        });
        std::fs::remove_dir_all(folder).unwrap();
        assert!(volumes.iter().all(|volume| (volume / volumes[0] - 1.0).abs() < 1e-4 && *volume > 0.0), "{volumes:?}");
    }

    #[test]
    fn trees_of_a_forest_share_shapes() {
        let scene = forest(15);
        let triangles = scene.triangle_count() / 15;
        assert_eq!((scene.object_count(), scene.shapes.len()), (30, 24));
        assert!((90_000..110_000).contains(&triangles), "{triangles}");
    }
}
