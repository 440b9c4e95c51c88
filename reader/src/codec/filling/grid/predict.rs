//! Predictions of vertices, in a fixed order of IEEE operations.

use crate::codec::vector::{Vec3, add, cross, scale, sub};

/// The middle of an edge, from its ends and, where they exist, the next vertices beyond either end at the same spacing:
/// by the cubic through four points, the quadratic through three, or the mean of two.
pub(super) fn edge_middle(before: Option<Vec3>, ends: [Vec3; 2], after: Option<Vec3>) -> Vec3 {
    let [a, b] = ends;
    let quadratic =
        |near: Vec3, far: Vec3, beyond: Vec3| add(add(scale(near, 0.75), scale(far, 0.375)), scale(beyond, -0.125));
    match (before, after) {
        (Some(p), Some(q)) => sub(scale(add(a, b), 0.5625), scale(add(p, q), 0.0625)),
        (Some(p), None) => quadratic(a, b, p),
        (None, Some(q)) => quadratic(b, a, q),
        (None, None) => scale(add(a, b), 0.5),
    }
}

/// The middle of a cell, from its corners and the middles of its edges: the Coons patch at (1/2, 1/2).
pub(super) fn cell_middle(edges: [Vec3; 4], corners: [Vec3; 4]) -> Vec3 {
    let sum = |p: [Vec3; 4]| add(add(p[0], p[1]), add(p[2], p[3]));
    sub(scale(sum(edges), 0.5), scale(sum(corners), 0.25))
}

/// The mean of some points, and the area vector of the closed chain through them. Both are zero without points.
pub(super) fn centre(chain: &[Vec3]) -> (Vec3, Vec3) {
    let sum = chain.iter().fold([0.0; 3], |sum, &p| add(sum, p));
    let mean = if chain.is_empty() { sum } else { scale(sum, 1.0 / chain.len() as f64) };
    let mut area = [0.0; 3];
    for (i, &p) in chain.iter().enumerate() {
        let q = chain[(i + 1) % chain.len()];
        area = add(area, cross(sub(p, mean), sub(q, mean)));
    }
    (mean, area)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_of_a_cubic_and_cells_of_a_coons_patch_are_predicted_exactly() {
        let cubic = |x: f64| [x, x * x, x * x * x - 2.0 * x];
        assert_eq!(edge_middle(Some(cubic(-3.0)), [cubic(-1.0), cubic(1.0)], Some(cubic(3.0))), cubic(0.0));
        let quadratic = |x: f64| [x, x * x, 1.0];
        assert_eq!(edge_middle(Some(quadratic(-3.0)), [quadratic(-1.0), quadratic(1.0)], None), quadratic(0.0));
        assert_eq!(edge_middle(None, [quadratic(-1.0), quadratic(1.0)], Some(quadratic(3.0))), quadratic(0.0));
        let f = |x: f64, y: f64| [x, y, x * x + 3.0 * y * y + x * y];
        let corners = [f(-1.0, -1.0), f(1.0, -1.0), f(1.0, 1.0), f(-1.0, 1.0)];
        assert_eq!(cell_middle([f(0.0, -1.0), f(1.0, 0.0), f(0.0, 1.0), f(-1.0, 0.0)], corners), f(0.0, 0.0));
    }
}
