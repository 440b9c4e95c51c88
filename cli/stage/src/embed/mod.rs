//! Embed: finds a bijection between a disk-shaped chart and a regular polygon with as many corners.
//!
//! The method is Tutte's embedding ("How to draw a graph", 1963; Floater, "One-to-one piecewise linear mappings over
//! triangulations", 2003, for borders that are convex but not strictly convex), with the border fixed on the polygon.
//! With positive symmetric weights, placing every inner vertex at the mean of its neighbours gives a map without flips.
//! The first solve uses uniform weights; one or two rounds of symmetric reweighting by stretch follow. Rounding can
//! still flip triangles where a chart is crowded beyond double precision, so the orientation of every triangle is
//! decided exactly.
//!
//! Later stages may assume that every triangle of the map is exactly counter-clockwise and that border vertices lie on
//! their side at their parameter. One thread embeds one chart; charts run in parallel. The result depends on the chart
//! and the options alone.

mod border;
mod chords;
mod locate;
mod polygon;
mod report;
mod solve;
mod stretch;
mod system;

use std::borrow::Cow;

use glam::{DVec2, DVec3};

pub use locate::{Location, Locator};
pub use polygon::{MAX_CORNERS, MIN_CORNERS, corner_point, quad_coordinates, quad_point, side_point};
pub use report::EmbedReport;

use crate::chart::ChartMesh;
use lodpack_mesh::Adjacency;

/// Options of [`embed_chart`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct EmbedOptions {
    /// Rounds of stretch reweighting; each costs about a quarter of the first solve. The first round brings nearly all
    /// of the gain, the second a little where charts are crowded, further rounds nothing.
    pub reweightings: u32,
    /// Charts with a larger total L2 stretch are refused: a grid would need several times the samples of an even map,
    /// and the irregular filling is smaller.
    pub stretch_limit: f64,
    /// Charts in which a larger share of the area is under-sampled ([`EmbedQuality::undersampled_area`]) are refused.
    pub undersampled_limit: f64,
    /// Decades over which the weights of the first solve are spread. Default 0: all weights are 1. Tests use this to
    /// make stiff systems.
    pub weight_decades: f64,
}

impl Default for EmbedOptions {
    fn default() -> Self {
        Self { reweightings: 1, stretch_limit: 8.0, undersampled_limit: 0.05, weight_decades: 0.0 }
    }
}

/// The map of a chart onto the regular polygon inscribed in the unit circle.
///
/// Corner i is at the angle 2 pi i / n; side i runs from corner i to corner i + 1 and follows the chart's loop. The map
/// is linear on each of `triangles`. These are the chart's own, except that chords (inner edges with both ends on the
/// border) are halved by vertices of the map, which lie in the middle of the chord on the surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Embedding {
    /// Number of the chart's corners, sides and quads: [`MIN_CORNERS`] ..= [`MAX_CORNERS`].
    pub corner_count: usize,
    /// Point of each chart vertex, then of the midpoint of each of `chords`.
    pub uv: Vec<DVec2>,
    /// The triangles on which the map is linear, as indices into `uv`; all exactly counter-clockwise in the plane.
    pub triangles: Vec<[u32; 3]>,
    /// Neighbours of `triangles`.
    pub adjacency: Adjacency,
    /// The chart vertices at both ends of each halved chord.
    pub chords: Vec<[u32; 2]>,
    /// For each of `triangles` beyond the number of the chart's own: the chart triangle that it is part of. A triangle
    /// below that number is the chart's triangle of the same index, or the first part of it.
    pub source: Vec<u32>,
    /// How even the map is.
    pub quality: EmbedQuality,
}

/// How even a map is. All stretches are L2 stretches, normalised to 1 for a map that is an isometry up to scale.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EmbedQuality {
    /// L2 stretch of the whole map.
    pub stretch_total: f64,
    /// Half of the surface area has at most this stretch.
    pub stretch_p50: f64,
    /// Nine tenths of the surface area have at most this stretch.
    pub stretch_p90: f64,
    /// Stretch of the worst triangle.
    pub stretch_max: f64,
    /// Share of the surface area where the map shrinks below 1/16 of its mean density.
    pub undersampled_area: f64,
    /// Triangles that rounding flipped in a solve and that are positive in the result.
    pub flips_repaired: u32,
    /// Largest distance of an inner vertex from the weighted mean of its neighbours, in radii of the polygon.
    pub residual: f64,
    /// A lower bound on the condition number of the linear system, for the worst solve: the squared ratio of the
    /// largest to the smallest diagonal entry of the Cholesky factor.
    pub conditioning: f64,
}

