//! Areas of a surface between which its colours jump: simplify keeps the edges between them, and bake puts nothing of one into the image of
//! another.

use crate::mesh::NONE;

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
}

impl ColourAreas {
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
