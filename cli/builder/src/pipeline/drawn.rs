//! What is drawn of a root: its patches by level, and which of them where all that is drawn is of one level.

use lodpack::LatticePoint;
use lodpack::write::{Model, RootRecord};
use serde::{Deserialize, Serialize};

/// A patch as it decodes: its border, then its inside.
#[derive(Clone, Debug, Default)]
pub(super) struct DrawnPatch {
    pub positions: Vec<LatticePoint>,
    pub triangles: Vec<[u32; 3]>,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
}

/// The patches of a root by level; empty where they are not wanted.
pub(super) type DrawnBlocks = Vec<Option<DrawnPatch>>;

/// A region with all roots drawn at one level: its triangles, and the largest error that the file stores.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct DrawnLevel {
    pub triangles: u64,
    pub error: f64,
}

/// Which roots are drawn where all that is drawn is of one level, and at which level.
pub(super) fn drawn_at(model: &Model, level: usize) -> Vec<(u32, usize)> {
    let mut is_group = vec![false; model.roots.len()];
    model.roots.iter().filter_map(|root| root.parent).for_each(|parent| is_group[parent as usize] = true);
    let drawn = |(number, root): (u32, &RootRecord)| {
        let coarser = root.blocks[..=level].iter().rposition(Option::is_some);
        let at = match root.parent {
            None => coarser.or_else(|| root.blocks.iter().position(Option::is_some)),
            Some(_) => coarser,
        }?;
        let is_finest = root.blocks.iter().rposition(Option::is_some).is_some_and(|finest| finest < level);
        (!is_group[number as usize] || !is_finest).then_some((number, at))
    };
    (0..).zip(&model.roots).filter_map(drawn).collect()
}

/// Adds up a level as a file does (SPEC.md, "Levels"). A root that lacks the level is drawn coarser, perhaps beside a
/// finer neighbour.
pub(super) fn drawn(model: &Model, level: usize) -> lodpack::Result<DrawnLevel> {
    let mut sum = DrawnLevel::default();
    for (root, at) in drawn_at(model, level) {
        let Some(block) = &model.roots[root as usize].blocks[at] else { continue };
        let deviation = if at < level { block.border_deviation } else { 0.0 };
        sum.triangles += u64::from(block.triangle_count);
        sum.error = sum.error.max(lodpack::write::stored_error(block.error, deviation, &model.lattice)?);
    }
    Ok(sum)
}
