//! Groups above regions: made where the products of all regions are joined, from the tops of these alone, and from as
//! much of what lies below them as stays small.

use lodpack::{
    LatticePoint,
    index::HalfArc as FileHalfArc,
    write::{Above, ArcSample, Assembly, BlockRecord, Model, Piece, RootRecord},
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::super::Plan;
use super::super::drawn::{DrawnLevel, drawn};
use super::super::summary::Times;
use super::super::texels::storage;
use super::net::Net;
use super::texels_above::{KnownTop, paint_above};
use super::{Forest, MOST_BELOW, Node, NodeSurface};
use crate::reduce::CoarseSurface;
use lodpack_mesh::NONE;
use lodpack_runtime::machine::thread_cpu_time;
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::group;

/// A root of a region without a parent, as groups above regions need it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in super::super) struct Top {
    /// Its number in the region.
    pub root: u32,
    /// As in its record.
    pub bounds: [[f64; 3]; 2],
    /// Its coarsest level.
    pub level: u8,
    /// Its coarsest block: error, border deviation and triangles.
    pub error: f64,
    pub border_deviation: f64,
    pub triangle_count: u32,
    /// Triangles of the input that it stands for.
    pub weight: u64,
    /// What is drawn at its coarsest level, if a group can be made of it.
    pub surface: Option<TopSurface>,
}

/// The surface of a top.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(in super::super) struct TopSurface {
    /// Its border comes first.
    pub surface: CoarseSurface,
    /// What it covers, from one level finer on, each level once; none for charts.
    pub below: Vec<CoarseSurface>,
    /// For each half-arc of its loops the samples of the arc up to the finest of these levels, at least one finer than
    /// its own.
    pub samples: Vec<Vec<ArcSample>>,
    /// The texel streams of its block.
    pub texels: Vec<Vec<u8>>,
}

impl Top {
    /// Keeps of what lies below the top as much as this top, one of `regions`, may bring along.
    pub fn keep_share(&mut self, regions: u32) {
        let Some(TopSurface { below, samples, .. }) = &mut self.surface else { return };
        below.truncate(fitting(below.iter().map(|surface| surface.triangles.len()), share(regions)));
        let finest = finest_of_samples(self.level, below);
        samples.iter_mut().for_each(|samples| samples.retain(|sample| sample.level <= finest));
    }

    /// Moves the levels of a region's top from `before` to `now`. Coarser ones have nothing but what all levels have.
    pub fn move_levels(&mut self, before: u8, now: u8) {
        let moved = |level: u8| (level + now).saturating_sub(before);
        self.level = moved(self.level);
        let samples = self.surface.iter_mut().flat_map(|top| &mut top.samples).flatten();
        samples.filter(|sample| sample.level > 0).for_each(|sample| sample.level = moved(sample.level));
    }
}

/// The most triangles of what lies below the top of a region, given the number of regions.
fn share(regions: u32) -> usize {
    MOST_BELOW / regions.max(1) as usize
}

/// How many levels below a top can be brought along: the first one, and further ones as long as all of them together
/// have at most `most` triangles.
fn fitting(triangles: impl Iterator<Item = usize>, most: usize) -> usize {
    let mut sum = 0;
    let fits = |(number, triangles): &(usize, usize)| {
        sum += triangles;
        *number == 0 || sum <= most
    };
    triangles.enumerate().take_while(fits).count()
}

/// The finest level whose samples a top brings, at least one finer than its own.
fn finest_of_samples(level: u8, below: &[CoarseSurface]) -> u8 {
    level + (below.len() as u8).max(1)
}

/// The tops of a region's records, which weigh `weight` together, with what one of `regions` regions may bring along.
pub(in super::super) fn tops(forest: &Forest, weight: u64, regions: u32) -> Vec<Top> {
    let [end, _] = forest.levels;
    let tops = || (0..).zip(&forest.records).filter(|(_, record)| record.parent.is_none());
    let weight = weight / (tops().count() as u64).max(1);
    let top = |(root, record): (u32, &RootRecord)| {
        let mut blocks = (0..).zip(&record.blocks);
        let (level, block) = blocks.find_map(|(level, block)| Some((level, block.as_ref()?)))?;
        let node = forest.nodes.iter().flatten().find(|node| node.record == root && node.surface.level == end);
        let surface = node.map(|node| {
            let below = brought_along(node, share(regions));
            let finest = finest_of_samples(end, &below);
            let half_arcs = node.loops.iter().flatten();
            TopSurface {
                surface: node.surface.coarse(),
                below,
                samples: half_arcs.map(|half_arc| forest.net.samples_of(*half_arc, finest)).collect(),
                texels: block.texels.clone(),
            }
        });
        let &BlockRecord { error, border_deviation, triangle_count, .. } = block;
        let bounds = record.bounds;
        Some(Top { root, bounds, level, error, border_deviation, triangle_count, weight, surface })
    };
    tops().filter_map(top).collect()
}

