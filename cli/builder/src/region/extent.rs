//! The size and smoothness of regions, from which the lengths of a build and the size of its charts are derived.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::Thickness;
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;
use lodpack_stage::subdivide::Subdivided;

/// Size and smoothness of the repaired input, as sums over its regions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Extent {
    /// Smallest and largest coordinates.
    pub bounds: [DVec3; 2],
    /// Triangles.
    pub triangles: u64,
    /// Vertices. Those on seams count once for each region.
    pub vertices: u64,
    /// How many of these triangles there are because others were divided, which had too many texels. What follows is of
    /// those before.
    pub added_triangles: u64,
    /// And how many of the vertices.
    pub added_vertices: u64,
    /// Texels of images that triangles show.
    pub texels: f64,
    /// Sum over the sides of all triangles.
    pub edge_lengths: f64,
    /// Area.
    pub area: f64,
    /// Edges with two triangles. Those on seams count for no region.
    pub inner_edges: u64,
    /// Sum over these edges of the distance between the unit normals of the two triangles: twice the sine of half their
    /// angle.
    pub bends: f64,
    /// How thick the closed components are. Those that several regions share are large, and do not count.
    pub thickness: Thickness,
}

impl Extent {
    /// Measures a mesh, given its number of components.
    pub fn of(mesh: &Mesh, adjacency: &Adjacency, component_count: u64) -> Self {
        let bent = || {
            let _pass = trace::pass("bends");
            let (mut doubled, mut inner_edges, mut bends) = (0.0, 0, 0.0);
            let normals: Vec<DVec3> = (0..mesh.triangles.len() as u32)
                .map(|t| {
                    let area = mesh.doubled_area(t);
                    doubled += area.length();
                    area.normalize_or_zero()
                })
                .collect();
            for (t, opposite) in (0..).zip(adjacency.opposite.as_chunks::<3>().0) {
                // Each edge once.
                for &other in opposite.iter().filter(|&&other| other != NONE && other / 3 > t) {
                    inner_edges += 1;
                    bends += normals[t as usize].distance(normals[other as usize / 3]);
                }
            }
            (doubled, inner_edges, bends)
        };
        let thick = || {
            let _pass = trace::pass("thickness");
            Thickness::of(mesh, adjacency, component_count)
        };
        let long = || {
            let _pass = trace::pass("lengths");
            (mesh.edge_lengths(), mesh.bounds())
        };
        let of_all = trace::parallel("extent");
        let ((doubled, inner_edges, bends), (thickness, (edge_lengths, bounds))) =
            rayon::join(bent, || rayon::join(thick, long));
        drop(of_all);
        Self {
            bounds,
            triangles: mesh.triangles.len() as u64,
            vertices: mesh.positions.len() as u64,
            added_triangles: 0,
            added_vertices: 0,
            texels: 0.0,
            edge_lengths,
            area: doubled * 0.5,
            inner_edges,
            bends,
            thickness,
        }
    }

    /// Notes what was added since, and what triangles show.
    pub fn add(&mut self, Subdivided { triangles, vertices, texels }: Subdivided) {
        (self.triangles, self.vertices) = (self.triangles + triangles, self.vertices + vertices);
        (self.added_triangles, self.added_vertices, self.texels) = (triangles, vertices, texels);
    }

    /// The extent of both together.
    pub fn plus(self, other: Self) -> Self {
        let ([low, high], [other_low, other_high]) = (self.bounds, other.bounds);
        Self {
            bounds: [low.min(other_low), high.max(other_high)],
            triangles: self.triangles + other.triangles,
            vertices: self.vertices + other.vertices,
            added_triangles: self.added_triangles + other.added_triangles,
            added_vertices: self.added_vertices + other.added_vertices,
            texels: self.texels + other.texels,
            edge_lengths: self.edge_lengths + other.edge_lengths,
            area: self.area + other.area,
            inner_edges: self.inner_edges + other.inner_edges,
            bends: self.bends + other.bends,
            thickness: self.thickness.plus(other.thickness),
        }
    }

    /// Triangles before any was divided.
    pub fn undivided_triangles(&self) -> u64 {
        self.triangles - self.added_triangles
    }

    /// Mean length of the triangles' edges, each side of each triangle counted once.
    pub fn mean_edge_length(&self) -> f64 {
        self.edge_lengths / (3 * self.undivided_triangles()).max(1) as f64
    }

    /// How much the surface bends from a triangle to the next: the mean distance of their unit normals (0 to 2).
    pub fn mean_bend(&self) -> f64 {
        self.bends / self.inner_edges.max(1) as f64
    }
}
