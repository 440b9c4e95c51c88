//! Texels beside what is drawn, which nobody sees until a renderer makes smaller versions of an image: these mix all texels that lie close together.

use lodpack::decode::texels::Image;

/// Of each texel of an image whether something is interpolated with it in some triangle, whose corners are places in the image, in texels.
pub(super) fn drawn_texels([width, height]: [u32; 2], triangles: impl Iterator<Item = [[f32; 2]; 3]>) -> Vec<bool> {
    let mut drawn = vec![false; width as usize * height as usize];
    for corners in triangles {
        let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY];
        corners.iter().for_each(|corner| (low, high) = (low.min(corner[1]), high.max(corner[1])));
        for row in texels_with(low, high, height) {
            // A texel counts up to the middles of those beside it.
            let rows = [row as f32 - 0.5, row as f32 + 1.5];
            if let Some([left, right]) = extent(corners, rows) {
                let first = row as usize * width as usize;
                texels_with(left, right, width).for_each(|column| drawn[first + column as usize] = true);
            }
        }
    }
    drawn
}

/// The texels of a line that are interpolated with from one place to another.
fn texels_with(low: f32, high: f32, count: u32) -> std::ops::Range<u32> {
    // Conversions saturate, and NaN becomes 0.
    let first = (low - 1.5).ceil().max(0.0) as u32;
    let end = (high + 0.5).floor().max(-1.0) + 1.0;
    first..(end as u32).min(count)
}

/// How far a triangle reaches to the left and to the right between two heights.
fn extent(corners: [[f32; 2]; 3], [top, bottom]: [f32; 2]) -> Option<[f32; 2]> {
    let mut reached = [f32::INFINITY, f32::NEG_INFINITY];
    let mut reach = |x: f32| reached = [reached[0].min(x), reached[1].max(x)];
    for k in 0..3 {
        let [[x, y], [next_x, next_y]] = [corners[k], corners[(k + 1) % 3]];
        if (top..=bottom).contains(&y) {
            reach(x);
        }
        for height in [top, bottom] {
            if (y < height) != (next_y < height) {
                reach(x + (next_x - x) * ((height - y) / (next_y - y)));
            }
        }
    }
    (reached[0] <= reached[1]).then_some(reached)
}

/// Gives all other texels those of the closest drawn one, by the sum of columns and rows between them.
pub(crate) fn extrude(image: &mut Image<u8>, drawn: &[bool]) {
    let (components, [width, height]) = (usize::from(image.components), image.size.map(|length| length as usize));
    let mut distances: Vec<u16> = drawn.iter().map(|&drawn| if drawn { 0 } else { u16::MAX }).collect();
    let mut take = |to: usize, from: usize| {
        let distance = distances[from].saturating_add(1);
        if distance < distances[to] {
            distances[to] = distance;
            image.data.copy_within(from * components..(from + 1) * components, to * components);
        }
    };
    for row in (0..height).map(|row| row * width) {
        (1..width).for_each(|column| take(row + column, row + column - 1));
        (1..width).rev().for_each(|column| take(row + column - 1, row + column));
    }
    (width..width * height).for_each(|texel| take(texel, texel - width));
    (width..width * height).rev().for_each(|texel| take(texel - width, texel));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_is_interpolated_with_is_drawn_and_little_else() {
        let corners = [[3.2, 2.1], [14.7, 5.0], [6.0, 13.4]];
        let drawn = drawn_texels([20, 18], std::iter::once(corners));
        let mut seen = vec![false; drawn.len()];
        for (i, j) in (0..=200).flat_map(|i| (0..=200 - i).map(move |j| (i, j))) {
            let [b, c] = [i, j].map(|share| share as f32 / 200.0);
            let place = [0, 1].map(|k| corners[0][k] * (1.0 - b - c) + corners[1][k] * b + corners[2][k] * c - 0.5);
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                seen[(place[1] as usize + y) * 20 + place[0] as usize + x] = true;
            }
        }
        assert!(seen.iter().zip(&drawn).all(|(seen, drawn)| !seen || *drawn));
        let [seen, drawn] = [seen, drawn].map(|all| all.into_iter().filter(|is| *is).count());
        assert!(drawn < seen + seen / 3, "{drawn} texels for {seen}");
    }

    #[test]
    fn places_beyond_an_image_are_not_drawn() {
        for x in [f32::NAN, -1e30, 1e30, f32::INFINITY] {
            assert_eq!(drawn_texels([4, 4], std::iter::once([[x, 9.0], [x, 20.0], [-3.0, 40.0]])), [false; 16]);
        }
        assert_eq!(drawn_texels([2, 2], std::iter::once([[-9.0, -9.0], [30.0, -9.0], [-9.0, 30.0]])), [true; 4]);
    }

    #[test]
    fn other_texels_are_those_of_the_closest_one() {
        let mut image = Image::filled([5, 4], &[0, 0]);
        image.data[..2].copy_from_slice(&[1, 10]);
        image.data[38..].copy_from_slice(&[2, 20]);
        let mut drawn = [false; 20];
        (drawn[0], drawn[19]) = (true, true);
        extrude(&mut image, &drawn);
        let firsts: Vec<u8> = image.data.iter().step_by(2).copied().collect();
        assert_eq!(firsts[..4], [1, 1, 1, 1]);
        assert_eq!(firsts[16..], [2, 2, 2, 2]);
        assert!(image.data.as_chunks::<2>().0.iter().all(|texel| [[1, 10], [2, 20]].contains(texel)));
        // Where nothing is drawn, nothing changes.
        let mut empty = Image::filled([2, 2], &[7]);
        extrude(&mut empty, &[false; 4]);
        assert_eq!(empty.data, [7; 4]);
    }
}
