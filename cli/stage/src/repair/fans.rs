//! Gives every vertex exactly one fan of triangles.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::edges::{Pairing, origin};
use lodpack_mesh::{NONE, next_half_edge, previous_half_edge};
use lodpack_runtime::trace;

/// Gives each fan of a vertex a vertex of its own: the fan with the first corner keeps the number, the others get new
/// numbers from `vertex_count` on. Returns the vertex that each new one copies. Pairs must be wound consistently.
pub(super) fn split_fans(triangles: &mut [[u32; 3]], opposite: &[u32], vertex_count: usize) -> Vec<u32> {
    let mut corner_count = vec![0u32; vertex_count];
    let mut some_corner = vec![NONE; vertex_count];
    for (t, triangle) in triangles.iter().enumerate() {
        for (k, &v) in triangle.iter().enumerate() {
            corner_count[v as usize] += 1;
            some_corner[v as usize] = (3 * t + k) as u32;
        }
    }
    let has_several_fans = |v: usize| {
        let mut fan_size = 0;
        if some_corner[v] != NONE {
            for_each_in_fan(opposite, some_corner[v], |_| fan_size += 1);
        }
        fan_size != corner_count[v]
    };
    // Corners of vertices with several fans: by vertex, then in order.
    let of_all = trace::even("vertices");
    let several: Vec<bool> = (0..vertex_count).into_par_iter().map(has_several_fans).collect();
    drop(of_all);
    if !several.contains(&true) {
        return Vec::new();
    }
    let mut corners: Vec<(u32, u32)> = Vec::new();
    for (t, triangle) in triangles.iter().enumerate() {
        for (k, &v) in triangle.iter().enumerate() {
            if several[v as usize] {
                corners.push((v, (3 * t + k) as u32));
            }
        }
    }
    corners.sort_unstable();
    let mut origins = Vec::new();
    let mut done = vec![false; opposite.len()];
    let mut previous = NONE;
    for (v, corner) in corners {
        if done[corner as usize] {
            continue;
        }
        let number = if v == previous {
            origins.push(v);
            (vertex_count + origins.len() - 1) as u32
        } else {
            v
        };
        previous = v;
        for_each_in_fan(opposite, corner, |h| {
            done[h as usize] = true;
            triangles[h as usize / 3][h as usize % 3] = number;
        });
    }
    origins
}

/// Visits the half-edges that start at a vertex, within the fan of `start`.
fn for_each_in_fan(opposite: &[u32], start: u32, mut visit: impl FnMut(u32)) {
    let mut h = start;
    loop {
        visit(h);
        h = opposite[previous_half_edge(h) as usize];
        if h == start {
            return;
        }
        if h == NONE {
            break;
        }
    }
    h = start;
    loop {
        match opposite[h as usize] {
            NONE => return,
            other => h = next_half_edge(other),
        }
        visit(h);
    }
}

/// At a cut edge, several sheets may still share both ends. This gives all sheets but the first a fan of its own at one
/// end, by cutting the edges of the sheet's triangles there. Returns the number of edges cut. Fans must be split again
/// afterwards.
///
/// Sheets share both ends when a fan comes back to the edge on both sides, as around the end of a slit. The new fan
/// holds only the triangles of one sheet at this edge and shares its edges with no other, so one round per edge is
/// enough.
pub(super) fn detach_shared_edges(triangles: &[[u32; 3]], pairing: &mut Pairing) -> u64 {
    let mut sheets: BTreeMap<(u32, u32), Vec<u32>> = BTreeMap::new();
    pairing.cut.sort_unstable();
    pairing.cut.dedup();
    for &h in &pairing.cut {
        // One half-edge stands for the pair.
        if pairing.opposite[h as usize] >= h {
            let (a, b) = (origin(triangles, h), origin(triangles, next_half_edge(h)));
            sheets.entry((a.min(b), a.max(b))).or_default().push(h);
        }
    }
    let before = pairing.cut.len();
    for sheet in sheets.into_values().flat_map(|list| list.into_iter().skip(1)) {
        let other = pairing.opposite[sheet as usize];
        pairing.separate(previous_half_edge(sheet));
        if other != NONE {
            pairing.separate(next_half_edge(other));
        }
    }
    (pairing.cut.len() - before) as u64 / 2
}
