//! Divides a patch into pieces that are nearly flat.

use std::collections::BinaryHeap;

use glam::DVec3;
use lodpack::decode::texels::Map;
use lodpack::write::PieceShape;

use super::BakedPatch;
use super::long::Growth;
use super::sizes::{Sizes, area_of_texel};
use super::triangles::{STEEP, Triangles};
use crate::areas::Areas;
use lodpack_mesh::NONE;

/// Cosine of the angle by which a triangle may be inclined to the mean of its piece while the piece grows.
const FLAT: f64 = 0.7;
/// Length of the longest coordinate of an axis.
const AXIS_LENGTH: f64 = 31.0;

/// The pieces of a patch.
#[derive(Clone, Debug, Default)]
pub(super) struct Pieces {
    pub shapes: Vec<PieceShape>,
    /// The piece of each triangle.
    pub labels: Vec<u16>,
    sizes: Sizes,
    /// What the first triangle of each piece shows, if texels may be longer than wide.
    growths: Vec<Growth>,
}

/// A triangle that waits to be added to a piece.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Candidate {
    /// How well it fits.
    cosine: f64,
    triangle: u32,
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.cosine.total_cmp(&other.cosine).then(other.triangle.cmp(&self.triangle))
    }
}

/// The axis nearest to a direction.
fn axis_of(direction: DVec3) -> [i8; 3] {
    let longest = direction.abs().max_element();
    if longest <= 0.0 || longest.is_nan() {
        return [0, 0, 1];
    }
    (direction * (AXIS_LENGTH / longest)).to_array().map(|x| x.round() as i8)
}

/// The direction of a piece's axis.
pub(super) fn direction_of(shape: &PieceShape) -> DVec3 {
    DVec3::from(shape.axis.map(f64::from)).normalize_or_zero()
}

/// Divides a patch: a piece grows from the largest triangle that is left, over neighbours that are inclined like it. It
/// never has areas between which colours jump, nor texels of several sizes.
pub(super) fn divide(patch: &BakedPatch<'_>, sizes: Sizes) -> Pieces {
    let all: Vec<u32> = (0..patch.triangles.len() as u32).collect();
    let mut pieces = Pieces { shapes: vec![], labels: vec![u16::MAX; patch.triangles.len()], sizes, growths: vec![] };
    let triangles = Triangles::new(patch);
    pieces.grow(&all, patch, &triangles);
    pieces.join(patch, &triangles);
    pieces.divide_apart(&triangles);
    pieces.remove_empty();
    pieces.lengthen(&triangles);
    pieces
}

impl Pieces {
    /// Gives triangles new pieces of their own.
    pub fn separate(&mut self, hidden: &[u32], patch: &BakedPatch<'_>) {
        hidden.iter().for_each(|&triangle| self.labels[triangle as usize] = u16::MAX);
        let triangles = Triangles::new(patch);
        self.grow(hidden, patch, &triangles);
        self.divide_apart(&triangles);
        self.remove_empty();
        self.lengthen(&triangles);
    }

    fn grow(&mut self, seeds: &[u32], patch: &BakedPatch<'_>, triangles: &Triangles) {
        let areas = &triangles.areas;
        let mut seeds = seeds.to_vec();
        seeds.sort_by(|&a, &b| {
            let [x, y] = [a, b].map(|t| areas[t as usize].length_squared());
            y.total_cmp(&x).then(a.cmp(&b))
        });
        // A triangle that was given away once starts a piece or stays: so this ends.
        let mut again = vec![];
        for only_once in [false, true] {
            let of_pass = if only_once { std::mem::take(&mut again) } else { seeds.clone() };
            for seed in of_pass {
                if self.labels[seed as usize] != u16::MAX {
                    continue;
                }
                // Beyond this number, everything goes to the last piece.
                if self.shapes.len() + 1 >= usize::from(u16::MAX) {
                    self.labels[seed as usize] = self.shapes.len() as u16 - 1;
                    continue;
                }
                let piece = self.shapes.len() as u16;
                let (members, sum) = self.grow_piece(seed, piece, triangles, patch.areas);
                let axis = axis_of(sum);
                let shape = PieceShape { axis, larger: self.larger(seed), long: None };
                let direction = direction_of(&shape);
                for &member in members.iter().filter(|&&member| member != seed && !only_once) {
                    if !triangles.leans(member, direction, STEEP) {
                        self.labels[member as usize] = u16::MAX;
                        again.push(member);
                    }
                }
                self.shapes.push(shape);
                self.growths.extend(self.sizes.growths.get(seed as usize));
            }
        }
    }

