//! Stub: irregular. A stand-in codec of the agreed interface until the real one is there.

use crate::{
    context::{Context, IRREGULAR},
    entropy::{SymbolBuffer, SymbolSource},
    error::{Error, Result},
    patch::{LatticePoint, Patch},
};

/// How coarsely a level's vertices are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quantisation {
    /// The step along the surface normal is 2^normal_shift lattice steps; at most 40.
    pub normal_shift: u8,
    /// The step along the surface is 2^tangent_shift normal steps; at most 40. 2 to 4 is good.
    pub tangent_shift: u8,
}

/// What a hostile patch may ask for.
#[derive(Clone, Copy, Debug)]
pub struct PatchLimits {
    /// Border and interior vertices together.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
}

/// A patch to be coded.
#[derive(Clone, Copy, Debug)]
pub struct PatchTarget<'a> {
    /// The border samples, loop after loop, in the winding of the triangles.
    pub loops: &'a [Vec<LatticePoint>],
    /// Wanted positions of the interior vertices, in lattice units.
    pub interior: &'a [[f64; 3]],
    /// Vertices as in [`Patch`]: the border samples first, loop after loop, then the interior.
    pub triangles: &'a [[u32; 3]],
}

/// Moves a vertex along a direction to its best place.
pub trait Slide {
    /// The best signed distance from `point` along the unit vector `normal` for interior vertex `vertex`.
    fn offset(&self, vertex: u32, point: [f64; 3], normal: [f64; 3]) -> f64;
}

/// Codes a patch.
///
/// # Errors
/// None.
pub fn encode_patch(
    target: &PatchTarget<'_>,
    _quantisation: Quantisation,
    _slide: &dyn Slide,
    out: &mut SymbolBuffer,
) -> Result<(Patch, Vec<u32>)> {
    out.put(IRREGULAR, target.interior.len() as u64);
    let mut patch = Patch {
        border_count: target.loops.iter().map(Vec::len).sum::<usize>() as u32,
        interior: Vec::new(),
        triangles: target.triangles.to_vec(),
    };
    for point in target.interior {
        let point = point.map(|x| x.round() as i64);
        (0..3).for_each(|axis| out.put_signed(IRREGULAR + 1 + axis as Context, point[axis]));
        patch.interior.push(point);
    }
    out.put(IRREGULAR + 4, target.triangles.len() as u64);
    target.triangles.iter().flatten().for_each(|&v| out.put(IRREGULAR + 5, u64::from(v)));
    Ok((patch, (0..target.interior.len() as u32).collect()))
}

pub(crate) fn decode_patch(
    symbols: &mut impl SymbolSource,
    loops: &[Vec<LatticePoint>],
    _quantisation: Quantisation,
    limits: PatchLimits,
) -> Result<Patch> {
    let border_count = loops.iter().map(Vec::len).sum::<usize>() as u64;
    let too_many = || Error::format("a patch has too many vertices or triangles");
    let interior_count = symbols.get(IRREGULAR)?;
    let count = border_count.checked_add(interior_count).filter(|&c| c <= limits.vertices).ok_or_else(too_many)?;
    let mut patch = Patch { border_count: border_count as u32, ..Patch::default() };
    for _ in 0..interior_count {
        let mut point = [0; 3];
        for axis in 0..3 {
            point[axis] = symbols.get_signed(IRREGULAR + 1 + axis as Context)?;
        }
        patch.interior.push(point);
    }
    let triangle_count = Some(symbols.get(IRREGULAR + 4)?).filter(|&c| c <= limits.triangles).ok_or_else(too_many)?;
    for _ in 0..triangle_count {
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            *corner = Some(symbols.get(IRREGULAR + 5)?).filter(|&v| v < count).ok_or_else(too_many)? as u32;
        }
        patch.triangles.push(triangle);
    }
    Ok(patch)
}
