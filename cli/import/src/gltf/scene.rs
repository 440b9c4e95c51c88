//! The scene graph: which meshes are drawn, and where, in f64 from the JSON to the vertex.

use std::borrow::Cow;

use glam::{DMat4, DVec3};

use super::accessor::{Array, read_vectors};
use super::buffers::Buffers;
use super::document::Document;
use super::fields::Index;
use super::node_list::{Instances, Node, transform};
use super::nodes::roots_of_forest;
use super::primitive::PrimitiveReader;
use super::skin::Joints;
use crate::check_size;
use crate::error::{Location, Parsed};
use crate::source::Source;
use lodpack_mesh::NONE;
use lodpack_mesh::attributes::ObjectNode;

/// The number of instances of a primitive that are drawn before the next one is read.
const INSTANCES_AT_ONCE: usize = 1 << 14;

/// Walks the default scene; without one, the first scene; without any scene, all root nodes; without nodes, the meshes
/// as they are.
pub(super) fn read_scene<'a>(
    source: &Source,
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    reader: &mut PrimitiveReader<'a>,
) -> Parsed<()> {
    let world_from_scene = world_from_scene(source, document);
    if document.nodes.is_empty() {
        return (0..document.meshes.len()).try_for_each(|mesh| reader.read_mesh(mesh, &[world_from_scene], None));
    }
    let roots = scene_roots(source, document)?;
    let uses_skins = document.nodes.iter().any(|node| node.skin().is_some() && node.mesh.is_some());
    let joints = uses_skins.then(|| Joints::new(document, buffers));
    let (mut hidden_count, mut named_count) = (0, 0);
    // A list instead of recursion, and each node once: a damaged file can neither overflow the stack nor loop forever.
    let mut seen = vec![false; document.nodes.len()];
    let mut open: Vec<(std::slice::Iter<Index>, DMat4, Option<u32>)> = vec![(roots.iter(), world_from_scene, None)];
    while let Some((siblings, world_from_parent, parent)) = open.last_mut() {
        let (world_from_parent, parent) = (*world_from_parent, *parent);
        let Some(number) = siblings.next().map(|&number| usize::from(number)) else {
            open.pop();
            continue;
        };
        let location = Location::Item("node", number as u64);
        let Some(node) = document.nodes.get(number) else {
            let problem = format!("is named, but there are {}; export the file again", document.nodes.len());
            return Err(source.syntax(location, problem));
        };
        if std::mem::replace(&mut seen[number], true) {
            let problem = "is reached twice, but nodes must form a tree; export the file again";
            return Err(source.syntax(location, problem));
        }
        let world_from_node = world_from_parent * node.parent_from_node();
        if !world_from_node.is_finite() {
            return Err(source.syntax(location, "has a transform that is not finite; export the file again"));
        }
        if !node.is_visible() {
            hidden_count += 1;
            continue;
        }
        let object = reader.sink.wants_objects().then(|| reader.sink.add_node(named(&node, parent)));
        if let Some(mesh) = node.mesh.map(usize::from) {
            if mesh >= document.meshes.len() {
                let problem =
                    format!("uses mesh {mesh}, but there are {}; export the file again", document.meshes.len());
                return Err(source.syntax(location, problem));
            }
            named_count += u64::from(node.name.is_some());
            reader.sink.set_object(object.unwrap_or(NONE));
            match (node.instances(), node.skin(), &joints) {
                (_, Some(skin), Some(joints)) => {
                    let matrices = joints.matrices(source, skin.into())?;
                    reader.read_mesh(mesh, &[world_from_scene], Some(&matrices[..]))?;
                }
                (Some(instances), ..) => {
                    let (count, mut worlds) =
                        worlds_of_instances(source, document, buffers, location, instances, world_from_node)?;
                    let [vertices, triangles] = reader.size_of_mesh(mesh).map(|size| size.saturating_mul(count));
                    check_size(source.path, vertices, triangles)?;
                    loop {
                        let some: Vec<DMat4> = worlds.by_ref().take(INSTANCES_AT_ONCE).collect::<Parsed<_>>()?;
                        if some.is_empty() {
                            break;
                        }
                        reader.read_mesh(mesh, &some, None)?;
                    }
                }
                _ => reader.read_mesh(mesh, &[world_from_node], None)?,
            }
        }
        if !node.children.is_empty() {
            open.push((node.children.iter(), world_from_node, object));
        }
    }
    source.note_skipped(hidden_count, "nodes are not visible, and were left out with all below them");
    // A single name is that of the model.
    if named_count > 1 && !reader.sink.wants_objects() {
        reader.sink.leave_out("names of nodes");
    }
    Ok(())
}

