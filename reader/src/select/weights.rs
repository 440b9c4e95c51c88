//! Weights of errors: pixels per world unit, or one without a view.

use super::hierarchy::Hierarchy;
use crate::select::view::{Projection, Volume};

/// The part of space that a query is about.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Scope {
    pub volume: Option<Volume>,
    pub projection: Option<Projection>,
}

impl Scope {
    /// The factor for a box: 0 outside, 1 inside without a view.
    pub(crate) fn factor(&self, bounds: [[f64; 3]; 2]) -> f64 {
        if self.volume.is_some_and(|volume| !volume.meets(bounds)) {
            return 0.0;
        }
        self.projection.map_or(1.0, |projection| projection.look(bounds).factor)
    }
}

/// The weight of each node of a cut: the factor of its box or a little more.
///
/// With **play** the weights stay the same while the camera moves little: a weight is set up to `play` too large, and
/// its limit tells how far the picture may move before the weight could be too small, or more than `play` too large
/// (bounded priority change, which the coherent algorithms need: Niski 2007, section 4.1.1). The logarithm of a factor
/// changes by at most 3 / depth per world unit of motion in the camera's axes, since the depth and the largest distance
/// change by at most one. So a ratio r > 1 is not used up before depth (1 - r^(-1/3)), which is at least depth (1 -
/// 1/r) / 3.
#[derive(Clone, Debug)]
pub(crate) struct Weights {
    scope: Scope,
    play: f64,
    values: Vec<f64>,
    /// A weight has to be computed again when travel + turn * reach > limit.
    limits: Vec<f64>,
    reaches: Vec<f64>,
    /// Nodes outside mostly lie together, so bundles of roots save looking at each.
    bundles: Vec<Bundle>,
    /// Nodes of the cut that are inside and counted in their bundles.
    is_counted: Vec<bool>,
    travel: f64,
    turn: f64,
    look_count: u64,
}

/// Some roots, and all nodes below them.
#[derive(Clone, Copy, Debug)]
struct Bundle {
    /// All of it is outside, until `limit` is reached.
    is_asleep: bool,
    limit: f64,
    reach: f64,
    /// Nodes of the cut that are inside.
    inside_count: u32,
}

impl Weights {
    pub(crate) fn new(hierarchy: &Hierarchy, scope: Scope, play: f64) -> Self {
        let count = hierarchy.node_count() as usize;
        let awake = Bundle { is_asleep: false, limit: 0.0, reach: 0.0, inside_count: 0 };
        let mut this = Self {
            scope,
            play,
            values: vec![0.0; count],
            limits: vec![f64::INFINITY; count],
            reaches: vec![0.0; count],
            bundles: vec![awake; hierarchy.bundle_bounds().len()],
            is_counted: vec![false; count],
            travel: 0.0,
            turn: 0.0,
            look_count: 0,
        };
        for bundle in 0..this.bundles.len() as u32 {
            this.look_at_bundle(hierarchy, bundle);
        }
        this
    }

    /// Puts a bundle to sleep if all of it is outside, or else wakes it up.
    fn look_at_bundle(&mut self, hierarchy: &Hierarchy, bundle: u32) {
        self.look_count += 1;
        let bounds = hierarchy.bundle_bounds()[bundle as usize];
        let is_off = self.scope.volume.is_some_and(|volume| !volume.meets(bounds));
        let (travel, turn) = (self.travel, self.turn);
        let state = &mut self.bundles[bundle as usize];
        match self.scope.projection.map(|projection| projection.look(bounds)) {
            _ if is_off => (state.is_asleep, state.limit) = (true, f64::INFINITY),
            Some(visibility) if visibility.factor == 0.0 => {
                state.is_asleep = true;
                state.reach = visibility.far + visibility.margin;
                state.limit = visibility.margin + travel + turn * state.reach;
            }
            _ => state.is_asleep = false,
        }
    }

    /// Keeps the number of nodes inside; a bundle without any may go to sleep.
    fn count(&mut self, hierarchy: &Hierarchy, node: u32, is_inside: bool) {
        if std::mem::replace(&mut self.is_counted[node as usize], is_inside) == is_inside {
            return;
        }
        let bundle = hierarchy.bundle(node);
        let state = &mut self.bundles[bundle as usize];
        state.inside_count = if is_inside { state.inside_count + 1 } else { state.inside_count - 1 };
        if state.inside_count == 0 {
            self.look_at_bundle(hierarchy, bundle);
            if self.bundles[bundle as usize].is_asleep {
                for &member in hierarchy.bundle_nodes(bundle) {
                    self.limits[member as usize] = f64::INFINITY;
                }
            }
        }
    }

    pub(crate) fn scope(&self) -> &Scope {
        &self.scope
    }

    pub(crate) fn get(&self, node: u32) -> f64 {
        self.values[node as usize]
    }

    /// How many boxes have been projected.
    pub(crate) fn look_count(&self) -> u64 {
        self.look_count
    }

