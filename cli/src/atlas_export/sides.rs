//! Which sides of charts are the same line, and the samples along it that both share.

use glam::DVec3;

use crate::chart::{BorderVertex, ChartMesh};

/// One side of one chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SideId {
    pub chart: u32,
    pub side: u32,
}

/// What is known of a side.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Side {
    /// The side that is the same line seen from the other chart. It runs the other way.
    pub partner: Option<SideId>,
    /// Positions at equal parameter steps from the side's first corner to its last, both included.
    pub samples: Vec<[f32; 3]>,
}

/// The line of a side in a form that both charts beside it find: the bits of its vertex positions, in the direction whose
/// bits come first.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Line {
    bits: Vec<[u64; 3]>,
    reversed: bool,
    id: SideId,
}

/// Samples every side of every chart at 2^(resolution + 1) equal steps of its parameter.
///
/// Sides are the same line when their vertices have the same positions, as is the case on both sides of an arc. The line is
/// sampled once, from the data and in the direction of the first chart that has it; the others get these samples. Where more
/// than two sides coincide (a non-manifold edge that was cut), opposite ones are paired in the order of their charts.
pub(super) fn sample_sides(charts: &[&ChartMesh], resolution: u32) -> Vec<Vec<Side>> {
    let mut sides: Vec<Vec<Side>> = Vec::with_capacity(charts.len());
    let mut lines = Vec::new();
    for (chart_index, chart) in charts.iter().enumerate() {
        let vertices = chart.loops.first().map_or(&[][..], |border| border.as_slice());
        let mut count = 0;
        for run in vertices.chunk_by(|a, b| a.side == b.side) {
            let id = SideId { chart: chart_index as u32, side: count };
            count += 1;
            lines.push(line_of(chart, vertices, run, id));
        }
        sides.push(vec![Side { partner: None, samples: Vec::new() }; count as usize]);
    }
    lines.sort_unstable();
    for same in lines.chunk_by(|a, b| a.bits == b.bits) {
        // All forward ones come first, each kind in the order of the charts.
        let (forward, backward) = same.split_at(same.partition_point(|line| !line.reversed));
        for (a, b) in forward.iter().zip(backward) {
            sides[a.id.chart as usize][a.id.side as usize].partner = Some(b.id);
            sides[b.id.chart as usize][b.id.side as usize].partner = Some(a.id);
        }
        let Some(owner) = same.iter().min_by_key(|line| line.id) else { continue };
        let samples = sample_side(charts[owner.id.chart as usize], owner.id.side, resolution);
        for line in same {
            let mut own = samples.clone();
            if line.reversed != owner.reversed {
                own.reverse();
            }
            sides[line.id.chart as usize][line.id.side as usize].samples = own;
        }
    }
    sides
}

/// `run` are the vertices of one side without its last corner, which is the next side's first.
fn line_of(chart: &ChartMesh, border: &[BorderVertex], run: &[BorderVertex], id: SideId) -> Line {
    // Zero has two bit patterns; adding zero leaves one.
    let bits_of = |v: &BorderVertex| chart.positions[v.vertex as usize].to_array().map(|x| (x + 0.0).to_bits());
    let mut bits: Vec<[u64; 3]> = run.iter().map(bits_of).collect();
    bits.extend(end_of_side(border, id.side).map(bits_of));
    let reversed = bits.iter().rev().lt(bits.iter());
    if reversed {
        bits.reverse();
    }
    Line { bits, reversed, id }
}

/// The corner at which a side ends.
fn end_of_side(border: &[BorderVertex], side: u32) -> Option<&BorderVertex> {
    border.iter().find(|v| v.side == side + 1).or(border.first())
}

/// Positions at equal steps of the parameter, linear between the border's vertices.
fn sample_side(chart: &ChartMesh, side: u32, resolution: u32) -> Vec<[f32; 3]> {
    let border = chart.loops.first().map_or(&[][..], |border| border.as_slice());
    let mut knots: Vec<(f64, DVec3)> =
        border.iter().filter(|v| v.side == side).map(|v| (v.param, chart.positions[v.vertex as usize])).collect();
    knots.extend(end_of_side(border, side).map(|v| (1.0, chart.positions[v.vertex as usize])));
    let step_count = 2usize << resolution;
    let mut segment = 0;
    let sample = |k: usize| {
        let param = k as f64 / step_count as f64;
        while segment + 2 < knots.len() && knots[segment + 1].0 <= param {
            segment += 1;
        }
        let ((start, a), (end, b)) = (knots[segment], knots[segment + 1]);
        // The ends exactly: they are corners, which other sides share.
        let position = match (param - start) / (end - start) {
            f if f <= 0.0 => a,
            f if f >= 1.0 => b,
            f => a + (b - a) * f,
        };
        position.as_vec3().to_array()
    };
    (0..=step_count).map(sample).collect()
}
