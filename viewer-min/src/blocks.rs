//! A root's data for the GPU, as plain numbers, for both ways of drawing.

use std::collections::BTreeMap;

use lodpack::{
    decode::{BorderKey, PARAM_END},
    stream::{BorderEdge, DrawnRoot, DrawnSurface},
};

use crate::camera::pair;

/// Marks an edge that is on no side.
const NONE: u32 = u32::MAX;
/// Numbers per border triangle.
pub const RECORD: usize = 12;

/// A root's border triangles for vertex pulling, [`RECORD`] numbers each: the corners, then for each edge its side and
/// the parameters of its ends along the arc, or no side.
pub fn border_records(surface: &DrawnSurface) -> Vec<u32> {
    let edge = |edge: Option<BorderEdge>| match edge {
        Some(BorderEdge { side, params: [from, to] }) => [side, from, to],
        None => [NONE, 0, 0],
    };
    let triangles = surface.border_triangles();
    triangles.flat_map(|(corners, edges)| corners.into_iter().chain(edges.into_iter().flat_map(edge))).collect()
}

/// The samples to which a root's border is snapped. First the most triangles that the fan of any border triangle needs; then, for
/// each side, the index and the number of its samples; then the samples by ascending parameter, each its parameter and
/// position. Contains only what finer neighbours have beyond the root's own samples.
pub fn snap_table(DrawnRoot { surface, strips, .. }: &DrawnRoot, records: &[u32]) -> Vec<u32> {
    let mut samples: BTreeMap<(u32, u32), [f64; 3]> = BTreeMap::new();
    for (key, &position) in strips.iter().flat_map(|strip| strip.keys.iter().zip(&strip.positions)) {
        if let BorderKey::Sample { arc, param } = *key {
            samples.insert((arc, param), position);
        }
    }
    let arcs: Vec<u32> = surface.half_arcs().map(|half_arc| half_arc.arc).collect();
    let mut table = vec![0; 1 + 2 * arcs.len()];
    for (side, &arc) in arcs.iter().enumerate() {
        let own = samples.range((arc, 0)..(arc, PARAM_END));
        (table[1 + 2 * side], table[2 + 2 * side]) = (table.len() as u32, own.clone().count() as u32);
        for (&(_, param), &position) in own {
            table.push(param);
            table.extend(pair(position).map(f32::to_bits));
        }
    }
    let extra = |edge: &[u32]| {
        let (low, high) = (edge[1].min(edge[2]), edge[1].max(edge[2]));
        arcs.get(edge[0] as usize).map_or(0, |&arc| samples.range((arc, low)..(arc, high)).count())
    };
    let fans = records.chunks_exact(RECORD).map(|record| 1 + record[3..].chunks_exact(3).map(extra).sum::<usize>());
    table[0] = fans.max().unwrap_or(1) as u32;
    table
}
