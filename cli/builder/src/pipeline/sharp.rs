//! Whether what images of the base colour show is even but for a few sharp edges, as letters and drawings are.

use glam::DVec3;

use crate::reduce::weights_of;
use lodpack_stage::bake::weight_growth;
use lodpack_stage::shade::Face;

/// Texels of the input for each point that is looked at.
const SPARSE: f64 = 16.0;
/// The most points of a triangle.
const MOST_POINTS: f64 = 64.0;
/// What curves by less than this between texels is even, in steps of 255 of about sRGB.
const EVEN: f64 = 2.0;
/// Where no more than this share is not even, it costs few bytes to be finer.
const FEW: f64 = 0.25;
/// How much that curves in the mean of squares, if it is sharp.
const SHARP: f64 = 17.0;
/// Fewer texels that are not even say nothing.
const LEAST: f64 = 32.0;

/// What points of a chart have shown. Sums are weighted by texels of the input.
#[derive(Debug, Default)]
pub(super) struct Sharpness {
    points: u32,
    seen: f64,
    uneven: f64,
    /// Of squares of how much colours curve where they are not even.
    squares: f64,
}

impl Sharpness {
    /// Looks at points of a triangle, whose images have `density` texels per unit of length: how far the colour of each
    /// is from the middle between those of a texel before and after it.
    pub fn look(&mut self, face: &Face<'_>, corners: [DVec3; 3], density: f64) {
        let sides = [corners[1] - corners[0], corners[2] - corners[0]];
        let normal = sides[0].cross(sides[1]);
        let square = normal.length_squared();
        let texels = 0.5 * square.sqrt() * density * density;
        if !(square > 0.0 && texels > 0.0 && texels.is_finite()) {
            return;
        }
        let growth = weight_growth(corners);
        let along = sides[0].normalize();
        let steps = [along, normal.normalize().cross(along)]
            .map(|step| growth.map(|growth| growth.dot(step) / density))
            .map(|[b, c]| [-b - c, b, c]);
        let is_inside = |weights: &[f64; 3]| weights.iter().all(|&weight| weight >= 0.0);
        let colour_at = |weights: [f64; 3]| face.base_colour(weights.map(|weight| weight as f32), 0.0).map(about_srgb);
        let count = (texels / SPARSE).clamp(1.0, MOST_POINTS).floor();
        let each = texels / count;
        for _ in 0..count as u32 {
            self.points += 1;
            let middle = weights_of(self.points);
            let mut here = None;
            for step in steps {
                let beside = [-1.0, 1.0].map(|way| [0, 1, 2].map(|k| middle[k] + way * step[k]));
                if beside.iter().all(is_inside) {
                    let here = here.get_or_insert_with(|| colour_at(middle));
                    let [before, after] = beside.map(colour_at);
                    let curved = |k: usize| before[k] - 2.0 * here[k] + after[k];
                    self.add((0..3).map(|k| curved(k) * curved(k)).sum::<f64>() / 3.0, each);
                }
            }
        }
    }

    fn add(&mut self, square: f64, weight: f64) {
        self.seen += weight;
        if square >= EVEN * EVEN {
            self.uneven += weight;
            self.squares += weight * square;
        }
    }

    /// Whether finer texels show more for few bytes.
    pub fn is_sharp(&self) -> bool {
        self.uneven >= LEAST && self.uneven <= FEW * self.seen && self.squares >= SHARP * SHARP * self.uneven
    }
}

/// Of linear light, in steps of 255.
fn about_srgb(value: f32) -> f64 {
    255.0 * f64::from(value.clamp(0.0, 1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use image::{GrayImage, ImageFormat, Luma};

    use super::*;
    use lodpack_mesh::appearance::{Appearance, Material, TextureUse, Wrap};
    use lodpack_mesh::attributes::{AttributeLayout, RegionAttributes};
    use lodpack_mesh::images::ImageSource;
    use lodpack_stage::shade::Shader;

    /// Of a triangle that shows half of an image of 128 texels.
    fn of_image(grey: impl Fn(u32, u32) -> u8) -> bool {
        let mut bytes = Cursor::new(vec![]);
        let image = GrayImage::from_fn(128, 128, |x, y| Luma([grey(x, y)]));
        image.write_to(&mut bytes, ImageFormat::Png).unwrap();
        let mut layout = AttributeLayout::default();
        layout.add_uv(1);
        let texture = TextureUse { image: 0, uv_set: 0, wrap: [Wrap::Clamp; 2], transform: None };
        let appearance = Appearance {
            layout,
            has_colour: true,
            materials: vec![Material { base_texture: Some(texture), ..Material::default() }],
            images: vec![ImageSource::Inline { name: "an image".into(), bytes: bytes.into_inner() }],
            ..Appearance::default()
        };
        let records = vec![0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
        let region = RegionAttributes { corners: vec![[0, 1, 2]], records, ..RegionAttributes::default() };
        let shader = Shader::new(&appearance, None, &std::env::temp_dir(), 0, &|_| ());
        let corners = [DVec3::ZERO, 3.0 * DVec3::X, 3.0 * DVec3::Y];
        let mut sharpness = Sharpness::default();
        let face = shader.painter(&region).face(0, corners);
        // As many triangles as charts have.
        (0..8).for_each(|_| sharpness.look(&face, corners, face.image_density().into()));
        // Without an area nothing is seen.
        sharpness.look(&face, [DVec3::X; 3], face.image_density().into());
        sharpness.is_sharp()
    }

    #[test]
    fn lines_are_sharp_and_photographs_are_not() {
        assert!(of_image(|x, y| if x % 32 == 7 || y % 32 == 9 { 0 } else { 255 }));
        assert!(!of_image(|x, y| (x + y) as u8));
        assert!(!of_image(|x, y| if x % 32 == 7 || y % 32 == 9 { 100 } else { 110 }));
        let grain = |x: u32, y: u32| ((x * 7919) ^ (y * 104_729)).wrapping_mul(2_654_435_761) >> 24;
        assert!(!of_image(|x, y| grain(x, y) as u8));
    }

    fn of(squares: &[(f64, f64)]) -> Sharpness {
        let mut sharpness = Sharpness::default();
        squares.iter().for_each(|&(square, weight)| sharpness.add(square, weight));
        sharpness
    }

    #[test]
    fn few_strong_edges_are_sharp() {
        assert!(of(&[(0.0, 9000.0), (3000.0, 300.0)]).is_sharp());
        // A photograph has something everywhere, a smooth image nothing, and dirt is weak.
        assert!(!of(&[(0.0, 600.0), (3000.0, 300.0)]).is_sharp());
        assert!(!of(&[(1.0, 9000.0)]).is_sharp());
        assert!(!of(&[(0.0, 9000.0), (100.0, 300.0)]).is_sharp());
        assert!(!of(&[(0.0, 9000.0), (3000.0, 3.0)]).is_sharp());
        assert!(!Sharpness::default().is_sharp());
    }
}
