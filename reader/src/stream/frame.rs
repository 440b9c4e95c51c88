//! A frame: from the wanted cut and the loaded units to the units to draw and to ask for.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use super::{
    content::{FileContent, Unit},
    drawn_surface::DrawnSurface,
    loader::{Loader, UnitState},
    picture::{Changes, Picture},
    queue::Class,
};
use crate::select::Node;

/// What to draw in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shows {
    /// Nothing: the coarsest level is not loaded yet, and the file has no overview.
    Nothing,
    /// The overview: the coarsest level is not loaded yet. See [`super::Session::overview`].
    Overview,
    /// The picture. See [`super::Session::picture`].
    Picture,
}

/// The result of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// What to draw.
    pub shows: Shows,
    /// Whether everything is drawn as wanted, except for what has been given up.
    pub is_complete: bool,
    /// Differences from the picture of the frame before.
    pub changes: Changes,
    /// Roots drawn coarser than wanted.
    pub late_roots: u32,
    /// Roots that are missing from the picture because none of their levels could be loaded.
    pub lost_roots: Vec<u32>,
}

/// The part of a cut that can be drawn.
#[derive(Default)]
pub(crate) struct Drawable {
    pub is_complete: bool,
    pub late_roots: u32,
    pub lost_roots: Vec<u32>,
    /// Whether a root that is not lost has no level yet.
    pub lacks_roots: bool,
    /// Wanted units that were there.
    pub hits: u64,
}

/// The block to ask for of a root, and the block to draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Choice {
    target: Option<Unit>,
    drawn: Option<Unit>,
}

impl Choice {
    /// The target is the wanted block or, if that is lost, the nearest coarser one, else the nearest finer one. The first block in
    /// the same order that is loaded is drawn. A block of level `so_far` that is finer than wanted may stay until the target is
    /// loaded.
    fn new(blocks: &[Unit], level: u8, so_far: Option<u8>, state: impl Fn(Unit) -> UnitState) -> Self {
        let wanted = blocks.partition_point(|block| block.level <= level).max(1).min(blocks.len());
        let (coarser, finer) = blocks.split_at(wanted);
        let in_order = || coarser.iter().rev().chain(finer).copied();
        let target = in_order().find(|&unit| state(unit) != UnitState::Failed);
        let is_there = |unit: &Unit| state(*unit) == UnitState::Decoded;
        let stays = |unit: &&Unit| Some(unit.level) == so_far && is_there(unit);
        let staying = if target.is_some_and(|target| is_there(&target)) { None } else { finer.iter().find(stays) };
        Self { target, drawn: staying.copied().or_else(|| in_order().find(is_there)) }
    }

    /// By how many levels the drawn block is coarser than the target; 0 if it is not.
    fn missing(&self) -> u8 {
        match (self.target, self.drawn) {
            (Some(target), Some(drawn)) => target.level.saturating_sub(drawn.level),
            (Some(target), None) => target.level + 1,
            (None, _) => 0,
        }
    }
}

/// A node of the cut, and what is drawn for it.
#[derive(Debug)]
struct Slot {
    node: Node,
    /// The drawn block, if it is the target: nothing is left to load.
    settled: Option<Unit>,
    surface: Option<Arc<DrawnSurface>>,
}

impl Slot {
    fn new(node: Node) -> Self {
        Self { node, settled: None, surface: None }
    }
}

/// The cut that frames want, kept from frame to frame. A root that is drawn as wanted is settled: the loader holds its unit, and no
/// frame looks at it again until one wants another level. So the cost of a frame grows with what has changed and what is missing; the
/// rest takes a comparison of two lists.
#[derive(Debug, Default)]
pub(crate) struct WantedCut {
    /// Sorted by root.
    slots: Vec<Slot>,
    /// Places of the slots that are not settled, ascending.
    open: Vec<usize>,
    /// For how many slots each unit is held.
    holds: BTreeMap<Unit, u32>,
    /// Whether surfaces came or went since they were last asked for.
    is_changed: bool,
    /// Whether blocks that had been given up may be had again.
    is_stale: bool,
}

impl WantedCut {
    /// Sets the cut of the running frame, sorted by root.
    pub fn follow(&mut self, loader: &mut Loader<FileContent>, wanted: &[Node]) {
        let is_stale = std::mem::take(&mut self.is_stale);
        if !is_stale && wanted.iter().eq(self.slots.iter().map(|slot| &slot.node)) {
            return;
        }
        let mut before = std::mem::take(&mut self.slots).into_iter().peekable();
        let mut slots = Vec::with_capacity(wanted.len());
        let mut released = Vec::new();
        let mut has_gone = false;
        for &node in wanted {
            while let Some(slot) = before.next_if(|slot| slot.node.root < node.root) {
                released.extend(slot.settled);
                has_gone = true;
            }
            let mut slot = before.next_if(|slot| slot.node.root == node.root).unwrap_or_else(|| Slot::new(node));
            if is_stale || slot.node != node {
                slot.node = node;
                released.extend(slot.settled.take());
            }
            slots.push(slot);
        }
        for slot in before {
            released.extend(slot.settled);
            has_gone = true;
        }
        self.slots = slots;
        self.is_changed |= has_gone;
        let numbered = self.slots.iter().enumerate();
        self.open = numbered.filter(|(_, slot)| slot.settled.is_none()).map(|(at, _)| at).collect();
        released.into_iter().for_each(|unit| self.release(loader, unit));
    }

