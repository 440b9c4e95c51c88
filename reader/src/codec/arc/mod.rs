//! Arcs: chains of samples at dyadic parameters between two corners, nested level by level (SPEC.md, "Arcs").
//!
//! An arc's parameter runs from 0 (its first corner) to 65536 (its second). At each level every interval between
//! neighbouring samples may be split at its middle; the halves are examined again at the same level. Intervals are visited
//! by length, longest first, and by parameter among equals. The index says how many samples a level adds: once these are there,
//! no flags follow. The middle is forecast from the samples around it and corrected
//! by a residual in a local frame.
//!
//! Encoder, quantiser and decoder run the same walk ([`Path::refine`]) with another [`Coder`], so they cannot drift apart.

pub(crate) mod contexts;

use crate::{
    codec::{
        entropy::{SymbolBuffer, SymbolSource, context::Context},
        local_frame::{AXES, Frame, round, to_lattice},
        patch::LatticePoint,
        vector::{Vec3, add, dot, scale, sub, to_f64},
    },
    error::{Error, Result, Violation},
};

/// Parameter of an arc's second corner.
pub const PARAM_END: u32 = 1 << 16;

/// Largest `tangent_shift`.
pub const MAX_TANGENT_SHIFT: u8 = 40;

/// A sample of an arc as it is stored: what [`quantise_arcs`] returns and a model holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ArcSample {
    /// Position along the arc in 1/65536: 1 to 65535.
    pub param: u32,
    /// The coarsest level at which the sample belongs to the arc.
    pub level: u8,
    /// Where the decoder will put it.
    pub position: LatticePoint,
    /// Steps from the forecast: across, across, along.
    pub(crate) residual: [i64; 3],
}

/// A sample that an arc should have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WantedSample {
    /// Position along the arc in 1/65536: 1 to 65535.
    pub param: u32,
    /// The coarsest level at which the sample belongs to the arc. The middle of an interval has no coarser level than the
    /// interval's ends.
    pub level: u8,
    /// Wanted position in lattice units.
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

/// Where arcs' samples will be once decoded: the builder fits everything else to these. `tangent_shift` is the model's: the
/// step along an arc is 2^tangent_shift lattice steps.
///
/// # Errors
/// [`Error::Model`] where an arc's ends do not exist, its samples are not nested, or positions leave the lattice.
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

/// [`quantise_arcs`] for one arc between two corner positions.
///
/// # Errors
/// [`Error::Model`] where the samples are not nested or positions leave the lattice.
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

/// A known point of an arc.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Knot {
    /// 0 to [`PARAM_END`].
    pub param: u32,
    /// Level from which on it belongs to the arc; 0 for corners.
    pub level: u8,
    /// Size class of its residual.
    size_class: u8,
    /// Its place.
    pub position: LatticePoint,
}

/// An arc as far as it is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Path {
    knots: Vec<Knot>,
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
        1 + self.path.samples().iter().filter(|knot| knot.level <= level).count()
    }

    /// Visits the corner where it begins, then the samples that belong to it at a level, in its direction. Parameters run from 0
    /// at that corner to [`PARAM_END`], which is not visited.
    #[inline]
    pub(crate) fn walk(&self, level: u8, mut visit: impl FnMut(u32, LatticePoint)) {
        let samples = self.path.samples().iter().filter(|knot| knot.level <= level);
        visit(0, self.path.end_positions()[usize::from(self.reversed)]);
        if self.reversed {
            samples.rev().for_each(|knot| visit(PARAM_END - knot.param, knot.position));
        } else {
            samples.for_each(|knot| visit(knot.param, knot.position));
        }
    }
}

/// The forecast for the middle of an interval.
struct Forecast {
    param: u32,
    level: u8,
    point: Vec3,
    /// Its normal is the direction of the arc.
    frame: Frame,
    /// Length of a step along the arc.
    step: f64,
    size_class: usize,
}

