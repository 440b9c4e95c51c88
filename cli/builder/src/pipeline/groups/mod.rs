//! Groups: above the charts of a region nested groups of them, each drawn as one surface, up to one for the region; and
//! above the tops of all regions groups of these, up to one for the file.
//!
//! The members of a group are joined along the arcs between them, and their surface is simplified without these. So
//! vertices are free where borders were, and a group has about as many triangles as each of its members, four times as
//! far from the input. A group is made from what lies two heights below it where there is that, and certified against
//! it: its bound is added, and is a sixteenth of what the group may be off. The top of a file, one node that everybody
//! sees first, is made from a finer cut. Nothing here looks at the input.

pub(super) mod above_regions;
mod corners;
mod levels;
pub(super) mod net;
pub(super) mod outline;
mod parts;
mod surface;
mod texels_above;
pub(super) mod top;

use glam::DVec3;
use lodpack::{
    LatticePoint,
    decode::Patch,
    index::Filling,
    write::{BlockRecord, RootRecord},
};
use rayon::prelude::*;

use super::Scale;
use super::chart_work::{Root, raise_coarser, record_loops};
use super::drawn::{DrawnBlocks, DrawnPatch};
use super::summary::Times;
use crate::reduce::{CoarseSurface, error_sum};
use corners::corner_levels;
use levels::{MadeLevel, Making};
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_runtime::trace;
use lodpack_stage::arc_samples::border_deviation;
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::areas::{Areas, Jumps};
use lodpack_stage::certify::{BorderPairing, PairedVertex};
use lodpack_stage::chart::{BorderVertex, ChartMesh};
use lodpack_stage::group::{Charts, group};
use lodpack_stage::simplify::{LevelPatch, SimplifiedChart};
use net::Net;
use outline::Borders;
use parts::{InParts, collapsed, is_of_small_parts};
use surface::{Joined, Part, join};
use top::{Few, halve_levels, leave_out, reduce_top};

/// The error of a group is raised above those of its members, unless theirs are more than this many times its own: then
/// a bound of theirs is loose, and would make that of everything above it loose, too.
const MOST_RAISED: f64 = 3.0;
/// How often corners are kept because a border could not be simplified without them.
const MAX_ROUNDS: usize = 4;
/// A group keeps about this share of its members' triangles where parts decide, but never fewer than the number below
/// by choice: so few cost nothing.
const SHARE: f64 = 0.25;
const FEWEST: usize = 400;
/// The most triangles of the surface that a top is made from, and of what all regions together bring for it. More would
/// not be seen in a top of a few hundred.
const MOST_BELOW: usize = 50_000;
/// Holes of the surface that are no wider than this share of the tolerance of a group's finest level are closed.
const WIDEST_HOLE: f64 = 0.25;

/// A chart or a group, as the groups above see it.
pub(super) struct Node {
    /// Number of its record.
    pub record: u32,
    pub loops: Vec<Vec<HalfArc>>,
    /// Its surface at its coarsest level.
    pub surface: NodeSurface,
    /// What it covers, from one level finer on, each level once; none for charts. Beyond the first one no more than
    /// [`MOST_BELOW`] triangles.
    pub below: Vec<NodeSurface>,
    /// How far its border is from finer samples than those that are known here; 0 if all are.
    pub border_deviation: f64,
}

/// What is drawn of a node, or of its members together, at a level.
pub(super) struct NodeSurface {
    pub level: u8,
    /// The border, loop after loop, then the inside; relative to the lattice's origin.
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
    /// Bound of the distance to the input.
    pub error: f64,
}

impl NodeSurface {
    fn new(level: u8, CoarseSurface { positions, triangles, error }: CoarseSurface) -> Self {
        Self { level, positions, triangles, areas: vec![], error }
    }

    fn coarse(&self) -> CoarseSurface {
        CoarseSurface { positions: self.positions.clone(), triangles: self.triangles.clone(), error: self.error }
    }
}

