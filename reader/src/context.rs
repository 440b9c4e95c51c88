//! The entropy contexts of SPEC.md: which symbol is coded with which statistics. One list for all codecs.

/// A context number, below [`COUNT`].
pub type Context = u16;

/// First context of the irregular filling's codec.
pub(crate) const IRREGULAR: Context = 0;
/// Irregular: number of components without a border.
pub(crate) const IRREGULAR_COMPONENTS: Context = IRREGULAR;
/// Irregular: coordinates of such a component's first triangle.
pub(crate) const IRREGULAR_SEED: Context = IRREGULAR + 1;
/// Irregular: offset of a Split.
pub(crate) const IRREGULAR_SPLIT: Context = IRREGULAR + 2;
/// Irregular: index of a Union.
pub(crate) const IRREGULAR_LOOP: Context = IRREGULAR + 3;
/// Irregular: offset of a Union.
pub(crate) const IRREGULAR_UNION: Context = IRREGULAR + 4;
/// Irregular, 32 contexts: operations; 8 classes of the angle at the gate's end, in each 4 of the one at its start.
pub(crate) const IRREGULAR_OPERATION: Context = IRREGULAR + 5;
/// Irregular, 27 contexts: residuals; along, across and normal, in each [`IRREGULAR_SIZES`] classes of expected size.
pub(crate) const IRREGULAR_RESIDUAL: Context = IRREGULAR + 37;
/// How many classes of residual size there are.
pub(crate) const IRREGULAR_SIZES: Context = 9;
/// First context of the arcs' codec.
pub(crate) const ARC: Context = 64;
/// First context of the grid filling's codec.
pub(crate) const GRID: Context = 128;
/// How many contexts there are.
pub const COUNT: Context = 256;
