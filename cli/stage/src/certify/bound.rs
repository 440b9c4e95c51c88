//! Branch and bound on the largest distance of the points of one surface from another.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::bvh::{Child, TriangleBvh};
use super::plains::Plains;
use super::plates::Plates;
use super::subtriangle::Subtriangle;
use super::{Bound, CertifyOptions};
use lodpack_mesh::NONE;

/// After this many cuts a subtriangle keeps its bound. The rounding of that many cut points is within the inflation of
/// the final bound.
const MAX_DEPTH: u16 = 128;
/// Distances below this share of the coordinates are rounding and never worth a cut.
const ROUNDING: f64 = 1e-14;
/// The final bound is inflated by this share of itself, and by [`INFLATE_REACH`] of the coordinates.
///
/// All coordinates are relative to the origin of one surface, and `reach` bounds them for both. Rounding comes from two
/// subtractions per point, from about ten operations per distance, and from two for each of at most [`MAX_DEPTH`]
/// nested cuts, after which the parts may fail to tile their triangle (a missed point is that near to them, and so is
/// its distance). Together that is below 400 units in the last place of `reach`, 1e-13. Squares and roots add a few
/// units in the last place of the result.
const INFLATE: f64 = 1e-12;
const INFLATE_REACH: f64 = 1e-13;
/// Added as well, because squares of anything smaller underflow.
const INFLATE_TINY: f64 = 1e-150;
/// Queries and cuts after which a search ends, whatever its limit: this many, plus the number below for each triangle
/// of both surfaces. Scans and parts take less than a quarter of that. A surface that takes more is folded, intersects
/// itself within the tolerance or has a hub; its bound stays valid but is looser than asked for.
pub(super) const MOST_WORK: u64 = 60_000;
const MOST_WORK_PER_TRIANGLE: u64 = 16;
/// After this share of it a search looks for [`Plains`]: what takes longer than usual may be flat.
const BEFORE_PLAINS: u64 = 4;
/// Queries and cuts that [`Search::exceeding`] spends on one triangle at most.
const WORK_PER_TRIANGLE: u64 = 500;
/// A query that looks into more nodes and leaves of the hierarchy counts as several: as one more for each beyond. Most
/// take a dozen or two; where the boxes of all triangles overlap, as in a fan, each
/// takes as many as there are, and a limit on the number of queries would be none on the time.
const FREE_VISITS: u64 = 64;
/// Vertices queried before anything else, so that pruning starts with a good lower bound.
const SEEDS: usize = 128;

/// Cuts made in a subtriangle from the queue before the rest of it returns to the queue.
const LOCAL_CUTS: usize = 64;

/// Plates are at most this share of the threshold thick.
const PLATE: f64 = 0.5;

/// A query ends at any triangle within this share of the (squared) threshold.
const NEAR: f64 = 0.25;

/// A triangle that lies on `from`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// The slot of the triangle of `from` in which it lies.
    pub within: u32,
    /// Relative to the origin of `to`.
    pub corners: [DVec3; 3],
    /// The slot of a triangle of `to` that may be near.
    pub hint: u32,
}

/// A waiting subtriangle, ordered by its squared bound. Among equals, the older one comes first.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    bound: f64,
    subtriangle: u32,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound).then(other.subtriangle.cmp(&self.subtriangle))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// The search in one direction. All lengths are kept squared.
