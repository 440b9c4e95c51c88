//! Codecs: entropy coding, arcs, fillings, and the arithmetic that they share.

pub(crate) mod arc;
pub(crate) mod bytes;
pub(crate) mod entropy;
pub(crate) mod filling;
pub(crate) mod local_frame;
pub(crate) mod patch;
pub(crate) mod texels;
pub(crate) mod vector;
