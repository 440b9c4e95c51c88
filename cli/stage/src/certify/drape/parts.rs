//! How a triangle of the finer surface is laid: it is divided into parts, each of which is mapped linearly into one
//! tile.
//!
//! Around the triangle, its edges pass from tile to tile. At each crossing, one point of the edge (the one nearest to
//! the edge between the tiles) is mapped to a point of that edge. Where the boundary enters a tile and returns over the
//! same edge, a straight cut joins both crossings, and the part beyond lies in that tile. This is repeated until the
//! whole boundary is used up, or until a core remains whose tiles go around a vertex. That vertex is the image of one
//! point of the core, from which the core is divided like a cake. Parts are convex, neighbours agree on what they
//! share, and both triangles at an edge agree on its crossings, so the map is continuous.
//!
//! (Crossings of an edge may coincide or lie at its ends. The map then stands for maps with crossings a hair apart,
//! each of which moves points a hair farther; distances between closed surfaces do not notice.)

use glam::DVec3;

use super::super::closest::PreparedTriangle;
use super::hold::Hold;
use super::{Drape, nearest_on_segment};
use lodpack_mesh::ordered;

/// A point on the boundary of a triangle and its image.
#[derive(Clone, Copy)]
struct MappedPoint {
    point: DVec3,
    image: Image,
}

#[derive(Clone, Copy)]
enum Image {
    Point(DVec3),
    /// The foot of a vertex, computed on demand.
    Foot(u32),
}

/// Successive points of the outline that lie in one tile.
#[derive(Clone, Copy)]
struct Run {
    tile: u32,
    /// Index of the first point; the run ends where the next one begins.
    first: usize,
}

/// The parts of the current triangle. Kept from triangle to triangle to reuse the memory.
#[derive(Default)]
pub(super) struct Parts {
    way: Vec<u32>,
    crossings: Vec<MappedPoint>,
    outline: Vec<MappedPoint>,
    runs: Vec<Run>,
    core: Vec<u32>,
}

/// Receives the images of the parts, as triangles, each with its tile.
pub(super) type Sink<'s> = &'s mut dyn FnMut(u32, [DVec3; 3]);

impl Parts {
    fn begin_run(&mut self, tile: u32) {
        self.runs.push(Run { tile, first: self.outline.len() });
    }

    /// The points of a run.
    fn run(&self, index: usize) -> std::ops::Range<usize> {
        self.runs[index].first..self.runs.get(index + 1).map_or(self.outline.len(), |run| run.first)
    }

    /// Crosses over into another tile.
    fn cross(&mut self, mapped: MappedPoint, tile: u32, drape: &Drape, sink: &mut Option<Sink>) {
        self.outline.push(mapped);
        let top = self.runs.len() - 1;
        if top > 0 && self.runs[top - 1].tile == tile {
            // This returns over the edge by which the run began.
            let Run { tile, first } = self.runs[top];
            if let Some(sink) = sink {
                drape.fan(tile, self.outline[first], &self.outline[first + 1..], sink);
            }
            self.outline.truncate(first);
            self.runs.pop();
        } else {
            self.begin_run(tile);
        }
        self.outline.push(mapped);
    }
}

