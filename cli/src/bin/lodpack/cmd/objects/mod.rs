//! Objects of a file: those that patterns name, their list, and what is written of them.

pub mod drawn;
pub mod list;

use super::open::{Source, in_file};
use anyhow::{Result, bail};
use lodpack::objects::ObjectNode;
use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

/// Nodes of a file by their numbers: all of them, or those that were asked for with all that lies above them.
pub struct Nodes {
    pub known: BTreeMap<u32, ObjectNode>,
    pub objects: u32,
}

impl Nodes {
    /// Reads all of them; none if the file has no objects.
    pub fn read(path: &Path, file: &lodpack::File<Source>) -> Result<Option<Self>> {
        let Some(objects) = file.objects() else { return Ok(None) };
        let known = (0..).zip(in_file(path, objects.nodes())?).collect();
        Ok(Some(Self { known, objects: objects.count() }))
    }

    /// The objects that patterns name, as [`Nodes::matching`] finds them. Names and ids without stars and slashes are
    /// looked up, so that of a million nodes a few pages are read; none if the file has no objects.
    pub fn found(
        path: &Path,
        file: &lodpack::File<Source>,
        patterns: &[String],
    ) -> Result<Option<(Self, BTreeSet<u32>)>> {
        let Some(objects) = file.objects() else { return Ok(None) };
        let mut named_by_all = vec![];
        for pattern in patterns {
            let number = pattern.strip_prefix('#').and_then(|number| number.parse::<u32>().ok());
            let mut named: Vec<u32> = number.filter(|&number| number < objects.node_count()).into_iter().collect();
            if number.is_none() && !pattern.contains(['*', '/']) {
                named = in_file(path, objects.find_name(pattern))?;
                named.extend(in_file(path, objects.find_id(pattern))?);
            }
            // Perhaps it names a path, or nothing.
            if named.is_empty() {
                let Some(nodes) = Self::read(path, file)? else { return Ok(None) };
                let found = nodes.matching(path, patterns)?;
                return Ok(Some((nodes, found)));
            }
            named_by_all.extend(named);
        }
        let found: BTreeSet<u32> = in_file(path, objects.below(&named_by_all))?.into_iter().collect();
        let mut nodes = Self { known: BTreeMap::new(), objects: objects.count() };
        for &object in &found {
            for number in in_file(path, objects.above(object))?.into_iter().chain([object]) {
                if let Entry::Vacant(unknown) = nodes.known.entry(number) {
                    unknown.insert(in_file(path, objects.node(number))?);
                }
            }
        }
        Ok(Some((nodes, found)))
    }

    /// What lies above a node, from the top down.
    pub fn above(&self, number: u32) -> Vec<u32> {
        let mut above = vec![];
        let mut node = self.known.get(&number);
        // A file may lie about its tree.
        while let Some(parent) = node.and_then(|node| node.parent).filter(|_| above.len() < self.known.len()) {
            above.push(parent);
            node = self.known.get(&parent);
        }
        above.reverse();
        above
    }

    /// The names of what lies above a node, joined by slashes.
    pub fn path_above(&self, number: u32) -> String {
        let name = |number: &u32| self.known.get(number).and_then(|node| node.name.clone()).unwrap_or_default();
        self.above(number).iter().map(name).collect::<Vec<_>>().join("/")
    }

