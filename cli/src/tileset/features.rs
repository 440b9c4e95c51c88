//! The objects of a tile: which point belongs to which (EXT_mesh_features), and what each is called
//! (EXT_structural_metadata).

use std::collections::BTreeMap;

use lodpack::objects::ObjectNode;
use lodpack::{File, ReadAt, Result};
use serde_json::{Value, json};

/// The extension that says to which object each point belongs.
pub const FEATURES: &str = "EXT_mesh_features";
/// The extension that says what objects are called.
pub const METADATA: &str = "EXT_structural_metadata";

/// What the points of a tile belong to.
pub struct Features {
    /// For each point a number in `nodes`.
    pub of_points: Vec<u32>,
    /// The objects of the tile, ascending by number.
    nodes: Vec<ObjectNode>,
    /// What lies above each, joined by slashes.
    paths: Vec<String>,
}

/// A property of objects: the bytes of all texts, and where each begins and the last one ends.
pub struct Property {
    /// As programs ask for it.
    pub name: &'static str,
    /// UTF-8, without gaps.
    pub values: Vec<u8>,
    /// As many as objects, and one.
    pub offsets: Vec<u8>,
}

impl Features {
    /// Of points whose objects have these numbers in the file; none without objects.
    ///
    /// # Errors
    /// Those of reading names.
    pub fn of<S: ReadAt>(file: &File<S>, objects: Vec<u32>) -> Result<Option<Self>> {
        let Some(of_file) = file.objects().filter(|_| !objects.is_empty()) else { return Ok(None) };
        let mut numbers: BTreeMap<u32, u32> = objects.iter().map(|&object| (object, 0)).collect();
        let (mut nodes, mut paths) = (vec![], vec![]);
        for (place, (&object, number)) in (0..).zip(&mut numbers) {
            *number = place;
            nodes.push(of_file.node(object)?);
            let mut path = vec![];
            for above in of_file.above(object)? {
                path.push(of_file.node(above)?.name.unwrap_or_default());
            }
            path.reverse();
            paths.push(path.join("/"));
        }
        Ok(Some(Self { of_points: objects.iter().map(|object| numbers[object]).collect(), nodes, paths }))
    }

    /// How many objects there are.
    pub fn count(&self) -> usize {
        self.nodes.len()
    }

    /// Names, ids and paths. An object that has none has an empty text.
    pub fn properties(&self) -> [Property; 3] {
        let text = |text: fn(&ObjectNode) -> &Option<String>| move |node| text(node).as_deref().unwrap_or_default();
        [
            property("name", self.nodes.iter().map(text(|node| &node.name))),
            property("id", self.nodes.iter().map(text(|node| &node.id))),
            property("path", self.paths.iter().map(String::as_str)),
        ]
    }

    /// What a primitive says, whose first attribute of features has their numbers.
    pub fn of_primitive(&self) -> Value {
        json!({"featureIds": [{"featureCount": self.count(), "attribute": 0, "propertyTable": 0, "label": "object"}]})
    }
}

fn property<'a>(name: &'static str, texts: impl Iterator<Item = &'a str>) -> Property {
    let mut property = Property { name, values: vec![], offsets: 0_u32.to_le_bytes().to_vec() };
    for text in texts {
        property.values.extend(text.bytes());
        property.offsets.extend((property.values.len() as u32).to_le_bytes());
    }
    property
}

/// What a document says of objects, of whose properties these are the views of values and of offsets.
pub fn metadata(count: usize, views: &[(&'static str, usize, usize)]) -> Value {
    let class: serde_json::Map<String, Value> =
        views.iter().map(|(name, ..)| ((*name).into(), json!({"type": "STRING", "noData": ""}))).collect();
    let properties: serde_json::Map<String, Value> = views
        .iter()
        .map(|&(name, values, offsets)| {
            (name.into(), json!({"values": values, "stringOffsets": offsets, "stringOffsetType": "UINT32"}))
        })
        .collect();
    json!({
        "schema": {"id": "lodpack_objects", "classes": {"object": {"properties": class}}},
        "propertyTables": [{"class": "object", "count": count, "properties": properties}],
    })
}
