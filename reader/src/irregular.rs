//! Stub: irregular.
