//! Where the boundary of a surface bends: there its arcs end, so that coarse levels keep its shape with few vertices.
//!
//! Samples inside arcs lie at halves, quarters and so on, wherever the boundary turns, and a coarse level would cut off
//! a corner of a sheet between two of them. A corner of the atlas may lie anywhere, and each level of groups has only
//! those that it needs.

use glam::DVec3;

/// How often an interval may be divided on the way to a bend, so that even a spiral takes time in proportion to its
/// length.
const MOST_DEPTH: u32 = 48;

/// The point of segment `ab` that is closest to `p`, and its parameter in 0..=1.
#[inline]
pub fn closest_on_segment(p: DVec3, a: DVec3, b: DVec3) -> (DVec3, f64) {
    let direction = b - a;
    let squared = direction.length_squared();
    let t = if squared > 0.0 { ((p - a).dot(direction) / squared).clamp(0.0, 1.0) } else { 0.0 };
    (a + direction * t, t)
}

/// The inner points of a path, ascending, with which it is nowhere farther than `tolerance` from its chords (Douglas
/// and Peucker 1973).
pub(super) fn bends(points: &[DVec3], tolerance: f64) -> Vec<usize> {
    let mut found = vec![];
    let mut pending = vec![(0, points.len() - 1, 0)];
    while let Some((first, last, depth)) = pending.pop() {
        let off = |&i: &usize| points[i].distance_squared(closest_on_segment(points[i], points[first], points[last]).0);
        let farthest = (first + 1..last).max_by(|i, j| off(i).total_cmp(&off(j)).then(j.cmp(i)));
        if let Some(middle) = farthest.filter(|middle| depth < MOST_DEPTH && off(middle) > tolerance * tolerance) {
            found.push(middle);
            pending.extend([(first, middle, depth + 1), (middle, last, depth + 1)]);
        }
    }
    found.sort_unstable();
    found
}

/// The point of a path that is farthest from its first one, if that is farther than `tolerance`.
pub(super) fn farthest(points: &[DVec3], tolerance: f64) -> Option<usize> {
    let off = |&i: &usize| points[i].distance_squared(points[0]);
    let farthest = (1..points.len()).max_by(|i, j| off(i).total_cmp(&off(j)).then(j.cmp(i)));
    farthest.filter(|i| off(i) > tolerance * tolerance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bends_are_corners_and_none_are_on_straight_parts() {
        // Three sides of a square, with noise far below the tolerance.
        let noise = |i: usize| 1e-3 * if i.is_multiple_of(3) { 1.0 } else { 0.0 };
        let side =
            |from: DVec3, along: DVec3| (0..20).map(move |i| from + along * (f64::from(i) / 20.0)).collect::<Vec<_>>();
        let mut points =
            [side(DVec3::ZERO, DVec3::X), side(DVec3::X, DVec3::Y), side(DVec3::ONE - DVec3::Z, -DVec3::X)].concat();
        points.iter_mut().enumerate().for_each(|(i, p)| p.z += noise(i));
        assert_eq!(bends(&points, 0.1), [20, 40]);
        assert_eq!(bends(&points, 2.0), [0; 0]);
        assert_eq!(farthest(&points, 0.1), Some(40));
        assert_eq!(farthest(&points, 2.0), None);
    }

    #[test]
    fn a_path_within_the_tolerance_of_its_bends_takes_bounded_depth() {
        // Ever smaller zigzags, each of which divides its interval near one end.
        let zigzag = |i: i32| f64::from(1 - 2 * (i % 2)) / f64::from(1 + i);
        let points: Vec<DVec3> = (0..400).map(|i| DVec3::new(0.0, zigzag(i), f64::from(i))).collect();
        let found = bends(&points, 0.0);
        assert!(!found.is_empty() && found.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
