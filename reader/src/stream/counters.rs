//! Counters of a session's work, among them the hit rates that neither Niski 2007 nor Correa 2004 reports.

use std::time::Duration;

/// How long pages took from the first frame that wanted them until they were decoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LatencyHistogram {
    /// Entry 0: below one millisecond; entry k: from 2^(k-1) to below 2^k milliseconds; the last one: all above.
    pub counts: [u64; 16],
    total: Duration,
}

impl LatencyHistogram {
    pub(crate) fn add(&mut self, latency: Duration) {
        let millis = u64::try_from(latency.as_millis()).unwrap_or(u64::MAX);
        let class = (64 - millis.leading_zeros() as usize).min(self.counts.len() - 1);
        self.counts[class] += 1;
        self.total = self.total.saturating_add(latency);
    }

    /// The mean; zero without pages.
    pub fn mean(&self) -> Duration {
        let count: u64 = self.counts.iter().sum();
        self.total.checked_div(u32::try_from(count).unwrap_or(u32::MAX)).unwrap_or_default()
    }
}

/// What a session has done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames begun.
    pub frames: u64,
    /// Frames that had to wait for pages; only those of [`crate::stream::Mode::Synchronous`] do.
    pub stalls: u64,
    /// How long these frames waited in all.
    pub stall_time: Duration,
    /// Units that a frame demanded and found decoded.
    pub hits: u64,
    /// Units that a frame demanded when they were loaded but not yet decoded. Each counts once until it is decoded or
    /// given up.
    pub byte_hits: u64,
    /// Demand misses: units that a frame demanded before their bytes were loaded. Each counts once until it is decoded
    /// or given up.
    pub misses: u64,
    /// Pages and decoded units that were evicted.
    pub evictions: u64,
    /// Reads of the file.
    pub requests: u64,
    /// Bytes that these reads asked for.
    pub bytes_read: u64,
    /// Requests for pages that no frame had demanded, and their bytes.
    pub prefetch_requests: u64,
    /// See `prefetch_requests`; bytes between pages do not count.
    pub prefetch_bytes: u64,
    /// Bytes of these that a frame demanded later.
    pub prefetch_used_bytes: u64,
    /// Pages that were queued and not read because frames no longer wanted them.
    pub cancelled: u64,
    /// Reads that failed and were tried again.
    pub retries: u64,
    /// Pages and units that were given up. Each is reported once.
    pub failures: u64,
    /// Units decoded.
    pub decoded: u64,
    /// Sum over frames of the wanted roots drawn coarser than wanted: see [`crate::stream::Frame::late_roots`].
    pub late_roots: u64,
    /// Sum over frames of the borders of drawn roots whose triangles were rebuilt (Niski 2007, table 5.1).
    pub borders_rebuilt: u64,
    /// Sum over frames of all borders of drawn roots.
    pub borders_drawn: u64,
    /// Time from the first demand of a unit until it is decoded.
    pub latency: LatencyHistogram,
}

impl Counters {
    /// Bytes that were prefetched and that no frame has demanded so far.
    pub fn wasted_prefetch_bytes(&self) -> u64 {
        self.prefetch_bytes - self.prefetch_used_bytes.min(self.prefetch_bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_fall_into_classes_of_powers_of_two() {
        let mut histogram = LatencyHistogram::default();
        for micros in [0, 999, 1000, 1999, 2000, 50_000, 10_000_000_000] {
            histogram.add(Duration::from_micros(micros));
        }
        assert_eq!(histogram.counts[..3], [2, 2, 1]);
        assert_eq!(histogram.counts[6], 1);
        assert_eq!(histogram.counts[15], 1);
        assert_eq!(histogram.counts.iter().sum::<u64>(), 7);
        assert!(LatencyHistogram::default().mean().is_zero());
    }
}