pub(super) struct Search<'a> {
    from: &'a TriangleBvh,
    to: &'a TriangleBvh,
    /// Vertices of `from` relative to the origin of `to`.
    points: Vec<DVec3>,
    /// Squared distance and closest slot of each vertex; [`NONE`] for vertices not queried yet.
    vertex_nearest: Vec<(f64, u32)>,
    /// The largest distance found to occur, and where it occurs.
    lower: f64,
    worst: DVec3,
    /// A distance known to occur elsewhere.
    known: f64,
    /// A part of the surface that is at most this far needs no resolution.
    enough: f64,
    /// By how much the threshold exceeds the lower bound, as a factor on squares; zero keeps it at `enough`.
    growth: f64,
    /// A part proven to be at most this far is not examined again.
    threshold: f64,
    /// Share of the (squared) threshold up to which the point of a cut is not queried.
    margin: f64,
    /// The largest bound of all parts set aside so far.
    settled: f64,
    subtriangles: Vec<Subtriangle>,
    free: Vec<u32>,
    heap: BinaryHeap<Waiting>,
    /// The plates of `to`, once they have been needed.
    plates: Option<Plates>,
    /// The plains of `to`, likewise.
    plains: Option<Plains>,
    /// Parts of the current subtriangle.
    stack: Vec<(f64, Subtriangle)>,
    /// Closest slot of the last query.
    last: u32,
    /// Queries and cuts so far.
    work: u64,
    work_limit: u64,
}

/// A squared distance between points whose coordinates, relative to some point, are at most `reach`, with every
/// rounding error.
pub(super) fn inflated(square: f64, reach: f64) -> f64 {
    square.sqrt() * (1.0 + INFLATE) + INFLATE_REACH * reach + INFLATE_TINY
}

impl<'a> Search<'a> {
    /// A search for the largest distance. Neither surface may be empty.
    pub(super) fn new(from: &'a TriangleBvh, to: &'a TriangleBvh, options: &CertifyOptions) -> Self {
        let gap = 1.0 + options.relative_gap.max(0.0);
        let mut search = Self::with_threshold(from, to, options.floor.max(options.target.unwrap_or(0.0)));
        search.growth = gap * gap;
        search.margin = 1.0 / gap;
        search.work_limit = options.work_limit.min(search.most_work());
        search.know(options.lower * options.lower);
        search
    }

    /// A search for the parts that are farther than `enough`. Neither surface may be empty.
    pub(super) fn with_threshold(from: &'a TriangleBvh, to: &'a TriangleBvh, enough: f64) -> Self {
        let points: Vec<DVec3> = from.positions.iter().map(|&p| p - to.origin).collect();
        let reach = from.reach + (from.origin - to.origin).abs().max_element() + to.reach;
        // Lowered, so that the inflated bound does not exceed what was asked for.
        let enough = ((enough - INFLATE_REACH * reach) * (1.0 - 2.0 * INFLATE)).max(ROUNDING * reach);
        let mut search = Self {
            from,
            to,
            vertex_nearest: vec![(0.0, NONE); points.len()],
            lower: 0.0,
            worst: from.positions[0],
            known: 0.0,
            enough: enough * enough,
            growth: 0.0,
            margin: 0.95,
            threshold: 0.0,
            settled: 0.0,
            subtriangles: Vec::new(),
            free: Vec::new(),
            heap: BinaryHeap::new(),
            plates: None,
            plains: None,
            stack: Vec::new(),
            last: 0,
            work: 0,
            work_limit: u64::MAX,
            points,
        };
        search.know(0.0);
        search
    }

    /// The work after which a search ends, whatever its limit.
    fn most_work(&self) -> u64 {
        let triangles = self.from.triangle_count() + self.to.triangle_count();
        MOST_WORK + MOST_WORK_PER_TRIANGLE * triangles as u64
    }

    /// The squared distance up to which a part needs no closer look.
    pub(super) fn threshold(&self) -> f64 {
        self.threshold
    }

    /// Squared distance of a vertex, and the slot at that distance. If the vertex is well within the threshold, any
    /// near slot may be returned.
    pub(super) fn query_vertex_nearly(&mut self, vertex: u32) -> (f64, u32) {
        self.query_vertex(vertex, self.threshold * NEAR)
    }

    /// The largest distance found so far, squared.
    pub(super) fn lower(&self) -> f64 {
        self.lower
    }

    /// Reports a squared distance that occurs somewhere, not necessarily here. Bounds below it no longer matter.
    pub(super) fn know(&mut self, square: f64) {
        self.known = self.known.max(square);
        self.threshold = (self.known.max(self.lower) * self.growth).max(self.enough);
    }

