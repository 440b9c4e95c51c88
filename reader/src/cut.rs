//! Stub: cut.
