//! Decoding: the machine driven by a symbol stream.

use super::{
    PatchLimits, REFINEMENTS,
    connectivity::{Driver, Machine, Operation},
    contexts,
    geometry::Forecast,
};
use crate::{
    codec::{
        entropy::{SymbolSource, context::Context},
        filling::Quantisation,
        local_frame::{COORDINATE_LIMIT, to_lattice},
        patch::{LatticePoint, Patch},
        vector::Vec3,
    },
    error::Violation,
};

/// Codes of the operations.
pub(super) const NEW: u64 = 0;
pub(super) const NEXT: u64 = 1;
pub(super) const PREVIOUS: u64 = 2;
pub(super) const SPLIT: u64 = 3;
pub(super) const UNION: u64 = 4;

/// Decodes irregular blocks one after the other, triangle by triangle.
#[derive(Debug, Default)]
pub(super) struct PatchDecoder {
    machine: Machine,
    quantisation: Quantisation,
}

impl PatchDecoder {
    /// Begins a block.
    ///
    /// # Errors
    /// If the symbols break a rule or exceed `limits`, or if `symbols` fails.
    pub(crate) fn begin(
        &mut self,
        symbols: &mut impl SymbolSource,
        loops: &[Vec<LatticePoint>],
        quantisation: Quantisation,
        limits: PatchLimits,
    ) -> Result<(), Violation> {
        let mut decoder = Decoder { symbols, quantisation };
        self.machine.begin(loops, limits, &mut decoder)?;
        self.quantisation = decoder.quantisation;
        Ok(())
    }

    /// Decodes up to the next triangle. Returns whether there is more to come.
    ///
    /// # Errors
    /// As [`PatchDecoder::begin`].
    #[inline]
    pub(crate) fn advance(&mut self, symbols: &mut impl SymbolSource) -> Result<bool, Violation> {
        self.machine.advance(&mut Decoder { symbols, quantisation: self.quantisation })
    }

    /// Takes the patch, once nothing more is to come.
    pub(crate) fn take_patch(&mut self) -> Patch {
        self.machine.take_patch()
    }
}

/// Decodes one irregular block.
///
/// # Errors
/// As [`PatchDecoder::begin`].
pub(crate) fn decode_patch(
    symbols: &mut impl SymbolSource,
    loops: &[Vec<LatticePoint>],
    quantisation: Quantisation,
    limits: PatchLimits,
) -> Result<Patch, Violation> {
    Machine::run(loops, limits, &mut Decoder { symbols, quantisation })
}

struct Decoder<'a, S> {
    symbols: &'a mut S,
    quantisation: Quantisation,
}

/// The vertex at a residual from its forecast.
#[inline]
pub(super) fn place(forecast: &Forecast, residual: [i64; 3], quantisation: Quantisation) -> Option<LatticePoint> {
    let height = residual[2] as f64 * quantisation.steps().0;
    to_lattice(forecast.frame.lift(place_level(forecast, residual, quantisation), height))
}

/// As [`place`], before the normal component of the residual is added.
#[inline]
pub(super) fn place_level(forecast: &Forecast, residual: [i64; 3], quantisation: Quantisation) -> Vec3 {
    let step = quantisation.steps().1;
    let moved = forecast.frame.slide(forecast.point, residual[0] as f64 * step, residual[1] as f64 * step);
    forecast.frame.lift(moved, forecast.bend(moved))
}

impl<S: SymbolSource> Driver for Decoder<'_, S> {
    type Error = Violation;

    fn closed_components(&mut self) -> Result<u64, Violation> {
        let head = self.symbols.get(contexts::HEAD)?;
        self.quantisation = self.quantisation.refined((head % REFINEMENTS) as u8);
        Ok(head / REFINEMENTS)
    }

    fn seed(&mut self, machine: &Machine) -> Result<[LatticePoint; 3], Violation> {
        let mut corners = [[0; 3]; 3];
        let step = self.quantisation.steps().0 as i64;
        let mut last = machine.seed_reference();
        for corner in &mut corners {
            for x in &mut last {
                let residual = self.symbols.get_signed(contexts::SEED)?;
                let moved = residual.checked_mul(step).and_then(|d| x.checked_add(d));
                *x = moved
                    .filter(|x| x.unsigned_abs() <= COORDINATE_LIMIT as u64)
                    .ok_or(Violation(&"a coordinate exceeds 2^40"))?;
            }
            *corner = last;
        }
        Ok(corners)
    }

    #[inline(always)]
    fn operation(&mut self, _: &Machine, _: u32, context: Context) -> Result<Operation, Violation> {
        Ok(match self.symbols.get(context)? {
            NEW => Operation::New,
            NEXT => Operation::Next,
            PREVIOUS => Operation::Previous,
            SPLIT => {
                let coded = self.symbols.get_signed(contexts::SPLIT)?;
                Operation::Split { offset: if coded >= 0 { coded.saturating_add(2) } else { coded.saturating_sub(1) } }
            }
            UNION => Operation::Union {
                index: self.symbols.get(contexts::UNION_LOOP)?,
                offset: self.symbols.get_signed(contexts::UNION)?,
            },
            _ => return Err(Violation(&"an operation is unknown")),
        })
    }

    #[inline(always)]
    fn vertex(&mut self, forecast: &Forecast) -> Result<LatticePoint, Violation> {
        let [along, across, normal] = forecast.contexts(self.quantisation.steps());
        let (along, across) = (self.symbols.get_signed(along)?, self.symbols.get_signed(across)?);
        let residual = [along, across, self.symbols.get_signed(normal)?];
        place(forecast, residual, self.quantisation).ok_or(Violation(&"a coordinate exceeds 2^40"))
    }

    fn close(&mut self, _: &Machine, _: u32) -> Result<(), Violation> {
        Ok(())
    }
}
