//! The nodes of a document in a few long lists: documents can have millions, whose names and transforms would
//! otherwise each lie in pieces of memory of their own.

use std::collections::BTreeMap;
use std::fmt;

use glam::{DMat4, DQuat, DVec3};
use serde::Deserialize;
use serde::de::{Deserializer, SeqAccess, Visitor};

use super::fields::{Id, Index, Name, Weights, Whole};

/// A node as it is written, for as long as it is read.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Written {
    children: Box<[Index]>,
    mesh: Option<Index>,
    skin: Option<Index>,
    weights: Option<Weights>,
    matrix: Option<Box<[f64; 16]>>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
    name: Name,
    #[serde(rename = "extras")]
    id: Id,
    extensions: Option<Box<NodeExtensions>>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instances: Option<Instances>,
    #[serde(rename = "KHR_node_visibility")]
    pub(super) visibility: Option<Visibility>,
}

/// `EXT_mesh_gpu_instancing`: accessors by name.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Instances {
    pub(super) attributes: BTreeMap<String, Index>,
}

/// `KHR_node_visibility`.
#[derive(Deserialize)]
#[serde(default)]
pub(super) struct Visibility {
    pub(super) visible: bool,
}

impl Default for Visibility {
    fn default() -> Self {
        Self { visible: true }
    }
}

/// A node of a document.
#[derive(Clone, Copy)]
pub(super) struct Node<'a> {
    pub(super) children: &'a [Index],
    pub(super) mesh: Option<Index>,
    pub(super) name: Option<&'a str>,
    pub(super) id: Option<&'a str>,
    transform: &'a [f64],
    has: u8,
    rare: Option<&'a Rare>,
}

/// What few nodes have.
struct Rare {
    node: usize,
    skin: Option<Index>,
    weights: Option<Weights>,
    extensions: Option<Box<NodeExtensions>>,
}

impl<'a> Node<'a> {
    pub(super) fn skin(&self) -> Option<Index> {
        self.rare?.skin
    }

    pub(super) fn weights(&self) -> Option<&'a Weights> {
        self.rare?.weights.as_ref()
    }

    pub(super) fn instances(&self) -> Option<&'a Instances> {
        self.rare?.extensions.as_deref()?.instances.as_ref()
    }

    pub(super) fn is_visible(&self) -> bool {
        let extensions = self.rare.and_then(|rare| rare.extensions.as_deref());
        extensions.and_then(|extensions| extensions.visibility.as_ref()).is_none_or(|of| of.visible)
    }

    /// The node's own transform.
    pub(super) fn parent_from_node(&self) -> DMat4 {
        if let Ok(matrix) = self.transform.try_into() {
            return DMat4::from_cols_array(matrix);
        }
        let mut rest = self.transform;
        let [translation, rotation, scale] =
            [(HAS_TRANSLATION, 3), (HAS_ROTATION, 4), (HAS_SCALE, 3)].map(|(part, count)| {
                let (own, after) = rest.split_at_checked(if self.has & part == 0 { 0 } else { count })?;
                rest = after;
                Some(own)
            });
        transform(
            vector(translation).unwrap_or([0.0; 3]),
            vector(rotation).unwrap_or([0.0, 0.0, 0.0, 1.0]),
            vector(scale).unwrap_or([1.0; 3]),
        )
    }
}

