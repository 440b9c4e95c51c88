//! Verifying objects: every rule of their sections, and that islands have the owners that the file says.

use crate::{
    error::{Error, Result},
    file::File,
    format::header::kind,
    islands::islands,
    source::ReadAt,
};

impl<S: ReadAt> File<S> {
    /// Reads all lists of objects and compares them with one another.
    pub(super) fn verify_object_lists(&self) -> Result<()> {
        let Some(objects) = self.index().objects() else { return Ok(()) };
        let open = objects.open();
        let mut shapes = |cluster: u32, first: u32| {
            self.load_indices([cluster])?;
            let owners = self.ask(|_, fetched| objects.cluster(cluster, fetched))?;
            let is_first = |&object: &u32| object < first;
            let mut further: Vec<u32> =
                owners.0.iter().flat_map(|leaf| &leaf.objects).copied().filter(is_first).collect();
            further.sort_unstable();
            further.dedup();
            for leaf in &owners.0 {
                let mut sorted = leaf.objects.clone();
                sorted.sort_unstable();
                if sorted.windows(2).any(|pair| pair[0] == pair[1]) {
                    let location = || format!("objects, owners of cluster {cluster}");
                    return Err(Error::format("a leaf names an object twice").at(location));
                }
            }
            Ok((further, owners.1))
        };
        let ask = |question: &mut dyn FnMut(&crate::Fetched) -> Result<()>| self.ask(|_, fetched| question(fetched));
        open.verify(&mut shapes, &ask).map_err(|error| error.at(|| format!("section {}", kind::name(kind::OBJECTS))))
    }

    /// Decodes all blocks of leaves, and checks that the file names an owner for each island, and no others; and that
    /// every object has an island.
    pub(super) fn verify_owners(&self) -> Result<()> {
        let Some(objects) = self.index().objects() else { return Ok(()) };
        let mut is_seen = vec![];
        for cluster in 0..self.index().cluster_count() {
            let owners = self.ask(|_, fetched| objects.cluster(cluster, fetched))?;
            is_seen.resize(owners.1 as usize, false);
            for (root, leaf) in objects.leaves_of(cluster)?.into_iter().zip(&owners.0) {
                for (block, entry) in self.root_entry(root)?.blocks.iter().enumerate() {
                    if usize::from(entry.level) >= self.level_count() {
                        continue;
                    }
                    let location = || format!("root {root}, level {}", entry.level);
                    let patch = self.decode_root(root, entry.level)?.patch;
                    let of_block = leaf.of_block(block);
                    if islands(&patch.triangles).1 as usize != of_block.len() {
                        return Err(Error::format("a block has other islands than owners").at(location));
                    }
                    for owner in of_block {
                        is_seen.get_mut(owner as usize).into_iter().for_each(|seen| *seen = true);
                    }
                }
            }
        }
        // Of a prefix some are in no block yet.
        let is_whole = self.level_count() == self.index().levels().levels.len();
        match is_seen.iter().position(|seen| !seen).filter(|_| is_whole) {
            Some(object) => Err(Error::format("an object has no island").at(|| format!("object {object}"))),
            None => Ok(()),
        }
    }
}
