//! The levels of corners: which of them are vertices of the borders between groups.
//!
//! Where three nodes of a level meet, the corner is a vertex. Where only two are left, the border runs on, and the
//! corner is a point of it like any other: it stays where the border would otherwise leave its points by more than the
//! level allows (Douglas and Peucker 1973), or where two borders would become one edge.

use std::collections::BTreeMap;

use super::super::Scale;
use super::net::Net;
use glam::DVec3;
use lodpack_mesh::NONE;
use lodpack_mesh::exact::power_of_two;
use lodpack_stage::arcs::closest_on_segment;

/// The top of a file has at least this many corners, so that its border is nearer than its level asks for: a few
/// hundred triangles have no use for a rough outline.
const CORNERS_OF_TOP: usize = 64;
/// The most halvings, for that, of the distance that a border may have.
const MOST_HALVINGS: i32 = 12;

/// The coarsest level of each corner, above nodes of the level `bottom` up to the level `end`. `group_of` names, for
/// each height above these nodes, the group of each.
pub(super) fn corner_levels(net: &Net, scale: &Scale, [end, bottom]: [u8; 2], group_of: &[Vec<u32>]) -> Vec<u8> {
    let mut levels = net.corner_levels.clone();
    for level in (end..bottom).rev() {
        let height = usize::from(bottom - level).min(group_of.len());
        let Some(groups) = height.checked_sub(1).and_then(|height| group_of.get(height)) else { continue };
        let vertices = |straight: f64| Level { net, scale, level, levels: &levels, straight }.vertices(groups);
        let straight = scale.levels[usize::from(level)].arc_tolerance;
        let mut corners = vertices(straight);
        if end == 0 && groups.iter().all(|&group| group == 0) {
            let nearer = (1..=MOST_HALVINGS).map(|halvings| vertices(straight * power_of_two(-halvings)));
            corners = nearer.take_while(|nearer| nearer.len() <= CORNERS_OF_TOP).last().unwrap_or(corners);
        }
        for corner in corners {
            levels[corner as usize] = level;
        }
    }
    levels
}

/// The borders of a level.
struct Level<'a> {
    net: &'a Net<'a>,
    scale: &'a Scale,
    level: u8,
    /// The corners that are vertices one level finer have that level here.
    levels: &'a [u8],
    /// How far a border may be from the points that it leaves out.
    straight: f64,
}

/// A point of a chain of arcs between corners that stay.
#[derive(Clone, Copy)]
struct Point {
    position: DVec3,
    /// The corner, if it may stay.
    candidate: Option<u32>,
    /// Whether it stays.
    stays: bool,
    /// Whether it is a sample of all levels.
    lasts: bool,
}

