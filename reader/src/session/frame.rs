//! From a wanted cut and what is loaded to what is drawn and what is asked for.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use super::{
    content::{FileContent, Unit},
    loader::{Loader, Standing},
    picture::{Changes, Picture},
    queue::Class,
    surface::Surface,
};
use crate::adapt::Node;

/// What a frame shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// Nothing: the coarsest level is not there yet, and the file has no overview.
    Nothing,
    /// The overview: the coarsest level is not there yet. See [`super::Session::overview`].
    Overview,
    /// The picture. See [`super::Session::picture`].
    Picture,
}

/// What came of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What is to be drawn.
    pub shows: Shows,
    /// Whether everything is drawn as wanted, but for what has been given up.
    pub is_complete: bool,
    /// How the picture differs from that of the frame before.
    pub changes: Changes,
    /// Roots drawn coarser than wanted.
    pub late_roots: u32,
    /// Roots of which no level could be loaded: they are missing from the picture.
    pub lost_roots: Vec<u32>,
}

/// What of a cut can be drawn.
#[derive(Default)]
pub(crate) struct Drawable {
    /// Sorted by root.
    pub surfaces: Vec<Arc<Surface>>,
    pub is_complete: bool,
    pub late_roots: u32,
    pub lost_roots: Vec<u32>,
    /// Whether a root that is not lost has no level yet.
    pub lacks_roots: bool,
    /// Wanted units that were there.
    pub hits: u64,
}

/// Which of a root's blocks to ask for and which to draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Choice {
    target: Option<Unit>,
    drawn: Option<Unit>,
}

impl Choice {
    /// The target is the wanted block or, where that is lost, the nearest coarser one, else the nearest finer one. Drawn is
    /// the first in the same order that is there. A block of level `so_far` that is finer than wanted may stay until the
    /// target is there.
    fn new(blocks: &[Unit], level: u8, so_far: Option<u8>, standing: impl Fn(Unit) -> Standing) -> Self {
        let wanted = blocks.partition_point(|block| block.level <= level).max(1).min(blocks.len());
        let (coarser, finer) = blocks.split_at(wanted);
        let in_order = || coarser.iter().rev().chain(finer).copied();
        let target = in_order().find(|&unit| standing(unit) != Standing::Failed);
        let is_there = |unit: &Unit| standing(*unit) == Standing::Decoded;
        let stays = |unit: &&Unit| Some(unit.level) == so_far && is_there(unit);
        let staying = if target.is_some_and(|target| is_there(&target)) { None } else { finer.iter().find(stays) };
        Self { target, drawn: staying.copied().or_else(|| in_order().find(is_there)) }
    }

    /// How many levels the drawn block is below the target; 0 if it is not coarser.
    fn missing(&self) -> u8 {
        match (self.target, self.drawn) {
            (Some(target), Some(drawn)) => target.level.saturating_sub(drawn.level),
            (Some(target), None) => target.level + 1,
            (None, _) => 0,
        }
    }
}

/// Demands what a cut needs, and finds what can be drawn of it.
pub(crate) fn demand(
    loader: &mut Loader<FileContent>,
    wanted: &[Node],
    picture: &Picture,
    may_stay_finer: bool,
    now: Duration,
) -> Drawable {
    let content = loader.content().clone();
    let mut drawable = Drawable { is_complete: true, ..Drawable::default() };
    let mut targets: BTreeMap<Unit, u8> = BTreeMap::new();
    let mut drawn = Vec::with_capacity(wanted.len());
    for node in wanted {
        let so_far = picture.root(node.root).map(|root| root.surface.level).filter(|_| may_stay_finer);
        let choice = Choice::new(content.blocks(node.root), node.level, so_far, |unit| loader.standing(unit));
        let Some(target) = choice.target else {
            drawable.lost_roots.push(node.root);
            continue;
        };
        let missing = targets.entry(target).or_default();
        *missing = choice.missing().max(*missing);
        drawable.late_roots += u32::from(choice.missing() > 0);
        drawable.lacks_roots |= choice.drawn.is_none();
        drawn.extend(choice.drawn.map(|unit| (node.root, unit)));
    }
    for (unit, missing) in targets {
        match loader.want(unit, Class::Demand, missing, now) {
            Standing::Decoded => drawable.hits += 1,
            Standing::Coming | Standing::Failed => drawable.is_complete = false,
        }
    }
    for (root, unit) in drawn {
        let surfaces = loader.take(unit);
        let surface = surfaces.and_then(|surfaces| {
            let at = surfaces.binary_search_by_key(&root, |surface| surface.root).ok()?;
            surfaces.get(at).cloned()
        });
        match surface {
            Some(surface) => drawable.surfaces.push(surface),
            None => drawable.lacks_roots = true,
        }
    }
    drawable
}

/// Asks for what a cut will need.
pub(crate) fn prefetch(loader: &mut Loader<FileContent>, expected: &[Node], now: Duration) {
    let content = loader.content().clone();
    let mut targets: BTreeMap<Unit, u8> = BTreeMap::new();
    for node in expected {
        let choice = Choice::new(content.blocks(node.root), node.level, None, |unit| loader.standing(unit));
        if let Some(target) = choice.target {
            let missing = targets.entry(target).or_default();
            *missing = choice.missing().max(*missing);
        }
    }
    for (unit, missing) in targets {
        loader.want(unit, Class::Prefetch, missing, now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(level: u8) -> Unit {
        Unit { level, cluster: 0, stream: 0 }
    }

    fn choice(level: u8, so_far: Option<u8>, decoded: &[u8], failed: &[u8]) -> (Option<u8>, Option<u8>, u8) {
        // Level 2 does not exist.
        let choice = Choice::new(&[0, 1, 3, 4].map(unit), level, so_far, |unit| {
            if decoded.contains(&unit.level) {
                Standing::Decoded
            } else if failed.contains(&unit.level) {
                Standing::Failed
            } else {
                Standing::Coming
            }
        });
        (choice.target.map(|unit| unit.level), choice.drawn.map(|unit| unit.level), choice.missing())
    }

    #[test]
    fn the_finest_level_that_is_there_and_not_finer_than_wanted_is_drawn() {
        assert_eq!(choice(3, None, &[0, 1, 3, 4], &[]), (Some(3), Some(3), 0));
        assert_eq!(choice(3, None, &[0, 1, 4], &[]), (Some(3), Some(1), 2));
        assert_eq!(choice(2, None, &[0], &[]), (Some(1), Some(0), 1));
        assert_eq!(choice(4, None, &[], &[]), (Some(4), None, 5));
        // Better finer than not at all.
        assert_eq!(choice(0, None, &[3], &[]), (Some(0), Some(3), 0));
    }

    #[test]
    fn what_is_lost_is_replaced_by_the_next_coarser_or_else_finer() {
        assert_eq!(choice(4, None, &[0], &[4]), (Some(3), Some(0), 3));
        assert_eq!(choice(4, None, &[0], &[4, 3, 1]), (Some(0), Some(0), 0));
        assert_eq!(choice(1, None, &[], &[0, 1]), (Some(3), None, 4));
        assert_eq!(choice(1, None, &[], &[0, 1, 3, 4]), (None, None, 0));
    }

    #[test]
    fn what_was_drawn_finer_stays_until_the_wanted_level_is_there() {
        assert_eq!(choice(1, Some(4), &[0, 4], &[]), (Some(1), Some(4), 0));
        assert_eq!(choice(1, Some(4), &[0, 1, 4], &[]), (Some(1), Some(1), 0));
        assert_eq!(choice(1, Some(4), &[0, 3], &[]), (Some(1), Some(0), 1));
    }
}
