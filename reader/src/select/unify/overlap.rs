//! Cut unification by an overlap tree (Niski 2007, section 7.4).
//!
//! A node that is not wholly within its tile is a boundary node. Boundary nodes of all tiles overlap where one is the
//! other or its ancestor; each set of overlapping ones gets one level. Whatever two tiles show of one piece of surface
//! is then drawn at the same level in both, and so are its borders, because the neighbours that both tiles show are
//! boundary nodes too.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    error::{Error, Result},
    select::{Adapter, Hierarchy, Node},
};

/// Which level overlapping nodes get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unification {
    /// The finest: no tile's error grows, but budgets may be exceeded. Without budgets the tiles draw what one cut for
    /// the whole picture would.
    #[default]
    Quality,
    /// The coarsest: budgets are kept, up to what stitching adds, but errors may grow.
    Performance,
}

/// The unified cuts of all tiles.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Unified {
    /// The nodes that each tile draws.
    pub tiles: Vec<Vec<Node>>,
    /// The nodes that any tile draws, each once: a cut.
    pub nodes: Vec<Node>,
    /// Boundary nodes, counted in each tile.
    pub boundary_count: usize,
    /// Nodes that have got another level, counted in each tile.
    pub change_count: usize,
}

/// Unifies the cuts that adapters of one hierarchy have for the tiles of one picture.
///
/// Takes O(B log N) for B boundary nodes and N nodes. Levels that not all overlapping nodes have are left out; nodes
/// whose ranges of levels have nothing in common are left as they are.
///
/// # Errors
/// [`Error::Query`] if the adapters have different hierarchies.
pub fn unify_cuts(tiles: &[Adapter], mode: Unification) -> Result<Unified> {
    let Some(first) = tiles.first() else { return Ok(Unified::default()) };
    let hierarchy = first.hierarchy();
    if !tiles.iter().all(|tile| std::sync::Arc::ptr_eq(tile.hierarchy(), hierarchy)) {
        return Err(Error::Query { what: "tiles can only be unified if they share one hierarchy".into() });
    }
    let mut cuts: Vec<BTreeMap<u32, u8>> = tiles.iter().map(Adapter::drawn).collect();
    let mut boundary: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (number, (tile, cut)) in tiles.iter().zip(&cuts).enumerate() {
        for &node in cut.keys().filter(|&&node| tile.crosses_window(node)) {
            boundary.entry(node).or_default().push(number);
        }
    }

    let mut unified = Unified { boundary_count: boundary.values().map(Vec::len).sum(), ..Unified::default() };
    for set in overlap_sets(hierarchy, &boundary).values() {
        let members: Vec<(usize, u32)> =
            set.iter().flat_map(|node| boundary[node].iter().map(move |&tile| (tile, *node))).collect();
        let levels = members.iter().map(|&(tile, node)| hierarchy.level(node, cuts[tile][&node]));
        let wanted = match mode {
            Unification::Quality => levels.max(),
            Unification::Performance => levels.min(),
        };
        let Some(level) = wanted.and_then(|level| common_level(hierarchy, set, level)) else { continue };
        for (tile, node) in members {
            let resolution = hierarchy.resolution_at(node, level);
            let before = cuts[tile].insert(node, resolution);
            unified.change_count += usize::from(before != Some(resolution));
        }
    }

    if hierarchy.has_children() {
        unified.change_count += draw_once(hierarchy, &mut cuts, mode);
    }
    // Other levels within a set of overlapping nodes would undo what was done for it.
    if mode == Unification::Quality && !hierarchy.has_children() && !tiles.iter().any(Adapter::is_limited) {
        unified.change_count += refine_beside_finer(hierarchy, tiles, &mut cuts);
    }

    let node =
        |(&node, &resolution): (&u32, &u8)| Node { root: hierarchy.id(node), level: hierarchy.level(node, resolution) };
    unified.tiles = cuts.iter().map(|cut| cut.iter().map(node).collect()).collect();
    let all: BTreeMap<u32, u8> = cuts.iter().flatten().map(|(&node, &resolution)| (node, resolution)).collect();
    unified.nodes = all.iter().map(node).collect();
    Ok(unified)
}

