//! Arcs: chains of samples at dyadic parameters between two corners, nested level by level (SPEC.md, "Corners and
//! arcs").
//!
//! The parameter of an arc runs from 0 at its first corner to 65536 at its second. Each level may split every interval
//! between neighbouring samples at its middle, and may split the halves again. Intervals are visited by width, widest
//! first, and among equals by parameter. The index gives the number of samples that a level adds; once these are known,
//! no flags follow. The position of a middle is forecast from the samples around it ([`forecast`]) and corrected by a
//! residual in a local frame.
//!
//! Encoder, quantiser and decoder run the same walk ([`Path::refine`]), each with its own [`Coder`], so they cannot
//! drift apart.

mod coders;
pub(crate) mod contexts;
mod corner;
mod forecast;
mod quantise;
#[cfg(test)]
mod tests;

pub(crate) use coders::Split;
pub(crate) use corner::{decode_corner, encode_corner};
pub use quantise::{ArcSample, ArcTarget, WantedSample, quantise_arc, quantise_arcs};

use crate::{
    codec::{
        entropy::{SymbolBuffer, SymbolSource, context::Context},
        patch::LatticePoint,
    },
    error::{Error, Result, Violation},
};
use coders::{Decoder, Encoder, Recorder, Repeater};
use forecast::{Forecast, size_class};

/// The parameter of an arc's second corner.
pub const PARAM_END: u32 = 1 << 16;

/// The largest `tangent_shift`.
pub const MAX_TANGENT_SHIFT: u8 = 40;

/// A known point of an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Knot {
    /// 0 to [`PARAM_END`].
    pub param: u32,
    /// The coarsest level at which it belongs to the arc; 0 for corners.
    pub level: u8,
    /// Size class of its residual: see [`Path::forecast`].
    size_class: u8,
    /// Its position, in lattice units.
    pub position: LatticePoint,
}

/// The known part of an arc.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Path {
    knots: Vec<Knot>,
    /// The coarsest level at which each of its corners is a vertex.
    end_levels: [u8; 2],
    /// Whether its knots have positions: see [`Path::skipped`].
    is_placed: bool,
}

/// An arc in one of its directions: a side of a root.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HalfPath<'a> {
    /// The arc.
    pub path: &'a Path,
    /// Whether it is walked from its second corner to its first.
    pub reversed: bool,
}

impl HalfPath<'_> {
    /// The number of vertices that [`HalfPath::walk`] visits.
    pub(crate) fn vertex_count(&self, level: u8) -> usize {
        let corner = usize::from(self.path.end_levels[usize::from(self.reversed)] <= level);
        corner + self.path.samples().iter().filter(|knot| knot.level <= level).count()
    }

    /// Visits the corner where it begins, if that is a vertex at a level, then the samples that belong to it, in its
    /// direction. Parameters run from 0 at that corner to [`PARAM_END`], which is not visited.
    #[inline]
    pub(crate) fn walk(&self, level: u8, mut visit: impl FnMut(u32, LatticePoint)) {
        let samples = self.path.samples().iter().filter(|knot| knot.level <= level);
        let begin = usize::from(self.reversed);
        if self.path.end_levels[begin] <= level {
            visit(0, self.path.end_positions()[begin]);
        }
        if self.reversed {
            samples.rev().for_each(|knot| visit(PARAM_END - knot.param, knot.position));
        } else {
            samples.for_each(|knot| visit(knot.param, knot.position));
        }
    }
}

/// What the walk asks about an arc: the encoder answers from samples, the decoder from symbols.
trait Coder {
    /// Whether the interval around `param` is split at `level`.
    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation>;
    /// The steps from the forecast to the sample.
    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation>;
    /// An upper bound on the number of intervals that will still be split.
    fn left(&self) -> usize {
        usize::MAX
    }
}

impl Path {
    /// The arc between two corners, without samples.
    pub(crate) fn new(ends: [LatticePoint; 2]) -> Self {
        let size_class = contexts::SIZE_CLASSES as u8 - 1;
        let knot = |param, position| Knot { param, level: 0, size_class, position };
        Self { knots: vec![knot(0, ends[0]), knot(PARAM_END, ends[1])], end_levels: [0; 2], is_placed: true }
    }

    /// An arc before a wanted one in a stream. Its symbols have to be read, but its corners may be unknown, so its
    /// knots get no positions. No context depends on positions.
    pub(crate) fn skipped() -> Self {
        Self { is_placed: false, ..Self::new([[0; 3]; 2]) }
    }

    /// An arc that is not needed, not even for its symbols.
    pub(crate) fn absent() -> Self {
        Self { knots: Vec::new(), end_levels: [0; 2], is_placed: false }
    }

    /// The same arc, whose corners are vertices from these levels on.
    pub(crate) fn with_end_levels(self, end_levels: [u8; 2]) -> Self {
        Self { end_levels, ..self }
    }

    /// The coarsest level at which each of its corners is a vertex.
    pub(crate) fn end_levels(&self) -> [u8; 2] {
        self.end_levels
    }

    /// Whether it is not needed: see [`Path::absent`].
    pub(crate) fn is_absent(&self) -> bool {
        self.knots.is_empty()
    }

    /// Makes room for `count` samples.
    pub(crate) fn reserve(&mut self, count: u32) {
        self.knots.reserve(count as usize);
    }

    /// Whether its knots have positions.
    pub(crate) fn is_placed(&self) -> bool {
        self.is_placed
    }

    /// The samples between the corners, by parameter.
    pub(crate) fn samples(&self) -> &[Knot] {
        self.knots.get(1..self.knots.len().saturating_sub(1)).unwrap_or(&[])
    }

