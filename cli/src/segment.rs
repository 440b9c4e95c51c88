//! Stub: segment.
