//! Stub: arc.
