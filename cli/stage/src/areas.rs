//! Areas of a surface between which its colours jump: simplify keeps the edges between them, and bake puts nothing of
//! one into the image of another.

use std::collections::{BTreeMap, BTreeSet};

use lodpack_mesh::NONE;
use lodpack_mesh::union_find::find;

/// The square of the difference between two ways to draw: no colours differ more.
pub const OF_DRAWINGS: f64 = 255.0 * 255.0;
/// How far from an edge colours are compared, in texels: on it, images show some of what lies beside their charts or
/// pieces.
pub const INWARDS: f64 = 0.5;
/// And at most this share of the triangle.
pub const MOST_INWARDS: f64 = 0.3;

/// Two areas, the smaller number first.
pub type Pair = [u32; 2];

/// By how much the colours of pairs of areas differ where they meet: the sum of squares by length, and the length.
#[derive(Debug, Default)]
pub struct Differences(BTreeMap<Pair, [f64; 2]>);

impl Differences {
    /// Adds an edge between two areas. `square` is the mean square of the difference over the components.
    pub fn add(&mut self, [one, other]: [u32; 2], square: f64, length: f64) {
        let sum = self.0.entry([one.min(other), one.max(other)]).or_default();
        *sum = [sum[0] + square * length, sum[1] + length];
    }

    /// The pairs that differ by more than `least`, and the others with their mean square; both ascending.
    pub fn divided(self, least: f64) -> (Vec<Pair>, Vec<(Pair, f64)>) {
        let (mut lines, mut alike) = (vec![], vec![]);
        for (pair, [sum, length]) in self.0 {
            if sum > least * least * length {
                lines.push(pair);
            } else {
                alike.push((pair, if length > 0.0 { sum / length } else { 0.0 }));
            }
        }
        (lines, alike)
    }
}

/// Which areas show different colours where they meet.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Jumps {
    /// Pairs of areas, the smaller number first, ascending.
    pairs: Vec<[u32; 2]>,
}

impl Jumps {
    /// Of pairs of areas.
    pub fn new(mut pairs: Vec<[u32; 2]>) -> Self {
        pairs.iter_mut().for_each(|pair| pair.sort_unstable());
        pairs.sort_unstable();
        pairs.dedup();
        Self { pairs }
    }

    /// Whether colours jump between two areas. [`NONE`] is no area.
    pub fn are_between(&self, a: u32, b: u32) -> bool {
        a != b && a != NONE && b != NONE && self.pairs.binary_search(&[a.min(b), a.max(b)]).is_ok()
    }
}

/// The areas of some triangles.
#[derive(Clone, Copy, Debug)]
pub struct Areas<'a> {
    /// By triangle; [`NONE`] for none.
    pub of_triangles: &'a [u32],
    /// Where colours jump.
    pub jumps: &'a Jumps,
}

impl<'a> Areas<'a> {
    /// None where nothing is known of the triangles.
    pub fn of(of_triangles: &'a [u32], jumps: Option<&'a Jumps>) -> Option<Self> {
        jumps.filter(|_| !of_triangles.is_empty()).map(|jumps| Self { of_triangles, jumps })
    }

    /// Whether there are two triangles between which colours jump, side by side or not.
    pub fn have_jumps(&self) -> bool {
        let mut all: Vec<u32> = self.of_triangles.to_vec();
        all.sort_unstable();
        all.dedup();
        (1..all.len()).any(|i| all[..i].iter().any(|&other| self.jumps.are_between(all[i], other)))
    }

    /// Whether colours jump between two triangles.
    pub fn jump(&self, one: usize, other: usize) -> bool {
        self.jumps.are_between(self.of_triangles[one], self.of_triangles[other])
    }
}

/// The areas of a whole mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColourAreas {
    /// By triangle; [`NONE`] for none.
    pub of_triangles: Vec<u32>,
    /// Where colours jump.
    pub jumps: Jumps,
    /// The areas of which all vertices have one colour.
    pub parts: BTreeSet<u32>,
    /// If all triangles belong to areas that show one thing each, in all channels, a triangle of each of these;
    /// otherwise empty.
    pub looks: BTreeMap<u32, u32>,
}

impl ColourAreas {
    /// Areas that are sets of triangles, by pairs between which colours jump; triangles of other sets are in none.
    /// `sets` are those of
    /// [`lodpack_mesh::union_find`], one entry for each triangle.
    pub fn of_sets(sets: &mut [u32], pairs: Vec<[u32; 2]>) -> Self {
        let known: BTreeSet<u32> = pairs.iter().flatten().copied().collect();
        let count = sets.len() as u32;
        let area = |triangle| Some(find(sets, triangle)).filter(|set| known.contains(set)).unwrap_or(NONE);
        let of_triangles = (0..count).map(area).collect();
        Self { of_triangles, jumps: Jumps::new(pairs), ..Self::default() }
    }

    /// Of looks that are all there is: the first triangle that looks like each triangle, and pairs of these between
    /// which colours jump.
    pub fn of_looks(of_triangles: Vec<u32>, pairs: Vec<[u32; 2]>) -> Self {
        let looks = of_triangles.iter().map(|&look| (look, look)).collect();
        Self { of_triangles, jumps: Jumps::new(pairs), looks, ..Self::default() }
    }

    /// Whether a triangle belongs to an area of which all vertices have one colour.
    pub fn are_part(&self, triangle: usize) -> bool {
        self.of_triangles.get(triangle).is_some_and(|area| self.parts.contains(area))
    }

    /// All of them.
    pub fn all(&self) -> Areas<'_> {
        Areas { of_triangles: &self.of_triangles, jumps: &self.jumps }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_jump_between_areas_of_a_pair_alone() {
        let jumps = Jumps::new(vec![[7, 2], [2, 3], [3, 2]]);
        assert!(jumps.are_between(2, 7) && jumps.are_between(7, 2) && jumps.are_between(3, 2));
        assert!(!jumps.are_between(3, 7) && !jumps.are_between(2, 2) && !jumps.are_between(2, NONE));
        assert!(Areas::of(&[], Some(&jumps)).is_none() && Areas::of(&[2], None).is_none());
        assert!(Areas::of(&[2, 7, NONE], Some(&jumps)).is_some_and(|areas| areas.jump(0, 1) && !areas.jump(1, 2)));
        let have = |areas: &[u32]| Areas::of(areas, Some(&jumps)).is_some_and(|areas| areas.have_jumps());
        assert!(have(&[3, NONE, 3, 2]) && !have(&[3, 7, 7, 3, NONE]));
    }
}
