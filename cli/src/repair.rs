//! Stub: repair.