/// A transform of its parts.
pub(super) fn transform(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> DMat4 {
    let rotation = DQuat::from_array(rotation);
    // As it is written, the norm is only near 1.
    let rotation = if rotation.length_squared() > 0.0 { rotation.normalize() } else { DQuat::IDENTITY };
    DMat4::from_scale_rotation_translation(DVec3::from(scale), rotation, DVec3::from(translation))
}

fn vector<const N: usize>(values: Option<&[f64]>) -> Option<[f64; N]> {
    values?.try_into().ok()
}

const HAS_MESH: u8 = 1;
const HAS_TRANSLATION: u8 = 2;
const HAS_ROTATION: u8 = 4;
const HAS_SCALE: u8 = 8;

/// A node in the lists: what it has in each ends here, and begins where that of the node before ends.
#[derive(Clone, Copy, Default)]
struct Row {
    children: usize,
    transform: usize,
    name: usize,
    id: usize,
    mesh: u32,
    has: u8,
}

/// All nodes of a document.
#[derive(Default)]
pub(super) struct Nodes {
    rows: Vec<Row>,
    children: Vec<Index>,
    /// A matrix, or what is stated of translation, rotation and scale.
    transforms: Vec<f64>,
    /// Names and ids.
    texts: String,
    /// By node.
    rare: Vec<Rare>,
}

impl Nodes {
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn get(&self, number: usize) -> Option<Node<'_>> {
        let row = self.rows.get(number)?;
        let before = number.checked_sub(1).and_then(|before| self.rows.get(before)).copied().unwrap_or_default();
        let rare = self.rare.binary_search_by_key(&number, |rare| rare.node);
        let text = |range: std::ops::Range<usize>| self.texts.get(range).filter(|text| !text.is_empty());
        Some(Node {
            children: self.children.get(before.children..row.children)?,
            mesh: (row.has & HAS_MESH != 0).then_some(Whole(row.mesh)),
            name: text(before.id..row.name),
            id: text(row.name..row.id),
            transform: self.transforms.get(before.transform..row.transform)?,
            has: row.has,
            rare: rare.ok().and_then(|at| self.rare.get(at)),
        })
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = Node<'_>> {
        (0..self.len()).filter_map(|number| self.get(number))
    }

    fn push(&mut self, node: Written) {
        let mut has = 0;
        match &node.matrix {
            Some(matrix) => self.transforms.extend_from_slice(&matrix[..]),
            None => {
                let mut add = |part: u8, values: Option<&[f64]>| {
                    let Some(values) = values else { return };
                    has |= part;
                    self.transforms.extend_from_slice(values);
                };
                add(HAS_TRANSLATION, node.translation.as_ref().map(|values| &values[..]));
                add(HAS_ROTATION, node.rotation.as_ref().map(|values| &values[..]));
                add(HAS_SCALE, node.scale.as_ref().map(|values| &values[..]));
            }
        }
        has |= if node.mesh.is_some() { HAS_MESH } else { 0 };
        self.children.extend_from_slice(&node.children);
        self.texts.push_str(node.name.0.as_deref().unwrap_or_default());
        let name = self.texts.len();
        self.texts.push_str(node.id.0.as_deref().unwrap_or_default());
        if node.skin.is_some() || node.weights.is_some() || node.extensions.is_some() {
            let Written { skin, weights, extensions, .. } = node;
            self.rare.push(Rare { node: self.rows.len(), skin, weights, extensions });
        }
        self.rows.push(Row {
            children: self.children.len(),
            transform: self.transforms.len(),
            name,
            id: self.texts.len(),
            mesh: node.mesh.map_or(0, |mesh| mesh.0),
            has,
        });
    }
}

impl<'de> Deserialize<'de> for Nodes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut nodes = Self::default();
        deserializer.deserialize_seq(Each(|node| nodes.push(node)))?;
        Ok(nodes)
    }
}

/// The bytes of memory of nodes and of a walk through them, without keeping any.
#[derive(Default)]
pub(super) struct NodeBytes {
    kept: u64,
    /// The longest that a single node takes while it is read.
    passing: u64,
    parents: u64,
    count: u64,
    has_skins: bool,
}

impl NodeBytes {
    fn add(&mut self, node: &Written) {
        let text = |text: &Option<Box<str>>| text.as_ref().map_or(0, |text| text.len() as u64);
        let of_children = size_of_val(&*node.children) as u64;
        let of_texts = text(&node.name.0) + text(&node.id.0);
        let values = node
            .matrix
            .as_ref()
            .map_or(0, |_| 16)
            .max(node.translation.map_or(0, |_| 3) + node.rotation.map_or(0, |_| 4) + node.scale.map_or(0, |_| 3));
        self.kept += size_of::<Row>() as u64 + of_children + of_texts + values * size_of::<f64>() as u64;
        if node.skin.is_some() || node.weights.is_some() {
            self.kept += size_of::<Rare>() as u64;
        }
        if let Some(extensions) = &node.extensions {
            let instances = extensions.instances.iter().flat_map(|of| of.attributes.keys());
            self.kept += (size_of::<Rare>() + size_of::<NodeExtensions>()) as u64;
            self.kept += instances.map(|name| 64 + name.len() as u64).sum::<u64>();
        }
        self.has_skins |= node.skin.is_some();
        self.parents += u64::from(!node.children.is_empty());
        self.count += 1;
        self.passing = self.passing.max(3 * of_children + 3 * of_texts);
    }

    /// An upper bound, with lists that are half empty once they have grown.
    pub(super) fn total(&self) -> u64 {
        // For each node whether it was seen; the nodes that are open, each with its place; where all are, for joints.
        let walk = self.count + 2 * 192 * self.parents;
        let joints = if self.has_skins { self.count * 2 * 160 } else { 0 };
        2 * self.kept + self.passing + walk + joints
    }
}

impl<'de> Deserialize<'de> for NodeBytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut bytes = Self::default();
        deserializer.deserialize_seq(Each(|node| bytes.add(&node)))?;
        Ok(bytes)
    }
}

/// Hands on one node after the other.
struct Each<F>(F);

