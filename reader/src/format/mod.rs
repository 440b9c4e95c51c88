//! The records of a file, each parsed and written in one place (SPEC.md, chapters 4 to 8).

pub(crate) mod channels;
pub(crate) mod cluster_lists;
pub(crate) mod clusters;
pub(crate) mod error_code;
pub(crate) mod header;
pub(crate) mod index_block;
pub(crate) mod levels;
pub(crate) mod overview;
pub(crate) mod placement;
pub(crate) mod records;
pub(crate) mod sections;
pub(crate) mod texels;
