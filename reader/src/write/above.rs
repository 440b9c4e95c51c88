//! Groups above the roots of several pieces: what is known of these, and how the groups become a piece of their own.

use super::{
    assembly::Assembly,
    model::{Model, RootRecord},
    piece::{LocalRef, NO_ROOT, Piece},
};
use crate::{
    codec::entropy::Tally,
    error::{Error, Result},
    format::records::HalfArc,
    lattice::LatticePoint,
};

/// Groups above roots that have been counted. Arcs, corners and the roots below have their numbers in the assembly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Above {
    /// The groups. Parents are numbers in this list.
    pub roots: Vec<RootRecord>,
    /// Roots without a parent so far, each with the number of its parent in this list.
    pub children: Vec<[u32; 2]>,
    /// Corners that are vertices of groups here, each with the coarsest level at which it is one.
    pub corner_levels: Vec<(u32, u8)>,
}

impl Assembly {
    /// The loops around a root of a piece that has been counted, and the root's number in the assembly.
    pub fn root(&self, piece: usize, root: u32) -> Option<(u32, &[Vec<HalfArc>])> {
        let [roots, _] = self.catalogue.of_piece(piece)?;
        let number = roots.start.checked_add(root).filter(|number| roots.contains(number))?;
        Some((number, &self.catalogue.roots.get(number as usize)?.loops))
    }

    /// The corners at the ends of an arc.
    pub fn arc_ends(&self, arc: u32) -> Option<[u32; 2]> {
        self.catalogue.arc_ends.get(arc as usize).copied()
    }

    /// The position of a corner, and the coarsest level at which it is a vertex.
    pub fn corner(&self, corner: u32) -> Option<(LatticePoint, u8)> {
        let position = self.catalogue.corners.get(corner as usize)?;
        Some((*position, *self.catalogue.corner_levels.get(corner as usize)?))
    }

    /// Counts groups above the roots of all pieces, after these. Returns their piece, which is the last one that
    /// [`super::Output`] takes. Of `head`, uses the lattice, the levels and the channels.
    ///
    /// # Errors
    /// [`Error::Model`] if they do not fit the pieces.
    pub fn count_above(&mut self, head: &Model, above: &Above) -> Result<Piece> {
        let level_count = head.levels.len();
        let mut piece = Piece::of_channels(&head.channels);
        for record in &above.roots {
            let mut entry = super::piece::root_entry(head, record)?;
            for HalfArc { arc, .. } in entry.loops.iter_mut().flatten() {
                let is_there = (*arc as usize) < self.catalogue.arc_ends.len() && *arc < 1 << 31;
                *arc = is_there
                    .then(|| LocalRef::of_shared(*arc).0)
                    .ok_or_else(|| Error::model("an arc does not exist"))?;
            }
            piece.index.parents.push(record.parent.unwrap_or(NO_ROOT));
            piece.push_root(entry, record)?;
        }
        piece.index.count(&piece.symbols, level_count);
        self.check(&piece.index)?;
        self.catalogue.add_above(&piece.index, &above.children, &above.corner_levels)?;
        self.tally(&piece.index);
        Ok(piece)
    }

    /// Counts the symbols of a piece for the tables.
    pub(super) fn tally(&mut self, piece: &super::piece::PieceIndex) {
        piece.arc_tallies.iter().zip(&mut self.arcs).for_each(|(tally, sum): (&Tally, _)| sum.add(tally));
        piece.block_tallies.iter().take(1).for_each(|tally| self.coarsest.add(tally));
        piece.arc_tallies.iter().chain(&piece.block_tallies).for_each(|tally| self.all.add(tally));
    }
}
