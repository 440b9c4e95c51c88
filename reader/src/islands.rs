//! Islands: the connected parts of a block.

/// Divides triangles into islands: those that share vertices, transitively, are in one. Returns the island of each
/// triangle, and how many there are. Islands are numbered in the order of their first triangles.
///
/// ```
/// assert_eq!(lodpack::islands(&[[0, 1, 2], [5, 4, 3], [2, 6, 7]]), (vec![0, 1, 0], 2));
/// ```
pub fn islands(triangles: &[[u32; 3]]) -> (Vec<u32>, u32) {
    let vertex_count = triangles.iter().flatten().max().map_or(0, |&last| last as usize + 1);
    let mut above: Vec<u32> = (0..vertex_count as u32).collect();
    for &[a, b, c] in triangles {
        for other in [b, c] {
            let (a, other) = (top(&mut above, a), top(&mut above, other));
            above[a.max(other) as usize] = a.min(other);
        }
    }
    const NONE: u32 = u32::MAX;
    let (mut numbers, mut count) = (vec![NONE; vertex_count], 0);
    let label = |&[a, ..]: &[u32; 3]| {
        let number = &mut numbers[top(&mut above, a) as usize];
        if *number == NONE {
            *number = count;
            count += 1;
        }
        *number
    };
    let labels = triangles.iter().map(label).collect();
    (labels, count)
}

/// The vertex that stands for all that are joined with one. Paths are halved on the way.
fn top(above: &mut [u32], mut vertex: u32) -> u32 {
    loop {
        let next = above[vertex as usize];
        if next == vertex {
            return vertex;
        }
        above[vertex as usize] = above[next as usize];
        vertex = above[next as usize];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::synthetic::Random;

    #[test]
    fn islands_are_what_spreading_from_triangle_to_triangle_finds() {
        let mut random = Random::new(5);
        for round in 0..200 {
            let vertices = 1 + random.below(60);
            let triangles: Vec<[u32; 3]> =
                (0..random.below(40)).map(|_| [0; 3].map(|_: u32| random.below(vertices) as u32)).collect();
            let (labels, count) = islands(&triangles);
            let mut next = 0;
            let mut expected = vec![u32::MAX; triangles.len()];
            for first in 0..triangles.len() {
                if expected[first] != u32::MAX {
                    continue;
                }
                let mut waiting = vec![first];
                expected[first] = next;
                while let Some(one) = waiting.pop() {
                    for other in 0..triangles.len() {
                        let shares = triangles[one].iter().any(|vertex| triangles[other].contains(vertex));
                        if shares && expected[other] == u32::MAX {
                            expected[other] = next;
                            waiting.push(other);
                        }
                    }
                }
                next += 1;
            }
            assert_eq!((labels, count), (expected, next), "{round}");
        }
    }
}
