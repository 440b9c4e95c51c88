//! Normals for surfaces that store none: means around vertices that end at creases (SPEC.md, 14.4).
//!
//! Weights are areas. Angles are more usual (Thürmer and Wüthrich, "Computing Vertex Normals from Polygonal Facets",
//! 1998), but simplified meshes have long thin triangles beside large ones that lie along the surface, and their
//! normals are farther off: format-spec/trials/light.md has the measurements.

use std::io;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use glam::DVec3;
use rayon::prelude::*;

/// An edge is a crease where its triangles' normals are at least 30 degrees apart: the cosine.
const CREASE: f64 = 0.866_025_403_784_438_6;
/// The name of their accessor in glTF, by which a build knows that they say nothing of the surface that its triangles
/// do not.
pub const COMPUTED: &str = "normals of triangles, joined";
/// A triangle whose sines sum to less has no normal, and a sum of normals that is shorter than this share of its
/// weights no direction.
const TINY: f64 = 1e-9;
/// What nothing else has a say in.
const UP: DVec3 = DVec3::Z;
/// Vertices that a thread takes at once. Results do not depend on it.
const CHUNK: usize = 4096;

/// How many normals a vertex may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Creases {
    /// One for each side of a crease.
    Kept,
    /// One alone, for formats that have one a vertex.
    Smoothed,
}

/// A normal for each corner of a mesh. Corners around a vertex that are not separated by creases share one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fans {
    /// The vertex of each fan, ascending. Each vertex has at least one.
    pub vertices: Vec<u32>,
    /// The normal of each fan, of length 1.
    pub normals: Vec<[f32; 3]>,
    /// The fans of each triangle's corners.
    pub triangles: Vec<[u32; 3]>,
}

impl Fans {
    /// The fans of a mesh, in time that grows with its size, and 24 bytes a triangle beside the result.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidInput`] if the mesh has more than 2^32 corners.
    pub fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]], creases: Creases) -> io::Result<Self> {
        if u32::try_from(triangles.len() * 3).is_err() {
            let what = "normals are for at most 2^32 corners of triangles; add --normals none";
            return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
        }
        let (start, corners) = corners_of_vertices(positions.len(), triangles);
        // The fan of each corner: a number within its chunk of vertices, until it is known how many fans other chunks
        // have.
        let fan_of: Vec<[AtomicU32; 3]> = (0..triangles.len()).into_par_iter().map(|_| Default::default()).collect();
        let chunk = |first: usize| {
            let (mut around, mut fans) = (Around::default(), vec![]);
            for vertex in first..(first + CHUNK).min(positions.len()) {
                let own = &corners[start[vertex] as usize..start[vertex + 1] as usize];
                around.fill(own, positions, triangles);
                let before = fans.len() as u32;
                around.join(creases);
                around.sum(|normal| fans.push((vertex as u32, normal)));
                for (&corner, &fan) in own.iter().zip(&around.fan_of) {
                    fan_of[corner as usize / 3][corner as usize % 3].store(before + fan, Relaxed);
                }
            }
            fans
        };
        let chunks: Vec<Vec<(u32, [f32; 3])>> =
            (0..positions.len().div_ceil(CHUNK)).into_par_iter().map(|number| chunk(number * CHUNK)).collect();
        drop((start, corners));
        let mut first_of = vec![0u32];
        first_of.extend(chunks.iter().scan(0, |sum, chunk| {
            *sum += chunk.len() as u32;
            Some(*sum)
        }));
        let global = |(fans, vertices): ([AtomicU32; 3], &[u32; 3])| {
            let mut vertices = vertices.iter();
            fans.map(|fan| fan.into_inner() + vertices.next().map_or(0, |&v| first_of[v as usize / CHUNK]))
        };
        let (vertices, normals) = chunks.into_iter().flatten().unzip();
        Ok(Self { vertices, normals, triangles: fan_of.into_par_iter().zip(triangles).map(global).collect() })
    }
}

