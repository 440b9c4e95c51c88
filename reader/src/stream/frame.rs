//! A frame: from the wanted cut and the loaded units to the units to draw and to ask for.

use std::{collections::HashMap, sync::Arc, time::Duration};

use super::{
    content::{FileContent, Unit},
    drawn_surface::DrawnSurface,
    loader::{Loader, UnitState},
    pace::paced,
    picture::{Changes, Picture},
    queue::Class,
};
use crate::{
    format::records::MAX_LEVELS,
    objects::ObjectFilter,
    select::Node,
    sorted::{SortedMap, SortedSet, in_order},
};

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
    /// Wanted roots drawn coarser than wanted because their blocks are not there yet. In a tree one of them may be
    /// drawn by a root above it, which then also stands for loaded roots beside it; these are not counted.
    pub late_roots: u32,
    /// Roots that are missing from the picture because none of their levels, nor of those of the roots above them,
    /// could be loaded.
    pub lost_roots: Vec<u32>,
    /// Roots drawn without the images that they need, because these are not there yet.
    pub late_textures: u32,
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

/// A block of a root.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Block {
    root: u32,
    unit: Unit,
}

/// The block to ask for, and the block to draw: a root's own ones, or of roots above it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Choice {
    target: Option<Block>,
    drawn: Option<Block>,
    /// Whether roots below that are drawn already stay instead.
    stays: bool,
}

/// Where a choice looks for blocks.
trait Blocks {
    /// A root's own blocks, coarse to fine.
    fn of(&self, root: u32) -> Vec<Unit>;

    fn parent(&self, root: u32) -> Option<u32>;
}

impl Blocks for FileContent {
    fn of(&self, root: u32) -> Vec<Unit> {
        self.blocks(root)
    }

    fn parent(&self, root: u32) -> Option<u32> {
        self.parent(root)
    }
}

impl Choice {
    /// The target is the wanted block or, if that is lost, the nearest coarser one of the root, else the nearest finer
    /// one, else the finest one of the nearest root above it. The first block in the same order that is loaded is
    /// drawn. A block of level `so_far` that is finer than wanted may stay until the target is loaded.
    fn new(blocks: &impl Blocks, node: Node, so_far: Option<u8>, state: impl Fn(Unit) -> UnitState) -> Self {
        let own = blocks.of(node.root);
        let wanted = own.partition_point(|block| block.level <= node.level).max(1).min(own.len());
        let (coarser, finer) = own.split_at(wanted);
        let ancestors = std::iter::successors(blocks.parent(node.root), |&root| blocks.parent(root)).take(MAX_LEVELS);
        let mut in_order =
            coarser.iter().rev().chain(finer).map(|&unit| Block { root: node.root, unit }).chain(
                ancestors.flat_map(|root| blocks.of(root).into_iter().rev().map(move |unit| Block { root, unit })),
            );
        let is_there = |block: &Block| state(block.unit) == UnitState::Decoded;
        let target = in_order.find(|block| state(block.unit) != UnitState::Failed);
        // What comes before the target is lost.
        let drawn = target.filter(is_there).or_else(|| {
            let stays = |unit: &&Unit| Some(unit.level) == so_far && state(**unit) == UnitState::Decoded;
            let staying = finer.iter().find(stays).map(|&unit| Block { root: node.root, unit });
            staying.or_else(|| in_order.find(is_there))
        });
        Self { target, drawn, stays: false }
    }

    /// By how many levels the drawn block is coarser than the target; 0 if it is not.
    fn missing(&self) -> u8 {
        match (self.target, self.drawn) {
            (Some(target), Some(drawn)) => target.unit.level.saturating_sub(drawn.unit.level),
            (Some(target), None) if !self.stays => target.unit.level + 1,
            _ => 0,
        }
    }
}

/// A node of the cut, and what is drawn for it.
#[derive(Debug)]
struct Slot {
    node: Node,
    /// The drawn unit, if it is the target: nothing is left to load.
    settled: Option<Unit>,
    /// Of the root itself, or of one above it, which takes the place of everything below it.
    surface: Option<Arc<DrawnSurface>>,
    shown: Option<Shown>,
}

impl Slot {
    fn new(node: Node) -> Self {
        Self { node, settled: None, surface: None, shown: None }
    }
}

/// Which surface is drawn, without a look at it: 10,000 surfaces lie all over the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shown {
    root: u32,
    level: u8,
    address: usize,
}

impl Shown {
    fn of(surface: &Arc<DrawnSurface>) -> Self {
        Self { root: surface.root, level: surface.level, address: Arc::as_ptr(surface).addr() }
    }

    fn node(self) -> (u32, u8) {
        (self.root, self.level)
    }
}

