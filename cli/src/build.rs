//! Stub: build.