/// One direction of coding.
trait Coder {
    /// Whether the interval around `param` is split at `level`.
    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation>;
    /// Steps from the forecast to the sample.
    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation>;
    /// At most how many intervals will still be split.
    fn left(&self) -> usize {
        usize::MAX
    }
}

impl Path {
    /// The arc between two corners, without samples.
    pub(crate) fn new(ends: [LatticePoint; 2]) -> Self {
        let size_class = contexts::SIZE_CLASSES as u8 - 1;
        let knot = |param, position| Knot { param, level: 0, size_class, position };
        Self { knots: vec![knot(0, ends[0]), knot(PARAM_END, ends[1])], is_placed: true }
    }

    /// An arc that lies before a wanted one in a stream: its symbols are read, but its corners may be unknown and its knots
    /// get no positions. No context depends on these.
    pub(crate) fn skipped() -> Self {
        Self { is_placed: false, ..Self::new([[0; 3]; 2]) }
    }

    /// An arc of which nothing is needed, not even its symbols.
    pub(crate) fn absent() -> Self {
        Self { knots: Vec::new(), is_placed: false }
    }

    /// Whether nothing is needed of it: see [`Path::absent`].
    pub(crate) fn is_absent(&self) -> bool {
        self.knots.is_empty()
    }

    /// Makes room for so many samples.
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

    /// Writes a level's new samples.
    ///
    /// # Errors
    /// [`Error::Model`] where `samples`, by ascending parameter, are not what [`quantise_arcs`] returned for these corners.
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

    /// Reads a level's new samples, of which there are `count`.
    ///
    /// # Errors
    /// Where there are more or fewer, or a rule is broken.
    pub(crate) fn decode_level(
        &mut self,
        level: u8,
        tangent_shift: u8,
        count: u32,
        symbols: &mut impl SymbolSource,
    ) -> Result<(), Violation> {
        let mut decoder = Decoder { symbols, left: count };
        self.refine(level, tangent_shift, &mut decoder)?;
        if decoder.left > 0 { Err(Violation(&"an arc has fewer samples than its index says")) } else { Ok(()) }
    }