/// The corners of each vertex, ascending: where they begin, and their numbers. Corner `3 t + k` is corner `k` of
/// triangle `t`.
fn corners_of_vertices(vertex_count: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<u32>) {
    let mut start = vec![0u32; vertex_count + 1];
    triangles.iter().flatten().for_each(|&v| start[v as usize + 1] += 1);
    for v in 0..vertex_count {
        start[v + 1] += start[v];
    }
    let (mut slot, mut corners) = (start.clone(), vec![0; triangles.len() * 3]);
    for (corner, &v) in (0..).zip(triangles.iter().flatten()) {
        corners[slot[v as usize] as usize] = corner;
        slot[v as usize] += 1;
    }
    (start, corners)
}

/// The corners around one vertex. It is filled again and again, so that nothing is allocated for each.
#[derive(Default)]
struct Around {
    /// Of each triangle: its normal, or zero if it has none, and its weight.
    normals: Vec<(DVec3, f64)>,
    /// Lengths of the two edges of each triangle that end at the vertex.
    lengths: Vec<[f64; 2]>,
    /// Edges that end at the vertex: the other end, whether the triangle's border runs there from here, and the
    /// corner's place.
    edges: Vec<(u32, bool, u32)>,
    /// The fan of each corner.
    fan_of: Vec<u32>,
    /// The sum of a fan, of its weights, and its first normal.
    sums: Vec<(DVec3, f64, DVec3)>,
}

impl Around {
    fn fill(&mut self, corners: &[u32], positions: &[[f64; 3]], triangles: &[[u32; 3]]) {
        self.normals.clear();
        self.lengths.clear();
        self.edges.clear();
        for (place, &corner) in (0..).zip(corners) {
            let (triangle, k) = (triangles[corner as usize / 3], corner as usize % 3);
            let [next, previous] = [1, 2].map(|step| triangle[(k + step) % 3]);
            let (normal, sine, lengths) = normal_of(triangle.map(|v| DVec3::from(positions[v as usize])), k);
            self.normals.push((normal, sine));
            self.lengths.push(lengths);
            // What has no normal takes no part.
            if normal != DVec3::ZERO {
                self.edges.extend([(next, true, place), (previous, false, place)]);
            }
        }
        // Areas count in squares of the longest edge, so that none is too large.
        let longest = self.lengths.iter().flatten().fold(0.0, |a: f64, &b| a.max(b));
        for ((normal, weight), lengths) in self.normals.iter_mut().zip(&self.lengths) {
            if *normal != DVec3::ZERO {
                *weight *= lengths[0] / longest * (lengths[1] / longest);
            }
        }
    }

    /// Makes fans of all corners that are joined by edges that are no creases. Each has the number of its first corner.
    fn join(&mut self, creases: Creases) {
        self.fan_of.clear();
        if creases == Creases::Smoothed {
            let first = self.normals.iter().position(|(normal, _)| *normal != DVec3::ZERO);
            self.fan_of.resize(self.normals.len(), first.unwrap_or(0) as u32);
            return;
        }
        self.fan_of.extend(0..self.normals.len() as u32);
        self.edges.sort_unstable();
        for edge in self.edges.chunk_by(|a, b| a.0 == b.0) {
            let &[(_, false, a), (_, true, b)] = edge else { continue };
            if self.normals[a as usize].0.dot(self.normals[b as usize].0) > CREASE {
                let [a, b] = [a, b].map(|corner| root(&mut self.fan_of, corner));
                self.fan_of[a.max(b) as usize] = a.min(b);
            }
        }
        for corner in 0..self.fan_of.len() as u32 {
            self.fan_of[corner as usize] = root(&mut self.fan_of, corner);
        }
    }

