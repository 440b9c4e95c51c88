//! Choosing levels: which root is drawn how finely (SPEC.md, "Cuts").
//!
//! Adaptation starts with everything at its coarsest and always refines the root with the largest error (Niski 2007,
//! chapter 4, with a single queue), so that a budget is spent where it counts, and without one the result is the coarsest
//! cut that meets the tolerance: a root is only ever refined when it breaks it, and what its neighbours do cannot mend that.

use std::{
    cmp::Reverse,
    collections::{BinaryHeap, HashMap},
};

use crate::{
    error::{Error, Result},
    error_code::sum_of_bounds,
    file::File,
    index::{ClusterIndex, RootEntry},
    source::ReadAt,
};

/// What to do with roots outside the region of a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Outside {
    /// They are not drawn.
    #[default]
    Drop,
    /// They are drawn at level 0.
    Coarsest,
}

/// What is to be drawn. Without anything: everything at the finest level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Query {
    /// World box; roots whose box meets it are inside. Without one all roots are.
    pub region: Option<[[f64; 3]; 2]>,
    /// What to do with roots outside the region.
    pub outside: Outside,
    /// Error to be reached inside, world units; without one as fine as possible.
    pub tolerance: Option<f64>,
    /// Most triangles of the mesh.
    pub max_triangles: Option<u64>,
    /// Most nodes of the cut.
    pub max_nodes: Option<u64>,
}

/// A root drawn at a level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Which root.
    pub root: u32,
    /// Level of the block that is drawn.
    pub level: u8,
}

/// Why a cut is not finer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Limiter {
    /// It meets the tolerance.
    Tolerance,
    /// The file has nothing finer where it would be needed.
    Finest,
    /// A finer one would have too many triangles.
    Triangles,
}

/// Roots and their levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Cut {
    /// Sorted by root.
    pub nodes: Vec<Node>,
    /// Bound of the error of each node in this cut, world units.
    pub node_errors: Vec<f64>,
    /// The largest of them inside the region.
    pub error: f64,
    /// Exact number of triangles of the mesh.
    pub triangle_count: u64,
    /// Why it is not finer.
    pub limited_by: Limiter,
}

impl<S: ReadAt> File<S> {
    /// Finds the cut for a query, from the index alone.
    ///
    /// # Errors
    /// [`Error::Query`] where the query cannot be met (it says what can) or is not a number; [`Error::Io`],
    /// [`Error::Format`], [`Error::Limit`].
    pub fn select(&self, query: &Query) -> Result<Cut> {
        check(query)?;
        let mut adaptation = Adaptation::new(self, query)?;
        adaptation.check_budgets(query)?;
        let limited_by = adaptation.refine(query);
        Ok(adaptation.cut(limited_by))
    }

    /// The cut that draws every root at `level`, or at the next coarser one that it has.
    ///
    /// # Errors
    /// [`Error::Query`] where the file has no such level; [`Error::Io`], [`Error::Format`], [`Error::Limit`].
    pub fn uniform_cut(&self, level: u8) -> Result<Cut> {
        if usize::from(level) >= self.level_count() {
            return Err(Error::Query {
                what: format!("level {level} does not exist: there are {}", self.level_count()),
            });
        }
        let mut adaptation = Adaptation::new(self, &Query::default())?;
        for node in 0..adaptation.nodes.len() {
            let state = &mut adaptation.nodes[node];
            state.block = state.entry.block_at(level);
        }
        adaptation.recount_triangles();
        Ok(adaptation.cut(Limiter::Finest))
    }

    /// How many boundary edges the mesh of a cut has: those on arcs that only one of its roots uses.
    ///
    /// # Errors
    /// As [`File::select`].
    pub fn boundary_edge_count(&self, cut: &Cut) -> Result<u64> {
        let mut adaptation = Adaptation::of_roots(self, &mut |root, _| {
            cut.nodes.binary_search_by_key(&root, |node| node.root).is_ok().then_some(true)
        })?;
        for (state, node) in adaptation.nodes.iter_mut().zip(&cut.nodes) {
            state.block = state.entry.block_at(node.level);
        }
        let open = adaptation.arcs.iter().filter(|arc| arc.uses.len() == 1);
        Ok(open.map(|arc| arc.sample_count(adaptation.drawn_level(arc)) + 1).sum())
    }

