//! The top of a region without a border: where its topology needs many triangles, another one takes its place.

use lodpack::write::{BlockRecord, OverviewRecord};

use super::super::coarse::CoarseSurface;
use super::super::overview::{OVERVIEW_TRIANGLES, coded};
use super::super::reduce::reduce;
use super::super::scale::Scale;

/// The step of vertices along the normal over the bound of a reduced surface, at most.
const STEP_PER_BOUND: f64 = 0.25;

/// A coarser block of a top is left out unless it has at most this share of the finer one's triangles.
const WORTHWHILE: f64 = 0.75;

/// Leaves out coarse blocks with hardly fewer triangles than finer ones: there topology decides, not the error.
pub(super) fn leave_out(blocks: &mut [Option<BlockRecord>]) {
    let mut finer = f64::INFINITY;
    for block in blocks.iter_mut().rev() {
        let Some(triangles) = block.as_ref().map(|block| f64::from(block.triangle_count)) else { continue };
        if triangles > finer * WORTHWHILE {
            *block = None;
        } else {
            finer = triangles;
        }
    }
}

/// Replaces the coarsest blocks of a top by one of few triangles, if these have more. `surface` is what it stands for.
pub(super) fn reduce_top(surface: &CoarseSurface, blocks: &mut [Option<BlockRecord>], scale: &Scale) {
    let Some(finest) = blocks.iter().rposition(Option::is_some) else { return };
    if blocks.iter().flatten().all(|block| block.triangle_count as usize > OVERVIEW_TRIANGLES)
        && let Some((reduced, _)) = reduce(surface, OVERVIEW_TRIANGLES)
    {
        let step = |level: usize| scale.step() * (1_u64 << scale.levels[level].quantisation.normal_shift) as f64;
        let is_fine = |&level: &usize| step(level) <= STEP_PER_BOUND * (reduced.error - surface.error);
        let level = (0..=finest).find(is_fine).unwrap_or(finest);
        if let Some(OverviewRecord { error, loops, triangle_count, symbols, .. }) =
            coded(surface, reduced, scale, level)
            && loops.is_empty()
        {
            blocks[..level].fill(None);
            blocks[level] = Some(BlockRecord { error, border_deviation: 0.0, triangle_count, symbols });
        }
    }
}
