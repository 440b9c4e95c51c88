//! The cut-border machine: which triangle comes next, and how the active loops change.
//!
//! The machine follows Gumhold and Strasser, "Real time compression of triangle mesh connectivity" (1998), with the
//! geometric contexts of later angle coders (Kaelberer et al., "FreeLence", 2005). Encoder and decoder run the same
//! code, each with its own [`Driver`], so they cannot drift apart.
//!
//! An active loop surrounds a part of the surface that is still unknown and lies to its left. The machine asks for the
//! triangle to the left of one of its edges, the gate. The answer is an [`Operation`].

use super::geometry::{self, Angle, Forecast};
use crate::{
    codec::{
        entropy::context::Context,
        patch::{LatticePoint, Patch},
        vector::{Vec3, add, cross, scale, sub, to_f64},
    },
    error::Violation,
};

/// "No vertex", "no slot".
pub(super) const NONE: u32 = u32::MAX;

/// The most vertices of a patch. With at most 2^32 / 3 triangles, slot numbers fit 32 bits: each slot belongs to a new
/// vertex, or to the triangle of a Split or Union.
const VERTEX_LIMIT: u64 = 1 << 31;

/// The third vertex of the triangle to the left of the gate a -> b.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Operation {
    /// A vertex that is on no active loop.
    New,
    /// The vertex after b.
    Next,
    /// The vertex before a.
    Previous,
    /// Another vertex of the same loop: `offset` > 0 counts from b forward (at least 2), < 0 from a backward (at most
    /// -2).
    Split { offset: i64 },
    /// A vertex of a pending loop, `index` places below the top of the stack and `offset` slots from its gate's start.
    Union { index: u64, offset: i64 },
}

/// Makes the machine's decisions: from a stream of symbols, or from the mesh that is encoded.
pub(super) trait Driver {
    /// The error of a decision.
    type Error: From<Violation>;
    /// The number of components without a border.
    fn closed_components(&mut self) -> Result<u64, Self::Error>;
    /// The corners of a closed component's first triangle.
    fn seed(&mut self, machine: &Machine) -> Result<[LatticePoint; 3], Self::Error>;
    /// What lies to the left of the edge that starts at slot `gate`. `context` is the context of the operation's code.
    fn operation(&mut self, machine: &Machine, gate: u32, context: Context) -> Result<Operation, Self::Error>;
    /// The position of the new vertex, after [`Operation::New`].
    fn vertex(&mut self, forecast: &Forecast) -> Result<LatticePoint, Self::Error>;
    /// A loop of two edges is about to close: `slot` and the slot after it.
    fn close(&mut self, machine: &Machine, slot: u32) -> Result<(), Self::Error>;
}

/// A vertex on an active loop, together with the edge to the next one. A vertex may have several slots.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slot {
    /// The vertex, counted as in [`Patch`].
    pub vertex: u32,
    /// The slot after this one.
    pub next: u32,
    /// The slot before this one.
    pub previous: u32,
    /// The third vertex of the triangle to the right of the edge to the next slot; [`NONE`] on the border of the patch.
    pub outer: u32,
    /// [`geometry::pseudo_angle`] at this slot when one of its edges last changed.
    pub angle: Angle,
}

/// A vertex.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    /// Its position.
    pub position: Vec3,
    /// The sum of the area vectors of the decoded triangles around it.
    pub normal: Vec3,
}

/// A loop that waits for its turn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pending {
    /// The slot whose edge will be its first gate.
    pub gate: u32,
    /// The number of its slots.
    pub length: u64,
}

/// The state that encoder and decoder share.
#[derive(Clone, Debug, Default)]
pub(crate) struct Machine {
    /// All slots that were ever made. Those that have left their loop are never reached again.
    pub slots: Vec<Slot>,
    /// All vertices so far.
    pub vertices: Vec<Vertex>,
    /// The loops that wait; the last one is next.
    pub pending: Vec<Pending>,
    /// The length of the current loop; 0 if there is none.
    pub length: u64,
    /// Its gate.
    gate: u32,
    /// Components without a border that are still to come.
    closed: u64,
    limits: PatchLimits,
    /// The number of slots that Splits and Unions have walked over.
    walked: u64,
    patch: Patch,
}

/// The largest counts that a patch may have. Decoding ends with an error as soon as it exceeds one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PatchLimits {
    /// Border and interior vertices together.
    pub vertices: u64,
    /// Triangles.
    pub triangles: u64,
}