/// The records of nodes, then of the groups above them.
pub(super) struct Forest<'a> {
    net: &'a Net<'a>,
    scale: &'a Scale,
    /// The level up to which there are groups, and that of the nodes at the bottom.
    levels: [u8; 2],
    /// Where colours jump, if that is known.
    pub jumps: Option<&'a Jumps>,
    pub records: Vec<RootRecord>,
    /// What is drawn of each record, if they are to have texels.
    pub drawn: Vec<DrawnBlocks>,
    /// See [`lodpack::write::Model::corner_levels`].
    pub corner_levels: Vec<u8>,
    /// Interior vertices of all groups.
    pub interior_vertices: u64,
    /// The nodes that have no parent yet. None for a group that could not be built: its members have no parent.
    pub nodes: Vec<Option<Node>>,
}

/// A group on its way to a record.
struct Group {
    members: Vec<u32>,
    result: Option<BuiltGroup>,
}

struct BuiltGroup {
    record: RootRecord,
    node: Node,
    drawn: DrawnBlocks,
    interior_vertices: u64,
}

/// A chart as the group above sees it. `root` has the number `record`.
pub(super) fn node_of_chart(
    net: &Net,
    scale: &Scale,
    record: u32,
    loops: Vec<Vec<HalfArc>>,
    root: &Root,
    level: u8,
) -> Node {
    let error = root.record.blocks[usize::from(level)].as_ref().map_or(0.0, |block| block.error);
    let Patch { interior, triangles, .. } = &root.coarsest;
    let positions = positions(net, scale, &loops, level, interior);
    let drawn = root.drawn.get(usize::from(level)).and_then(Option::as_ref);
    let areas = drawn.map_or(vec![], |drawn| drawn.areas.clone());
    let surface = NodeSurface { level, positions, triangles: triangles.clone(), areas, error };
    Node { record, loops, surface, below: vec![], border_deviation: 0.0 }
}

/// The vertices of a node at the bottom: those of its border, then the others.
fn positions(net: &Net, scale: &Scale, loops: &[Vec<HalfArc>], level: u8, interior: &[LatticePoint]) -> Vec<DVec3> {
    let borders = net.at_the_bottom();
    let border = loops.iter().flatten().flat_map(|&half_arc| borders.points(half_arc, level));
    let points = border.map(|point| point.position).chain(interior.iter().copied());
    points.map(|point| scale.local_from_lattice(point)).collect()
}

impl<'a> Forest<'a> {
    /// Nodes without groups. `levels` are the one up to which there will be groups, and that of the nodes; `records`
    /// are theirs, and `drawn` what is drawn of these, empty if it is not wanted.
    pub fn new(
        net: &'a Net<'a>,
        scale: &'a Scale,
        levels: [u8; 2],
        records: Vec<RootRecord>,
        drawn: Vec<DrawnBlocks>,
        nodes: Vec<Node>,
    ) -> Self {
        let corner_levels = net.corner_levels.clone();
        let nodes = nodes.into_iter().map(Some).collect();
        Self { net, scale, levels, jumps: None, records, drawn, corner_levels, interior_vertices: 0, nodes }
    }

    /// Adds groups of all heights. `weights` are the sizes of the nodes, `unit` that of one of average size.
    pub fn add_groups(&mut self, weights: &[u64], unit: f64, times: &mut Times) {
        let middle = |node: &Option<Node>| {
            let bounds = node.as_ref().map_or([[0.0; 3]; 2], |node| self.records[node.record as usize].bounds);
            (DVec3::from(bounds[0]) + DVec3::from(bounds[1])) * 0.5
        };
        let centres: Vec<DVec3> = self.nodes.iter().map(middle).collect();
        let is_pair = |pair: &[u32; 2]| pair[0] != pair[1] && pair.iter().all(|&node| (node as usize) < weights.len());
        let pairs: Vec<[u32; 2]> = self.net.sides.iter().copied().filter(is_pair).collect();
        let heights = group(&Charts { weights, centres: &centres, pairs: &pairs }, unit);
        let [end, bottom] = self.levels;
        self.corner_levels =
            corner_levels(self.net, self.scale, self.levels, &groups_of_nodes(weights.len(), &heights));
        let count = heights.len() as u8;
        for (height, groups) in (1..).zip(heights) {
            let finest = bottom - height;
            let coarsest = if height == count { end } else { finest };
            self.add_height(groups, [coarsest, finest], times);
        }
    }