    /// Numbers the fans in the order of their first corners, from 0 on, and passes their normals on.
    fn sum(&mut self, mut found: impl FnMut([f32; 3])) {
        self.sums.clear();
        for (corner, &(normal, own)) in self.normals.iter().enumerate() {
            let first = self.fan_of[corner] as usize;
            if normal == DVec3::ZERO {
                // Nobody sees this triangle: the first fan will do.
                self.fan_of[corner] = 0;
                continue;
            }
            if first == corner {
                self.fan_of[corner] = self.sums.len() as u32;
                self.sums.push((DVec3::ZERO, 0.0, normal));
            } else {
                self.fan_of[corner] = self.fan_of[first];
            }
            let (sum, weight, _) = &mut self.sums[self.fan_of[corner] as usize];
            (*sum, *weight) = (*sum + normal * own, *weight + own);
        }
        if self.sums.is_empty() {
            self.sums.push((UP, 1.0, UP));
        }
        for &(sum, weight, first) in &self.sums {
            let length = sum.length();
            let normal = if length > TINY * weight { sum / length } else { first };
            found(normal.to_array().map(|x| x as f32));
        }
    }
}

/// The first corner of a corner's fan.
fn root(fan_of: &mut [u32], mut corner: u32) -> u32 {
    while fan_of[corner as usize] != corner {
        fan_of[corner as usize] = fan_of[fan_of[corner as usize] as usize];
        corner = fan_of[corner as usize];
    }
    corner
}

/// The normal of a triangle, or zero if it has none, the sine at one of its corners, and the lengths of the edges that
/// end there.
fn normal_of([a, b, c]: [DVec3; 3], corner: usize) -> (DVec3, f64, [f64; 2]) {
    let ways = [way(a, b), way(b, c), way(c, a)];
    let [(p, _), (q, _), (r, _)] = ways;
    // As long as the sum of the sines: also of a needle, whose sharp corner alone would tell little.
    let sum = p.cross(q) + q.cross(r) + r.cross(p);
    let length = sum.length();
    let normal = if length > TINY { sum / length } else { DVec3::ZERO };
    let [(next, to_next), (previous, from_previous)] = [ways[corner], ways[(corner + 2) % 3]];
    (normal, next.cross(previous).length(), [to_next, from_previous])
}

/// Direction and length of the way from one point to another. The direction is zero if they are the same. Neither
/// squares nor differences leave the range of numbers.
fn way(from: DVec3, to: DVec3) -> (DVec3, f64) {
    let (mut way, mut unit) = (to - from, 1.0);
    if !way.is_finite() {
        (way, unit) = (to * 0.5 - from * 0.5, 2.0);
    }
    let most = way.abs().max_element();
    if most == 0.0 {
        return (DVec3::ZERO, 0.0);
    }
    let scaled = way / most;
    let length = scaled.length();
    (scaled / length, (most * length * unit).min(f64::MAX))
}

#[cfg(test)]
#[expect(clippy::disallowed_methods, reason = "tests make shapes, whose last bits do not matter")]
mod tests {
    use super::*;

    const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

    fn cube(scale: f64) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let corner = |bits: u32| [0, 1, 2].map(|axis| (f64::from(bits >> axis & 1) * 2.0 - 1.0) * scale);
        ((0..8).map(corner).collect(), CUBE.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
    }

    /// A square of `n` by `n` quads, of which each vertex is moved to the unit sphere.
    fn part_of_a_sphere(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let place = |k: u32| f64::from(k) / f64::from(n) - 0.5;
        let all = |size: u32| (0..size).flat_map(move |y| (0..size).map(move |x| [x, y]));
        let positions = all(n + 1).map(|[x, y]| DVec3::new(place(x), place(y), 1.0).normalize().to_array());
        let quads = all(n).map(|[x, y]| [y * (n + 1) + x, (y + 1) * (n + 1) + x]);
        let triangles = quads.flat_map(|[a, d]| [[a, a + 1, d + 1], [a, d + 1, d]]);
        (positions.collect(), triangles.collect())
    }

