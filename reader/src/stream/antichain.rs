//! Whether none of the roots that a session is to draw lies above another.

use std::collections::HashMap;

use super::content::FileContent;
use crate::{
    error::{Error, Result},
    format::records::MAX_LEVELS,
    select::Node,
};

/// The roots of the last cut, and how many of them lie below each root above any. A frame looks only at what has
/// changed.
#[derive(Debug, Default)]
pub(crate) struct Antichain {
    /// Ascending.
    roots: Vec<u32>,
    above: HashMap<u32, u32>,
}

impl Antichain {
    /// Takes the next cut, which is sorted by root. Keeps the last one where that fails.
    ///
    /// # Errors
    /// [`Error::Query`] if one root is above another; [`Error::Missing`] if the index blocks of roots or of those above
    /// them are not known;
    /// [`Error::Format`].
    pub fn set(&mut self, content: &FileContent, nodes: &[Node]) -> Result<()> {
        let roots: Vec<u32> = nodes.iter().map(|node| node.root).collect();
        let (mut added, mut removed) = (Vec::new(), Vec::new());
        let mut before = self.roots.iter().copied().peekable();
        for &root in &roots {
            while let Some(gone) = before.next_if(|&old| old < root) {
                removed.push(gone);
            }
            if before.next_if_eq(&root).is_none() {
                added.push(root);
            }
        }
        removed.extend(before);
        // What may fail comes first.
        let mut branches = Vec::with_capacity(added.len());
        for root in added {
            branches.push((root, branch(content, root)?));
        }
        let gone: Vec<u32> = removed.into_iter().flat_map(|root| branch(content, root).unwrap_or_default()).collect();
        gone.iter().for_each(|&root| self.count(root, false));
        let is_wanted = |root: &u32| roots.binary_search(root).is_ok();
        let mut result = Ok(());
        branches.iter().flat_map(|(_, above)| above).for_each(|&root| self.count(root, true));
        for (root, above) in &branches {
            if self.above.contains_key(root) || above.iter().any(is_wanted) {
                result =
                    Err(Error::Query { what: format!("root {root} and a root above or below it are both in the cut") });
            }
        }
        if result.is_ok() {
            self.roots = roots;
        } else {
            branches.iter().flat_map(|(_, above)| above).for_each(|&root| self.count(root, false));
            gone.iter().for_each(|&root| self.count(root, true));
        }
        result
    }

    fn count(&mut self, root: u32, more: bool) {
        let count = self.above.entry(root).or_default();
        *count = if more { *count + 1 } else { count.saturating_sub(1) };
        if *count == 0 {
            self.above.remove(&root);
        }
    }
}

/// The roots above a root. Makes sure that their levels continue each other, so that there are no more than levels.
fn branch(content: &FileContent, root: u32) -> Result<Vec<u32>> {
    let mut branch = Vec::new();
    let mut below = content.find_blocks(root)?;
    let mut next = content.index().parent(root)?;
    while let Some(root) = next {
        let blocks = content.find_blocks(root)?;
        let (last, first) = (blocks.last().map(|unit| unit.level), below.first().map(|unit| unit.level));
        // In a prefix, a root may have no block.
        let continues = last.zip(first).is_none_or(|(last, first)| last.checked_add(1) == Some(first));
        if !continues || branch.len() > MAX_LEVELS {
            let location = || format!("root {root}");
            return Err(Error::format("the levels of a root's children do not continue its own").at(location));
        }
        branch.push(root);
        (below, next) = (blocks, content.index().parent(root)?);
    }
    Ok(branch)
}
