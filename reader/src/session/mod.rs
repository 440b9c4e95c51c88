//! Streaming.
#![allow(dead_code, unused_imports)]

mod cache;
mod counters;
mod job;
mod loader;
mod motion;
mod queue;

#[cfg(test)]
mod tests;

pub use counters::{Counters, LatencyHistogram};
pub use job::Read;
pub use loader::Problem;
pub use motion::{Motion, Pose};
pub use queue::Class;

/// When a frame is drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Waits.
    Synchronous,
    /// Does not.
    #[default]
    Asynchronous,
}
