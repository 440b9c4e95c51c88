//! What refinements add to a cut, by the error before them.

/// Buckets of the histogram: 64 to each power of two, so its last one ends at a billionth of the largest error.
pub(super) const BUCKETS: usize = 2048;

/// Bits of a positive number that its bucket does not depend on.
const BUCKET_SHIFT: u32 = 46;

/// The share that drafts aim at.
const AIM: f64 = 0.985;

/// Triangles, nodes and bytes.
pub(super) type Sums = [f64; 3];

/// What refinements add, by the logarithm of the error before them, the largest first.
pub(super) struct Histogram {
    /// The bits of the largest error.
    first: u64,
    /// Sums of the first buckets; the first sum is that of the coarsest cut.
    sums: Vec<Sums>,
}

impl Histogram {
    /// An empty one for errors up to the largest.
    pub fn new(largest: f64) -> Self {
        Self { first: largest.to_bits() >> BUCKET_SHIFT, sums: vec![Sums::default(); BUCKETS + 1] }
    }

    /// Adds what takes the place of something else when everything with an error like this is refined; at infinity, it
    /// belongs to the coarsest cut.
    pub fn add(&mut self, error: f64, comes: Sums, goes: Sums) {
        let below = self.first.saturating_sub(error.max(0.0).to_bits() >> BUCKET_SHIFT);
        let bucket = if error == f64::INFINITY { 0 } else { (below as usize).min(BUCKETS - 1) + 1 };
        (0..3).for_each(|k| self.sums[bucket][k] += comes[k] - goes[k]);
    }

    /// Makes sums of what was added.
    pub fn sum_up(mut self) -> Self {
        for bucket in 1..self.sums.len() {
            (0..3).for_each(|k| self.sums[bucket][k] += self.sums[bucket - 1][k]);
        }
        self
    }

    /// The largest number whose bucket is not among the first `bucket`.
    pub fn end(&self, bucket: usize) -> f64 {
        let first_bits = (self.first + 1).saturating_sub(bucket as u64) << BUCKET_SHIFT;
        f64::from_bits(first_bits.saturating_sub(1))
    }

    /// The bucket up to which the budgets suffice, if the sums are wrong by the same factor everywhere as at `bucket`,
    /// where so much is used.
    pub fn guess(&self, budgets: [u64; 3], bucket: usize, used: [u64; 3]) -> usize {
        let there = self.sums[bucket.min(self.sums.len() - 1)];
        let limit = |k: usize| match budgets[k] {
            u64::MAX => f64::INFINITY,
            budget => budget as f64 * there[k] / (used[k] as f64).max(1.0),
        };
        let limits = [limit(0) * AIM, limit(1), limit(2) * AIM];
        let beyond = self.sums.iter().position(|sums| (0..3).any(|k| sums[k] > limits[k]));
        beyond.unwrap_or(self.sums.len()).saturating_sub(1)
    }
}
