//! Where the input's images have more texels than elsewhere, as signs and labels do.

use std::collections::HashMap;

use crate::mesh::union_find::{find, unite};
use crate::stage::bake::larger;

/// Triangles side by side whose densities differ by less belong together: a photograph that is stretched over a surface is one.
const ALIKE: f64 = 1.5;
/// What has fewer texels of the input has no size of its own.
const FEW: f64 = 256.0;
/// What has so many times the mean density counts as finest.
const MOST: f64 = 16.0;
/// Texels get larger where they are so many times as fine as they would have to be after that.
const SPARE: f64 = 1.19;
/// An image that has so many times the texels along one direction as it has in the mean of both is stretched.
const STRETCHED: f64 = 2.0;
/// Where more than this share of a surface shows stretched images, as walls do in pictures from above, sizes of texels say little.
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

/// How much larger the texels of each triangle may be than the smallest, as a power of the root of two; nothing if all are alike.
pub(super) fn larger_by_density(triangles: &[[u32; 3]], densities: &[Density]) -> Vec<u8> {
    let is_stretched = |density: &&Density| density.most > STRETCHED * density.mean;
    let ([sum, area], [_, stretched]) = (sums(densities.iter()), sums(densities.iter().filter(is_stretched)));
    let mean = sum / area;
    let are_alike = |one: f64, other: f64| one.max(other) <= ALIKE * one.min(other);
    let usual: Vec<f64> = densities.iter().map(|density| between(density, mean)).collect();
    if stretched > MOST_STRETCHED * area || usual.iter().all(|&density| are_alike(density, mean)) {
        return vec![];
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
    let of_set = |set: &u32| {
        let [sum, area] = sums[set];
        // Without an area nothing is shown.
        if area > 0.0 && sum * sum >= FEW * area { (sum / area).min(MOST * mean) } else { mean }
    };
    let of_sets: Vec<f64> = sets.iter().map(of_set).collect();
    let finest = of_sets.iter().copied().fold(0.0, f64::max);
    let all: Vec<u8> = of_sets.iter().map(|&density| larger(finest / density / SPARE)).collect();
    if all.iter().all(|&larger| larger == 0) { vec![] } else { all }
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
        larger_by_density(&triangles, &densities)
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
    fn walls_in_a_picture_from_above_ask_for_no_size() {
        let (ground, wall) = ([2.0; 2], [0.0, 9.0]);
        assert!(larger_of(&[ground, wall, [10.0; 2], ground]).is_empty());
        // A single one stays as it is, where others differ.
        let mut many = vec![ground; 30];
        many.extend([wall, [20.0; 2]]);
        let larger = larger_of(&many);
        assert_eq!(larger[29..], [6, 6, 0]);
    }

    #[test]
    fn triangles_without_area_or_texels_are_like_others() {
        let (triangles, mut densities) = strip(&[[2.0; 2], [0.0; 2], [16.0; 2], [0.0; 2]]);
        densities[1].area = 0.0;
        let larger = larger_by_density(&triangles, &densities);
        assert_eq!(larger.len(), 4);
        assert_eq!(larger[2], 0);
    }
}