impl Level<'_> {
    /// The corners that are vertices at this level.
    fn vertices(&self, groups: &[u32]) -> Vec<u32> {
        let net = self.net;
        let of = |node: u32| groups.get(node as usize).copied().unwrap_or(NONE);
        let mut at_corner: Vec<Vec<u32>> = vec![vec![]; net.corners.len()];
        for ((number, ends), sides) in (0..).zip(&net.ends).zip(&net.sides) {
            let [left, right] = sides.map(of);
            if left != right {
                ends.iter().for_each(|&end| at_corner[end as usize].push(number));
            }
        }
        let stays = |corner: u32| at_corner[corner as usize].len() != 2 || net.is_fixed[corner as usize];
        let meets = |corner: &u32| !at_corner[*corner as usize].is_empty();
        let corners = 0..net.corners.len() as u32;
        let mut vertices: Vec<u32> = corners.clone().filter(|corner| meets(corner) && stays(*corner)).collect();
        let mut is_done = vec![false; net.ends.len()];
        let (mut chains, mut rings) = (vec![], vec![]);
        // From corners that stay, and then around what has none.
        for start in vertices.iter().copied().chain(corners.filter(|&corner| meets(&corner) && !stays(corner))) {
            for &first in &at_corner[start as usize] {
                let (mut chain, mut arc, mut from) = (vec![], first, start);
                while !std::mem::replace(&mut is_done[arc as usize], true) {
                    chain.push((arc, from));
                    let [a, b] = net.ends[arc as usize];
                    from = if a == from { b } else { a };
                    if stays(from) || from == start {
                        break;
                    }
                    let next = at_corner[from as usize].iter().find(|&&next| next != arc);
                    arc = next.copied().unwrap_or(arc);
                }
                if !chain.is_empty() {
                    if stays(start) { chains.push((chain, [start, from])) } else { rings.push(chain) }
                }
            }
        }
        // Chains between the same corners.
        let mut parallel: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for (_, [a, b]) in &chains {
            *parallel.entry([*a.min(b), *a.max(b)]).or_default() += 1;
        }
        for (chain, [a, b]) in chains {
            let mut points = self.points(&chain);
            if a == b {
                self.keep_at_least(&mut points, 2);
            } else if parallel[&[a.min(b), a.max(b)]] > 1 {
                self.keep_at_least(&mut points, 1);
            }
            self.keep_needed(&mut points);
            vertices.extend(points[1..points.len() - 1].iter().filter(|p| p.stays).filter_map(|p| p.candidate));
        }
        for ring in rings {
            let mut points = self.points(&ring);
            points.pop();
            let is_corner = |p: &Point| p.stays && p.candidate.is_some();
            let candidate = points.iter().position(|p| p.candidate.is_some());
            let first = points.iter().position(|p| p.stays || p.candidate.is_some());
            let mut kept = self.ring(points.clone(), first.unwrap_or(0));
            // The corner where it was begun was chosen freely, and coarser levels may lack it: with two others alone
            // they would have no loop.
            let is_vertex = |p: &&Point| p.lasts || p.stays && p.candidate.is_some();
            if kept[1..].iter().filter(is_vertex).count() < 3 {
                points[0].stays = false;
                let first = points.iter().position(|p| p.lasts || p.candidate.is_some());
                kept = self.ring(points.clone(), first.unwrap_or(0));
            }
            // The samples of a long straight border may be enough for its shape, but a loop begins with a corner.
            if let Some(candidate) = candidate.filter(|_| !kept.iter().any(is_corner)) {
                kept = self.ring(points, candidate);
            }
            vertices.extend(kept.iter().filter(|p| p.stays).filter_map(|p| p.candidate));
        }
        vertices.sort_unstable();
        vertices.dedup();
        vertices
    }

    /// What stays of a closed border, from a point that stays to itself.
    fn ring(&self, mut points: Vec<Point>, first: usize) -> Vec<Point> {
        points.rotate_left(first);
        points[0].stays = true;
        points.push(points[0]);
        self.keep_at_least(&mut points, 2);
        self.keep_needed(&mut points);
        points
    }

    /// All points of a chain, ends included. The ends stay, and so do samples of this level.
    fn points(&self, chain: &[(u32, u32)]) -> Vec<Point> {
        let scale = self.scale;
        let corner = |corner: u32| Point {
            position: scale.local_from_lattice(self.net.corners[corner as usize]),
            candidate: (self.levels[corner as usize] == self.level + 1).then_some(corner),
            stays: false,
            lasts: false,
        };
        let mut points = vec![];
        let mut last = NONE;
        for &(arc, from) in chain {
            let [a, b] = self.net.ends[arc as usize];
            points.push(corner(from));
            let before = points.len();
            points.extend(self.net.samples[arc as usize].iter().map(|sample| Point {
                position: scale.local_from_lattice(sample.position),
                candidate: None,
                stays: sample.level <= self.level,
                lasts: sample.level == 0,
            }));
            if a != from {
                points[before..].reverse();
            }
            last = if a == from { b } else { a };
        }
        points.push(corner(last));
        let end = points.len() - 1;
        (points[0].stays, points[end].stays) = (true, true);
        points
    }

    /// Keeps at least `count` points between the ends, if there are that many: those that are farthest off. Samples
    /// that coarser levels lack do not count, since no corner between them could come back there.
    fn keep_at_least(&self, points: &mut [Point], count: usize) {
        let lasts = |p: &&Point| p.lasts || p.stays && p.candidate.is_some();
        while points[1..points.len() - 1].iter().filter(lasts).count() < count {
            let mut farthest: Option<(f64, usize)> = None;
            let kept: Vec<usize> = (0..points.len()).filter(|&i| points[i].stays).collect();
            for pair in kept.windows(2) {
                let [a, b] = [points[pair[0]].position, points[pair[1]].position];
                for i in (pair[0] + 1..pair[1]).filter(|&i| points[i].candidate.is_some()) {
                    let distance = points[i].position.distance(closest_on_segment(points[i].position, a, b).0);
                    if farthest.is_none_or(|(most, _)| distance > most) {
                        farthest = Some((distance, i));
                    }
                }
            }
            let Some((_, i)) = farthest else { return };
            points[i].stays = true;
        }
    }

    /// Keeps further points until none is too far from the chords between those that stay.
    fn keep_needed(&self, points: &mut [Point]) {
        let kept: Vec<usize> = (0..points.len()).filter(|&i| points[i].stays).collect();
        let mut pending: Vec<[usize; 2]> = kept.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        while let Some([first, last]) = pending.pop() {
            let [a, b] = [points[first].position, points[last].position];
            let off = |i: &usize| points[*i].position.distance(closest_on_segment(points[*i].position, a, b).0);
            if (first + 1..last).all(|i| off(&i) <= self.straight) {
                continue;
            }
            let candidates = (first + 1..last).filter(|&i| points[i].candidate.is_some());
            let Some(middle) = candidates.max_by(|i, j| off(i).total_cmp(&off(j)).then(j.cmp(i))) else { continue };
            points[middle].stays = true;
            pending.extend([[first, middle], [middle, last]]);
        }
    }
}
