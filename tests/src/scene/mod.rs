//! Generated scenes of named objects, many of which have the same shape: a plant and a forest.

use glam::{DAffine3, DQuat, DVec3};

mod forest;
mod plant;
mod shapes;
mod write;

pub use forest::forest;
pub use plant::plant;
pub use write::{Sharing, write_glb, write_obj};

/// A closed surface, or many of them, with one colour.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// In metres, z up.
    pub positions: Vec<DVec3>,
    /// Corners of each, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Which of [`COLOURS`] it has.
    pub colour: usize,
}

/// Where a node is in the space of its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Metres, after the others.
    pub translation: DVec3,
    /// Of length 1.
    pub rotation: DQuat,
    /// Below 0 along one axis for what is mirrored.
    pub scale: DVec3,
}

/// A node of the tree: an assembly, or an object if it has a shape.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Not unique; `None` for some objects.
    pub name: Option<String>,
    /// Unique where there is one.
    pub id: Option<String>,
    /// Comes before this one.
    pub parent: Option<u32>,
    /// What it shows, of [`Scene::shapes`].
    pub shape: Option<u32>,
    /// Into the space of its parent.
    pub transform: Transform,
}

/// A tree of nodes, and the shapes that they show.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// In their own spaces.
    pub shapes: Vec<Shape>,
    /// Parents before their children.
    pub nodes: Vec<Node>,
}

/// Names of colours, and their red, green and blue in linear light.
pub const COLOURS: [(&str, [f64; 3]); 9] = [
    ("steel", [0.45, 0.47, 0.50]),
    ("galvanised", [0.60, 0.62, 0.63]),
    ("valve red", [0.55, 0.04, 0.03]),
    ("cable black", [0.02, 0.02, 0.02]),
    ("concrete", [0.42, 0.40, 0.37]),
    ("pipe green", [0.05, 0.28, 0.12]),
    ("pipe yellow", [0.62, 0.45, 0.03]),
    ("bark", [0.12, 0.07, 0.04]),
    ("leaf", [0.06, 0.22, 0.03]),
];

impl Transform {
    /// None.
    pub const IDENTITY: Self = Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// A shift.
    pub fn at(translation: DVec3) -> Self {
        Self { translation, ..Self::IDENTITY }
    }

    /// As a matrix.
    pub fn matrix(self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

impl Scene {
    fn add_shape(&mut self, shape: Shape) -> u32 {
        self.shapes.push(shape);
        self.shapes.len() as u32 - 1
    }

    fn add(&mut self, node: Node) -> u32 {
        self.nodes.push(node);
        self.nodes.len() as u32 - 1
    }

    /// Where each node is in the world.
    pub fn in_world(&self) -> Vec<DAffine3> {
        let mut matrices: Vec<DAffine3> = Vec::with_capacity(self.nodes.len());
        for node in &self.nodes {
            let own = node.transform.matrix();
            matrices.push(node.parent.map_or(own, |parent| matrices[parent as usize] * own));
        }
        matrices
    }

    /// Number of nodes that have a shape.
    pub fn object_count(&self) -> usize {
        self.nodes.iter().filter(|node| node.shape.is_some()).count()
    }

    /// Triangles of all objects.
    pub fn triangle_count(&self) -> u64 {
        let shapes = self.nodes.iter().filter_map(|node| node.shape);
        shapes.map(|shape| self.shapes[shape as usize].triangles.len() as u64).sum()
    }
}
