//! Stub: limits.
