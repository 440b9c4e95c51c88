//! How the pipeline reports what it does, without knowing who listens.

/// Receives the course of a build. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A stage begins; `total` is its amount of work in units of its own, 0 when unknown.
    fn begin(&self, stage: &'static str, total: u64);
    /// More of the current stage's work is done.
    fn advance(&self, amount: u64);
    /// More of the current stage's work turns out to be done already, by an earlier process: it says nothing of how fast this one is.
    fn skip(&self, amount: u64) {
        self.advance(amount);
    }
    /// Something that the user should know, not an error.
    fn note(&self, message: &str);
}

/// Hears nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, _message: &str) {}
}
