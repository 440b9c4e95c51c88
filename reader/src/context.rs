//! The entropy contexts of SPEC.md: which symbol is coded with which statistics. One list for all codecs.

/// A context number, below [`COUNT`].
pub type Context = u16;

/// First context of the irregular filling's codec.
pub(crate) const IRREGULAR: Context = 0;
/// First context of the arcs' codec.
pub(crate) const ARC: Context = 64;
/// First context of the grid filling's codec.
pub(crate) const GRID: Context = 128;
/// How many contexts there are.
pub const COUNT: Context = 256;
