//! A root's data for the GPU, as plain numbers, for both ways of drawing.

use std::collections::{BTreeMap, HashMap};

use lodpack::{
    decode::{BorderKey, PARAM_END},
    index::HalfArc,
    stream::{BorderEdge, DrawnRoot, DrawnSurface, Light},
};

use crate::camera::{NO_NORMAL, vertex};

/// Marks an edge that is on no chain.
const NONE: u32 = u32::MAX;
/// Numbers per border triangle.
pub const RECORD: usize = 12;

/// A root's border triangles for vertex pulling, [`RECORD`] numbers each: the corners, then for each edge its chain and
/// where it begins and ends along that, or no chain. A chain runs from one corner that is a vertex of the surface to
/// the next, and has the number of its first side. In light the corners are those of triangles with normals.
pub fn border_records(surface: &DrawnSurface, light: Option<&Light>) -> Vec<u32> {
    let chains = Chains::new(surface);
    let edge = |edge: Vec<BorderEdge>| match (edge.first(), edge.last()) {
        (Some(first), Some(last)) => {
            let [(chain, from), (_, to)] =
                [chains.place(first.side, first.params[0]), chains.place(last.side, last.params[1])];
            [chain, from, to]
        }
        _ => [NONE, 0, 0],
    };
    let lit = |number: usize| light.and_then(|light| light.triangles.get(surface.triangles.len() + number).copied());
    let triangles = surface.border_triangles().enumerate();
    let corners = |number: usize, corners: [u32; 3]| lit(number).unwrap_or(corners);
    triangles
        .flat_map(|(number, (own, edges))| corners(number, own).into_iter().chain(edges.into_iter().flat_map(edge)))
        .collect()
}

/// The chains of a surface.
struct Chains {
    half_arcs: Vec<HalfArc>,
    /// For each side the first one of its chain.
    firsts: Vec<u32>,
}

impl Chains {
    fn new(surface: &DrawnSurface) -> Self {
        let half_arcs: Vec<HalfArc> = surface.half_arcs().collect();
        let mut firsts: Vec<u32> = (0..half_arcs.len() as u32).collect();
        for (side, _) in surface.passed_corners() {
            firsts[side as usize] = firsts[side as usize - 1];
        }
        Self { half_arcs, firsts }
    }

    /// The chain of a side, and the place of a parameter along it, which grows in the direction of the loop.
    fn place(&self, side: u32, param: u32) -> (u32, u32) {
        let along = if self.half_arcs[side as usize].reversed { PARAM_END - param } else { param };
        let chain = self.firsts[side as usize];
        // No chain has 65,536 sides, unless somebody makes one to see this fail.
        (chain, (side - chain).saturating_mul(PARAM_END).saturating_add(along))
    }
}

/// The vertices to which a root's border is snapped. First the most triangles that the fan of any border triangle
/// needs; then, for each chain, by its number, the index and the number of its vertices; then the vertices in the order
/// of the loop, each its place along the chain, its position and its normal. Contains only what finer neighbours have
/// beyond the root's own.
pub fn snap_table(drawn: &DrawnRoot, light: Option<&Light>, records: &[u32]) -> Vec<u32> {
    let DrawnRoot { surface, strips, .. } = drawn;
    let chains = Chains::new(surface);
    let sides: HashMap<u32, u32> = chains.half_arcs.iter().map(|half_arc| half_arc.arc).zip(0..).collect();
    let mut corners: HashMap<u32, Vec<u32>> = HashMap::new();
    surface.passed_corners().for_each(|(side, corner)| corners.entry(corner).or_default().push(side));
    let mut snapped: BTreeMap<(u32, u32), ([f64; 3], [i16; 2])> = BTreeMap::new();
    let inserted = strips.iter().flat_map(|strip| strip.keys.iter().zip(&strip.positions));
    let normals = light.iter().flat_map(|light| &light.strip_normals).copied().chain(std::iter::repeat(NO_NORMAL));
    for ((key, &position), normal) in inserted.zip(normals) {
        let inserted = (position, normal);
        match *key {
            BorderKey::Sample { arc, param } => {
                snapped.extend(sides.get(&arc).map(|&side| (chains.place(side, param), inserted)));
            }
            BorderKey::Corner(corner) => {
                let (sides, half_arcs) = (corners.get(&corner).into_iter().flatten(), &chains.half_arcs);
                let begin = |side: u32| if half_arcs[side as usize].reversed { PARAM_END } else { 0 };
                snapped.extend(sides.map(|&side| (chains.place(side, begin(side)), inserted)));
            }
        }
    }
    let side_count = chains.half_arcs.len();
    let mut table = vec![0; 1 + 2 * side_count];
    for chain in 0..side_count {
        let own = snapped.range((chain as u32, 0)..=(chain as u32, u32::MAX));
        (table[1 + 2 * chain], table[2 + 2 * chain]) = (table.len() as u32, own.clone().count() as u32);
        for (&(_, place), &(position, normal)) in own {
            table.push(place);
            table.extend(vertex(position, normal));
        }
    }
    let extra = |edge: &[u32]| match edge {
        &[chain, from, to] if chain != NONE => snapped.range((chain, from)..(chain, to)).count(),
        _ => 0,
    };
    let fans = records.chunks_exact(RECORD).map(|record| 1 + record[3..].chunks_exact(3).map(extra).sum::<usize>());
    table[0] = fans.max().unwrap_or(1) as u32;
    table
}