    /// The objects among these nodes, which are all, that patterns name: by number (#12), name, id, or names of all
    /// above and its own joined by slashes; a star stands for any text. An assembly stands for everything in it.
    ///
    /// # Errors
    /// If a pattern names nothing.
    pub fn matching(&self, path: &Path, patterns: &[String]) -> Result<BTreeSet<u32>> {
        let mut children: HashMap<u32, Vec<u32>> = HashMap::new();
        for (&number, node) in &self.known {
            node.parent.iter().for_each(|&parent| children.entry(parent).or_default().push(number));
        }
        let mut found = BTreeSet::new();
        for pattern in patterns {
            let mut waiting: Vec<u32> = match pattern.strip_prefix('#').and_then(|number| number.parse::<u32>().ok()) {
                Some(number) => Some(number).filter(|number| self.known.contains_key(number)).into_iter().collect(),
                None => self.known.keys().copied().filter(|&number| self.is_named(number, pattern)).collect(),
            };
            if waiting.is_empty() {
                let file = path.display();
                bail!(
                    "{file}: no object is named {pattern}; lodpack info --objects lists them, and * stands for any text"
                );
            }
            let mut seen = BTreeSet::new();
            while let Some(number) = waiting.pop() {
                if seen.insert(number) {
                    waiting.extend(children.get(&number).into_iter().flatten());
                }
            }
            found.extend(seen.into_iter().filter(|&number| number < self.objects));
        }
        Ok(found)
    }

    fn is_named(&self, number: u32, pattern: &str) -> bool {
        let Some(node) = self.known.get(&number) else { return false };
        let is_it = |text: &Option<String>| text.as_ref().is_some_and(|text| matches(pattern, text));
        if is_it(&node.name) || is_it(&node.id) {
            return true;
        }
        let (Some(name), true) = (&node.name, pattern.contains('/')) else { return false };
        matches(pattern, &format!("{}/{name}", self.path_above(number)))
    }
}

/// Whether a text is what a pattern with stars stands for.
fn matches(pattern: &str, text: &str) -> bool {
    let Some((first, rest)) = pattern.split_once('*') else { return pattern == text };
    let Some(mut left) = text.strip_prefix(first) else { return false };
    let mut parts: Vec<&str> = rest.split('*').collect();
    let last = parts.pop().unwrap_or_default();
    for part in parts {
        match left.find(part) {
            Some(at) => left = &left[at + part.len()..],
            None => return false,
        }
    }
    left.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stars_stand_for_any_text() {
        for (pattern, text, is_it) in [
            ("BOLT", "BOLT", true),
            ("BOLT", "BOLTS", false),
            ("BOLT*", "BOLT", true),
            ("*-7", "FLANGE-7", true),
            ("*-7", "FLANGE-71", false),
            ("A*/L*/F*", "A/L1/F2", true),
            ("A*A", "A", false),
            ("*", "", true),
            ("a*b*c", "a-b-b-c", true),
            ("a*bb*c", "a-b-b-c", false),
        ] {
            assert_eq!(matches(pattern, text), is_it, "{pattern} {text}");
        }
    }

    #[test]
    fn patterns_name_objects_and_assemblies_all_that_is_in_them() {
        let node = |name: &str, id: Option<&str>, parent| ObjectNode {
            name: Some(name.into()),
            id: id.map(Into::into),
            parent,
        };
        let all = vec![
            node("PIPE", Some("a"), Some(3)),
            node("BOLT", Some("b"), Some(4)),
            node("BOLT", None, Some(0)),
            node("HALL", Some("h"), None),
            node("LINE", None, Some(3)),
        ];
        let nodes = Nodes { known: (0..).zip(all).collect(), objects: 3 };
        let found = |patterns: &[&str]| {
            let patterns: Vec<String> = patterns.iter().map(|&pattern| pattern.into()).collect();
            nodes.matching(Path::new("x"), &patterns).map(|found| found.into_iter().collect::<Vec<u32>>())
        };
        assert_eq!(found(&["HALL"]).unwrap(), [0, 1, 2]);
        assert_eq!(found(&["b", "#2"]).unwrap(), [1, 2]);
        assert_eq!(found(&["BOLT"]).unwrap(), [1, 2]);
        assert_eq!(found(&["HALL/LINE/*"]).unwrap(), [1]);
        assert_eq!(found(&["PIPE"]).unwrap(), [0, 2]);
        assert!(found(&["HALL", "VALVE"]).is_err() && found(&["#5"]).is_err());
    }
}
