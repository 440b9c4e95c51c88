//! The index of an open file: what is resident, what a query misses, and what it adds up to.

pub(crate) mod needs;
pub(crate) mod opener;
pub(crate) mod resident;
pub(crate) mod summary;
