//! Stub: import.
