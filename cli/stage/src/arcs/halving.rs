//! Parameters along a path by halving: the vertex nearest to the middle of an interval (by arc length) gets the middle
//! parameter. [`super::super::arc_samples`] samples arcs this way.
//!
//! The rule stands here because tracing must not make an arc on which halving runs out of parameters.

use glam::DVec3;

/// Units of the parameter along an arc. Halving goes as deep as the binary logarithm of this.
pub const ARC_UNITS: u32 = 1 << 16;

pub(crate) fn lengths_along(points: &[DVec3]) -> Vec<f64> {
    let mut length = vec![0.0; points.len()];
    for i in 1..points.len() {
        length[i] = length[i - 1] + points[i].distance(points[i - 1]);
    }
    length
}

/// The inner vertex of the interval from `i` to `j` that is nearest to its middle by arc length.
pub(crate) fn middle_vertex(length: &[f64], i: usize, j: usize) -> usize {
    let half = 0.5 * (length[i] + length[j]);
    let after = i + 1 + length[i + 1..j].partition_point(|&s| s < half);
    if after == j || after > i + 1 && half - length[after - 1] < length[after] - half { after - 1 } else { after }
}

/// Where to divide a path into arcs so that halving reaches all of its vertices. These are the ends, ascending, of the
/// intervals that still contain vertices when their parameters cannot be halved any more. Empty for a path whose edges
/// have similar lengths.
pub(super) fn intervals_too_deep(points: &[DVec3]) -> Vec<usize> {
    let last = points.len() - 1;
    let length = lengths_along(points);
    let mut ends = vec![];
    let mut pending = vec![(0, last, ARC_UNITS)];
    while let Some((i, j, units)) = pending.pop() {
        if j == i + 1 {
            continue;
        }
        if units == 1 {
            ends.extend([i, j]);
            continue;
        }
        let m = middle_vertex(&length, i, j);
        pending.extend([(i, m, units / 2), (m, j, units / 2)]);
    }
    ends.retain(|&end| end != 0 && end != last);
    ends.sort_unstable();
    ends.dedup();
    ends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_over_many_decades_are_divided_where_halving_ends() {
        let even: Vec<DVec3> = (0..1000).map(|i| DVec3::X * f64::from(i)).collect();
        assert!(intervals_too_deep(&even).is_empty());
        let decades: Vec<DVec3> = (0..=48).map(|i| DVec3::X * 10f64.powf(f64::from(i) / 4.0 - 12.0)).collect();
        let cuts = intervals_too_deep(&decades);
        assert!(!cuts.is_empty() && cuts.iter().all(|&cut| 0 < cut && cut < 48), "{cuts:?}");
    }
}
