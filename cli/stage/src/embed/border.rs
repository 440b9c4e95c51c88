//! Checks that a chart is a disk with a sound border, and places that border on the polygon.

use glam::DVec2;

use super::polygon::{self, MAX_CORNERS, MIN_CORNERS};
use super::{EmbedError, chords::Refined};
use crate::chart::ChartMesh;
use lodpack_mesh::{Adjacency, NONE};

/// Checks a chart and returns its number of corners, if it is a disk whose only loop is sound.
pub(super) fn check_disk(chart: &ChartMesh, adjacency: &Adjacency) -> Result<usize, EmbedError> {
    let vertex_count = chart.positions.len();
    let mut used = vec![false; vertex_count];
    for &v in chart.triangles.iter().flatten() {
        used[v as usize] = true;
    }
    // Each inner edge has two half-edges, each border edge one.
    let border_edge_count = adjacency.opposite.iter().filter(|&&o| o == NONE).count();
    let edge_count = (chart.triangles.len() * 3 + border_edge_count) / 2;
    let used_count = used.iter().filter(|&&u| u).count();
    let euler_characteristic = (used_count + chart.triangles.len()) as i64 - edge_count as i64;
    let [border] = chart.loops.as_slice() else {
        return Err(EmbedError::NotADisk { loop_count: chart.loops.len(), euler_characteristic });
    };
    if euler_characteristic != 1 {
        return Err(EmbedError::NotADisk { loop_count: 1, euler_characteristic });
    }

    let unsound = |index: usize, what| Err(EmbedError::UnsoundBorder { index, what });
    if border.len() != border_edge_count {
        return unsound(0, "the loop and the open edges of the triangles differ in number");
    }
    // The vertex to which the open half-edge from each vertex leads. A disk's border passes each vertex once.
    let mut successor = vec![NONE; vertex_count];
    for (h, _) in adjacency.opposite.iter().enumerate().filter(|&(_, &o)| o == NONE) {
        let t = chart.triangles[h / 3];
        successor[t[h % 3] as usize] = t[(h + 1) % 3];
    }
    for (i, v) in border.iter().enumerate() {
        let next = border[(i + 1) % border.len()];
        if successor.get(v.vertex as usize) != Some(&next.vertex) {
            return unsound(i, "the loop does not follow the open edges of the triangles");
        }
        let in_order = if i == 0 {
            v.side == 0 && v.param == 0.0
        } else {
            let last = border[i - 1];
            (v.side == last.side && v.param > last.param) || (v.side == last.side + 1 && v.param == 0.0)
        };
        if !in_order || !(0.0..1.0).contains(&v.param) {
            return unsound(
                i,
                "sides must be numbered in order, and their parameters must start at 0, grow strictly and stay below 1",
            );
        }
    }
    let corner_count = border.last().map_or(0, |v| v.side as usize + 1);
    if !(MIN_CORNERS..=MAX_CORNERS).contains(&corner_count) {
        return Err(EmbedError::CornerCount { corner_count });
    }
    Ok(corner_count)
}

/// Puts the border vertices on the sides of the polygon and all other vertices at its centre.
pub(super) fn place_border(chart: &ChartMesh, corner_count: usize, refined: &Refined) -> Vec<DVec2> {
    let mut uv = vec![DVec2::ZERO; refined.vertex_count()];
    for v in chart.loops.iter().flatten() {
        uv[v.vertex as usize] = polygon::side_point(corner_count, v.side as usize, v.param);
    }
    uv
}
