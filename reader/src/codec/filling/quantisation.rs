//! How coarsely fillings store their vertices.

use std::ops::Index;

use super::Filling;

/// Largest shift.
pub(crate) const MAX_SHIFT: u8 = 40;

/// The steps of a filling's vertices at one level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quantisation {
    /// The step along the surface normal is 2^normal_shift lattice steps; at most 40.
    pub normal_shift: u8,
    /// The step along the surface is 2^tangent_shift normal steps; at most 40. Good values are 2 to 4.
    pub tangent_shift: u8,
}

impl Quantisation {
    /// Whether both shifts are in range.
    pub(crate) fn is_valid(self) -> bool {
        self.normal_shift.max(self.tangent_shift) <= MAX_SHIFT
    }

    /// The same with a tangential step 2^refinement times smaller, but not below the normal step.
    pub(crate) fn refined(self, refinement: u8) -> Self {
        Self { tangent_shift: self.tangent_shift.saturating_sub(refinement), ..self }
    }

    /// Normal and tangential step in lattice steps; both are powers of two.
    pub(crate) fn steps(self) -> (f64, f64) {
        let normal = (1u64 << self.normal_shift.min(MAX_SHIFT)) as f64;
        (normal, normal * (1u64 << self.tangent_shift.min(MAX_SHIFT)) as f64)
    }
}

/// The steps of each filling at one level: `steps[filling]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LevelSteps([Quantisation; Filling::COUNT]);

impl LevelSteps {
    /// Asks for the steps of each filling.
    pub fn new(mut steps_of: impl FnMut(Filling) -> Quantisation) -> Self {
        let mut steps = Self::default();
        Filling::all().for_each(|filling| steps.0[filling as usize] = steps_of(filling));
        steps
    }
}

impl From<Quantisation> for LevelSteps {
    /// The same steps for all fillings.
    fn from(quantisation: Quantisation) -> Self {
        Self([quantisation; Filling::COUNT])
    }
}

impl Index<Filling> for LevelSteps {
    type Output = Quantisation;

    fn index(&self, filling: Filling) -> &Quantisation {
        &self.0[filling as usize]
    }
}

/// Moves a vertex along a direction to its best place. Irregular fillings name a vertex by its index in
/// [`PatchTarget::interior`](super::irregular::PatchTarget::interior), grids by its
/// [`GridSite`](super::grid::GridSite).
pub trait Slide<V = u32> {
    /// The best signed distance from `point` along the unit vector `normal`, in lattice units. `point` is where the
    /// vertex lies once its tangential residual is rounded, without any normal one; it may be a few edge lengths off
    /// the surface. Following the surface from there, instead of the frame, keeps the rounding from lifting the vertex
    /// off it.
    fn offset(&self, vertex: V, point: [f64; 3], normal: [f64; 3]) -> f64;
}
