//! Encoding: the machine driven by the mesh that is wanted.

use std::collections::HashMap;

use super::{
    PatchLimits, REFINEMENTS,
    area::Placed,
    connectivity::{Driver, Machine, Operation},
    contexts,
    decode::{NEW, NEXT, PREVIOUS, SPLIT, UNION, place, place_level},
    geometry::Forecast,
    target::{Wavefront, following, preceding},
};
use crate::{
    codec::{
        entropy::{SymbolBuffer, context::Context},
        filling::{Quantisation, Slide},
        local_frame::{COORDINATE_LIMIT, round},
        patch::{LatticePoint, Patch},
        vector::{dot, sub},
    },
    error::Violation,
};

/// A patch to be encoded.
#[derive(Clone, Copy, Debug)]
pub struct PatchTarget<'a> {
    /// The border vertices, loop after loop, in the winding of the triangles.
    pub loops: &'a [Vec<LatticePoint>],
    /// Wanted positions of the interior vertices, in lattice units.
    pub interior: &'a [[f64; 3]],
    /// Vertex numbers as in [`Patch`]: the border first, loop after loop, then the interior.
    pub triangles: &'a [[u32; 3]],
}

/// Why a patch cannot be encoded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// The triangles do not form a manifold with the loops as its border.
    #[error("patch is not a manifold with the given border: {what} at triangle {triangle}; repair the mesh first")]
    Topology {
        /// What was found.
        what: &'static str,
        /// Index of a triangle where it was found.
        triangle: u32,
    },
    /// A position is not finite, or leaves the lattice (2^40 steps on either side).
    #[error("interior vertex {vertex} cannot be placed on the lattice; choose a larger step")]
    Position {
        /// Index in [`PatchTarget::interior`].
        vertex: u32,
    },
    /// The patch breaks a rule of the format.
    #[error("patch breaks a rule of the format: {what}")]
    Rule {
        /// The rule.
        what: &'static str,
    },
}

impl From<Violation> for EncodeError {
    fn from(violation: Violation) -> Self {
        Self::Rule { what: violation.0 }
    }
}

/// Encodes a patch: appends its symbols to `out`. Returns the patch exactly as a decoder will decode it, and the
/// `order` of its vertices: interior vertex i of the patch is interior vertex `order[i]` of the target.
/// Interior vertices are moved a few steps where a triangle would have no area on the lattice.
///
/// # Errors
/// [`EncodeError`] if the target is not a manifold bounded by its loops, or leaves the lattice. `out` is then
/// unchanged.
pub fn encode_patch(
    target: &PatchTarget,
    quantisation: Quantisation,
    slide: &dyn Slide,
    out: &mut SymbolBuffer,
) -> Result<(Patch, Vec<u32>), EncodeError> {
    encode_refined_patch(target, quantisation, 0, slide, out)
}

/// As [`encode_patch`], with a tangential step 2^`refinement` times smaller than that of the level, but not below the
/// normal step: for patches that need smaller steps than others. `refinement` is at most 3.
///
/// # Errors
/// As [`encode_patch`].
pub fn encode_refined_patch(
    target: &PatchTarget,
    quantisation: Quantisation,
    refinement: u8,
    slide: &dyn Slide,
    out: &mut SymbolBuffer,
) -> Result<(Patch, Vec<u32>), EncodeError> {
    let written = out.mark();
    let refinement = refinement.min(REFINEMENTS as u8 - 1);
    let result = Encoder::new(target, quantisation, refinement, slide, out).and_then(Encoder::run);
    if result.is_err() {
        out.truncate(written);
    }
    result
}

struct Encoder<'a> {
    target: &'a PatchTarget<'a>,
    quantisation: Quantisation,
    refinement: u8,
    slide: &'a dyn Slide,
    out: &'a mut SymbolBuffer,
    wavefront: Wavefront<'a>,
    border_count: u32,
    placed: Placed<'a>,
    /// A half-edge that leaves the vertex that the next call of `vertex` places.
    leaving: u32,
    order: Vec<u32>,
}

