//! The encoder's view of its target: half-edges, which triangles are coded, and which half-edge each active slot stands
//! for.

use super::{connectivity::NONE, encode::EncodeError};

/// The half-edge that follows in the same triangle (half-edge 3 t + k leaves corner k of triangle t).
pub(super) fn following(half_edge: u32) -> u32 {
    if half_edge % 3 == 2 { half_edge - 2 } else { half_edge + 1 }
}

/// The half-edge that precedes in the same triangle.
pub(super) fn preceding(half_edge: u32) -> u32 {
    if half_edge.is_multiple_of(3) { half_edge + 2 } else { half_edge - 1 }
}

/// The line between coded and unknown triangles of the target.
pub(super) struct Wavefront<'a> {
    triangles: &'a [[u32; 3]],
    border_count: u32,
    /// The half-edge on the other side; [`NONE`] on the border.
    opposite: Vec<u32>,
    /// The half-edge of an unknown triangle that each slot's edge is.
    half_edge_of: Vec<u32>,
    /// The slot whose edge a half-edge is, if any; meaningful in unknown triangles only.
    slot_of: Vec<u32>,
    /// Which triangles are coded.
    known: Vec<bool>,
    /// Whether each vertex is or was on an active loop.
    reached: Vec<bool>,
    /// Triangles below this are known once closed components are coded.
    first_unknown: usize,
}

fn topology(what: &'static str, half_edge: u32) -> EncodeError {
    EncodeError::Topology { what, triangle: half_edge / 3 }
}

impl<'a> Wavefront<'a> {
    /// Pairs half-edges and binds the border loops (of these lengths, numbered as in a patch) to slots 0, 1, ...
    pub(super) fn new(
        triangles: &'a [[u32; 3]],
        loop_lengths: &[usize],
        interior_count: usize,
    ) -> Result<Self, EncodeError> {
        let border_count: usize = loop_lengths.iter().sum();
        let vertex_count = border_count + interior_count;
        if vertex_count > 1 << 31 || triangles.len() >= (NONE / 3) as usize {
            return Err(EncodeError::Rule { what: "a patch has at most 2^31 vertices and 2^32 / 3 triangles" });
        }
        let mut front = Self {
            triangles,
            border_count: border_count as u32,
            opposite: pair_half_edges(triangles, vertex_count)?,
            half_edge_of: Vec::with_capacity(vertex_count),
            slot_of: vec![NONE; triangles.len() * 3],
            known: vec![false; triangles.len()],
            reached: vec![false; vertex_count],
            first_unknown: 0,
        };
        front.reached[..border_count].fill(true);
        front.bind_border(loop_lengths)?;
        Ok(front)
    }

    fn bind_border(&mut self, loop_lengths: &[usize]) -> Result<(), EncodeError> {
        let mut leaving = vec![NONE; self.border_count as usize];
        for (h, _) in (0u32..).zip(&self.opposite).filter(|&(_, &o)| o == NONE) {
            match leaving.get_mut(self.origin(h) as usize) {
                Some(slot @ &mut NONE) => *slot = h,
                Some(_) => return Err(topology("a border vertex lies on the border twice", h)),
                None => return Err(topology("an interior vertex lies on the border", h)),
            }
        }
        let mut first = 0;
        for count in loop_lengths.iter().map(|&n| n as u32) {
            for k in 0..count {
                let h = leaving[(first + k) as usize];
                if h == NONE || self.origin(following(h)) != first + (k + 1) % count {
                    return Err(topology("a border edge has no triangle", if h == NONE { 0 } else { h }));
                }
                self.slot_of[h as usize] = first + k;
                self.half_edge_of.push(h);
            }
            first += count;
        }
        Ok(())
    }

    /// The vertex that a half-edge leaves.
    pub(super) fn origin(&self, half_edge: u32) -> u32 {
        self.triangles[half_edge as usize / 3][half_edge as usize % 3]
    }

    /// The other two vertices of each triangle around the vertex that `leaving` leaves, as far as these go on from one
    /// to the next.
    pub(super) fn around(&self, leaving: u32) -> impl Iterator<Item = [u32; 2]> + Clone {
        let next = move |&h: &u32| Some(self.opposite[preceding(h) as usize]).filter(|&h| h != NONE && h != leaving);
        std::iter::successors(Some(leaving), next).map(move |h| [following(h), preceding(h)].map(|h| self.origin(h)))
    }

    /// The number of components without a border.
    pub(super) fn closed_components(&self) -> u64 {
        let mut seen = vec![false; self.known.len()];
        let mut stack = Vec::new();
        let mut flood = |start: u32| {
            let grown = !seen[start as usize];
            stack.push(start);
            while let Some(triangle) = stack.pop() {
                if !std::mem::replace(&mut seen[triangle as usize], true) {
                    let sides = &self.opposite[triangle as usize * 3..][..3];
                    stack.extend(sides.iter().filter(|&&o| o != NONE).map(|o| o / 3));
                }
            }
            grown
        };
        for h in &self.half_edge_of {
            flood(h / 3);
        }
        (0..self.known.len() as u32).filter(|&t| flood(t)).count() as u64
    }

