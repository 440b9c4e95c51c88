//! Stub: sample.