    fn release(&mut self, loader: &mut Loader<FileContent>, unit: Unit) {
        let count = self.holds.get(&unit).map_or(0, |count| count - 1);
        if count > 0 {
            self.holds.insert(unit, count);
        } else {
            self.holds.remove(&unit);
            loader.release(unit);
        }
    }

    /// Makes the next frame look at everything anew, because units that were given up will be tried again.
    pub fn doubt(&mut self) {
        self.is_stale = true;
    }

    /// Demands what the cut needs, and finds the part that can be drawn.
    pub fn demand(
        &mut self,
        loader: &mut Loader<FileContent>,
        picture: &Picture,
        may_stay_finer: bool,
        now: Duration,
    ) -> Drawable {
        let content = loader.content().clone();
        let mut drawable = Drawable { is_complete: true, hits: self.holds.len() as u64, ..Drawable::default() };
        let mut targets: BTreeMap<Unit, u8> = BTreeMap::new();
        let mut choices = Vec::with_capacity(self.open.len());
        for at in std::mem::take(&mut self.open) {
            let Some(Slot { node, .. }) = self.slots.get(at) else { continue };
            let so_far = picture.root(node.root).map(|root| root.surface.level).filter(|_| may_stay_finer);
            let choice = Choice::new(content.blocks(node.root), node.level, so_far, |unit| loader.state(unit));
            match choice.target {
                Some(target) => {
                    let missing = targets.entry(target).or_default();
                    *missing = choice.missing().max(*missing);
                    drawable.late_roots += u32::from(choice.missing() > 0);
                }
                None => drawable.lost_roots.push(node.root),
            }
            choices.push((at, choice));
        }
        for (unit, missing) in targets {
            match loader.want(unit, Class::Demand, missing, now) {
                UnitState::Decoded => drawable.hits += u64::from(!self.holds.contains_key(&unit)),
                UnitState::Coming | UnitState::Failed => drawable.is_complete = false,
            }
        }
        for (at, choice) in choices {
            drawable.lacks_roots |= !self.draw(loader, at, choice);
        }
        drawable
    }

    /// Draws the chosen block of a slot. Returns whether it could, or whether the root is lost.
    fn draw(&mut self, loader: &mut Loader<FileContent>, at: usize, Choice { target, drawn }: Choice) -> bool {
        let Some(slot) = self.slots.get_mut(at) else { return true };
        let surface = drawn.and_then(|unit| loader.take(unit)).and_then(|surfaces| {
            let place = surfaces.binary_search_by_key(&slot.node.root, |surface| surface.root).ok()?;
            surfaces.get(place).cloned()
        });
        let level = |surface: &Option<Arc<DrawnSurface>>| surface.as_ref().map(|surface| surface.level);
        self.is_changed |= level(&slot.surface) != level(&surface);
        slot.surface = surface;
        slot.settled = target.filter(|_| drawn == target && slot.surface.is_some());
        let is_fine = slot.surface.is_some() || target.is_none();
        match slot.settled {
            Some(unit) => {
                let count = self.holds.entry(unit).or_default();
                if *count == 0 {
                    loader.hold(unit);
                }
                *count += 1;
            }
            None => self.open.push(at),
        }
        is_fine
    }

    #[cfg(test)]
    pub fn open_count(&self) -> usize {
        self.open.len()
    }

    /// All surfaces, by root, where any came or went since the last call.
    pub fn take_changed(&mut self) -> Option<Vec<Arc<DrawnSurface>>> {
        let is_changed = std::mem::take(&mut self.is_changed);
        is_changed.then(|| self.slots.iter().filter_map(|slot| slot.surface.clone()).collect())
    }

    /// Asks for what the predicted cut will need.
    pub fn prefetch(&self, loader: &mut Loader<FileContent>, expected: &[Node], now: Duration) {
        let content = loader.content().clone();
        let mut targets: BTreeMap<Unit, u8> = BTreeMap::new();
        let mut slots = self.slots.iter().peekable();
        for node in expected {
            while slots.next_if(|slot| slot.node.root < node.root).is_some() {}
            if slots.peek().is_some_and(|slot| slot.node == *node && slot.settled.is_some()) {
                continue;
            }
            let choice = Choice::new(content.blocks(node.root), node.level, None, |unit| loader.state(unit));
            if let Some(target) = choice.target {
                let missing = targets.entry(target).or_default();
                *missing = choice.missing().max(*missing);
            }
        }
        for (unit, missing) in targets {
            loader.want(unit, Class::Prefetch, missing, now);
        }
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
                UnitState::Decoded
            } else if failed.contains(&unit.level) {
                UnitState::Failed
            } else {
                UnitState::Coming
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