    /// World box around everything that a root draws and around the piece of input that it stands for.
    ///
    /// # Errors
    /// [`Error::Query`] where there is no such root; [`Error::Io`], [`Error::Format`].
    pub fn root_bounds(&self, root: u32) -> Result<[[f64; 3]; 2]> {
        if root >= self.root_count() {
            return Err(Error::Query { what: format!("root {root} does not exist: there are {}", self.root_count()) });
        }
        self.load_indices([self.owner(root, |cluster| cluster.first_root)?])?;
        Ok(self.root_entry(root)?.bounds.map(|point| self.lattice().world(point)))
    }
}

fn check(query: &Query) -> Result<()> {
    if query.tolerance.is_some_and(|tolerance| tolerance.is_nan() || tolerance < 0.0) {
        return Err(Error::Query { what: "a tolerance has to be zero or more".into() });
    }
    if query.region.is_some_and(|[low, high]| !(0..3).all(|axis| low[axis] <= high[axis])) {
        return Err(Error::Query { what: "the smallest corner of a region has to come first".into() });
    }
    Ok(())
}

/// A root while a cut is made.
struct NodeState<'f> {
    root: u32,
    entry: &'f RootEntry,
    /// Index in the entry's blocks.
    block: usize,
    /// Indices of its arcs, each once.
    arcs: Vec<u32>,
    inside: bool,
    /// Cannot be refined further.
    done: bool,
}

impl NodeState<'_> {
    fn level(&self) -> u8 {
        self.entry.blocks[self.block].level
    }
}

/// An arc while a cut is made.
struct ArcState<'f> {
    index: &'f ClusterIndex,
    /// Counted from the cluster's first.
    local: u32,
    /// Nodes that use it, once for each half-arc.
    uses: Vec<u32>,
}

impl ArcState<'_> {
    fn sample_count(&self, level: u8) -> u64 {
        u64::from(self.index.sample_count(self.local, level))
    }
}

/// Whether a root takes part, and if so whether it lies inside the region.
type Keep<'k> = dyn FnMut(u32, &RootEntry) -> Option<bool> + 'k;

struct Adaptation<'f> {
    lattice: crate::Lattice,
    finest: u8,
    nodes: Vec<NodeState<'f>>,
    arcs: Vec<ArcState<'f>>,
    triangle_count: u64,
}

impl<'f> Adaptation<'f> {
    /// Everything that a query is about, at its coarsest.
    fn new<S: ReadAt>(file: &'f File<S>, query: &Query) -> Result<Self> {
        let meets = |bounds: [crate::LatticePoint; 2]| {
            let [low, high] = bounds.map(|point| file.lattice().world(point));
            query.region.is_none_or(|region| (0..3).all(|k| low[k] <= region[1][k] && region[0][k] <= high[k]))
        };
        let keep_all = query.outside == Outside::Coarsest;
        let numbered = (0..).zip(file.clusters());
        let near: Vec<u32> = numbered.filter(|(_, c)| keep_all || meets(c.bounds)).map(|(number, _)| number).collect();
        Self::of_clusters(file, near, &mut |_, entry| {
            let inside = meets(entry.bounds);
            (inside || keep_all).then_some(inside)
        })
    }

    /// The roots for which `keep` says whether they lie inside, at their coarsest.
    fn of_roots<S: ReadAt>(file: &'f File<S>, keep: &mut Keep<'_>) -> Result<Self> {
        Self::of_clusters(file, (0..file.cluster_count()).collect(), keep)
    }

    fn of_clusters<S: ReadAt>(file: &'f File<S>, clusters: Vec<u32>, keep: &mut Keep<'_>) -> Result<Self> {
        file.load_indices(clusters.iter().copied())?;
        let mut nodes: Vec<NodeState<'f>> = Vec::new();
        for number in clusters {
            let (cluster, index) = (file.cluster(number)?, file.index(number)?);
            for (root, entry) in (cluster.first_root..).zip(&index.roots) {
                if let Some(inside) = keep(root, entry) {
                    nodes.push(NodeState { root, entry, block: 0, arcs: Vec::new(), inside, done: !inside });
                }
            }
        }

        let mut owners = Vec::new();
        for half_arc in nodes.iter().flat_map(|node| node.entry.half_arcs()) {
            owners.push(file.owner(half_arc.arc, |cluster| cluster.first_arc)?);
        }
        file.load_indices(owners)?;
        let mut arcs: Vec<ArcState<'f>> = Vec::new();
        let mut arc_of: HashMap<u32, u32> = HashMap::new();
        for (number, node) in (0..).zip(&mut nodes) {
            for half_arc in node.entry.half_arcs() {
                let next = arcs.len() as u32;
                let arc = *arc_of.entry(half_arc.arc).or_insert(next);
                if arc == next {
                    let owner = file.owner(half_arc.arc, |cluster| cluster.first_arc)?;
                    let local = half_arc.arc - file.cluster(owner)?.first_arc;
                    arcs.push(ArcState { index: file.index(owner)?, local, uses: Vec::new() });
                }
                arcs[arc as usize].uses.push(number);
                node.arcs.push(arc);
            }
            node.arcs.sort_unstable();
            node.arcs.dedup();
        }
        let finest = file.level_count() as u8 - 1;
        let mut adaptation = Self { lattice: file.lattice(), finest, nodes, arcs, triangle_count: 0 };
        adaptation.recount_triangles();
        Ok(adaptation)
    }