    fn query(&mut self, point: DVec3, enough: f64) -> (f64, u32) {
        let (found, visited) = self.to.nearest_counted(point, self.last, enough);
        self.work += 1 + visited.saturating_sub(FREE_VISITS);
        self.last = found.1;
        found
    }

    /// Queries a point that lies on `from`. A triangle found within `enough` need not be the closest.
    fn query_on_surface(&mut self, point: DVec3, enough: f64) -> (f64, u32) {
        let found = self.query(point, enough);
        if found.0 > self.lower.max(enough) {
            self.lower = found.0;
            self.worst = point + self.to.origin;
            self.know(0.0);
        }
        found
    }

    fn query_vertex(&mut self, vertex: u32, enough: f64) -> (f64, u32) {
        let mut found = self.vertex_nearest[vertex as usize];
        if found.1 == NONE {
            found = self.query_on_surface(self.points[vertex as usize], enough);
            self.vertex_nearest[vertex as usize] = found;
        }
        found
    }

    /// Queries some vertices, spread over `from`.
    pub(super) fn seed(&mut self) {
        let step = (self.points.len() / SEEDS).max(1);
        for vertex in (0..self.points.len() as u32).step_by(step) {
            self.query_vertex(vertex, 0.0);
        }
    }

    /// Sets a part with this bound aside, if the bound is low enough.
    fn settle(&mut self, bound: f64) -> bool {
        let settled = bound <= self.threshold;
        if settled {
            self.settled = self.settled.max(bound);
        }
        settled
    }

    /// Settles everything below a node of `from`, or passes on the triangles that need cuts.
    fn visit(&mut self, node: u32, open: &mut impl FnMut(&mut Self, u32, f64, Subtriangle)) {
        let shift = self.from.origin - self.to.origin;
        for child in self.from.children(node) {
            if self.settle_ball(&child, shift) {
                continue;
            }
            if child.triangle_count == 0 {
                self.visit(child.index, open);
            } else {
                for slot in child.index..child.index + u32::from(child.triangle_count) {
                    if let Some((bound, subtriangle)) = self.visit_triangle(slot) {
                        open(self, slot, bound, subtriangle);
                    }
                }
            }
        }
    }

    /// Settles all triangles in a ball that is small against the threshold.
    fn settle_ball(&mut self, child: &Child, shift: DVec3) -> bool {
        let reserve = self.threshold.sqrt() - child.radius;
        if reserve <= 0.0 {
            return false;
        }
        let centre = child.centre + shift;
        let mut square = self.to.distance_squared(centre, self.last);
        if square > reserve * reserve {
            if reserve < 0.5 * child.radius {
                return false;
            }
            square = self.query(centre, reserve * reserve).0;
        }
        square <= reserve * reserve && {
            let bound = square.sqrt() + child.radius;
            self.settled = self.settled.max(bound * bound);
            true
        }
    }

    /// The subtriangle for a whole triangle and its bound, unless it can be settled at once.
    fn visit_triangle(&mut self, slot: u32) -> Option<(f64, Subtriangle)> {
        let vertices = self.from.triangles[slot as usize];
        let corners = vertices.map(|v| self.points[v as usize]);
        self.visit_subtriangle(corners, |search, j| search.query_vertex(vertices[j], search.threshold * NEAR))
    }

    /// The subtriangle for a triangle that lies on `from` and its bound, unless it can be settled at once. Its corners
    /// are relative to the origin of `to`; the search begins there at the triangle in slot `hint`.
    fn visit_part(&mut self, corners: [DVec3; 3], hint: u32) -> Option<(f64, Subtriangle)> {
        self.last = hint;
        self.visit_subtriangle(corners, |search, j| search.query_on_surface(corners[j], search.threshold * NEAR))
    }

