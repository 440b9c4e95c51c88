//! Repair: turns any triangle soup into an oriented manifold with boundary, and counts every change.
//!
//! Later stages may assume that every edge has one or two triangles, wound consistently; that every vertex has exactly
//! one fan of triangles; and that every vertex is used. The remaining triangles keep their order and positions never
//! change. The result depends on the input alone.
//!
//! Non-manifold edges and vertices are cut, not deleted (Guéziec et al., "Cutting and Stitching: Converting Sets of
//! Polygons to Manifold Surfaces", 2001).

mod edges;
mod faces;
mod fans;
mod objects;
mod weld;
mod winding;

pub use edges::{MAX_MATCHED, best_pairs, pair_edges};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use lodpack_mesh::union_find::count_components;
use lodpack_mesh::{Adjacency, Mesh, NONE};
use lodpack_runtime::trace;

/// What [`repair`] found and changed. For a clean, closed mesh all counts are zero, except `components`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RepairReport {
    /// Vertices replaced by an earlier one at exactly the same position (0.0 and -0.0 count as the same).
    pub welded_vertices: u64,
    /// Triangles dropped because two corners are the same vertex, or all three lie exactly on a line. If such a
    /// triangle filled the gap beside a vertex on an edge (a T-junction), the gap of zero width shows up in
    /// `boundary_edges`.
    pub degenerate_faces: u64,
    /// Triangles dropped because an earlier one has the same three vertices, in either winding.
    pub duplicate_faces: u64,
    /// Edges with more than two triangles, along which the surface was cut into sheets.
    pub nonmanifold_edges_cut: u64,
    /// Edges cut because no winding is consistent across them (Möbius strips).
    pub unorientable_edges_cut: u64,
    /// Sound edges cut because two sheets at one of the edges above could not be separated otherwise.
    pub further_edges_cut: u64,
    /// Vertices with several fans of triangles, including those that the cuts above made. Every fan got a vertex of its
    /// own.
    pub nonmanifold_vertices_split: u64,
    /// Triangles whose winding was reversed.
    pub flipped_faces: u64,
    /// Vertices dropped, after welding, because no triangle uses them.
    pub unreferenced_vertices: u64,
    /// Parts of the result that no edge connects.
    pub components: u64,
    /// Edges of the result that have only one triangle.
    pub boundary_edges: u64,
    /// Whether no triangle is left. The caller decides what to do about it.
    pub nothing_left: bool,
}

impl RepairReport {
    /// The sum of two reports.
    pub fn plus(self, other: Self) -> Self {
        Self {
            welded_vertices: self.welded_vertices + other.welded_vertices,
            degenerate_faces: self.degenerate_faces + other.degenerate_faces,
            duplicate_faces: self.duplicate_faces + other.duplicate_faces,
            nonmanifold_edges_cut: self.nonmanifold_edges_cut + other.nonmanifold_edges_cut,
            unorientable_edges_cut: self.unorientable_edges_cut + other.unorientable_edges_cut,
            further_edges_cut: self.further_edges_cut + other.further_edges_cut,
            nonmanifold_vertices_split: self.nonmanifold_vertices_split + other.nonmanifold_vertices_split,
            flipped_faces: self.flipped_faces + other.flipped_faces,
            unreferenced_vertices: self.unreferenced_vertices + other.unreferenced_vertices,
            components: self.components + other.components,
            boundary_edges: self.boundary_edges + other.boundary_edges,
            nothing_left: self.nothing_left && other.nothing_left,
        }
    }
}

/// Makes a mesh manifold, consistently wound, and free of degenerate and duplicate triangles.
///
/// Indices must be in range, positions finite, and three times the number of triangles below 2^32 - 1, as
/// `lodpack-import` guarantees. At an edge of more than two triangles, consistently wound pairs are joined again, the
/// flattest first, then the other pairs in the same order; a triangle left over gets a boundary there. In each
/// component the winding that covers more area wins; at a tie, that of the first triangle.
///
/// Takes linear time, and at most about 100 bytes of temporary memory per triangle.
pub fn repair(mesh: Mesh) -> (Mesh, Adjacency, RepairReport) {
    repaired(mesh, &[], None)
}

