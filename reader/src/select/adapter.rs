//! A cut that follows the camera.

use std::{collections::BTreeMap, sync::Arc};

use super::{
    adaptation::{Adaptation, Goal},
    cut::{Cut, Limiter, Outside, Query},
    from_scratch::Later,
    front::{ABSENT, Front},
    hierarchy::Hierarchy,
    quad_queue::Effort,
    weights::{Scope, Weights},
};
use crate::error::Result;

/// How far a cut may lag behind the camera, so that it changes little from frame to frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coherence {
    /// A node becomes coarser only if its error then stays below the tolerance by this fraction, 0 to 1. Splits, merges
    /// and making room in a budget have the same threshold (Niski 2007, section 4.3).
    pub hysteresis: f64,
    /// Screen errors may be overestimated by this fraction, 0 to 1, so that they need not be computed again while the
    /// camera moves little.
    pub play: f64,
}

impl Default for Coherence {
    fn default() -> Self {
        Self { hysteresis: 0.1, play: 0.125 }
    }
}

/// A node that is drawn differently from the frame before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The root, as in [`super::Node`].
    pub root: u32,
    /// Its level now; `None` if it is no longer drawn.
    pub level: Option<u8>,
}

/// What an update changed, and what the cut takes now.
#[derive(Clone, Debug, PartialEq)]
pub struct AdaptReport {
    /// Nodes that are drawn differently, ascending.
    pub changes: Vec<Change>,
    /// Exact number of triangles of the mesh.
    pub triangle_count: u64,
    /// Number of nodes.
    pub node_count: u64,
    /// Bytes of pages that the cut needs.
    pub byte_count: u64,
    /// Why it is not finer.
    pub limited_by: Limiter,
    /// The budget that the cut exceeds because even the coarsest cut of the visible roots does.
    pub exceeded: Option<Limiter>,
    /// Boxes projected and errors evaluated in this frame.
    pub evaluation_count: u64,
}

/// Keeps a cut from frame to frame and changes only what has to change: by the quad-queue where triangles or bytes are
/// limited, else by the dual-queue.
///
/// The cut depends on the frames before. In every frame it is whole, keeps the budgets, and meets the tolerance unless
/// a budget or the file forbids it. No camera knows which budgets its next frame can keep, so no budget fails a frame.
/// A budget that even the coarsest cut of the visible roots exceeds is raised to what that cut takes, and
/// [`AdaptReport::exceeded`] names it.
#[derive(Clone, Debug)]
pub struct Adapter {
    /// What is chosen from where a query wants other objects.
    whole: Arc<Hierarchy>,
    adaptation: Adaptation,
    coherence: Coherence,
    query: Query,
    /// The levels that the last frame drew.
    shown: Vec<u8>,
    /// Frames left without proposals of splits and merges, after one was undone.
    rest: u32,
    /// Whether nothing has been reported yet.
    is_fresh: bool,
}

/// Frames without proposals of splits and merges after one that gained nothing.
const REST: u32 = 8;

impl Adapter {
    /// Chooses a cut for a first query from scratch.
    ///
    /// # Errors
    /// As for [`Adapter::update`].
    pub fn new(hierarchy: Arc<Hierarchy>, query: &Query, coherence: Coherence) -> Result<Self> {
        let adaptation = start(&hierarchy, query, coherence)?;
        let shown = vec![ABSENT; adaptation.front.hierarchy.node_count() as usize];
        Ok(Self { whole: hierarchy, adaptation, coherence, query: query.clone(), shown, rest: 0, is_fresh: true })
    }

