//! How the inside of a root is coded. Each filling has a folder; what all of them share stands here.

pub mod grid;
pub(crate) mod irregular;
