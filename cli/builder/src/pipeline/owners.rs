//! The owners of a block: the object of each of its islands.
//!
//! Objects share no vertex of the mesh, and simplification keeps apart what is apart. So each vertex of a patch that was
//! a vertex of the chart says to which object its island belongs.

use glam::DVec3;
use lodpack::islands;
use lodpack_mesh::NONE;
use lodpack_stage::certify::{Hint, Surface};

use super::ChartedMesh;
use super::shared_arcs::CutChart;

/// The objects of a chart.
pub(super) struct ChartObjects<'a> {
    cut: &'a CutChart,
    original: &'a Surface<'a>,
    /// Of each triangle of the chart.
    of_triangles: Vec<u32>,
    /// Of each of its vertices.
    of_vertices: Vec<u32>,
}

impl<'a> ChartObjects<'a> {
    /// None if there are no objects. `original` is the chart of the input.
    pub fn of(charted: &ChartedMesh, chart: u32, cut: &'a CutChart, original: &'a Surface<'a>) -> Option<Self> {
        if charted.objects.is_empty() {
            return None;
        }
        let triangles = &charted.atlas.charts[chart as usize].triangles;
        let of_triangles: Vec<u32> = triangles.iter().map(|&t| charted.objects[t as usize]).collect();
        let mut of_vertices = vec![NONE; cut.original.len()];
        for (corners, &object) in cut.mesh.triangles.iter().zip(&of_triangles) {
            corners.iter().for_each(|&vertex| of_vertices[vertex as usize] = object);
        }
        Some(Self { cut, original, of_triangles, of_vertices })
    }

    /// The owners of a level that was made by collapses or by cells: of its patch, whose vertices are at `positions`.
    /// `was` are the vertices of the chart that these were, or [`NONE`]; empty if unknown.
    pub fn owners(&self, level: u8, triangles: &[[u32; 3]], positions: &[DVec3], was: &[u32]) -> Vec<u32> {
        let loops = self.cut.mesh.loops.iter().zip(&self.cut.lattice);
        let border = loops.flat_map(|(border, points)| border.iter().zip(points));
        let drawn = border.filter(|(vertex, point)| vertex.level <= level && point.is_some());
        let mut of_vertices: Vec<u32> = drawn.map(|(vertex, _)| self.of_vertices[vertex.vertex as usize]).collect();
        let inside = was.get(of_vertices.len()..).unwrap_or_default();
        of_vertices.extend(inside.iter().map(|&was| self.of_vertices.get(was as usize).copied().unwrap_or(NONE)));
        let (labels, count) = islands(triangles);
        let mut owners = vec![NONE; count as usize];
        for (corners, &island) in triangles.iter().zip(&labels) {
            let known = corners.iter().filter_map(|&vertex| of_vertices.get(vertex as usize)).find(|&&of| of != NONE);
            if let (NONE, Some(&known)) = (owners[island as usize], known) {
                owners[island as usize] = known;
            }
        }
        for (corners, &island) in triangles.iter().zip(&labels) {
            if owners[island as usize] == NONE {
                owners[island as usize] = self.nearest(corners.map(|vertex| positions[vertex as usize]));
            }
        }
        owners
    }

    /// The owners of a surface that was made in any way. None if one of its islands lies near several objects, which it
    /// may have joined.
    pub fn owners_of(&self, positions: &[DVec3], triangles: &[[u32; 3]]) -> Option<Vec<u32>> {
        let (labels, count) = islands(triangles);
        let mut owners = vec![NONE; count as usize];
        for (corners, &island) in triangles.iter().zip(&labels) {
            let nearest = self.nearest(corners.map(|vertex| positions[vertex as usize]));
            let owner = &mut owners[island as usize];
            if *owner != NONE && *owner != nearest {
                return None;
            }
            *owner = nearest;
        }
        Some(owners)
    }

    /// The object nearest to the middle of a triangle.
    fn nearest(&self, corners: [DVec3; 3]) -> u32 {
        if let [only, rest @ ..] = &self.of_triangles[..]
            && rest.iter().all(|other| other == only)
        {
            return *only;
        }
        let middle = corners.iter().sum::<DVec3>() / 3.0;
        let closest = self.original.bvh().closest(middle, &mut Hint::default());
        self.of_triangles[closest.triangle as usize]
    }
}