    fn fans(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Fans {
        let fans = Fans::new(positions, triangles, Creases::Kept).unwrap();
        let length = |normal: &[f32; 3]| DVec3::from(normal.map(f64::from)).length();
        assert!(fans.normals.iter().all(|normal| (length(normal) - 1.0).abs() < 1e-6), "{:?}", fans.normals);
        let of = |fan: &[u32; 3]| fan.map(|fan| fans.vertices[fan as usize]);
        assert_eq!(fans.triangles.iter().map(of).collect::<Vec<_>>(), triangles);
        fans
    }

    /// Two triangles that share an edge, folded by an angle in degrees.
    fn fold(degrees: f64) -> Fans {
        let (sin, cos) = degrees.to_radians().sin_cos();
        fans(&[[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [cos, 0.0, -sin]], &[[0, 1, 2], [1, 0, 3]])
    }

    #[test]
    fn a_cube_of_any_size_keeps_three_normals_a_corner() {
        for scale in [1e-320, 1e-300, 1.0, 1e300, 1e308] {
            let (positions, triangles) = cube(scale);
            let fans = fans(&positions, &triangles);
            assert_eq!(fans.normals.len(), 24);
            assert!(fans.normals.iter().flatten().all(|x| [0.0, 1.0].contains(&x.abs())), "{:?}", fans.normals);
            // One or two triangles of each side end at a corner.
            let whole = Fans::new(&positions, &triangles, Creases::Smoothed).unwrap();
            assert_eq!((whole.vertices, whole.triangles), ((0..8).collect(), triangles));
            assert!(whole.normals.iter().flatten().all(|x| (0.3..0.9).contains(&x.abs())), "{:?}", whole.normals);
        }
    }

    #[test]
    fn a_fold_is_a_crease_from_its_angle_on() {
        let degrees = CREASE.acos().to_degrees();
        assert_eq!([degrees - 0.1, degrees + 0.1].map(|degrees| fold(degrees).normals.len()), [4, 6]);
        assert_eq!([180.0, 179.0].map(|degrees| fold(degrees).normals.len()), [6, 6]);
        let [shared, _, alone, _] = fold(20.0).normals[..] else { unreachable!() };
        assert!((f64::from(shared[0]) - 10.0_f64.to_radians().sin()).abs() < 1e-6 && alone == [0.0, 0.0, 1.0]);
    }

    #[test]
    fn a_sphere_is_smooth_and_the_same_on_any_number_of_threads() {
        let (positions, triangles) = part_of_a_sphere(100);
        assert!(positions.len() > CHUNK, "several chunks");
        let all = fans(&positions, &triangles);
        assert_eq!(all.normals.len(), positions.len());
        for (&vertex, normal) in all.vertices.iter().zip(&all.normals) {
            let degrees =
                DVec3::from(positions[vertex as usize]).angle_between(DVec3::from(normal.map(f64::from))).to_degrees();
            assert!(degrees < 1.0, "{degrees}");
        }
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            assert!(pool.install(|| fans(&positions, &triangles)) == all);
        }
    }

    #[test]
    fn what_has_no_area_changes_nothing_and_has_normals() {
        let (mut positions, mut triangles) = cube(1.0);
        let sound = fans(&positions, &triangles);
        // On an edge, in a point, on a line in space, and a vertex of no triangle.
        positions.extend([[-1.0, -1.0, 0.0], [9.0, 0.0, 0.0], [9.0, 1.0, 0.0], [9.0, 2.0, 0.0], [7.0; 3]]);
        triangles.extend([[0, 8, 4], [3, 3, 3], [5, 5, 7], [9, 10, 11]]);
        let fans = fans(&positions, &triangles);
        assert_eq!(fans.normals[..24], sound.normals);
        assert_eq!(fans.normals[24..], [[0.0, 0.0, 1.0]; 5]);
    }

    #[test]
    fn more_or_fewer_than_two_triangles_at_an_edge_are_not_joined() {
        let points = [[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.1]];
        // A third one, one that is turned around, and the same one on its back.
        assert_eq!(fans(&points, &[[0, 1, 2], [1, 0, 3], [1, 0, 4]]).normals.len(), 9);
        assert_eq!(fans(&points[..4], &[[0, 1, 2], [0, 1, 3]]).normals.len(), 6);
        assert_eq!(fans(&points[..3], &[[0, 1, 2], [1, 0, 2]]).normals.len(), 6);
    }
}
