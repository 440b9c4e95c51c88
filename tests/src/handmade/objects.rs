//! Sections OBJECTS and OBJECT_PAGES (SPEC.md, chapter 24), bit by bit.

use super::{CLUSTERS, Container, OBJECT_PAGES, OBJECTS, PAGES, Section};
use std::collections::HashMap;

/// What is coded, with the name of the chances that it uses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Symbol {
    /// A bit.
    Bit(&'static str, bool),
    /// An unsigned number.
    Number(&'static str, u32),
    /// A signed one.
    Signed(&'static str, i32),
    /// Bits of equal probabilities.
    Raw(u32, u32),
}

/// A list of at most 1024 pages: the first key of each, and its bytes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HandmadeList {
    /// Whether entries have keys.
    pub has_keys: bool,
    /// Pages.
    pub pages: Vec<(u32, Vec<u8>)>,
    /// Bytes behind the directory's last entry.
    pub excess: Vec<u8>,
    /// What the directory's offset is off by.
    pub offset_excess: u64,
}

/// Objects of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct HandmadeObjects {
    /// Numbers of objects and of assemblies.
    pub counts: [u64; 2],
    /// Of each list of pairs, how many it has.
    pub pairs: [u64; 4],
    /// Owners, nodes, names, ids, children, further clusters.
    pub lists: [HandmadeList; 6],
    /// Bytes behind OBJECTS, and behind OBJECT_PAGES.
    pub excess: [Vec<u8>; 2],
    /// What checksums of roots are off by.
    pub checksum_excess: u32,
}

/// Codes symbols.
pub fn coded(symbols: &[Symbol]) -> Vec<u8> {
    let mut coder = Coder { low: 0, range: u32::MAX, bytes: vec![], chances: HashMap::new() };
    for &symbol in symbols {
        match symbol {
            Symbol::Bit(name, bit) => coder.bit((name, 0), bit),
            Symbol::Number(name, value) => coder.number(name, value),
            Symbol::Signed(name, value) => coder.number(name, (value << 1 ^ value >> 31) as u32),
            Symbol::Raw(count, value) => coder.raw(count, value),
        }
    }
    coder.bytes.extend((coder.low as u32).to_be_bytes());
    coder.bytes
}

struct Coder {
    low: u64,
    range: u32,
    bytes: Vec<u8>,
    chances: HashMap<(&'static str, u32), [u32; 2]>,
}

impl Coder {
    fn narrow(&mut self, bound: u32, is_below: bool) {
        if is_below {
            self.range = bound;
        } else {
            self.low += u64::from(bound);
            self.range -= bound;
        }
        if self.low >> 32 > 0 {
            self.low &= 0xffff_ffff;
            for byte in self.bytes.iter_mut().rev() {
                *byte = byte.wrapping_add(1);
                if *byte > 0 {
                    break;
                }
            }
        }
        while self.range < 1 << 24 {
            self.bytes.push((self.low >> 24) as u8);
            self.low = self.low << 8 & 0xffff_ffff;
            self.range <<= 8;
        }
    }