impl Drape {
    /// The square of the most that the points of a triangle move; none if it is not mapped. Its image goes to the sink,
    /// in part even if the triangle turns out not to be mapped.
    pub(super) fn lay(&self, slot: u32, parts: &mut Parts, mut sink: Option<Sink>) -> Option<f64> {
        let v = self.fine.triangles[slot as usize];
        let feet = v.map(|v| &self.feet[v as usize]);
        let mut square = feet[0].square.max(feet[1].square).max(feet[2].square);
        let tiles = feet.map(|foot| foot.tile);
        if tiles[0] == tiles[1] && tiles[1] == tiles[2] {
            if let Some(sink) = sink {
                sink(tiles[0], v.map(|v| self.foot(v)));
            }
            return Some(square);
        }
        if let Some(tile) = self.common_tile(v) {
            if let Some(sink) = sink {
                sink(tile, v.map(|v| self.foot(v)));
            }
            return Some(square);
        }
        parts.outline.clear();
        parts.runs.clear();
        parts.begin_run(tiles[0]);
        for k in 0..3 {
            parts.outline.push(MappedPoint { point: self.points[v[k] as usize], image: Image::Foot(v[k]) });
            let ends = ordered([v[k], v[(k + 1) % 3]]);
            square = square.max(self.cross_tiles(ends, parts)?);
            let count = parts.crossings.len();
            for index in 0..count {
                let (mapped, tile) = if ends[0] == v[k] {
                    (parts.crossings[index], parts.way[index + 1])
                } else {
                    (parts.crossings[count - 1 - index], parts.way[count - 1 - index])
                };
                parts.cross(mapped, tile, self, &mut sink);
            }
        }
        // The last run is in the tile of the first.
        let (mut first, mut last) = (0, parts.runs.len() - 1);
        if last == 0 {
            if let Some(sink) = sink {
                self.fan(tiles[0], parts.outline[0], &parts.outline[1..], sink);
            }
            return Some(square);
        }
        while last > first + 2 && parts.runs[first + 1].tile == parts.runs[last - 1].tile {
            if let Some(sink) = &mut sink {
                let [begin, end] = [first, last].map(|run| parts.run(run));
                let joined: Vec<MappedPoint> =
                    parts.outline[end].iter().chain(&parts.outline[begin]).copied().collect();
                self.fan(parts.runs[first].tile, joined[0], &joined[1..], sink);
            }
            first += 1;
            last -= 1;
        }
        parts.core.clear();
        parts.core.extend(parts.runs[first..last].iter().map(|run| run.tile));
        let corner = self.corners[self.tiles.shared_vertex(&parts.core)? as usize];
        let core = &parts.outline[parts.runs[first].first..parts.run(last).end];
        square = square.max(self.distance_to_core(slot, core, corner));
        if let Some(sink) = sink {
            // The last run ends where the first begins.
            let start = self.image(&core[0]);
            for index in first..=last {
                let tile = parts.runs[index].tile;
                let mut images: Vec<DVec3> = parts.outline[parts.run(index)].iter().map(|m| self.image(m)).collect();
                if index == last {
                    images.push(start);
                }
                images.windows(2).for_each(|pair| sink(tile, [corner, pair[0], pair[1]]));
            }
        }
        Some(square)
    }

    /// The squared distance of a point from the nearest point of a core, given by its outline.
    fn distance_to_core(&self, slot: u32, core: &[MappedPoint], point: DVec3) -> f64 {
        let is_whole = core.iter().filter(|mapped| matches!(mapped.image, Image::Foot(_))).count() == 3;
        if is_whole {
            let shift = self.coarse.origin - self.fine.origin;
            let closest = self.fine.closest_in(point + shift, slot) - shift;
            return closest.distance_squared(point);
        }
        let fan = core[1..].windows(2).map(|pair| [core[0].point, pair[0].point, pair[1].point]);
        fan.map(|corners| PreparedTriangle::new(corners).closest_point(point).distance_squared(point))
            .fold(f64::INFINITY, f64::min)
    }

    /// Finds the tiles that an edge passes and where it crosses between them. Returns the square of the most that these
    /// points move.
    fn cross_tiles(&self, ends: [u32; 2], parts: &mut Parts) -> Option<f64> {
        let Parts { way, crossings, .. } = parts;
        let feet = ends.map(|v| &self.feet[v as usize]);
        way.clear();
        crossings.clear();
        if !self.way(ends, way) {
            return None;
        }
        let ends = ends.map(|v| self.points[v as usize]);
        let (mut share, mut square) = (0.0, 0.0f64);
        for pair in way.windows(2) {
            let edge = self.tiles.edge_between(pair[0], pair[1])?;
            let holds = |end: usize| match feet[end].hold {
                Hold::Vertex(corner) | Hold::Corner(corner) if edge.contains(&corner) => {
                    Some(self.corners[corner as usize])
                }
                _ => None,
            };
            // If the foot of an end is a vertex of the edge between the tiles, the crossing is at that end.
            if share == 0.0
                && let Some(image) = holds(0)
            {
                crossings.push(MappedPoint { point: ends[0], image: Image::Point(image) });
                continue;
            }
            if let Some(image) = holds(1) {
                share = 1.0;
                crossings.push(MappedPoint { point: ends[1], image: Image::Point(image) });
                continue;
            }
            let edge = edge.map(|v| self.corners[v as usize]);
            // Never go backward along the edge.
            share = nearest_share(ends, edge).max(share);
            let point = ends[0].lerp(ends[1], share);
            let image = nearest_on_segment(point, edge[0], edge[1]);
            square = square.max(point.distance_squared(image));
            crossings.push(MappedPoint { point, image: Image::Point(image) });
        }
        Some(square)
    }

