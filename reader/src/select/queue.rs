//! A priority queue of nodes whose priorities change.

use super::hierarchy::NONE;

/// A binary heap with the largest priority first and, among equal ones, the smallest node. It knows where each node is,
/// so a node is changed or removed in logarithmic time, and no entry is ever out of date.
#[derive(Clone, Debug, Default)]
pub(crate) struct Queue {
    heap: Vec<(f64, u32)>,
    /// Per node its index in the heap.
    places: Vec<u32>,
}

impl Queue {
    pub(crate) fn new(node_count: u32) -> Self {
        Self { heap: Vec::new(), places: vec![NONE; node_count as usize] }
    }

    pub(crate) fn peek(&self) -> Option<(f64, u32)> {
        self.heap.first().copied()
    }

    /// Inserts a node, gives it another priority, or, without one, removes it.
    pub(crate) fn set(&mut self, node: u32, priority: Option<f64>) {
        let place = self.places[node as usize];
        match (place != NONE, priority) {
            (false, None) => {}
            (false, Some(priority)) => {
                self.heap.push((priority, node));
                self.places[node as usize] = self.heap.len() as u32 - 1;
                self.rise(self.heap.len() - 1);
            }
            (true, Some(priority)) => {
                let place = place as usize;
                let before = std::mem::replace(&mut self.heap[place].0, priority);
                if before != priority {
                    self.rise(place);
                    self.sink(self.places[node as usize] as usize);
                }
            }
            (true, None) => {
                self.places[node as usize] = NONE;
                let last = self.heap.pop();
                if let Some(last) = last.filter(|last| last.1 != node) {
                    let place = place as usize;
                    self.heap[place] = last;
                    self.places[last.1 as usize] = place as u32;
                    self.rise(place);
                    self.sink(self.places[last.1 as usize] as usize);
                }
            }
        }
    }

    fn before(a: (f64, u32), b: (f64, u32)) -> bool {
        a.0 > b.0 || a.0 == b.0 && a.1 < b.1
    }

    fn rise(&mut self, mut place: usize) {
        let item = self.heap[place];
        while place > 0 {
            let above = (place - 1) / 2;
            if !Self::before(item, self.heap[above]) {
                break;
            }
            self.heap[place] = self.heap[above];
            self.places[self.heap[place].1 as usize] = place as u32;
            place = above;
        }
        self.heap[place] = item;
        self.places[item.1 as usize] = place as u32;
    }

    fn sink(&mut self, mut place: usize) {
        let item = self.heap[place];
        loop {
            let mut below = 2 * place + 1;
            if below >= self.heap.len() {
                break;
            }
            if self.heap.get(below + 1).is_some_and(|&other| Self::before(other, self.heap[below])) {
                below += 1;
            }
            if !Self::before(self.heap[below], item) {
                break;
            }
            self.heap[place] = self.heap[below];
            self.places[self.heap[place].1 as usize] = place as u32;
            place = below;
        }
        self.heap[place] = item;
        self.places[item.1 as usize] = place as u32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_first_is_always_the_largest(
            changes in proptest::collection::vec((0_u32..20, proptest::option::of(0_u8..10)), 1..200),
        ) {
            let mut queue = Queue::new(20);
            let mut plain = [None; 20];
            for (node, priority) in changes {
                queue.set(node, priority.map(f64::from));
                plain[node as usize] = priority;
                let largest = (0..20_u32).filter_map(|n| plain[n as usize].map(|p| (p, std::cmp::Reverse(n)))).max();
                prop_assert_eq!(queue.peek(), largest.map(|(p, n)| (f64::from(p), n.0)));
            }
        }
    }
}
