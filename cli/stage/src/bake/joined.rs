//! Joins pieces: while they grew, each took what fits it and left the rest to others, in parts of a triangle or two.
//! The borders of such parts take texels, which must show the same as those on the other side.

use glam::DVec3;

use super::BakedPatch;
use super::pieces::{Pieces, direction_of};
use super::triangles::{STEEP, Triangles};
use crate::areas::Areas;

/// The most passes over all triangles.
const MAX_ROUNDS: usize = 8;
/// The same for all triangles of a piece that goes to another one as a whole. With .4 `valve-index` loses .4 dB.
const FLAT: f64 = 0.5;
/// A border must get shorter by this share of a triangle's circumference.
const LEAST_GAIN: f64 = 0.01;

impl Pieces {
    /// Makes borders shorter: triangles, and pieces as a whole, go to those beside them that they fit as well.
    pub fn join(&mut self, patch: &BakedPatch<'_>, triangles: &Triangles) {
        let mut areas = patch.areas.map(|areas| AreasOfPieces::new(areas, self));
        self.join_triangles(patch, triangles, &mut areas);
        self.join_pieces(patch, triangles, &mut areas);
        self.join_triangles(patch, triangles, &mut areas);
    }

    fn join_triangles(&mut self, patch: &BakedPatch<'_>, triangles: &Triangles, areas: &mut Option<AreasOfPieces<'_>>) {
        let directions: Vec<DVec3> = self.shapes.iter().map(direction_of).collect();
        for _ in 0..MAX_ROUNDS {
            let mut has_changed = false;
            for (triangle, beside) in (0..).zip(&triangles.neighbours) {
                let own = self.labels[triangle as usize];
                let labels = beside.map(|other| self.labels.get(other as usize).copied());
                if labels.iter().flatten().all(|&label| label == own) {
                    continue;
                }
                let lengths = lengths(patch, triangle);
                let shared = |piece| (0..3).filter(|&k| labels[k] == Some(piece)).map(|k| lengths[k]).sum::<f64>();
                let least = shared(own) + LEAST_GAIN * lengths.iter().sum::<f64>();
                let fits = |&piece: &u16| {
                    piece != own
                        && shared(piece) > least
                        && self.larger_of(piece) == self.larger_of(own)
                        && triangles.leans(triangle, directions[usize::from(piece)], STEEP)
                        && self.fits_texels_of(triangle, piece, directions[usize::from(piece)])
                        && areas.as_ref().is_none_or(|areas| areas.fits(triangle, piece))
                };
                let fitting = labels.into_iter().flatten().filter(fits);
                if let Some(best) = fitting.max_by(|&a, &b| shared(a).total_cmp(&shared(b))) {
                    self.labels[triangle as usize] = best;
                    areas.iter_mut().for_each(|areas| areas.add(triangle, best));
                    has_changed = true;
                }
            }
            if !has_changed {
                break;
            }
        }
    }

    /// Whole pieces, the smallest first.
    fn join_pieces(&mut self, patch: &BakedPatch<'_>, triangles: &Triangles, areas: &mut Option<AreasOfPieces<'_>>) {
        let mut members: Vec<Vec<u32>> = vec![vec![]; self.shapes.len()];
        for (triangle, &piece) in (0..).zip(&self.labels) {
            members[usize::from(piece)].push(triangle);
        }
        let size = |members: &Vec<u32>| members.iter().map(|&t| triangles.areas[t as usize].length()).sum::<f64>();
        let sizes: Vec<f64> = members.iter().map(size).collect();
        let mut order: Vec<usize> = (0..members.len()).collect();
        order.sort_by(|&a, &b| sizes[a].total_cmp(&sizes[b]));
        for piece in order {
            let own = std::mem::take(&mut members[piece]);
            let fits = |&other: &u16| {
                let direction = direction_of(&self.shapes[usize::from(other)]);
                self.larger_of(other) == self.larger_of(piece as u16)
                    && own.iter().all(|&triangle| triangles.leans(triangle, direction, FLAT))
                    && own.iter().all(|&triangle| self.fits_texels_of(triangle, other, direction))
                    && areas.as_ref().is_none_or(|areas| own.iter().all(|&triangle| areas.fits(triangle, other)))
            };
            let best = self.beside(&own, patch, triangles).into_iter().find(fits).unwrap_or(piece as u16);
            if usize::from(best) != piece {
                for &triangle in &own {
                    self.labels[triangle as usize] = best;
                    areas.iter_mut().for_each(|areas| areas.add(triangle, best));
                }
            }
            members[usize::from(best)].extend(own);
        }
    }

