//! Samples of the quads of charts, of whatever kind: positions, texels, numbers.

use super::product::AtlasChart;
use lodpack_stage::arcs::HalfArc;

/// The images of a chart's quads, each of (2^`resolution` + 1)^2 samples, row by row. Outer edges take the samples of
/// the sides, of which each has 2^(`resolution` + 1) + 1; the centre and the spokes are evaluated only once. `evaluate`
/// is given a quad and a point (s, t) of it.
pub(super) fn sample_quads<T: Copy>(
    resolution: u32,
    sides: &[Vec<T>],
    mut evaluate: impl FnMut(usize, f64, f64) -> T,
) -> Vec<Vec<T>> {
    let n = sides.len();
    let last = 1usize << resolution;
    let mut at = |quad: usize, x: usize, y: usize| evaluate(quad, x as f64 / last as f64, y as f64 / last as f64);
    let centre = at(0, 0, 0);
    // Spoke i runs from the centre to the middle of side i: the left edge of quad i, the top edge of quad i + 1.
    let mut spokes: Vec<Vec<T>> = Vec::with_capacity(n);
    for (quad, side) in sides.iter().enumerate() {
        let inner = (1..last).map(|y| at(quad, 0, y));
        let mut spoke = vec![centre];
        spoke.extend(inner);
        spoke.push(side[last]);
        spokes.push(spoke);
    }
    let mut images = Vec::with_capacity(n);
    for quad in 0..n {
        let previous = (quad + n - 1) % n;
        let mut samples = Vec::with_capacity((last + 1) * (last + 1));
        for y in 0..=last {
            for x in 0..=last {
                samples.push(if x == last {
                    sides[previous][last + y]
                } else if y == last {
                    sides[quad][last - x]
                } else if x == 0 {
                    spokes[quad][y]
                } else if y == 0 {
                    spokes[previous][x]
                } else {
                    at(quad, x, y)
                });
            }
        }
        images.push(samples);
    }
    images
}

/// The samples along a chart's sides, each from the side's first corner to its last, of those along the arcs.
pub(super) fn samples_of_sides<T: Copy>(chart: &AtlasChart, arc_samples: &[Vec<T>]) -> Vec<Vec<T>> {
    let side = |half: &HalfArc| {
        let mut samples = arc_samples[half.arc as usize].clone();
        if half.reversed {
            samples.reverse();
        }
        samples
    };
    chart.sides.iter().map(side).collect()
}