    fn recount_triangles(&mut self) {
        let blocks = self.nodes.iter().map(|node| u64::from(node.entry.blocks[node.block].triangle_count));
        let all_arcs: Vec<u32> = (0..self.arcs.len() as u32).collect();
        self.triangle_count = blocks.sum::<u64>() + self.extra_triangles(&all_arcs);
    }

    fn check_budgets(&self, query: &Query) -> Result<()> {
        let node_count = self.nodes.len() as u64;
        if query.max_nodes.is_some_and(|most| node_count > most) {
            return Err(Error::Query { what: format!("the query needs at least {node_count} nodes") });
        }
        let least = self.triangle_count;
        if query.max_triangles.is_some_and(|most| least > most) {
            return Err(Error::Query { what: format!("the query needs at least {least} triangles") });
        }
        Ok(())
    }

    /// Refines greedily. Where a budget ends that, the error may have been smaller before: refining a root also raises
    /// the errors of coarser neighbours, whose borders then differ. So the best state is taken, and the rest of the budget
    /// is spent where it raises nothing above that state's error.
    fn refine(&mut self, query: &Query) -> Limiter {
        let mut log = Vec::new();
        let limiter = self.refine_where(query, f64::INFINITY, &mut log);
        if limiter != Limiter::Triangles {
            return limiter;
        }
        for &(node, _) in &log {
            self.nodes[node as usize].block -= 1;
        }
        self.recount_triangles();
        let mut worst = WorstNode::new(self);
        let mut best = (worst.error(self), 0);
        for (number, &(node, triangle_count)) in (1..).zip(&log) {
            self.nodes[node as usize].block += 1;
            self.triangle_count = triangle_count;
            worst.update(self, node);
            let error = worst.error(self);
            if error <= best.0 {
                best = (error, number);
            }
        }
        for &(node, _) in &log[best.1..] {
            self.nodes[node as usize].block -= 1;
        }
        self.recount_triangles();
        for node in &mut self.nodes {
            node.done = !node.inside;
        }
        self.refine_where(query, best.0, &mut Vec::new());
        limiter
    }

    /// Refines the root with the largest error first, as long as no root's error gets above `ceiling` by that, and writes
    /// down which roots, and the triangles after each.
    fn refine_where(&mut self, query: &Query, ceiling: f64, log: &mut Vec<(u32, u64)>) -> Limiter {
        let most_triangles = query.max_triangles.unwrap_or(u64::MAX);
        let (mut finest_reached, mut budget_reached) = (query.tolerance.is_none(), false);
        // Errors are not negative, so that their bits are ordered as they are. Entries whose error has changed since are
        // stale: the change has pushed another one.
        let mut queue: BinaryHeap<(u64, Reverse<u32>)> =
            (0..self.nodes.len() as u32).map(|node| (self.error(node).to_bits(), Reverse(node))).collect();
        while let Some((bits, Reverse(node))) = queue.pop() {
            let error = self.error(node);
            if self.nodes[node as usize].done || error.to_bits() != bits {
                continue;
            }
            if query.tolerance.is_some_and(|tolerance| error <= tolerance) {
                break;
            }
            let state = &self.nodes[node as usize];
            let finer = state.entry.blocks.get(state.block + 1).is_some_and(|block| block.level <= self.finest);
            let triangle_count = if finer { self.triangles_with_finer(node) } else { 0 };
            let fits = !finer
                || triangle_count <= most_triangles && (ceiling.is_infinite() || self.stays_below(node, ceiling));
            let state = &mut self.nodes[node as usize];
            if !finer || !fits {
                state.done = true;
                finest_reached |= !finer;
                budget_reached |= !fits;
                continue;
            }
            state.block += 1;
            self.triangle_count = triangle_count;
            log.push((node, triangle_count));
            queue.push((self.error(node).to_bits(), Reverse(node)));
            for neighbour in self.neighbours(node) {
                if !self.nodes[neighbour as usize].done {
                    queue.push((self.error(neighbour).to_bits(), Reverse(neighbour)));
                }
            }
        }
        match (budget_reached, finest_reached) {
            (true, _) => Limiter::Triangles,
            (false, true) => Limiter::Finest,
            (false, false) => Limiter::Tolerance,
        }
    }

