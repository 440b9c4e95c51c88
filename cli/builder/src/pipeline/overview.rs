//! The overview: one small mesh of the whole model, for files whose coarsest cut does not fit in the first request.

use super::drawn::DrawnPatch;
use super::scale::Scale;
use crate::reduce::CoarseSurface;
use crate::reduce::boundary_loops;
use crate::reduce::{Ways, reduce};
use glam::DVec3;
use lodpack::{
    LatticePoint,
    write::{OverviewRecord, PatchTarget, Slide, SymbolBuffer, encode_patch},
};
use lodpack_mesh::Mesh;
use lodpack_stage::repair::sew;

/// A file gets an overview where its header, index and coarsest level together are larger: smaller ones arrive as fast
/// as an overview would.
pub const OVERVIEW_FROM_BYTES: u64 = 16 << 10;
/// A file gets an overview only where it has at least this many roots: the index and coarsest level of fewer are small
/// enough.
pub const OVERVIEW_FROM_ROOTS: u64 = 32;
/// The most triangles of an overview, which take less than a kilobyte.
pub const OVERVIEW_TRIANGLES: usize = 500;

/// The overview of a surface; none if nothing is left of the surface with so few triangles.
pub(super) fn overview(surface: &CoarseSurface, scale: &Scale) -> Option<OverviewRecord> {
    let (reduced, _) = reduce(surface, Ways::Nearest, OVERVIEW_TRIANGLES, Some)?;
    coded(surface, reduced, scale, 0).map(|(overview, _)| overview)
}

/// A coarser surface instead of another, coded with the steps of a level; and what is drawn of it.
pub(super) fn coded(
    surface: &CoarseSurface,
    reduced: CoarseSurface,
    scale: &Scale,
    level: usize,
) -> Option<(OverviewRecord, DrawnPatch)> {
    // Where vertices were clustered, more than two triangles may meet in an edge.
    let (Mesh { positions, triangles }, _) = sew(Mesh { positions: reduced.positions, triangles: reduced.triangles });
    let border: Vec<Vec<u32>> = boundary_loops(&triangles, positions.len())?
        .iter()
        .map(|border| border.iter().map(|b| b.vertex).collect())
        .collect();

    let step = scale.step();
    let quantisation = scale.levels.get(level)?.quantisation;
    let normal_step = (1_u64 << quantisation.normal_shift) as f64;
    let rounded = |&v: &u32| -> LatticePoint {
        (positions[v as usize] / step).to_array().map(|x| (x / normal_step).round() as i64 * normal_step as i64)
    };
    let loops: Vec<Vec<LatticePoint>> = border.iter().map(|border| border.iter().map(rounded).collect()).collect();
    // A patch has its border first.
    let mut order: Vec<u32> = border.into_iter().flatten().collect();
    let border_count = order.len();
    let mut numbers = vec![u32::MAX; positions.len()];
    (0..).zip(&order).for_each(|(number, &v)| numbers[v as usize] = number);
    for &v in triangles.as_flattened() {
        if numbers[v as usize] == u32::MAX {
            numbers[v as usize] = order.len() as u32;
            order.push(v);
        }
    }
    let interior: Vec<[f64; 3]> =
        order[border_count..].iter().map(|&v| (positions[v as usize] / step).to_array()).collect();
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|corners| corners.map(|v| numbers[v as usize])).collect();
    let target = PatchTarget { loops: &loops, interior: &interior, triangles: &triangles };
    let mut symbols = SymbolBuffer::default();
    let (drawn, _) = encode_patch(&target, quantisation, &Nearest(&interior), &mut symbols).ok()?;

    let points = loops.iter().flatten().chain(&drawn.interior);
    let drawn_positions: Vec<DVec3> = points.map(|&p| scale.local_from_lattice(p)).collect();
    let error = surface.error_of(&surface.positions, &surface.triangles, &drawn_positions, &drawn.triangles);
    let positions = loops.iter().flatten().chain(&drawn.interior).copied().collect();
    let overview = OverviewRecord { error, quantisation, loops, triangle_count: drawn.triangles.len() as u32, symbols };
    Some((overview, DrawnPatch { positions, triangles: drawn.triangles, areas: vec![] }))
}

/// Slides vertices as near as possible to where they are wanted, in lattice steps.
struct Nearest<'a>(&'a [[f64; 3]]);

impl Slide for Nearest<'_> {
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64 {
        let wanted = DVec3::from_array(self.0[vertex as usize]);
        (wanted - DVec3::from_array(point)).dot(DVec3::from_array(normal))
    }
}