impl Machine {
    /// Runs `driver` from the border loops until nothing unknown is left.
    pub(super) fn run<D: Driver>(
        loops: &[Vec<LatticePoint>],
        limits: PatchLimits,
        driver: &mut D,
    ) -> Result<Patch, D::Error> {
        let mut machine = Self::default();
        machine.begin(loops, limits, driver)?;
        while machine.advance(driver)? {}
        Ok(machine.take_patch())
    }

    /// Begins with the border loops. The memory of an earlier run is used again.
    pub(super) fn begin<D: Driver>(
        &mut self,
        loops: &[Vec<LatticePoint>],
        limits: PatchLimits,
        driver: &mut D,
    ) -> Result<(), D::Error> {
        self.limits = limits;
        self.start(loops)?;
        self.closed = driver.closed_components()?;
        Ok(())
    }

    /// Works until the next triangle is decoded. Returns whether there is more to come.
    pub(super) fn advance<D: Driver>(&mut self, driver: &mut D) -> Result<bool, D::Error> {
        if self.length > 2 {
            let gate = self.sharpest_gate(self.gate);
            let context = geometry::operation_context(self, gate);
            let operation = driver.operation(self, gate, context)?;
            self.gate = self.apply(gate, operation, driver)?;
            return Ok(true);
        }
        if self.length > 0 {
            // The two edges that are left are the two sides of one edge.
            driver.close(self, self.gate)?;
        }
        if let Some(Pending { gate, length }) = self.pending.pop() {
            (self.gate, self.length) = (gate, length);
            return Ok(true);
        }
        self.length = 0;
        if self.closed == 0 {
            return Ok(false);
        }
        self.closed -= 1;
        let corners = driver.seed(self)?;
        self.start_component(corners)?;
        Ok(true)
    }

    /// Takes the decoded patch.
    pub(super) fn take_patch(&mut self) -> Patch {
        std::mem::take(&mut self.patch)
    }

    /// Pushes all border loops, the first on top, each with the edge from its first vertex as gate.
    fn start(&mut self, loops: &[Vec<LatticePoint>]) -> Result<(), Violation> {
        self.slots.clear();
        self.vertices.clear();
        self.pending.clear();
        (self.length, self.walked, self.patch) = (0, 0, Patch::default());
        self.reserve(loops);
        for border in loops {
            if border.len() < 3 {
                return Err(Violation(&"a border loop has fewer than three samples"));
            }
            if (self.slots.len() + border.len()) as u64 > self.limits.vertices.min(VERTEX_LIMIT) {
                return Err(Violation(&"more border samples than vertices are allowed"));
            }
            let (first, count) = (self.slots.len() as u32, border.len() as u32);
            // So small that it counts only until the first triangle.
            let area = scale(geometry::polygon_area_vector(border), 1.0 / (1u64 << 20) as f64);
            for (k, &point) in (0..).zip(border) {
                self.slots.push(Slot {
                    vertex: first + k,
                    next: if k + 1 == count { first } else { first + k + 1 },
                    previous: if k == 0 { first + count - 1 } else { first + k - 1 },
                    outer: NONE,
                    angle: Angle::default(),
                });
                self.push_vertex(to_f64(point), area);
            }
            for slot in first..first + count {
                self.measure(slot);
            }
            self.pending.push(Pending { gate: first, length: u64::from(count) });
        }
        self.pending.reverse();
        self.patch.border_count = self.slots.len() as u32;
        Ok(())
    }

    /// Makes room for a disk with the triangles that the index gives, so that little has to be moved. A large count may
    /// be a lie.
    fn reserve(&mut self, loops: &[Vec<LatticePoint>]) {
        const MOST: u64 = 1 << 16;
        if self.limits.triangles > MOST {
            return;
        }
        let triangles = self.limits.triangles as usize;
        let border: usize = loops.iter().map(Vec::len).sum();
        // Euler: a disk has two triangles per inner vertex, and one more per border vertex.
        let inner = triangles.saturating_sub(border) / 2 + 1;
        self.patch.triangles.reserve(triangles);
        self.patch.interior.reserve(inner);
        self.slots.reserve(border + inner);
        self.vertices.reserve(border + inner);
    }

    #[inline]
    fn push_vertex(&mut self, position: Vec3, normal: Vec3) -> u32 {
        self.vertices.push(Vertex { position, normal });
        self.vertices.len() as u32 - 1
    }

    #[inline]
    fn push_interior(&mut self, point: LatticePoint) -> Result<u32, Violation> {
        if self.vertices.len() as u64 >= self.limits.vertices.min(VERTEX_LIMIT) {
            return Err(Violation(&"a patch has more vertices than are allowed"));
        }
        self.patch.interior.push(point);
        Ok(self.push_vertex(to_f64(point), [0.0; 3]))
    }

