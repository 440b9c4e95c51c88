//! The content of all pieces of a file, piece after piece, before the file has an order.

use std::{collections::BTreeMap, ops::Range};

use super::piece::{LocalRef, NO_ROOT, PieceIndex};
use crate::{
    error::{Error, Result},
    format::{index_block::RootEntry, records::HalfArc},
    lattice::LatticePoint,
};

/// The roots, arcs and corners of all pieces so far, numbered as they came. The order of a file needs all of them,
/// about half a kilobyte a root, but no symbols.
#[derive(Clone, Debug, Default)]
pub(super) struct Catalogue {
    /// First root, arc and corner of each piece, and of the next one.
    firsts: Vec<[u32; 3]>,
    next: [u32; 3],
    pub roots: Vec<RootEntry>,
    pub centres: Vec<[f64; 3]>,
    /// Per root its parent, or [`NO_ROOT`].
    pub parents: Vec<u32>,
    /// The number of symbols in each block, root after root.
    pub block_symbols: Vec<u32>,
    pub arc_ends: Vec<[u32; 2]>,
    /// Per arc and level.
    pub new_samples: Vec<u32>,
    pub corners: Vec<LatticePoint>,
    pub corner_levels: Vec<u8>,
    /// By shared number.
    shared_arcs: BTreeMap<u32, u32>,
    shared_corners: BTreeMap<u32, u32>,
}

impl Catalogue {
    /// Adds a checked piece.
    ///
    /// # Errors
    /// [`Error::Model`] if it does not fit the pieces before.
    pub fn add(&mut self, piece: &PieceIndex) -> Result<()> {
        let known = |this: &Self, shared: u32| this.shared_arcs.get(&shared).copied();
        self.add_with(piece, known)
    }

    /// Adds a checked piece without arcs and corners of its own, whose shared arcs are numbers in this catalogue. Its
    /// first roots are the parents of `children`, each a root of the catalogue and its parent's number in the piece;
    /// `corner_levels` are those of corners that become vertices at coarser levels than so far.
    ///
    /// # Errors
    /// [`Error::Model`] if it does not fit the pieces before.
    pub fn add_above(&mut self, piece: &PieceIndex, children: &[[u32; 2]], corner_levels: &[(u32, u8)]) -> Result<()> {
        let first = self.next[0];
        self.add_with(piece, |this, arc| Some(arc).filter(|&arc| (arc as usize) < this.arc_ends.len()))?;
        for &[child, parent] in children {
            let levels =
                |root: u32| self.roots.get(root as usize).map(|root| root.blocks.iter().map(|block| block.level));
            let coarsest = levels(child).and_then(|mut levels| levels.next());
            let above = first.checked_add(parent).and_then(levels).and_then(Iterator::last);
            if child >= first || above.is_none() || above.map(|above| above + 1) != coarsest {
                return Err(Error::model("a group of several pieces does not continue the levels of its members"));
            }
            if std::mem::replace(&mut self.parents[child as usize], first + parent) != NO_ROOT {
                return Err(Error::model("a root has two parents"));
            }
        }
        for &(corner, level) in corner_levels {
            let own = self.corner_levels.get_mut(corner as usize).filter(|own| level <= **own);
            *own.ok_or_else(|| Error::model("a corner of several pieces does not exist, or is a vertex already"))? =
                level;
        }
        Ok(())
    }

    /// Adds a piece. `known` finds the number of an arc that the piece shares.
    fn add_with(&mut self, piece: &PieceIndex, known: impl Fn(&Self, u32) -> Option<u32>) -> Result<()> {
        let first = self.next;
        for (next, count) in self.next.iter_mut().zip([piece.roots.len(), piece.arc_ends.len(), piece.corners.len()]) {
            let end = u32::try_from(count).ok().and_then(|count| next.checked_add(count));
            *next = end
                .filter(|&end| end < u32::MAX)
                .ok_or_else(|| Error::model("2^32 - 1 or more corners, arcs or roots"))?;
        }
        self.firsts.push(first);
        for (shared, numbers, first) in [
            (&piece.shared_arcs, &mut self.shared_arcs, first[1]),
            (&piece.shared_corners, &mut self.shared_corners, first[2]),
        ] {
            for &[number, own] in shared {
                if numbers.insert(number, first + own).is_some() {
                    return Err(Error::model(format!("shared arc or corner {number} comes first twice")));
                }
            }
        }
        let unknown = || Error::model("a piece shares an arc or corner that no earlier piece has");
        for root in &piece.roots {
            let mut root = root.clone();
            for HalfArc { arc, .. } in root.loops.iter_mut().flatten() {
                let place = LocalRef(*arc);
                let number = place.own().map(|own| first[1] + own).or_else(|| known(self, place.shared()?));
                *arc = number.ok_or_else(unknown)?;
            }
            self.roots.push(root);
        }
        let corner = |this: &Self, end: u32| {
            let place = LocalRef(end);
            let number = place.own().map(|own| first[2] + own);
            number.or_else(|| this.shared_corners.get(&place.shared()?).copied()).ok_or_else(unknown)
        };
        for &[a, b] in &piece.arc_ends {
            let ends = [corner(self, a)?, corner(self, b)?];
            if ends[0] == ends[1] {
                return Err(Error::model("both ends of an arc are the same corner"));
            }
            self.arc_ends.push(ends);
        }
        self.centres.extend(&piece.centres);
        self.corner_levels.extend(&piece.corner_levels);
        let parent = |&parent: &u32| if parent == NO_ROOT { NO_ROOT } else { first[0] + parent };
        self.parents.extend(piece.parents.iter().map(parent));
        self.block_symbols.extend(&piece.block_symbols);
        self.new_samples.extend(&piece.new_samples);
        self.corners.extend(&piece.corners);
        Ok(())
    }

