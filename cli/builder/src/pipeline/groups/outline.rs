//! Borders of nodes: their points at a level, and the outline of nodes that become one.

use std::collections::{HashMap, HashSet};

use super::net::Net;
use lodpack::LatticePoint;
use lodpack_stage::arcs::HalfArc;

/// Where arcs run, and from which level on their corners are vertices.
pub(in super::super) struct Borders<'a> {
    pub net: &'a Net<'a>,
    pub corner_levels: &'a [u8],
}

/// A point of a border.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct BorderPoint {
    /// The corner, unless it is a sample.
    pub corner: Option<u32>,
    /// The coarsest level at which it is a vertex.
    pub level: u8,
    pub position: LatticePoint,
}

impl Net<'_> {
    /// The borders of the nodes at the bottom.
    pub fn at_the_bottom(&self) -> Borders<'_> {
        Borders { net: self, corner_levels: &self.corner_levels }
    }
}

impl Borders<'_> {
    /// The points of a half-arc in its direction: the corner where it begins, and the samples up to a level.
    pub fn points(&self, half_arc: HalfArc, level: u8) -> Vec<BorderPoint> {
        let [corner, _] = self.net.ends_of(half_arc);
        let corner_level = self.corner_levels[corner as usize];
        let mut points = vec![];
        if corner_level <= level {
            let position = self.net.corners[corner as usize];
            points.push(BorderPoint { corner: Some(corner), level: corner_level, position });
        }
        let samples = self.net.samples[half_arc.arc as usize].iter().filter(|sample| sample.level <= level);
        let mut samples: Vec<BorderPoint> =
            samples.map(|s| BorderPoint { corner: None, level: s.level, position: s.position }).collect();
        if half_arc.reversed {
            samples.reverse();
        }
        points.extend(samples);
        points
    }

    /// Whether a half-arc begins with a vertex of a level.
    pub fn begins_with_vertex(&self, half_arc: HalfArc, level: u8) -> bool {
        self.corner_levels[self.net.ends_of(half_arc)[0] as usize] <= level
    }
}

/// A half-arc of one of several nodes: node, loop, place in the loop.
pub(super) type Place = [u32; 3];

/// The half-arcs of several nodes.
pub(super) struct Members<'a> {
    /// Per node its loops.
    loops: Vec<&'a [Vec<HalfArc>]>,
    places: HashMap<(u32, bool), Place>,
}

impl<'a> Members<'a> {
    pub fn new(loops: Vec<&'a [Vec<HalfArc>]>) -> Self {
        let mut this = Self { loops, places: HashMap::new() };
        for place in this.all() {
            let HalfArc { arc, reversed } = this.half_arc(place);
            this.places.insert((arc, reversed), place);
        }
        this
    }

    fn all(&self) -> Vec<Place> {
        let mut all = vec![];
        for (node, loops) in (0..).zip(&self.loops) {
            for (number, half_arcs) in (0..).zip(*loops) {
                all.extend((0..half_arcs.len() as u32).map(|k| [node, number, k]));
            }
        }
        all
    }

    pub fn half_arc(&self, [node, number, k]: Place) -> HalfArc {
        self.loops[node as usize][number as usize][k as usize]
    }

    /// The half-arc that follows in the loop.
    pub fn next(&self, [node, number, k]: Place) -> Place {
        let count = self.loops[node as usize][number as usize].len() as u32;
        [node, number, (k + 1) % count]
    }

    /// The same arc as another half-arc of these nodes sees it.
    pub fn opposite(&self, place: Place) -> Option<Place> {
        let HalfArc { arc, reversed } = self.half_arc(place);
        self.places.get(&(arc, !reversed)).copied()
    }

    /// Both sides of each arc between two of the nodes, or of one and itself.
    pub fn inner(&self) -> Vec<[Place; 2]> {
        let forward = self.all().into_iter().filter(|&place| !self.half_arc(place).reversed);
        forward.filter_map(|place| Some([place, self.opposite(place)?])).collect()
    }

    /// The loops around all nodes together.
    pub fn outline(&self) -> Vec<Vec<Place>> {
        let mut seen: HashSet<Place> = HashSet::new();
        let mut loops = vec![];
        for start in self.all() {
            let mut around = vec![];
            let mut at = start;
            while self.opposite(at).is_none() && seen.insert(at) {
                around.push(at);
                at = self.next(at);
                // Past everything that is inside now.
                while let Some(opposite) = self.opposite(at) {
                    at = self.next(opposite);
                }
            }
            if !around.is_empty() {
                loops.push(around);
            }
        }
        loops
    }
}
