//! Pages of nodes: parents, then names, then ids (SPEC.md, "Pages of nodes").

use std::collections::HashMap;

use super::{
    ObjectNode, PAGE, PAGE_LOG2,
    bits::{Bits, Flag},
    text::Texts,
};
#[cfg(feature = "write")]
use crate::codec::texels::binary::BitEncoder;
use crate::{
    codec::texels::binary::{BitDecoder, NumberChances},
    error::{Error, Result},
    limits::{Limits, within},
};

/// Parents that are remembered.
const RECENT: usize = 16;

/// What concerns all pages of a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nodes {
    pub objects: u32,
    pub all: u32,
}

impl Nodes {
    /// How many pages there are.
    pub fn pages(self) -> u32 {
        self.all.div_ceil(PAGE)
    }

    /// How many nodes a page has.
    fn of_page(self, page: u32) -> u32 {
        self.all.saturating_sub(page << PAGE_LOG2).min(PAGE)
    }

    /// Writes a page.
    #[cfg(feature = "write")]
    pub fn write(self, nodes: &[ObjectNode]) -> Result<Vec<u8>> {
        let mut bits = BitEncoder::new();
        self.code(&mut bits, nodes, nodes.len(), usize::MAX)?;
        Ok(bits.finish())
    }

    /// Reads a page.
    pub fn parse(self, page: u32, bytes: &[u8], limits: &Limits) -> Result<Vec<ObjectNode>> {
        let mut bits = BitDecoder::new(bytes);
        let most = usize::try_from(limits.part_bytes).unwrap_or(usize::MAX);
        let nodes = self.code(&mut bits, &[], self.of_page(page) as usize, most)?;
        bits.finish()?;
        Ok(nodes)
    }

    fn code(self, bits: &mut impl Bits, given: &[ObjectNode], count: usize, most: usize) -> Result<Vec<ObjectNode>> {
        let mut nodes = Vec::new();
        let (mut parents, mut texts) = (Parents::new(self), Texts::default());
        for number in 0..count {
            let parent = given.get(number).and_then(|node| node.parent).map_or(0, |parent| parent + 1);
            let parent = parents.code(bits, parent)?;
            bits.check()?;
            nodes.push(ObjectNode { parent: parent.checked_sub(1), ..ObjectNode::default() });
        }
        let mut bytes = 0;
        for field in 0..2_u32 {
            let mut has = Flag::default();
            let mut similar: HashMap<Option<u32>, Vec<u8>> = HashMap::new();
            let mut before = Vec::new();
            for (number, node) in nodes.iter_mut().enumerate() {
                let given = given.get(number).and_then(|node| if field == 0 { &node.name } else { &node.id }.as_ref());
                if !has.code(bits, given.is_some()) {
                    bits.check()?;
                    continue;
                }
                let reference = similar.get(&node.parent).unwrap_or(&before);
                let text = texts.code(bits, field, reference, given.map_or(&[], |text| text.as_bytes()))?;
                bytes += text.len();
                within(most as u64, bytes as u64, "size of the names of a page")?;
                similar.insert(node.parent, text.clone());
                before = text.clone();
                let text = String::from_utf8(text).map_err(|_| Error::format("a name or an id is not UTF-8"))?;
                *(if field == 0 { &mut node.name } else { &mut node.id }) = Some(text);
            }
        }
        Ok(nodes)
    }
}

/// Parents of nodes: mostly one of those that came last.
struct Parents {
    nodes: Nodes,
    recent: Vec<u32>,
    ranks: [NumberChances; 2],
    is_first: bool,
    other: NumberChances,
    last_new: u32,
}

impl Parents {
    fn new(nodes: Nodes) -> Self {
        Self {
            nodes,
            recent: vec![0],
            ranks: Default::default(),
            is_first: false,
            other: NumberChances::default(),
            last_new: nodes.objects,
        }
    }

    /// Codes a parent: its number plus 1, or 0 for none.
    fn code(&mut self, bits: &mut impl Bits, parent: u32) -> Result<u32> {
        let rank = self.recent.iter().position(|&recent| recent == parent).unwrap_or(self.recent.len());
        let rank = bits.number(&mut self.ranks[usize::from(self.is_first)], rank as u32)? as usize;
        self.is_first = rank == 0;
        let parent = match self.recent.get(rank) {
            Some(&parent) => {
                self.recent.remove(rank);
                parent
            }
            None if rank == self.recent.len() => {
                let step = bits.signed(&mut self.other, (i64::from(parent) - i64::from(self.last_new)) as i32)?;
                let parent = u32::try_from(i64::from(self.last_new) + i64::from(step)).ok();
                let parent = parent.filter(|&parent| parent <= self.nodes.all);
                self.last_new = parent.ok_or_else(|| Error::format("a parent does not exist"))?;
                self.recent.truncate(RECENT - 1);
                self.last_new
            }
            None => return Err(Error::format("a parent does not exist")),
        };
        self.recent.insert(0, parent);
        Ok(parent)
    }
}

