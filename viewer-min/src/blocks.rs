//! What the GPU gets of a root, as plain numbers; both drawing ways.

use std::{collections::BTreeMap, sync::Arc};

use lodpack::{
    BorderKey, PARAM_END,
    session::{Strip, Surface},
};

use crate::camera::{Pair, pair};

/// No side.
const NONE: u32 = u32::MAX;
/// Numbers of a border triangle.
pub const RECORD: usize = 12;

/// Triangles with vertices of their own, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    pub vertices: Vec<Pair>,
    pub indices: Vec<[u32; 3]>,
}

impl Triangles {
    /// Any mesh.
    pub fn of_mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        Self { vertices: positions.iter().map(|&p| pair(p)).collect(), indices: triangles.to_vec() }
    }

    /// A root with its strips: an index list stitched on the CPU.
    pub fn of_root(surface: &Surface, strips: &[Arc<Strip>]) -> Self {
        let mut made = Self::of_mesh(&surface.positions, &surface.triangles);
        for strip in strips {
            let own = (made.vertices.len() - surface.positions.len()) as u32;
            made.vertices.extend(strip.positions.iter().map(|&p| pair(p)));
            let first = surface.positions.len() as u32;
            let moved = |vertex: u32| if vertex < first { vertex } else { vertex + own };
            made.indices.extend(strip.triangles.iter().map(|triangle| triangle.map(moved)));
        }
        made
    }
}

/// A root's border triangles for vertex pulling, [`RECORD`] numbers each. The corners; then for each edge its side and the
/// parameters of its ends along the arc, or no side.
pub fn border_records(surface: &Surface) -> Vec<u32> {
    let is_corner = |vertex: &u32| matches!(surface.keys[*vertex as usize], BorderKey::Corner(_));
    let starts: Vec<u32> = (0..surface.keys.len() as u32).filter(is_corner).collect();
    let reversed: Vec<bool> = surface.half_arcs().map(|half_arc| half_arc.reversed).collect();
    let mut records = Vec::new();
    for (corners, on_border) in surface.border_triangles() {
        records.extend(corners);
        for k in 0..3 {
            if !on_border[k] {
                records.extend([NONE, 0, 0]);
                continue;
            }
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let side = starts.partition_point(|&start| start <= from) - 1;
            let ends = if reversed[side] { [PARAM_END, 0] } else { [0, PARAM_END] };
            let param = |vertex: u32, end: u32| match surface.keys[vertex as usize] {
                BorderKey::Sample { param, .. } => param,
                BorderKey::Corner(_) => end,
            };
            records.extend([side as u32, param(from, ends[0]), param(to, ends[1])]);
        }
    }
    records
}

/// What a root's border is snapped to. First the number of places that each border triangle needs at most; then for each
/// side where its samples begin and how many they are; then the samples, by ascending parameter: that and the position. Only
/// what finer neighbours have beyond the root's own samples is there.
pub fn snap_table(surface: &Surface, strips: &[Arc<Strip>], records: &[u32]) -> Vec<u32> {
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
    let places = records.chunks_exact(RECORD).map(|record| 1 + record[3..].chunks_exact(3).map(extra).sum::<usize>());
    table[0] = places.max().unwrap_or(1) as u32;
    table
}
