//! The surfaces of a group's members as one: what the group simplifies, and what it is certified against.

use std::collections::BTreeMap;

use super::NodeSurface;
use super::net::Net;
use super::outline::{BorderPoint, Borders, Members, Place};
use crate::reduce::{error_sum, filled};
use glam::DVec3;
use lodpack_mesh::union_find::{find, unite};
use lodpack_mesh::{NONE, ordered, sides};
use lodpack_stage::arcs::HalfArc;
use lodpack_stage::arcs::closest_on_segment;

/// A surface that is to be joined with others of the same level.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    /// Its border.
    pub loops: &'a [Vec<HalfArc>],
    pub surface: &'a NodeSurface,
}

/// Several surfaces of a level as one.
#[derive(Clone)]
pub(super) struct Joined {
    pub level: u8,
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
    /// The half-arcs around it.
    pub loops: Vec<Vec<HalfArc>>,
    /// The points of its border, loop after loop, each with its vertex.
    pub border: Vec<Vec<(BorderPoint, u32)>>,
    /// Bound of its distance to the input.
    pub error: f64,
}

/// Joins parts along the arcs between them. Corners are joined only where arcs are, so that surfaces which touch in a
/// corner stay apart there. Each loop begins with a vertex of the level `coarsest`.
pub(super) fn join(borders: &Borders, parts: &[Part], coarsest: u8) -> Joined {
    let members = Members::new(parts.iter().map(|part| part.loops).collect());
    let mut vertices = Vertices::new(borders, parts);
    for [place, opposite] in members.inner() {
        let (along, mut against) = (vertices.of_arc(&members, place), vertices.of_arc(&members, opposite));
        against.reverse();
        along.into_iter().zip(against).for_each(|(a, b)| unite(&mut vertices.same_as, a, b));
    }
    let (numbers, count) = vertices.numbers();
    let mut positions = vec![DVec3::ZERO; count];
    let (mut triangles, mut areas) = (vec![], vec![]);
    let has_areas = parts.iter().any(|part| !part.surface.areas.is_empty());
    let mut edges: Vec<[u32; 2]> = vec![];
    let surfaces = || parts.iter().map(|part| part.surface).zip(&vertices.firsts);
    for (surface, &first) in surfaces() {
        let of_part = |v: u32| numbers[(first + v) as usize];
        (0..).zip(&surface.positions).for_each(|(v, &position)| positions[of_part(v) as usize] = position);
        edges.extend(surface.triangles.iter().flat_map(|corners| sides(corners.map(of_part))));
    }
    edges.sort_unstable();
    let crowded: Vec<[u32; 2]> = edges.chunk_by(|a, b| a == b).filter(|run| run.len() > 2).map(|run| run[0]).collect();
    for (surface, &first) in surfaces() {
        let of_part = |v: u32| numbers[(first + v) as usize];
        let area = |number: usize| surface.areas.get(number).copied().unwrap_or(NONE);
        if crowded.is_empty() {
            triangles.extend(surface.triangles.iter().map(|corners| corners.map(of_part)));
            if has_areas {
                areas.extend((0..surface.triangles.len()).map(area));
            }
            continue;
        }
        let is_crowded = |edge: [u32; 2]| crowded.binary_search(&ordered(edge.map(of_part))).is_ok();
        let fans = divided(surface, is_crowded, of_part, &mut positions);
        if has_areas {
            areas.extend(fans.iter().enumerate().flat_map(|(number, fan)| vec![area(number); fan.len()]));
        }
        triangles.extend(fans.into_iter().flatten());
    }
    let (mut loops, mut border) = (vec![], vec![]);
    for mut around in members.outline() {
        let first = around.iter().position(|&p| borders.begins_with_vertex(members.half_arc(p), coarsest));
        around.rotate_left(first.unwrap_or(0));
        let mut points = vec![];
        for &place in &around {
            let of_place = vertices.at(place).map(|v| numbers[v as usize]);
            points.extend(
                borders
                    .points(members.half_arc(place), parts[place[0] as usize].surface.level)
                    .into_iter()
                    .zip(of_place),
            );
        }
        border.push(points);
        loops.push(around.into_iter().map(|place| members.half_arc(place)).collect());
    }
    let error = parts.iter().map(|part| part.surface.error).fold(0.0, f64::max);
    let level = parts.first().map_or(0, |part| part.surface.level);
    Joined { level, positions, triangles, areas, loops, border, error }
}

