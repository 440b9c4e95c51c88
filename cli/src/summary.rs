//! Stub: summary.
