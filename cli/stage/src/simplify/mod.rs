//! Simplify: makes the levels of an irregular filling by quadric-error edge collapse inside one chart (Garland and
//! Heckbert, "Surface Simplification Using Quadric Error Metrics", 1997).
//!
//! One sequence of collapses yields all levels, the finest first. It begins with sweeps over all edges, which take what
//! is cheap; a queue takes the others, the cheapest first, in passes that each measure from the surface that the one
//! before has left. Interior vertices move to where their quadric is smallest. The border follows the samples of the
//! arcs: at each level the border vertices that are not samples are removed along the border, whatever that costs, and
//! those that remain never move. So every level meets its neighbours without cracks.
//!
//! Later stages may assume that a level's border is exactly the samples of its arcs and that its triangles are an
//! oriented manifold with the topology of the chart. A level that [`SimplifiedChart::cap_missing`] had to fill has that
//! border, but one fan per loop.
//!
//! The work is done in coordinates relative to the chart and scaled by a power of two to about unit size, so neither
//! the scale nor the position of the input matters.

mod collapse;
mod early;
mod forced;
mod half_edges;
mod passes;
mod planes;
mod quadric;
mod queue;
mod sweep;
#[cfg(test)]
mod tests;
mod unfold;

use glam::DVec3;

pub use self::early::Early;
pub use self::quadric::Quadric;

use self::collapse::Collapser;
use self::half_edges::HalfEdges;
use crate::areas::Areas;
use crate::chart::{BorderVertex, ChartMesh, FREE};
use lodpack_mesh::NONE;

/// Options of [`simplify_chart`].
#[derive(Clone, Copy, Debug, Default)]
pub struct SimplifyOptions<'a> {
    /// For each level, coarsest first, a length in input units that acts like an RMS distance. Vertices are merged
    /// while the mean squared distance to the planes of all triangles merged so far, weighted by area, is at most its
    /// square. With 0, only those vertices disappear that must; if it is infinite, any may, until `min_triangles` are
    /// left.
    pub thresholds: &'a [f64],
    /// The first of these levels that is wanted.
    pub coarsest: usize,
    /// For each input vertex a factor >= 1 on its quadric, but not on its weight in the mean: where an earlier attempt
    /// exceeded the tolerance, the factor keeps the surface finer. The list may be shorter than the vertices; the rest
    /// count as 1.
    pub importance: Option<&'a [f32]>,
    /// Number of triangles at which merging by choice stops; border vertices are removed even below it. 0 means no
    /// limit.
    pub min_triangles: usize,
    /// Where the threshold is infinite: at how many times `min_triangles` planes are renewed, the most first. The more
    /// often, the nearer the surface, as long as many triangles go in between; and the farther off are thin parts.
    pub stops: &'a [f64],
    /// The areas of the triangles, if colours jump between some: the lines between these stay as near as the surface.
    pub areas: Option<Areas<'a>>,
}

/// A chart at one level.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LevelPatch {
    /// Chart-local vertices of the border samples, loop after loop: exactly those of this level or coarser ones.
    pub border: Vec<u32>,
    /// Number of border samples of each loop.
    pub border_loops: Vec<u32>,
    /// Positions of the interior vertices, in input units.
    pub interior: Vec<DVec3>,
    /// The chart-local vertex that each interior vertex was, which may have moved since, or [`NONE`]; empty if unknown.
    pub interior_was: Vec<u32>,
    /// For each interior vertex, the squared distance to the planes merged into it, as a function of the *offset from
    /// that vertex* in input units. With it, a codec can slide a quantised vertex along a line to the best position.
    pub interior_quadrics: Vec<Quadric>,
    /// Indices into `border` followed by `interior`, counter-clockwise, as in `lodpack::decode::Patch`.
    pub triangles: Vec<[u32; 3]>,
    /// The area of each triangle; empty if nothing is known of them.
    pub areas: Vec<u32>,
}