/// Why a file cannot have a node, if it cannot.
#[cfg(feature = "write")]
pub(super) fn fault(node: &ObjectNode) -> Option<String> {
    let bytes = [&node.name, &node.id].into_iter().flatten().map(String::len).max().unwrap_or(0);
    let most = super::MOST_BYTES;
    (bytes > most).then(|| format!("a name or an id of an object has {bytes} bytes, more than {most}"))
}

#[cfg(all(test, feature = "write"))]
mod tests {
    use super::super::MOST_BYTES;
    use super::*;

    fn nodes(names: &[Option<&str>]) -> Vec<ObjectNode> {
        let node = |(number, name): (usize, &Option<&str>)| ObjectNode {
            name: name.map(Into::into),
            id: (number % 2 == 0).then(|| format!("{number:x}-é")),
            parent: (number % 3 > 0).then_some((number * 7 % names.len()) as u32),
        };
        names.iter().enumerate().map(node).collect()
    }

    #[test]
    fn pages_come_back_and_short_ones_are_refused() {
        let long = "-x/".repeat(1365);
        let names = [Some(""), None, Some("BOLT"), Some("BOLT"), Some("螺栓"), Some(&long), Some("A-1"), Some("A-2")];
        let nodes = nodes(&names);
        let of = Nodes { objects: 5, all: nodes.len() as u32 };
        let limits = Limits::default();
        let bytes = of.write(&nodes).unwrap();
        assert_eq!(of.parse(0, &bytes, &limits).unwrap(), nodes);
        assert!(of.parse(0, &[&bytes[..], &[7; 8]].concat(), &limits).is_err());
        assert!(of.parse(0, &bytes[..bytes.len() / 2], &limits).is_err());
        assert!(of.parse(0, &bytes, &Limits { part_bytes: 1000, ..limits }).is_err());
    }

    #[test]
    fn texts_that_are_not_utf8_or_too_long_are_refused() {
        let page = |text: &[u8]| {
            let mut bits = BitEncoder::new();
            let of = Nodes { objects: 1, all: 1 };
            Parents::new(of).code(&mut bits, 0).unwrap();
            Flag::default().code(&mut bits, true);
            let coded = Texts::default().code(&mut bits, 0, &[], text);
            Flag::default().code(&mut bits, false);
            coded.and_then(|_| of.parse(0, &bits.finish(), &Limits::default()))
        };
        assert_eq!(page("é".as_bytes()).unwrap()[0].name.as_deref(), Some("é"));
        assert!(page(&[0xc3]).unwrap_err().to_string().contains("UTF-8"));
        assert!(page(&[b'x'; MOST_BYTES]).is_ok() && page(&[b'x'; MOST_BYTES + 1]).is_err());
    }

    /// Bytes of pages against `xz -9` of the list of names: see tests/RESULTS.md.
    #[test]
    #[ignore = "a measurement, of a list that LODPACK_NAMES names"]
    fn bytes_of_names() {
        let Ok(path) = std::env::var("LODPACK_NAMES") else { return };
        let text = std::fs::read_to_string(path).unwrap();
        let nodes: Vec<ObjectNode> = text
            .lines()
            .map(|line| {
                let mut fields =
                    line.split('\t').map(|field| Some(field.to_string()).filter(|field| !field.is_empty()));
                let [name, id, parent] = [(); 3].map(|()| fields.next().flatten());
                ObjectNode { name, id, parent: parent.map(|parent| parent.parse().unwrap()) }
            })
            .collect();
        let objects = nodes.iter().filter_map(|node| node.parent).min().unwrap();
        let of = Nodes { objects, all: nodes.len() as u32 };
        let bytes = |nodes: &[ObjectNode]| -> usize {
            nodes.chunks(PAGE as usize).map(|page| of.write(page).unwrap().len()).sum()
        };
        let without = |name: bool, id: bool| {
            let keep = |node: &ObjectNode| ObjectNode {
                name: node.name.clone().filter(|_| name),
                id: node.id.clone().filter(|_| id),
                parent: node.parent,
            };
            bytes(&nodes.iter().map(keep).collect::<Vec<_>>())
        };
        let (all, parents) = (bytes(&nodes), without(false, false));
        let names = without(true, false) - parents;
        eprintln!("{} nodes: {all} bytes, of them names {names}, parents {parents}", nodes.len());
    }
}
