//! Everything in the sections of objects, compared with one another.

use std::collections::BTreeSet;

use super::{
    MOST_ABOVE, OpenObjects, hash,
    list::{self, ListKind},
    pairs::Pair,
};
use crate::{
    error::{Error, Result},
    source::Fetched,
};

/// Asks a question until what it needs has been read.
type Ask<'a> = dyn Fn(&mut dyn FnMut(&Fetched) -> Result<()>) -> Result<()> + 'a;
/// Of a cluster, given the first object that is new in it: those of its leaves that are not, and the first object after
/// all of them.
type Owners<'a> = dyn FnMut(u32, u32) -> Result<(Vec<u32>, u32)> + 'a;

impl OpenObjects {
    /// Reads all lists, and checks that parts fill the section in their order, that keys are those of pages, and that
    /// each list says what the others do.
    pub fn verify(&self, owners: &mut Owners<'_>, ask: &Ask<'_>) -> Result<()> {
        self.verify_places(ask)?;
        let mut further = self.verify_owners(owners, ask)?;
        let mut found: [Vec<Pair>; 3] = Default::default();
        let mut parents = vec![];
        for page in 0..self.pages(ListKind::Nodes) {
            let nodes = get(ask, |fetched| self.nodes(page, fetched))?;
            for node in nodes.iter() {
                found[0].extend(node.name.as_deref().map(|name| (hash(name, self.head.nodes), page)));
                found[1].extend(node.id.as_deref().map(|id| (hash(id, self.head.nodes), page)));
                found[2].push((node.parent.map_or(0, |parent| parent + 1), page));
                parents.push(node.parent);
            }
        }
        self.verify_parents(&parents)?;
        further.sort_unstable();
        let [names, ids, children] = &mut found;
        for (kind, found) in [
            (ListKind::Names, names),
            (ListKind::Ids, ids),
            (ListKind::Children, children),
            (ListKind::Further, &mut further),
        ] {
            found.sort_unstable();
            found.dedup();
            self.verify_pairs(kind, found, ask)?;
        }
        Ok(())
    }

    /// Parts follow each other without gaps: roots, then list by list directories and pages.
    fn verify_places(&self, ask: &Ask<'_>) -> Result<()> {
        let gap = || Error::format("there is a gap between parts of lists of objects, or they overlap");
        let mut next: u64 = self.head.roots.iter().map(|part| part.length).sum();
        for kind in ListKind::ALL {
            let pages = self.pages(kind);
            for height in (1..=list::height(pages)).rev() {
                for number in 0..list::count_at(pages, height) {
                    let entries = get(ask, |fetched| self.directory(kind, height, number, fetched))?;
                    for entry in entries.iter() {
                        if entry.part.offset != next {
                            return Err(gap().at(|| format!("objects, list of {}", kind.name())));
                        }
                        next += entry.part.length;
                    }
                    if entries.windows(2).any(|pair| pair[0].key > pair[1].key) {
                        return Err(Error::format("keys of a list of objects do not ascend"));
                    }
                }
            }
        }
        if next == self.section_bytes() { Ok(()) } else { Err(gap().at(|| "end of section object pages".to_string())) }
    }

    /// Returns in which clusters objects are beside the first one.
    fn verify_owners(&self, owners: &mut Owners<'_>, ask: &Ask<'_>) -> Result<Vec<Pair>> {
        let (mut further, mut next) = (vec![], 0);
        for cluster in 0..self.pages(ListKind::Owners) {
            let first = get(ask, |fetched| self.entry(ListKind::Owners, cluster, fetched))?.key;
            if first != next {
                let what = "the owners of a cluster do not begin with the object that its entry says";
                return Err(Error::format(what).at(|| format!("objects, owners of cluster {cluster}")));
            }
            let (of_cluster, end) = owners(cluster, first)?;
            further.extend(of_cluster.into_iter().map(|object| (object, cluster)));
            next = end;
        }
        match next == self.head.objects {
            true => Ok(further),
            false => Err(Error::format("there are objects that no leaf holds").at(|| "section objects".to_string())),
        }
    }

    fn verify_pairs(&self, kind: ListKind, wanted: &[Pair], ask: &Ask<'_>) -> Result<()> {
        let location = || format!("objects, list of {}", kind.name());
        let mut wanted = wanted.iter();
        for page in 0..self.pages(kind) {
            let pairs = get(ask, |fetched| self.pair_page(kind, page, fetched))?;
            if !pairs.iter().all(|pair| wanted.next() == Some(pair)) {
                return Err(Error::format("something is looked for where it is not").at(location));
            }
        }
        match wanted.next() {
            None => Ok(()),
            Some(_) => Err(Error::format("something is not found where it is").at(location)),
        }
    }

    /// Checks that each node leads to one without a parent.
    fn verify_parents(&self, parents: &[Option<u32>]) -> Result<()> {
        let mut is_assembly = BTreeSet::from_iter(self.head.objects..self.head.nodes);
        let mut depths = vec![u32::MAX; parents.len()];
        let mut path = vec![];
        for node in 0..parents.len() {
            let (mut at, mut depth) = (Some(node as u32), 0);
            while let Some(node) = at {
                let known = depths.get(node as usize).copied().unwrap_or(0);
                if known != u32::MAX {
                    depth = known + 1;
                    break;
                }
                path.push(node);
                at = parents.get(node as usize).copied().flatten();
                if path.len() > MOST_ABOVE as usize + 1 {
                    break;
                }
            }
            if path.len() as u64 + u64::from(depth) > u64::from(MOST_ABOVE) + 1 {
                let what = "nodes lie above one another in a circle, or more than 4096 deep";
                return Err(Error::format(what).at(|| format!("objects, node {node}")));
            }
            while let Some(node) = path.pop() {
                depths[node as usize] = depth;
                depth += 1;
            }
            parents[node].iter().for_each(|parent| _ = is_assembly.remove(parent));
        }
        match is_assembly.first() {
            None => Ok(()),
            Some(node) => Err(Error::format("an assembly has no parts").at(|| format!("objects, node {node}"))),
        }
    }
}

/// An answer, once what it needs has been read.
fn get<T>(ask: &Ask<'_>, mut question: impl FnMut(&Fetched) -> Result<T>) -> Result<T> {
    let mut answer = None;
    ask(&mut |fetched| {
        answer = Some(question(fetched)?);
        Ok(())
    })?;
    answer.ok_or_else(|| Error::format("a list of objects has no answer"))
}