    /// Inline, so that the corners stay in registers: storing them one by one and loading them together would stall the
    /// processor.
    #[inline(always)]
    fn push_triangle(&mut self, corners: [u32; 3]) -> Result<(), Violation> {
        let [a, b, c] = corners;
        if a == b || b == c || c == a {
            return Err(Violation(&"a triangle has the same vertex twice"));
        }
        if self.patch.triangles.len() as u64 >= self.limits.triangles.min(u64::from(NONE / 3)) {
            return Err(Violation(&"a patch has more triangles than are allowed"));
        }
        self.patch.triangles.push([a, b, c]);
        let position = |v: u32| self.vertices[v as usize].position;
        let area = cross(sub(position(b), position(a)), sub(position(c), position(a)));
        let mut raise = |v: u32| {
            let sum = &mut self.vertices[v as usize].normal;
            *sum = add(*sum, area);
        };
        raise(a);
        raise(b);
        raise(c);
        Ok(())
    }

    /// Begins a closed component with a triangle. The loop around it, a, c, b, becomes the only pending one.
    fn start_component(&mut self, corners: [LatticePoint; 3]) -> Result<(), Violation> {
        let a = self.push_interior(corners[0])?;
        let b = self.push_interior(corners[1])?;
        let c = self.push_interior(corners[2])?;
        self.push_triangle([a, b, c])?;
        let first = self.slots.len() as u32;
        for (k, vertex, outer) in [(0, a, b), (1, c, a), (2, b, c)] {
            let (next, previous) = (first + (k + 1) % 3, first + (k + 2) % 3);
            self.slots.push(Slot { vertex, next, previous, outer, angle: Angle::default() });
        }
        for slot in first..first + 3 {
            self.measure(slot);
        }
        self.pending.push(Pending { gate: first, length: 3 });
        Ok(())
    }

    /// The edge that ends at the sharpest of five corners of the loop: the end of the edge `gate`, and two corners on
    /// either side.
    ///
    /// Most sharp corners are closed by a single triangle, so the operation there is easy to predict, and loops rarely
    /// split. Searching the whole loop would save one percent more.
    #[inline]
    fn sharpest_gate(&self, gate: u32) -> u32 {
        let here = self.slots[gate as usize];
        let after = self.slots[here.next as usize];
        let beyond = self.slots[after.next as usize];
        let farthest = self.slots[beyond.next as usize];
        let before = self.slots[here.previous as usize];
        let others = [
            (beyond.angle, here.next),
            (here.angle, here.previous),
            (farthest.angle, after.next),
            (before.angle, before.previous),
        ];
        // The first of equals.
        let sharper = |best: (Angle, u32), other: (Angle, u32)| if other.0 < best.0 { other } else { best };
        others.into_iter().fold((after.angle, gate), sharper).1
    }

    /// Measures a slot's angle anew.
    fn measure(&mut self, slot: u32) {
        let Slot { next, previous, .. } = self.slots[slot as usize];
        self.measure_between(slot, self.slots[next as usize].vertex, self.slots[previous as usize].vertex);
    }

    /// As [`Machine::measure`], where the vertices of the slots after and before it are known.
    #[inline]
    fn measure_between(&mut self, slot: u32, next: u32, previous: u32) {
        let slot = &mut self.slots[slot as usize];
        let position = |vertex: u32| &self.vertices[vertex as usize].position;
        let at = &self.vertices[slot.vertex as usize];
        slot.angle = geometry::pseudo_angle(at, position(next), position(previous));
    }