/// Makes the nodes that any tile draws a cut: no node stays that lies above another. Nodes that other tiles draw finer
/// are split, or else all finer ones merged. Returns how many nodes of tiles have gone.
fn draw_once(hierarchy: &Hierarchy, cuts: &mut [BTreeMap<u32, u8>], mode: Unification) -> usize {
    let drawn: BTreeMap<u32, u8> = cuts.iter().flatten().map(|(&node, &resolution)| (node, resolution)).collect();
    let above = |node: u32| ancestors(hierarchy, node);
    let split: BTreeSet<u32> = drawn.keys().flat_map(|&node| above(node)).collect();
    let mut gone = 0;
    for cut in cuts {
        for (node, resolution) in std::mem::take(cut) {
            match mode {
                Unification::Performance => {
                    let top = above(node).filter(|node| drawn.contains_key(node)).last();
                    gone += usize::from(top.is_some());
                    let top = top.unwrap_or(node);
                    cut.insert(top, drawn.get(&top).copied().unwrap_or(resolution));
                }
                Unification::Quality if !split.contains(&node) => _ = cut.insert(node, resolution),
                Unification::Quality => {
                    gone += 1;
                    let mut pending = vec![node];
                    while let Some(node) = pending.pop() {
                        if split.contains(&node) {
                            pending.extend(hierarchy.children(node));
                        } else {
                            cut.insert(node, drawn.get(&node).copied().unwrap_or(0));
                        }
                    }
                }
            }
        }
    }
    gone
}

/// Refines nodes that miss the tolerance since a neighbour that another tile shows is finer than their own tile knew:
/// what is added to a coarser side of a border moves it. Without this a picture of tiles would be coarser than the
/// whole one. Returns how many nodes of tiles have got another resolution.
fn refine_beside_finer(hierarchy: &Hierarchy, tiles: &[Adapter], cuts: &mut [BTreeMap<u32, u8>]) -> usize {
    let mut drawn: BTreeMap<u32, u8> = cuts.iter().flatten().map(|(&node, &resolution)| (node, resolution)).collect();
    let mut pending: BTreeSet<u32> = drawn.keys().copied().collect();
    let mut changed = 0;
    while let Some(node) = pending.pop_first() {
        let resolution = drawn[&node];
        let grades = hierarchy.grades(node);
        let level = grades[usize::from(resolution)].level;
        let is_finer = |border: u32, user: &u32| {
            let other = drawn.get(user).map(|&resolution| hierarchy.level(*user, resolution));
            let samples = |level| hierarchy.sample_count(border, level);
            other.is_some_and(|other| other > level && samples(other) > samples(level))
        };
        let borders = hierarchy.borders(node);
        let has_finer = borders.iter().any(|&border| hierarchy.users(border).iter().any(|user| is_finer(border, user)));
        let error = grades[usize::from(resolution)].refined_error;
        let mut seen = tiles.iter().zip(&*cuts).filter(|(_, cut)| cut.contains_key(&node));
        let meets = seen.all(|(tile, _)| tile.meets_tolerance(node, error));
        if !has_finer || meets || usize::from(resolution) + 1 == grades.len() {
            continue;
        }
        drawn.insert(node, resolution + 1);
        for cut in cuts.iter_mut() {
            changed += usize::from(cut.get_mut(&node).map(|own| *own = resolution + 1).is_some());
        }
        pending.insert(node);
        let beside = borders.iter().flat_map(|&border| hierarchy.users(border));
        pending.extend(beside.filter(|user| drawn.contains_key(user)));
    }
    changed
}

/// The nodes above a node, from its parent on.
fn ancestors(hierarchy: &Hierarchy, node: u32) -> impl Iterator<Item = u32> {
    std::iter::successors(hierarchy.parent(node), |&node| hierarchy.parent(node))
}

/// The sets of overlapping nodes, by the topmost: the leaves of the overlap tree, whose nodes are pruned as soon as an
/// ancestor is among the boundary nodes.
fn overlap_sets(hierarchy: &Hierarchy, boundary: &BTreeMap<u32, Vec<usize>>) -> BTreeMap<u32, Vec<u32>> {
    let mut sets: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &node in boundary.keys() {
        let topmost = ancestors(hierarchy, node).filter(|ancestor| boundary.contains_key(ancestor)).last();
        sets.entry(topmost.unwrap_or(node)).or_default().push(node);
    }
    sets
}

/// The level next to `level` among those that lie in the ranges of all nodes of a set.
fn common_level(hierarchy: &Hierarchy, set: &[u32], level: u8) -> Option<u8> {
    let ends = |node: &u32| {
        let grades = hierarchy.grades(*node);
        (grades.first().map_or(0, |grade| grade.level), grades.last().map_or(0, |grade| grade.level))
    };
    let coarsest = set.iter().map(|node| ends(node).0).max()?;
    let finest = set.iter().map(|node| ends(node).1).min()?;
    (coarsest <= finest).then(|| level.clamp(coarsest, finest))
}