    /// Adapts the cut to a query.
    ///
    /// # Errors
    /// [`crate::Error::Query`] if something in the query is not a number or makes no sense, or its objects are not
    /// those that the hierarchy was made for ([`Hierarchy::for_query`]); the cut stays as it is.
    pub fn update(&mut self, query: &Query) -> Result<AdaptReport> {
        let scope = query.scope()?;
        let goal = query.goal(self.coherence.hysteresis);
        let before = self.adaptation.front.evaluation_count();
        if let Some(filter) = query.objects.as_ref().or(self.query.objects.as_ref()) {
            filter.is_there();
            if query.objects != self.query.objects {
                return self.show_others(query);
            }
        }
        let is_new = query.has_budget() != self.query.has_budget()
            || query.outside != self.query.outside
            || query.volume != self.query.volume
            || query.view.is_some() != self.query.view.is_some();
        if is_new {
            let hierarchy = Arc::clone(&self.adaptation.front.hierarchy);
            self.adaptation = start(&hierarchy, query, self.coherence)?;
            (self.query, self.is_fresh) = (query.clone(), false);
            let everything = 0..hierarchy.node_count();
            let evaluation_count = self.adaptation.front.evaluation_count();
            return Ok(self.report(everything.collect(), evaluation_count));
        }
        let mut nodes = if std::mem::replace(&mut self.is_fresh, false) {
            (0..self.shown.len() as u32).collect()
        } else {
            Vec::new()
        };
        nodes.extend(self.move_to(query, scope, goal));
        self.adapt();
        if self.adaptation.goal.exceeded(&self.adaptation.front).is_some() {
            // No cut keeps the budgets, so each becomes at least what the coarsest cut takes.
            self.adaptation.front.reset();
            self.adaptation.goal = goal.within_reach(&self.adaptation.front);
            self.adapt();
        }
        nodes.extend(self.adaptation.front.changed_since(0).iter().map(|&(node, _)| node));
        nodes.sort_unstable();
        nodes.dedup();
        let evaluation_count = self.adaptation.front.evaluation_count() - before;
        Ok(self.report(nodes, evaluation_count))
    }

    /// Starts from scratch for a query that wants other objects, which have nodes of other numbers.
    fn show_others(&mut self, query: &Query) -> Result<AdaptReport> {
        let adaptation = start(&self.whole, query, self.coherence)?;
        let before = std::mem::replace(&mut self.adaptation, adaptation).front.hierarchy;
        let hierarchy = Arc::clone(&self.adaptation.front.hierarchy);
        let shown = std::mem::replace(&mut self.shown, vec![ABSENT; hierarchy.node_count() as usize]);
        (self.query, self.is_fresh, self.rest) = (query.clone(), false, 0);
        let was_drawn = (0..).zip(shown).filter(|&(_, level)| level != ABSENT);
        let mut gone: BTreeMap<u32, u8> = was_drawn.map(|(node, level)| (before.id(node), level)).collect();
        let evaluation_count = self.adaptation.front.evaluation_count();
        let mut report = self.report((0..hierarchy.node_count()).collect(), evaluation_count);
        report.changes.retain(|change| gone.remove(&change.root) != change.level);
        report.changes.extend(gone.into_keys().map(|root| Change { root, level: None }));
        report.changes.sort_unstable_by_key(|change| change.root);
        Ok(report)
    }

    fn adapt(&mut self) {
        if self.query.has_budget() {
            let rounds = if self.rest == 0 { Effort::FRAME.rounds } else { 0 };
            let kept = self.adaptation.adapt_quad_queue(Effort { rounds, ..Effort::FRAME });
            self.rest = if kept { self.rest.saturating_sub(1) } else { REST };
        } else {
            self.adaptation.adapt_dual_queue();
        }
    }

