//! What the GPU gets of a root, as plain numbers; both drawing ways.

use lodpack::{
    BorderKey,
    session::{Strip, Surface},
};

/// Words of a vertex: a position as pairs of floats.
pub const VERTEX_WORDS: usize = 6;
/// No side.
const NONE: u32 = u32::MAX;
/// Where an arc ends, in the units of a sample's parameter.
const END: u32 = 1 << 16;

/// A position as the sum of two floats each: 48 bits.
pub fn pair(position: [f64; 3]) -> [f32; VERTEX_WORDS] {
    let high = position.map(|x| x as f32);
    let low = [0, 1, 2].map(|k| (position[k] - f64::from(high[k])) as f32);
    [high[0], high[1], high[2], low[0], low[1], low[2]]
}

/// Triangles with vertices of their own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Triangles {
    /// See [`pair`].
    pub vertices: Vec<[f32; VERTEX_WORDS]>,
    /// Counter-clockwise seen from outside.
    pub indices: Vec<[u32; 3]>,
}

impl Triangles {
    /// Any mesh.
    pub fn of_mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> Self {
        Self { vertices: positions.iter().map(|&p| pair(p)).collect(), indices: triangles.to_vec() }
    }

    /// All strips of a root: stitched index lists, on a copy of the vertices that they use.
    pub fn of_strips<'s>(surface: &Surface, strips: impl Iterator<Item = &'s Strip>) -> Self {
        let mut made = Self::default();
        let mut known = vec![NONE; surface.positions.len()];
        for strip in strips {
            let own = made.vertices.len() as u32;
            made.vertices.extend(strip.positions.iter().map(|&p| pair(p)));
            for triangle in &strip.triangles {
                made.indices.push(triangle.map(|vertex| {
                    let Some(known) = known.get_mut(vertex as usize) else {
                        return own + vertex - surface.positions.len() as u32;
                    };
                    if *known == NONE {
                        *known = made.vertices.len() as u32;
                        made.vertices.push(pair(surface.positions[vertex as usize]));
                    }
                    *known
                }));
            }
        }
        made
    }
}

/// A root's border triangles for vertex pulling: twelve numbers each. The corners; then for each edge its side and the
/// parameters of its ends along the arc, or no side.
pub fn border_records(surface: &Surface) -> Vec<u32> {
    let is_corner = |vertex: &u32| matches!(surface.keys[*vertex as usize], BorderKey::Corner(_));
    let starts: Vec<u32> = (0..surface.keys.len() as u32).filter(is_corner).collect();
    let reversed: Vec<bool> = surface.half_arcs().map(|half_arc| half_arc.reversed).collect();
    let side_of = |vertex: u32| starts.partition_point(|&start| start <= vertex) - 1;
    let mut records = Vec::new();
    for (corners, on_border) in surface.border_triangles() {
        records.extend(corners);
        for k in 0..3 {
            if !on_border[k] {
                records.extend([NONE, 0, 0]);
                continue;
            }
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let side = side_of(from);
            let ends = if reversed[side] { [END, 0] } else { [0, END] };
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
/// sides with a finer neighbour have any; `finer` names that.
pub fn snap_table<'s>(surface: &Surface, records: &[u32], finer: impl Fn(u32) -> Option<&'s Surface>) -> Vec<u32> {
    let side_count = surface.half_arcs().len();
    let mut table = vec![0; 1 + 2 * side_count];
    let mut params: Vec<Vec<u32>> = vec![Vec::new(); side_count];
    for (side, half_arc) in surface.half_arcs().enumerate() {
        let Some(other) = finer(half_arc.arc) else { continue };
        let sample = |(key, position): (&BorderKey, &[f64; 3])| match key {
            BorderKey::Sample { arc, param } if *arc == half_arc.arc => Some((*param, *position)),
            _ => None,
        };
        let mut samples: Vec<(u32, [f64; 3])> = other.keys.iter().zip(&other.positions).filter_map(sample).collect();
        samples.sort_unstable_by_key(|&(param, _)| param);
        (table[1 + 2 * side], table[2 + 2 * side]) = (table.len() as u32, samples.len() as u32);
        for (param, position) in samples {
            params[side].push(param);
            table.push(param);
            table.extend(pair(position).map(f32::to_bits));
        }
    }
    let extra = |edge: &[u32]| {
        let Some(params) = params.get(edge[0] as usize) else { return 0 };
        let (low, high) = (edge[1].min(edge[2]), edge[1].max(edge[2]));
        params.partition_point(|&p| p < high).saturating_sub(params.partition_point(|&p| p <= low))
    };
    let places = records.chunks_exact(12).map(|record| 1 + record[3..].chunks_exact(3).map(extra).sum::<usize>());
    table[0] = places.max().unwrap_or(1) as u32;
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_keep_a_millimetre_at_five_million() {
        for x in [5e6 + 0.001, -5e6 + 1e-6, 1.0 / 3.0, 123_456_789.123_456] {
            let p = pair([x, 0.0, 0.0]);
            assert!((f64::from(p[0]) + f64::from(p[3]) - x).abs() < x.abs() * 1e-14);
        }
    }
}
