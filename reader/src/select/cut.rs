//! Queries and cuts: what is asked for, and the answer.

use std::sync::Arc;

use super::{
    adaptation::{Adaptation, Goal},
    from_scratch::Later,
    front::Front,
    hierarchy::Hierarchy,
    weights::{Scope, Weights},
};
use crate::{
    error::{Error, Result},
    format::header::FileId,
    objects::ObjectFilter,
    select::{
        View,
        view::{Projection, Volume},
    },
};

/// What to do with roots outside a query's volume and view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    /// They are not drawn.
    #[default]
    Drop,
    /// They are drawn at level 0.
    Coarsest,
}

/// What to draw, and how finely. The default asks for everything at the finest level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Query {
    /// Roots whose boxes meet it are inside. Without a volume all roots are.
    pub volume: Option<Volume>,
    /// The view to draw: what it does not show is outside, and its pixel tolerance replaces `tolerance`.
    pub view: Option<View>,
    /// What to do with roots outside the volume and the view.
    pub outside: Outside,
    /// The error to reach inside, world units. Without a tolerance the cut is as fine as possible.
    pub tolerance: Option<f64>,
    /// Triangle budget of the mesh.
    pub max_triangles: Option<u64>,
    /// Node budget of the cut.
    pub max_nodes: Option<u64>,
    /// Budget for the bytes of all pages that the cut's blocks and their coarser levels need.
    pub max_bytes: Option<u64>,
    /// Which objects are drawn; all of them without a filter ([`crate::File::hide`], [`crate::File::only`],
    /// [`crate::index::Objects::filter`]). Roots that show nothing else than hidden objects are not drawn, and groups
    /// that show some of them are split. Budgets count whole roots, so the mesh may have fewer triangles.
    pub objects: Option<Arc<ObjectFilter>>,
}

/// A root at a level. (Hierarchies that were not made from a file may have nodes that are no roots.)
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// The root's number; in a hierarchy that was not made from a file, the node's.
    pub root: u32,
    /// The level at which it is drawn.
    pub level: u8,
}

/// Why a cut is not finer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Limiter {
    /// It meets the tolerance.
    Tolerance,
    /// The file has nothing finer where the query needs it.
    #[default]
    Finest,
    /// A finer one would have too many triangles.
    Triangles,
    /// A finer one would have too many nodes.
    Nodes,
    /// A finer one would need too many bytes.
    Bytes,
}

/// A level for each root that is drawn.
///
/// # How a cut is drawn
///
/// Two roots meet along arcs. Every arc is drawn with the samples of the finest level among its roots in the cut. A
/// root that is coarser there takes the finer neighbour's samples into its border triangles: each sample splits the
/// triangle at its edge into two, fanned from the opposite vertex. So roots of any levels meet without a crack, and no
/// vertex moves.
///
/// The samples that a root takes lie on the surface that its neighbour draws, not on its own. So its error is that of
/// its block and, where any neighbour brings samples that it lacks, the block's border deviation added to it: see
/// [`crate::index::BlockContents`]. [`Cut::node_errors`] has these sums.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cut {
    /// Sorted by root.
    pub nodes: Vec<Node>,
    /// Bound of the error of each node as this cut draws it, world units.
    pub node_errors: Vec<f64>,
    /// The largest of them inside the volume and the view, where the tolerance holds. What is drawn outside may have
    /// larger errors: the largest of `node_errors` bounds everything.
    pub error: f64,
    /// The largest error in the view, pixels; 0 without a view.
    pub pixel_error: f64,
    /// Exact number of triangles of the mesh.
    pub triangle_count: u64,
    /// Bytes of pages that the cut needs, coarser levels included; 0 unless the query had a byte budget.
    pub byte_count: u64,
    /// Why it is not finer.
    pub limited_by: Limiter,
    /// The budget that the cut exceeds. Only an [`super::Adapter`] makes such cuts, where even the coarsest cut exceeds
    /// it.
    pub exceeded: Option<Limiter>,
    /// The file that it was selected in: another file refuses it. None for cuts that were put together by hand.
    pub file: Option<FileId>,
    /// Which objects its mesh has, as the query said. `triangle_count` and `byte_count` are of whole roots then.
    pub objects: Option<Arc<ObjectFilter>>,
}

impl Cut {
    /// Bound of the error of everything that is drawn, also outside the volume and the view; `error` bounds what is
    /// inside.
    pub fn error_everywhere(&self) -> f64 {
        self.node_errors.iter().copied().fold(self.error, f64::max)
    }
}

impl Limiter {
    /// Its name in every language.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tolerance => "tolerance",
            Self::Finest => "finest",
            Self::Triangles => "triangles",
            Self::Nodes => "nodes",
            Self::Bytes => "bytes",
        }
    }
}

