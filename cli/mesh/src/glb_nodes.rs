//! Several models in one GLB, each with a node of its own: what our writers write, joined.

use std::io::{self, ErrorKind, Write};

use serde_json::{Value, json};

/// Lists of a document whose places other parts of it name.
const LISTS: [&str; 10] = [
    "nodes",
    "meshes",
    "accessors",
    "bufferViews",
    "materials",
    "textures",
    "images",
    "samplers",
    "extensionsUsed",
    "extensionsRequired",
];
/// Under these names stand places in a list; the names of attributes are all that also stand for one.
const PLACES: [(&str, usize); 6] =
    [("mesh", 1), ("indices", 2), ("bufferView", 3), ("material", 4), ("index", 5), ("source", 6)];

/// Writes GLB files as one whose scene shows the nodes of all their scenes, with these names.
///
/// # Errors
/// Any error of the writer; [`ErrorKind::InvalidData`] if one of them is no GLB with one buffer,
/// [`ErrorKind::InvalidInput`] beyond 4 GiB.
pub fn write_joined_glb(out: impl Write, models: &[(&str, Vec<u8>)]) -> io::Result<()> {
    let mut joined = json!({"asset": {"version": "2.0", "generator": "lodpack"}, "scene": 0});
    let (mut shown, mut binary) = (Vec::<Value>::new(), Vec::new());
    for (name, bytes) in models {
        let (mut document, chunk) = chunks(bytes)?;
        let counts = LISTS.map(|list| joined[list].as_array().map_or(0, Vec::len));
        for view in document["bufferViews"].as_array_mut().into_iter().flatten() {
            view["byteOffset"] = (view["byteOffset"].as_u64().unwrap_or(0) + binary.len() as u64).into();
        }
        let nodes = document["scenes"][0]["nodes"].as_array().cloned().unwrap_or_default();
        for node in nodes.iter().filter_map(Value::as_u64) {
            document["nodes"][node as usize]["name"] = (*name).into();
            shown.push((node + counts[0] as u64).into());
        }
        for (&list, &count) in LISTS.iter().zip(&counts) {
            let Some(Value::Array(mut items)) = document.get_mut(list).map(Value::take) else { continue };
            items.iter_mut().for_each(|item| move_places(item, &counts));
            if joined[list].is_null() {
                joined[list] = json!([]);
            }
            let Some(all) = joined[list].as_array_mut() else { continue };
            // Names of extensions stand there once.
            items.retain(|item| !list.starts_with("extensions") || !all[..count].contains(item));
            all.extend(items);
        }
        binary.extend_from_slice(chunk);
        binary.resize(binary.len().next_multiple_of(4), 0);
    }
    joined["scenes"] = json!([{ "nodes": shown }]);
    joined["buffers"] = json!([{ "byteLength": binary.len() }]);
    // A list that no model has is not written.
    if let Some(object) = joined.as_object_mut() {
        object.retain(|_, value| !value.is_null());
    }
    super::export::write_glb_chunks(out, &joined, &binary)
}

/// The document of a GLB, and the bytes of its buffer.
fn chunks(bytes: &[u8]) -> io::Result<(Value, &[u8])> {
    let wrong = || io::Error::new(ErrorKind::InvalidData, "this is no GLB with one buffer");
    let word = |at: usize| bytes.get(at..at + 4)?.first_chunk().map(|word| u32::from_le_bytes(*word) as usize);
    let length = word(12).ok_or_else(wrong)?;
    let text = bytes.get(20..).and_then(|rest| rest.get(..length)).ok_or_else(wrong)?;
    let document = serde_json::from_slice(text)?;
    Ok((document, bytes.get(28 + length..).unwrap_or_default()))
}

/// Adds to all places of lists that stand in a value how many items those lists had before.
fn move_places(value: &mut Value, counts: &[usize; LISTS.len()]) {
    match value {
        Value::Object(object) => {
            for (name, value) in object.iter_mut() {
                let list = match (name.as_str(), &value) {
                    ("attributes", Value::Object(_)) => {
                        let attributes = value.as_object_mut().into_iter().flat_map(|object| object.values_mut());
                        attributes.for_each(|place| move_place(place, counts[2]));
                        continue;
                    }
                    ("sampler", Value::Number(_)) => Some(7),
                    (name, Value::Number(_)) => PLACES.iter().find(|place| place.0 == name).map(|place| place.1),
                    _ => None,
                };
                match list {
                    Some(list) => move_place(value, counts[list]),
                    None => move_places(value, counts),
                }
            }
        }
        Value::Array(items) => items.iter_mut().for_each(|item| move_places(item, counts)),
        _ => {}
    }
}

fn move_place(place: &mut Value, by: usize) {
    if let Some(number) = place.as_u64() {
        *place = (number + by as u64).into();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::{MeshFormat, write_mesh};
    use crate::shaded::{Shading, write_shaded_mesh};
    use crate::upright::Upright;

    #[test]
    fn two_models_become_two_nodes_that_keep_what_is_theirs() {
        let positions = [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [10.0, 1.0, 0.0]];
        let (mut bare, mut shaded, mut both) = (vec![], vec![], vec![]);
        write_mesh(&mut bare, MeshFormat::Glb, &positions, &[[0, 1, 2]]).unwrap();
        let shading =
            Shading { normals: vec![[0.0, 0.0, 1.0]; 3], colours: Some(vec![[1, 2, 3]; 3]), ..Shading::default() };
        write_shaded_mesh(&mut shaded, MeshFormat::Glb, (&positions, &[[0, 1, 2]]), &shading, Upright::default())
            .unwrap();
        write_joined_glb(&mut both, &[("surface", bare), ("ground", shaded.clone())]).unwrap();
        let ((joined, binary), (alone, own)) = (chunks(&both).unwrap(), chunks(&shaded).unwrap());
        assert_eq!(joined["scenes"][0]["nodes"], json!([0, 1]));
        assert_eq!([&joined["nodes"][0]["name"], &joined["nodes"][1]["name"]], ["surface", "ground"]);
        let primitive = &joined["meshes"][1]["primitives"][0];
        assert_eq!((&primitive["indices"], &primitive["material"]), (&json!(5), &json!(1)));
        assert_eq!(primitive["attributes"], json!({"POSITION": 2, "NORMAL": 3, "COLOR_0": 4}));
        let view = joined["accessors"][4]["bufferView"].as_u64().unwrap() as usize;
        let range = |document: &Value, view: usize| {
            let number = |name: &str| document["bufferViews"][view][name].as_u64().unwrap_or(0) as usize;
            number("byteOffset")..number("byteOffset") + number("byteLength")
        };
        assert_eq!(binary[range(&joined, view)], own[range(&alone, view - 2)]);
        assert!(joined.get("textures").is_none() && write_joined_glb(vec![], &[("none", vec![1, 2])]).is_err());
    }
}
