//! Texels beside what is drawn, which nobody sees until a renderer makes smaller versions of an image: these mix all
//! texels that lie close together.

use super::Image;

impl<T: Copy> Image<T> {
    /// Gives all texels that are not drawn those of the closest drawn one, by the sum of columns and rows between them.
    /// `drawn` has a value for each texel, row after row. Where nothing is drawn, nothing changes.
    pub fn extrude(&mut self, drawn: &[bool]) {
        let (components, [width, height]) = (usize::from(self.components), self.size.map(|length| length as usize));
        let mut distances: Vec<u16> = drawn.iter().map(|&drawn| if drawn { 0 } else { u16::MAX }).collect();
        distances.resize(width * height, u16::MAX);
        let mut take = |to: usize, from: usize| {
            let distance = distances[from].saturating_add(1);
            if distance < distances[to] {
                distances[to] = distance;
                self.data.copy_within(from * components..(from + 1) * components, to * components);
            }
        };
        for row in (0..height).map(|row| row * width) {
            (1..width).for_each(|column| take(row + column, row + column - 1));
            (1..width).rev().for_each(|column| take(row + column - 1, row + column));
        }
        (width..width * height).for_each(|texel| take(texel, texel - width));
        (width..width * height).rev().for_each(|texel| take(texel - width, texel));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_texels_are_those_of_the_closest_one() {
        let mut image = Image::<u8>::filled([5, 4], &[0, 0]);
        image.data[..2].copy_from_slice(&[1, 10]);
        image.data[38..].copy_from_slice(&[2, 20]);
        let mut drawn = [false; 20];
        (drawn[0], drawn[19]) = (true, true);
        image.extrude(&drawn);
        let firsts: Vec<u8> = image.data.iter().step_by(2).copied().collect();
        assert_eq!(firsts[..4], [1, 1, 1, 1]);
        assert_eq!(firsts[16..], [2, 2, 2, 2]);
        assert!(image.data.as_chunks::<2>().0.iter().all(|texel| [[1, 10], [2, 20]].contains(texel)));
        // Where nothing is drawn, nothing changes.
        let mut empty = Image::<u16>::filled([2, 2], &[7]);
        empty.extrude(&[false; 4]);
        assert_eq!(empty.data, [7; 4]);
    }
}
