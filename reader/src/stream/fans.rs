//! Normals of a surface for smooth light, as far as they follow from its own triangles (SPEC.md, 14.5).
//!
//! Triangles around a vertex that smooth edges join are a **fan**, which has one normal: the mean of theirs, weighted
//! by area. What other roots add at the border is in `light.rs`.

use super::octahedral::{NONE, Octahedral, octahedral};
use crate::codec::vector::{Vec3, add, cross, dot, scale, sub};

/// An edge is a crease where its triangles' normals are at least 30 degrees apart: the cosine.
pub(super) const CREASE: f64 = 0.866_025_403_784_438_6;
/// A triangle whose sines sum to less has no normal, and a sum of normals that is shorter than this share of its
/// weights no direction.
const TINY: f64 = 1e-9;
/// The normal of a vertex without triangles.
const UP: Vec3 = [0.0, 0.0, 1.0];

/// The fans of a surface. Each vertex has a first one, whose number is that of the vertex; numbers from the count of
/// vertices on are further ones, by vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Fans {
    /// The vertices of further fans, ascending.
    pub further: Vec<u32>,
    /// The normal of each fan.
    pub normals: Vec<Octahedral>,
    /// Corners of triangles that are of further fans, ascending, with the fan in the lower half: corner `k` of triangle
    /// `t` is `3 t + k`. Triangles at the border follow the inner ones.
    corners: Vec<u64>,
    /// The sum of each fan at the border, in squares of lattice steps: first ones, then further ones.
    pub sums: Vec<[f32; 3]>,
    /// Where fans meet the border: for each of its vertices at the edge to the next one, and at that from the one
    /// before.
    pub ends: Vec<[End; 2]>,
    /// The corners of the file that are vertices, ascending, each with the vertex in the lower half.
    border_corners: Vec<u64>,
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
        // Nearly all triangles have a wide corner there. Lattice coordinates are far from the ends of the range of
        // numbers.
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

    fn add(&mut self, &Face { normal, area }: &Face) {
        (self.sum, self.weight) = (add(self.sum, scale(normal, area)), self.weight + area);
    }

    fn normal(&self) -> Octahedral {
        let length = dot(self.sum, self.sum).sqrt();
        octahedral(if length > TINY * self.weight { scale(self.sum, 1.0 / length) } else { self.first })
    }
}

impl Fans {
    /// Forgets the corners of triangles that go, and numbers the others anew.
    pub fn retain_triangles(&mut self, stays: &[bool]) {
        let mut next = 0;
        let number = |&stays: &bool| {
            next += u64::from(stays);
            stays.then(|| next - 1)
        };
        let numbers: Vec<Option<u64>> = stays.iter().map(number).collect();
        let renumbered = |&entry: &u64| {
            let (corner, fan) = (entry >> 32, entry & u64::from(u32::MAX));
            let triangle = numbers.get((corner / 3) as usize).copied().flatten()?;
            Some((3 * triangle + corner % 3) << 32 | fan)
        };
        self.corners = self.corners.iter().filter_map(renumbered).collect();
    }

