//! Stub: index.
