//! Samples of the arcs, and the sides of charts that share them.

use rayon::prelude::*;

use super::product::{ArcKnot, AtlasChart};
use lodpack_stage::arcs::HalfArc;

/// One side of one chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SideId {
    pub chart: u32,
    pub side: u32,
    /// Whether the side runs against its arc.
    pub reversed: bool,
}

/// Samples every arc once, in its own direction, at 2^(resolution + 1) equal steps of its parameter. Everything that
/// borders on the arc takes these samples, so all agree.
pub(super) fn sample_arcs(arcs: &[Vec<ArcKnot>], resolution: u32) -> Vec<Vec<[f32; 3]>> {
    arcs.par_iter().map(|knots| sample_arc(knots, 2usize << resolution)).collect()
}

/// The sides along each arc, in the order of the charts: at most two.
pub(super) fn sides_of_arcs(charts: &[AtlasChart], arc_count: usize) -> Vec<Vec<SideId>> {
    let mut sides_of = vec![Vec::new(); arc_count];
    for (chart_index, chart) in charts.iter().enumerate() {
        for (side, half) in chart.sides.iter().enumerate() {
            let id = SideId { chart: chart_index as u32, side: side as u32, reversed: half.reversed };
            sides_of[half.arc as usize].push(id);
        }
    }
    sides_of
}

/// For all sides of all charts the same arc as a side of the other chart, if there is one. It runs the other way.
pub(super) fn partners_of(charts: &[AtlasChart], sides_of: &[Vec<SideId>]) -> Vec<Vec<Option<SideId>>> {
    let partner = |half: &HalfArc| {
        let others = &sides_of[half.arc as usize];
        others.iter().find(|other| other.reversed != half.reversed).copied()
    };
    charts.iter().map(|chart| chart.sides.iter().map(partner).collect()).collect()
}

/// Positions at equal steps of the parameter, linear between the knots.
fn sample_arc(knots: &[ArcKnot], step_count: usize) -> Vec<[f32; 3]> {
    let mut segment = 0;
    let sample = |k: usize| {
        let param = k as f64 / step_count as f64;
        while segment + 2 < knots.len() && knots[segment + 1].param <= param {
            segment += 1;
        }
        let (start, end) = (knots[segment], knots[segment + 1]);
        // The ends are exact, because they are corners that other arcs share.
        let position = match (param - start.param) / (end.param - start.param) {
            f if f <= 0.0 => start.position,
            f if f >= 1.0 => end.position,
            f => start.position + (end.position - start.position) * f,
        };
        position.as_vec3().to_array()
    };
    (0..=step_count).map(sample).collect()
}
