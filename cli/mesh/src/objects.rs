//! Objects in files of meshes: nodes of GLB with their names, ids and tree, and groups of OBJ.

use std::io::{self, BufWriter, Write};
use std::ops::Range;

use lodpack::Mesh;
use lodpack::decode::TexturedMesh;
use serde_json::{Value, json};

use super::encoded::{Formats, Written};
use super::glb::Scene;
use super::layers::Look;
use super::pages::PagedMesh;
use super::upright::Upright;

/// An object, or an assembly above some.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectPart {
    /// Its name, if it has one.
    pub name: Option<String>,
    /// What other programs know it by, if anything.
    pub id: Option<String>,
    /// The part that it lies in, which comes before it.
    pub parent: Option<usize>,
    /// Its triangles in the mesh of all parts.
    pub triangles: Range<usize>,
}

/// How objects are written as GLB.
#[derive(Clone, Copy, Debug)]
pub struct GlbForm {
    /// Of images.
    pub formats: Formats,
    /// What is up.
    pub upright: Upright,
    /// Most texels along a side of an image.
    pub page_size: u32,
    /// Whether normals are computed.
    pub is_smooth: bool,
}

/// Some triangles of a mesh, by number and in this order, with their vertices alone.
pub fn picked(mesh: &Mesh, triangles: impl IntoIterator<Item = usize>) -> Mesh {
    let mut places = std::collections::HashMap::new();
    let mut own = Mesh::default();
    for number in triangles {
        let corners = mesh.triangles[number].map(|vertex| {
            *places.entry(vertex).or_insert_with(|| {
                own.positions.push(mesh.positions[vertex as usize]);
                own.positions.len() as u32 - 1
            })
        });
        own.triangles.push(corners);
        own.triangle_nodes.push(mesh.triangle_nodes[number]);
    }
    own
}

/// Gives a part the textures of its own nodes: all of them would be copied for each of thousands of parts.
fn with_own_textures(mut part: TexturedMesh, whole: &TexturedMesh) -> TexturedMesh {
    let mut numbers = std::collections::HashMap::new();
    for node in &mut part.mesh.triangle_nodes {
        let next = part.textures.len() as u32;
        *node = *numbers.entry(*node).or_insert_with(|| {
            part.textures.push(whole.textures.get(*node as usize).cloned().unwrap_or_default());
            next
        });
    }
    part
}

/// Writes GLB with a node for each part, of which those without a parent turn what is below them; what a part looks
/// like comes from `textured`. Returns which images were written.
///
/// # Errors
/// Any error of the writer; [`io::ErrorKind::InvalidInput`] beyond 4 GiB.
pub fn write_objects_glb(
    out: impl Write,
    mesh: &Mesh,
    textured: Option<(&TexturedMesh, &Look)>,
    parts: &[ObjectPart],
    form: GlbForm,
) -> io::Result<Written> {
    let mut scene = Scene::default();
    let centre = super::export::glb_origin(&mesh.positions);
    let (mut nodes, mut children, mut tops) = (vec![], vec![vec![]; parts.len()], vec![]);
    let mut mesh_count = 0;
    for (number, part) in parts.iter().enumerate() {
        let mut node = json!({});
        part.name.iter().for_each(|name| node["name"] = name.as_str().into());
        part.id.iter().for_each(|id| node["extras"] = json!({"id": id}));
        if !part.triangles.is_empty() {
            let own = picked(mesh, part.triangles.clone());
            let paged = match textured {
                Some((whole, look)) => {
                    let places = whole.places.get(part.triangles.clone()).unwrap_or_default().to_vec();
                    let textured = with_own_textures(TexturedMesh { mesh: own, places, textures: vec![] }, whole);
                    let paged = PagedMesh::new(&textured, look, form.page_size);
                    if form.is_smooth { paged.smooth(&textured.mesh)? } else { paged }
                }
                None if form.is_smooth => PagedMesh::bare(&own)?,
                None => PagedMesh::without_normals(own),
            };
            scene.add(&paged, centre, form.formats)?;
            node["mesh"] = mesh_count.into();
            mesh_count += 1;
        }
        match part.parent.and_then(|parent| children.get_mut(parent)) {
            Some(beside) => beside.push(number),
            None => {
                tops.push(number);
                if let Value::Object(turned) = form.upright.node(0, centre) {
                    turned.into_iter().filter(|(key, _)| key != "mesh").for_each(|(key, value)| node[key] = value);
                }
            }
        }
        nodes.push(node);
    }
    for (node, below) in nodes.iter_mut().zip(children).filter(|(_, below)| !below.is_empty()) {
        node["children"] = Value::from(below);
    }
    scene.write(out, &nodes, &tops, None)
}