    /// Positions of the corners.
    pub(crate) fn end_positions(&self) -> [LatticePoint; 2] {
        [self.knots.first(), self.knots.last()].map(|knot| knot.map_or([0; 3], |knot| knot.position))
    }

    /// Writes the new samples of a level.
    ///
    /// # Errors
    /// [`Error::Model`] if `samples`, by ascending parameter, are not what [`quantise_arcs`] returned for these
    /// corners.
    pub(crate) fn encode_level(
        &mut self,
        level: u8,
        tangent_shift: u8,
        samples: &[ArcSample],
        symbols: &mut SymbolBuffer,
    ) -> Result<()> {
        let left = samples.iter().filter(|sample| sample.level == level).count();
        self.refine(level, tangent_shift, &mut Encoder { samples, symbols, left })?;
        let present = || samples.iter().filter(|sample| sample.level <= level);
        let same = present().count() == self.samples().len()
            && present().zip(self.samples()).all(|(s, k)| s.param == k.param && s.position == k.position);
        if same { Ok(()) } else { Err(Error::model("samples are not as quantise_arcs returned them")) }
    }

    /// Reads the `count` new samples of a level.
    ///
    /// # Errors
    /// If the symbols hold fewer samples, or break a rule.
    pub(crate) fn decode_level(
        &mut self,
        level: u8,
        tangent_shift: u8,
        count: u32,
        symbols: &mut impl SymbolSource,
    ) -> Result<(), Violation> {
        let mut decoder = Decoder { symbols, left: count };
        self.refine(level, tangent_shift, &mut decoder)?;
        if decoder.left > 0 { Err(Violation(&"an arc has fewer samples than the index says")) } else { Ok(()) }
    }

    /// As [`Path::decode_level`], and records the splits, so that [`Path::repeat_level`] can repeat the level without
    /// its symbols.
    pub(crate) fn record_level(
        &mut self,
        level: u8,
        tangent_shift: u8,
        count: u32,
        symbols: &mut impl SymbolSource,
        splits: &mut Vec<Split>,
    ) -> Result<(), Violation> {
        let mut recorder = Recorder { decoder: Decoder { symbols, left: count }, splits };
        self.refine(level, tangent_shift, &mut recorder)?;
        let left = recorder.decoder.left;
        if left > 0 { Err(Violation(&"an arc has fewer samples than the index says")) } else { Ok(()) }
    }

    /// Adds the new samples of a level as [`Path::record_level`] recorded them.
    ///
    /// # Errors
    /// If the arc leaves the lattice.
    pub(crate) fn repeat_level(&mut self, level: u8, tangent_shift: u8, splits: &[Split]) -> Result<(), Violation> {
        self.refine(level, tangent_shift, &mut Repeater { splits })
    }

    /// Splits intervals as the coder says. All coarser levels have been done.
    fn refine(&mut self, level: u8, tangent_shift: u8, coder: &mut impl Coder) -> Result<(), Violation> {
        let step = (1_u64 << tangent_shift.min(MAX_TANGENT_SHIFT)) as f64;
        // Widths are powers of two, so this is a set with one bit per width.
        let mut widths = self.knots.windows(2).fold(0, |widths, pair| widths | (pair[1].param - pair[0].param));
        let mut middles = Vec::with_capacity(coder.left().min(self.knots.len()));
        while widths > 1 && coder.left() > 0 {
            let width_bits = widths.ilog2();
            let width = 1 << width_bits;
            for (i, pair) in self.knots.windows(2).enumerate() {
                let [first, second] = [&pair[0], &pair[1]];
                if second.param - first.param != width {
                    continue;
                }
                let param = first.param + width / 2;
                if coder.split(self.split_context(i, width_bits, level), param, level)? {
                    let forecast = self.forecast(i, width, level, step);
                    let residual = coder.residual(&forecast)?;
                    let size = residual[0].unsigned_abs().max(residual[1].unsigned_abs());
                    let middle = Knot {
                        param,
                        level,
                        size_class: size_class(size, contexts::SIZE_CLASSES - 2) as u8,
                        position: if self.is_placed { forecast.place(residual)? } else { [0; 3] },
                    };
                    middles.push((i, middle));
                    if coder.left() == 0 {
                        break;
                    }
                }
            }
            widths &= !width;
            if !middles.is_empty() {
                widths |= width / 2;
                self.insert(&middles);
                middles.clear();
            }
        }
        Ok(())
    }

    /// Inserts knots, each after the knot with the given index. The indices ascend.
    fn insert(&mut self, middles: &[(usize, Knot)]) {
        let mut end = self.knots.len();
        self.knots.extend(middles.iter().map(|&(_, middle)| middle));
        // From the end, so that nothing is overwritten before it has moved.
        for (already, &(before, middle)) in middles.iter().enumerate().rev() {
            let distance = already + 1;
            self.knots.copy_within(before + 1..end, before + 1 + distance);
            self.knots[before + distance] = middle;
            end = before + 1;
        }
    }

    #[inline]
    fn split_context(&self, i: usize, width_bits: u32, level: u8) -> Context {
        let width = 1 << width_bits;
        let (first, second) = (&self.knots[i], &self.knots[i + 1]);
        let before = i > 0 && first.param - self.knots[i - 1].param < width;
        let after = self.knots.get(i + 2).is_some_and(|next| next.param - second.param < width);
        let is_new = first.level == level || second.level == level;
        let depth = PARAM_END.ilog2() - width_bits;
        contexts::split(is_new && level > 0, usize::from(before) + usize::from(after), depth)
    }
}
