//! The queue of edges by collapse cost.
//!
//! Quadric errors only grow while a mesh is simplified, so a cost computed earlier is a lower bound: an entry is
//! evaluated again when it reaches the top, not whenever a neighbour changes. Each edge has at most one entry.

use std::collections::BinaryHeap;

/// Edges in the order of (cost, edge), cheapest first. Ties go to the lower edge, so the order is deterministic.
#[derive(Debug, Default)]
pub(super) struct EdgeQueue {
    /// The complement of (bits of the cost as f32, edge): non-negative floats sort like their bits.
    heap: BinaryHeap<u64>,
    queued: Vec<bool>,
}

/// The cost in the form in which the queue compares it.
pub(super) fn rank(cost: f64) -> u32 {
    (cost.max(0.0) as f32).to_bits()
}

impl EdgeQueue {
    pub fn new(edge_count: usize) -> Self {
        Self { heap: BinaryHeap::with_capacity(edge_count), queued: vec![false; edge_count] }
    }

    pub fn contains(&self, edge: u32) -> bool {
        self.queued[edge as usize]
    }

    /// Adds an edge that is not in the queue.
    pub fn push(&mut self, rank: u32, edge: u32) {
        self.queued[edge as usize] = true;
        self.heap.push(!((u64::from(rank) << 32) | u64::from(edge)));
    }

    /// The cheapest entry: (rank, edge). The edge may be dead by now.
    pub fn top(&self) -> Option<(u32, u32)> {
        self.heap.peek().map(|&entry| ((!entry >> 32) as u32, !entry as u32))
    }

    /// Removes the cheapest entry.
    pub fn pop(&mut self) {
        if let Some(entry) = self.heap.pop() {
            self.queued[!entry as u32 as usize] = false;
        }
    }

    /// Puts the cheapest entry behind others, if its rank has grown beyond that of the next. Whether it has: if not, it is still the
    /// cheapest, whatever its rank is now.
    pub fn defer_top(&mut self, rank: u32) -> bool {
        // The children of the top: one of them is the next.
        let next = self.heap.as_slice().get(1..).and_then(|rest| rest.iter().take(2).max());
        let Some(&next) = next else { return false };
        let goes_behind = rank > (!next >> 32) as u32;
        if goes_behind && let Some(mut top) = self.heap.peek_mut() {
            *top = !((u64::from(rank) << 32) | u64::from(!*top as u32));
        }
        goes_behind
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_by_cost_and_then_by_edge() {
        let mut queue = EdgeQueue::new(5);
        for (cost, edge) in [(2.0, 4), (1e-30, 3), (2.0, 1), (0.0, 0), (-1e-20, 2)] {
            queue.push(rank(cost), edge);
        }
        assert!(queue.contains(4));
        assert_eq!(queue.top(), Some((rank(0.0), 0)));
        // Behind the next, but not behind one of the same cost.
        assert!(!queue.defer_top(rank(0.0)) && queue.defer_top(rank(1.0)));
        let pop = |queue: &mut EdgeQueue| {
            let top = queue.top();
            queue.pop();
            top.map(|(_, edge)| edge)
        };
        let order: Vec<u32> = std::iter::from_fn(|| pop(&mut queue)).collect();
        assert_eq!(order, [2, 3, 0, 1, 4]);
        assert!(!queue.contains(4));
    }
}