    fn visit_subtriangle(
        &mut self,
        corners: [DVec3; 3],
        query: impl Fn(&mut Self, usize) -> (f64, u32),
    ) -> Option<(f64, Subtriangle)> {
        let mut subtriangle = Subtriangle { corners, candidates: [self.last; 3], squares: [[0.0; 3]; 3], depth: 0 };
        let bound = subtriangle.covered_by(self.to, self.last);
        if self.settle(bound) {
            return None;
        }
        if self.work >= 2 * self.most_work() {
            // Any triangle gives a bound, so one is known without a query.
            subtriangle.squares = subtriangle.corners.map(|corner| [self.to.distance_squared(corner, self.last); 3]);
            return Some((bound, subtriangle));
        }
        for j in 0..3 {
            let (square, candidate) = query(self, j);
            subtriangle.candidates[j] = candidate;
            let known = (0..j).find(|&k| subtriangle.candidates[k] == candidate);
            let mut bound = 0f64;
            for i in 0..3 {
                subtriangle.squares[i][j] = match known {
                    Some(k) => subtriangle.squares[i][k],
                    None if i == j => square,
                    None => self.to.distance_squared(subtriangle.corners[i], candidate),
                };
                bound = bound.max(subtriangle.squares[i][j]);
            }
            if self.settle(bound) {
                return None;
            }
        }
        Some((subtriangle.bound().0, subtriangle))
    }

    fn push(&mut self, bound: f64, subtriangle: Subtriangle) {
        let index = if let Some(index) = self.free.pop() {
            self.subtriangles[index as usize] = subtriangle;
            index
        } else {
            self.subtriangles.push(subtriangle);
            self.subtriangles.len() as u32 - 1
        };
        self.heap.push(Waiting { bound, subtriangle: index });
    }

    /// Cuts a subtriangle, and then its parts, for a while. Continuing with the parts at once keeps the queue short and
    /// the queries near each other; returning to the queue keeps the search from spending its work where the bound is
    /// not worst.
    fn refine_locally(&mut self, bound: f64, subtriangle: Subtriangle) {
        let mut stack = std::mem::take(&mut self.stack);
        stack.push((bound, subtriangle));
        let mut cuts = 0;
        while let Some((bound, subtriangle)) = stack.pop() {
            if self.settle(bound) {
                continue;
            }
            if cuts == LOCAL_CUTS {
                self.push(bound, subtriangle);
                continue;
            }
            cuts += 1;
            self.refine(bound, &subtriangle, &mut stack);
        }
        self.stack = stack;
    }

    /// Cuts a subtriangle and keeps the parts that are still above the threshold.
    fn refine(&mut self, bound: f64, subtriangle: &Subtriangle, open: &mut Vec<(f64, Subtriangle)>) {
        self.work += 1;
        if subtriangle.depth >= MAX_DEPTH {
            self.settled = self.settled.max(bound);
            return;
        }
        if subtriangle.depth == 0 {
            // Where the subtriangle is small, the triangle closest to its middle covers more than those closest to its
            // corners.
            let middle = (subtriangle.corners[0] + subtriangle.corners[1] + subtriangle.corners[2]) / 3.0;
            let (_, slot) = self.query_on_surface(middle, self.threshold * NEAR);
            if !subtriangle.candidates.contains(&slot) {
                let bound = subtriangle.covered_by(self.to, slot);
                if self.settle(bound) {
                    return;
                }
            }
            if self.settle_on_plate(slot, &subtriangle.corners) {
                return;
            }
        }
        if self.work > self.most_work() / BEFORE_PLAINS && self.settle_on_plain(subtriangle) {
            return;
        }
        let cut = subtriangle.cut(self.to, self.threshold);
        let mut found = None;
        // With this margin, parts whose inherited candidates lie at the very threshold do not need ever smaller cuts.
        if cut.squares[0].max(cut.squares[1]) > self.threshold * self.margin {
            self.last = subtriangle.candidates[if cut.squares[0] <= cut.squares[1] { cut.near } else { cut.far }];
            found = Some(self.query_on_surface(cut.point, self.threshold * NEAR));
        }
        for part in subtriangle.parts(&cut, found, self.to) {
            let (bound, _) = part.bound();
            if !self.settle(bound) {
                open.push((bound, part));
            }
        }
    }