/// What a node names.
fn named(node: &Node, parent: Option<u32>) -> ObjectNode {
    let [name, id] = [node.name, node.id].map(|text| text.map(str::to_owned));
    ObjectNode { name, id, parent }
}

/// Where the scene is: elsewhere only with `CESIUM_RTC`, whose centre has z up, as tiles have it. What has y up in glTF
/// is turned before it is moved there, so that the centre is turned back here.
fn world_from_scene(source: &Source, document: &Document) -> DMat4 {
    let Some(relative) = document.extensions.as_ref().and_then(|extensions| extensions.relative_to_centre.as_ref())
    else {
        return DMat4::IDENTITY;
    };
    let [x, y, z] = relative.center;
    source.note(&format!("it is relative to the centre {x} {y} {z} (CESIUM_RTC, z up), which was added"));
    DMat4::from_translation(DVec3::new(x, z, -y))
}

/// The root nodes of the scene that is read.
fn scene_roots<'a>(source: &Source, document: &'a Document) -> Parsed<Cow<'a, [Index]>> {
    let other_count = (document.scenes.len() as u64).saturating_sub(1);
    source.note_skipped(other_count, "other scenes were left out: only the default one is read");
    let scene = document.scene.map_or(0, usize::from);
    match document.scenes.get(scene) {
        Some(scene) => Ok(Cow::Borrowed(&scene.nodes)),
        None if scene > 0 => {
            let problem = format!("is the default one, but there are {}; export the file again", document.scenes.len());
            Err(source.syntax(Location::Item("scene", scene as u64), problem))
        }
        None => Ok(Cow::Owned(roots_of_forest(document))),
    }
}

/// How many instances a node has, and where they are (`EXT_mesh_gpu_instancing`).
fn worlds_of_instances<'a>(
    source: &'a Source,
    document: &'a Document,
    buffers: &'a Buffers<'a>,
    location: Location,
    instances: &'a Instances,
    world_from_node: DMat4,
) -> Parsed<(u64, impl Iterator<Item = Parsed<DMat4>> + use<'a>)> {
    let array = |(name, &accessor): (&String, &Index)| {
        let array = Array::find(document, buffers, accessor.into());
        let problem = format!(
            "has instances with accessor {} for {name}, which is not there; export the file again",
            usize::from(accessor)
        );
        array.ok_or_else(|| source.syntax(location, problem))
    };
    let named = |name: &str| instances.attributes.get_key_value(name).map(array).transpose();
    let counts = instances.attributes.iter().map(|attribute| Ok(array(attribute)?.count()));
    let counts = counts.collect::<Parsed<Vec<usize>>>()?;
    let count = counts.first().copied().unwrap_or(0);
    if counts.iter().any(|&other| other != count) {
        return Err(
            source.syntax(location, "has instances of which attributes have different counts; export the file again")
        );
    }
    let translations = named("TRANSLATION")?.map(|array| read_vectors::<3>(source, &array)).transpose()?;
    let rotations = named("ROTATION")?.map(|array| read_vectors::<4>(source, &array)).transpose()?;
    let scales = named("SCALE")?.map(|array| read_vectors::<3>(source, &array)).transpose()?;
    // Those of custom attributes alone are all at the same place.
    let is_placed = translations.is_some() || rotations.is_some() || scales.is_some();
    let count = if is_placed { count } else { count.min(1) };
    let (mut translations, mut rotations, mut scales) =
        (translations.into_iter().flatten(), rotations.into_iter().flatten(), scales.into_iter().flatten());
    let world = move |number: usize| {
        let world = world_from_node
            * transform(
                translations.next().unwrap_or([0.0; 3]),
                rotations.next().unwrap_or([0.0, 0.0, 0.0, 1.0]),
                scales.next().unwrap_or([1.0; 3]),
            );
        if !world.is_finite() {
            return Err(source.syntax(
                location,
                format!("has instance {number}, which is not at a finite place; export the file again"),
            ));
        }
        Ok(world)
    };
    Ok((count as u64, (0..count).map(world)))
}
