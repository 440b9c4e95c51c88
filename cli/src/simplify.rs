//! Stub: simplify.
