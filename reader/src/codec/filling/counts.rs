//! Counts by filling, for summaries.

use std::collections::BTreeMap;

use super::Filling;

/// A number for each filling: of roots, or of blocks.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FillingCounts(BTreeMap<Filling, u64>);

impl FillingCounts {
    /// The number of a filling.
    pub fn of(&self, filling: Filling) -> u64 {
        self.0.get(&filling).copied().unwrap_or(0)
    }

    /// All fillings that this program knows, each with its number, which may be 0.
    pub fn iter(&self) -> impl Iterator<Item = (Filling, u64)> + '_ {
        Filling::all().map(|filling| (filling, self.of(filling)))
    }

    /// The sum over all fillings.
    pub fn total(&self) -> u64 {
        self.0.values().sum()
    }

    /// Counts one more.
    pub fn count(&mut self, filling: Filling) {
        *self.0.entry(filling).or_default() += 1;
    }

    /// Adds other counts.
    pub fn add(&mut self, other: &Self) {
        other.0.iter().for_each(|(&filling, count)| *self.0.entry(filling).or_default() += count);
    }
}

impl FromIterator<Filling> for FillingCounts {
    fn from_iter<T: IntoIterator<Item = Filling>>(fillings: T) -> Self {
        let mut counts = Self::default();
        fillings.into_iter().for_each(|filling| counts.count(filling));
        counts
    }
}
