//! What inputs name: objects, and assemblies of them.
//!
//! Parsers add nodes in the order of their file and say to which one the triangles that follow belong. At the end, each
//! of several files is an assembly, or one object if it names none; nodes without triangles below them are left out.

use std::ops::Range;
use std::path::Path;

use crate::named::named;
use lodpack_mesh::NONE;
use lodpack_mesh::attributes::{Attributes, ObjectNode, ObjectRun};
use serde::{Deserialize, Serialize};

/// What becomes of the objects that inputs name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Objects {
    /// They are kept, unless there is only one, or they meet at open edges as the tiles of a scan do.
    #[default]
    Auto,
    /// They are kept: nothing is welded, and no face dropped, across them.
    Keep,
    /// The inputs are one surface.
    Join,
}

impl Objects {
    /// Name, choice and description of each.
    pub const ALL: [(&str, Self, &str); 3] = [
        ("auto", Self::Auto, "Keep them, unless there is only one, or most meet at open edges, as tiles of a scan do"),
        ("keep", Self::Keep, "Keep them: nothing is welded and no face is dropped across objects"),
        ("join", Self::Join, "Join them to one surface without names"),
    ];

    /// Whether this is what happens without being asked for.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

named!(Objects);

/// The most bytes of a name or an id, as in files.
const MOST_BYTES: usize = 4096;
/// The most nodes above a node of an input; files allow some more.
const MOST_ABOVE: u16 = 4000;
/// Bytes of the name and the id of a node, as long as they mostly are.
const BYTES_OF_NAMES: usize = 96;

/// Collects the objects of one file after the other.
#[derive(Debug, Default)]
pub struct ObjectSink {
    choice: Objects,
    /// Of all files so far. Parents are nodes of the same file, and come first.
    nodes: Vec<ObjectNode>,
    /// How many nodes are above each.
    depths: Vec<u16>,
    /// How many names and ids were cut, and how many nodes got others above them.
    cut: u64,
    raised: u64,
    /// Of all files so far. Triangles without an object have [`NONE`].
    runs: Vec<ObjectRun>,
    files: Vec<File>,
}

/// What has ended.
#[derive(Debug)]
struct File {
    name: String,
    nodes: Range<usize>,
    runs: Range<usize>,
    triangles: Range<u64>,
}

impl ObjectSink {
    /// Objects of inputs that nobody has read.
    pub fn new(choice: Objects) -> Self {
        Self { choice, ..Self::default() }
    }

    /// Whether objects may be kept. Parsers that need time for them need not read them otherwise.
    pub fn are_wanted(&self) -> bool {
        self.choice != Objects::Join
    }

    /// Bytes of memory that objects take of an input of some triangles.
    pub fn bytes(&self, triangles: u64) -> u64 {
        let nodes: usize = [size_of::<ObjectNode>() + BYTES_OF_NAMES, size_of::<ObjectRun>()]
            .into_iter()
            .zip([self.nodes.len(), self.runs.len()])
            .map(|(bytes, count)| bytes * count)
            .sum();
        if self.runs.is_empty() { 0 } else { nodes as u64 + size_of::<u32>() as u64 * triangles }
    }

    /// Adds a node of the current file, and returns its number. Its parent was added before.
    pub fn add(&mut self, mut node: ObjectNode) -> u32 {
        for text in [&mut node.name, &mut node.id].into_iter().flatten().filter(|text| text.len() > MOST_BYTES) {
            let end = (0..=MOST_BYTES).rev().find(|&end| text.is_char_boundary(end));
            text.truncate(end.unwrap_or(0));
            self.cut += 1;
        }
        let depth = |node: u32| self.depths[node as usize];
        if let Some(parent) = node.parent.filter(|&parent| depth(parent) == MOST_ABOVE) {
            node.parent = self.nodes[parent as usize].parent;
            self.raised += 1;
        }
        self.depths.push(node.parent.map_or(0, |parent| depth(parent) + 1));
        self.nodes.push(node);
        self.nodes.len() as u32 - 1
    }

    /// Sentences about what is not kept as it is.
    pub fn about(&self) -> Vec<String> {
        let cut =
            format!("{} names and ids of objects are longer than {MOST_BYTES} bytes: the rest was cut off", self.cut);
        let raised = format!(
            "{} objects and assemblies lie more than {MOST_ABOVE} deep in others: they were put into those {MOST_ABOVE} deep",
            self.raised
        );
        [(self.cut, cut), (self.raised, raised)]
            .into_iter()
            .filter(|(count, _)| *count > 0)
            .map(|(_, text)| text)
            .collect()
    }