/// The triangles of a part in the numbers of all, each as those that it becomes. Where edges of several parts run
/// between the same two vertices, those inside a part get a vertex of their own, so that no edge has more than two
/// triangles.
fn divided(
    surface: &NodeSurface,
    crowded: impl Fn([u32; 2]) -> bool,
    of_part: impl Fn(u32) -> u32,
    positions: &mut Vec<DVec3>,
) -> Vec<Vec<[u32; 3]>> {
    let edges = inner_edges(&surface.triangles, crowded);
    let middles = (positions.len() as u32..).zip(&edges).map(|(middle, &edge)| (edge, middle)).collect();
    positions.extend(edges.iter().map(|edge| middle(edge.map(|v| surface.positions[v as usize]))));
    surface.triangles.iter().map(|&corners| fan(corners, &middles, &of_part)).collect()
}

/// Some of the edges that have triangles on both sides, ascending.
fn inner_edges(triangles: &[[u32; 3]], is_wanted: impl Fn([u32; 2]) -> bool) -> Vec<[u32; 2]> {
    let mut counts: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for edge in triangles.iter().flat_map(|&corners| sides(corners)).filter(|&edge| is_wanted(edge)) {
        *counts.entry(edge).or_default() += 1;
    }
    counts.into_iter().filter(|&(_, count)| count == 2).map(|(edge, _)| edge).collect()
}

fn middle([a, b]: [DVec3; 2]) -> DVec3 {
    (a + b) * 0.5
}

/// A triangle with vertices inserted into its edges.
fn fan(corners: [u32; 3], middles: &BTreeMap<[u32; 2], u32>, number: impl Fn(u32) -> u32) -> Vec<[u32; 3]> {
    let of_side = |k: usize| middles.get(&ordered([corners[k], corners[(k + 1) % 3]])).copied();
    let mut around: Vec<u32> = (0..3).flat_map(|k| [Some(number(corners[k])), of_side(k)]).flatten().collect();
    // From one of them there is no triangle without an area.
    let first = (0..3).find_map(of_side).and_then(|middle| around.iter().position(|&v| v == middle));
    around.rotate_left(first.unwrap_or(0));
    (1..around.len() - 1).map(|k| [around[0], around[k], around[k + 1]]).collect()
}

impl Joined {
    /// The surface as one of a node.
    pub fn surface(&self) -> NodeSurface {
        let mut numbers = vec![NONE; self.positions.len()];
        let border = self.border.iter().flatten().map(|&(_, vertex)| vertex);
        let mut order: Vec<u32> = border.collect();
        (0..).zip(&order).for_each(|(number, &vertex)| numbers[vertex as usize] = number);
        for vertex in 0..self.positions.len() as u32 {
            let number = &mut numbers[vertex as usize];
            if *number == NONE {
                *number = order.len() as u32;
                order.push(vertex);
            }
        }
        let positions = order.into_iter().map(|vertex| self.positions[vertex as usize]).collect();
        let triangles = self.triangles.iter().map(|corners| corners.map(|v| numbers[v as usize])).collect();
        NodeSurface { level: self.level, positions, triangles, areas: self.areas.clone(), error: self.error }
    }