impl<'de, F: FnMut(Written)> Visitor<'de> for Each<F> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a list of nodes")
    }

    fn visit_seq<A: SeqAccess<'de>>(mut self, mut list: A) -> Result<(), A::Error> {
        while let Some(node) = list.next_element::<Written>()? {
            (self.0)(node);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nodes(json: &str) -> Nodes {
        serde_json::from_str(json).unwrap()
    }

    #[test]
    fn ids_are_texts_or_numbers_and_extras_may_be_anything() {
        let read = |extras: &str| {
            let nodes = nodes(&format!(r#"[{{"name": "before"}}, {{"extras": {extras}, "mesh": 3}}]"#));
            let node = nodes.get(1).unwrap();
            assert_eq!((node.mesh, node.name), (Some(Whole(3)), None), "{extras}");
            node.id.map(str::to_owned)
        };
        for (extras, id) in [
            (r#"{"id": "a", "x": [1]}"#, "a"),
            (r#"{"guid": "g", "GLOBALID": "b", "Id": "a"}"#, "a"),
            (r#"{"guid": "g", "globalId": "b"}"#, "b"),
            (r#"{"GUID": "g", "id": null}"#, "g"),
            (r#"{"id": 18446744073709551615}"#, "18446744073709551615"),
            (r#"{"id": -7}"#, "-7"),
            (r#"{"id": 1.5, "guid": {"id": [2]}}"#, "1.5"),
        ] {
            assert_eq!(read(extras).as_deref(), Some(id), "{extras}");
        }
        for extras in ["0", "-1", "1.5", "null", "true", r#""id""#, "[]", r#"[{"id": 1}]"#, "{}", r#"{"id": {}}"#] {
            assert_eq!(read(extras), None, "{extras}");
        }
    }

    #[test]
    fn lists_give_each_node_what_it_states_and_the_rest_as_the_format_says() {
        let nodes = nodes(
            r#"[{"scale": [2, 3, 4], "children": [2, 1], "name": "a", "extras": {"id": "x"}},
                {"matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 5,6,7,1], "scale": [9, 9, 9], "mesh": 0, "name": ""},
                {"rotation": [0, 0, 1, 0], "translation": [1, 2, 3], "skin": 4, "weights": [0, 1]},
                {"extensions": {"KHR_node_visibility": {"visible": false}}, "children": [3]}, {}]"#,
        );
        let texts: Vec<_> = nodes.iter().map(|node| (node.name, node.id)).collect();
        assert_eq!(texts, [(Some("a"), Some("x")), (None, None), (None, None), (None, None), (None, None)]);
        let children: Vec<Vec<u32>> =
            nodes.iter().map(|node| node.children.iter().map(|child| child.0).collect()).collect();
        assert_eq!(children, [vec![2, 1], vec![], vec![], vec![3], vec![]]);
        let places: Vec<DMat4> = nodes.iter().map(|node| node.parent_from_node()).collect();
        let identity = transform([0.0; 3], [0.0, 0.0, 0.0, 1.0], [1.0; 3]);
        assert_eq!(places[0], transform([0.0; 3], [0.0, 0.0, 0.0, 1.0], [2.0, 3.0, 4.0]));
        assert_eq!(places[1], DMat4::from_translation([5.0, 6.0, 7.0].into()));
        assert_eq!(places[2], transform([1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 0.0], [1.0; 3]));
        assert_eq!(places[3..], [identity, identity]);
        let rare: Vec<_> =
            nodes.iter().map(|node| (node.skin(), node.weights().is_some(), node.is_visible())).collect();
        let plain = (None, false, true);
        assert_eq!(rare, [plain, plain, (Some(Whole(4)), true, true), (None, false, false), plain]);
    }

    #[test]
    fn nodes_take_less_than_is_counted_for_them() {
        let some = r#"{"translation": [1, 2, 3], "scale": [1, 2, 3], "name": "BOX 1", "children": [1, 2]},"#;
        let json = format!("[{}{{}}]", some.repeat(1000));
        let (nodes, bytes) = (nodes(&json), serde_json::from_str::<NodeBytes>(&json).unwrap());
        let Nodes { rows, children, transforms, texts, rare } = &nodes;
        let taken = rows.capacity() * size_of::<Row>()
            + children.capacity() * size_of::<Index>()
            + transforms.capacity() * size_of::<f64>()
            + texts.capacity()
            + rare.capacity() * size_of::<Rare>();
        assert!(taken as u64 <= bytes.total(), "{taken} {}", bytes.total());
        assert!(bytes.total() < 1000 * (2 * (40 + 48 + 5 + 8) + 2 * 192) + 2000, "{}", bytes.total());
    }
}