    /// Adds the groups of a height, which have these levels.
    fn add_height(&mut self, groups: Vec<Vec<u32>>, levels: [u8; 2], times: &mut Times) {
        let mut groups: Vec<Group> = groups.into_iter().map(|members| Group { members, result: None }).collect();
        for round in 0..MAX_ROUNDS {
            let this = &*self;
            let attempt = |group: &mut Group| match &group.result {
                Some(_) => (vec![], Times::default()),
                None => {
                    let _pass = trace::pass("group");
                    let mut times = Times::default();
                    let result = this.build(&group.members, levels, round + 1 == MAX_ROUNDS, &mut times);
                    let wishes = result.as_ref().err().cloned().unwrap_or_default();
                    group.result = result.ok();
                    (wishes, times)
                }
            };
            let of_all = trace::parallel("groups");
            let outcomes: Vec<(Vec<(u32, u8)>, Times)> = groups.par_iter_mut().map(attempt).collect();
            drop(of_all);
            let mut wishes: Vec<(u32, u8)> = vec![];
            for (of_group, of_work) in outcomes {
                wishes.extend(of_group);
                times.add(&of_work);
            }
            if wishes.is_empty() {
                break;
            }
            for &(corner, level) in &wishes {
                let own = &mut self.corner_levels[corner as usize];
                *own = level.min(*own);
            }
            // Nodes that have one of these corners have another border now.
            for group in &mut groups {
                let has_corner = |node: &Node| {
                    let corners = node.loops.iter().flatten().map(|&half_arc| self.net.ends_of(half_arc)[0]);
                    corners.into_iter().any(|corner| wishes.iter().any(|&(wished, _)| wished == corner))
                };
                if group.result.as_ref().is_some_and(|built| has_corner(&built.node)) {
                    group.result = None;
                }
            }
        }
        let mut nodes = vec![];
        for group in groups {
            let Some(BuiltGroup { record, mut node, drawn, interior_vertices }) = group.result else {
                nodes.push(None);
                continue;
            };
            node.record = self.records.len() as u32;
            for member in group.members.iter().filter_map(|&member| self.nodes[member as usize].as_ref()) {
                self.records[member.record as usize].parent = Some(node.record);
            }
            self.interior_vertices += interior_vertices;
            if !self.drawn.is_empty() {
                self.drawn.push(drawn);
            }
            self.records.push(record);
            nodes.push(Some(node));
        }
        self.nodes = nodes;
    }