    fn grow_piece(
        &mut self,
        seed: u32,
        piece: u16,
        Triangles { areas, neighbours }: &Triangles,
        colours: Option<Areas<'_>>,
    ) -> (Vec<u32>, DVec3) {
        let (mut sum, mut members) = (DVec3::ZERO, vec![]);
        // The areas of its triangles.
        let mut own: Vec<u32> = vec![];
        let mut open = BinaryHeap::from([Candidate { cosine: 1.0, triangle: seed }]);
        while let Some(Candidate { triangle, .. }) = open.pop() {
            if self.labels[triangle as usize] != u16::MAX {
                continue;
            }
            let area = areas[triangle as usize];
            let cosine = |area: DVec3, sum: DVec3| {
                let lengths = area.length() * sum.length();
                if lengths > 0.0 { area.dot(sum) / lengths } else { 1.0 }
            };
            let is_alike = || self.fits(triangle, self.sizes.growths.get(seed as usize), sum);
            if cosine(area, sum) < FLAT || self.larger(triangle) != self.larger(seed) || !is_alike() {
                continue;
            }
            if let Some(colours) = colours {
                let this = colours.of_triangles[triangle as usize];
                if own.iter().any(|&area| colours.jumps.are_between(area, this)) {
                    continue;
                }
                if !own.contains(&this) {
                    own.push(this);
                }
            }
            self.labels[triangle as usize] = piece;
            members.push(triangle);
            sum += area;
            for &next in neighbours[triangle as usize].iter().filter(|&&next| next != NONE) {
                if self.labels[next as usize] == u16::MAX {
                    open.push(Candidate { cosine: cosine(areas[next as usize], sum), triangle: next });
                }
            }
        }
        (members, sum)
    }

    /// Whether texels of one shape show a triangle and a piece, which is projected along a direction.
    pub fn fits_texels_of(&self, triangle: u32, piece: u16, direction: DVec3) -> bool {
        self.fits(triangle, self.growths.get(usize::from(piece)), direction)
    }

    /// The same of a piece that began like this.
    fn fits(&self, triangle: u32, of_piece: Option<&Growth>, normal: DVec3) -> bool {
        let of_triangle = self.sizes.growths.get(triangle as usize);
        of_triangle.zip(of_piece).is_none_or(|(one, other)| one.fits(other, normal.normalize_or_zero()))
    }

    /// How much larger the texels of a triangle are than the smallest.
    fn larger(&self, triangle: u32) -> u8 {
        self.sizes.larger.get(triangle as usize).copied().unwrap_or(0)
    }

    /// How much larger those of a piece are.
    pub fn larger_of(&self, piece: u16) -> u8 {
        self.shapes[usize::from(piece)].larger
    }

    /// Gives pieces texels that are longer than wide, where what they show is.
    fn lengthen(&mut self, triangles: &Triangles) {
        if self.sizes.growths.is_empty() {
            return;
        }
        let mut sums = vec![Growth::default(); self.shapes.len()];
        for ((&label, growth), area) in self.labels.iter().zip(&self.sizes.growths).zip(&triangles.areas) {
            sums[usize::from(label)].add(growth, area.length());
        }
        for (shape, sum) in self.shapes.iter_mut().zip(sums) {
            shape.long = sum.long(direction_of(shape));
        }
    }

    /// Of each piece of a map the area of texels that are not longer than wide.
    pub fn usual_areas(&self, map: &Map, exponent: u32) -> Vec<f64> {
        let mut areas = vec![1.0; map.pieces.len()];
        for (&own, &label) in self.labels.iter().zip(&map.labels) {
            areas[usize::from(label)] = area_of_texel(exponent + u32::from(self.larger_of(own)));
        }
        areas
    }

    /// Adds a piece that begins like another one.
    pub fn add_like(&mut self, piece: u16) {
        self.shapes.push(self.shapes[usize::from(piece)]);
        self.growths.extend(self.growths.get(usize::from(piece)).copied());
    }

    /// Renumbers pieces, without those that have no triangle.
    fn remove_empty(&mut self) {
        let mut is_used = vec![false; self.shapes.len()];
        self.labels.iter().for_each(|&label| is_used[usize::from(label)] = true);
        let mut number = 0;
        let numbers: Vec<u16> = is_used
            .iter()
            .map(|&used| {
                number += u16::from(used);
                number.wrapping_sub(1)
            })
            .collect();
        self.labels.iter_mut().for_each(|label| *label = numbers[usize::from(*label)]);
        let mut used = is_used.iter();
        self.shapes.retain(|_| used.next() == Some(&true));
        let mut used = is_used.iter();
        self.growths.retain(|_| used.next() == Some(&true));
    }
}
