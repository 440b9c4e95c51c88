//! What places along borders should show.

use glam::DVec3;

use super::borders::{Edge, EdgeSide, Place};
use super::rim::{Rim, RimEdge, UNKNOWN, packed};
use lodpack_mesh::NONE;

/// What places should show.
#[derive(Default)]
pub(super) struct Wanted {
    /// How strongly covered texels change.
    pub places: Vec<(Place, f32)>,
    /// At each of them the colours of all channels without opacity.
    pub colours: Vec<[f32; 3]>,
    /// The edges of the outer border, relative to the patch's origin, and how many points each has.
    pub outer_edges: Vec<([DVec3; 2], u32)>,
    /// Which of the places these points are, [`NONE`] where nothing is wanted.
    pub outer_points: Vec<u32>,
    /// Points along inner edges where both sides want the same.
    pub alike: Vec<Alike>,
    /// Which places are shown beyond the patch as well.
    pub alone: Vec<u32>,
    /// Places between two of these.
    pub alone_between: Vec<(Place, [u32; 2])>,
}

/// A point of an inner edge.
pub(super) struct Alike {
    /// Where it is on both sides.
    pub places: [Place; 2],
    /// Whether it comes next after the one before it on an edge.
    pub follows: bool,
}

impl Wanted {
    /// Notes an edge of which all points will be noted.
    pub fn add_edge(&mut self, edge: &Edge) {
        self.outer_edges.push((edge.ends(), edge.points().count() as u32));
    }

    /// Notes which points of a side of an outer edge have to show what is wanted. Those are the last ones that were
    /// noted.
    pub fn add_alone(&mut self, side: EdgeSide<'_>) {
        let count = side.edge().points().count();
        let points = &self.outer_points[self.outer_points.len() - count..];
        self.alone.extend(points.iter().filter(|&&point| point != NONE));
        let between = side.all_places().skip(1).step_by(2).zip(points.windows(2));
        let known = between.filter_map(|(place, ends)| match *ends {
            [one, other] if one != NONE && other != NONE => Some((place, [one, other])),
            _ => None,
        });
        self.alone_between.extend(known);
    }

    /// Notes the points of an inner edge of which both sides want the same.
    pub fn add_pairs(&mut self, pairs: impl Iterator<Item = [Place; 2]>, is_alike: impl Fn(usize) -> bool) {
        for (step, places) in pairs.enumerate().filter(|&(step, _)| is_alike(step)) {
            self.alike.push(Alike { places, follows: step > 0 && is_alike(step - 1) });
        }
    }
}

impl Rim {
    /// Of what borders should show.
    pub fn new(wanted: &Wanted, origin: DVec3, channels: usize) -> Self {
        let mut this = Self { channels, ..Self::default() };
        let mut points = wanted.outer_points.as_slice();
        for &(ends, count) in &wanted.outer_edges {
            let Some((of_edge, others)) = points.split_at_checked(count as usize) else { break };
            points = others;
            // Of such an edge there is nothing to know.
            if of_edge.iter().all(|&point| point == NONE) {
                continue;
            }
            let (ends, first) = (ends.map(|end| end + origin), (this.colours.len() / channels) as u32);
            this.edges.push(RimEdge { ends, first, steps: count - 1 });
            for &point in of_edge {
                let colours = wanted.colours.get(point as usize * channels..).and_then(|rest| rest.get(..channels));
                match colours.filter(|_| point != NONE) {
                    Some(colours) => this.colours.extend(colours.iter().map(|colour| colour.map(packed))),
                    None => this.colours.extend(std::iter::repeat_n([UNKNOWN, 0, 0], channels)),
                }
            }
        }
        this
    }
}
