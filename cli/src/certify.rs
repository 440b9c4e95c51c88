//! Stub: certify.
