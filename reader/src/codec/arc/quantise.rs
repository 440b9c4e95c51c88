//! Quantising arcs: from wanted samples to those that a file can store (encoder only).

use super::{Coder, Path, forecast::Forecast};
use crate::{
    codec::{
        entropy::context::Context,
        local_frame::round,
        patch::LatticePoint,
        vector::{dot, sub},
    },
    error::{Error, Result, Violation},
};

/// A sample of an arc as a file stores it: what [`quantise_arcs`] returns, and what a model holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArcSample {
    /// Position along the arc in 1/65536: 1 to 65535.
    pub param: u32,
    /// The coarsest level at which the sample belongs to the arc.
    pub level: u8,
    /// Its position once decoded.
    pub position: LatticePoint,
    /// Steps from the forecast: two across the arc, one along it.
    pub(crate) residual: [i64; 3],
}

/// A sample that an arc should have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WantedSample {
    /// Position along the arc in 1/65536: 1 to 65535.
    pub param: u32,
    /// The coarsest level at which the sample belongs to the arc. The middle of an interval must not have a coarser
    /// level than the ends of the interval.
    pub level: u8,
    /// The wanted position, in lattice units.
    pub position: [f64; 3],
}

/// An arc before quantisation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArcTarget {
    /// Corners at both ends.
    pub ends: [u32; 2],
    /// Samples by ascending parameter.
    pub samples: Vec<WantedSample>,
}

/// Quantises the samples of arcs. A builder fits everything else to the positions that result, since these are the ones
/// that a reader will decode. The step along an arc is 2^tangent_shift lattice steps, as the model says.
///
/// # Errors
/// [`Error::Model`] if an end of an arc does not exist, samples are not nested, or positions leave the lattice.
pub fn quantise_arcs(
    corners: &[LatticePoint],
    targets: &[ArcTarget],
    tangent_shift: u8,
) -> Result<Vec<Vec<ArcSample>>> {
    let corner = |index: u32| {
        corners.get(index as usize).copied().ok_or_else(|| Error::model(format!("corner {index} does not exist")))
    };
    targets
        .iter()
        .enumerate()
        .map(|(index, target)| {
            let [first, second] = target.ends;
            quantise_arc([corner(first)?, corner(second)?], &target.samples, tangent_shift).map_err(|error| match error
            {
                Error::Model { what } => Error::model(format!("arc {index}: {what}")),
                other => other,
            })
        })
        .collect()
}

/// As [`quantise_arcs`], for one arc between two positions.
///
/// # Errors
/// [`Error::Model`] if samples are not nested, or positions leave the lattice.
pub fn quantise_arc(ends: [LatticePoint; 2], wanted: &[WantedSample], tangent_shift: u8) -> Result<Vec<ArcSample>> {
    if wanted.windows(2).any(|pair| pair[0].param >= pair[1].param) {
        return Err(Error::model("samples are not in order of their parameters"));
    }
    let mut path = Path::new(ends);
    let mut quantiser = Quantiser { wanted, samples: Vec::with_capacity(wanted.len()) };
    let level_count = wanted.iter().map(|sample| sample.level + 1).max().unwrap_or(0);
    for level in 0..level_count {
        path.refine(level, tangent_shift, &mut quantiser).map_err(|_| {
            Error::model("positions leave the lattice (2^40 steps on either side); choose a larger step")
        })?;
    }
    let mut samples = quantiser.samples;
    if samples.len() != wanted.len() {
        return Err(Error::model("samples are not nested: a middle is coarser than an end of its interval"));
    }
    samples.sort_unstable_by_key(|sample| sample.param);
    for (sample, knot) in samples.iter_mut().zip(path.samples()) {
        sample.position = knot.position;
    }
    Ok(samples)
}

/// Finds the residuals that come closest to the wanted positions.
struct Quantiser<'a> {
    wanted: &'a [WantedSample],
    samples: Vec<ArcSample>,
}

impl Coder for Quantiser<'_> {
    fn split(&mut self, _context: Context, param: u32, level: u8) -> Result<bool, Violation> {
        let found = self.wanted.binary_search_by_key(&param, |sample| sample.param);
        Ok(found.is_ok_and(|index| self.wanted[index].level == level))
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let found = self.wanted.binary_search_by_key(&forecast.param, |sample| sample.param);
        let index = found.map_err(|_| Violation(&"an arc lacks a sample"))?;
        let wanted = sub(self.wanted[index].position, forecast.point);
        let frame = &forecast.frame;
        let steps = [dot(wanted, frame.along), dot(wanted, frame.across), dot(wanted, frame.normal) / forecast.step];
        let residual = steps.map(|x| round(x) as i64);
        let (param, level) = (forecast.param, forecast.level);
        self.samples.push(ArcSample { param, level, position: [0; 3], residual });
        Ok(residual)
    }
}