impl<'a> Encoder<'a> {
    fn new(
        target: &'a PatchTarget<'a>,
        quantisation: Quantisation,
        refinement: u8,
        slide: &'a dyn Slide,
        out: &'a mut SymbolBuffer,
    ) -> Result<Self, EncodeError> {
        let lengths: Vec<usize> = target.loops.iter().map(Vec::len).collect();
        let border_count = lengths.iter().sum::<usize>() as u32;
        let wavefront = Wavefront::new(target.triangles, &lengths, target.interior.len())?;
        let (placed, order) = (Placed::new(target.loops, target.interior), Vec::with_capacity(target.interior.len()));
        Ok(Self { target, quantisation, refinement, slide, out, wavefront, border_count, placed, leaving: 0, order })
    }

    fn run(mut self) -> Result<(Patch, Vec<u32>), EncodeError> {
        let limits = PatchLimits { vertices: u64::MAX, triangles: u64::MAX };
        let patch = Machine::run(self.target.loops, limits, &mut self)?;
        if self.order.len() != self.target.interior.len() {
            return Err(EncodeError::Rule { what: "an interior vertex has no triangle" });
        }
        Ok((patch, self.order))
    }

    /// Interior vertex `vertex` (counted with the border) becomes the patch's next one.
    fn take(&mut self, vertex: u32) -> u32 {
        let interior = vertex - self.border_count;
        self.order.push(interior);
        interior
    }
}

/// The operation that reaches the active slot `far` from the gate.
fn locate(machine: &Machine, gate: u32, far: u32) -> Result<Operation, EncodeError> {
    let slots = &machine.slots;
    let (mut forward, mut backward) = (slots[gate as usize].next, gate);
    for distance in 0..=(machine.length as i64 - 1) / 2 {
        if forward == far {
            return Ok(Operation::Split { offset: distance });
        }
        if backward == far {
            return Ok(Operation::Split { offset: -distance });
        }
        forward = slots[forward as usize].next;
        backward = slots[backward as usize].previous;
    }
    // So it is in another loop: walk from `far` in both directions until the gate of a pending loop is met.
    let gates: HashMap<u32, u64> = machine.pending.iter().rev().map(|p| p.gate).zip(0..).collect();
    let (mut forward, mut backward) = (far, far);
    for distance in 0..=slots.len() as i64 {
        // A gate met backward lies before `far`: the offset from it is positive.
        if let Some(&index) = gates.get(&backward) {
            return Ok(Operation::Union { index, offset: distance });
        }
        if let Some(&index) = gates.get(&forward) {
            return Ok(Operation::Union { index, offset: -distance });
        }
        forward = slots[forward as usize].next;
        backward = slots[backward as usize].previous;
    }
    Err(EncodeError::Rule { what: "a vertex is on no active loop" })
}