    /// The pieces beside triangles of one, that with the longest border in common first.
    fn beside(&self, own: &[u32], patch: &BakedPatch<'_>, triangles: &Triangles) -> Vec<u16> {
        let mut borders: Vec<(u16, f64)> = vec![];
        for &triangle in own {
            let this = self.labels[triangle as usize];
            let labels = triangles.neighbours[triangle as usize].map(|other| self.labels.get(other as usize).copied());
            if labels.iter().flatten().any(|&label| label != this) {
                let pairs = labels.into_iter().zip(lengths(patch, triangle));
                borders
                    .extend(pairs.filter_map(|(label, length)| Some((label.filter(|&label| label != this)?, length))));
            }
        }
        borders.sort_by_key(|&(label, _)| label);
        let of_piece = |run: &[(u16, f64)]| (run[0].0, run.iter().map(|(_, length)| length).sum::<f64>());
        let mut all: Vec<(u16, f64)> = borders.chunk_by(|a, b| a.0 == b.0).map(of_piece).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        all.into_iter().map(|(label, _)| label).collect()
    }

    /// Gives each part of a piece that no edge joins with the rest a piece of its own: where one of two sheets ends
    /// before the other, as seen along the axis, both would have texels in common.
    pub fn divide_apart(&mut self, triangles: &Triangles) {
        let (mut is_known, mut is_found) = (vec![false; self.shapes.len()], vec![false; self.labels.len()]);
        let mut open = vec![];
        for seed in 0..self.labels.len() {
            if std::mem::replace(&mut is_found[seed], true) {
                continue;
            }
            let before = self.labels[seed];
            let mut piece = before;
            let has_part = std::mem::replace(&mut is_known[usize::from(before)], true);
            // Beyond this number, parts stay together.
            if has_part && self.shapes.len() + 1 < usize::from(u16::MAX) {
                piece = self.shapes.len() as u16;
                self.add_like(before);
                is_known.push(true);
            }
            open.push(seed as u32);
            while let Some(triangle) = open.pop() {
                self.labels[triangle as usize] = piece;
                for &next in &triangles.neighbours[triangle as usize] {
                    let is_part = self.labels.get(next as usize) == Some(&before);
                    if is_part && !std::mem::replace(&mut is_found[next as usize], true) {
                        open.push(next);
                    }
                }
            }
        }
    }
}

/// How long the sides of a triangle are.
fn lengths(patch: &BakedPatch<'_>, triangle: u32) -> [f64; 3] {
    let [a, b, c] = patch.triangles[triangle as usize].map(|corner| patch.position(corner));
    [a.distance(b), b.distance(c), c.distance(a)]
}

/// The areas of the triangles of each piece: no colours jump between two of them.
struct AreasOfPieces<'a> {
    areas: Areas<'a>,
    of_pieces: Vec<Vec<u32>>,
}

impl<'a> AreasOfPieces<'a> {
    fn new(areas: Areas<'a>, pieces: &Pieces) -> Self {
        let mut result = Self { areas, of_pieces: vec![vec![]; pieces.shapes.len()] };
        (0..).zip(&pieces.labels).for_each(|(triangle, &piece)| result.add(triangle, piece));
        result
    }

    fn add(&mut self, triangle: u32, piece: u16) {
        let (area, own) = (self.areas.of_triangles[triangle as usize], &mut self.of_pieces[usize::from(piece)]);
        if !own.contains(&area) {
            own.push(area);
        }
    }

