//! What an input names: objects, and assemblies of them.

use serde::{Deserialize, Serialize};

use lodpack_mesh::attributes::{Attributes, ObjectNode};

/// What an input names, as far as it is kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Nodes {
    /// Objects and assemblies, in the order of the input.
    pub list: Vec<ObjectNode>,
    /// How many of them are objects.
    pub objects: u64,
}

impl Nodes {
    /// Those of an input, which are taken out of it: a million of them take as much memory as a small region.
    pub fn taken(attributes: &mut Attributes) -> Self {
        let [objects, _] = attributes.node_counts();
        Self { list: std::mem::take(&mut attributes.nodes), objects }
    }

    /// Bytes of memory that they take.
    pub fn bytes(&self) -> u64 {
        let text = |text: &Option<String>| text.as_ref().map_or(0, |text| text.len().next_multiple_of(16) + 16);
        self.list.iter().map(|node| (size_of::<ObjectNode>() + text(&node.name) + text(&node.id)) as u64).sum()
    }

    /// How many of them are assemblies.
    pub fn assemblies(&self) -> u64 {
        self.list.len() as u64 - self.objects
    }
}
