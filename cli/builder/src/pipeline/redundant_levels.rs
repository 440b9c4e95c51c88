//! Levels that a file does not need. The lengths of a build decide how many levels there may be; only its roots show
//! whether each of them adds anything.

use lodpack::write::Model;

/// Removes every level that adds nothing to the coarser one, and every level whose blocks each have as many triangles
/// as at the next finer level, since it would only be less exact. The levels that stay draw the same as before.
pub(super) fn remove_redundant_levels(model: &mut Model) {
    for finer in (1..model.levels.len()).rev() {
        // Samples are coded against those of coarser levels, so two levels that both have samples cannot become one.
        if model.arcs.iter().flat_map(|arc| &arc.samples).any(|sample| usize::from(sample.level) == finer) {
            continue;
        }
        if model.roots.iter().all(|root| root.blocks[finer].is_none()) {
            // The coarser level is as exact as this one had to be.
            model.levels[finer - 1].tolerance = model.levels[finer].tolerance;
            remove_level(model, finer, finer);
        } else if !model.roots.is_empty() && model.roots.iter().all(|root| is_as_large(root, finer)) {
            remove_level(model, finer - 1, finer);
        }
    }
}

/// Removes the coarsest levels of a tree at which nothing has a block.
pub(super) fn remove_empty_levels(model: &mut Model) {
    // Samples are coded against those of coarser levels, so two levels that both have samples cannot become one.
    let has_samples =
        |model: &Model, level: u8| model.arcs.iter().flat_map(|arc| &arc.samples).any(|s| s.level == level);
    while model.levels.len() > 1
        && model.roots.iter().all(|root| root.blocks[0].is_none())
        && !(has_samples(model, 0) && has_samples(model, 1))
    {
        remove_level(model, 0, 1);
        model.corner_levels.iter_mut().for_each(|level| *level = level.saturating_sub(1));
    }
}

/// Whether a root that has a block at the next coarser level has as many triangles here.
fn is_as_large(root: &lodpack::write::RootRecord, finer: usize) -> bool {
    match (&root.blocks[finer - 1], &root.blocks[finer]) {
        // Nested fillings build on coarser levels.
        (Some(coarser), Some(finer)) => !root.filling.is_nested() && coarser.triangle_count == finer.triangle_count,
        (None, _) => true,
        (Some(_), None) => false,
    }
}

/// Removes a level and all its blocks. Samples of `first_moved` and finer levels move to the next coarser one.
fn remove_level(model: &mut Model, level: usize, first_moved: usize) {
    model.levels.remove(level);
    for root in &mut model.roots {
        root.blocks.remove(level);
    }
    for sample in model.arcs.iter_mut().flat_map(|arc| &mut arc.samples) {
        sample.level -= u8::from(usize::from(sample.level) >= first_moved);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use lodpack::{
        decode::PARAM_END,
        index::Filling,
        write::{ArcRecord, BlockRecord, LevelInfo, RootRecord, WantedSample, quantise_arc},
    };

    /// Two roots with `triangles` by level (0 for no block), and an arc with a sample at each of the levels in
    /// `samples`.
    fn model(triangles: [[u32; 4]; 2], samples: &[u8]) -> Model {
        let root = |counts: [u32; 4]| RootRecord {
            blocks: counts
                .map(|triangle_count| {
                    (triangle_count > 0).then(|| BlockRecord { triangle_count, ..Default::default() })
                })
                .to_vec(),
            ..RootRecord::default()
        };
        let wanted = samples.iter().rev().zip((1..=samples.len()).rev());
        let wanted: Vec<WantedSample> = wanted
            .map(|(&level, halvings)| WantedSample { param: PARAM_END >> halvings, level, position: [0.0; 3] })
            .collect();
        let samples = quantise_arc([[0; 3], [1 << 10, 0, 0]], &wanted, 0).expect("close to each other");
        Model {
            levels: [8.0, 4.0, 2.0, 1.0].map(|tolerance| LevelInfo { tolerance, ..LevelInfo::default() }).to_vec(),
            arcs: vec![ArcRecord { ends: [0, 1], samples }],
            roots: triangles.map(root).to_vec(),
            ..Model::default()
        }
    }

    /// Tolerances, triangles of the first root, levels of samples.
    fn left(mut model: Model) -> (Vec<f64>, Vec<u32>, Vec<u8>) {
        remove_redundant_levels(&mut model);
        let counts = |block: &Option<BlockRecord>| block.as_ref().map_or(0, |block| block.triangle_count);
        (
            model.levels.iter().map(|level| level.tolerance).collect(),
            model.roots[0].blocks.iter().map(counts).collect(),
            model.arcs[0].samples.iter().rev().map(|sample| sample.level).collect(),
        )
    }

    #[test]
    fn levels_without_anything_are_removed_and_leave_their_tolerance() {
        assert_eq!(left(model([[1, 0, 0, 0]; 2], &[])), (vec![1.0], vec![1], vec![]));
        assert_eq!(left(model([[1, 0, 5, 0]; 2], &[0, 2])), (vec![4.0, 1.0], vec![1, 5], vec![0, 1]));
    }

    #[test]
    fn levels_of_as_many_triangles_as_the_next_finer_one_are_removed() {
        assert_eq!(left(model([[12; 4]; 2], &[])), (vec![1.0], vec![12], vec![]));
        assert_eq!(
            left(model([[12, 12, 14, 14]; 2], &[0, 1, 2])),
            (vec![8.0, 4.0, 1.0], vec![12, 12, 14], vec![0, 1, 2])
        );
        assert_eq!(left(model([[1, 3, 9, 9]; 2], &[2])), (vec![8.0, 4.0, 1.0], vec![1, 3, 9], vec![2]));
    }

    #[test]
    fn levels_that_any_root_or_arc_needs_stay() {
        for (triangles, samples) in [
            ([[1, 2, 3, 4]; 2], &[][..]),
            ([[1, 0, 0, 4], [1, 2, 3, 0]], &[]),
            ([[5; 4], [5, 6, 7, 8]], &[]),
            ([[5; 4]; 2], &[1, 2, 3]),
        ] {
            assert_eq!(left(model(triangles, samples)).0.len(), 4, "{triangles:?}");
        }
        let mut grids = model([[5; 4]; 2], &[]);
        grids.roots.iter_mut().for_each(|root| root.filling = Filling::Grid);
        assert_eq!(left(grids).0.len(), 4);
    }
}
