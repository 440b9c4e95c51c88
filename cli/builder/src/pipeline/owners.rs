//! The owners of a block: the object of each of its islands.
//!
//! Objects share no vertex of the mesh, and simplification keeps apart what is apart. So each vertex of a patch that
//! was a vertex of the chart says to which object its island belongs.

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

#[cfg(test)]
mod tests {
    use super::super::region_progress::RegionProgress;
    use super::super::roots::build_roots;
    use super::super::shared_arcs::SharedArcs;
    use super::super::summary::Fallbacks;
    use super::super::{ModelOptions, Prepared, prepare};
    use super::*;
    use crate::region::{RegionStore, Regions};
    use lodpack_mesh::Mesh;
    use lodpack_mesh::attributes::{ObjectNode, ObjectRun, Surface as Input};
    use lodpack_runtime::progress::Silent;
    use lodpack_stage::arcs::trace_arcs_to_bends;

    /// A box of n x n squares a side, bent outward, from one corner to the other; without its last side if it is open.
    fn bent_box(mesh: &mut Mesh, [low, high]: [DVec3; 2], n: u32, is_open: bool) {
        let sides = (0..3).flat_map(|axis| [(axis, 0.0), (axis, 1.0)]).take(if is_open { 5 } else { 6 });
        for (axis, side) in sides {
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(a, b)| {
                    let mut at = DVec3::ZERO;
                    let share = |a: u32| f64::from(a) / f64::from(n);
                    (at[axis], at[(axis + 1) % 3], at[(axis + 2) % 3]) = (side, share(a), share(b));
                    // Sides that touch others stay flat.
                    let bend = 0.2 * (at - at * at).element_sum();
                    let at = low + (high - low) * at.with_z(at.z * (1.0 - bend));
                    mesh.positions.push(at);
                    mesh.positions.len() as u32 - 1
                });
                let [a, b, c, d] = corners;
                let [b, d] = if side == 0.0 { [d, b] } else { [b, d] };
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// Large and small boxes that touch, and their objects: each of 140 has one or two of them.
    fn scene() -> (Input, Vec<[DVec3; 2]>) {
        let (mut mesh, mut bounds) = (Mesh::default(), vec![]);
        let mut input = Input::default();
        for object in 0..140u32 {
            let at = DVec3::new(f64::from(object % 12), f64::from(object / 12), 0.0);
            let node = (object * 37) % 140;
            input.attributes.objects.push(ObjectRun { first_triangle: mesh.triangles.len() as u32, node });
            let n = if object % 9 == 0 { 24 } else { 1 + object % 5 };
            bent_box(&mut mesh, [at, at + DVec3::ONE], n, object % 4 == 1);
            if object % 3 == 0 {
                bent_box(&mut mesh, [at + DVec3::Z, at + DVec3::new(1.0, 1.0, 1.5)], 2, object % 2 == 1);
            }
            bounds.push((node, [at, at + DVec3::new(1.0, 1.0, 1.5)]));
        }
        bounds.sort_by_key(|&(node, _)| node);
        input.attributes.nodes = vec![ObjectNode::default(); 140];
        (Input { mesh, ..input }, bounds.into_iter().map(|(_, bounds)| bounds).collect())
    }

    fn area(corners: [DVec3; 3]) -> f64 {
        0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length()
    }

    #[test]
    fn every_island_of_every_block_lies_where_its_owner_is() {
        let (input, bounds) = scene();
        let mut areas = vec![0.0; bounds.len()];
        for triangle in 0..input.mesh.triangles.len() as u32 {
            areas[input.attributes.object(triangle) as usize] += area(input.mesh.corners(triangle));
        }
        for chart_triangles in [150, 4000, 100_000] {
            let options = ModelOptions { chart_triangles: Some(chart_triangles), ..ModelOptions::default() };
            let division = options.division(u64::MAX, &input.appearance);
            let regions = Regions::in_memory(input.clone(), division);
            let triangles = input.mesh.triangles.len() as u64;
            let Prepared { store, plan, seams, .. } = prepare(regions, triangles, &options, None, &Silent).unwrap();
            let RegionStore::Memory(regions) = store else { panic!("there is enough memory") };
            let (mut left, scale) = (areas.clone(), &plan.scale);
            let origin = DVec3::from_array(scale.lattice.origin);
            for (region, seams) in regions.iter().zip(&seams) {
                let (mesh, adjacency, labels) = (&region.mesh, &region.adjacency, &region.labels[..]);
                let atlas = trace_arcs_to_bends(mesh, adjacency, labels, seams, scale.straight_boundary());
                let coarsest =
                    if atlas.charts.len() > 1 { scale.coarsest_of_charts } else { scale.coarsest_of_regions };
                let charted = ChartedMesh {
                    mesh,
                    adjacency,
                    labels,
                    objects: &region.attributes.objects,
                    atlas: &atlas,
                    scale,
                    coarsest,
                    // What is drawn is known then.
                    has_channels: true,
                    areas: None,
                };
                let mut arcs = SharedArcs::new(&charted).unwrap();
                let fallbacks = &mut Fallbacks::default();
                let (roots, ..) = build_roots(
                    &charted,
                    plan.fillings,
                    &mut arcs,
                    fallbacks,
                    &RegionProgress::new(&Silent, 1, false, false),
                )
                .unwrap();
                for root in roots {
                    let finest = root.record.blocks.iter().rposition(Option::is_some).unwrap();
                    for (level, (block, drawn)) in root.record.blocks.iter().zip(&root.drawn).enumerate() {
                        let (Some(block), Some(drawn)) = (block, drawn) else { continue };
                        let (islands, count) = islands(&drawn.triangles);
                        assert_eq!(block.owners.len(), count as usize);
                        for (corners, island) in drawn.triangles.iter().zip(islands) {
                            let owner = block.owners[island as usize] as usize;
                            let corners =
                                corners.map(|v| scale.local_from_lattice(drawn.positions[v as usize]) + origin);
                            let [low, high] = bounds[owner];
                            let slack = block.error + 1e-9;
                            let is_in =
                                |p: DVec3| (p - low).min_element() > -slack && (high - p).min_element() > -slack;
                            assert!(corners.into_iter().all(is_in), "{corners:?} {:?} {slack}", bounds[owner]);
                            left[owner] -= if level == finest { area(corners) } else { 0.0 };
                        }
                    }
                }
            }
            let is_gone = |(left, area): (&f64, &f64)| left.abs() < 0.02 * area;
            assert!(left.iter().zip(&areas).all(is_gone), "{chart_triangles}: {left:?}");
        }
    }
}
