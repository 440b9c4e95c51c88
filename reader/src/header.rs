//! Stub: header.
