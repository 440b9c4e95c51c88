//! The overview: one small mesh of the whole model, for files whose coarsest cut does not fit in the first request.

use super::coarse::CoarseSurface;
use super::irregular::QuadricSlide;
use super::scale::Scale;
use glam::DVec3;
use lodpack::{
    LatticePoint,
    write::{OverviewRecord, PatchTarget, SymbolBuffer, encode_patch},
};

/// A file gets an overview where its header, index and coarsest level together are larger: smaller ones arrive as fast as an overview
/// would.
pub const OVERVIEW_FROM_BYTES: u64 = 16 << 10;
/// A file gets an overview only where it has at least this many roots: the index and coarsest level of fewer are small enough.
pub const OVERVIEW_FROM_ROOTS: u64 = 32;
/// Triangles to aim for, which take one or two kilobytes.
pub const OVERVIEW_TRIANGLES: usize = 2000;
/// An overview with more triangles (because of many components or long boundaries) would not be small.
const MAX_TRIANGLES: usize = 2 * OVERVIEW_TRIANGLES;

/// The overview of a surface; none if the surface cannot be made small.
pub(super) fn overview(surface: &CoarseSurface, scale: &Scale) -> Option<OverviewRecord> {
    let (whole, patch) = surface.simplified(OVERVIEW_TRIANGLES)?;
    if patch.triangles.len() > MAX_TRIANGLES {
        return None;
    }

    let step = scale.step();
    let quantisation = scale.levels.first()?.quantisation;
    let normal_step = (1_u64 << quantisation.normal_shift) as f64;
    let rounded = |v: u32| -> LatticePoint {
        (whole.positions[v as usize] / step).to_array().map(|x| (x / normal_step).round() as i64 * normal_step as i64)
    };
    let mut border = patch.border.iter().map(|&v| rounded(v));
    let loops: Vec<Vec<LatticePoint>> =
        patch.border_loops.iter().map(|&count| border.by_ref().take(count as usize).collect()).collect();
    let interior: Vec<[f64; 3]> = patch.interior.iter().map(|&p| (p / step).to_array()).collect();
    let target = PatchTarget { loops: &loops, interior: &interior, triangles: &patch.triangles };
    let slide = QuadricSlide { patch: &patch, step, bound: normal_step * f64::from(1 << quantisation.tangent_shift) };
    let mut symbols = SymbolBuffer::default();
    let (drawn, _) = encode_patch(&target, quantisation, &slide, &mut symbols).ok()?;

    let points = loops.iter().flatten().chain(&drawn.interior);
    let drawn_positions: Vec<DVec3> = points.map(|&p| scale.local_from_lattice(p)).collect();
    let error = surface.error_of(&whole, &drawn_positions, &drawn.triangles);
    Some(OverviewRecord { error, quantisation, loops, triangle_count: drawn.triangles.len() as u32, symbols })
}
