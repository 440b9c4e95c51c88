//! Drops triangles and vertices.

use glam::DVec3;
use rayon::prelude::*;
use robust::{Coord, orient2d};

use lodpack_mesh::NONE;
use lodpack_runtime::trace;

/// Renumbers vertices and drops triangles without area. Returns the number of triangles dropped; `origins` gets the
/// numbers of the others.
pub(super) fn drop_degenerate(
    triangles: &mut Vec<[u32; 3]>,
    new_number: &[u32],
    positions: &[DVec3],
    origins: Option<&mut Vec<(u32, bool)>>,
) -> u64 {
    let of_all = trace::even("degenerate");
    triangles.par_iter_mut().with_min_len(1 << 14).for_each(|triangle| {
        let [a, b, c] = triangle.map(|v| new_number[v as usize]);
        let repeats = a == b || b == c || c == a;
        let degenerate = repeats || are_collinear([a, b, c].map(|v| positions[v as usize]));
        *triangle = if degenerate { [NONE; 3] } else { [a, b, c] };
    });
    drop(of_all);
    let before = triangles.len();
    if let Some(origins) = origins {
        origins.extend((0..).zip(triangles.iter()).filter(|(_, t)| t[0] != NONE).map(|(number, _)| (number, false)));
    }
    triangles.retain(|t| t[0] != NONE);
    (before - triangles.len()) as u64
}

/// Whether three points lie exactly on a line, that is, whether their projections along all three axes do. Exact
/// (Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997) as long as
/// products of coordinate differences neither overflow nor fall below the smallest f64.
fn are_collinear([a, b, c]: [DVec3; 3]) -> bool {
    [(0, 1), (1, 2), (2, 0)].into_iter().all(|(u, v)| {
        let coord = |p: DVec3| Coord { x: p[u], y: p[v] };
        orient2d(coord(a), coord(b), coord(c)) == 0.0
    })
}

/// Drops the triangles in an ascending list, or what is known of each.
pub(super) fn drop_listed<T>(triangles: &mut Vec<T>, list: &[u32]) {
    let (mut list, mut number) = (list.iter().peekable(), 0u32);
    triangles.retain(|_| {
        number += 1;
        list.next_if_eq(&&(number - 1)).is_none()
    });
}

/// Drops the vertices that no triangle uses and keeps the order of the others. Returns the number of vertices dropped.
pub(super) fn drop_unreferenced(triangles: &mut [[u32; 3]], positions: &mut Vec<DVec3>) -> u64 {
    let mut new_number = vec![NONE; positions.len()];
    triangles.iter().flatten().for_each(|&v| new_number[v as usize] = 0);
    let mut kept = 0;
    for old in 0..positions.len() {
        if new_number[old] != NONE {
            new_number[old] = kept;
            positions[kept as usize] = positions[old];
            kept += 1;
        }
    }
    let dropped = positions.len() as u64 - u64::from(kept);
    if dropped > 0 {
        positions.truncate(kept as usize);
        positions.shrink_to_fit();
        triangles.iter_mut().flatten().for_each(|v| *v = new_number[*v as usize]);
    }
    dropped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_exactly_collinear_corners_are_degenerate() {
        let line = |t: f64| DVec3::new(1.0, 2.0, -3.0) + DVec3::new(3.0, 0.5, 0.25) * t;
        assert!(are_collinear([line(0.0), line(8.0), line(1024.0)]));
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let near = line(8.0) + axis * 4.0 * f64::EPSILON * line(8.0);
            assert!(!are_collinear([line(0.0), near, line(1024.0)]));
        }
        let far = DVec3::splat(5e6);
        assert!(!are_collinear([far, far + DVec3::X * 1e-3, far + DVec3::new(2e-3, 1e-9, 0.0)]));
        assert!(are_collinear([far, far, DVec3::ZERO]));
    }
}
