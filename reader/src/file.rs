//! Stub: file.
