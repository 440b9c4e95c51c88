//! One winding for each component.

use glam::DVec3;

use super::edges::{Pairing, origin};
use crate::mesh::NONE;

pub(super) struct Outcome {
    pub(super) cut_edge_count: u64,
    pub(super) flipped_face_count: u64,
    pub(super) component_count: u64,
}

/// Reverses triangles until all pairs run in opposite directions; pairs for which that is impossible are cut.
///
/// Each component is walked breadth first from its first triangle, which keeps cuts short; then the winding with more area wins.
pub(super) fn make_consistent(triangles: &mut [[u32; 3]], pairing: &mut Pairing, positions: &[DVec3]) -> Outcome {
    if !pairing.has_inconsistent_pair {
        let component_count = count_components(&pairing.opposite);
        return Outcome { cut_edge_count: 0, flipped_face_count: 0, component_count };
    }
    let mut outcome = Outcome { cut_edge_count: 0, flipped_face_count: 0, component_count: 0 };
    let mut reached = vec![false; triangles.len()];
    let mut flipped = vec![false; triangles.len()];
    let mut queue: Vec<u32> = Vec::new();
    for seed in 0..triangles.len() {
        if reached[seed] {
            continue;
        }
        outcome.component_count += 1;
        reached[seed] = true;
        queue.clear();
        queue.push(seed as u32);
        let mut head = 0;
        while let Some(&t) = queue.get(head) {
            head += 1;
            for h in 3 * t..3 * t + 3 {
                let other = pairing.opposite[h as usize];
                if other == NONE {
                    continue;
                }
                let same_direction = origin(triangles, h) == origin(triangles, other);
                let (neighbour, wanted) = (other as usize / 3, flipped[t as usize] ^ same_direction);
                if !reached[neighbour] {
                    reached[neighbour] = true;
                    flipped[neighbour] = wanted;
                    queue.push(neighbour as u32);
                } else if flipped[neighbour] != wanted {
                    pairing.separate(h);
                    outcome.cut_edge_count += 1;
                }
            }
        }
        if queue.iter().any(|&t| flipped[t as usize]) {
            let mut area = [0.0; 2];
            for &t in &queue {
                let [a, b, c] = triangles[t as usize].map(|v| positions[v as usize]);
                area[usize::from(flipped[t as usize])] += (b - a).cross(c - a).length();
            }
            if area[1] > area[0] {
                queue.iter().for_each(|&t| flipped[t as usize] ^= true);
            }
        }
    }
    outcome.flipped_face_count = flipped.iter().filter(|&&f| f).count() as u64;
    reverse(triangles, pairing, &flipped);
    outcome
}

/// Reverses triangles [a, b, c] to [a, c, b]: half-edges 0 and 2 change places.
fn reverse(triangles: &mut [[u32; 3]], pairing: &mut Pairing, flipped: &[bool]) {
    let renamed = |h: u32| match h {
        NONE => NONE,
        h if flipped[h as usize / 3] => h - h % 3 + (2 - h % 3),
        h => h,
    };
    for (t, triangle) in triangles.iter_mut().enumerate() {
        let opposite = &mut pairing.opposite[3 * t..3 * t + 3];
        opposite.iter_mut().for_each(|h| *h = renamed(*h));
        if flipped[t] {
            triangle.swap(1, 2);
            opposite.swap(0, 2);
        }
    }
    pairing.cut.iter_mut().for_each(|h| *h = renamed(*h));
    pairing.has_inconsistent_pair = false;
}

/// Number of pieces that no edge connects.
pub(super) fn count_components(opposite: &[u32]) -> u64 {
    let mut reached = vec![false; opposite.len() / 3];
    let mut open: Vec<u32> = Vec::new();
    let mut count = 0;
    for seed in 0..reached.len() {
        if reached[seed] {
            continue;
        }
        count += 1;
        reached[seed] = true;
        open.push(seed as u32);
        while let Some(t) = open.pop() {
            for h in 3 * t as usize..3 * t as usize + 3 {
                let other = opposite[h];
                if other != NONE && !std::mem::replace(&mut reached[other as usize / 3], true) {
                    open.push(other / 3);
                }
            }
        }
    }
    count
}