    /// Sets the object of the triangles from a number on: a node, or [`NONE`].
    pub fn set(&mut self, node: u32, first_triangle: u64) {
        let first_triangle = first_triangle as u32;
        let first = self.files.last().map_or(0, |file| file.runs.end);
        if self.runs.len() > first && self.runs.last().is_some_and(|run| run.first_triangle == first_triangle) {
            self.runs.pop();
        }
        let before = self.runs.get(first..).and_then(<[ObjectRun]>::last).map_or(NONE, |run| run.node);
        if before != node {
            self.runs.push(ObjectRun { first_triangle, node });
        }
    }

    /// Ends a file, whose triangles these are.
    pub fn end_file(&mut self, path: &Path, triangles: Range<u64>) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (nodes, runs) = self.files.last().map_or((0, 0), |file| (file.nodes.end, file.runs.end));
        let (nodes, runs) = (nodes..self.nodes.len(), runs..self.runs.len());
        self.files.push(File { name, nodes, runs, triangles });
    }

    /// Ends the inputs: puts nodes and runs into their attributes.
    pub fn finish(mut self, attributes: &mut Attributes) {
        if !self.are_wanted() {
            return;
        }
        let is_one = self.files.len() == 1;
        let (mut nodes, mut runs): (Vec<ObjectNode>, Vec<ObjectRun>) = (vec![], vec![]);
        let mut own = std::mem::take(&mut self.nodes).into_iter();
        for file in &self.files {
            let of_file = self.of_file(file);
            let names_any = of_file.iter().any(|run| run.node != NONE);
            let own: Vec<ObjectNode> = own.by_ref().take(file.nodes.len()).collect();
            if is_one && !names_any {
                return;
            }
            let file_node = (!is_one).then_some(nodes.len() as u32);
            if file_node.is_some() {
                nodes.push(ObjectNode { name: Some(file.name.clone()), ..ObjectNode::default() });
            }
            let first = nodes.len();
            let moved = |node: u32| node - file.nodes.start as u32 + first as u32;
            nodes.extend(own.into_iter().map(|node| {
                let parent = node.parent.map(moved).or(file_node);
                ObjectNode { parent, ..node }
            }));
            // What a file with names leaves without one is an object nevertheless.
            let mut nameless = file_node.filter(|_| !names_any);
            for run in of_file {
                let node = match run.node {
                    NONE => *nameless.get_or_insert_with(|| {
                        nodes.push(ObjectNode { parent: file_node, ..ObjectNode::default() });
                        nodes.len() as u32 - 1
                    }),
                    node => moved(node),
                };
                if runs.last().is_none_or(|before| before.node != node) {
                    runs.push(ObjectRun { node, ..run });
                }
            }
        }
        let is_used = uses(&nodes, &runs);
        let mut next = 0;
        let numbers: Vec<u32> = is_used
            .iter()
            .map(|&is_used| {
                next += u32::from(is_used);
                next.wrapping_sub(1)
            })
            .collect();
        let number = |node: u32| numbers[node as usize];
        let used = nodes.into_iter().zip(&is_used).filter(|(_, is_used)| **is_used);
        attributes.nodes = used.map(|(node, _)| ObjectNode { parent: node.parent.map(number), ..node }).collect();
        attributes.objects = runs.into_iter().map(|run| ObjectRun { node: number(run.node), ..run }).collect();
        if self.choice == Objects::Auto && attributes.node_counts()[0] < 2 {
            attributes.join_objects();
        }
    }

    /// The runs of a file that have triangles; all triangles are in one.
    fn of_file(&self, file: &File) -> Vec<ObjectRun> {
        let Range { start, end } = file.triangles;
        let unnamed = ObjectRun { first_triangle: start as u32, node: NONE };
        let mut runs = vec![];
        for run in std::iter::once(&unnamed).chain(&self.runs[file.runs.clone()]) {
            if runs.last().is_some_and(|before: &ObjectRun| before.first_triangle == run.first_triangle) {
                runs.pop();
            }
            if u64::from(run.first_triangle) < end {
                runs.push(*run);
            }
        }
        runs
    }
}