    /// Whether no error inside the region gets above `ceiling` were `node`, which has a finer block, drawn with that.
    fn stays_below(&mut self, node: u32, ceiling: f64) -> bool {
        self.nodes[node as usize].block += 1;
        let all = std::iter::once(node).chain(self.neighbours(node));
        let below = all.filter(|&near| self.nodes[near as usize].inside).all(|near| self.error(near) <= ceiling);
        self.nodes[node as usize].block -= 1;
        below
    }

    /// The other users of a node's arcs, some of them more than once.
    fn neighbours(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let users = self.nodes[node as usize].arcs.iter().flat_map(|&arc| &self.arcs[arc as usize].uses);
        users.copied().filter(move |&user| user != node)
    }

    /// Bound of a node's error in this cut.
    fn error(&self, node: u32) -> f64 {
        let state = &self.nodes[node as usize];
        let block = &state.entry.blocks[state.block];
        let is_refined = |&arc: &u32| {
            let arc = &self.arcs[arc as usize];
            arc.sample_count(self.drawn_level(arc)) > arc.sample_count(block.level)
        };
        let error = block.error.bound(&self.lattice);
        if block.border_deviation.0 > 0 && state.arcs.iter().any(is_refined) {
            sum_of_bounds(error, block.border_deviation.bound(&self.lattice))
        } else {
            error
        }
    }

    /// The finest level of an arc's roots.
    fn drawn_level(&self, arc: &ArcState<'_>) -> u8 {
        arc.uses.iter().map(|&node| self.nodes[node as usize].level()).max().unwrap_or(0)
    }

    /// Triangles of the mesh were `node` one block finer.
    fn triangles_with_finer(&mut self, node: u32) -> u64 {
        let extra = |this: &Self| this.extra_triangles(&this.nodes[node as usize].arcs);
        let block_triangles = |this: &Self| {
            let state = &this.nodes[node as usize];
            u64::from(state.entry.blocks[state.block].triangle_count)
        };
        let without = self.triangle_count - extra(self) - block_triangles(self);
        self.nodes[node as usize].block += 1;
        let count = without + extra(self) + block_triangles(self);
        self.nodes[node as usize].block -= 1;
        count
    }

    /// Triangles that stitching adds along some arcs: one for each sample that a root itself does not have.
    fn extra_triangles(&self, arcs: &[u32]) -> u64 {
        let on_arc = |arc: &ArcState<'_>| {
            let drawn = arc.sample_count(self.drawn_level(arc));
            arc.uses.iter().map(|&node| drawn - arc.sample_count(self.nodes[node as usize].level())).sum::<u64>()
        };
        arcs.iter().map(|&arc| on_arc(&self.arcs[arc as usize])).sum()
    }

    fn cut(&self, limited_by: Limiter) -> Cut {
        let node_errors: Vec<f64> = (0..self.nodes.len() as u32).map(|node| self.error(node)).collect();
        let inside = node_errors.iter().zip(&self.nodes).filter(|(_, node)| node.inside);
        Cut {
            nodes: self.nodes.iter().map(|node| Node { root: node.root, level: node.level() }).collect(),
            error: inside.map(|(&error, _)| error).fold(0.0, f64::max),
            node_errors,
            triangle_count: self.triangle_count,
            limited_by,
        }
    }
}

/// The largest error inside the region, while roots are refined.
struct WorstNode {
    /// Errors as bits; those that have changed since are stale.
    queue: BinaryHeap<(u64, u32)>,
}

impl WorstNode {
    fn new(adaptation: &Adaptation<'_>) -> Self {
        let inside = (0..).zip(&adaptation.nodes).filter(|(_, node)| node.inside);
        Self { queue: inside.map(|(node, _)| (adaptation.error(node).to_bits(), node)).collect() }
    }

    /// Notes that `node` has been refined.
    fn update(&mut self, adaptation: &Adaptation<'_>, node: u32) {
        for near in std::iter::once(node).chain(adaptation.neighbours(node)) {
            if adaptation.nodes[near as usize].inside {
                self.queue.push((adaptation.error(near).to_bits(), near));
            }
        }
    }

    fn error(&mut self, adaptation: &Adaptation<'_>) -> f64 {
        while let Some(&(bits, node)) = self.queue.peek() {
            if adaptation.error(node).to_bits() == bits {
                return f64::from_bits(bits);
            }
            self.queue.pop();
        }
        0.0
    }
}