    /// Begins a closed component: its first triangle is now known, and the three slots from `slot` on surround it.
    /// Returns its half-edges.
    pub(super) fn seed(&mut self, slot: u32) -> Result<[u32; 3], EncodeError> {
        let Some(triangle) = (self.first_unknown..self.known.len()).find(|&t| !self.known[t]) else {
            return Err(EncodeError::Rule { what: "a closed component has no triangle" });
        };
        self.first_unknown = triangle + 1;
        self.known[triangle] = true;
        let corners = self.triangles[triangle];
        let h = 3 * triangle as u32;
        for v in corners {
            if !self.reach(v) {
                return Err(topology("a vertex where two separate fans of triangles meet", h));
            }
        }
        // The loop around a, b, c is a, c, b: its edges are the far sides of c a, b c and a b.
        for (slot, half_edge) in (slot..).zip([h + 2, h + 1, h]) {
            self.bind(slot, half_edge);
        }
        Ok([h, h + 1, h + 2])
    }

    /// The half-edge of a gate. Its triangle is known from now on.
    pub(super) fn enter(&mut self, gate: u32) -> Result<u32, EncodeError> {
        let h = self.half_edge_of[gate as usize];
        if h == NONE || std::mem::replace(&mut self.known[h as usize / 3], true) {
            return Err(topology("a surface that folds back onto its own edge", if h == NONE { 0 } else { h }));
        }
        Ok(h)
    }

    /// Whether an unknown triangle's half-edge is the edge of `slot`.
    pub(super) fn is_edge_of(&self, half_edge: u32, slot: u32) -> bool {
        self.slot_of[half_edge as usize] == slot
    }

    /// Marks a vertex as reached. Returns whether it is new.
    pub(super) fn reach(&mut self, vertex: u32) -> bool {
        !std::mem::replace(&mut self.reached[vertex as usize], true)
    }

    /// Makes the far side of `half_edge`, whose triangle is now known, the edge of `slot`: of an existing slot or of
    /// the next new one.
    pub(super) fn bind(&mut self, slot: u32, half_edge: u32) {
        let unknown = self.opposite[half_edge as usize];
        match self.half_edge_of.get_mut(slot as usize) {
            Some(place) => *place = unknown,
            None => self.half_edge_of.push(unknown),
        }
        if let Some(place) = self.slot_of.get_mut(unknown as usize) {
            *place = slot;
        }
    }

    /// Turns around the origin of `leaving`, a half-edge of the triangle just entered, through unknown triangles to the
    /// active edge that bounds them.
    pub(super) fn active_slot(&self, leaving: u32) -> Result<u32, EncodeError> {
        let mut h = leaving;
        loop {
            if self.slot_of[h as usize] != NONE {
                return Ok(self.slot_of[h as usize]);
            }
            let o = self.opposite[h as usize];
            if o == NONE || self.known[o as usize / 3] {
                return Err(topology("a border that no loop describes", h));
            }
            h = following(o);
            if h == leaving {
                return Err(topology("a vertex where two separate fans of triangles meet", h));
            }
        }
    }

    /// Checks that the two slots of a closing loop are the two sides of one edge.
    pub(super) fn close(&self, slot: u32, other: u32) -> Result<(), EncodeError> {
        let (h, g) = (self.half_edge_of[slot as usize], self.half_edge_of[other as usize]);
        let is_far_side = |h: u32, g: u32| self.opposite.get(h as usize) == Some(&g);
        if is_far_side(h, g) || is_far_side(g, h) {
            Ok(())
        } else {
            Err(topology("two edges between the same two vertices", if h == NONE { 0 } else { h }))
        }
    }
}

/// The opposite of each half-edge, [`NONE`] on the border.
fn pair_half_edges(triangles: &[[u32; 3]], vertex_count: usize) -> Result<Vec<u32>, EncodeError> {
    let mut edges = Vec::with_capacity(triangles.len() * 3);
    for (t, &corners) in (0u32..).zip(triangles) {
        for k in 0..3 {
            let (a, b) = (corners[k as usize], corners[(k as usize + 1) % 3]);
            if a as usize >= vertex_count || a == b {
                return Err(EncodeError::Topology {
                    what: "a corner that is no vertex, or a vertex twice",
                    triangle: t,
                });
            }
            edges.push((a.min(b), a.max(b), 3 * t + k));
        }
    }
    edges.sort_unstable();
    let mut opposite = vec![NONE; edges.len()];
    for run in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        match *run {
            [_] => {}
            [(.., g), (.., h)]
                if triangles[g as usize / 3][g as usize % 3] != triangles[h as usize / 3][h as usize % 3] =>
            {
                opposite[g as usize] = h;
                opposite[h as usize] = g;
            }
            [(.., h), ..] => return Err(topology("an edge with three triangles, or two wound against each other", h)),
            [] => {}
        }
    }
    Ok(opposite)
}
