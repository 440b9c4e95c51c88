//! What pieces must not show: where colours jump, nothing from beyond the line.

use lodpack::decode::texels::Map;

use super::BakedPatch;
use lodpack_mesh::NONE;

/// For each piece of a map the areas that it must not show, ascending: those that lie beside it, and
/// that differ from its own. Areas that no triangle of the patch is left of are shown by the pieces that lie there.
pub(super) struct Strangers(Vec<Vec<u32>>);

impl Strangers {
    /// `beyond` are areas beside the patch that it must not show either.
    pub fn new(patch: &BakedPatch<'_>, map: &Map, beyond: &[u32]) -> Self {
        let Some(areas) = patch.areas else { return Self(vec![]) };
        let mut of_pieces: Vec<Vec<u32>> = vec![vec![]; map.pieces.len()];
        for (&label, &area) in map.labels.iter().zip(areas.of_triangles).filter(|(_, area)| **area != NONE) {
            of_pieces[usize::from(label)].push(area);
        }
        for own in &mut of_pieces {
            own.sort_unstable();
            own.dedup();
        }
        let mut all = of_pieces.concat();
        all.extend(beyond);
        all.sort_unstable();
        all.dedup();
        let differs = |own: &[u32], other: u32| own.iter().any(|&area| areas.jumps.are_between(area, other));
        let of_piece = |own: &Vec<u32>| all.iter().copied().filter(|&other| differs(own, other)).collect();
        Self(of_pieces.iter().map(of_piece).collect())
    }

    /// Those of a piece.
    pub fn of(&self, piece: usize) -> &[u32] {
        self.0.get(piece).map_or(&[], Vec::as_slice)
    }

    /// Whether a piece must not show an area.
    pub fn has(&self, piece: usize, area: u32) -> bool {
        self.of(piece).binary_search(&area).is_ok()
    }
}
