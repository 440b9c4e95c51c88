//! Gives each component one winding.

use glam::DVec3;

use super::edges::{Pairing, origin};
use lodpack_mesh::NONE;

pub(super) struct Outcome {
    pub(super) cut_edge_count: u64,
    pub(super) flipped_face_count: u64,
    /// Whether each triangle was reversed; empty if none was.
    pub(super) flipped: Vec<bool>,
}

/// Reverses triangles until the two half-edges of every pair run in opposite directions, and cuts the pairs for which
/// that is impossible.
///
/// Each component is walked breadth first from its first triangle, which keeps cuts short; then the winding that covers
/// more area wins.
pub(super) fn make_consistent(triangles: &mut [[u32; 3]], pairing: &mut Pairing, positions: &[DVec3]) -> Outcome {
    let mut outcome = Outcome { cut_edge_count: 0, flipped_face_count: 0, flipped: vec![] };
    if !pairing.has_inconsistent_pair {
        return outcome;
    }
    let mut reached = vec![false; triangles.len()];
    let mut flipped = vec![false; triangles.len()];
    let mut queue: Vec<u32> = Vec::new();
    for seed in 0..triangles.len() {
        if reached[seed] {
            continue;
        }
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
    outcome.flipped = flipped;
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