    /// Builds a group of nodes at some levels, coarse to fine. If it cannot be simplified, returns corners that may be
    /// missing as vertices, and from which level on; none where no corner would help. With `capped`, levels that cannot
    /// be simplified get any surface instead.
    fn build(
        &self,
        members: &[u32],
        [coarsest, finest]: [u8; 2],
        capped: bool,
        times: &mut Times,
    ) -> Result<BuiltGroup, Vec<(u32, u8)>> {
        let start = thread_cpu_time();
        let scale = self.scale;
        let borders = Borders { net: self.net, corner_levels: &self.corner_levels };
        let nodes: Vec<&Node> = members.iter().filter_map(|&member| self.nodes[member as usize].as_ref()).collect();
        if nodes.is_empty() {
            return Err(vec![]);
        }
        let members = join(&borders, &members_of(&nodes), coarsest);
        // A hole takes five triangles at least, and scans have hundreds of small ones.
        let holes = members.holes(self.net, coarsest, scale.levels[usize::from(finest)].tolerance * WIDEST_HOLE);
        let members = members.with_caps(&holes);
        // Few of many parts stay, however they are made: four times the triangles would cost a quarter of the build for
        // nothing.
        let is_of_small_parts = is_of_small_parts(&members);
        let depths = if is_of_small_parts { 0..0 } else { 0..scale.levels.len() };
        let parts_below = depths.map_while(|depth| below_of(&nodes, depth));
        let finer: Vec<Joined> = parts_below.map(|parts| join(&borders, &parts, coarsest).with_caps(&holes)).collect();
        // There is one top, so that a dearer way costs next to nothing.
        let below = if coarsest == 0 { finer.last() } else { finer.first() };
        let below = below.unwrap_or(&members);
        let mut joined = below.clone();
        times.cut += thread_cpu_time() - start;

        let start = thread_cpu_time();
        let making = Making { scale, jumps: self.jumps, levels: [coarsest, finest], below, is_of_small_parts };
        let mut early = None;
        let mut simplify = |joined: &Joined| {
            early = None;
            making.simplify(joined, None, Some(&mut early))
        };
        let mut simplified = simplify(&joined);
        for ends in [2, 1] {
            if simplified.stuck.is_empty() {
                break;
            }
            joined = joined.with_divided_edges(ends);
            simplified = simplify(&joined);
        }
        let mut has_flaps = false;
        if !simplified.stuck.is_empty() && coarsest == finest {
            let stuck: Vec<u32> = simplified.stuck.iter().map(|stuck| stuck.vertex).collect();
            let flapped = making.simplify(&joined.with_flaps(&stuck, finest), None, None);
            has_flaps = flapped.stuck.is_empty();
            simplified = if has_flaps { flapped } else { simplified };
        }
        let is_bare = simplified.levels[usize::from(coarsest)..].contains(&None);
        if is_bare {
            let wishes = simplified.stuck.iter().flat_map(|stuck| joined.corners_beside(stuck.vertex, stuck.level));
            // What the members have as a vertex, too: groups below that lack it are made already, and would border on
            // another line.
            let is_of_members = |&(corner, _): &(u32, u8)| self.corner_levels[corner as usize] <= finest + 1;
            let wishes: Vec<(u32, u8)> = wishes.filter(is_of_members).collect();
            if !capped && !wishes.is_empty() {
                return Err(wishes);
            }
            simplified.cap_missing(&joined.chart(), usize::from(coarsest));
        }
        let is_thinned = thin_parts(&joined, &members, &mut simplified, usize::from(coarsest), is_bare);
        times.simplify += thread_cpu_time() - start;

        let deviation_below = nodes.iter().map(|node| node.border_deviation).fold(0.0, f64::max);
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let origin = DVec3::from_array(scale.lattice.origin);
        let mut blocks = vec![None; scale.levels.len()];
        let mut all_drawn: DrawnBlocks = if self.drawn.is_empty() { vec![] } else { vec![None; blocks.len()] };
        let (mut interior_vertices, mut surfaces) = (0, vec![]);
        let is_plain = !is_bare && !has_flaps && !is_thinned;
        let mut of_finest = match is_plain {
            true => Some(making.make_finest(&joined, &mut simplified, &mut early, times).ok_or_else(Vec::new)?),
            false => None,
        };
        if is_plain && coarsest == 0 && !joined.loops.is_empty() {
            halve_levels(&mut simplified.levels, FEWEST, |level, wanted| collapsed(&joined, level, wanted));
        }
        let of_all = trace::parallel("levels");
        let make = |(level, patch): (u8, &LevelPatch)| {
            let _pass = trace::pass("level");
            let mut times = Times::default();
            (level, making.make(&joined, level, patch, &mut times), times)
        };
        let is_made = |level: u8| level == finest && of_finest.is_some();
        let levels = (0..=finest).zip(&simplified.levels).filter(|&(level, _)| !is_made(level));
        let levels: Vec<(u8, &LevelPatch)> =
            levels.filter_map(|(level, patch)| Some((level, patch.as_ref()?))).collect();
        let mut all_made: Vec<(u8, Option<MadeLevel>, Times)> = levels.into_par_iter().map(make).collect();
        drop(of_all);
        all_made.extend(of_finest.take().map(|made| (finest, Some(made), Times::default())));
        for (level, made, of_level) in all_made {
            times.add(&of_level);
            let Some(made) = made else { return Err(vec![]) };
            let MadeLevel { patch, symbols, areas, points, positions, distance, .. } = made;
            if let Some(drawn) = all_drawn.get_mut(usize::from(level)) {
                let (triangles, areas) = (patch.triangles.clone(), areas.clone());
                *drawn = Some(DrawnPatch { positions: points, triangles, areas });
            }
            for &p in &positions {
                bounds = [bounds[0].min(p), bounds[1].max(p)];
            }
            interior_vertices += patch.interior.len() as u64;
            let error = error_sum(below.error, distance);
            blocks[usize::from(level)] = Some(BlockRecord {
                error,
                border_deviation: self.deviation(&borders, &joined, level, deviation_below),
                triangle_count: patch.triangles.len() as u32,
                symbols,
                texels: vec![],
                owners: vec![],
            });
            surfaces.push(NodeSurface { level, positions, triangles: patch.triangles, areas, error });
        }
        if coarsest == 0 {
            leave_out(&mut blocks);
        }
        if joined.loops.is_empty() && coarsest == 0 {
            let few = match (is_thinned, Areas::of(&joined.areas, self.jumps)) {
                (true, _) => Few::SomeParts,
                (false, Some(areas)) if areas.have_jumps() => Few::Lines,
                (false, _) => Few::Surface,
            };
            let mut top = reduce_top(&below.whole(), &mut blocks, scale, few, &mut all_drawn, &mut bounds, true);
            // Too many of very many parts may be left, however they are reduced; the members have fewer.
            if !top.has_few && !std::ptr::eq(below, &members) {
                top = reduce_top(&members.whole(), &mut blocks, scale, few, &mut all_drawn, &mut bounds, true);
            }
            if let Some((level, surface)) = top.replaced {
                surfaces.insert(0, NodeSurface::new(level, surface));
            }
        }
        let of_members =
            nodes.iter().filter_map(|node| self.records[node.record as usize].blocks.iter().flatten().next());
        let of_members = of_members.map(|block| block.error).reduce(f64::max);
        let own = blocks.iter().flatten().next_back().map_or(0.0, |block| block.error);
        raise_coarser(&mut blocks, of_members.filter(|&error| error <= own * MOST_RAISED), scale.step());
        let mut bounds = bounds.map(|p| (p + origin).to_array());
        for node in &nodes {
            let of_member = self.records[node.record as usize].bounds;
            bounds[0] = [0, 1, 2].map(|k| bounds[0][k].min(of_member[0][k]));
            bounds[1] = [0, 1, 2].map(|k| bounds[1][k].max(of_member[1][k]));
        }
        let loops = record_loops(&joined.loops);
        let record = RootRecord { filling: Filling::Irregular, loops, bounds, parent: None, blocks };
        let (loops, mut surfaces) = (members.loops.clone(), surfaces.into_iter());
        let Some(surface) = surfaces.next() else { unreachable!("a missing level has been capped") };
        let below = surfaces.chain([&members].into_iter().chain(&finer).map(Joined::surface)).collect();
        let node = Node { record: 0, loops, surface, below, border_deviation: deviation_below };
        Ok(BuiltGroup { record, node, drawn: all_drawn, interior_vertices })
    }

