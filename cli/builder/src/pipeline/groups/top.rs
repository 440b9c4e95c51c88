//! The top of a file without a border, a group or its only chart: where its topology needs many triangles, another one
//! takes its place.

use glam::DVec3;
use lodpack::write::{BlockRecord, OverviewRecord};

use super::super::drawn::DrawnBlocks;
use super::super::overview::{OVERVIEW_TRIANGLES, coded};
use super::super::scale::{Scale, factor_of};
use super::parts::closed;
use crate::reduce::CoarseSurface;
use crate::reduce::{Ways, reduce};
use lodpack_mesh::exact::power_of_two;
use lodpack_stage::simplify::LevelPatch;

/// The lattice step, grown with the tolerance of a level, over the bound of a reduced surface of that level, at most.
const STEP_PER_BOUND: f64 = 0.25;

/// A coarser block of a top is left out unless it has at most this share of the finer one's triangles.
const WORTHWHILE: f64 = 0.75;

/// A top that has a block of few triangles gets another instead if its error is at most this share of that.
const NEARER: f64 = 0.8;

/// And only if what it stands for has at least this many triangles: fewer are hardly more than the block itself.
const WORTH_ANOTHER: usize = 2000;

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

/// Makes coarse levels of a top with a border anew where they have hardly fewer triangles than finer ones: each has
/// half of the finer level's, as far as its border allows. `coarser` makes a level of about the number of triangles
/// that it is given.
pub(super) fn halve_levels(
    levels: &mut [Option<LevelPatch>],
    most: usize,
    coarser: impl Fn(usize, usize) -> Option<LevelPatch>,
) {
    let (mut finer, mut wanted) = (usize::MAX, most);
    for level in (0..levels.len()).rev() {
        let fits =
            |patch: &LevelPatch| finer == usize::MAX || patch.triangles.len() as f64 <= finer as f64 * WORTHWHILE;
        if !levels[level].as_ref().is_some_and(fits)
            && let Some(patch) = coarser(level, wanted).filter(fits)
        {
            levels[level] = Some(patch);
        }
        finer = levels[level].as_ref().map_or(finer, |patch| patch.triangles.len());
        wanted = (finer.min(most) / 2).max(1);
    }
}

/// What a top has whose triangles are few.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Few {
    /// A surface like any other.
    Surface,
    /// Lines between colours, which another surface would not have.
    Lines,
    /// Too few parts, so that any other surface may be better.
    SomeParts,
}

/// What became of a top.
pub(in super::super) struct ReducedTop {
    /// Whether some block has few triangles.
    pub has_few: bool,
    /// The surface of few triangles that has taken the place of the coarsest blocks, and its level.
    pub replaced: Option<(u8, CoarseSurface)>,
}

/// Replaces the coarsest blocks of a top by one of few triangles, if these have more or are farther off; one that has
/// no block gets one at its finest level. `surface` is what it stands for, `drawn` what is drawn of it, and `bounds`
/// the box around all of that, relative to the lattice's origin. Where the top `has_children`, it keeps its finest
/// level.
pub(in super::super) fn reduce_top(
    surface: &CoarseSurface,
    blocks: &mut [Option<BlockRecord>],
    scale: &Scale,
    few: Few,
    drawn: &mut DrawnBlocks,
    bounds: &mut [DVec3; 2],
    has_children: bool,
) -> ReducedTop {
    let mut replaced = None;
    let Some(last) = blocks.len().checked_sub(1) else { return ReducedTop { has_few: false, replaced } };
    let finest = blocks.iter().rposition(Option::is_some).unwrap_or(last);
    let is_small = |block: &&BlockRecord| block.triangle_count as usize <= OVERVIEW_TRIANGLES;
    let small = blocks.iter().flatten().filter(is_small).map(|block| block.error).reduce(f64::min);
    let (ways, most) = match (small, few) {
        (None, _) => (Ways::Nearest, f64::INFINITY),
        (Some(error), Few::SomeParts) => (Ways::Nearest, error),
        (Some(error), _) => (Ways::Quick, error * NEARER),
    };
    let is_done = matches!(ways, Ways::Quick) && (few == Few::Lines || surface.triangles.len() < WORTH_ANOTHER);
    // Clustered vertices may join sheets, which have to come apart without an opening.
    if !is_done
        && let Some((reduced, _)) = reduce(surface, ways, OVERVIEW_TRIANGLES, closed)
        && reduced.error < most
    {
        // The finest level takes its place unless a coarser one, by its tolerance, allows as much.
        let finest_step = scale.step() * power_of_two(i32::from(scale.fineness));
        let step = |level: usize| finest_step * factor_of(usize::from(scale.finest()) - level);
        let is_fine = |&level: &usize| step(level) <= STEP_PER_BOUND * (reduced.error - surface.error);
        let goes = blocks[finest].as_ref().is_none_or(|block| is_small(&block));
        // Levels of children follow the finest one.
        let coarsest = if has_children && goes { finest } else { 0 };
        let level = (coarsest..=finest).find(is_fine).unwrap_or(finest);
        if let Some((OverviewRecord { error, loops, triangle_count, symbols, .. }, patch)) =
            coded(surface, reduced, scale, level)
            && loops.is_empty()
        {
            blocks
                .iter_mut()
                .filter(|block| block.as_ref().is_some_and(|block| is_small(&block)))
                .for_each(|block| *block = None);
            blocks[..level].fill(None);
            blocks[level] =
                Some(BlockRecord { error, border_deviation: 0.0, triangle_count, symbols, ..BlockRecord::default() });
            let positions: Vec<DVec3> = patch.positions.iter().map(|&point| scale.local_from_lattice(point)).collect();
            *bounds = positions.iter().fold(*bounds, |[low, high], &p| [low.min(p), high.max(p)]);
            replaced = Some((level as u8, CoarseSurface { positions, triangles: patch.triangles.clone(), error }));
            if let Some(drawn) = drawn.get_mut(level) {
                *drawn = Some(patch);
            }
        }
    }
    ReducedTop { has_few: blocks.iter().flatten().any(|block| is_small(&block)), replaced }
}
