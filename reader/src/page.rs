//! Stub: page.
