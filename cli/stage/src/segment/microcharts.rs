//! Microcharts of about 64 triangles each, and the graph of them on which Lloyd rounds run.

use super::SegmentOptions;
use super::geometry::{Facet, Normaliser, bend, creaseness, relative_distance};
use glam::DVec3;
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;
use rayon::prelude::*;

/// Triangles in a full microchart.
const MICROCHART_SIZE: usize = 64;
/// A microchart with fewer triangles than this grows across creases rather than stay so small.
const MICROCHART_SIZE_AT_CREASE: usize = 16;
/// Triangles per task. The number is fixed so that nothing depends on the number of threads.
const BLOCK: usize = 1 << 17;

/// Sums over the triangles of a microchart.
#[derive(Clone, Copy, Default)]
pub(super) struct Microchart {
    /// Area-weighted, in normalised coordinates.
    pub centroid: DVec3,
    /// Sum of the triangles' area vectors.
    pub area_vector: DVec3,
    pub area: f64,
    /// Number of triangles.
    pub count: u32,
    /// Its first triangle.
    pub first: u32,
}

pub(super) struct Microcharts {
    /// Microchart of each triangle; [`NONE`] for triangles that are not wanted.
    pub of_triangle: Vec<u32>,
    pub all: Vec<Microchart>,
}

/// The neighbours of microchart `c` are `edges[start[c]..start[c + 1]]`, each with its distance in triangle sizes.
pub(super) struct MicrochartGraph {
    pub start: Vec<u32>,
    pub edges: Vec<(u32, f32)>,
}

impl MicrochartGraph {
    pub fn neighbours(&self, microchart: u32) -> &[(u32, f32)] {
        &self.edges[self.start[microchart as usize] as usize..self.start[microchart as usize + 1] as usize]
    }
}

/// Floods microcharts over the triangles for which `wanted` holds, block by block in parallel. If the order of the
/// triangles has so little locality that blocks yield only scraps, floods once more over the whole mesh.
pub(super) fn build_microcharts(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    wanted: impl Fn(u32) -> bool + Sync,
) -> Microcharts {
    let microcharts = flood_blocks(mesh, adjacency, normaliser, &wanted, BLOCK);
    let triangle_count: usize = microcharts.all.iter().map(|c| c.count as usize).sum();
    if microcharts.all.len() * 12 > triangle_count && mesh.triangles.len() > BLOCK {
        return flood_blocks(mesh, adjacency, normaliser, &wanted, mesh.triangles.len());
    }
    microcharts
}

fn flood_blocks(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    wanted: &(impl Fn(u32) -> bool + Sync),
    block_size: usize,
) -> Microcharts {
    let _all = trace::even("floods");
    let mut of_triangle = vec![NONE; mesh.triangles.len()];
    let blocks: Vec<Vec<Microchart>> = of_triangle
        .par_chunks_mut(block_size)
        .enumerate()
        .map(|(block, slots)| flood_block(mesh, adjacency, normaliser, wanted, (block * block_size) as u32, slots))
        .collect();
    let mut offset = 0;
    let offsets: Vec<u32> = blocks
        .iter()
        .map(|block| {
            offset += block.len() as u32;
            offset - block.len() as u32
        })
        .collect();
    of_triangle.par_chunks_mut(block_size).zip(offsets).for_each(|(slots, offset)| {
        for slot in slots.iter_mut().filter(|slot| **slot != NONE) {
            *slot += offset;
        }
    });
    Microcharts { of_triangle, all: blocks.concat() }
}