/// What lies below a node, level after level, as far as it fits.
fn brought_along(node: &Node, most: usize) -> Vec<CoarseSurface> {
    let levels = node.surface.level + 1..;
    let follows = |(surface, level): &(&NodeSurface, u8)| surface.level == *level;
    let below: Vec<&NodeSurface> =
        node.below.iter().zip(levels).take_while(follows).map(|(surface, _)| surface).collect();
    let count = fitting(below.iter().map(|surface| surface.triangles.len()), most);
    below[..count].iter().map(|surface| surface.coarse()).collect()
}

/// Groups above regions, and what they change in the sums over all of these.
pub(in super::super) struct AboveRegions {
    pub piece: Piece,
    /// Totals of the levels that regions do not have.
    pub drawn: Vec<DrawnLevel>,
    pub groups: u64,
    pub interior_vertices: u64,
    /// The coarsest of everything, if all of it is known here.
    pub coarsest: Option<CoarseSurface>,
}

/// Counts groups above the tops of regions, by region, all of which have been counted. None if there is nothing to
/// group.
pub(in super::super) fn count_above(
    plan: &Plan,
    head: &Model,
    assembly: &mut Assembly,
    tops: Vec<Vec<Top>>,
    times: &mut Times,
) -> lodpack::Result<Option<AboveRegions>> {
    let (scale, bottom) = (&plan.scale, plan.scale.coarsest_of_regions);
    if bottom == 0 {
        return Ok(None);
    }
    let mut known = Known::default();
    for (region, tops) in tops.into_iter().enumerate() {
        tops.into_iter().try_for_each(|top| known.add(assembly, region, top, head.levels.len(), bottom))?;
    }
    let Known { numbers, records, nodes, texels, weights, arcs, corners, .. } = known;
    let count = records.len() as u32;
    let storage = storage(&plan.appearance, plan.colour_step);
    let painted: Vec<(u32, Option<KnownTop>)> = nodes
        .iter()
        .zip(&texels)
        .map(|(node, streams)| (node.record, KnownTop::new(node, streams, &storage, scale.step())))
        .collect();
    let patches = if plan.appearance.is_empty() { vec![] } else { vec![vec![]; records.len()] };
    let net = Net {
        corners: &corners.iter().map(|corner| corner.position).collect::<Vec<_>>(),
        corner_levels: corners.iter().map(|corner| corner.level).collect(),
        is_fixed: vec![false; corners.len()],
        ends: arcs.iter().map(|arc| arc.ends).collect(),
        sides: arcs.iter().map(|arc| arc.sides).collect(),
        samples: &arcs.iter().map(|arc| arc.samples.clone()).collect::<Vec<_>>(),
    };
    let heights_below = scale.coarsest_of_charts - bottom;
    let mut forest = Forest::new(&net, scale, [0, bottom], records, patches, nodes);
    forest.add_groups(&weights, group::size(f64::from(scale.chart_triangles), u32::from(heights_below)), times);
    let Forest { mut records, drawn: patches, corner_levels, interior_vertices, nodes, .. } = forest;
    if records.len() as u32 == count {
        return Ok(None);
    }
    if !patches.is_empty() {
        let start = thread_cpu_time();
        paint_above(&mut records, count as usize, &patches, &painted, [f64::from(bottom), scale.step()], &storage);
        times.texels += thread_cpu_time() - start;
    }

    let is_whole = records.iter().filter(|record| record.parent.is_none()).count() == nodes.iter().flatten().count();
    let surfaces = || nodes.iter().flatten().map(|node| node.surface.coarse()).collect();
    let coarsest = is_whole.then(|| CoarseSurface::joined(surfaces()));
    let model = Model { levels: head.levels.clone(), lattice: head.lattice, roots: records, ..Model::default() };
    let levels = 0..usize::from(bottom);
    let drawn = levels.map(|level| drawn(&model, level)).collect::<lodpack::Result<_>>()?;
    let mut above = Above::default();
    for (number, mut record) in (0..).zip(model.roots) {
        if number < count {
            above.children.extend(record.parent.map(|parent| [numbers[number as usize], parent - count]));
            continue;
        }
        record.parent = record.parent.map(|parent| parent - count);
        let half_arcs = record.loops.iter_mut().flatten();
        half_arcs.for_each(|half_arc| half_arc.arc = arcs[half_arc.arc as usize].number);
        above.roots.push(record);
    }
    let raised = corners.iter().zip(corner_levels).filter(|(corner, level)| *level < corner.level);
    above.corner_levels = raised.map(|(corner, level)| (corner.number, level)).collect();
    let groups = above.roots.len() as u64;
    let piece = assembly.count_above(head, &above)?;
    Ok(Some(AboveRegions { piece, drawn, groups, interior_vertices, coarsest }))
}

