//! Points spread over a surface by area, at which surfaces are compared.

/// Calls a function for about `count` points, with the number of the triangle and the weights of its corners. `areas`
/// are those of the triangles, or any multiple of them.
pub(crate) fn for_each_point(areas: &[f64], count: usize, mut visit: impl FnMut(usize, [f64; 3])) {
    let step = areas.iter().sum::<f64>() / count as f64;
    let (mut passed, mut next, mut number) = (0.0, 0.5 * step, 0_u32);
    for (triangle, area) in areas.iter().enumerate() {
        passed += area;
        while next < passed && step > 0.0 {
            visit(triangle, weights_of(number));
            number += 1;
            next += step;
        }
    }
}

/// The weights of a triangle's corners at a point of a sequence that fills it evenly (Roberts, "The Unreasonable
/// Effectiveness of Quasirandom Sequences").
pub(crate) fn weights_of(number: u32) -> [f64; 3] {
    let (u, v) = (f64::from(number) * 0.754_877_666, f64::from(number) * 0.569_840_291);
    let (u, v) = (u.fract(), v.fract());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    [1.0 - u - v, u, v]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_have_as_many_points_as_area() {
        let mut counts = [0; 3];
        for_each_point(&[1.0, 0.0, 3.0], 400, |triangle, weights| {
            counts[triangle] += 1;
            assert!(weights.iter().all(|&weight| weight >= 0.0) && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        });
        assert_eq!(counts, [100, 0, 300]);
        for_each_point(&[0.0, f64::NAN], 10, |_, _| panic!("nothing has an area"));
    }
}
