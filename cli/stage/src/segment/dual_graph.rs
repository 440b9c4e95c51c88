//! The dual graph of one chart: its triangles, and which of them share an edge. The cuts through a chart work on it.

use super::geometry::Normaliser;
use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Some triangles of the mesh, and their neighbours among themselves.
pub(super) struct DualGraph {
    /// Mesh triangles, ascending.
    pub triangles: Vec<u32>,
    /// The half-edge on the other side in local numbers (3 x local triangle + corner); [`NONE`] on the border.
    pub opposite: Vec<u32>,
}

/// A loop of the chart's border.
pub(super) struct BorderLoop {
    /// Local triangles along the loop.
    pub triangles: Vec<u32>,
    pub length: f64,
}

/// Steps that a breadth-first search took to each triangle, and the triangle it came from.
pub(super) struct Distances {
    pub steps: Vec<u32>,
    pub from: Vec<u32>,
    /// The triangle reached last, which is one of the farthest.
    pub farthest: u32,
}

impl DualGraph {
    pub fn new(adjacency: &Adjacency, triangles: Vec<u32>) -> Self {
        let opposite = triangles
            .iter()
            .flat_map(|&t| [3 * t, 3 * t + 1, 3 * t + 2])
            .map(|h| match adjacency.opposite[h as usize] {
                NONE => NONE,
                o => triangles.binary_search(&(o / 3)).map_or(NONE, |i| 3 * i as u32 + o % 3),
            })
            .collect();
        Self { triangles, opposite }
    }

    pub fn neighbours(&self, t: u32) -> impl Iterator<Item = u32> + '_ {
        self.opposite[3 * t as usize..3 * t as usize + 3].iter().filter(|&&o| o != NONE).map(|&o| o / 3)
    }

    /// Border loops, the longest first.
    pub fn loops(&self, mesh: &Mesh, normaliser: &Normaliser) -> Vec<BorderLoop> {
        let mut seen = vec![false; self.opposite.len()];
        let mut loops = Vec::new();
        for start in 0..self.opposite.len() as u32 {
            if self.opposite[start as usize] != NONE || seen[start as usize] {
                continue;
            }
            let mut around = BorderLoop { triangles: Vec::new(), length: 0.0 };
            let mut h = start;
            while !seen[h as usize] {
                seen[h as usize] = true;
                around.triangles.push(h / 3);
                around.length += normaliser.edge_length(mesh, 3 * self.triangles[h as usize / 3] + h % 3);
                h = next_half_edge(h);
                while self.opposite[h as usize] != NONE {
                    h = next_half_edge(self.opposite[h as usize]);
                }
            }
            loops.push(around);
        }
        loops.sort_by(|a, b| b.length.total_cmp(&a.length));
        loops
    }

    pub fn distances(&self, sources: &[u32]) -> Distances {
        let mut steps = vec![NONE; self.triangles.len()];
        let mut from = vec![NONE; self.triangles.len()];
        let mut queue = Vec::with_capacity(self.triangles.len());
        for &s in sources {
            if steps[s as usize] == NONE {
                steps[s as usize] = 0;
                queue.push(s);
            }
        }
        let mut head = 0;
        while head < queue.len() {
            let t = queue[head];
            head += 1;
            for n in self.neighbours(t) {
                if steps[n as usize] == NONE {
                    steps[n as usize] = steps[t as usize] + 1;
                    from[n as usize] = t;
                    queue.push(n);
                }
            }
        }
        Distances { steps, from, farthest: queue.last().copied().unwrap_or(0) }
    }

    /// Divides the triangles in two halves, each nearer to one of two triangles that are as far apart as possible.
    pub fn halve(&self) -> [Vec<u32>; 2] {
        let a = self.distances(&[0]).farthest;
        let b = self.distances(&[a]).farthest;
        self.nearer_to(&[a], &[b])
    }

    /// Cuts a chart with two border loops, which is a ring, into two strips from loop to loop: one along the shortest
    /// path between the loops, the other along the path that keeps farthest from it. Returns none if the second would
    /// be a sliver.
    pub fn halve_ring(&self, a: &BorderLoop, b: &BorderLoop) -> Option<[Vec<u32>; 2]> {
        let from_b = self.distances(&b.triangles);
        let end = *a.triangles.iter().min_by_key(|&&t| from_b.steps[t as usize])?;
        let short_path = path(&from_b.from, end);
        let from_path = self.distances(&short_path);
        let wide_path = self.widest_path(&b.triangles, &a.triangles, &from_path.steps)?;
        Some(self.nearer_to(&short_path, &wide_path))
    }

    /// The path between two sets of triangles whose smallest `clearance` is largest; none if that is under 4.
    fn widest_path(&self, sources: &[u32], ends: &[u32], clearance: &[u32]) -> Option<Vec<u32>> {
        const LEAST_CLEARANCE: u32 = 4;
        let mut is_end = vec![false; self.triangles.len()];
        for &t in ends {
            is_end[t as usize] = true;
        }
        let mut from = vec![NONE; self.triangles.len()];
        let mut seen = vec![false; self.triangles.len()];
        // Widest first, then fewest steps, then the smallest triangle.
        let mut heap = BinaryHeap::new();
        for &t in sources {
            heap.push((clearance[t as usize], Reverse((0, t, NONE))));
        }
        while let Some((width, Reverse((steps, t, previous)))) = heap.pop() {
            if seen[t as usize] {
                continue;
            }
            seen[t as usize] = true;
            from[t as usize] = previous;
            if width < LEAST_CLEARANCE {
                return None;
            }
            if is_end[t as usize] {
                return Some(path(&from, t));
            }
            for n in self.neighbours(t).filter(|&n| !seen[n as usize]) {
                heap.push((width.min(clearance[n as usize]), Reverse((steps + 1, n, t))));
            }
        }
        None
    }

    /// The mesh triangles nearer to `a` than to `b`, and the others.
    fn nearer_to(&self, a: &[u32], b: &[u32]) -> [Vec<u32>; 2] {
        let mut side = vec![2u8; self.triangles.len()];
        let mut queue = Vec::with_capacity(self.triangles.len());
        for (sources, s) in [(a, 0), (b, 1)] {
            for &t in sources {
                if side[t as usize] == 2 {
                    side[t as usize] = s;
                    queue.push(t);
                }
            }
        }
        let mut head = 0;
        while head < queue.len() {
            let t = queue[head];
            head += 1;
            for n in self.neighbours(t) {
                if side[n as usize] == 2 {
                    side[n as usize] = side[t as usize];
                    queue.push(n);
                }
            }
        }
        [0, 1].map(|s| self.triangles.iter().zip(&side).filter(|(_, side)| **side == s).map(|(&t, _)| t).collect())
    }
}

fn path(from: &[u32], end: u32) -> Vec<u32> {
    std::iter::successors(Some(end), |&t| Some(from[t as usize]).filter(|&t| t != NONE)).collect()
}
