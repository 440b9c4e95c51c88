//! Certify: proves an upper bound on the distance between two triangle sets, by branch and bound.
//!
//! The distance to *one* triangle, a convex set, is a convex function, so over a subtriangle of another triangle it is
//! largest at a corner. Hence the largest of three point-triangle distances bounds the distance of a whole subtriangle
//! from the surface, whichever triangle is taken; the triangles closest to the corners make good candidates. A
//! subtriangle that the bound cannot settle is cut where the candidates of two corners are equally far, worst
//! subtriangle first, until the upper and lower bounds agree. The scheme is that of Guthe, Borodin and Klein ("Fast and
//! accurate Hausdorff distance calculation between meshes", WSCG 2005), with other cuts. Upper bounds hold whichever
//! candidates the search happens to find: an inexact search costs only tightness.
//!
//! Callers may rely on `upper`: it is rounded up and includes every rounding error of this stage. `lodpack verify`
//! checks it with code that shares nothing with this stage.
//!
//! * `closest`: distance to one triangle. `bvh`: [`TriangleBvh`], closest-point queries. `subtriangle`: a subtriangle
//!   and its cut.
//! * `bound`: the search. `drape`: where the borders of two surfaces correspond, a map from the finer surface onto the
//!   coarser settles nearly everything beforehand. `by_part`: [`Comparison`], part by part where there are several;
//!   `unchanged`: parts of which most stays as it is, `flat`: or is triangulated otherwise; `surface`: what is
//!   compared. `plates`, `plains`: flat sides of which that is not known.

mod bound;
mod bvh;
mod by_part;
mod closest;
mod drape;
mod flat;
mod plains;
mod plates;
mod subtriangle;
mod surface;
#[cfg(test)]
mod tests;
mod unchanged;

use bound::Search;
use glam::DVec3;

pub use bvh::{AROUND, Around, Closest, Feet, Few, Hint, Near, Numbers, Single, TOGETHER, TriangleBvh};
pub use by_part::Comparison;
pub use drape::{BorderPairing, PairedVertex};
pub use surface::Surface;

/// How tight a bound must be. Lengths are in the units of the positions.
#[derive(Clone, Debug, PartialEq)]
pub struct CertifyOptions {
    /// The share of the lower bound by which the upper bound may exceed it.
    pub relative_gap: f64,
    /// Distances up to this need not be resolved: an upper bound of at most `floor` is good enough whatever the lower
    /// bound.
    pub floor: f64,
    /// A distance already known to occur, in the other direction or elsewhere in the mesh. The answer need not be
    /// resolved below it, nor within the gap above it.
    pub lower: f64,
    /// Decision mode, the cheapest: once an upper bound of at most this is proven, the search ends.
    pub target: Option<f64>,
    /// Closest-point queries and cuts after which the bound is returned as it stands: valid, but not as tight as asked
    /// for. One pass over all triangles is always made, and there are never many more than 16 for each. A query that
    /// looks at far more triangles than most counts as several.
    pub work_limit: u64,
}

impl Default for CertifyOptions {
    fn default() -> Self {
        Self { relative_gap: 0.05, floor: 0.0, lower: 0.0, target: None, work_limit: u64::MAX }
    }
}

/// Bounds on the largest distance of the points of one surface from another.
///
/// Unless the work limit was reached, `upper` is at most the largest of (1 + gap) x `lower`, (1 + gap) x the lower
/// bound in the options, the floor and the target, up to rounding (1e-13 of the coordinates).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// A distance that occurs, at `worst`. It need not be the largest one found if all are far below the floor, the
    /// target or the known lower bound, because queries end early then.
    pub lower: f64,
    /// No distance is larger. Rounded up.
    pub upper: f64,
    /// A point on the first surface (on either for [`two_sided`]) that is `lower` away from the other; zero if there
    /// are no triangles.
    pub worst: DVec3,
    /// Closest-point queries and cuts made; a query that looks at far more triangles than most counts as several.
    pub work: u64,
}

impl Bound {
    /// The answer if one side has no triangles, so there is nothing to search.
    fn of_empty(from: &TriangleBvh, to: &TriangleBvh) -> Option<Self> {
        let worst = from.positions.first().copied().unwrap_or_default();
        if from.is_empty() {
            Some(Self { lower: 0.0, upper: 0.0, worst, work: 0 })
        } else if to.is_empty() {
            Some(Self { lower: f64::INFINITY, upper: f64::INFINITY, worst, work: 0 })
        } else {
            None
        }
    }

    /// The bound for both directions together.
    fn or_worse(self, other: Self) -> Self {
        let worse = if other.lower > self.lower { other } else { self };
        Self { upper: self.upper.max(other.upper), work: self.work + other.work, ..worse }
    }
}

/// Bounds the largest distance of the points of `from` from `to`: infinity if only `to` is empty, zero if `from` is.
pub fn one_sided(from: &TriangleBvh, to: &TriangleBvh, options: &CertifyOptions) -> Bound {
    Bound::of_empty(from, to).unwrap_or_else(|| {
        let mut search = Search::new(from, to, options);
        search.seed();
        search.run()
    })
}

/// Bounds the Hausdorff distance: the larger of both directions, each of which uses what the other finds.
pub fn two_sided(a: &TriangleBvh, b: &TriangleBvh, options: &CertifyOptions) -> Bound {
    if let (Some(forward), Some(backward)) = (Bound::of_empty(a, b), Bound::of_empty(b, a)) {
        return forward.or_worse(backward);
    }
    let mut forward = Search::new(a, b, options);
    let mut backward = Search::new(b, a, options);
    forward.seed();
    backward.seed();
    forward.know(backward.lower());
    let forward = forward.run();
    backward.know(forward.lower * forward.lower);
    forward.or_worse(backward.run())
}

/// The triangles of `from`, as ascending indices into the caller's list, that are not proven to lie within `target` of
/// `to`. They include all that do exceed it and, given enough work, few others. The work on one triangle is bounded;
/// all together take about `work_limit` closest-point queries and cuts after a first pass, and never many more than 16
/// for each.
pub fn exceeding(from: &TriangleBvh, to: &TriangleBvh, target: f64, work_limit: u64) -> Vec<u32> {
    match Bound::of_empty(from, to) {
        Some(bound) if bound.upper == 0.0 => Vec::new(),
        Some(_) => (0..from.triangle_count() as u32).collect(),
        None => Search::with_threshold(from, to, target).exceeding(work_limit),
    }
}
