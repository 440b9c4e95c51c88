//! Where the input's images have more texels than elsewhere, as signs and labels do.

use std::collections::HashMap;

use lodpack_mesh::union_find::{find, unite};
use lodpack_stage::bake::larger;

/// Triangles side by side whose densities differ by less belong together: a photograph that is stretched over a surface
/// is one.
const ALIKE: f64 = 1.5;
/// What has fewer texels of the input has no size of its own.
const FEW: f64 = 256.0;
/// What has this many times the mean density counts as finest.
const MOST: f64 = 16.0;
/// Texels get larger where they are this many times as fine as they would have to be after that.
const SPARE: f64 = 1.19;
/// An image that has this many times the texels along one direction as it has in the mean of both is stretched.
const STRETCHED: f64 = 2.0;
/// Where more than this share of a surface shows stretched images, as walls do in pictures from above, texels may be
/// longer than wide.
const MOST_STRETCHED: f64 = 0.05;

/// What images have at a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// Texels per unit of length, in the mean of all directions.
    pub mean: f64,
    /// In the direction in which there are most.
    pub most: f64,
    /// The triangle's area.
    pub area: f64,
}

/// The sum of densities by area, and the area.
fn sums<'a>(densities: impl Iterator<Item = &'a Density>) -> [f64; 2] {
    densities.fold([0.0; 2], |[sum, area], density| [sum + density.mean * density.area, area + density.area])
}

/// The texels that images ask for.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Asked {
    /// How much larger those of each triangle may be than the smallest, as a power of the root of two; nothing if all
    /// are alike.
    pub larger: Vec<u8>,
    /// The texels per unit of length, as a root of the mean of squares, where images are stretched: then texels may be
    /// longer than wide.
    pub stretched: Option<f64>,
}

/// What the images of triangles ask for. Where images are stretched, what has more texels than the mean gets as many as
/// it has, and what has fewer gets as many as the mean: few texels cost little, and an image that is not in line with
/// them needs more.
pub(super) fn asked_by_images(triangles: &[[u32; 3]], densities: &[Density]) -> Asked {
    let [sum, area] = sums(densities.iter());
    let mean = sum / area;
    let is_stretched = |density: &&Density| density.most > STRETCHED * density.mean;
    let [_, stretched] = sums(densities.iter().filter(is_stretched));
    let is_stretched = stretched > MOST_STRETCHED * area;
    let are_alike = |one: f64, other: f64| one.max(other) <= ALIKE * one.min(other);
    let of_one = |density: &Density| if is_stretched { density.mean } else { between(density, mean) };
    let usual: Vec<f64> = densities.iter().map(of_one).collect();
    if usual.iter().all(|&density| are_alike(density, mean)) {
        return Asked { larger: vec![], stretched: is_stretched.then_some(mean) };
    }

    let mut sets: Vec<u32> = (0..triangles.len() as u32).collect();
    let mut open: HashMap<[u32; 2], u32> = HashMap::new();
    for (number, &[a, b, c]) in (0..).zip(triangles) {
        for [p, q] in [[a, b], [b, c], [c, a]] {
            let before = open.insert([p.min(q), p.max(q)], number);
            if let Some(other) = before.filter(|&other| are_alike(usual[number as usize], usual[other as usize])) {
                unite(&mut sets, number, other);
            }
        }
    }
    let sets: Vec<u32> = (0..triangles.len() as u32).map(|triangle| find(&mut sets, triangle)).collect();
    let mut sums: HashMap<u32, [f64; 2]> = HashMap::new();
    for ((set, density), usual) in sets.iter().zip(densities).zip(&usual) {
        let sum = sums.entry(*set).or_default();
        *sum = [sum[0] + usual * density.area, sum[1] + density.area];
    }
    let least = if is_stretched { mean } else { 0.0 };
    let of_set = |set: &u32| {
        let [sum, area] = sums[set];
        // Without an area nothing is shown.
        if area > 0.0 && sum * sum >= FEW * area { (sum / area).max(least).min(MOST * mean) } else { mean }
    };
    let of_sets: Vec<f64> = sets.iter().map(of_set).collect();
    let finest = of_sets.iter().copied().fold(0.0, f64::max);
    let larger: Vec<u8> = of_sets.iter().map(|&density| larger(finest / density / SPARE)).collect();
    let squares: f64 = of_sets.iter().zip(densities).map(|(set, density)| set * set * density.area).sum();
    Asked {
        larger: if larger.iter().all(|&larger| larger == 0) { vec![] } else { larger },
        stretched: is_stretched.then_some((squares / area).sqrt()),
    }
}

/// The density that a triangle asks for: as near to the usual one as lies between that of its directions.
fn between(density: &Density, usual: f64) -> f64 {
    usual.max(density.mean).min(density.most.max(density.mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A strip of triangles.
    fn strip(densities: &[[f64; 2]]) -> (Vec<[u32; 3]>, Vec<Density>) {
        let triangles = (0..densities.len() as u32).map(|number| [number, number + 1, number + 2]).collect();
        (triangles, densities.iter().map(|&[mean, most]| Density { mean, most, area: 100.0 }).collect())
    }

    fn larger_of(densities: &[[f64; 2]]) -> Vec<u8> {
        let (triangles, densities) = strip(densities);
        asked_by_images(&triangles, &densities).larger
    }

    #[test]
    fn a_label_has_finer_texels_than_what_is_around_it() {
        let (around, label) = ([2.0; 2], [10.0; 2]);
        assert_eq!(larger_of(&[around, around, label, label, around]), [4, 4, 0, 0, 4]);
        // A factor of two is little.
        assert!(larger_of(&[around, around, [4.0; 2], around]).is_empty());
    }

    #[test]
    fn a_photograph_that_is_stretched_has_texels_of_one_size() {
        assert!(larger_of(&[[2.0; 2], [2.8; 2], [4.0; 2], [5.6; 2], [8.0; 2], [10.0; 2]]).is_empty());
    }

    #[test]
    fn walls_in_a_picture_from_above_have_long_texels() {
        let (ground, wall) = ([2.0; 2], [0.0, 9.0]);
        let asked = |densities: &[[f64; 2]]| {
            let (triangles, densities) = strip(densities);
            asked_by_images(&triangles, &densities)
        };
        // As many as the ground in the mean.
        let Asked { larger, stretched } = asked(&[ground, wall, ground, ground]);
        assert!(larger.is_empty() && (1.5..2.1).contains(&stretched.expect("it is stretched")), "{stretched:?}");
        // What has more has as many as it has.
        let Asked { larger, stretched } = asked(&[ground, wall, [10.0; 2], ground]);
        assert_eq!(larger, [2, 2, 0, 2]);
        assert!((5.0..6.0).contains(&stretched.expect("it is stretched")), "{stretched:?}");
        // A single one stays as it is, where others differ.
        let mut many = vec![ground; 30];
        many.extend([wall, [20.0; 2]]);
        let Asked { larger, stretched } = asked(&many);
        assert_eq!((&larger[29..], stretched), (&[6, 6, 0][..], None));
    }

    #[test]
    fn triangles_without_area_or_texels_are_like_others() {
        let (triangles, mut densities) = strip(&[[2.0; 2], [0.0; 2], [16.0; 2], [0.0; 2]]);
        densities[1].area = 0.0;
        let larger = asked_by_images(&triangles, &densities).larger;
        assert_eq!(larger.len(), 4);
        assert_eq!(larger[2], 0);
    }
}
