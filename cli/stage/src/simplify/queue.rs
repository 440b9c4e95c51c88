//! The queue of edges by collapse cost.
//!
//! Quadric errors only grow while a mesh is simplified, so a cost computed earlier is a lower bound: an entry is
//! evaluated again when it reaches the top, not whenever a neighbour changes. Each edge has at most one entry.

use dary_heap::QuaternaryHeap;

/// Edges in the order of (cost, edge), cheapest first. Ties go to the lower edge, so the order is deterministic.
#[derive(Debug, Default)]
pub(super) struct EdgeQueue {
    /// The complement of (bits of the cost as f32, edge): non-negative floats sort like their bits.
    heap: QuaternaryHeap<u64>,
    queued: Vec<bool>,
}

/// The cost in the form in which the queue compares it.
pub(super) fn rank(cost: f64) -> u32 {
    (cost.max(0.0) as f32).to_bits()
}

impl EdgeQueue {
    pub fn new(edge_count: usize) -> Self {
        Self { heap: QuaternaryHeap::with_capacity(edge_count), queued: vec![false; edge_count] }
    }

    pub fn contains(&self, edge: u32) -> bool {
        self.queued[edge as usize]
    }

    /// Adds an edge that is not in the queue.
    pub fn push(&mut self, rank: u32, edge: u32) {
        self.queued[edge as usize] = true;
        self.heap.push(!((u64::from(rank) << 32) | u64::from(edge)));
    }

    /// Removes the cheapest entry: (rank, edge). The edge may be dead by now.
    pub fn pop(&mut self) -> Option<(u32, u32)> {
        let entry = !self.heap.pop()?;
        let edge = entry as u32;
        self.queued[edge as usize] = false;
        Some(((entry >> 32) as u32, edge))
    }

    /// Rank of the cheapest entry.
    pub fn top_rank(&self) -> Option<u32> {
        self.heap.peek().map(|&entry| (!entry >> 32) as u32)
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
        assert_eq!(queue.top_rank(), Some(rank(0.0)));
        let order: Vec<u32> = std::iter::from_fn(|| queue.pop().map(|(_, edge)| edge)).collect();
        assert_eq!(order, [0, 2, 3, 1, 4]);
        assert!(!queue.contains(4));
    }
}
