//! Fillings: how the inside of a root is coded.
//!
//! Each filling has a folder with its encoder, its [`BlockDecoder`] and its contexts. The rest of the crate knows a
//! filling by its row in the [table](Descriptor) alone. A further filling needs a folder, a variant of [`Filling`], a
//! row in the table, a line in the [register of contexts](crate::codec::entropy::context), and a chapter in SPEC.md.
//! Its parameters in a file are two shifts a level, like those of the others, whether it uses them or not
//! (`format::levels`).

mod block;
mod counts;
pub mod grid;
pub(crate) mod irregular;
mod quantisation;

pub(crate) use block::{BlockDecoder, BlockTask, LANES, LaneSymbols, RootBorder};
pub use counts::FillingCounts;
pub use quantisation::{LevelSteps, Quantisation, Slide};

use crate::codec::entropy::context::Use;

/// How the triangles inside a root's loops are coded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Filling {
    /// Triangles and vertices of any shape; every level stands on its own.
    #[default]
    Irregular,
    /// Quadtrees of samples in a disk; every level builds on the coarser ones.
    Grid,
}

/// All fillings, in the order of the enum, which is also that of their codes.
static FILLINGS: [Descriptor; Filling::COUNT] = [irregular::DESCRIPTOR, grid::DESCRIPTOR];

/// What the rest of the crate must know about a filling: its row in the table.
pub(crate) struct Descriptor {
    /// Which filling this is.
    pub filling: Filling,
    /// The number that stands for it in files.
    pub code: u16,
    /// Its name for people and programs: one lower-case word.
    pub name: &'static str,
    /// What its roots consist of, for people: a phrase that follows "irregular fillings:".
    pub description: &'static str,
    /// Whether a block builds on the root's next coarser block, which then has to be decoded first.
    pub is_nested: bool,
    /// What its contexts are for.
    pub uses: &'static [Use],
    /// Makes a decoder.
    pub decoder: fn() -> Box<dyn BlockDecoder>,
}

impl Filling {
    /// The number of fillings.
    pub(crate) const COUNT: usize = 2;

    /// All fillings.
    pub fn all() -> impl Iterator<Item = Self> {
        FILLINGS.iter().map(|descriptor| descriptor.filling)
    }

    /// Its name for people and programs: one lower-case word.
    pub fn name(self) -> &'static str {
        self.descriptor().name
    }

    /// What its roots consist of, for people: a phrase that completes "irregular fillings: ...".
    pub fn description(self) -> &'static str {
        self.descriptor().description
    }

    /// Whether its levels are nested: a block builds on the root's next coarser block, which has to be decoded first.
    pub fn is_nested(self) -> bool {
        self.descriptor().is_nested
    }

    /// Its row in the table.
    pub(crate) fn descriptor(self) -> &'static Descriptor {
        &FILLINGS[self as usize]
    }

    /// The filling that a number stands for in files.
    pub(crate) fn from_code(code: u16) -> Option<Self> {
        FILLINGS.iter().find(|descriptor| descriptor.code == code).map(|descriptor| descriptor.filling)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_filling_has_its_row_a_code_and_contexts_of_its_own() {
        for (place, row) in FILLINGS.iter().enumerate() {
            assert_eq!((row.filling as usize, Filling::from_code(row.code)), (place, Some(row.filling)));
        }
        assert!(FILLINGS.is_sorted_by(|a, b| a.code < b.code && a.name != b.name));
        assert!(FILLINGS.iter().flat_map(|row| row.uses).is_sorted_by(|a, b| a.first < b.first));
        assert_eq!(Filling::from_code(u16::MAX), None);
    }
}