/// As [`repair`], and says for each triangle that is left which one of the input it was, and whether its winding was
/// reversed. Corners keep their order, but a reversed triangle [a, b, c] is [a, c, b].
///
/// `objects` are those of the triangles, or empty: those of different ones share no vertex afterwards, and none is
/// dropped as a duplicate of one of another object.
pub fn repair_with_origins(mesh: Mesh, objects: &[u32]) -> (Mesh, Adjacency, RepairReport, Vec<(u32, bool)>) {
    let mut origins = vec![];
    let (mesh, adjacency, report) = repaired(mesh, objects, Some(&mut origins));
    (mesh, adjacency, report, origins)
}

fn repaired(
    mesh: Mesh,
    objects: &[u32],
    mut origins: Option<&mut Vec<(u32, bool)>>,
) -> (Mesh, Adjacency, RepairReport) {
    let mut report = RepairReport::default();
    let Mesh { mut positions, mut triangles } = mesh;

    let before = positions.len();
    let of_vertices = match objects.is_empty() {
        true => vec![],
        false => objects::part_objects(&mut positions, &mut triangles, objects),
    };
    let step = trace::step("weld");
    let kept_vertex = weld::weld_vertices(&mut positions, of_vertices);
    drop(step);
    // Copies for further objects are none of the input's.
    report.welded_vertices = before.saturating_sub(positions.len()) as u64;
    report.degenerate_faces = faces::drop_degenerate(&mut triangles, &kept_vertex, &positions, origins.as_deref_mut());
    drop(kept_vertex);
    let (mesh, adjacency) = sewn(positions, triangles, &mut report, origins);
    (mesh, adjacency, report)
}

/// Like [`repair`], for triangles that repeat no vertex: welds nothing and keeps triangles without area.
pub fn sew(Mesh { positions, triangles }: Mesh) -> (Mesh, Adjacency) {
    sewn(positions, triangles, &mut RepairReport::default(), None)
}

fn sewn(
    mut positions: Vec<DVec3>,
    mut triangles: Vec<[u32; 3]>,
    report: &mut RepairReport,
    mut origins: Option<&mut Vec<(u32, bool)>>,
) -> (Mesh, Adjacency) {
    let step = trace::step("pair");
    let mut pairing = edges::pair_edges(&triangles, &positions);
    if !pairing.duplicates.is_empty() {
        report.duplicate_faces = pairing.duplicates.len() as u64;
        faces::drop_listed(&mut triangles, &pairing.duplicates);
        if let Some(origins) = origins.as_deref_mut() {
            faces::drop_listed(origins, &pairing.duplicates);
        }
        pairing = edges::pair_edges(&triangles, &positions);
    }
    drop(step);
    report.nonmanifold_edges_cut = pairing.nonmanifold_edge_count;

    // Each half-edge now has at most one opposite. Make the winding consistent across all pairs that remain.
    let step = trace::step("wind");
    let outcome = winding::make_consistent(&mut triangles, &mut pairing, &positions);
    drop(step);
    report.unorientable_edges_cut = outcome.cut_edge_count;
    report.flipped_faces = outcome.flipped_face_count;
    if let Some(origins) = origins {
        origins.iter_mut().zip(&outcome.flipped).for_each(|(origin, &flipped)| origin.1 = flipped);
    }

    // Give each fan its own vertex. Where two sheets at a cut edge still share both of its ends, cut their fans
    // further.
    let step = trace::step("fans");
    let mut copied = fans::split_fans(&mut triangles, &pairing.opposite, positions.len());
    while let further @ 1.. = fans::detach_shared_edges(&triangles, &mut pairing) {
        report.further_edges_cut += further;
        let more = fans::split_fans(&mut triangles, &pairing.opposite, positions.len() + copied.len());
        for vertex in more {
            let copied_from = (vertex as usize).checked_sub(positions.len()).map_or(vertex, |copy| copied[copy]);
            copied.push(copied_from);
        }
    }
    drop(step);
    let _step = trace::step("count");
    positions.reserve_exact(copied.len());
    for &original in &copied {
        positions.push(positions[original as usize]);
    }
    copied.sort_unstable();
    copied.dedup();
    report.nonmanifold_vertices_split = copied.len() as u64;

    report.unreferenced_vertices = faces::drop_unreferenced(&mut triangles, &mut positions);
    report.components = count_components(positions.len(), &triangles) as u64;
    report.boundary_edges = pairing.opposite.iter().filter(|&&o| o == NONE).count() as u64;
    report.nothing_left = triangles.is_empty();
    (Mesh { positions, triangles }, Adjacency { opposite: pairing.opposite })
}

#[cfg(test)]
mod tests;
