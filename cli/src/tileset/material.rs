//! What a tile's surface looks like. Colours and textures of channels belong here once files have them.

use serde_json::{Value, json};

/// Gives every primitive of a glTF document its material.
pub fn apply(document: &mut Value) {
    document["materials"] = json!([{
        // Without channels: matt and light grey. Surfaces with boundaries are seen from behind, too.
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0},
        "doubleSided": true,
    }]);
    for primitive in document["meshes"]
        .as_array_mut()
        .into_iter()
        .flatten()
        .flat_map(|mesh| mesh["primitives"].as_array_mut())
        .flatten()
    {
        primitive["material"] = 0.into();
    }
}
