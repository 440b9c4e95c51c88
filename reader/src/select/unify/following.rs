//! Tiles that follow one camera: their cuts are adapted side by side, then unified.

use std::{
    collections::BTreeMap,
    num::NonZeroUsize,
    sync::Arc,
    thread,
    time::{Duration, Instant},
};

use super::{Unification, Unified, unify_cuts};
use crate::{
    error::{Error, Result},
    select::{AdaptReport, Adapter, Coherence, Hierarchy, Node, Query},
};

/// The cuts of the tiles of a picture, kept from frame to frame: an [`Adapter`] each, all over one hierarchy.
#[derive(Clone, Debug)]
pub struct Tiles {
    adapters: Vec<Adapter>,
    unification: Unification,
}

/// What an update of [`Tiles`] has found.
#[derive(Clone, Debug)]
pub struct TilesReport {
    /// What each tile draws, and what all of them draw together.
    pub unified: Unified,
    /// Of each tile alone, before unification.
    pub tiles: Vec<AdaptReport>,
    /// How long each tile took, without unification.
    pub times: Vec<Duration>,
}

impl Tiles {
    /// Begins with a query for each tile, from scratch: those of [`super::TileTree::queries`], or of the displays of a
    /// wall.
    ///
    /// # Errors
    /// As [`Adapter::new`].
    pub fn new(
        hierarchy: &Arc<Hierarchy>,
        queries: &[Query],
        coherence: Coherence,
        unification: Unification,
    ) -> Result<Self> {
        let start = |query| Adapter::new(Arc::clone(hierarchy), query, coherence);
        let adapters = queries.iter().map(start).collect::<Result<_>>()?;
        Ok(Self { adapters, unification })
    }

    /// Adapts all tiles to their queries, on as many threads as there are processors, and unifies their cuts.
    ///
    /// # Errors
    /// [`Error::Query`] if there is not one query for each tile; as [`Adapter::update`], and then tiles may have moved.
    pub fn update(&mut self, queries: &[Query]) -> Result<TilesReport> {
        let count = self.adapters.len();
        if queries.len() != count {
            return Err(Error::Query { what: format!("{count} tiles need as many queries, not {}", queries.len()) });
        }
        let threads = thread::available_parallelism().map_or(1, NonZeroUsize::get);
        let share = count.div_ceil(threads).max(1);
        let update_one = |(adapter, query): (&mut Adapter, &Query)| {
            let begun = Instant::now();
            adapter.update(query).map(|report| (report, begun.elapsed()))
        };
        let update = |(adapters, queries): (&mut [Adapter], &[Query])| -> Vec<Result<(AdaptReport, Duration)>> {
            adapters.iter_mut().zip(queries).map(update_one).collect()
        };
        let mut shares = self.adapters.chunks_mut(share).zip(queries.chunks(share));
        let own = shares.next();
        let reports = thread::scope(|scope| {
            let others: Vec<_> = shares.map(|share| scope.spawn(|| update(share))).collect();
            let mut reports: Vec<Vec<Result<_>>> = own.into_iter().map(update).collect();
            for other in others {
                match other.join() {
                    Ok(of_share) => reports.push(of_share),
                    Err(panic) => std::panic::resume_unwind(panic),
                }
            }
            reports
        });
        let (tiles, times) = reports.into_iter().flatten().collect::<Result<(Vec<_>, Vec<_>)>>()?;
        Ok(TilesReport { unified: unify_cuts(&self.adapters, self.unification)?, tiles, times })
    }

    /// The nodes of the unified cut that each tile has to have: its own, and those whose boxes touch them, so that its
    /// borders are stitched and lit as in the whole picture. Each list ascends by root.
    pub fn with_neighbours(&self, unified: &Unified) -> Vec<Vec<Node>> {
        let Some(hierarchy) = self.adapters.first().map(Adapter::hierarchy) else { return Vec::new() };
        let boxes = Boxes::new(unified.nodes.iter().filter_map(|&node| Some((node, hierarchy.bounds_of(node.root)?))));
        let with_neighbours = |own: &Vec<Node>| {
            let mut nodes: BTreeMap<u32, u8> = BTreeMap::new();
            for node in own {
                nodes.insert(node.root, node.level);
                let beside = hierarchy.bounds_of(node.root).into_iter().flat_map(|bounds| boxes.touching(bounds));
                nodes.extend(beside.map(|other| (other.root, other.level)));
            }
            nodes.into_iter().map(|(root, level)| Node { root, level }).collect()
        };
        unified.tiles.iter().map(with_neighbours).collect()
    }
}

type Bounds = [[f64; 3]; 2];

/// Nodes by where their boxes begin along the first axis.
struct Boxes {
    sorted: Vec<(Node, Bounds)>,
    /// For each, how far any box so far reaches.
    reach: Vec<f64>,
}

impl Boxes {
    fn new(nodes: impl Iterator<Item = (Node, Bounds)>) -> Self {
        let mut sorted: Vec<(Node, Bounds)> = nodes.collect();
        sorted.sort_by(|(_, a), (_, b)| a[0][0].total_cmp(&b[0][0]));
        let mut most = f64::NEG_INFINITY;
        let reach = sorted.iter().map(|(_, bounds)| {
            most = most.max(bounds[1][0]);
            most
        });
        Self { reach: reach.collect(), sorted }
    }

    /// The nodes whose boxes have a point in common with a box.
    fn touching(&self, [low, high]: Bounds) -> impl Iterator<Item = Node> + '_ {
        let end = self.sorted.partition_point(|(_, bounds)| bounds[0][0] <= high[0]);
        let reaching = (0..end).rev().take_while(move |&at| self.reach[at] >= low[0]);
        let touches = move |&at: &usize| {
            let [other_low, other_high] = self.sorted[at].1;
            (0..3).all(|k| other_low[k] <= high[k] && low[k] <= other_high[k])
        };
        reaching.filter(touches).map(|at| self.sorted[at].0)
    }
}
