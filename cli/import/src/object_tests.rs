//! What inputs name, out of each format and out of several files.

use std::path::PathBuf;

use serde_json::{Value, json};

use super::gltf::tests::glb;
use super::*;
use lodpack_mesh::attributes::Attributes;
use lodpack_runtime::storage::WorkDirectory;

/// Reads files of a folder, in memory and through temporary files, which have to give the same.
fn read(files: &[(&str, Vec<u8>)], objects: Objects) -> (Attributes, usize) {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| folder.path().join(name)).collect();
    files.iter().zip(&paths).for_each(|((_, bytes), path)| std::fs::write(path, bytes).unwrap());
    let options = ImportOptions { objects, ..ImportOptions::shape() };
    let directory = WorkDirectory::create(&folder.path().join("work")).unwrap();
    let room = Room { memory: u64::MAX, overflow: Overflow::Into(directory) };
    let Ok(Imported::Spilled(mesh)) = import_large_meshes(&paths, &room, &options, &Silent) else {
        panic!("all is in files")
    };
    let Ok(Imported::Memory(surface)) = import_large_meshes(&paths, &Room::memory_alone(), &options, &Silent) else {
        panic!("there is enough memory")
    };
    assert_eq!(mesh.attributes, surface.attributes);
    (surface.attributes, surface.mesh.triangles.len())
}

/// The objects of all triangles: paths of names, with ids, "-" for what has no name.
fn paths(files: &[(&str, Vec<u8>)], objects: Objects) -> Vec<String> {
    let (attributes, triangles) = read(files, objects);
    let path = |triangle: usize| {
        let (mut path, mut node) = (vec![], Some(attributes.object(triangle as u32)));
        while let Some(of) = node.map(|node| &attributes.nodes[node as usize]) {
            let id = of.id.as_ref().map_or(String::new(), |id| format!("={id}"));
            path.push(format!("{}{id}", of.name.as_deref().unwrap_or("-")));
            node = of.parent;
        }
        path.reverse();
        path.join("/")
    };
    if attributes.nodes.is_empty() { vec![] } else { (0..triangles).map(path).collect() }
}

fn obj(statements: &str) -> Vec<u8> {
    format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n{statements}").into_bytes()
}

/// A document whose nodes show one triangle where they have mesh 0.
fn gltf(nodes: Value, roots: Value) -> Vec<u8> {
    let positions = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let binary: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    let document = json!({
        "asset": {"version": "2.0"}, "scenes": [{"nodes": roots}], "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}, {"primitives": []}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"byteLength": 36}]
    });
    glb(&document, &binary)
}

#[test]
fn nodes_with_meshes_are_objects_in_assemblies() {
    let nodes = json!([
        {"name": "hall", "children": [1, 2, 3], "extras": {"GLOBALID": "h"}},
        {"name": "valve", "mesh": 0, "extras": {"id": 7}, "children": [4]},
        {"children": [5], "extras": 3},
        {"name": "nothing below", "children": [6]},
        {"name": "valve", "mesh": 0},
        {"mesh": 0, "name": "", "extras": {"guid": "x", "id": []}},
        {"name": "empty", "mesh": 1},
    ]);
    let file = gltf(nodes, json!([0]));
    let expected = ["hall=h/valve=7", "hall=h/valve=7/valve", "hall=h/-/-=x"];
    assert_eq!(paths(&[("a.glb", file.clone())], Objects::Auto), expected);
    let (attributes, _) = read(&[("a.glb", file.clone())], Objects::Keep);
    assert_eq!((attributes.node_counts(), attributes.nodes.len()), ([3, 2], 5));
    assert_eq!(read(&[("a.glb", file)], Objects::Join).0, Attributes::default());
    // One alone has its name only if it is asked for.
    let one = gltf(json!([{"name": "one", "mesh": 0}]), json!([0]));
    assert_eq!(paths(&[("a.glb", one.clone())], Objects::Auto), [""; 0]);
    assert_eq!(paths(&[("a.glb", one)], Objects::Keep), ["one"]);
}

#[test]
fn deep_trees_have_as_many_assemblies_as_files_hold() {
    let node = |number: usize| match number {
        20_000 => json!({"mesh": 0}),
        _ => json!({"children": [number + 1], "name": number.to_string()}),
    };
    let mut nodes: Vec<Value> = (0..=20_000).map(node).collect();
    nodes.push(json!({"mesh": 0, "name": "beside"}));
    let (attributes, _) = read(&[("deep.glb", gltf(nodes.into(), json!([0, 20_001])))], Objects::Auto);
    assert_eq!(attributes.node_counts(), [2, 4000]);
    assert!(attributes.nodes.iter().zip(0..).all(|(node, number)| node.parent.is_none_or(|parent| parent < number)));
}

#[test]
fn objects_and_groups_name_faces_wherever_they_come_again() {
    let text = "f 1 2 3\ng a b # c\nf 1 2 3 4\no  one \nf 1 2 3\ng left\nf 1 3 4\ng\nf 1 2 4\no\nf 1 2 3\no\nf 2 3 4\no one\n\
                f 1 2 3\ng left\nf 1 2 3\ng empty\n";
    let expected = ["-", "a b # c", "a b # c", "one", "one/left", "one", "-", "-", "one", "one/left"];
    assert_eq!(paths(&[("a.obj", obj(text))], Objects::Auto), expected);
    let (attributes, _) = read(&[("a.obj", obj(text))], Objects::Auto);
    assert_eq!(attributes.node_counts(), [6, 0]);
    assert_ne!(attributes.object(6), attributes.object(7), "what has no name is not the same");
    assert_eq!(paths(&[("a.obj", obj("g\nf 1 2 3\ng default\ng\nf 1 2 3\n"))], Objects::Keep), [""; 0]);
    let odd = [&obj("o caf")[..], b"\xe9\nf 1 2 3\no \xc3\xa9\nf 1 2 3\n"].concat();
    assert_eq!(paths(&[("a.obj", odd)], Objects::Auto), ["caf\u{fffd}", "\u{e9}"]);
}

#[test]
fn polygons_before_their_vertices_keep_their_objects() {
    // Quads that precede a vertex come behind all others.
    let text = "o\nf 1 2 3\no late\nf 1 2 3 5\ng part\nf 1 2 5 4\no\nf 2 3 4\no\nf 1 2 3 5\nf 1 2 3\nv 0 2 0\no late\nf 1 2 3\n";
    let expected = ["-", "-", "-", "late", "late", "late", "late/part", "late/part", "-", "-"];
    assert_eq!(paths(&[("a.obj", obj(text))], Objects::Auto), expected);
    let (attributes, _) = read(&[("a.obj", obj(text))], Objects::Auto);
    let objects: Vec<u32> = (0..10).map(|triangle| attributes.object(triangle)).collect();
    assert!(objects[2] == objects[8] && objects[1] != objects[2] && objects[0] != objects[1], "{objects:?}");
}

#[test]
fn each_of_several_files_is_an_assembly_or_an_object() {
    let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let named = gltf(json!([{"name": "one", "mesh": 0}]), json!([0]));
    let files = [
        ("b.obj", obj("f 1 2 3\no x\nf 1 2 3\n")),
        ("a.ply", ply.to_vec()),
        ("c.glb", named),
        ("d.obj", obj("f 1 2 3 4\n")),
    ];
    let expected = ["b.obj/-", "b.obj/x", "a.ply", "c.glb/one", "d.obj", "d.obj"];
    assert_eq!(paths(&files, Objects::Auto), expected);
    assert_eq!(paths(&files[1..2], Objects::Keep), [""; 0]);
}