    /// [`Path::decode_level`] that notes the splits, so that the level can be repeated without its symbols.
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
        if left > 0 { Err(Violation(&"an arc has fewer samples than its index says")) } else { Ok(()) }
    }

    /// Takes a level's new samples as [`Path::record_level`] noted them.
    ///
    /// # Errors
    /// Where the arc leaves the lattice.
    pub(crate) fn repeat_level(&mut self, level: u8, tangent_shift: u8, splits: &[Split]) -> Result<(), Violation> {
        self.refine(level, tangent_shift, &mut Repeater { splits })
    }

    /// Splits intervals as the coder says: all levels before this one are done.
    fn refine(&mut self, level: u8, tangent_shift: u8, coder: &mut impl Coder) -> Result<(), Violation> {
        let step = (1_u64 << tangent_shift.min(MAX_TANGENT_SHIFT)) as f64;
        // Powers of two: a bit for each width that there is.
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

    /// Inserts knots, each after the one with the given index, which ascend.
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

    /// Forecast for the middle of the interval after knot `i`: with p and q its ends, o the knot one interval length
    /// before p and r the one after q, where these are knots, (9 (p + q) - (o + r)) / 16, or (6 p + 3 q - o) / 8, or
    /// (6 q + 3 p - r) / 8, or (p + q) / 2. Its frame's normal has the direction of q - p, its direction is the coordinate
    /// axis along which |q - p| is smallest, the first of equals. With residual (a, b, c) the sample lies at
    /// forecast + along * a + across * b + normal * (c * step), summed in this order, then rounded.
    ///
    /// Its size class is the bit length of max(|a|, |b|), at most 6, of the end whose parameter has fewer trailing zero
    /// bits, which is the middle of the interval above; 7 where that is a corner.
    #[inline]
    fn forecast(&self, i: usize, width: u32, level: u8, step: f64) -> Forecast {
        let (first, second) = (self.knots[i], self.knots[i + 1]);
        // The end that came later is the middle of the interval above this one.
        let above = if first.param.trailing_zeros() < second.param.trailing_zeros() { first } else { second };
        let (param, size_class) = (first.param + width / 2, usize::from(above.size_class));
        if !self.is_placed {
            return Forecast { param, level, point: [0.0; 3], frame: AXES, step, size_class };
        }
        let (p, q) = (to_f64(first.position), to_f64(second.position));
        // Most are neighbours in the list.
        let at = |param: Option<u32>, neighbour: Option<usize>| {
            let next = self.knots.get(neighbour?)?;
            if next.param == param? {
                return Some(to_f64(next.position));
            }
            let index = self.knots.binary_search_by_key(&param?, |knot| knot.param).ok()?;
            Some(to_f64(self.knots[index].position))
        };
        let point =
            match (at(first.param.checked_sub(width), i.checked_sub(1)), at(Some(second.param + width), Some(i + 2))) {
                (Some(o), Some(r)) => scale(sub(scale(add(p, q), 9.0), add(o, r)), 0.0625),
                (Some(o), None) => scale(sub(add(scale(p, 6.0), scale(q, 3.0)), o), 0.125),
                (None, Some(r)) => scale(sub(add(scale(q, 6.0), scale(p, 3.0)), r), 0.125),
                (None, None) => scale(add(p, q), 0.5),
            };
        let chord = sub(q, p);
        let mut flattest = 0;
        for axis in 1..3 {
            if chord[axis].abs() < chord[flattest].abs() {
                flattest = axis;
            }
        }
        // Written out: a number stored alone and loaded with its neighbour is waited for.
        let [x, y, z] = [flattest == 0, flattest == 1, flattest == 2];
        let direction = [f64::from(u8::from(x)), f64::from(u8::from(y)), f64::from(u8::from(z))];
        Forecast { param, level, point, frame: Frame::new(chord, direction), step, size_class }
    }
}

impl Forecast {
    /// The lattice point at `residual` steps from the forecast.
    fn place(&self, residual: [i64; 3]) -> Result<LatticePoint, Violation> {
        let (a, b, along) = (residual[0] as f64, residual[1] as f64, residual[2] as f64);
        to_lattice(self.frame.lift(self.frame.slide(self.point, a, b), along * self.step))
            .ok_or(Violation(&"an arc leaves the lattice"))
    }

    /// Contexts of the second component depend on the first one.
    fn contexts(&self, first: i64) -> [Context; 3] {
        let second_class = size_class(first.unsigned_abs(), contexts::SIZE_CLASSES - 1);
        [
            contexts::residual(0, self.size_class),
            contexts::residual(1, second_class),
            contexts::residual(2, self.size_class),
        ]
    }
}

/// Bit length of a magnitude, at most `most`.
fn size_class(magnitude: u64, most: usize) -> usize {
    (magnitude.checked_ilog2().map_or(0, |bits| bits + 1) as usize).min(most)
}

/// Finds the residuals that come closest to what is wanted.
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
        let index = found.map_err(|_| Violation(&"an arc has no such sample"))?;
        let wanted = sub(self.wanted[index].position, forecast.point);
        let frame = &forecast.frame;
        let steps = [dot(wanted, frame.along), dot(wanted, frame.across), dot(wanted, frame.normal) / forecast.step];
        let residual = steps.map(|x| round(x) as i64);
        let (param, level) = (forecast.param, forecast.level);
        self.samples.push(ArcSample { param, level, position: [0; 3], residual });
        Ok(residual)
    }
}

/// Writes known residuals.
struct Encoder<'a> {
    samples: &'a [ArcSample],
    symbols: &'a mut SymbolBuffer,
    left: usize,
}

