//! Objects: what the input named, the tree of assemblies above them, and the islands of leaves that they own (SPEC.md,
//! "Objects").
//!
//! A file with objects has a small section with their number and the roots of six *lists*; pages and directories of
//! these lie in a section of their own, of which a question reads what it needs:
//!
//! - `section`: the small one,
//! - `list`: directories, in which pages are found by number or by key,
//! - `owners`: a page a cluster, with the objects of its leaves,
//! - `page`: names, ids and parents of nodes, and `text`: what foresees their letters,
//! - `pairs`: pages of what is looked for and where it is,
//! - `bits`: what codes them, in both directions,
//! - `filter`: what is drawn of objects,
//! - `open`: what is known of the objects of an open file, and answers; `verify` compares all lists,
//! - `write`: both sections.

mod bits;
mod filter;
mod list;
mod open;
mod owners;
mod page;
mod pairs;
mod section;
mod text;
mod verify;
#[cfg(feature = "write")]
mod write;

pub(crate) use filter::has_filters;
pub use filter::{ObjectChoice, ObjectFilter, ObjectState};
pub(crate) use open::OpenObjects;
pub(crate) use owners::{LeafOwners, LeafShape};
#[cfg(feature = "write")]
pub(crate) use write::ObjectsWriter;

/// Entries of a page and of a directory, but of the last ones of a list.
const PAGE: u32 = 1 << PAGE_LOG2;
const PAGE_LOG2: u32 = 10;
/// The most bytes of a name or an id.
pub(crate) const MOST_BYTES: usize = 4096;
/// The most nodes above a node.
pub(crate) const MOST_ABOVE: u32 = 4096;
/// The most nodes of a file.
const MOST_NODES: u64 = (1 << 31) - 1;

/// What the input named: an object, which leaves hold islands of, or an assembly of others.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ObjectNode {
    /// Its name, if it has one; names may repeat. At most 4096 bytes.
    pub name: Option<String>,
    /// What other programs know it by, if anything; ids may repeat. At most 4096 bytes.
    pub id: Option<String>,
    /// The node that it is a part of, by number.
    pub parent: Option<u32>,
}

/// The hash under which a name or an id is found in a file of some nodes: a CRC-32, of which so many of the highest
/// bits are left that a file of random names has one false hit in sixteen look-ups.
fn hash(text: &str, node_count: u32) -> u32 {
    crc32fast::hash(text.as_bytes()) >> 28_u32.saturating_sub(u32::BITS - node_count.leading_zeros())
}