impl Driver for Encoder<'_> {
    type Error = EncodeError;

    fn closed_components(&mut self) -> Result<u64, EncodeError> {
        let count = self.wavefront.closed_components();
        self.out.put(contexts::HEAD, count * REFINEMENTS + u64::from(self.refinement));
        self.quantisation = self.quantisation.refined(self.refinement);
        Ok(count)
    }

    fn seed(&mut self, machine: &Machine) -> Result<[LatticePoint; 3], EncodeError> {
        let half_edges = self.wavefront.seed(machine.slots.len() as u32)?;
        let mut corners = [[0; 3]; 3];
        let step = self.quantisation.steps().0;
        let mut last = machine.seed_reference();
        for (corner, half_edge) in corners.iter_mut().zip(half_edges) {
            let number = self.wavefront.origin(half_edge);
            let vertex = self.take(number);
            let wanted = self.target.interior[vertex as usize];
            let residual = [0, 1, 2].map(|k| round((wanted[k] - last[k] as f64) / step) as i64);
            let moved = |residual: [i64; 3]| {
                let moved = [0, 1, 2].map(|k| last[k] as f64 + residual[k] as f64 * step);
                moved.iter().all(|x| x.abs() <= COORDINATE_LIMIT).then(|| moved.map(|x| x as i64))
            };
            let is_finite = wanted.iter().all(|x| x.is_finite());
            let placed =
                self.placed.place(number, self.wavefront.around(half_edge), residual, moved).filter(|_| is_finite);
            let (residual, point) = placed.ok_or(EncodeError::Position { vertex })?;
            for component in residual {
                self.out.put_signed(contexts::SEED, component);
            }
            (*corner, last) = (point, point);
        }
        Ok(corners)
    }

    fn operation(&mut self, machine: &Machine, gate: u32, context: Context) -> Result<Operation, EncodeError> {
        let front = &mut self.wavefront;
        let half_edge = front.enter(gate)?;
        let (ahead, behind) = (following(half_edge), preceding(half_edge));
        let (after, before) = (machine.slots[gate as usize].next, machine.slots[gate as usize].previous);
        if front.is_edge_of(ahead, after) {
            front.bind(gate, behind);
            self.out.put(context, NEXT);
            return Ok(Operation::Next);
        }
        if front.is_edge_of(behind, before) {
            front.bind(before, ahead);
            self.out.put(context, PREVIOUS);
            return Ok(Operation::Previous);
        }
        let c = front.origin(behind);
        let operation = if front.reach(c) {
            self.out.put(context, NEW);
            self.take(c);
            self.leaving = behind;
            Operation::New
        } else {
            // Neither edge of the triangle at c is active, so the slot of c is found by way of the triangles beyond.
            let operation = locate(machine, gate, front.active_slot(behind)?)?;
            match operation {
                Operation::Split { offset } => {
                    self.out.put(context, SPLIT);
                    self.out.put_signed(contexts::SPLIT, if offset > 0 { offset - 2 } else { offset + 1 });
                }
                Operation::Union { index, offset } => {
                    self.out.put(context, UNION);
                    self.out.put(contexts::UNION_LOOP, index);
                    self.out.put_signed(contexts::UNION, offset);
                }
                _ => {}
            }
            operation
        };
        self.wavefront.bind(gate, behind);
        self.wavefront.bind(machine.slots.len() as u32, ahead);
        Ok(operation)
    }

    fn vertex(&mut self, forecast: &Forecast) -> Result<LatticePoint, EncodeError> {
        let number = self.wavefront.origin(self.leaving);
        let vertex = number - self.border_count;
        let (normal_step, tangent_step) = self.quantisation.steps();
        let wanted = sub(self.target.interior[vertex as usize], forecast.point);
        let frame = &forecast.frame;
        let along = round(dot(wanted, frame.along) / tangent_step);
        let across = round(dot(wanted, frame.across) / tangent_step);
        let mut residual = [along as i64, across as i64, 0];
        let point = place_level(forecast, residual, self.quantisation);
        let offset = self.slide.offset(vertex, point, frame.normal);
        residual[2] = round(offset / normal_step) as i64;
        // Twice the size of the lattice suffices for the residual between any two of its points. NaN fails, too.
        let reach = 4.0 * COORDINATE_LIMIT;
        let is_near = along.abs() <= reach && across.abs() <= reach && offset.abs() <= reach;
        if !is_near {
            return Err(EncodeError::Position { vertex });
        }
        let place = |residual| place(forecast, residual, self.quantisation);
        let around = self.wavefront.around(self.leaving);
        let placed = self.placed.place(number, around, residual, place);
        let (residual, placed) = placed.ok_or(EncodeError::Position { vertex })?;
        for (component, context) in residual.into_iter().zip(forecast.contexts(self.quantisation.steps())) {
            self.out.put_signed(context, component);
        }
        Ok(placed)
    }

    fn close(&mut self, machine: &Machine, slot: u32) -> Result<(), EncodeError> {
        self.wavefront.close(slot, machine.slots[slot as usize].next)
    }
}