impl Query {
    /// The volume and view of the query, checked.
    ///
    /// # Errors
    /// [`Error::Query`] if something in the query is not a number or makes no sense.
    pub(crate) fn scope(&self) -> Result<Scope> {
        if self.tolerance.is_some_and(|tolerance| tolerance.is_nan() || tolerance < 0.0) {
            return Err(Error::Query { what: "a tolerance must be zero or more".into() });
        }
        if self.view.is_some_and(|view| view.pixel_tolerance.is_nan() || view.pixel_tolerance < 0.0) {
            return Err(Error::Query { what: "a pixel tolerance must be zero or more".into() });
        }
        if self.view.is_some() && self.tolerance.is_some() {
            return Err(Error::Query {
                what: "a query with a view takes its tolerance from the view, in pixels; leave `tolerance` unset"
                    .into(),
            });
        }
        self.volume.map_or(Ok(()), |volume| volume.check())?;
        Ok(Scope { volume: self.volume, projection: self.view.as_ref().map(Projection::new).transpose()? })
    }

    pub(crate) fn goal(&self, hysteresis: f64) -> Goal {
        let none = Goal::none();
        Goal {
            tolerance: self.view.map(|view| view.pixel_tolerance).or(self.tolerance).unwrap_or(none.tolerance),
            triangles: self.max_triangles.unwrap_or(none.triangles),
            nodes: self.max_nodes.unwrap_or(none.nodes),
            bytes: self.max_bytes.unwrap_or(none.bytes),
            hysteresis,
        }
    }

    /// Whether the query has a budget to spend where it lowers the error most, so nodes have to be ordered by error.
    pub(crate) fn has_budget(&self) -> bool {
        self.max_triangles.is_some() || self.max_bytes.is_some()
    }
}

/// Finds the cut for a query from scratch: that of the smallest threshold within the budgets, and
/// then as far as the queues change it.
///
/// # Errors
/// [`Error::Query`] if no cut keeps the budgets (the message says what the coarsest takes), or something in the query
/// is not a number.
pub fn select_in(hierarchy: &Arc<Hierarchy>, query: &Query) -> Result<Cut> {
    Ok(adapt_from_scratch(hierarchy, query)?.cut())
}

pub(crate) fn adapt_from_scratch(hierarchy: &Arc<Hierarchy>, query: &Query) -> Result<Adaptation> {
    let hierarchy = hierarchy.showing(query.objects.as_ref())?;
    let weights = Weights::new(&hierarchy, query.scope()?, 0.0);
    let front = Front::new(hierarchy, weights, query.outside == Outside::Coarsest);
    let goal = query.goal(0.0);
    check_budgets(&goal, &front)?;
    Ok(Adaptation::from_scratch(front, goal, query.has_budget(), Later::Done))
}

/// # Errors
/// [`Error::Query`] if the coarsest cut is above a budget.
pub(crate) fn check_budgets(goal: &Goal, coarsest: &Front) -> Result<()> {
    let (least, what) = match goal.exceeded(coarsest) {
        None => return Ok(()),
        Some(Limiter::Nodes) => (coarsest.node_count, "nodes"),
        Some(Limiter::Bytes) => (coarsest.byte_count, "bytes of pages"),
        Some(_) => (coarsest.triangle_count, "triangles"),
    };
    Err(Error::Query { what: format!("the query needs at least {least} {what}") })
}

impl Adaptation {
    /// The cut as it is.
    pub(crate) fn cut(&self) -> Cut {
        Cut { limited_by: self.limiter(), ..self.front.cut() }
    }
}

impl Front {
    /// The cut as it is, whatever limits it.
    pub(crate) fn cut(&self) -> Cut {
        let (triangle_count, byte_count, file) = (self.triangle_count, self.byte_count, self.hierarchy.file());
        let objects = self.hierarchy.filter().cloned();
        let mut cut = Cut { triangle_count, byte_count, file, objects, ..Cut::default() };
        let has_view = self.weights.scope().projection.is_some();
        for node in (0..self.hierarchy.node_count()).filter(|&node| self.is_drawn(node)) {
            let resolution = self.resolution(node);
            let error = self.world_error(node, resolution);
            let level = self.hierarchy.level(node, resolution);
            cut.nodes.push(Node { root: self.hierarchy.id(node), level });
            cut.node_errors.push(error);
            if self.is_inside(node) {
                cut.error = cut.error.max(error);
                cut.pixel_error = if has_view { cut.pixel_error.max(error * self.weights.get(node)) } else { 0.0 };
            }
        }
        cut
    }
}
