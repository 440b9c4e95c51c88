//! The small section OBJECTS: how many there are, and the roots of the lists (SPEC.md, "Section OBJECTS").

use super::{MOST_NODES, list::ListKind, page::Nodes, pairs::Pairs};
#[cfg(feature = "write")]
use crate::codec::bytes::put_varint;
use crate::{
    codec::bytes::Cursor,
    error::{Error, Result},
    format::sections::Part,
    limits::Limits,
};

/// What the section says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Head {
    pub objects: u32,
    pub nodes: u32,
    /// Of each list of pairs, how many it has.
    pub pairs: [u32; 4],
    /// The root of each list.
    pub roots: [Part; 6],
}

impl Head {
    #[cfg(feature = "write")]
    pub fn write(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        put_varint(&mut bytes, self.objects.into());
        put_varint(&mut bytes, (self.nodes - self.objects).into());
        self.pairs.iter().for_each(|&count| put_varint(&mut bytes, count.into()));
        self.roots.iter().for_each(|part| part.write(&mut bytes));
        bytes
    }

    pub fn parse(bytes: &[u8], limits: &Limits) -> Result<Self> {
        const TOO_MANY: &str = "there are no objects, or more than a file can have";
        let mut cursor = Cursor::new(bytes);
        let objects = cursor.varint_up_to(MOST_NODES, TOO_MANY)?;
        let nodes = objects + cursor.varint_up_to(MOST_NODES - objects, TOO_MANY)?;
        if objects == 0 {
            return Err(Error::format(TOO_MANY));
        }
        let mut pairs = [0; 4];
        for (number, count) in pairs.iter_mut().enumerate() {
            // What is in further clusters may be more.
            let most = if number < 3 { nodes } else { u32::MAX.into() };
            *count = cursor.varint_up_to(most, "there are more places of objects than objects")? as u32;
        }
        let mut next = 0;
        let mut roots = [Part::default(); 6];
        for part in &mut roots {
            *part = Part::parse(&mut cursor, &mut next, limits)?;
        }
        cursor.finish()?;
        let this = Self { objects: objects as u32, nodes: nodes as u32, pairs, roots };
        let is_empty = |kind: &ListKind| this.pairs(*kind).is_some_and(|pairs| pairs.count == 0);
        if ListKind::ALL.iter().zip(&roots).any(|(kind, root)| is_empty(kind) != (root.length == 0)) {
            return Err(Error::format("a list of objects is empty, or is not and has no root"));
        }
        Ok(this)
    }

    /// What concerns all pages of nodes.
    pub fn of_nodes(&self) -> Nodes {
        Nodes { objects: self.objects, all: self.nodes }
    }

    /// What concerns all pages of a list of pairs; its places are not known here where they are clusters.
    pub fn pairs(&self, kind: ListKind) -> Option<Pairs> {
        let number = match kind {
            ListKind::Owners | ListKind::Nodes => return None,
            ListKind::Names => 0,
            ListKind::Ids => 1,
            ListKind::Children => 2,
            ListKind::Further => 3,
        };
        let places = if kind == ListKind::Further { u32::MAX } else { self.of_nodes().pages() };
        Some(Pairs { count: self.pairs[number], places, are_hashes: number < 2 })
    }
}