    /// The factor of any node, in the cut or not. Changes no weight.
    pub(crate) fn glance(&mut self, hierarchy: &Hierarchy, node: u32) -> f64 {
        self.look_count += 1;
        self.scope.factor(hierarchy.bounds(node))
    }

    /// The weight that a node would enter the cut with. Changes none.
    pub(crate) fn foresee(&mut self, hierarchy: &Hierarchy, node: u32) -> f64 {
        if self.bundles[hierarchy.bundle(node) as usize].is_asleep {
            return 0.0;
        }
        let play = if self.scope.projection.is_some() { self.play / 2.0 } else { 0.0 };
        self.glance(hierarchy, node) * (1.0 + play)
    }

    /// Sets the weight of a node that enters the cut.
    pub(crate) fn weigh(&mut self, hierarchy: &Hierarchy, node: u32) -> f64 {
        if self.bundles[hierarchy.bundle(node) as usize].is_asleep {
            (self.values[node as usize], self.limits[node as usize]) = (0.0, f64::INFINITY);
            return 0.0;
        }
        let value = self.look_and_weigh(hierarchy, node);
        self.count(hierarchy, node, value > 0.0);
        value
    }

    fn look_and_weigh(&mut self, hierarchy: &Hierarchy, node: u32) -> f64 {
        self.look_count += 1;
        let (at, bounds) = (node as usize, hierarchy.bounds(node));
        self.limits[at] = f64::INFINITY;
        if self.scope.volume.is_some_and(|volume| !volume.meets(bounds)) {
            self.values[at] = 0.0;
            return 0.0;
        }
        let Some(projection) = self.scope.projection else {
            self.values[at] = 1.0;
            return 1.0;
        };
        let visibility = projection.look(bounds);
        let mut slack = visibility.margin;
        if visibility.factor == 0.0 {
            self.values[at] = 0.0;
        } else if self.play == 0.0 {
            (self.values[at], slack) = (visibility.factor, 0.0);
        } else {
            let old = self.values[at];
            // A weight that is well inside its play stays, so that nothing that depends on it has to change.
            let stays = visibility.factor > old * (1.0 - 0.75 * self.play)
                && visibility.factor < old * (1.0 - 0.25 * self.play);
            let value = if stays { old } else { visibility.factor * (1.0 + self.play / 2.0) };
            self.values[at] = value;
            let until = |ratio: f64| visibility.depth * (1.0 - ratio) / 3.0;
            slack =
                slack.min(until(visibility.factor / value)).min(until(value * (1.0 - self.play) / visibility.factor));
        }
        let reach = visibility.far + slack;
        self.reaches[at] = reach;
        self.limits[at] = slack + self.travel + self.turn * reach;
        self.values[at]
    }

    /// Forgets a node that has left the cut.
    pub(crate) fn forget(&mut self, node: u32, hierarchy: &Hierarchy) {
        self.limits[node as usize] = f64::INFINITY;
        if std::mem::replace(&mut self.is_counted[node as usize], false) {
            // Not a reason to look at the bundle: another node takes this one's place.
            self.bundles[hierarchy.bundle(node) as usize].inside_count -= 1;
        }
    }

    /// Changes the scope. Returns the nodes that have to be weighed again, of which some may not be in the cut.
    pub(crate) fn move_to(&mut self, hierarchy: &Hierarchy, scope: Scope) -> Vec<u32> {
        let before = std::mem::replace(&mut self.scope, scope);
        let motion = match (scope.projection, before.projection) {
            (Some(now), Some(then)) => now.motion_since(&then),
            (None, None) => Some((0.0, 0.0)),
            _ => None,
        };
        let Some((travel, turn)) = motion.filter(|_| scope.volume == before.volume) else {
            for bundle in 0..self.bundles.len() as u32 {
                self.bundles[bundle as usize].is_asleep = false;
                if self.bundles[bundle as usize].inside_count == 0 {
                    self.look_at_bundle(hierarchy, bundle);
                }
            }
            return (0..hierarchy.node_count()).collect();
        };
        self.travel += travel;
        self.turn += turn;
        let (travel, turn) = (self.travel, self.turn);
        let mut woken: Vec<u32> = Vec::new();
        for number in 0..self.bundles.len() as u32 {
            let bundle = &self.bundles[number as usize];
            if bundle.is_asleep && travel + turn * bundle.reach > bundle.limit {
                self.look_at_bundle(hierarchy, number);
                if !self.bundles[number as usize].is_asleep {
                    woken.extend(hierarchy.bundle_nodes(number));
                }
            }
        }
        // One look at two numbers a node, in order: a tenth of a millisecond for 100,000 nodes.
        let due = self.limits.iter().zip(&self.reaches).map(|(limit, reach)| travel + turn * reach > *limit);
        let mut nodes: Vec<u32> = (0..).zip(due).filter(|&(_, due)| due).map(|(node, _)| node).collect();
        nodes.extend(woken);
        nodes
    }
}