    /// By how much the error at a level can grow where a neighbour is drawn finer.
    /// `below` is how far the members' borders may be from samples that are not known here.
    fn deviation(&self, borders: &Borders, joined: &Joined, level: u8, below: f64) -> f64 {
        let local = |p: LatticePoint| self.scale.local_from_lattice(p);
        let finest = self.scale.finest();
        let mut worst: f64 = 0.0;
        for half_arcs in &joined.loops {
            let points = half_arcs.iter().flat_map(|&half_arc| borders.points(half_arc, finest));
            let mut points: Vec<(u8, DVec3)> = points.map(|point| (point.level, local(point.position))).collect();
            points.extend(points.first().copied());
            worst = worst.max(border_deviation(&points, level));
        }
        if below > 0.0 { error_sum(worst, below) } else { worst }
    }
}

impl Joined {
    /// The surface alone.
    fn whole(&self) -> CoarseSurface {
        CoarseSurface { positions: self.positions.clone(), triangles: self.triangles.clone(), error: self.error }
    }

    /// The surface as the simplifier takes it.
    fn chart(&self) -> ChartMesh {
        let loops = self.border.iter().map(|points| {
            let vertices =
                points.iter().map(|&(point, vertex)| BorderVertex { vertex, side: 0, param: 0.0, level: point.level });
            vertices.collect()
        });
        ChartMesh { positions: self.positions.clone(), triangles: self.triangles.clone(), loops: loops.collect() }
    }