/// Stands for a top without a surface where an arc names what lies beside it.
const UNKNOWN: u32 = NONE - 1;

/// The tops of regions, and the arcs and corners around them.
#[derive(Default)]
struct Known {
    /// Of each top its number in the assembly.
    numbers: Vec<u32>,
    /// What is known of its record.
    records: Vec<RootRecord>,
    /// Those of which groups can be made.
    nodes: Vec<Node>,
    /// The texel streams of each of these.
    texels: Vec<Vec<Vec<u8>>>,
    weights: Vec<u64>,
    arcs: Vec<KnownArc>,
    corners: Vec<KnownCorner>,
    /// By number in the assembly.
    arc_of: BTreeMap<u32, u32>,
    corner_of: BTreeMap<u32, u32>,
}

struct KnownArc {
    /// In the assembly.
    number: u32,
    ends: [u32; 2],
    sides: [u32; 2],
    samples: Vec<ArcSample>,
}

struct KnownCorner {
    /// In the assembly.
    number: u32,
    position: LatticePoint,
    level: u8,
}

impl Known {
    fn add(
        &mut self,
        assembly: &Assembly,
        region: usize,
        top: Top,
        level_count: usize,
        bottom: u8,
    ) -> lodpack::Result<()> {
        let wrong = || lodpack::Error::Model { what: format!("region {region} has other tops than it says") };
        let (number, around) = assembly.root(region, top.root).ok_or_else(wrong)?;
        let record = self.records.len() as u32;
        let mut blocks = vec![None; level_count];
        let Top { bounds, error, border_deviation, triangle_count, weight, .. } = top;
        *blocks.get_mut(usize::from(top.level)).ok_or_else(wrong)? =
            Some(BlockRecord { error, border_deviation, triangle_count, ..BlockRecord::default() });
        self.records.push(RootRecord { bounds, blocks, ..RootRecord::default() });
        self.numbers.push(number);
        let Some(TopSurface { surface, below, samples, texels }) = top.surface else {
            // The surface does not end where it begins.
            for half_arc in around.iter().flatten() {
                let arc = self.arc(assembly, half_arc.arc, vec![]).ok_or_else(wrong)?;
                self.arcs[arc as usize].sides[usize::from(half_arc.reversed)] = UNKNOWN;
            }
            return Ok(());
        };
        if samples.len() != around.iter().flatten().count() {
            return Err(wrong());
        }
        let (node, mut samples) = (self.nodes.len() as u32, samples.into_iter());
        let mut loops = vec![];
        for half_arcs in around {
            let mut of_loop = vec![];
            for &FileHalfArc { arc, reversed } in half_arcs {
                let arc = self.arc(assembly, arc, samples.next().unwrap_or_default()).ok_or_else(wrong)?;
                self.arcs[arc as usize].sides[usize::from(reversed)] = node;
                of_loop.push(HalfArc { arc, reversed });
            }
            loops.push(of_loop);
        }
        let surface = NodeSurface::new(bottom, surface);
        let below = (bottom + 1..).zip(below).map(|(level, surface)| NodeSurface::new(level, surface)).collect();
        self.nodes.push(Node { record, loops, surface, below, border_deviation });
        self.weights.push(weight);
        self.texels.push(texels);
        Ok(())
    }

    /// The number of an arc of the assembly here.
    fn arc(&mut self, assembly: &Assembly, number: u32, samples: Vec<ArcSample>) -> Option<u32> {
        if let Some(&arc) = self.arc_of.get(&number) {
            // The other region may have brought fewer levels.
            let known = &mut self.arcs[arc as usize].samples;
            if samples.len() > known.len() {
                *known = samples;
            }
            return Some(arc);
        }
        let [a, b] = assembly.arc_ends(number)?;
        let ends = [self.corner(assembly, a)?, self.corner(assembly, b)?];
        let arc = self.arcs.len() as u32;
        self.arcs.push(KnownArc { number, ends, sides: [NONE; 2], samples });
        self.arc_of.insert(number, arc);
        Some(arc)
    }

    fn corner(&mut self, assembly: &Assembly, number: u32) -> Option<u32> {
        if let Some(&corner) = self.corner_of.get(&number) {
            return Some(corner);
        }
        let (position, level) = assembly.corner(number)?;
        let corner = self.corners.len() as u32;
        self.corners.push(KnownCorner { number, position, level });
        self.corner_of.insert(number, corner);
        Some(corner)
    }
}
