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
    /// Those of an input.
    pub fn of(attributes: &Attributes) -> Self {
        let [objects, _] = attributes.node_counts();
        Self { list: attributes.nodes.clone(), objects }
    }

    /// How many of them are assemblies.
    pub fn assemblies(&self) -> u64 {
        self.list.len() as u64 - self.objects
    }
}
