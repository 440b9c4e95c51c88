//! How the library reports its progress without knowing who listens.

/// Receives the course of a build. All methods may be called from any thread.
pub trait Progress: Sync {
    /// A stage begins. `total` is its amount of work in units of its own choice, 0 when it is unknown.
    fn begin(&self, stage: &'static str, total: u64);
    /// More of the current stage's work is done.
    fn advance(&self, amount: u64);
    /// An earlier process has already done this much of the current stage's work, so it says nothing about the speed of
    /// this one.
    fn skip(&self, amount: u64) {
        self.advance(amount);
    }
    /// Something that the user should know and that is not an error.
    fn note(&self, message: &str);
}

/// Ignores all progress.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _stage: &'static str, _total: u64) {}
    fn advance(&self, _amount: u64) {}
    fn note(&self, _message: &str) {}
}
