//! Part of a triangle, with the triangles of the other surface that may cover it.

use glam::DVec3;

use super::bvh::TriangleBvh;

/// How evenly a cut must divide an edge: both parts keep at least this share of it, so edges shrink at every cut.
const MIN_SHARE: f64 = 0.1;
/// Steps towards the point of an edge that is equally far from two triangles. More steps do not lower the number of
/// subtriangles.
const BALANCE_STEPS: usize = 2;

/// A triangle within a triangle. Each corner has a candidate: a triangle of the other surface near it.
///
/// The distance to one triangle is convex, so the largest distance of the corners from one candidate bounds the
/// distance of every point of the subtriangle from the other surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Subtriangle {
    /// Relative to the origin of the other surface.
    pub(super) corners: [DVec3; 3],
    /// Slot of each corner's candidate.
    pub(super) candidates: [u32; 3],
    /// `squares[i][j]`: squared distance of corner `i` from candidate `j`.
    pub(super) squares: [[f64; 3]; 3],
    /// Cuts that led to this subtriangle.
    pub(super) depth: u16,
}

/// Where to cut a subtriangle: at `point`, on the edge between corners `near` and `far`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    pub(super) near: usize,
    pub(super) far: usize,
    pub(super) point: DVec3,
    /// Squared distances of `point` from the candidates of `near` and `far`.
    pub(super) squares: [f64; 2],
}

impl Subtriangle {
    /// The squared bound of the best candidate, and that candidate.
    pub(super) fn bound(&self) -> (f64, usize) {
        let over = |j: usize| self.squares[0][j].max(self.squares[1][j]).max(self.squares[2][j]);
        let bounds = [over(0), over(1), over(2)];
        let best = if bounds[0] <= bounds[1] && bounds[0] <= bounds[2] {
            0
        } else if bounds[1] <= bounds[2] {
            1
        } else {
            2
        };
        (bounds[best], best)
    }

    /// The largest squared distance of the corners from one triangle.
    pub(super) fn covered_by(&self, to: &TriangleBvh, slot: u32) -> f64 {
        self.corners.iter().map(|&c| to.distance_squared(c, slot)).fold(0.0, f64::max)
    }

    /// Chooses a cut such that the candidates of two corners each cover their part of the edge between them: it goes
    /// through the point that is equally far from both. The edge is the longest of those where neither end's candidate
    /// covers the other end up to the squared distance `threshold`. (Cutting where the best candidate fails most seems
    /// natural, but then the longest edge might never be cut.)
    pub(super) fn cut(&self, to: &TriangleBvh, threshold: f64) -> Cut {
        let mut longest = (false, -1.0, 0, 1);
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let open = self.squares[i][j].min(self.squares[j][i]) > threshold;
            let length = self.corners[i].distance_squared(self.corners[j]);
            if (open, length) > (longest.0, longest.1) {
                longest = (open, length, i, j);
            }
        }
        let (_, _, near, far) = longest;
        let bound = self.squares[near][far].min(self.squares[far][near]);
        let (start, end) = (self.corners[near], self.corners[far]);
        let candidates = [self.candidates[near], self.candidates[far]];
        let measure = |share: f64| {
            let point = start + (end - start) * share;
            let squares = [to.distance_squared(point, candidates[0]), to.distance_squared(point, candidates[1])];
            Cut { near, far, point, squares }
        };
        let mut low = (0.0, self.squares[near][near] - self.squares[near][far]);
        let mut high = (1.0, self.squares[far][near] - self.squares[far][far]);
        if low.1 >= 0.0 || high.1 <= 0.0 {
            // One of the two is closer all along the edge.
            return measure(0.5);
        }
        let mut step = 0;
        loop {
            let share = low.0 + (high.0 - low.0) * (low.1 / (low.1 - high.1)).clamp(MIN_SHARE, 1.0 - MIN_SHARE);
            let cut = measure(share.clamp(MIN_SHARE, 1.0 - MIN_SHARE));
            let excess = cut.squares[0] - cut.squares[1];
            step += 1;
            if step == BALANCE_STEPS || !(MIN_SHARE..=1.0 - MIN_SHARE).contains(&share) || excess.abs() <= 0.02 * bound
            {
                return cut;
            }
            if excess < 0.0 {
                low = (share, excess);
            } else {
                high = (share, excess);
            }
        }
    }

    /// The two parts of the subtriangle on either side of a cut. `found`, if known, is the squared distance and slot of
    /// the triangle closest to the cut's point, and becomes the point's candidate. Otherwise each part inherits the
    /// candidate of the other.
    pub(super) fn parts(&self, cut: &Cut, found: Option<(f64, u32)>, to: &TriangleBvh) -> [Subtriangle; 2] {
        let Cut { near, far, point, .. } = *cut;
        let third = 3 - near - far;
        let from_third = if self.candidates[third] == self.candidates[near] {
            cut.squares[0]
        } else if self.candidates[third] == self.candidates[far] {
            cut.squares[1]
        } else {
            to.distance_squared(point, self.candidates[third])
        };
        let part = |kept: usize, replaced: usize, side: usize| {
            let mut part = *self;
            part.depth += 1;
            part.corners[replaced] = point;
            part.squares[replaced][kept] = cut.squares[side];
            part.squares[replaced][third] = from_third;
            if let Some((square, slot)) = found {
                part.candidates[replaced] = slot;
                part.squares[replaced][replaced] = square;
                part.squares[kept][replaced] = to.distance_squared(part.corners[kept], slot);
                part.squares[third][replaced] = to.distance_squared(part.corners[third], slot);
            } else {
                part.squares[replaced][replaced] = cut.squares[1 - side];
            }
            part
        };
        [part(near, far, 0), part(far, near, 1)]
    }
}
