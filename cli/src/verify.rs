//! Stub: verify.