    /// Appends the tiles that the image of an edge passes. Where both feet lie in one tile, it is straight there: then
    /// the way goes around those feet that are vertices of it.
    pub(super) fn way(&self, ends: [u32; 2], way: &mut Vec<u32>) -> bool {
        let start = way.len();
        let [from, to] = ends.map(|v| &self.feet[v as usize]);
        let is_direct = match (from.hold, to.hold) {
            (Hold::Corner(a), Hold::Corner(b)) => {
                way.push(from.tile);
                self.tiles.way_to_edge(a, from.tile, b, way)
                    && self.tiles.way_around(b, way[way.len() - 1], to.tile, way)
            }
            (Hold::Corner(a), Hold::Free) if self.tiles.has(to.tile, a) => {
                way.push(from.tile);
                self.tiles.way_around(a, from.tile, to.tile, way)
            }
            (Hold::Free, Hold::Corner(b)) if self.tiles.has(from.tile, b) => {
                way.push(from.tile);
                self.tiles.way_around(b, from.tile, to.tile, way)
            }
            _ => false,
        };
        if !is_direct {
            way.truncate(start);
        }
        is_direct || self.tiles.way(from.tile, to.tile, way)
    }

    /// A tile in which all feet of a triangle lie, if one is known. The images of its edges are straight there, see
    /// [`Self::way`].
    fn common_tile(&self, triangle: [u32; 3]) -> Option<u32> {
        let feet = triangle.map(|v| &self.feet[v as usize]);
        let lies_in = |tile: u32| {
            feet.iter().all(|foot| match foot.hold {
                Hold::Free => foot.tile == tile,
                Hold::Corner(corner) => self.tiles.has(tile, corner),
                Hold::Edge(_) | Hold::Vertex(_) => false,
            })
        };
        let tile = match feet.iter().find(|foot| foot.hold == Hold::Free) {
            Some(free) => Some(free.tile),
            None => match feet[0].hold {
                Hold::Corner(corner) => self.tiles.find_around(corner, feet[0].tile, lies_in),
                _ => None,
            },
        };
        tile.filter(|&tile| lies_in(tile))
    }

    fn image(&self, mapped: &MappedPoint) -> DVec3 {
        match mapped.image {
            Image::Point(point) => point,
            Image::Foot(vertex) => self.foot(vertex),
        }
    }

    /// Hands the image of a part in one tile to the sink.
    fn fan(&self, tile: u32, apex: MappedPoint, outline: &[MappedPoint], sink: &mut dyn FnMut(u32, [DVec3; 3])) {
        let apex = self.image(&apex);
        let images: Vec<DVec3> = outline.iter().map(|mapped| self.image(mapped)).collect();
        images.windows(2).for_each(|pair| sink(tile, [apex, pair[0], pair[1]]));
    }
}

/// The share along the first segment at which it is nearest to the second (Ericson, "Real-Time Collision Detection",
/// 5.1.9).
fn nearest_share(first: [DVec3; 2], second: [DVec3; 2]) -> f64 {
    let (d1, d2, r) = (first[1] - first[0], second[1] - second[0], first[0] - second[0]);
    let (a, e, f) = (d1.length_squared(), d2.length_squared(), d2.dot(r));
    let (b, c) = (d1.dot(d2), d1.dot(r));
    // Where numbers are not finite (points or parallels for segments) any share is correct, if not the best.
    let within = |share: f64| if share > 0.0 { share.min(1.0) } else { 0.0 };
    let share = within((b * f - c * e) / (a * e - b * b));
    let other = (b * share + f) / e;
    if other < 0.0 {
        within(-c / a)
    } else if other > 1.0 {
        within((b - c) / a)
    } else {
        share
    }
}