/// What is drawn otherwise than before.
#[derive(Debug, Default)]
pub(crate) struct Difference {
    /// Roots that are no longer drawn.
    pub removed: Vec<u32>,
    /// Surfaces of roots that are new, are drawn at another level, or have been decoded again.
    pub surfaces: Vec<Arc<DrawnSurface>>,
}

impl Difference {
    /// Between two lists by root. Makes the first one the second.
    fn take<'s>(before: &mut Vec<Shown>, now: impl Iterator<Item = (Shown, &'s Arc<DrawnSurface>)>) -> Self {
        let (mut difference, mut after) = (Self::default(), Vec::with_capacity(before.len()));
        let mut drawn = before.iter().peekable();
        for (shown, surface) in now {
            while let Some(gone) = drawn.next_if(|other| other.root < shown.root) {
                difference.removed.push(gone.root);
            }
            if drawn.next_if(|other| other.root == shown.root) != Some(&shown) {
                difference.surfaces.push(Arc::clone(surface));
            }
            after.push(shown);
        }
        difference.removed.extend(drawn.map(|gone| gone.root));
        *before = after;
        difference
    }
}

/// The cut that frames want, kept from frame to frame. A root that is drawn as wanted is settled: the loader holds its
/// unit, and no frame looks at it again until one wants another level. So the cost of a frame grows with what has
/// changed and what is missing; the rest takes a comparison of two lists.
///
/// In a tree, a root whose blocks are not there is drawn by the nearest root above it that is, in place of everything
/// wanted below that one. So what is drawn covers what is wanted, and nothing twice.
#[derive(Debug, Default)]
pub(crate) struct WantedCut {
    /// Sorted by root.
    slots: Vec<Slot>,
    /// Empty: room for the slots of the next frame.
    spare: Vec<Slot>,
    /// Places of the slots that are not settled, ascending.
    open: Vec<usize>,
    /// Roots below those of open slots that stay instead.
    staying: Vec<Arc<DrawnSurface>>,
    /// For how many slots each unit is held.
    holds: SortedMap<Unit, u32>,
    /// Whether surfaces came or went since they were last asked for.
    is_changed: bool,
    /// Surfaces that were too much for the last frame.
    pub wait_count: usize,
    /// What was drawn then, by root.
    shown: Vec<Shown>,
    /// Whether blocks that had been given up may be had again, or are drawn otherwise.
    is_stale: bool,
    /// Which objects are drawn.
    filter: Option<Arc<ObjectFilter>>,
}

impl WantedCut {
    /// Whether these nodes are the cut already.
    pub fn is(&self, wanted: &[Node]) -> bool {
        wanted.iter().eq(self.slots.iter().map(|slot| &slot.node))
    }