    /// Adds the triangle at the gate and returns the next gate.
    fn apply<D: Driver>(&mut self, gate: u32, operation: Operation, driver: &mut D) -> Result<u32, D::Error> {
        let Slot { vertex: a, next: after, previous: before, .. } = self.slots[gate as usize];
        let Slot { vertex: b, next: beyond, .. } = self.slots[after as usize];
        match operation {
            Operation::New => {
                let forecast = geometry::forecast(self, gate);
                let point = driver.vertex(&forecast)?;
                let c = self.push_interior(point)?;
                self.push_triangle([a, b, c])?;
                let slot = self.slots.len() as u32;
                self.slots.push(Slot { vertex: c, next: after, previous: gate, outer: a, angle: Angle::default() });
                let edge = &mut self.slots[gate as usize];
                (edge.next, edge.outer) = (slot, b);
                self.slots[after as usize].previous = slot;
                self.length += 1;
                self.measure_between(gate, c, self.slots[before as usize].vertex);
                self.measure_between(slot, b, a);
                self.measure_between(after, self.slots[beyond as usize].vertex, c);
                Ok(slot)
            }
            Operation::Next => {
                let Slot { vertex: c, next: farthest, .. } = self.slots[beyond as usize];
                self.push_triangle([a, b, c])?;
                let edge = &mut self.slots[gate as usize];
                (edge.next, edge.outer) = (beyond, b);
                self.slots[beyond as usize].previous = gate;
                self.length -= 1;
                self.measure_between(gate, c, self.slots[before as usize].vertex);
                self.measure_between(beyond, self.slots[farthest as usize].vertex, a);
                Ok(gate)
            }
            Operation::Previous => {
                let Slot { vertex: c, previous: farthest, .. } = self.slots[before as usize];
                self.push_triangle([c, a, b])?;
                let edge = &mut self.slots[before as usize];
                (edge.next, edge.outer) = (after, a);
                self.slots[after as usize].previous = before;
                self.length -= 1;
                self.measure_between(before, b, self.slots[farthest as usize].vertex);
                self.measure_between(after, self.slots[beyond as usize].vertex, c);
                Ok(before)
            }
            Operation::Split { offset } => {
                let distance = offset.unsigned_abs();
                // Next and Previous are operations of their own, and the walk takes the shorter way. So both parts have
                // at least three slots.
                if distance < 2 || distance > (self.length - 1) / 2 {
                    return Err(Violation(&"a loop is split at an offset outside it").into());
                }
                let far = self.walk(if offset > 0 { after } else { gate }, offset)?;
                let slot = self.bridge(gate, far)?;
                // The loop of `slot` and b is the current one; that of a waits.
                let ahead = if offset > 0 { distance } else { self.length - 1 - distance };
                self.pending.push(Pending { gate, length: self.length - ahead });
                self.length = ahead + 1;
                Ok(slot)
            }
            Operation::Union { index, offset } => {
                let place = usize::try_from(index).ok().and_then(|i| self.pending.len().checked_sub(1)?.checked_sub(i));
                let Some(place) = place else {
                    return Err(Violation(&"a loop is joined to one that does not exist").into());
                };
                let other = self.pending.swap_remove(place);
                if offset.unsigned_abs() > other.length / 2 {
                    return Err(Violation(&"a loop is joined at an offset outside the other one").into());
                }
                let far = self.walk(other.gate, offset)?;
                let slot = self.bridge(gate, far)?;
                self.length += other.length + 1;
                Ok(slot)
            }
        }
    }

    /// Adds the triangle from the gate to a vertex that stays active: its slot `far` follows a, and a second slot
    /// precedes b.
    fn bridge(&mut self, gate: u32, far: u32) -> Result<u32, Violation> {
        let Slot { vertex: a, next: after, .. } = self.slots[gate as usize];
        let b = self.slots[after as usize].vertex;
        let Slot { vertex: c, previous: behind, .. } = self.slots[far as usize];
        self.push_triangle([a, b, c])?;
        let slot = self.slots.len() as u32;
        self.slots.push(Slot { vertex: c, next: after, previous: behind, outer: a, angle: Angle::default() });
        self.slots[behind as usize].next = slot;
        self.slots[after as usize].previous = slot;
        self.slots[far as usize].previous = gate;
        let edge = &mut self.slots[gate as usize];
        (edge.next, edge.outer) = (far, b);
        for changed in [gate, far, slot, after] {
            self.measure(changed);
        }
        Ok(slot)
    }

    /// The slot `offset` places from `start`. All walks together may take 64 steps per vertex known so far. That is far
    /// more than meshes need (shorter parts sum to at most half log2 n per slot), and keeps any stream from making
    /// decoding quadratic.
    fn walk(&mut self, start: u32, offset: i64) -> Result<u32, Violation> {
        self.walked += offset.unsigned_abs();
        if self.walked > 64 * self.vertices.len() as u64 {
            return Err(Violation(&"splits and unions walk too far"));
        }
        let mut slot = start;
        for _ in 0..offset.unsigned_abs() {
            let s = self.slots[slot as usize];
            slot = if offset > 0 { s.next } else { s.previous };
        }
        Ok(slot)
    }
}

impl Machine {
    /// The point that the first coordinates of a seed are relative to: the newest vertex, or the origin.
    pub(super) fn seed_reference(&self) -> LatticePoint {
        self.vertices.last().map_or([0; 3], |v| v.position.map(|x| x as i64))
    }
}