impl Coder for Encoder<'_> {
    fn left(&self) -> usize {
        self.left
    }

    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation> {
        if self.left == 0 {
            return Ok(false);
        }
        let found = self.samples.binary_search_by_key(&param, |sample| sample.param);
        let split = found.is_ok_and(|index| self.samples[index].level == level);
        self.symbols.put(context, u64::from(split));
        self.left -= usize::from(split);
        Ok(split)
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let found = self.samples.binary_search_by_key(&forecast.param, |sample| sample.param);
        let index = found.map_err(|_| Violation(&"an arc has no such sample"))?;
        let residual = self.samples[index].residual;
        for (context, steps) in forecast.contexts(residual[0]).into_iter().zip(residual) {
            self.symbols.put_signed(context, steps);
        }
        Ok(residual)
    }
}

/// Reads residuals.
struct Decoder<'a, S> {
    symbols: &'a mut S,
    left: u32,
}

impl<S: SymbolSource> Coder for Decoder<'_, S> {
    fn left(&self) -> usize {
        self.left as usize
    }

    fn split(&mut self, context: Context, _param: u32, _level: u8) -> Result<bool, Violation> {
        if self.left == 0 {
            return Ok(false);
        }
        match self.symbols.get(context)? {
            0 => Ok(false),
            1 => {
                self.left -= 1;
                Ok(true)
            }
            _ => Err(Violation(&"an arc's split flag is above 1")),
        }
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let first = self.symbols.get_signed(forecast.contexts(0)[0])?;
        let contexts = forecast.contexts(first);
        Ok([first, self.symbols.get_signed(contexts[1])?, self.symbols.get_signed(contexts[2])?])
    }
}

/// A sample as it was decoded, without its place in space.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Split {
    param: u32,
    residual: [i64; 3],
}

/// Reads residuals and notes them.
struct Recorder<'a, S> {
    decoder: Decoder<'a, S>,
    splits: &'a mut Vec<Split>,
}

impl<S: SymbolSource> Coder for Recorder<'_, S> {
    fn left(&self) -> usize {
        self.decoder.left()
    }

    fn split(&mut self, context: Context, param: u32, level: u8) -> Result<bool, Violation> {
        self.decoder.split(context, param, level)
    }

    fn residual(&mut self, forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let residual = self.decoder.residual(forecast)?;
        self.splits.push(Split { param: forecast.param, residual });
        Ok(residual)
    }
}

/// Gives residuals that were noted.
struct Repeater<'a> {
    splits: &'a [Split],
}

impl Coder for Repeater<'_> {
    fn left(&self) -> usize {
        self.splits.len()
    }

    fn split(&mut self, _context: Context, param: u32, _level: u8) -> Result<bool, Violation> {
        Ok(self.splits.first().is_some_and(|split| split.param == param))
    }

    fn residual(&mut self, _forecast: &Forecast) -> Result<[i64; 3], Violation> {
        let Some((split, rest)) = self.splits.split_first() else {
            return Err(Violation(&"an arc has fewer samples than its index says"));
        };
        self.splits = rest;
        Ok(split.residual)
    }
}

/// Writes a corner as the difference to the corner before it.
pub(crate) fn encode_corner(position: LatticePoint, before: LatticePoint, symbols: &mut SymbolBuffer) {
    for axis in 0..3 {
        symbols.put_signed(contexts::CORNER + axis as Context, position[axis] - before[axis]);
    }
}

/// Reads a corner.
///
/// # Errors
/// [`Error::Format`] where it leaves the lattice.
pub(crate) fn decode_corner(before: LatticePoint, symbols: &mut impl SymbolSource) -> Result<LatticePoint> {
    let mut position = before;
    for axis in 0..3 {
        let step = symbols.get_signed(contexts::CORNER + axis as Context)?;
        position[axis] = before[axis]
            .checked_add(step)
            .filter(|x| x.unsigned_abs() <= 1 << 40)
            .ok_or_else(|| Error::format("a corner leaves the lattice"))?;
    }
    Ok(position)
}

#[cfg(test)]
mod tests;
