//! How much of what is newly drawn goes in one frame, and what stays drawn until the rest has gone.

use std::{cmp::Reverse, collections::BTreeMap, sync::Arc};

use super::{content::FileContent, drawn_surface::DrawnSurface};
use crate::sorted::in_order;

/// Surfaces that come, and the drawn roots whose place they take. None of these can go without the others: a group and
/// what it splits into cover the same.
#[derive(Debug, Default)]
struct Step {
    /// Numbers of the surfaces.
    new: Vec<usize>,
    old: Vec<u32>,
    bytes: u64,
    /// By how many levels the picture becomes finer at most.
    finer: i32,
}

/// Of the surfaces to draw, sorted by root, those that a frame may draw which uploads at most so many bytes, and in
/// place of the others those that are drawn there, sorted, too. Returns them, and how many wait.
///
/// What gains most levels goes first. One step always goes, however large it is, and so does what nothing is drawn in
/// place of: pictures have no holes.
pub(super) fn paced(
    content: &FileContent,
    drawn: &[Arc<DrawnSurface>],
    surfaces: Vec<Arc<DrawnSurface>>,
    most: u64,
) -> (Vec<Arc<DrawnSurface>>, usize) {
    let steps = steps(content, drawn, &surfaces);
    let (steps, coming): (Vec<Step>, Vec<Step>) = steps.into_values().partition(|step| !step.old.is_empty());
    let mut used: u64 = coming.iter().map(|step| step.bytes).sum();
    let mut in_turn: Vec<&Step> = steps.iter().collect();
    in_turn.sort_by_key(|step| Reverse(step.finer));
    let mut waits = vec![false; surfaces.len()];
    let mut stay = Vec::new();
    for (number, step) in in_turn.into_iter().enumerate() {
        if number == 0 || used.saturating_add(step.bytes) <= most {
            used += step.bytes;
            continue;
        }
        step.new.iter().for_each(|&at| waits[at] = true);
        stay.extend(step.old.iter().filter_map(|&root| of_root(drawn, root).cloned()));
    }
    if stay.is_empty() {
        return (surfaces, 0);
    }
    let wait_count = waits.iter().filter(|&&waits| waits).count();
    let going = surfaces.into_iter().zip(waits).filter(|(_, waits)| !waits).map(|(surface, _)| surface);
    let all: Vec<Arc<DrawnSurface>> = going.chain(stay).collect();
    let order = in_order(all.iter().map(|surface| surface.root));
    (order.into_iter().map(|at| Arc::clone(&all[at as usize])).collect(), wait_count)
}

/// The steps from the picture to the surfaces, by a root that both sides of each are at or below.
fn steps(content: &FileContent, drawn: &[Arc<DrawnSurface>], surfaces: &[Arc<DrawnSurface>]) -> BTreeMap<u32, Step> {
    let mut steps = BTreeMap::<u32, Step>::new();
    for (at, surface) in surfaces.iter().enumerate() {
        let mut above = content.above(surface.root);
        let before = of_root(drawn, surface.root).or_else(|| above.find_map(|root| of_root(drawn, root)));
        if before.is_some_and(|before| Arc::ptr_eq(before, surface)) {
            continue;
        }
        let old = before.map(|before| before.root);
        let step = steps.entry(old.unwrap_or(surface.root)).or_default();
        step.new.push(at);
        step.old = old.into_iter().collect();
        step.bytes += surface.byte_count();
        let level = before.map_or(-1, |before| i32::from(before.level));
        step.finer = step.finer.max(i32::from(surface.level) - level);
    }
    let is_wanted = |root: u32| of_root(surfaces, root).is_some();
    for old in drawn.iter().map(|surface| surface.root) {
        if is_wanted(old) || steps.contains_key(&old) {
            continue;
        }
        // What is drawn in its place from now on, if it has not just left the view.
        if let Some(step) = content.above(old).find(|&root| is_wanted(root)).and_then(|root| steps.get_mut(&root)) {
            step.old.push(old);
            step.finer = 0;
        }
    }
    steps
}

fn of_root(surfaces: &[Arc<DrawnSurface>], root: u32) -> Option<&Arc<DrawnSurface>> {
    surfaces.get(surfaces.binary_search_by_key(&root, |surface| surface.root).ok()?)
}