/// Breadth-first floods inside the block of triangles that starts at `first`. They stop at creases if they can.
fn flood_block(
    mesh: &Mesh,
    adjacency: &Adjacency,
    normaliser: &Normaliser,
    wanted: &impl Fn(u32) -> bool,
    first: u32,
    slots: &mut [u32],
) -> Vec<Microchart> {
    let facets: Vec<Facet> = (0..slots.len() as u32).map(|i| normaliser.facet(mesh, first + i)).collect();
    let mut microcharts = Vec::new();
    let mut members: Vec<u32> = Vec::with_capacity(MICROCHART_SIZE);
    let mut beyond_creases: Vec<u32> = Vec::new();
    for seed in 0..slots.len() as u32 {
        if slots[seed as usize] != NONE || !wanted(first + seed) {
            continue;
        }
        let id = microcharts.len() as u32;
        members.clear();
        beyond_creases.clear();
        members.push(seed);
        slots[seed as usize] = id;
        let mut head = 0;
        while members.len() < MICROCHART_SIZE {
            if head == members.len() {
                if members.len() >= MICROCHART_SIZE_AT_CREASE {
                    break;
                }
                let Some(i) = beyond_creases.pop() else { break };
                if slots[i as usize] == NONE {
                    slots[i as usize] = id;
                    members.push(i);
                }
                continue;
            }
            let i = members[head];
            head += 1;
            let h = 3 * (first + i) as usize;
            for &opposite in &adjacency.opposite[h..h + 3] {
                // Triangles before the block wrap around to large numbers.
                let j = (opposite / 3).wrapping_sub(first);
                if opposite == NONE || j as usize >= slots.len() || slots[j as usize] != NONE {
                    continue;
                }
                if is_crease(&facets[i as usize], &facets[j as usize]) {
                    beyond_creases.push(j);
                } else if members.len() < MICROCHART_SIZE {
                    slots[j as usize] = id;
                    members.push(j);
                }
            }
        }
        microcharts.push(sum_up(&facets, &members, first + seed));
    }
    microcharts
}

/// Whether two triangles meet at more than about 45 degrees; avoids the square roots of [`bend`].
fn is_crease(a: &Facet, b: &Facet) -> bool {
    a.area_vector.dot(b.area_vector) < 0.7 * a.area * b.area
}

fn sum_up(facets: &[Facet], members: &[u32], first: u32) -> Microchart {
    let mut sum = Microchart { count: members.len() as u32, first, ..Microchart::default() };
    let mut plain = DVec3::ZERO;
    for facet in members.iter().map(|&i| &facets[i as usize]) {
        sum.centroid += facet.centroid * facet.area;
        plain += facet.centroid;
        sum.area_vector += facet.area_vector;
        sum.area += facet.area;
    }
    let weighted = sum.centroid / sum.area;
    sum.centroid = if weighted.is_finite() { weighted } else { plain / f64::from(sum.count) };
    sum
}

/// Connects microcharts that share an edge. A bend of the surface between them lengthens their distance.
pub(super) fn build_graph(
    adjacency: &Adjacency,
    microcharts: &Microcharts,
    options: &SegmentOptions,
) -> MicrochartGraph {
    let of_triangle = &microcharts.of_triangle;
    let of_all = trace::even("pairs");
    let mut pairs: Vec<u64> = of_triangle
        .par_chunks(BLOCK)
        .enumerate()
        .flat_map_iter(|(block, chunk)| {
            let mut pairs = Vec::with_capacity(chunk.len() / 4);
            for (i, &a) in chunk.iter().enumerate() {
                let h = 3 * (block * BLOCK + i);
                for &opposite in &adjacency.opposite[h..h + 3] {
                    if opposite != NONE {
                        let b = of_triangle[opposite as usize / 3];
                        if a < b {
                            pairs.push(u64::from(a) << 32 | u64::from(b));
                        }
                    }
                }
            }
            pairs.sort_unstable();
            pairs.dedup();
            pairs
        })
        .collect();
    pairs.par_sort_unstable();
    drop(of_all);
    pairs.dedup();

    let mut start = vec![0u32; microcharts.all.len() + 1];
    for &pair in &pairs {
        start[(pair >> 32) as usize + 1] += 1;
        start[pair as u32 as usize + 1] += 1;
    }
    for c in 0..microcharts.all.len() {
        start[c + 1] += start[c];
    }
    let mut slot = start.clone();
    let mut edges = vec![(0, 0.0); 2 * pairs.len()];
    for &pair in &pairs {
        let (a, b) = ((pair >> 32) as u32, pair as u32);
        let (x, y) = (&microcharts.all[a as usize], &microcharts.all[b as usize]);
        let size = |c: &Microchart| (c.area / f64::from(c.count)).sqrt();
        let distance = relative_distance(x.centroid.distance(y.centroid), size(x), size(y));
        let crease = creaseness(bend(x.area_vector, y.area_vector));
        let weight = (distance * (1.0 + 0.5 * options.crease_weight * crease)) as f32;
        for (from, to) in [(a, b), (b, a)] {
            edges[slot[from as usize] as usize] = (to, weight);
            slot[from as usize] += 1;
        }
    }
    MicrochartGraph { start, edges }
}