    /// Changes the weights of errors, and the goal. Returns the nodes whose visibility may have changed.
    fn move_to(&mut self, query: &Query, scope: Scope, goal: Goal) -> Vec<u32> {
        let adaptation = &mut self.adaptation;
        let front = &mut adaptation.front;
        front.clear_journal();
        if goal.tolerance != adaptation.goal.tolerance {
            front.mark_all();
        }
        let hierarchy = Arc::clone(&front.hierarchy);
        let due = front.weights.move_to(&hierarchy, scope);
        let due: Vec<u32> = due.into_iter().filter(|&node| front.contains(node)).collect();
        for &node in &due {
            front.weigh_again(node);
        }
        // Without trees no cut has other nodes than this one, so a node budget below these needs no second try.
        let node_count = if hierarchy.has_children() { 0 } else { front.node_count };
        adaptation.goal = Goal { nodes: goal.nodes.max(node_count), ..goal };
        self.query = query.clone();
        due
    }

    /// The cut as it is. Looks at every node.
    pub fn cut(&self) -> Cut {
        Cut { exceeded: self.exceeded(), ..self.adaptation.cut() }
    }

    fn exceeded(&self) -> Option<Limiter> {
        self.query.goal(0.0).exceeded(&self.adaptation.front)
    }

    /// The hierarchy that it was made with.
    pub(crate) fn whole(&self) -> &Arc<Hierarchy> {
        &self.whole
    }

    /// The hierarchy that the cut is chosen from: that of the objects which the last query wanted.
    pub fn hierarchy(&self) -> &Arc<Hierarchy> {
        &self.adaptation.front.hierarchy
    }

    /// Boxes projected and errors evaluated since the adapter was made.
    pub fn evaluation_count(&self) -> u64 {
        self.adaptation.front.evaluation_count()
    }

    /// Whether a node may be visible beyond the view's window.
    pub(crate) fn crosses_window(&self, node: u32) -> bool {
        let front = &self.adaptation.front;
        let projection = front.weights.scope().projection;
        projection.is_none_or(|projection| !projection.holds(front.hierarchy.bounds(node)))
    }

    /// Whether the query has a budget besides its tolerance.
    pub(crate) fn is_limited(&self) -> bool {
        self.query.has_budget() || self.query.max_nodes.is_some()
    }

    /// Whether an error of a node, world units, is within the tolerance of the view.
    pub(crate) fn meets_tolerance(&self, node: u32, error: f64) -> bool {
        let front = &self.adaptation.front;
        front.weights.scope().factor(front.hierarchy.bounds(node)) * error <= self.adaptation.goal.tolerance
    }

    /// The drawn nodes of the cut with their resolutions. Looks at every node.
    pub(crate) fn drawn(&self) -> BTreeMap<u32, u8> {
        let front = &self.adaptation.front;
        let drawn = (0..front.hierarchy.node_count()).filter(|&node| front.is_drawn(node));
        drawn.map(|node| (node, front.resolution(node))).collect()
    }

    fn report(&mut self, nodes: Vec<u32>, evaluation_count: u64) -> AdaptReport {
        let front = &self.adaptation.front;
        let mut changes = Vec::new();
        for node in nodes {
            let level = front.level(node);
            if std::mem::replace(&mut self.shown[node as usize], level) != level {
                changes.push(Change { root: front.hierarchy.id(node), level: (level != ABSENT).then_some(level) });
            }
        }
        AdaptReport {
            changes,
            triangle_count: front.triangle_count,
            node_count: front.node_count,
            byte_count: front.byte_count,
            limited_by: self.adaptation.limiter(),
            exceeded: self.exceeded(),
            evaluation_count,
        }
    }
}

fn start(hierarchy: &Arc<Hierarchy>, query: &Query, coherence: Coherence) -> Result<Adaptation> {
    let hierarchy = hierarchy.showing(query.objects.as_ref())?;
    let weights = Weights::new(&hierarchy, query.scope()?, coherence.play.clamp(0.0, 0.9));
    let front = Front::new(hierarchy, weights, query.outside == Outside::Coarsest);
    let goal = query.goal(coherence.hysteresis.clamp(0.0, 0.9));
    let goal = goal.within_reach(&front);
    Ok(Adaptation::from_scratch(front, goal, query.has_budget(), Later::Frames))
}
