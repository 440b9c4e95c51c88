//! Normals of a surface for smooth light, as far as they follow from its own triangles (SPEC.md, 14.5).
//!
//! Triangles around a vertex that smooth edges join are a **fan**, which has one normal: the mean of theirs, weighted by area. What other roots add
//! at the border is in `light.rs`.

use super::octahedral::{NONE, Octahedral, octahedral};
use crate::codec::vector::{Vec3, add, cross, dot, scale, sub};

/// An edge is a crease where its triangles' normals are at least 30 degrees apart: the cosine.
pub(super) const CREASE: f64 = 0.866_025_403_784_438_6;
/// A triangle whose sines sum to less has no normal, and a sum of normals that is shorter than this share of its weights no direction.
const TINY: f64 = 1e-9;
/// The normal of a vertex without triangles.
const UP: Vec3 = [0.0, 0.0, 1.0];

/// The fans of a surface. Each vertex has a first one, whose number is that of the vertex; numbers from the count of vertices on are further ones, by
/// vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Fans {
    /// The vertices of further fans, ascending.
    pub further: Vec<u32>,
    /// The normal of each fan.
    pub normals: Vec<Octahedral>,
    /// Corners of triangles that are of further fans, ascending, with the fan: corner `k` of triangle `t` is `3 t + k`. Triangles at the border follow
    /// the inner ones.
    pub corners: Vec<[u32; 2]>,
    /// The sum of each fan at the border, in squares of lattice steps: first ones, then further ones.
    pub sums: Vec<[f32; 3]>,
    /// Where fans meet the border: for each of its vertices at the edge to the next one, and at that from the one before.
    pub ends: Vec<[End; 2]>,
    /// The corners of the file that are vertices, ascending, each with the vertex.
    pub border_corners: Vec<[u32; 2]>,
}

/// A border edge at one of its vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct End {
    /// The fan of its triangle there.
    pub fan: u32,
    /// The half-arc on which the edge lies there.
    pub side: u32,
    /// The normal of its triangle.
    pub normal: Octahedral,
}

impl Default for End {
    fn default() -> Self {
        Self { fan: 0, side: 0, normal: NONE }
    }
}

/// What is known of triangles while fans are found.
pub(super) struct Corners {
    /// The fan of each corner.
    pub fans: Vec<u32>,
    faces: Vec<Face>,
}

impl Corners {
    /// The normal of a triangle.
    pub fn normal(&self, triangle: usize) -> Octahedral {
        let Face { normal, area } = self.faces[triangle];
        if area > 0.0 { octahedral(normal) } else { NONE }
    }
}

/// A triangle: its normal, of length 1, and its area; no area if it has no normal.
#[derive(Clone, Copy)]
struct Face {
    normal: Vec3,
    area: f64,
}

impl Face {
    fn of([a, b, c]: [Vec3; 3]) -> Self {
        let (p, q) = (sub(b, a), sub(c, a));
        let normal = cross(p, q);
        let length = dot(normal, normal).sqrt();
        let (pp, qq) = (dot(p, p), dot(q, q));
        // Nearly all triangles have a wide corner there. Lattice coordinates are far from the ends of the range of numbers.
        let is_wide = length * length > 1e-12 * pp * qq;
        if !is_wide {
            let r = sub(c, b);
            let [p, q, r] = [pp, qq, dot(r, r)].map(f64::sqrt);
            // The sum of the sines.
            if p * q * r == 0.0 || length * (p + q + r) <= TINY * p * q * r {
                return Self { normal: [0.0; 3], area: 0.0 };
            }
        }
        Self { normal: scale(normal, 1.0 / length), area: 0.5 * length }
    }
}

/// A fan while it is summed.
#[derive(Clone, Copy)]
struct Sum {
    first: Vec3,
    sum: Vec3,
    weight: f64,
}

impl Sum {
    const NONE: Self = Self { first: UP, sum: [0.0; 3], weight: 0.0 };

    fn normal(&self) -> Octahedral {
        let length = dot(self.sum, self.sum).sqrt();
        octahedral(if length > TINY * self.weight { scale(self.sum, 1.0 / length) } else { self.first })
    }
}

impl Fans {
    /// The fans of triangles, and those of their corners. The first vertices are at the border; ends are not known yet. None if there are too many
    /// triangles to count their corners.
    pub fn new(points: &[Vec3], border_count: usize, triangles: &[[u32; 3]]) -> Option<(Self, Corners)> {
        u32::try_from(triangles.len().checked_mul(3)?).ok()?;
        let (start, own) = corners_of_vertices(points.len(), triangles);
        let faces: Vec<Face> =
            triangles.iter().map(|corners| Face::of(corners.map(|vertex| points[vertex as usize]))).collect();
        let mut fan_of = vec![0; 3 * triangles.len()];
        let (mut fans, mut around) = (Self::default(), Around::default());
        fans.normals.reserve(points.len());
        let mut further = Vec::new();
        let mut further_sums = Vec::new();
        for vertex in 0..points.len() {
            let own = &own[start[vertex] as usize..start[vertex + 1] as usize];
            around.join(own, triangles, &faces);
            around.sums.clear();
            for (place, &corner) in own.iter().enumerate() {
                let Face { normal, area } = faces[corner as usize / 3];
                let first = around.first_of(place);
                let number = if area == 0.0 {
                    // Nobody sees this triangle: the first fan will do.
                    0
                } else if first == place {
                    around.sums.push(Sum { first: normal, ..Sum::NONE });
                    around.sums.len() - 1
                } else {
                    around.numbers[first]
                };
                around.numbers[place] = number;
                if area > 0.0 {
                    let sum = &mut around.sums[number];
                    (sum.sum, sum.weight) = (add(sum.sum, scale(normal, area)), sum.weight + area);
                }
                fan_of[corner as usize] = match number {
                    0 => vertex as u32,
                    _ => (points.len() + fans.further.len() + number - 1) as u32,
                };
                if number > 0 {
                    fans.corners.push([corner, fan_of[corner as usize]]);
                }
            }
            let is_border = vertex < border_count;
            let single = |sum: &Sum| sum.sum.map(|x| x as f32);
            let first = around.sums.first().copied().unwrap_or(Sum::NONE);
            fans.normals.push(first.normal());
            if is_border {
                fans.sums.push(single(&first));
            }
            for sum in around.sums.iter().skip(1) {
                fans.further.push(vertex as u32);
                further.push(sum.normal());
                if is_border {
                    further_sums.push(single(sum));
                }
            }
        }
        fans.normals.extend(further);
        fans.sums.extend(further_sums);
        fans.corners.sort_unstable();
        Some((fans, Corners { fans: fan_of, faces }))
    }

