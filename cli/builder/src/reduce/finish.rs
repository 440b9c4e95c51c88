//! A mesh with a stated number of triangles, made from a finer cut of a file.
//!
//! The levels of a file are a factor of four apart, so a cut for a number in between mixes two of them, and its mean
//! error is nearer to the coarser one's. A finer cut, [reduced](super::ways) as a whole, has neither levels nor borders
//! in it: its RMS error is about half of the mixture's. Its certified error is the cut's and that of the reduction
//! together.

use glam::DVec3;
use lodpack::source::ReadAt;
use lodpack::{Cut, File, Lattice, Limiter, Query};

use super::surface::CoarseSurface;
use super::ways::{Reduced, Topology, Ways, reductions};

/// A cut has this many times the triangles that are asked for, so that its error hardly counts beside that of the
/// reduction.
const CUT_PER_TRIANGLE: u64 = 8;
/// The fewest triangles of a cut: coarse levels have lost more by their borders than a new topology can.
const SMALL_CUT: u64 = 20_000;
/// Beyond this number of triangles the next factor must do: time grows with the cut.
const LARGE_CUT: u64 = 200_000;
/// A cut of more has this many times the triangles that are asked for.
const LARGE_CUT_PER_TRIANGLE: f64 = 2.5;

/// A reduced cut.
#[derive(Clone, Debug, PartialEq)]
pub struct Finished {
    /// World coordinates.
    pub positions: Vec<[f64; 3]>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Bound of the two-sided distance to the input, world units.
    pub error: f64,
    /// What became of the topology.
    pub topology: Topology,
    /// The area of each triangle; empty if that is not known.
    pub areas: Vec<u32>,
}

/// The triangles that a cut may have from which `triangles` are to be made.
fn cut_triangles(triangles: u64) -> u64 {
    let several = triangles.saturating_mul(CUT_PER_TRIANGLE).clamp(SMALL_CUT, LARGE_CUT);
    several.max((triangles as f64 * LARGE_CUT_PER_TRIANGLE) as u64)
}

/// The cut of a query from which `triangles` triangles are to be made, and the finest one that has no more as it is, if
/// there is one.
///
/// # Errors
/// Those of [`File::select`].
pub fn cut_to_finish<S: ReadAt>(file: &File<S>, query: &Query, triangles: u64) -> lodpack::Result<(Cut, Option<Cut>)> {
    let mut most = cut_triangles(triangles);
    let coarser = match file.select(&Query { max_triangles: Some(triangles), ..query.clone() }) {
        Err(lodpack::Error::Query { .. }) => None,
        cut => Some(cut?),
    };
    loop {
        let cut = match file.select(&Query { max_triangles: Some(most), ..query.clone() }) {
            // The coarsest cut of many small parts may be larger.
            Err(lodpack::Error::Query { .. }) => {
                file.select(&Query { max_triangles: None, tolerance: Some(f64::MAX), ..query.clone() })?
            }
            cut => cut?,
        };
        if cut.triangle_count >= triangles || cut.limited_by != Limiter::Triangles {
            return Ok((cut, coarser));
        }
        most = most.saturating_mul(2);
    }
}

/// Whether a cut that has few enough triangles is nearer than a reduced one with an error.
pub fn is_nearer(cut: &Cut, error: f64) -> bool {
    cut.error_everywhere() < error
}

/// Reduces the mesh of a cut to at most `triangles` triangles. `positions` are world coordinates of points of the
/// lattice; `error` bounds their distance to the input. None if there is no surface of so few triangles.
pub fn finish(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    error: f64,
    lattice: &Lattice,
    most_triangles: usize,
) -> Option<Finished> {
    finished_ways(positions, triangles, error, Ways::Nearest, lattice, most_triangles).into_iter().next()
}

/// As [`finish`], made in several ways, the one that is taken first. The areas of [`Ways::Each`] are those of the cut
/// between which its colours jump.
pub(super) fn finished_ways(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    error: f64,
    ways: Ways<'_>,
    lattice: &Lattice,
    most_triangles: usize,
) -> Vec<Finished> {
    let surface = local_surface(positions, triangles, error, lattice);
    let finished = |reduced| Finished::new(reduced, lattice);
    reductions(&surface, ways, most_triangles, Some).into_iter().map(finished).collect()
}

impl Finished {
    pub(super) fn new(Reduced { surface, topology, areas }: Reduced, lattice: &Lattice) -> Self {
        let CoarseSurface { positions, triangles, error } = surface;
        let origin = DVec3::from_array(lattice.origin);
        let positions = positions.iter().map(|&p: &DVec3| (origin + p).to_array()).collect();
        Self { positions, triangles, error, topology, areas }
    }
}

/// A cut relative to the lattice's origin.
pub(super) fn local_surface(
    positions: &[[f64; 3]],
    triangles: &[[u32; 3]],
    error: f64,
    lattice: &Lattice,
) -> CoarseSurface {
    // Exact, since lattice coordinates are whole and steps are powers of two.
    let step = lattice.step();
    let local = |p: &[f64; 3]| DVec3::from_array(lattice.units(*p).map(|x| x.round() * step));
    CoarseSurface { positions: positions.iter().map(local).collect(), triangles: triangles.to_vec(), error }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cuts_are_several_times_as_large_but_large_ones_fewer_times() {
        assert_eq!(
            [10, 5_000, 25_000, 50_000, 100_000].map(cut_triangles),
            [20_000, 40_000, 200_000, 200_000, 250_000]
        );
    }

    /// A row of closed boxes on a lattice of quarters, far from the origin.
    fn boxes(count: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>, Lattice) {
        let lattice = Lattice { origin: [5e6, -3e6, 1.0], step_log2: -2 };
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let (mut positions, mut triangles) = (vec![], vec![]);
        for i in 0..count {
            let first = positions.len() as u32;
            let corner = |bits: u32| [12 * i + 4 * (bits & 1), 4 * (bits >> 1 & 1), 4 * (bits >> 2)].map(i64::from);
            positions.extend((0..8).map(|bits| lattice.world(corner(bits))));
            let quads = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
            triangles.extend(quads.map(|corners| corners.map(|v| v + first)));
        }
        (positions, triangles, lattice)
    }

    #[test]
    fn parts_are_simplified_as_one_and_errors_add_up() {
        let (positions, triangles, lattice) = boxes(200);
        let mut before = 0.0;
        for most in [2400, 1200] {
            let finished = finish(&positions, &triangles, 0.5, &lattice, most).unwrap();
            assert!(finished.triangles.len() <= most && !finished.triangles.is_empty());
            assert!(finished.error >= 0.5 && finished.error >= before, "{most}: {} {before}", finished.error);
            // A box keeps its topology with four triangles.
            assert_eq!(finished.topology, Topology::Kept);
            before = finished.error;
        }
        // Parts in one row may have nothing in common but a line.
        let few = finish(&positions, &triangles, 0.5, &lattice, 40);
        assert!(few.is_none_or(|few| few.triangles.len() <= 40 && few.topology != Topology::Kept));
        assert_eq!(finish(&positions, &triangles, 0.5, &lattice, 0), None);
    }
}
