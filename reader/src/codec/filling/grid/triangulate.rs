//! Triangles of the convex polygons that a grid is drawn with. They are derived from decoded positions, so no bits are
//! spent on them.
//!
//! The rule (SPEC.md, "Triangles of a polygon"): among the triangulations without a triangle whose three vertices lie
//! on one side of the polygon in the parameter square, take the one with the least sum of squared diagonal lengths, by
//! dynamic programming. The order of sums is fixed, and ties go to the smaller apex, so every platform draws the same
//! triangles.

use crate::codec::vector::{Vec3, dot, sub};

/// Larger polygons are first halved by chords, because dynamic programming takes cubic time.
const DYNAMIC_PROGRAMMING_LIMIT: usize = 48;

/// The sides of the polygon on which a vertex lies: two for a corner, otherwise the same side twice.
pub(crate) type Lines = [u16; 2];

/// Triangulates polygons one after the other, in the same memory.
#[derive(Clone, Debug, Default)]
pub(crate) struct Triangulator {
    cost: Vec<f64>,
    apex: Vec<usize>,
    stack: Vec<(usize, usize)>,
}

fn share(a: Lines, b: Lines) -> bool {
    a[0] == b[0] || a[0] == b[1] || a[1] == b[0] || a[1] == b[1]
}

fn is_flat(a: Lines, b: Lines, c: Lines) -> bool {
    a.iter().any(|line| b.contains(line) && c.contains(line))
}

impl Triangulator {
    /// Appends the triangles, as indices into `points`, of a convex polygon whose vertices run counter-clockwise. Both
    /// slices have the same length. Fewer than three vertices have no triangles.
    pub(crate) fn triangulate(&mut self, points: &[Vec3], lines: &[Lines], triangles: &mut Vec<[u32; 3]>) {
        match points {
            [] | [_] | [_, _] => {}
            [_, _, _] => triangles.push([0, 1, 2]),
            [a, b, c, d] if !(0..4).any(|i| is_flat(lines[i], lines[(i + 1) % 4], lines[(i + 2) % 4])) => {
                if squared(*b, *d) <= squared(*a, *c) {
                    triangles.extend([[0, 1, 3], [1, 2, 3]]);
                } else {
                    triangles.extend([[0, 1, 2], [0, 2, 3]]);
                }
            }
            _ => {
                let mut pieces = vec![(0..points.len() as u32).collect::<Vec<_>>()];
                while let Some(piece) = pieces.pop() {
                    if piece.len() <= DYNAMIC_PROGRAMMING_LIMIT {
                        self.optimal(&piece, points, lines, triangles);
                    } else if let Some([first, second]) = halves(&piece, lines) {
                        pieces.push(second);
                        pieces.push(first);
                    } else {
                        // Polygons with three or more sides never get here. The result is watertight all the same.
                        triangles.extend(piece.windows(2).skip(1).map(|w| [piece[0], w[0], w[1]]));
                    }
                }
            }
        }
    }

    /// Triangulates the polygon `piece` (indices into `points`) with the least sum of squared diagonals.
    fn optimal(&mut self, piece: &[u32], points: &[Vec3], lines: &[Lines], triangles: &mut Vec<[u32; 3]>) {
        let n = piece.len();
        let at = |i: usize| piece[i] as usize;
        self.cost.clear();
        self.cost.resize(n * n, 0.0);
        self.apex.clear();
        self.apex.resize(n * n, 0);
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                let (mut least, mut apex) = (f64::INFINITY, i + 1);
                for k in i + 1..j {
                    if is_flat(lines[at(i)], lines[at(k)], lines[at(j)]) {
                        continue;
                    }
                    let cost = self.cost[i * n + k] + self.cost[k * n + j];
                    if cost < least {
                        (least, apex) = (cost, k);
                    }
                }
                // The base counts only if it is a diagonal, not if it closes the polygon.
                let base = if span + 1 < n { squared(points[at(i)], points[at(j)]) } else { 0.0 };
                self.cost[i * n + j] = least + base;
                self.apex[i * n + j] = apex;
            }
        }
        self.stack.push((0, n - 1));
        while let Some((i, j)) = self.stack.pop() {
            if j < i + 2 {
                continue;
            }
            let k = self.apex[i * n + j];
            triangles.push([piece[i], piece[k], piece[j]]);
            self.stack.push((k, j));
            self.stack.push((i, k));
        }
    }
}

/// Squared distance, summed as (x + y) + z.
fn squared(a: Vec3, b: Vec3) -> f64 {
    let d = sub(a, b);
    dot(d, d)
}

/// Cuts a polygon by the first chord between opposite vertices that does not run along one of its sides.
fn halves(piece: &[u32], lines: &[Lines]) -> Option<[Vec<u32>; 2]> {
    let n = piece.len();
    let start = (0..n).find(|&s| !share(lines[piece[s] as usize], lines[piece[(s + n / 2) % n] as usize]))?;
    let turned = |from: usize, count: usize| (0..count).map(|i| piece[(from + i) % n]).collect();
    Some([turned(start, n / 2 + 1), turned(start + n / 2, n - n / 2 + 1)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square with `extra` vertices inside its first side.
    fn square(extra: usize) -> (Vec<Vec3>, Vec<Lines>) {
        let mut points = vec![[0.0, 0.0, 0.0]];
        let mut lines = vec![[0, 3]];
        for i in 1..=extra {
            points.push([i as f64 / (extra + 1) as f64, 0.0, 0.0]);
            lines.push([0, 0]);
        }
        points.extend([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
        lines.extend([[0, 1], [1, 2], [2, 3]]);
        (points, lines)
    }

    fn double_area(points: &[Vec3], t: [u32; 3]) -> f64 {
        let [a, b, c] = t.map(|i| points[i as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    #[test]
    fn every_polygon_is_covered_once_by_proper_triangles() {
        for extra in [0, 1, 2, 7, 43, 44, 45, 90, 1000] {
            let (points, lines) = square(extra);
            let mut triangles = vec![];
            Triangulator::default().triangulate(&points, &lines, &mut triangles);
            assert_eq!(triangles.len(), points.len() - 2);
            let areas: Vec<f64> = triangles.iter().map(|&t| double_area(&points, t)).collect();
            assert!(areas.iter().all(|&a| a > 1e-9), "{extra}");
            assert!((areas.iter().sum::<f64>() - 2.0).abs() < 1e-9);
        }
    }

    #[test]
    fn a_square_takes_its_shorter_diagonal() {
        let lines = square(0).1;
        for (corner, expected) in [(2, [0, 1, 3]), (1, [0, 1, 2])] {
            let mut points = square(0).0;
            points[corner] = [2.0 * points[corner][0], 2.0 * points[corner][1], 0.0];
            points[0] = if corner == 1 { [-1.0, 0.5, 0.0] } else { points[0] };
            points[1] = if corner == 1 { [0.0, -3.0, 0.0] } else { points[1] };
            let mut triangles = vec![];
            Triangulator::default().triangulate(&points, &lines, &mut triangles);
            assert_eq!(triangles[0], expected);
        }
    }
}
