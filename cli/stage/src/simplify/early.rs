//! The collapses of an attempt's sweeps, which a later attempt with other weights repeats.
//!
//! These lie far below the threshold, where weights matter only at the vertices that have them. So an attempt that
//! keeps some places finer repeats them without looking, except at these places. (Charts of the dragon are tried 46
//! times for 26 of them.)

use glam::DVec3;

use super::collapse::{Collapser, STRICT};

/// A collapse that was carried out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Merge {
    pub half_edge: u32,
    pub removed: u32,
    /// Where the other end of the half-edge lies afterwards.
    pub target: DVec3,
}

/// The collapses of the sweeps of an attempt at a chart.
#[derive(Clone, Debug)]
pub struct Early {
    pub(super) merges: Vec<Merge>,
    /// The factors that vertices had; the list may be shorter.
    pub(super) importance: Vec<f32>,
}

impl Early {
    /// Repeats the collapses in the chart as it was, where the factors of vertices are the same.
    pub(super) fn repeat(&self, collapser: &mut Collapser<'_>, importance: Option<&[f32]>) {
        let factor = |list: &[f32], v: usize| list.get(v).copied().unwrap_or(1.0);
        let count = collapser.positions.len();
        let is_other = |v| factor(importance.unwrap_or_default(), v) != factor(&self.importance, v);
        let (mut differs, mut is_beside) = (vec![false; count], vec![false; count]);
        let mut ring = vec![];
        // What touches a vertex that differs has to be checked; the rest is as it was.
        let mut spread = |collapser: &Collapser<'_>, differs: &mut [bool], is_beside: &mut [bool], v: u32| {
            if collapser.mesh.is_alive(v) && !std::mem::replace(&mut differs[v as usize], true) {
                collapser.mesh.ring(v, &mut ring);
                ring.iter().for_each(|&beside| is_beside[beside as usize] = true);
            }
        };
        for v in (0..count as u32).filter(|&v| is_other(v as usize)) {
            spread(collapser, &mut differs, &mut is_beside, v);
        }
        for &Merge { half_edge, removed, target } in &self.merges {
            // None if one of both has been part of something else since.
            let kept = collapser.mesh.other_end(half_edge, removed);
            if let Some(kept) = kept {
                let ends = [removed, kept].map(|v| v as usize);
                let may_differ = ends.iter().any(|&v| differs[v]);
                let is_checked = ends.iter().any(|&v| is_beside[v]);
                if !may_differ && collapser.merge(half_edge, [removed, kept], target, is_checked.then_some(STRICT)) {
                    is_beside[kept as usize] |= is_beside[removed as usize];
                    continue;
                }
            }
            for v in [removed].into_iter().chain(kept) {
                spread(collapser, &mut differs, &mut is_beside, v);
            }
        }
    }
}
