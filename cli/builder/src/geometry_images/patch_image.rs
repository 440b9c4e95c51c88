//! Images of patches: each triangle has a square of its own, since there is no map.

use glam::DVec2;

use super::looks::Texel;
use super::product::{AtlasPatch, Looks};
use lodpack_stage::shade::{Painter, Shader};

/// Texels along the side of a triangle's square at most.
const MOST: u32 = 1024;

/// The images of a patch's triangles.
pub(super) struct PatchImage {
    /// Texels in a row, and rows.
    pub size: [u32; 2],
    /// Row after row.
    pub texels: Vec<Texel>,
    /// Which of them belong to a triangle.
    pub drawn: Vec<bool>,
    /// For each triangle the places of its corners in texels.
    pub places: Vec<[DVec2; 3]>,
}

impl PatchImage {
    /// Paints the triangles of a patch, with about a texel for 2^`coarser` texels of the input in each direction.
    pub fn new(patch: &AtlasPatch, looks: &Looks, shader: &Shader, coarser: u32) -> Self {
        let mut painter = shader.painter(&looks.attributes);
        let sides: Vec<u32> =
            (0..patch.triangles.len()).map(|triangle| side_of(patch, triangle, &mut painter, coarser)).collect();
        let (size, squares) = packed(&sides);
        let mut image = Self {
            size,
            texels: vec![Texel::default(); size[0] as usize * size[1] as usize],
            drawn: vec![false; size[0] as usize * size[1] as usize],
            places: Vec::with_capacity(sides.len()),
        };
        for (triangle, (&side, &[left, top])) in sides.iter().zip(&squares).enumerate() {
            let corners = corners_of(patch, triangle);
            let face = painter.face(patch.numbers[triangle] as usize, corners);
            // Corners lie half a texel from the border, in the middle of texels.
            let last = f64::from(side - 1);
            let [a, b, c] = corners;
            let footprint = ((b - a).cross(c - a).length().sqrt() / last.max(1.0)) as f32;
            for y in 0..side {
                for x in 0..side {
                    let weights = weights(f64::from(x) / last, f64::from(y) / last);
                    let place = (top + y) as usize * size[0] as usize + (left + x) as usize;
                    image.texels[place] = Texel::of(looks, &face, weights, footprint);
                    image.drawn[place] = true;
                }
            }
            let corner = DVec2::new(f64::from(left) + 0.5, f64::from(top) + 0.5);
            image.places.push([corner, corner + DVec2::new(last, 0.0), corner + DVec2::new(0.0, last)]);
        }
        image
    }
}

fn corners_of(patch: &AtlasPatch, triangle: usize) -> [glam::DVec3; 3] {
    patch.triangles[triangle].map(|v| patch.positions[v as usize])
}

/// Texels along the side of a triangle's square: two at least, so that each corner has its own.
fn side_of(patch: &AtlasPatch, triangle: usize, painter: &mut Painter, coarser: u32) -> u32 {
    let corners = corners_of(patch, triangle);
    let [a, b, c] = corners;
    let density = f64::from(painter.face(patch.numbers[triangle] as usize, corners).most_density());
    // Along the longest of the two edges that become sides of the square.
    let texels = density * (b - a).length().max((c - a).length()) / f64::from(1u32 << coarser.min(31));
    // The conversion saturates, and NaN becomes 0.
    (texels.ceil() as u32).saturating_add(1).clamp(2, MOST)
}

/// The weights of a triangle's corners at a point of its square; beyond the third side those of the closest point
/// there.
fn weights(s: f64, t: f64) -> [f32; 3] {
    let beyond = (s + t - 1.0).max(0.0) / 2.0;
    let (s, t) = ((s - beyond).clamp(0.0, 1.0), (t - beyond).clamp(0.0, 1.0));
    [1.0 - s - t, s, t].map(|weight| weight.max(0.0) as f32)
}

/// Places squares in rows, the largest first; returns the size of all together, and the left upper corner of each.
fn packed(sides: &[u32]) -> ([u32; 2], Vec<[u32; 2]>) {
    let area: f64 = sides.iter().map(|&side| f64::from(side) * f64::from(side)).sum();
    let largest = sides.iter().copied().max().unwrap_or(1);
    let width = (area.sqrt().ceil() as u32).max(largest);
    let mut order: Vec<usize> = (0..sides.len()).collect();
    order.sort_by_key(|&square| std::cmp::Reverse(sides[square]));
    let mut places = vec![[0; 2]; sides.len()];
    let ([mut x, mut y], mut row) = ([0, 0], 0);
    for square in order {
        let side = sides[square];
        if x + side > width {
            (x, y, row) = (0, y + row, 0);
        }
        places[square] = [x, y];
        x += side;
        row = row.max(side);
    }
    ([width, y + row.max(1)], places)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_lie_beside_each_other() {
        let sides: Vec<u32> = (0..60).map(|i| 2 + i * 7 % 13).collect();
        let ([width, height], places) = packed(&sides);
        let mut taken = vec![false; (width * height) as usize];
        for (&side, &[left, top]) in sides.iter().zip(&places) {
            for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
                let place = &mut taken[((top + y) * width + left + x) as usize];
                assert!(!std::mem::replace(place, true));
            }
        }
        assert!(taken.iter().filter(|&&taken| taken).count() * 10 > taken.len() * 7, "{width} x {height}");
        assert_eq!(packed(&[]), ([1, 1], vec![]));
    }

    #[test]
    fn beyond_its_third_side_a_triangle_goes_on_as_at_that_side() {
        assert_eq!(weights(0.0, 0.0), [1.0, 0.0, 0.0]);
        assert_eq!(weights(1.0, 1.0), [0.0, 0.5, 0.5]);
        assert_eq!(weights(1.0, 0.5), [0.0, 0.75, 0.25]);
    }
}