    fn fits(&self, triangle: u32, piece: u16) -> bool {
        let this = self.areas.of_triangles[triangle as usize];
        self.of_pieces[usize::from(piece)].iter().all(|&area| !self.areas.jumps.are_between(area, this))
    }
}

#[cfg(test)]
mod tests {
    use lodpack::{LatticePoint, write::PieceShape};

    use super::*;
    use crate::areas::Jumps;

    const UP: PieceShape = PieceShape { axis: [0, 0, 31], larger: 0, long: None };
    const ASIDE: PieceShape = PieceShape { axis: [31, 0, 0], larger: 0, long: None };

    /// Squares in a row, of two triangles each, that lead up a slope.
    fn slope(count: i64) -> (Vec<LatticePoint>, Vec<[u32; 3]>) {
        let positions = (0..=count).flat_map(|k| [[16 * k, 0, 4 * k], [16 * k, 16, 4 * k]]).collect();
        let of_square = |k: u32| [[2 * k, 2 * k + 2, 2 * k + 1], [2 * k + 1, 2 * k + 2, 2 * k + 3]];
        (positions, (0..count as u32).flat_map(of_square).collect())
    }

    /// Labels after something is done to pieces, and how many pieces there are.
    fn after(
        shapes: &[PieceShape],
        labels: &[u16],
        areas: Option<Areas<'_>>,
        change: impl Fn(&mut Pieces, &BakedPatch<'_>, &Triangles),
    ) -> (Vec<u16>, usize) {
        let (positions, triangles) = slope(labels.len() as i64 / 2);
        let patch =
            BakedPatch { positions: &positions, triangles: &triangles, reach: 1.0, areas, finer: 0, is_sharp: false };
        let mut pieces = Pieces::default();
        pieces.shapes = shapes.to_vec();
        pieces.labels = labels.to_vec();
        change(&mut pieces, &patch, &Triangles::new(&patch));
        (pieces.labels, pieces.shapes.len())
    }

    #[test]
    fn what_lies_within_a_piece_goes_to_it() {
        let joined = |labels: &[u16], areas: Option<Areas<'_>>| after(&[UP; 3], labels, areas, Pieces::join).0;
        assert_eq!(joined(&[0, 0, 0, 1, 0, 0, 0, 0], None), [0; 8]);
        // Pieces as a whole, the smallest first.
        assert_eq!(joined(&[0, 0, 1, 1, 1, 1, 2, 2], None), [1; 8]);
        // But no two between which colours jump.
        let (of_triangles, jumps) = ([0, 0, 5, 5, 0, 0], Jumps::new(vec![[0, 5]]));
        let areas = Some(Areas { of_triangles: &of_triangles, jumps: &jumps });
        assert_eq!(joined(&[0, 0, 1, 1, 0, 0], areas), [0, 0, 1, 1, 0, 0]);
    }

    #[test]
    fn what_is_too_steep_for_a_piece_does_not_go_to_it() {
        let joined = |shapes: [PieceShape; 2]| after(&shapes, &[0, 0, 0, 1, 0, 0], None, Pieces::join).0;
        assert_eq!(joined([ASIDE, UP]), [1; 6]);
        assert_eq!(joined([UP, ASIDE]), [0; 6]);
        let larger = PieceShape { larger: 1, ..UP };
        assert_eq!(joined([UP, larger]), [0, 0, 0, 1, 0, 0]);
    }

    #[test]
    fn parts_that_are_apart_are_pieces_of_their_own() {
        let (labels, count) = after(&[UP, ASIDE], &[0, 0, 1, 1, 0, 0, 1, 1, 0, 0], None, |pieces, _, triangles| {
            pieces.divide_apart(triangles)
        });
        assert_eq!((labels, count), (vec![0, 0, 1, 1, 2, 2, 3, 3, 4, 4], 5));
    }
}