/// Why a chart has no embedding. It can still have an irregular filling.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EmbedError {
    /// The chart has holes or handles, or is closed.
    #[error(
        "chart is not a disk: {loop_count} border loops, Euler characteristic {euler_characteristic} (a disk has 1 and 1); \
         cut it or give it an irregular filling"
    )]
    NotADisk {
        /// Border loops.
        loop_count: usize,
        /// Vertices - edges + triangles.
        euler_characteristic: i64,
    },
    /// The border loop contradicts the triangles or itself.
    #[error("chart border is unsound at vertex {index} of its loop: {what}")]
    UnsoundBorder {
        /// Index into the loop.
        index: usize,
        /// The rule that is broken.
        what: &'static str,
    },
    /// The polygon would have too few or too many corners.
    #[error(
        "chart has {corner_count} corners, a polygon needs {} to {}; move its arcs or give it an irregular filling",
        MIN_CORNERS,
        MAX_CORNERS
    )]
    CornerCount {
        /// Corners of the chart.
        corner_count: usize,
    },
    /// Triangles stay flipped or degenerate in double precision.
    #[error(
        "{flipped_count} triangles of the chart stay flipped in the plane; cut it lengthwise or give it an irregular filling"
    )]
    Flipped {
        /// Triangles that are not counter-clockwise.
        flipped_count: usize,
    },
    /// The map is too uneven for a grid.
    #[error(
        "chart is too uneven for a grid: stretch {stretch:.2} (limit {}), {:.1} % of its area under-sampled (limit {:.1} %); \
         cut it lengthwise or give it an irregular filling",
        options.stretch_limit, 100.0 * undersampled_area, 100.0 * options.undersampled_limit
    )]
    TooUneven {
        /// Total L2 stretch.
        stretch: f64,
        /// Share of the area that is under-sampled.
        undersampled_area: f64,
        /// The options whose limits were exceeded.
        options: EmbedOptions,
    },
    /// The linear system could not be solved.
    #[error(
        "the linear system of the chart is not positive definite or does not fit in memory; give it an irregular filling"
    )]
    Factorisation,
}

impl Embedding {
    /// Positions on the surface of the map's vertices: the chart's, then the middle of each chord.
    pub fn positions<'a>(&self, chart: &'a ChartMesh) -> Cow<'a, [DVec3]> {
        if self.chords.is_empty() {
            return Cow::Borrowed(&chart.positions);
        }
        let middle = |&[a, b]: &[u32; 2]| chart.positions[a as usize].midpoint(chart.positions[b as usize]);
        Cow::Owned(chart.positions.iter().copied().chain(self.chords.iter().map(middle)).collect())
    }

    /// The chart triangle of which a triangle of the map is all or part.
    pub fn chart_triangle(&self, triangle: u32) -> u32 {
        let chart_count = self.triangles.len() - self.source.len();
        (triangle as usize).checked_sub(chart_count).map_or(triangle, |part| self.source[part])
    }

    /// A locator, which finds points of the polygon in the map's triangles.
    pub fn locator(&self) -> Locator<'_> {
        Locator::new(&self.uv, &self.triangles, &self.adjacency)
    }
}

/// Maps a chart onto the regular polygon with as many corners.
///
/// Triangle indices must be below the number of vertices. Border vertices are placed on their side at their parameter.
///
/// # Errors
///
/// See [`EmbedError`]: each variant concerns this chart alone.
pub fn embed_chart(chart: &ChartMesh, options: &EmbedOptions) -> Result<Embedding, EmbedError> {
    let adjacency = Adjacency::new(&chart.triangles, chart.positions.len());
    let corner_count = border::check_disk(chart, &adjacency)?;
    let refined = chords::split_chords(chart, adjacency);
    let start = border::place_border(chart, corner_count, &refined);
    let solution = solve::solve(&refined, start, options)?;

    let mut quality = solution.stretch.quality();
    quality.flips_repaired = solution.flips_repaired;
    quality.residual = solution.residual;
    quality.conditioning = solution.conditioning;
    if quality.stretch_total > options.stretch_limit || quality.undersampled_area > options.undersampled_limit {
        return Err(EmbedError::TooUneven {
            stretch: quality.stretch_total,
            undersampled_area: quality.undersampled_area,
            options: *options,
        });
    }
    Ok(Embedding {
        corner_count,
        uv: solution.uv,
        triangles: refined.triangles,
        adjacency: refined.adjacency,
        chords: refined.chords,
        source: refined.source,
        quality,
    })
}

#[cfg(test)]
pub(crate) mod tests;