    /// Settles a triangle that lies along the plate of a slot.
    fn settle_on_plate(&mut self, slot: u32, corners: &[DVec3; 3]) -> bool {
        let (to, thickness) = (self.to, PLATE * self.threshold.sqrt());
        let bound = self.plates.get_or_insert_with(|| Plates::new(to, thickness)).bound(slot, corners);
        bound.is_some_and(|bound| self.settle(bound))
    }

    /// Settles a subtriangle that lies along a plain of one of its candidates.
    fn settle_on_plain(&mut self, subtriangle: &Subtriangle) -> bool {
        let (to, threshold) = (self.to, self.threshold);
        let plains = self.plains.get_or_insert_with(|| Plains::new(to, threshold.sqrt()));
        let [a, b, c] = subtriangle.candidates.map(|slot| plains.plain(slot));
        let bound = [a, b.filter(|_| b != a), c.filter(|_| c != a && c != b)].into_iter().flatten();
        let bound = bound.filter_map(|plain| plains.bound(plain, &subtriangle.corners, threshold)).next();
        bound.is_some_and(|bound| self.settle(bound))
    }

    /// Cuts the subtriangles in the queue, worst first, until all are settled or the work is used up.
    fn empty_queue(&mut self, work_limit: u64) {
        while let Some(Waiting { bound, subtriangle: index }) = self.heap.pop() {
            // The rest have no larger bounds, so this settles them too.
            if self.settle(bound) {
                return;
            }
            let decided = self.growth == 0.0 && self.lower > self.threshold;
            if decided || self.work >= work_limit {
                self.settled = self.settled.max(bound);
                return;
            }
            let subtriangle = self.subtriangles[index as usize];
            self.free.push(index);
            self.refine_locally(bound, subtriangle);
        }
    }

    /// Bounds the whole of `from`.
    pub(super) fn run(mut self) -> Bound {
        self.visit(0, &mut |search, _, bound, subtriangle| search.push(bound, subtriangle));
        self.finish()
    }

    /// Bounds some triangles of `from`, by slot, and some triangles that lie on it.
    pub(super) fn run_on(mut self, slots: impl Iterator<Item = u32>, patches: &[Patch]) -> Bound {
        for slot in slots {
            if let Some((bound, subtriangle)) = self.visit_triangle(slot) {
                self.push(bound, subtriangle);
            }
        }
        for &Patch { corners, hint, .. } in patches {
            if let Some((bound, subtriangle)) = self.visit_part(corners, hint) {
                self.push(bound, subtriangle);
            }
        }
        self.finish()
    }

    /// An upper bound for a squared distance between two surfaces that holds whatever the rounding.
    pub(super) fn inflate(square: f64, a: &TriangleBvh, b: &TriangleBvh) -> f64 {
        inflated(square, a.reach + (a.origin - b.origin).abs().max_element() + b.reach)
    }

    fn finish(mut self) -> Bound {
        self.empty_queue(self.work_limit);
        let upper = Self::inflate(self.settled.max(self.lower), self.from, self.to);
        Bound { lower: self.lower.sqrt(), upper, worst: self.worst, work: self.work }
    }

    /// The triangles of `from` that are not proven to be within the threshold, ascending, as the caller numbered them.
    pub(super) fn exceeding(mut self, work_limit: u64) -> Vec<u32> {
        let (mut found, mut left) = (Vec::new(), work_limit.min(self.most_work()));
        self.visit(0, &mut |search, slot, bound, subtriangle| {
            if search.exceeds(bound, subtriangle, &mut left) {
                found.push(search.from.original[slot as usize]);
            }
        });
        found.sort_unstable();
        found
    }

    /// Those of some triangles of `from`, by slot, that are not proven to be within the threshold, ascending, as the
    /// caller numbered them.
    pub(super) fn exceeding_among(mut self, slots: impl Iterator<Item = u32>, work_limit: u64) -> Vec<u32> {
        let (mut found, mut left) = (Vec::new(), work_limit.min(self.most_work()));
        for slot in slots {
            if let Some((bound, subtriangle)) = self.visit_triangle(slot)
                && self.exceeds(bound, subtriangle, &mut left)
            {
                found.push(self.from.original[slot as usize]);
            }
        }
        found.sort_unstable();
        found
    }