/// Writes OBJ with an object for each part that has triangles, by its name, its id or its number.
///
/// # Errors
/// Any error of the writer.
pub fn write_objects_obj(out: impl Write, mesh: &Mesh, parts: &[ObjectPart]) -> io::Result<()> {
    let mut out = BufWriter::new(out);
    for [x, y, z] in &mesh.positions {
        writeln!(out, "v {x} {y} {z}")?;
    }
    for (number, part) in parts.iter().enumerate().filter(|(_, part)| !part.triangles.is_empty()) {
        let text = part.name.as_ref().or(part.id.as_ref()).filter(|text| !text.trim().is_empty());
        let name: String = text.map_or(format!("#{number}"), |text| text.replace(char::is_control, " "));
        writeln!(out, "o {name}")?;
        for triangle in mesh.triangles.get(part.triangles.clone()).unwrap_or_default() {
            let [a, b, c] = triangle.map(|vertex| u64::from(vertex) + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
    }
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts() -> (Mesh, Vec<ObjectPart>) {
        let mesh = Mesh {
            positions: vec![
                [0.0; 3],
                [1.0, 0.0, 0.0],
                [0.0, 1.0, 0.0],
                [5.0, 0.0, 0.0],
                [6.0, 0.0, 0.0],
                [5.0, 1.0, 0.0],
            ],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            triangle_nodes: vec![0, 0],
        };
        let part = |name: Option<&str>, id: Option<&str>, parent, triangles| ObjectPart {
            name: name.map(Into::into),
            id: id.map(Into::into),
            parent,
            triangles,
        };
        let parts = vec![
            part(Some("HALL"), None, None, 0..0),
            part(Some("PIPE \"1\""), Some("x-1"), Some(0), 0..1),
            part(None, None, Some(1), 1..2),
        ];
        (mesh, parts)
    }

    #[test]
    fn nodes_of_glb_are_the_tree_of_parts() {
        let (mesh, parts) = parts();
        let form = GlbForm { formats: Formats::PNG, upright: Upright::default(), page_size: 1024, is_smooth: true };
        let mut bytes = vec![];
        write_objects_glb(&mut bytes, &mesh, None, &parts, form).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        assert_eq!(document["scenes"], json!([{"nodes": [0]}]));
        let hall = &document["nodes"][0];
        assert_eq!((&hall["name"], &hall["children"]), (&"HALL".into(), &json!([1])));
        assert_eq!(hall["translation"].as_array().map(Vec::len), Some(3));
        let pipe = json!({"name": "PIPE \"1\"", "extras": {"id": "x-1"}, "mesh": 0, "children": [2]});
        assert_eq!(document["nodes"][1], pipe);
        assert_eq!(document["nodes"][2], json!({"mesh": 1}));
        assert_eq!(document["meshes"].as_array().unwrap().len(), 2);
    }

    #[test]
    fn objects_of_obj_have_names_on_one_line() {
        let (mesh, mut parts) = parts();
        parts[1].name = Some("a\nb".into());
        let mut bytes = vec![];
        write_objects_obj(&mut bytes, &mesh, &parts).unwrap();
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.ends_with("o a b\nf 1 2 3\no #2\nf 4 5 6\n"), "{text}");
    }
}
