//! Stub: grid.
