//! How much memory a document takes, before it is read.

use serde::Deserialize;
use serde_json::value::RawValue;

use super::document::{Accessor, Primitive, View, ViewExtensions};
use super::fields::Index;
use super::material_fields::Material;
use super::node_list::NodeBytes;

/// A number of bytes; none if they are negligible.
pub(super) fn unless_negligible(bytes: u64) -> u64 {
    const NEGLIGIBLE: u64 = 4 << 20;
    if bytes > NEGLIGIBLE { bytes } else { 0 }
}

/// The texts of the lists that can be long.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Lists<'a> {
    #[serde(borrow)]
    nodes: Option<&'a RawValue>,
    #[serde(borrow)]
    scenes: Option<&'a RawValue>,
    #[serde(borrow)]
    meshes: Option<&'a RawValue>,
    #[serde(borrow)]
    accessors: Option<&'a RawValue>,
    #[serde(borrow)]
    buffer_views: Option<&'a RawValue>,
}

/// The most bytes of memory that parts of a text stand for.
#[derive(Clone, Copy)]
struct Rate {
    byte: usize,
    object: usize,
    comma: usize,
}

impl Rate {
    /// Strings, the buffers decoded from them, and materials, whose lists are copied when they grow.
    const OTHERS: Self = Self { byte: 4, object: 2 * size_of::<Material>(), comma: 64 };
    /// The numbers of root nodes.
    const SCENES: Self = Self { byte: 0, object: 64, comma: 3 * size_of::<Index>() };
    /// Primitives with their attributes, whose lists are copied when they grow and when they are complete.
    const MESHES: Self = Self { byte: 1, object: 3 * size_of::<Primitive>(), comma: 64 };
    const ACCESSORS: Self = Self { byte: 0, object: 2 * size_of::<Accessor>(), comma: 0 };
    const VIEWS: Self = Self { byte: 1, object: 2 * size_of::<View>() + size_of::<ViewExtensions>(), comma: 0 };

    fn of(self, text: &[u8]) -> u64 {
        let count = |letter: u8| text.iter().filter(|&&byte| byte == letter).count();
        (self.byte * text.len() + self.object * count(b'{') + self.comma * count(b',')) as u64
    }
}

/// An upper bound on the memory for a document and its embedded buffers; none if it is negligible.
pub(super) fn document_bytes(json: &[u8]) -> u64 {
    let all = Rate::OTHERS.of(json);
    // What is damaged is counted like the rest until it is refused.
    match unless_negligible(all) {
        0 => 0,
        all => unless_negligible(bytes_by_list(json, all).unwrap_or(all)),
    }
}

/// The same, more exactly; none of damaged documents.
fn bytes_by_list(json: &[u8], all: u64) -> Option<u64> {
    let lists: Lists = serde_json::from_slice(json).ok()?;
    let nodes = lists.nodes.map_or("[]", RawValue::get);
    let of_nodes = serde_json::from_str::<NodeBytes>(nodes).ok()?.total();
    let mut bytes = all - Rate::OTHERS.of(nodes.as_bytes()).min(all) + of_nodes;
    for (list, rate) in [
        (lists.scenes, Rate::SCENES),
        (lists.meshes, Rate::MESHES),
        (lists.accessors, Rate::ACCESSORS),
        (lists.buffer_views, Rate::VIEWS),
    ] {
        let text = list.map_or("", RawValue::get).as_bytes();
        bytes = bytes.saturating_sub(Rate::OTHERS.of(text)) + rate.of(text);
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_million_boxes_with_names_are_counted_as_they_are_kept() {
        let count = 100_000;
        let node = r#"{"mesh":1,"translation":[1.25,2.5,3.75],"scale":[0.2,0.3,0.4],"name":"BOX-01/00001-A"},"#;
        let roots: Vec<String> = (0..count).map(|number| number.to_string()).collect();
        let json = format!(r#"{{"nodes":[{}{{}}],"scenes":[{{"nodes":[{}]}}]}}"#, node.repeat(count), roots.join(","));
        let bytes = document_bytes(json.as_bytes());
        assert!((100..260).contains(&(bytes / count as u64)), "{bytes}");
        // Cut off, it is not known how much of it is kept.
        assert!(document_bytes(&json.as_bytes()[..json.len() - 1]) > 3 * bytes);
    }
}