    /// The numbers of the fans of a vertex, given the count of all vertices.
    pub fn of_vertex(&self, vertex: u32, vertex_count: usize) -> impl Iterator<Item = u32> + use<> {
        let first = self.further.partition_point(|&other| other < vertex);
        let count = self.further[first..].iter().take_while(|&&other| other == vertex).count();
        let first = (vertex_count + first) as u32;
        std::iter::once(vertex).chain(first..first + count as u32)
    }

    /// Where a fan at the border is among those: in [`Fans::sums`].
    pub fn border_place(&self, fan: u32, vertex_count: usize) -> usize {
        match (fan as usize).checked_sub(vertex_count) {
            Some(further) => self.ends.len() + further,
            None => fan as usize,
        }
    }

    /// The vertices that a corner of the file is.
    pub fn vertices_of_corner(&self, corner: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.border_corners.partition_point(|[other, _]| *other < corner);
        self.border_corners[first..].iter().take_while(move |[other, _]| *other == corner).map(|&[_, vertex]| vertex)
    }

    /// Its size in memory.
    pub fn byte_count(&self) -> usize {
        let bytes = size_of::<Self>() + 4 * (self.further.len() + self.normals.len());
        let bytes = bytes + 8 * (self.corners.len() + self.border_corners.len());
        bytes + 12 * self.sums.len() + size_of::<[End; 2]>() * self.ends.len()
    }
}

/// The corners of each vertex, ascending: where they begin, and their numbers.
fn corners_of_vertices(vertex_count: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; vertex_count + 1];
    triangles.iter().flatten().for_each(|&vertex| start[vertex as usize + 1] += 1);
    for vertex in 0..vertex_count {
        start[vertex + 1] += start[vertex];
    }
    let (mut slot, mut corners) = (start.clone(), vec![0; triangles.len() * 3]);
    for (corner, &vertex) in (0..).zip(triangles.iter().flatten()) {
        corners[slot[vertex as usize] as usize] = corner;
        slot[vertex as usize] += 1;
    }
    (start, corners)
}

/// The corners around one vertex. It is filled again and again, so that nothing is allocated for each.
#[derive(Default)]
struct Around {
    /// Edges that end at the vertex: the other end, whether the triangle's border runs from there to here, and the corner's place.
    edges: Vec<u64>,
    /// Another corner of the same fan, or itself.
    joined: Vec<u32>,
    /// The fan of each corner, and the sums of fans.
    numbers: Vec<usize>,
    sums: Vec<Sum>,
}

/// Of an edge: whether the border runs to the vertex.
const RUNS_HERE: u64 = 1 << 31;

impl Around {
    /// Joins corners by edges that are no creases.
    fn join(&mut self, own: &[u32], triangles: &[[u32; 3]], faces: &[Face]) {
        self.edges.clear();
        for (place, &corner) in (0..).zip(own) {
            let (triangle, k) = (corner as usize / 3, corner as usize % 3);
            // What has no normal takes no part.
            if faces[triangle].area > 0.0 {
                let [next, previous] = [1, 2].map(|step| u64::from(triangles[triangle][(k + step) % 3]) << 32);
                self.edges.extend([next | place, previous | RUNS_HERE | place]);
            }
        }
        self.edges.sort_unstable();
        self.joined.clear();
        self.joined.extend(0..own.len() as u32);
        self.numbers.clear();
        self.numbers.resize(own.len(), 0);
        for edge in self.edges.chunk_by(|a, b| a >> 32 == b >> 32) {
            let &[from_here, to_here] = edge else { continue };
            if from_here & RUNS_HERE != 0 || to_here & RUNS_HERE == 0 {
                continue;
            }
            let [a, b] = [from_here, to_here].map(|edge| (edge & (RUNS_HERE - 1)) as u32);
            let [one, other] = [a, b].map(|place| faces[own[place as usize] as usize / 3].normal);
            if dot(one, other) > CREASE {
                join(&mut self.joined, a, b);
            }
        }
    }

    /// The first corner of a corner's fan.
    fn first_of(&mut self, place: usize) -> usize {
        first(&mut self.joined, place as u32) as usize
    }
}

/// Makes two sets one. Each of these has the number of its least element.
pub(super) fn join(sets: &mut [u32], a: u32, b: u32) {
    let [a, b] = [a, b].map(|element| first(sets, element));
    sets[a.max(b) as usize] = a.min(b);
}

/// The least element of an element's set.
pub(super) fn first(sets: &mut [u32], mut element: u32) -> u32 {
    while sets[element as usize] != element {
        sets[element as usize] = sets[sets[element as usize] as usize];
        element = sets[element as usize];
    }
    element
}