    fn bit(&mut self, chance: (&'static str, u32), bit: bool) {
        let [fast, slow] = *self.chances.entry(chance).or_insert([1 << 15; 2]);
        self.narrow((self.range >> 12) * ((fast + slow) >> 5), !bit);
        let learned = |estimate: u32, rate: u32| {
            if bit { estimate - (estimate >> rate) } else { estimate + ((65535 - estimate) >> rate) }
        };
        self.chances.insert(chance, [learned(fast, 4), learned(slow, 7)]);
    }

    fn raw(&mut self, count: u32, value: u32) {
        (0..count).rev().for_each(|k| self.narrow(self.range >> 1, value >> k & 1 == 0));
    }

    fn number(&mut self, name: &'static str, value: u32) {
        for unary in 0..16 {
            self.bit((name, 1 + unary), value > unary);
            if value == unary {
                return;
            }
        }
        let rest = value - 15;
        let length = rest.ilog2();
        (0..length).for_each(|k| self.bit((name, 17 + k), true));
        self.bit((name, 17 + length), false);
        self.raw(length, rest - (1 << length));
    }
}

fn put_varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn put_part(bytes: &mut Vec<u8>, part: &[u8], excess: u32) {
    put_varint(bytes, part.len() as u64);
    if !part.is_empty() {
        bytes.extend(crc32fast::hash(part).wrapping_add(excess).to_le_bytes());
    }
}

impl HandmadeList {
    /// The root, which says that the first page lies at `first`.
    fn root(&self, first: u64) -> Vec<u8> {
        if self.pages.is_empty() {
            return vec![];
        }
        let mut bytes = (first + self.offset_excess).to_le_bytes().to_vec();
        let mut before = 0;
        for (key, page) in &self.pages {
            if self.has_keys {
                put_varint(&mut bytes, (*key - before).into());
                before = *key;
            }
            put_part(&mut bytes, page, 0);
        }
        [bytes, self.excess.clone()].concat()
    }
}

impl HandmadeObjects {
    /// The worked example's triangle as an object without a name in two assemblies, one in the other.
    pub fn example() -> Self {
        use Symbol::{Bit, Number, Signed};
        let owners = [Number("count", 1), Bit("new", true), Signed("first", 0), Signed("later", 0)];
        // Object 0 lies in node 2, node 1 in nothing, and node 2 in node 1. Neither names nor ids.
        let mut nodes = vec![Number("rank", 1), Signed("parent", 2), Number("rank", 1), Number("rank", 2)];
        nodes.push(Signed("parent", -1));
        nodes.extend(["name", "id"].iter().flat_map(|name| [Bit(name, false); 3]));
        // Pairs of parents: nothing, node 1, node 2, all in page 0.
        let children =
            [Signed("place", 0), Number("step", 2), Signed("place", 0), Number("step", 1), Signed("place", 0)];
        let list = |page: Vec<Symbol>| HandmadeList {
            has_keys: true,
            pages: vec![(0, coded(&page))],
            ..HandmadeList::default()
        };
        let mut lists = [
            list(owners.to_vec()),
            list(nodes),
            HandmadeList::default(),
            HandmadeList::default(),
            list(children.to_vec()),
            HandmadeList::default(),
        ];
        lists[1].has_keys = false;
        Self { counts: [1, 2], pairs: [0, 0, 3, 0], lists, ..Self::default() }
    }

    /// Puts it into a file, in place of the objects that it may have.
    pub fn put_into(&self, mut container: Container) -> Container {
        let lengths: u64 = self.lists.iter().map(|list| list.root(0).len() as u64).sum();
        let mut section = vec![];
        self.counts.iter().chain(&self.pairs).for_each(|&count| put_varint(&mut section, count));
        let (mut next, mut roots, mut pages) = (lengths, vec![], vec![]);
        for list in &self.lists {
            let root = list.root(next);
            put_part(&mut section, &root, self.checksum_excess);
            roots.extend(root);
            for (_, page) in &list.pages {
                next += page.len() as u64;
                pages.extend(page);
            }
        }
        section.extend(&self.excess[0]);
        pages.extend(&self.excess[1]);
        container.version[1] = container.version[1].max(6);
        container.sections.retain(|section| ![OBJECTS, OBJECT_PAGES].contains(&section.kind));
        let place = |container: &Container, kind: u32| {
            container.sections.iter().position(|section| section.kind == kind).unwrap_or(container.sections.len())
        };
        let at = place(&container, CLUSTERS);
        container.sections.insert(at, Section { kind: OBJECTS, flags: 0, content: section, reserved: 0 });
        let at = place(&container, PAGES);
        let content = [roots, pages].concat();
        container.sections.insert(at, Section { kind: OBJECT_PAGES, flags: 2, content, reserved: 0 });
        container
    }
}