/// For each node whether it is an object, or above one.
fn uses(nodes: &[ObjectNode], runs: &[ObjectRun]) -> Vec<bool> {
    let mut is_used = vec![false; nodes.len()];
    for run in runs {
        let mut node = Some(run.node);
        while let Some(number) = node.map(|node| node as usize).filter(|&number| !is_used[number]) {
            is_used[number] = true;
            node = nodes[number].parent;
        }
    }
    is_used
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(name: &str, parent: Option<u32>) -> ObjectNode {
        ObjectNode { name: Some(name.into()), id: None, parent }
    }

    /// The paths of the objects of triangles.
    fn paths(attributes: &Attributes, triangles: u32) -> Vec<String> {
        let path = |triangle: u32| {
            let (mut path, mut node) = (vec![], Some(attributes.object(triangle)));
            while let Some(number) = node {
                let ObjectNode { name, parent, .. } = &attributes.nodes[number as usize];
                path.push(name.clone().unwrap_or("-".into()));
                assert!(parent.is_none_or(|parent| parent < number), "parents come first");
                node = *parent;
            }
            path.reverse();
            path.join("/")
        };
        (0..triangles).map(path).collect()
    }

    #[test]
    fn files_are_assemblies_or_objects_and_empty_nodes_are_left_out() {
        let mut sink = ObjectSink::new(Objects::Auto);
        let empty = sink.add(named("empty", None));
        let hall = sink.add(named("hall", None));
        sink.add(named("door", Some(empty)));
        let (wall, roof) = (sink.add(named("wall", Some(hall))), sink.add(named("roof", Some(hall))));
        [(wall, 1), (roof, 1), (wall, 3), (roof, 5)].into_iter().for_each(|(node, at)| sink.set(node, at));
        sink.end_file(Path::new("a/one.glb"), 0..5);
        sink.end_file(Path::new("b/two.stl"), 5..7);
        sink.add(named("rest", None));
        sink.end_file(Path::new("three.obj"), 7..8);
        let mut attributes = Attributes::default();
        sink.finish(&mut attributes);
        let expected = [
            "one.glb/-",
            "one.glb/hall/roof",
            "one.glb/hall/roof",
            "one.glb/hall/wall",
            "one.glb/hall/wall",
            "two.stl",
            "two.stl",
            "three.obj",
        ];
        assert_eq!(paths(&attributes, 8), expected);
        assert_eq!((attributes.nodes.len(), attributes.node_counts()), (7, [5, 2]));
    }

    #[test]
    fn names_are_cut_between_letters_and_no_tree_is_too_deep() {
        let mut sink = ObjectSink::new(Objects::Keep);
        let mut parent = None;
        for _ in 0..=2 * MOST_ABOVE {
            parent = Some(sink.add(named(&"\u{20ac}".repeat(1400), parent)));
        }
        sink.set(parent.unwrap(), 0);
        sink.end_file(Path::new("a.obj"), 0..1);
        assert!(sink.about()[0].starts_with("8001 names") && sink.about()[1].starts_with("4000 objects"));
        let mut attributes = Attributes::default();
        sink.finish(&mut attributes);
        assert_eq!((attributes.nodes.len(), attributes.nodes[0].name.as_ref().unwrap().len()), (4001, 4095));
        assert_eq!(paths(&attributes, 1)[0].split('/').count(), 4001);
    }

    #[test]
    fn one_file_has_the_objects_that_it_names_and_a_single_one_only_if_it_is_wanted() {
        let of = |choice: Objects, names: &[&str]| {
            let mut sink = ObjectSink::new(choice);
            for (at, name) in (0..).zip(names) {
                let node = sink.add(named(name, None));
                sink.set(node, at);
            }
            sink.end_file(Path::new("a.obj"), 0..3);
            let mut attributes = Attributes::default();
            sink.finish(&mut attributes);
            attributes
        };
        assert_eq!(paths(&of(Objects::Auto, &["a", "b"]), 3), ["a", "b", "b"]);
        assert_eq!(paths(&of(Objects::Keep, &["a"]), 3), ["a"; 3]);
        for nothing in [of(Objects::Auto, &["a"]), of(Objects::Join, &["a", "b"]), of(Objects::Keep, &[])] {
            assert_eq!(nothing, Attributes::default());
        }
    }
}
