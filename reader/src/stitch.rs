//! Stub: stitch.