/// A border vertex that could not be removed at a level without changing the topology.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StuckBorder {
    /// Chart-local vertex.
    pub vertex: u32,
    /// The level from which it should have been removed.
    pub level: u8,
}

/// All levels of a chart.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SimplifiedChart {
    /// One entry per threshold, coarsest first. `None` if the border that the level demands could not be made. If all
    /// entries are `None` and nothing is stuck, the chart is not a manifold, or its loops are not its border.
    pub levels: Vec<Option<LevelPatch>>,
    /// The vertices that prevented the missing levels. The levels become possible once these vertices are samples of
    /// them.
    pub stuck: Vec<StuckBorder>,
}

impl SimplifiedChart {
    /// Gives each missing level from `coarsest` on the coarsest surface with the right border: a fan around the centre
    /// of every loop. That is far from the surface, but a bound can say how far, so it is better than no level.
    pub fn cap_missing(&mut self, chart: &ChartMesh, coarsest: usize) {
        for (level, patch) in (0..).zip(&mut self.levels).skip(coarsest) {
            if patch.is_none() {
                *patch = Some(capped(chart, level));
            }
        }
    }
}

fn capped(chart: &ChartMesh, level: u8) -> LevelPatch {
    let mut patch = LevelPatch::default();
    let border_count = chart.loops.iter().flatten().filter(|b| b.level <= level).count() as u32;
    for (apex, samples) in (border_count..).zip(&chart.loops) {
        let first = patch.border.len() as u32;
        patch.border.extend(samples.iter().filter(|b| b.level <= level).map(|b| b.vertex));
        let count = patch.border.len() as u32 - first;
        let centre =
            patch.border[first as usize..].iter().map(|&v| chart.positions[v as usize] / f64::from(count)).sum();
        patch.triangles.extend((0..count).map(|i| [first + i, first + (i + 1) % count, apex]));
        patch.border_loops.push(count);
        patch.interior.push(centre);
        patch.interior_quadrics.push(Quadric::default());
    }
    patch
}

/// How many sweeps a chart begins with. With three, the dragon has 38 more triangles, and with five 42 fewer.
const FIRST_SWEEPS: u32 = 4;
/// What these may take: edges whose mean squared distance is at most this share of what the level allows.
const CHEAP: f64 = 0.1;
/// Mean squared distances below this are rounding errors, in coordinates of about unit size.
const ROUNDING: f64 = 1e-15;

/// Makes every level of a chart by one sequence of collapses, from the finest to the coarsest.
pub fn simplify_chart(chart: &ChartMesh, options: &SimplifyOptions) -> SimplifiedChart {
    simplify_again(chart, options, None)
}

/// As [`simplify_chart`]. What the first attempt at a chart leaves in `early` makes further ones faster that differ in
/// importance alone.
pub fn simplify_again(
    chart: &ChartMesh,
    options: &SimplifyOptions,
    mut early: Option<&mut Option<Early>>,
) -> SimplifiedChart {
    let level_count = options.thresholds.len().min(usize::from(FREE));
    let mut result = SimplifiedChart { levels: vec![None; level_count], stuck: Vec::new() };
    let Some(mesh) = HalfEdges::new(&chart.triangles, chart.positions.len()).filter(|m| border_is(chart, m)) else {
        return result;
    };
    let unit_cube = UnitCube::of(&chart.positions);
    let positions: Vec<DVec3> = chart.positions.iter().map(|&p| (p - unit_cube.centre) / unit_cube.unit).collect();
    let border = || chart.loops.iter().flatten().map(|b| (b.vertex, b.level));
    let mut collapser = Collapser::new(mesh, positions, border(), options);

    for level in (options.coarsest.min(level_count)..level_count).rev() {
        let threshold = options.thresholds[level] / unit_cube.unit;
        // Anything below the rounding of unit coordinates is not an error, unless no error is allowed: then nothing is
        // removed by choice. A surface folded into a plane would otherwise count as flat and lose its folds.
        let squared = if threshold > 0.0 { threshold * threshold + ROUNDING } else { -1.0 };
        if level + 1 == level_count {
            match early.take() {
                Some(Some(early)) => early.repeat(&mut collapser, options.importance),
                first => {
                    let merges = collapser.sweep(FIRST_SWEEPS, CHEAP * squared);
                    if let Some(early) = first {
                        *early = Some(Early { merges, importance: options.importance.unwrap_or_default().to_vec() });
                    }
                }
            }
        }
        collapser.approach(level as u8, squared);
        let remaining = loop {
            collapser.drain();
            let remaining: Vec<u32> =
                border().map(|(v, _)| v).filter(|&v| collapser.mesh.is_alive(v) && collapser.must_go(v)).collect();
            if remaining.is_empty() || !collapser.force_border(&remaining) {
                break remaining;
            }
        };
        collapser.unfold();
        if remaining.is_empty() {
            result.levels[level] = Some(level_patch(chart, &collapser, level as u8, &unit_cube, options.areas));
        } else {
            result.stuck.extend(remaining.into_iter().map(|vertex| StuckBorder { vertex, level: level as u8 }));
        }
    }
    result
}