    /// The roots and the arcs of a piece.
    pub fn of_piece(&self, piece: usize) -> Option<[Range<u32>; 2]> {
        let first = self.firsts.get(piece)?;
        let end = self.firsts.get(piece + 1).unwrap_or(&self.next);
        Some([first[0]..end[0], first[1]..end[1]])
    }

    /// The piece that a root comes from.
    pub fn piece_of_root(&self, root: u32) -> usize {
        self.firsts.partition_point(|first| first[0] <= root).saturating_sub(1)
    }

    /// The piece that an arc comes from.
    pub fn piece_of_arc(&self, arc: u32) -> usize {
        self.firsts.partition_point(|first| first[1] <= arc).saturating_sub(1)
    }

    /// The piece that a root comes from, and its number in it.
    #[cfg(feature = "serde")]
    pub fn place_of_root(&self, root: u32) -> [u32; 2] {
        let piece = self.piece_of_root(root);
        [piece as u32, root - self.firsts[piece][0]]
    }

    /// The piece that an arc comes from, and its number among those that the piece is the first to have.
    #[cfg(feature = "serde")]
    pub fn place_of_arc(&self, arc: u32) -> [u32; 2] {
        let piece = self.piece_of_arc(arc);
        [piece as u32, arc - self.firsts[piece][1]]
    }

    /// Frees what is no longer needed once the order is known.
    pub fn shrink(&mut self) {
        self.centres = Vec::new();
        self.block_symbols = Vec::new();
        (self.shared_arcs, self.shared_corners) = Default::default();
    }
}

/// The index of each root's first block among the blocks of all roots.
pub(super) fn first_blocks(roots: &[RootEntry]) -> Vec<usize> {
    let mut next = 0;
    let first = |root: &RootEntry| {
        next += root.blocks.len();
        next - root.blocks.len()
    };
    roots.iter().map(first).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Assembly, Piece, Shares};
    use super::*;
    use crate::tests::synthetic::{Options, cube, model};

    #[test]
    fn pieces_that_were_tampered_with_are_refused() {
        let (model, _) = model(&cube(2), Options { levels: 3, seed: 8, grids_of_four: 1, heights: 0 });
        let Piece { index, .. } = Piece::new(&model, &Shares::default()).unwrap();
        let outcome = |change: &dyn Fn(&mut PieceIndex)| {
            let mut changed = index.clone();
            change(&mut changed);
            let mut assembly = Assembly::new(&model)?;
            assembly.count(&changed)?;
            assembly.arrange().map(|_| ())
        };
        outcome(&|_| ()).unwrap();
        let changes: [&dyn Fn(&mut PieceIndex); 14] = [
            // What does not exist.
            &|index| index.roots[0].loops[0][0].arc = 1 << 20,
            &|index| index.roots[0].loops[0][0].arc = LocalRef::of_shared(7).0,
            &|index| index.arc_ends[3][1] = 1 << 20,
            &|index| index.arc_ends[3][1] = LocalRef::of_shared(7).0,
            &|index| index.shared_arcs.push([7, 1 << 20]),
            &|index| index.shared_corners.extend([[7, 0], [7, 1]]),
            // Too much or too little.
            &|index| index.roots.push(index.roots[0].clone()),
            &|index| {
                index.roots.push(index.roots[0].clone());
                index.centres.push(index.centres[0]);
                index.parents.push(NO_ROOT);
                index.block_symbols.extend(vec![1; index.roots[0].blocks.len()]);
            },
            &|index| index.roots[0].blocks.clear(),
            &|index| index.corners.push([0; 3]),
            &|index| index.new_samples.truncate(5),
            // Out of range.
            &|index| index.new_samples[0] = u32::MAX,
            &|index| index.corners[0] = [i64::MAX; 3],
            &|index| index.roots[0].bounds.reverse(),
        ];
        for (number, change) in changes.iter().enumerate() {
            assert!(outcome(change).is_err(), "change {number}");
        }
    }
}
