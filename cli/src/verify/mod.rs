//! Stub
mod distance;