    /// For each loop whether it goes around a hole of the surface that is no wider than this, or would be no loop any
    /// more at the level `coarsest`. Where a seam of regions ends at a hole and goes on behind it, neither region knows
    /// that its arc of the hole has a partner, so both may come to be the same edge.
    pub fn holes(&self, net: &Net, coarsest: u8, widest: f64) -> Vec<bool> {
        let is_loop = |points: &[(BorderPoint, u32)]| points.iter().filter(|(p, _)| p.level <= coarsest).count() > 2;
        let is_hole = |(half_arcs, points): (&Vec<HalfArc>, &Vec<(BorderPoint, u32)>)| {
            points.len() > 1
                && half_arcs.iter().all(|half_arc| net.is_boundary(half_arc.arc))
                && (!is_loop(points) || self.cap(points).1 <= widest)
        };
        self.loops.iter().zip(&self.border).map(is_hole).collect()
    }

    /// A point in the middle of a loop, and how far triangles from it to the loop reach from that.
    fn cap(&self, points: &[(BorderPoint, u32)]) -> (DVec3, f64) {
        let place = |i: usize| self.positions[points[i % points.len()].1 as usize];
        let middle = (0..points.len()).map(place).sum::<DVec3>() / points.len() as f64;
        // The distance from an edge is convex, so it is largest in the middle.
        let reach = |i: usize| {
            let (start, end) = (place(i), place(i + 1));
            closest_on_segment(middle - start, DVec3::ZERO, end - start).0.distance(middle - start)
        };
        (middle, (0..points.len()).map(reach).fold(0.0, f64::max))
    }

    /// The same surface, closed over some of its loops, each by triangles around a vertex in its middle: so no edge has
    /// more than two triangles. A slit is closed as it is.
    pub fn with_caps(mut self, is_closed: &[bool]) -> Self {
        let mut widest: f64 = 0.0;
        let caps = self.border.iter().zip(is_closed).filter(|(points, is_closed)| **is_closed && !is_slit(points));
        for (points, _) in caps {
            let (middle, width) = self.cap(points);
            widest = widest.max(width);
            let apex = self.positions.len() as u32;
            self.positions.push(middle);
            let edges = points.iter().zip(points.iter().cycle().skip(1));
            self.triangles.extend(edges.map(|(&(_, a), &(_, b))| [b, a, apex]));
        }
        if !self.areas.is_empty() {
            self.areas.resize(self.triangles.len(), NONE);
        }
        if widest > 0.0 {
            // Rounding moves a middle by less.
            self.error = error_sum(self.error, widest) * (1.0 + 1e-9);
        }
        let mut stays = is_closed.iter().map(|is_closed| !is_closed);
        self.loops.retain(|_| stays.next().unwrap_or(true));
        let mut stays = is_closed.iter().map(|is_closed| !is_closed);
        self.border.retain(|_| stays.next().unwrap_or(true));
        self
    }

    /// The same surface, where every edge inside with the given number of ends at the border, one or two, has a vertex
    /// in its middle: then no border vertex is kept only because removing it would pinch the surface.
    pub fn with_divided_edges(mut self, ends: usize) -> Self {
        let mut on_border = vec![false; self.positions.len()];
        self.border.iter().flatten().for_each(|&(_, vertex)| on_border[vertex as usize] = true);
        let edges =
            inner_edges(&self.triangles, |edge| edge.into_iter().filter(|&v| on_border[v as usize]).count() >= ends);
        let middles = (self.positions.len() as u32..).zip(&edges).map(|(middle, &edge)| (edge, middle)).collect();
        for edge in edges {
            self.positions.push(middle(edge.map(|v| self.positions[v as usize])));
        }
        let fans: Vec<_> = self.triangles.iter().map(|&corners| fan(corners, &middles, |v| v)).collect();
        self.areas = self.areas.iter().zip(&fans).flat_map(|(&area, fan)| vec![area; fan.len()]).collect();
        self.triangles = fans.into_iter().flatten().collect();
        self
    }

