//! What a region shows of itself to the others: its boundary edges.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use lodpack_mesh::{Adjacency, Mesh, NONE, next_half_edge};

/// A position as its bits, so that it can be compared and sorted; 0.0 and -0.0 are the same.
pub(super) type PositionKey = [u64; 3];

/// A half-edge with nothing on its other side within the region.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BoundaryEdge {
    /// In the region's mesh.
    pub half_edge: u32,
    /// From and to, in the region's mesh.
    pub vertices: [u32; 2],
    /// Positions of both.
    pub positions: [DVec3; 2],
    /// Unit normal of the triangle, zero where it has none.
    pub normal: DVec3,
    /// The connected component of the region to which the triangle belongs.
    pub component: u32,
    /// Its object, or 0: edges of different objects are different edges.
    pub object: u32,
    /// Index of the next edge along the same boundary.
    pub next: u32,
}

/// The boundary of a region's repaired mesh.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RegionBoundary {
    /// All boundary half-edges, ascending. Every boundary vertex is the first vertex of exactly one.
    pub edges: Vec<BoundaryEdge>,
    /// Twice the area of each connected component.
    pub component_areas: Vec<f64>,
    /// Smallest and largest coordinates of the region's vertices.
    pub bounds: [DVec3; 2],
}

impl BoundaryEdge {
    pub(super) fn key(&self) -> [PositionKey; 2] {
        let [a, b] = self.positions.map(|p| (p + DVec3::ZERO).to_array().map(f64::to_bits));
        [a.min(b), a.max(b)]
    }
}

impl RegionBoundary {
    /// Collects the boundary of a repaired mesh. `components` is the component of each triangle, and `objects` the
    /// object of each; empty if there are none.
    pub fn new(mesh: &Mesh, adjacency: &Adjacency, components: &[u32], objects: &[u32]) -> Self {
        let half_edges: Vec<u32> =
            (0..).zip(&adjacency.opposite).filter(|&(_, &opposite)| opposite == NONE).map(|(h, _)| h).collect();
        let origin = |h: u32| mesh.triangles[h as usize / 3][h as usize % 3];
        let mut leaving: Vec<(u32, u32)> = half_edges.iter().zip(0..).map(|(&h, index)| (origin(h), index)).collect();
        leaving.sort_unstable();
        let edge = |&half_edge: &u32| {
            let vertices = [origin(half_edge), origin(next_half_edge(half_edge))];
            let index = leaving.partition_point(|entry| entry.0 < vertices[1]);
            BoundaryEdge {
                half_edge,
                vertices,
                positions: vertices.map(|v| mesh.positions[v as usize]),
                normal: mesh.doubled_area(half_edge / 3).normalize_or_zero(),
                component: components[half_edge as usize / 3],
                object: objects.get(half_edge as usize / 3).copied().unwrap_or(0),
                // Every vertex has one fan, so one boundary edge leaves each end.
                next: leaving.get(index).map_or(0, |entry| entry.1),
            }
        };
        let mut component_areas = vec![0.0; components.iter().max().map_or(0, |&last| last as usize + 1)];
        for (t, &component) in (0..).zip(components) {
            component_areas[component as usize] += mesh.doubled_area(t).length();
        }
        Self { edges: half_edges.iter().map(edge).collect(), component_areas, bounds: mesh.bounds() }
    }

    /// Whether the region's bounds allow it a triangle at an edge.
    pub(super) fn can_touch(&self, edge: &BoundaryEdge) -> bool {
        let [low, high] = self.bounds;
        edge.positions.iter().all(|p| p.cmpge(low).all() && p.cmple(high).all())
    }
}

/// The connected component of each triangle. Components are numbered in the order of their first triangles.
pub fn components(adjacency: &Adjacency) -> Vec<u32> {
    let mut component = vec![NONE; adjacency.opposite.len() / 3];
    let (mut count, mut pending) = (0, vec![]);
    for seed in 0..component.len() as u32 {
        if component[seed as usize] != NONE {
            continue;
        }
        component[seed as usize] = count;
        pending.push(seed);
        while let Some(t) = pending.pop() {
            for &opposite in &adjacency.opposite[3 * t as usize..3 * t as usize + 3] {
                if opposite != NONE && component[opposite as usize / 3] == NONE {
                    component[opposite as usize / 3] = count;
                    pending.push(opposite / 3);
                }
            }
        }
        count += 1;
    }
    component
}

/// Reverses the triangles of some connected components, [a, b, c] to [a, c, b].
pub fn reverse_components(mesh: &mut Mesh, adjacency: &mut Adjacency, components: &[u32], reversed: &[bool]) {
    let is_reversed = |half_edge: u32| reversed[components[half_edge as usize / 3] as usize];
    for (t, triangle) in mesh.triangles.iter_mut().enumerate() {
        let opposite = &mut adjacency.opposite[3 * t..3 * t + 3];
        opposite.iter_mut().filter(|h| **h != NONE && is_reversed(**h)).for_each(|h| *h = renumbered(*h));
        if is_reversed(3 * t as u32) {
            triangle.swap(1, 2);
            opposite.swap(0, 2);
        }
    }
}

/// The number that a half-edge has once its triangle is reversed.
fn renumbered(half_edge: u32) -> u32 {
    half_edge - half_edge % 3 + (2 - half_edge % 3)
}

impl RegionBoundary {
    /// For each edge the index of the one before it along the same boundary.
    pub(super) fn previous(&self) -> Vec<u32> {
        let mut previous = vec![0; self.edges.len()];
        self.edges.iter().zip(0..).for_each(|(edge, index)| previous[edge.next as usize] = index);
        previous
    }

    /// Makes this the boundary of the mesh after [`reverse_components`].
    pub fn reverse(&mut self, reversed: &[bool]) {
        let before = self.previous();
        for (edge, before) in self.edges.iter_mut().zip(before) {
            if reversed[edge.component as usize] {
                edge.half_edge = renumbered(edge.half_edge);
                edge.vertices.swap(0, 1);
                edge.positions.swap(0, 1);
                edge.normal = -edge.normal;
                edge.next = before;
            }
        }
    }
}