    /// The border vertices of a level.
    fn border_loops(&self, level: u8) -> Vec<Vec<LatticePoint>> {
        let of_loop = |points: &Vec<_>| {
            let drawn = points.iter().map(|&(point, _): &(outline::BorderPoint, u32)| point);
            drawn.filter(|point| point.level <= level).map(|point| point.position).collect()
        };
        self.border.iter().map(of_loop).collect()
    }

    /// Which border vertices are those of a level.
    fn pairing(&self, level: u8) -> BorderPairing {
        let mut drawn = 0..;
        let mut of_loop = |points: &Vec<(outline::BorderPoint, u32)>| {
            let paired = points.iter().map(|&(point, fine)| {
                let coarse = if point.level <= level { drawn.next() } else { None };
                PairedVertex { fine, coarse }
            });
            paired.collect()
        };
        self.border.iter().map(&mut of_loop).collect()
    }

    /// The corners nearest to a border vertex, itself included, that are no vertices at a level.
    fn corners_beside(&self, vertex: u32, level: u8) -> Vec<(u32, u8)> {
        for points in &self.border {
            let Some(at) = points.iter().position(|&(_, v)| v == vertex) else { continue };
            let count = points.len();
            let finer = |i: usize| points[i % count].0.corner.filter(|_| points[i % count].0.level > level);
            let after = (at..at + count).find_map(finer);
            let before = (at + 1..at + 1 + count).rev().find_map(finer);
            return after.into_iter().chain(before).map(|corner| (corner, level)).collect();
        }
        vec![]
    }
}

/// The surfaces of nodes.
fn members_of<'a>(nodes: &[&'a Node]) -> Vec<Part<'a>> {
    nodes.iter().map(|node| Part { loops: &node.loops, surface: &node.surface }).collect()
}

/// The surfaces of nodes `depth` levels below those that are one level finer; none unless all have one of the same
/// level, and not too many triangles.
fn below_of<'a>(nodes: &[&'a Node], depth: usize) -> Option<Vec<Part<'a>>> {
    let parts: Option<Vec<Part>> =
        nodes.iter().map(|node| Some(Part { loops: &node.loops, surface: node.below.get(depth)? })).collect();
    let triangles = |parts: &[Part]| parts.iter().map(|part| part.surface.triangles.len()).sum::<usize>();
    parts
        .filter(|parts| parts.windows(2).all(|pair| pair[0].surface.level == pair[1].surface.level))
        .filter(|parts| depth == 0 || triangles(parts) <= MOST_BELOW)
}

/// Gives the levels fewer small parts where these are too many, or where `is_bare` says that they are missing. Returns
/// whether any did.
fn thin_parts(
    joined: &Joined,
    members: &Joined,
    simplified: &mut SimplifiedChart,
    coarsest: usize,
    is_bare: bool,
) -> bool {
    let Some(parts) = InParts::new(joined) else { return false };
    let mut changed = false;
    let (mut share, depth) = (1.0, members.triangles.len() as f64 / joined.triangles.len() as f64);
    for level in (coarsest..simplified.levels.len()).rev() {
        share *= SHARE;
        let wanted = FEWEST.max((members.triangles.len() as f64 * share) as usize);
        let patch = simplified.levels[level].as_ref().filter(|_| !is_bare);
        if let Some(patch) = parts.with_fewer(patch, level, wanted, share * depth) {
            simplified.levels[level] = Some(patch);
            changed = true;
        }
    }
    changed
}

/// For each height the group of each node at the bottom.
fn groups_of_nodes(nodes: usize, heights: &[Vec<Vec<u32>>]) -> Vec<Vec<u32>> {
    let mut result: Vec<Vec<u32>> = vec![];
    let mut below: Vec<u32> = (0..nodes as u32).collect();
    for groups in heights {
        let mut group_of = vec![0; groups.iter().map(Vec::len).sum()];
        for (number, members) in (0..).zip(groups) {
            members.iter().for_each(|&member| group_of[member as usize] = number);
        }
        below.iter_mut().for_each(|node| *node = group_of[*node as usize]);
        result.push(below.clone());
    }
    result
}