    /// The surface with a flap beside each part of the border where one of some vertices lies: between the points that
    /// a level leaves out and the chord past them. So these points lie inside.
    pub fn with_flaps(&self, vertices: &[u32], level: u8) -> Self {
        let mut triangles = self.triangles.clone();
        let mut border = vec![];
        for points in &self.border {
            let mut left: Vec<(BorderPoint, u32)> = vec![];
            let kept: Vec<usize> = (0..points.len()).filter(|&i| points[i].0.level <= level).collect();
            for (number, &first) in kept.iter().enumerate() {
                let next = kept.get(number + 1).copied().unwrap_or(kept[0] + points.len());
                let run: Vec<(BorderPoint, u32)> = (first..=next).map(|i| points[i % points.len()]).collect();
                let between = &run[..run.len() - 1];
                if between.iter().any(|(_, vertex)| vertices.contains(vertex)) && run.len() > 2 {
                    let around: Vec<u32> = run.iter().map(|&(_, vertex)| vertex).collect();
                    triangles.extend(filled(&around, &self.positions).0);
                    left.push(between[0]);
                } else {
                    left.extend(between);
                }
            }
            border.push(left);
        }
        let mut areas = self.areas.clone();
        if !areas.is_empty() {
            areas.resize(triangles.len(), NONE);
        }
        Self { positions: self.positions.clone(), triangles, areas, loops: self.loops.clone(), border, ..*self }
    }
}

/// Whether a loop is one edge, there and back.
fn is_slit(points: &[(BorderPoint, u32)]) -> bool {
    points.len() == 2
}

/// The vertices of several parts, some of which are the same.
struct Vertices {
    /// First vertex of each part.
    firsts: Vec<u32>,
    /// Per part, loop and half-arc its first vertex; one more for each loop's end.
    starts: Vec<Vec<Vec<u32>>>,
    /// Whether the half-arc begins with a vertex.
    has_corner: Vec<Vec<Vec<bool>>>,
    same_as: Vec<u32>,
}

impl Vertices {
    fn new(borders: &Borders, parts: &[Part]) -> Self {
        let mut this = Self { firsts: vec![], starts: vec![], has_corner: vec![], same_as: vec![] };
        let mut next = 0;
        for &Part { loops, surface } in parts {
            this.firsts.push(next);
            let (mut at, mut starts, mut has_corner) = (next, vec![], vec![]);
            for half_arcs in loops {
                let mut of_loop = vec![at];
                for &half_arc in half_arcs {
                    at += borders.points(half_arc, surface.level).len() as u32;
                    of_loop.push(at);
                }
                starts.push(of_loop);
                has_corner.push(half_arcs.iter().map(|&h| borders.begins_with_vertex(h, surface.level)).collect());
            }
            this.starts.push(starts);
            this.has_corner.push(has_corner);
            next += surface.positions.len() as u32;
        }
        this.same_as = (0..next).collect();
        this
    }

    /// The vertices of a half-arc without the corner at its end.
    fn at(&self, [node, number, k]: Place) -> std::ops::Range<u32> {
        let starts = &self.starts[node as usize][number as usize];
        starts[k as usize]..starts[k as usize + 1]
    }

    /// The vertices of a half-arc with both corners, as far as these are vertices.
    fn of_arc(&self, members: &Members, place: Place) -> Vec<u32> {
        let next = members.next(place);
        let [node, number, k] = next.map(|x| x as usize);
        let end = self.has_corner[node][number][k].then(|| self.at(next).start);
        self.at(place).chain(end).collect()
    }

    /// For each vertex its number among those that differ, and how many there are.
    fn numbers(&mut self) -> (Vec<u32>, usize) {
        let mut numbers = vec![NONE; self.same_as.len()];
        let mut count = 0;
        for vertex in 0..numbers.len() as u32 {
            let first = find(&mut self.same_as, vertex) as usize;
            if numbers[first] == NONE {
                numbers[first] = count;
                count += 1;
            }
            numbers[vertex as usize] = numbers[first];
        }
        (numbers, count as usize)
    }
}