/// Working coordinates: input = centre + unit * coordinate, which fits the chart into about a unit cube.
struct UnitCube {
    centre: DVec3,
    /// A power of two, so that scaling rounds nothing.
    unit: f64,
}

impl UnitCube {
    fn of(positions: &[DVec3]) -> Self {
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        // The exponent without the mantissa: the largest power of two up to half the extent.
        let unit = f64::from_bits((0.5 * (high - low).max_element()).to_bits() & (0x7ff << 52));
        let centre = 0.5 * (low + high);
        if unit.is_normal() && centre.is_finite() { Self { centre, unit } } else { Self { centre: low, unit: 1.0 } }
    }
}

/// Whether the loops of a chart are the border of its triangles.
fn border_is(chart: &ChartMesh, mesh: &HalfEdges) -> bool {
    let listed: usize = chart.loops.iter().map(Vec::len).sum();
    let present = (0..chart.positions.len() as u32).filter(|&v| mesh.is_border(v)).count();
    let follows =
        |from: u32, to: u32| mesh.fan(from).next().is_some_and(|h| mesh.twin(h) == NONE && mesh.target(h) == to);
    listed == present
        && chart.loops.iter().all(|l| l.iter().zip(l.iter().cycle().skip(1)).all(|(a, b)| follows(a.vertex, b.vertex)))
}

/// Copies the current mesh into a patch.
fn level_patch(
    chart: &ChartMesh,
    collapser: &Collapser,
    level: u8,
    unit_cube: &UnitCube,
    areas: Option<Areas>,
) -> LevelPatch {
    let mut patch = LevelPatch::default();
    let mut index = vec![NONE; chart.positions.len()];
    for samples in &chart.loops {
        let before = patch.border.len();
        let stays = |b: &&BorderVertex| b.level <= level || b.level == FREE && collapser.mesh.is_alive(b.vertex);
        patch.border.extend(samples.iter().filter(stays).map(|b| b.vertex));
        patch.border_loops.push((patch.border.len() - before) as u32);
    }
    for (i, &v) in patch.border.iter().enumerate() {
        index[v as usize] = i as u32;
    }
    for v in 0..chart.positions.len() as u32 {
        if collapser.mesh.is_alive(v) && !collapser.mesh.is_border(v) {
            index[v as usize] = (patch.border.len() + patch.interior.len()) as u32;
            let p = collapser.positions[v as usize];
            patch.interior.push(unit_cube.centre + p * unit_cube.unit);
            patch.interior_was.push(v);
            patch.interior_quadrics.push(collapser.quadrics[v as usize].centred(p, unit_cube.unit));
        }
    }
    patch.triangles = collapser.mesh.triangles().map(|t| t.map(|v| index[v as usize])).collect();
    if let Some(areas) = areas {
        patch.areas = collapser.mesh.remaining().map(|slot| areas.of_triangles[slot]).collect();
    }
    patch
}
