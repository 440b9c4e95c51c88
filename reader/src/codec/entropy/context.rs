//! The register of contexts: who owns which numbers (SPEC.md, "Contexts").
//!
//! A context names the statistics that a symbol is coded with. Each owner has a run of numbers and says in its own
//! module what each of them is for. A further owner appends a line here; that changes no other numbers, and a file pays
//! nothing for contexts that it does not use.

/// A context number.
pub type Context = u16;

/// Contexts of index blocks: `format::index_block`.
pub(crate) const INDEX: Owner = Owner::first(13);
/// Contexts of corners and arcs: `codec::arc`.
pub(crate) const ARC: Owner = INDEX.then(51);
/// Contexts of irregular fillings: `codec::filling::irregular`.
pub(crate) const IRREGULAR: Owner = ARC.then(64);
/// Contexts of grids: `codec::filling::grid`.
pub(crate) const GRID: Owner = IRREGULAR.then(118);
/// Contexts of the tree: `format::index_block`.
pub(crate) const TREE: Owner = GRID.then(3);

/// Contexts of heights: `heights::codec`.
pub(crate) const HEIGHTS: Owner = TREE.then(82);

/// The number of contexts that this program knows: all numbers below have an owner.
pub(crate) const COUNT: usize = HEIGHTS.end as usize;
/// Section TABLES may name contexts below this limit. A reader ignores those that it does not know: optional sections
/// of a later minor version may use them.
pub(crate) const LIMIT: usize = 4096;

/// A run of contexts that belong to one part of the format.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Owner {
    /// Its first context.
    pub first: Context,
    /// The first context of the next owner.
    pub end: Context,
}

impl Owner {
    const fn first(count: Context) -> Self {
        Self { first: 0, end: count }
    }

    const fn then(self, count: Context) -> Self {
        Self { first: self.end, end: self.end + count }
    }
}

/// What some of an owner's contexts are for: those from `first` to the next use's, or to the owner's last.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Use {
    /// What the symbols say.
    pub name: &'static str,
    /// The first context.
    pub first: Context,
}

const _: () = assert!(COUNT <= LIMIT);