    /// Sets the cut of the running frame, sorted by root; no root is above another.
    pub fn follow(&mut self, loader: &mut Loader<FileContent>, wanted: &[Node]) {
        let is_stale = std::mem::take(&mut self.is_stale);
        if !is_stale && self.is(wanted) {
            return;
        }
        let mut before = std::mem::take(&mut self.slots);
        let mut slots = std::mem::take(&mut self.spare);
        let mut before_here = before.drain(..).peekable();
        let mut released = Vec::new();
        let mut has_gone = false;
        for &node in wanted {
            while let Some(slot) = before_here.next_if(|slot| slot.node.root < node.root) {
                released.extend(slot.settled);
                has_gone = true;
            }
            let mut slot = before_here.next_if(|slot| slot.node.root == node.root).unwrap_or_else(|| Slot::new(node));
            if is_stale || slot.node != node {
                slot.node = node;
                released.extend(slot.settled.take());
            }
            slots.push(slot);
        }
        for slot in before_here {
            released.extend(slot.settled);
            has_gone = true;
        }
        (self.slots, self.spare) = (slots, before);
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

    /// Draws other objects from the next frame on.
    pub fn show_objects(&mut self, filter: Option<Arc<ObjectFilter>>) {
        if self.filter != filter {
            self.filter = filter;
            (self.is_stale, self.is_changed) = (true, true);
        }
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
        let mut targets: SortedMap<Unit, u8> = SortedMap::new();
        let mut choices = Vec::with_capacity(self.open.len());
        let stayed = std::mem::take(&mut self.staying);
        for at in std::mem::take(&mut self.open) {
            let Some(&Slot { node, .. }) = self.slots.get(at) else { continue };
            let so_far = picture.root(node.root).map(|root| root.surface.level).filter(|_| may_stay_finer);
            let mut choice = Choice::new(&*content, node, so_far, |unit| loader.state(unit));
            let is_finer = |block: Block| block.unit.level > node.level;
            let may_wait = may_stay_finer && choice.drawn != choice.target && !choice.drawn.is_some_and(is_finer);
            if may_wait && let Some(below) = cover(&content, loader, picture, node.root) {
                choice = Choice { drawn: None, stays: true, ..choice };
                let filter = self.filter.as_deref();
                self.staying.extend(below.iter().map(|drawn| drawn.whole().filtered(filter, Some(drawn))));
            }
            match choice.target {
                Some(Block { unit, .. }) => {
                    let missing = targets.or_default(unit);
                    *missing = choice.missing().max(*missing);
                    drawable.late_roots += u32::from(choice.missing() > 0);
                }
                None if choice.stays => {}
                None => drawable.lost_roots.push(node.root),
            }
            choices.push((at, choice));
        }
        let node = |surface: &Arc<DrawnSurface>| (surface.root, surface.level);
        self.is_changed |= !stayed.iter().map(node).eq(self.staying.iter().map(node));
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

    /// Draws the chosen block for a slot. Returns whether it could, or the roots below stay, or the root is lost.
    fn draw(&mut self, loader: &mut Loader<FileContent>, at: usize, Choice { target, drawn, stays }: Choice) -> bool {
        let Some(slot) = self.slots.get_mut(at) else { return true };
        let surface = drawn.and_then(|Block { root, unit }| {
            let surfaces = loader.take(unit)?;
            let place = surfaces.binary_search_by_key(&root, |surface| surface.root).ok()?;
            Some(surfaces.get(place)?.filtered(self.filter.as_deref(), slot.surface.as_ref()))
        });
        let shown = surface.as_ref().map(Shown::of);
        self.is_changed |= slot.shown.map(Shown::node) != shown.map(Shown::node);
        (slot.surface, slot.shown) = (surface, shown);
        slot.settled = target.filter(|_| drawn == target && slot.surface.is_some()).map(|block| block.unit);
        let is_fine = slot.surface.is_some() || stays || target.is_none();
        match slot.settled {
            Some(unit) => {
                let count = self.holds.or_default(unit);
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

    /// What has changed since the last call, whose picture is still drawn. New surfaces have at most so many bytes; the
    /// others wait for the next calls.
    pub fn take_changed(&mut self, content: &FileContent, picture: &Picture, upload_bytes: u64) -> Option<Difference> {
        if !std::mem::take(&mut self.is_changed) {
            return None;
        }
        self.wait_count = 0;
        if upload_bytes < u64::MAX {
            let drawn: Vec<_> = picture.roots().map(|root| Arc::clone(&root.surface)).collect();
            let (surfaces, wait_count) = paced(content, &drawn, self.surfaces(content), upload_bytes);
            (self.wait_count, self.is_changed) = (wait_count, wait_count > 0);
            let now = surfaces.iter().map(|surface| (Shown::of(surface), surface));
            return Some(Difference::take(&mut self.shown, now));
        }
        let is_own = |slot: &Slot| slot.shown.is_none_or(|shown| shown.root == slot.node.root);
        if self.staying.is_empty() && self.slots.iter().all(is_own) {
            let now = self.slots.iter().filter_map(|slot| Some((slot.shown?, slot.surface.as_ref()?)));
            return Some(Difference::take(&mut self.shown, now));
        }
        let surfaces = self.surfaces(content);
        let now = surfaces.iter().map(|surface| (Shown::of(surface), surface));
        Some(Difference::take(&mut self.shown, now))
    }

    /// All surfaces to draw, by root, where some are drawn in place of others.
    fn surfaces(&self, content: &FileContent) -> Vec<Arc<DrawnSurface>> {
        // Roots that are drawn in place of what is wanted below them.
        let mut above: HashMap<u32, &Arc<DrawnSurface>> = HashMap::new();
        let surfaces = || self.slots.iter().filter_map(|slot| Some((slot.node.root, slot.surface.as_ref()?)));
        for (_, surface) in surfaces().filter(|(root, surface)| surface.root != *root) {
            let finest = above.entry(surface.root).or_insert(surface);
            *finest = if surface.level > finest.level { surface } else { finest };
        }
        // Roots that are drawn in place of others, or below such: roots with an ancestor in common share most of the
        // way up.
        let mut hides: HashMap<u32, bool> = above.keys().map(|&root| (root, true)).collect();
        let mut is_drawn = |surface: &Arc<DrawnSurface>| {
            let mut passed = Vec::new();
            let found = content.above(surface.root).find_map(|root| {
                passed.push(root);
                hides.get(&root).copied()
            });
            let is_hidden = found.unwrap_or(false);
            passed.into_iter().for_each(|root| _ = hides.entry(root).or_insert(is_hidden));
            !is_hidden
        };
        let own = surfaces().filter(|(root, surface)| surface.root == *root).map(|(_, surface)| surface);
        let all = own.chain(&self.staying).chain(above.values().copied());
        let all: Vec<Arc<DrawnSurface>> = all.filter(|surface| is_drawn(surface)).cloned().collect();
        let order = in_order(all.iter().map(|surface| surface.root));
        order.into_iter().map(|at| Arc::clone(&all[at as usize])).collect()
    }

    /// Asks for what the predicted cut will need.
    pub fn prefetch(&self, loader: &mut Loader<FileContent>, expected: &[Node], now: Duration) {
        let content = loader.content().clone();
        let mut targets: SortedMap<Unit, u8> = SortedMap::new();
        let mut slots = self.slots.iter().peekable();
        for node in expected {
            while slots.next_if(|slot| slot.node.root < node.root).is_some() {}
            if slots.peek().is_some_and(|slot| slot.node == *node && slot.settled.is_some()) {
                continue;
            }
            let choice = Choice::new(&*content, *node, None, |unit| loader.state(unit));
            if let Some(Block { unit, .. }) = choice.target {
                let missing = targets.or_default(unit);
                *missing = choice.missing().max(*missing);
            }
        }
        for (unit, missing) in targets {
            loader.want(unit, Class::Prefetch, missing, now);
        }
    }
}

/// What is drawn below a root, if that covers all of it and is still loaded. Counts as a use by the running frame.
fn cover(
    content: &FileContent,
    loader: &mut Loader<FileContent>,
    picture: &Picture,
    root: u32,
) -> Option<Vec<Arc<DrawnSurface>>> {
    let (mut surfaces, mut units) = (Vec::new(), SortedSet::new());
    let mut pending = vec![content.children(root)];
    while let Some(siblings) = pending.pop() {
        // What has no children and is not drawn is missing.
        if siblings.is_empty() {
            return None;
        }
        for root in siblings {
            let Some(drawn) = picture.root(root) else {
                pending.push(content.children(root));
                continue;
            };
            let unit = content.blocks(root).into_iter().find(|unit| unit.level == drawn.surface.level);
            units.insert(unit.filter(|&unit| loader.state(unit) == UnitState::Decoded)?);
            surfaces.push(drawn.surface.clone());
        }
    }
    units.into_iter().for_each(|unit| drop(loader.take(unit)));
    Some(surfaces)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The units of roots that are each the parent of the next one.
    struct Branch(Vec<Vec<Unit>>);

    impl Blocks for Branch {
        fn of(&self, root: u32) -> Vec<Unit> {
            self.0[root as usize].clone()
        }

        fn parent(&self, root: u32) -> Option<u32> {
            root.checked_sub(1)
        }
    }

    /// Levels of the chosen blocks for the last of these roots, which have blocks of these levels.
    fn choice_in(
        roots: &[&[u8]],
        level: u8,
        so_far: Option<u8>,
        decoded: &[u8],
        failed: &[u8],
    ) -> (Option<u8>, Option<u8>, u8) {
        let unit = |&level: &u8| Unit { level, cluster: 0, stream: 0 };
        let branch = Branch(roots.iter().map(|levels| levels.iter().map(unit).collect()).collect());
        let node = Node { root: roots.len() as u32 - 1, level };
        let choice = Choice::new(&branch, node, so_far, |unit| {
            if decoded.contains(&unit.level) {
                UnitState::Decoded
            } else if failed.contains(&unit.level) {
                UnitState::Failed
            } else {
                UnitState::Coming
            }
        });
        for block in [choice.target, choice.drawn].into_iter().flatten() {
            assert!(roots[block.root as usize].contains(&block.unit.level));
        }
        (choice.target.map(|block| block.unit.level), choice.drawn.map(|block| block.unit.level), choice.missing())
    }

    fn choice(level: u8, so_far: Option<u8>, decoded: &[u8], failed: &[u8]) -> (Option<u8>, Option<u8>, u8) {
        // Level 2 does not exist.
        choice_in(&[&[0, 1, 3, 4]], level, so_far, decoded, failed)
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

    #[test]
    fn the_nearest_root_above_that_is_there_stands_for_one_that_is_not() {
        let roots: [&[u8]; 3] = [&[0, 1], &[2], &[3, 4]];
        let choice = |level, decoded: &[u8], failed: &[u8]| choice_in(&roots, level, None, decoded, failed);
        assert_eq!(choice(4, &[0, 1], &[]), (Some(4), Some(1), 3));
        assert_eq!(choice(4, &[0, 2], &[]), (Some(4), Some(2), 2));
        assert_eq!(choice(4, &[0, 2, 3], &[]), (Some(4), Some(3), 1));
        // Its own finer block is better than a root above it.
        assert_eq!(choice(3, &[2, 4], &[]), (Some(3), Some(4), 0));
        // What is lost is drawn by the root above it for good, without more to wait for.
        assert_eq!(choice(4, &[0], &[3, 4]), (Some(2), Some(0), 2));
        assert_eq!(choice(4, &[0, 2], &[3, 4]), (Some(2), Some(2), 0));
        assert_eq!(choice(4, &[], &[0, 1, 2, 3, 4]), (None, None, 0));
    }
}