    /// Whether one subtriangle is not proven to be within the threshold. Takes what that costs from the work that is
    /// left.
    fn exceeds(&mut self, bound: f64, subtriangle: Subtriangle, left: &mut u64) -> bool {
        // Squares on the diagonal are distances of vertices, which no cut can lower.
        if (0..3).any(|i| subtriangle.squares[i][i] > self.threshold) {
            return true;
        }
        self.lower = 0.0;
        self.settled = 0.0;
        self.push(bound, subtriangle);
        let before = self.work;
        self.empty_queue(before + WORK_PER_TRIANGLE.min(*left));
        *left = left.saturating_sub(self.work - before);
        let exceeds = self.settled.max(self.lower) > self.threshold;
        self.heap.clear();
        self.subtriangles.clear();
        self.free.clear();
        exceeds
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A fan of `count` triangles, whose rim goes up and down by `height`.
    fn fan(count: u32, height: f64) -> TriangleBvh {
        let rim = (0..count).map(|i| {
            // A circle without sines.
            let t = 4.0 * f64::from(i) / f64::from(count);
            let (x, y) = if t < 2.0 { (1.0 - t, 1.0) } else { (t - 3.0, -1.0) };
            let across = (1.0 - x * x).max(0.0).sqrt() * y;
            DVec3::new(x, across, if i % 2 == 0 { height } else { -height })
        });
        let positions: Vec<DVec3> = std::iter::once(DVec3::ZERO).chain(rim).collect();
        let triangles: Vec<[u32; 3]> = (0..count).map(|i| [0, 1 + i, 1 + (i + 1) % count]).collect();
        TriangleBvh::new(&positions, &triangles)
    }

    #[test]
    fn a_query_counts_as_much_as_it_looks_at() {
        let [fan, other] = [fan(20_000, 0.1), fan(20_000, 0.0)];
        let mut search = Search::new(&other, &fan, &CertifyOptions::default());
        let point = DVec3::new(0.3, 0.2, 0.05);
        let (_, visited) = fan.nearest_counted(point, 0, 0.0);
        assert!(visited > 500, "the boxes of a fan overlap: {visited}");
        search.query(point, 0.0);
        assert_eq!(search.work, 1 + visited - FREE_VISITS);
        // Where triangles lie beside each other, a query counts as one.
        let field = super::super::tests::height_field(100, |x, y| x * y);
        let field = super::super::tests::surface(&field);
        let mut search = Search::new(&other, &field, &CertifyOptions::default());
        search.query(DVec3::new(0.1, 0.2, 0.0), 0.0);
        assert_eq!(search.work, 1);
    }

    #[test]
    fn searches_end_in_proportion_to_the_triangles_and_bounds_stay_valid() {
        for count in [2_000, 20_000] {
            let [fan, flat] = [fan(count, 0.1), fan(count, 0.0)];
            let most = 60_000 + 16 * 2 * u64::from(count);
            let bound =
                super::super::two_sided(&flat, &fan, &CertifyOptions { relative_gap: 1e-6, ..Default::default() });
            // Two directions; a search ends after the query or the cuts in which the limit is passed.
            assert!(bound.work < 2 * (2 * most + u64::from(count)), "{bound:?}");
            assert!((0.04..=bound.upper).contains(&bound.lower), "{bound:?}");
            // None that is too far off is missing.
            let mut hint = super::super::Hint::default();
            let found = super::super::exceeding(&fan, &flat, 0.05, u64::MAX);
            for slot in 0..fan.triangles.len() {
                let corners = fan.triangles[slot].map(|v| fan.positions[v as usize]);
                let is_far = corners.iter().any(|&p| flat.closest(p, &mut hint).distance > 0.051);
                assert!(!is_far || found.binary_search(&fan.original[slot]).is_ok(), "{slot}");
            }
        }
    }
}
