//! Objects and groups of an OBJ file.
//!
//! A name is the rest of its line. The same pair of an object and a group is the same object wherever it comes again.
//! An `o` without a name begins an object without one, and a `g` without a name ends the group. A group belongs to the
//! object before it, and a new object ends it.

use std::collections::HashMap;

use lodpack_mesh::NONE;
use lodpack_mesh::attributes::ObjectNode;

/// The object and the group at a place of a file.
#[derive(Clone, Debug)]
pub struct ObjObjects {
    /// The nodes of objects by name, and of groups by object and name.
    numbers: HashMap<(u32, Vec<u8>), u32>,
    /// Objects without a name, in the order of the file, and how many of them begin before the place.
    nameless: Vec<u32>,
    nameless_before: usize,
    object: u32,
    current: u32,
}

/// The object and the group at a place that is read again.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    nameless_before: usize,
    object: u32,
    current: u32,
}

impl ObjObjects {
    /// At the beginning of a file.
    pub fn new() -> Self {
        Self { numbers: HashMap::new(), nameless: vec![], nameless_before: 0, object: NONE, current: NONE }
    }

    /// The node of the faces that follow an `o` or a `g` with this rest of its line. `add` adds a node that is not yet
    /// known.
    pub fn begin(&mut self, is_object: bool, rest: &[u8], add: impl FnOnce(ObjectNode) -> u32) -> u32 {
        let name = rest.trim_ascii();
        let text = || Some(String::from_utf8_lossy(name).into_owned());
        match (is_object, name.is_empty()) {
            (true, true) => {
                if self.nameless_before == self.nameless.len() {
                    self.nameless.push(add(ObjectNode::default()));
                }
                self.object = self.nameless[self.nameless_before];
                self.nameless_before += 1;
                self.current = self.object;
            }
            (false, true) => self.current = self.object,
            (_, false) => {
                // Objects are told from groups without an object by their first letter.
                let above = if is_object { NONE } else { self.object };
                let parent = (above != NONE).then_some(above);
                let key = [if is_object { b"o" } else { b"g" }, name].concat();
                let number = self.numbers.entry((above, key));
                self.current = *number.or_insert_with(|| add(ObjectNode { name: text(), id: None, parent }));
                if is_object {
                    self.object = self.current;
                }
            }
        }
        self.current
    }

    /// Where the file is.
    pub fn place(&self) -> Place {
        let &Self { nameless_before, object, current, .. } = self;
        Place { nameless_before, object, current }
    }

    /// Goes back to an earlier place; returns the node of the faces that follow.
    pub fn go_back(&mut self, Place { nameless_before, object, current }: Place) -> u32 {
        (self.nameless_before, self.object, self.current) = (nameless_before, object, current);
        current
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_pair_is_the_same_object_and_those_without_a_name_are_their_own() {
        let (mut objects, mut nodes) = (ObjObjects::new(), vec![]);
        let mut begin = |objects: &mut ObjObjects, line: &str| {
            let (kind, rest) = line.split_at(1);
            objects.begin(kind == "o", rest.as_bytes(), |node| {
                nodes.push(node);
                nodes.len() as u32 - 1
            })
        };
        let lines = [
            ("g wall ", 0),
            ("g", NONE),
            ("g  wall", 0),
            ("o wall", 1),
            ("g left side # 2", 2),
            ("g", 1),
            ("o", 3),
            ("g left side # 2", 4),
            ("o", 5),
            ("o wall", 1),
            ("g left side # 2", 2),
        ];
        let start = objects.place();
        for round in 0..2 {
            for (line, number) in lines {
                assert_eq!(begin(&mut objects, line), number, "{line} in round {round}");
            }
            assert_eq!(objects.go_back(start), NONE);
        }
        let names: Vec<_> = nodes.iter().map(|node| (node.name.as_deref(), node.parent)).collect();
        let side = Some("left side # 2");
        let wall = Some("wall");
        assert_eq!(names, [(wall, None), (wall, None), (side, Some(1)), (None, None), (side, Some(3)), (None, None)]);
    }
}