    /// The fans of triangles, and those of their corners. The first vertices are at the border; ends are not known yet.
    /// None if there are too many triangles to count their corners.
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
            around.sum(own, triangles, &faces);
            for (&corner, &number) in own.iter().zip(&around.numbers) {
                let fan = match number {
                    0 => vertex as u32,
                    _ => (points.len() + fans.further.len()) as u32 + number - 1,
                };
                fan_of[corner as usize] = fan;
                if number > 0 {
                    fans.corners.push(pair(corner, fan));
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

    /// Corners of triangles that are of further fans, ascending from a triangle on, each with the fan.
    pub fn further_corners(&self, first_triangle: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        let first = self.corners.partition_point(|&corner| corner < pair(3 * first_triangle, 0));
        self.corners[first..].iter().map(|&corner| halves(corner))
    }

    /// Takes the corners of the file that are vertices, with these.
    pub fn set_border_corners(&mut self, corners: impl Iterator<Item = (u32, u32)>) {
        self.border_corners = corners.map(|(corner, vertex)| pair(corner, vertex)).collect();
        self.border_corners.sort_unstable();
    }

    /// The corners of the file that are vertices, ascending.
    pub fn border_corners(&self) -> impl Iterator<Item = u32> + '_ {
        self.border_corners.iter().map(|&corner| halves(corner).0)
    }

    /// The vertices that a corner of the file is.
    pub fn vertices_of_corner(&self, corner: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.border_corners.partition_point(|&other| other < pair(corner, 0));
        self.border_corners[first..]
            .iter()
            .map(|&pair| halves(pair))
            .take_while(move |(other, _)| *other == corner)
            .map(|(_, vertex)| vertex)
    }

    /// Its size in memory.
    pub fn byte_count(&self) -> usize {
        let bytes = size_of::<Self>() + 4 * (self.further.len() + self.normals.len());
        let bytes = bytes + 8 * (self.corners.len() + self.border_corners.len());
        bytes + 12 * self.sums.len() + size_of::<[End; 2]>() * self.ends.len()
    }
}

/// Two numbers in one: many kinds of things are sorted as this one kind.
fn pair(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

fn halves(pair: u64) -> (u32, u32) {
    ((pair >> 32) as u32, pair as u32)
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
    /// Edges that end at the vertex: the other end, whether the triangle's border runs from there to here, and the
    /// corner's place.
    edges: Vec<u64>,
    /// Another corner of the same fan, or itself.
    joined: Vec<u32>,
    /// The fan of each corner, from 0 on in the order of their first corners.
    numbers: Vec<u32>,
    /// The sums of these fans.
    sums: Vec<Sum>,
}

/// Of an edge: whether the border runs to the vertex.
const RUNS_HERE: u64 = 1 << 31;
/// At most this many corners are compared with each other. More are sorted: their number may be any.
const FEW: usize = 8;

impl Around {
    /// Finds the fans of corners, and sums them.
    fn sum(&mut self, own: &[u32], triangles: &[[u32; 3]], faces: &[Face]) {
        self.joined.clear();
        self.joined.extend(0..own.len() as u32);
        let join_count =
            if own.len() <= FEW { self.join_few(own, triangles, faces) } else { self.join(own, triangles, faces) };
        self.numbers.clear();
        self.numbers.resize(own.len(), 0);
        self.sums.clear();
        // Nearly all vertices have a single fan.
        if join_count + 1 == own.len() {
            let mut sum = Sum { first: faces[own[0] as usize / 3].normal, ..Sum::NONE };
            own.iter().for_each(|&corner| sum.add(&faces[corner as usize / 3]));
            self.sums.push(sum);
            return;
        }
        for (place, &corner) in own.iter().enumerate() {
            let face = &faces[corner as usize / 3];
            // Nobody sees a triangle without a normal: the first fan will do.
            if face.area > 0.0 {
                let first = first(&mut self.joined, place as u32) as usize;
                if first == place {
                    self.numbers[place] = self.sums.len() as u32;
                    self.sums.push(Sum { first: face.normal, ..Sum::NONE });
                }
                self.numbers[place] = self.numbers[first];
                self.sums[self.numbers[first] as usize].add(face);
            }
        }
    }

    /// Joins two corners unless the edge between them is a crease. Returns whether they were apart.
    #[inline]
    fn join_by_edge(&mut self, [a, b]: [usize; 2], own: &[u32], faces: &[Face]) -> bool {
        let [one, other] = [a, b].map(|place| faces[own[place] as usize / 3].normal);
        dot(one, other) > CREASE && join(&mut self.joined, a as u32, b as u32)
    }

    /// Joins corners by edges that are no creases, by comparing all with all. Returns how many sets have become part of
    /// others.
    fn join_few(&mut self, own: &[u32], triangles: &[[u32; 3]], faces: &[Face]) -> usize {
        const NONE: u32 = u32::MAX;
        let (mut next, mut previous) = ([NONE; FEW], [NONE; FEW]);
        for (place, &corner) in own.iter().enumerate() {
            let (triangle, k) = (corner as usize / 3, corner as usize % 3);
            // What has no normal takes no part.
            if faces[triangle].area > 0.0 {
                [next[place], previous[place]] = [1, 2].map(|step| triangles[triangle][(k + step) % 3]);
            }
        }
        let hits = |ends: &[u32; FEW], end: u32| (0..FEW).map(|k| u32::from(ends[k] == end) << k).sum::<u32>();
        let mut join_count = 0;
        for (place, &end) in next[..own.len()].iter().enumerate().filter(|(_, end)| **end != NONE) {
            let [from_here, to_here] = [hits(&next, end), hits(&previous, end)];
            if from_here.is_power_of_two() && to_here.is_power_of_two() {
                let other = to_here.trailing_zeros() as usize;
                join_count += usize::from(self.join_by_edge([place, other], own, faces));
            }
        }
        join_count
    }

    /// The same for any number of corners.
    fn join(&mut self, own: &[u32], triangles: &[[u32; 3]], faces: &[Face]) -> usize {
        let mut edges = std::mem::take(&mut self.edges);
        edges.clear();
        for (place, &corner) in (0..).zip(own) {
            let (triangle, k) = (corner as usize / 3, corner as usize % 3);
            if faces[triangle].area > 0.0 {
                let [next, previous] = [1, 2].map(|step| u64::from(triangles[triangle][(k + step) % 3]) << 32);
                edges.extend([next | place, previous | RUNS_HERE | place]);
            }
        }
        edges.sort_unstable();
        let mut join_count = 0;
        for edge in edges.chunk_by(|a, b| a >> 32 == b >> 32) {
            let &[from_here, to_here] = edge else { continue };
            if from_here & RUNS_HERE == 0 && to_here & RUNS_HERE != 0 {
                let places = [from_here, to_here].map(|edge| (edge & (RUNS_HERE - 1)) as usize);
                join_count += usize::from(self.join_by_edge(places, own, faces));
            }
        }
        self.edges = edges;
        join_count
    }
}

/// Makes two sets one; a set has the number of its least element. Returns whether they were two.
pub(super) fn join(sets: &mut [u32], a: u32, b: u32) -> bool {
    let [a, b] = [a, b].map(|element| first(sets, element));
    sets[a.max(b) as usize] = a.min(b);
    a != b
}

/// The least element of an element's set.
pub(super) fn first(sets: &mut [u32], mut element: u32) -> u32 {
    while sets[element as usize] != element {
        sets[element as usize] = sets[sets[element as usize] as usize];
        element = sets[element as usize];
    }
    element
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::octahedral::direction;

    const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

    fn fans(points: &[Vec3], triangles: &[[u32; 3]]) -> (Fans, Vec<u32>) {
        let (fans, corners) = Fans::new(points, 0, triangles).unwrap();
        assert_eq!(fans.normals.len(), points.len() + fans.further.len());
        for (&fan, &vertex) in corners.fans.iter().zip(triangles.as_flattened()) {
            let further = (fan as usize).checked_sub(points.len());
            assert_eq!(further.map_or(fan, |further| fans.further[further]), vertex);
            assert!(fans.of_vertex(vertex, points.len()).any(|other| other == fan));
        }
        (fans, corners.fans)
    }

    #[test]
    fn a_cube_keeps_three_normals_a_corner_and_what_has_no_area_changes_nothing() {
        let mut points: Vec<Vec3> =
            (0..8).map(|bits| [0, 1, 2].map(|axis| f64::from(bits >> axis & 1) * 2000.0 - 1000.0)).collect();
        let mut triangles: Vec<[u32; 3]> = CUBE.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        for round in 0..2 {
            let (cube, corners) = fans(&points, &triangles);
            assert_eq!(cube.further.len(), 16);
            for (number, triangle) in corners[..36].chunks_exact(3).enumerate() {
                let normal =
                    triangle.iter().map(|&fan| direction(cube.normals[fan as usize]).map(|x| x.round() as i64));
                let face = CUBE[number / 2].map(|vertex| points[vertex as usize]);
                let of_face = cross(sub(face[1], face[0]), sub(face[2], face[0])).map(|x| (x / 4e6).round() as i64);
                assert!(normal.into_iter().all(|normal| normal == of_face), "round {round}, triangle {number}");
            }
            // On an edge, in a point, on a line in space, and a vertex of no triangle.
            points.extend([[-1000.0, -1000.0, 0.0], [9e3, 0.0, 0.0], [9e3, 1e3, 0.0], [9e3, 2e3, 0.0], [7e3; 3]]);
            triangles.extend([[0, 8, 4], [3, 3, 3], [5, 5, 7], [9, 10, 11]]);
        }
    }

    #[test]
    fn many_corners_around_a_vertex_are_joined_as_few_are() {
        for count in [3, FEW - 1, FEW, FEW + 1, 40] {
            // A disc, and a roof of two sides.
            for crease in [false, true] {
                let at = |k: usize| {
                    let turn = (k as f64 * 2.0 + 1.0) / count as f64 * std::f64::consts::PI;
                    let [x, y] = [turn.cos() * 1e4, turn.sin() * 1e4];
                    [x, y, if crease { -y.abs() } else { 0.0 }]
                };
                let points: Vec<Vec3> = [[0.0; 3]].into_iter().chain((0..count).map(at)).collect();
                let triangles: Vec<[u32; 3]> =
                    (0..count as u32).map(|k| [0, 1 + k, 1 + (k + 1) % count as u32]).collect();
                let (disc, _) = fans(&points, &triangles);
                let around = disc.of_vertex(0, points.len()).count();
                let at_most = if crease { 2..=4 } else { 1..=1 };
                assert!(at_most.contains(&around), "{count}, {crease}: {around}");
                // The same with a triangle that is there twice: its edges are creases.
                let (doubled, _) = fans(&points, &[&triangles[..], &triangles[..1]].concat());
                assert!(doubled.of_vertex(0, points.len()).count() > around.min(2), "{count}, {crease}");
            }
        }
    }
}
