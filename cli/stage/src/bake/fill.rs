//! Values for texels that nothing was found for: those beside the patch, and those that no sample of the source fell
//! on.

use std::collections::HashMap;

use glam::DVec3;
use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::lanes::set;
use super::projection::projections;
use super::raster::{Drawn, texel_at};
use super::values::{Kept, Sums};
use crate::certify::{Hint, TriangleBvh};

/// The most pieces through which values pass until they come to one without any.
const MAX_ROUNDS: usize = 16;

/// The means of all texels that are used, and those of their neighbours where nothing was found.
///
/// Neighbours are those in the same piece, since beside its rectangle lies that of another piece, which shows something
/// else. A piece for which nothing at all was found takes what the pieces beside it show at the vertices that both
/// have, and where there are none what the closest piece does. So do texels that have values but lack a number, where
/// nothing was measured.
pub(super) fn finished(mut sums: Sums<'_>, patch: &BakedPatch<'_>, map: &Map, drawn: &Drawn) -> Kept {
    sums.divide();
    let (stride, labels, numbers) = (sums.stride(), sums.labels(), sums.storage.numbers());
    let Kept { sums: values, known } = sums.kept;
    let mut filling = Filling { map, is_used: &drawn.is_used, known, stride, labels, values };
    filling.fill(patch, drawn);
    for number in numbers {
        filling.fill_number(number, patch, drawn);
    }
    Kept { sums: filling.values, known: filling.known }
}

struct Filling<'a> {
    map: &'a Map,
    is_used: &'a [bool],
    /// Whether a texel has values.
    known: Vec<bool>,
    /// Numbers of a texel: its values, and weights that count no more.
    stride: usize,
    /// Where labels lie among them.
    labels: Vec<usize>,
    values: Vec<f32>,
}

impl Filling<'_> {
    /// Gives all texels that are used values, if anything is known.
    fn fill(&mut self, patch: &BakedPatch<'_>, drawn: &Drawn) {
        let mut is_complete = self.fill_pieces();
        for _ in 0..MAX_ROUNDS {
            if is_complete || !self.cross(patch) {
                break;
            }
            is_complete = self.fill_pieces();
        }
        if !is_complete {
            self.fill_rest(patch, drawn);
        }
    }

    /// Gives texels that lack a number one.
    fn fill_number(&mut self, number: usize, patch: &BakedPatch<'_>, drawn: &Drawn) {
        let values: Vec<f32> = self.values.iter().skip(number).step_by(self.stride).copied().collect();
        let known: Vec<bool> = values.iter().zip(&self.known).map(|(value, known)| *known && !value.is_nan()).collect();
        if known == self.known {
            return;
        }
        let labels = if self.labels.contains(&number) { vec![0] } else { vec![] };
        let mut alone = Filling { map: self.map, is_used: self.is_used, known, stride: 1, labels, values };
        alone.fill(patch, drawn);
        let all = self.values.iter_mut().skip(number).step_by(self.stride);
        all.zip(alone.values).for_each(|(value, filled)| *value = filled);
    }

    /// Gives texels the mean of their neighbours in the piece, ring by ring. Says whether all texels have values now.
    fn fill_pieces(&mut self) -> bool {
        let width = self.map.size[0] as usize;
        let (mut means, mut is_open, mut is_complete) = (vec![], vec![], true);
        for piece in &self.map.pieces {
            let [[left, top], [right, bottom]] = piece.range().map(|corner| corner.map(|x| x as usize));
            let mut open: Vec<usize> = vec![];
            for first in (top..=bottom).map(|y| y * width + left) {
                let row = first..first + right - left + 1;
                is_open.clear();
                is_open
                    .extend(self.is_used[row.clone()].iter().zip(&self.known[row]).map(|(used, known)| used & !known));
                open.extend(set(&is_open).map(|x| first + x));
            }
            while !open.is_empty() {
                let mut found = vec![];
                for &texel in &open {
                    let (x, y) = (texel % width, texel / width);
                    let columns = x.saturating_sub(1).max(left)..=(x + 1).min(right);
                    let rows = y.saturating_sub(1).max(top)..=(y + 1).min(bottom);
                    if self.add_mean(rows.flat_map(|y| columns.clone().map(move |x| y * width + x)), &mut means) {
                        found.push(texel);
                    }
                }
                if found.is_empty() {
                    break;
                }
                for (number, &texel) in found.iter().enumerate() {
                    self.set(texel, &means[number * self.stride..][..self.stride]);
                }
                means.clear();
                open.retain(|&texel| !self.known[texel]);
            }
            is_complete &= open.is_empty();
        }
        is_complete
    }

    /// Gives texels of vertices the values that another piece has at the vertex. Says whether there were any.
    fn cross(&mut self, patch: &BakedPatch<'_>) -> bool {
        let projections = projections(patch, self.map);
        let (mut known, mut open): (HashMap<u32, usize>, _) = (HashMap::new(), vec![]);
        for (corners, &label) in patch.triangles.iter().zip(&self.map.labels) {
            for &corner in corners {
                let place = projections[usize::from(label)].place(patch.position(corner));
                let [column, row] = texel_at(place, self.map.size);
                let texel = row as usize * self.map.size[0] as usize + column as usize;
                if self.known[texel] {
                    known.entry(corner).or_insert(texel);
                } else {
                    open.push((corner, texel));
                }
            }
        }
        let mut is_any = false;
        for (corner, texel) in open {
            if let Some(&from) = known.get(&corner) {
                let values = self.values[from * self.stride..][..self.stride].to_vec();
                self.set(texel, &values);
                is_any = true;
            }
        }
        is_any
    }

    /// Gives pieces that are left what the patch shows where it is closest to them.
    fn fill_rest(&mut self, patch: &BakedPatch<'_>, drawn: &Drawn) {
        let (width, projections) = (self.map.size[0] as usize, projections(patch, self.map));
        let is_open = |texel: &usize| drawn.is_used[*texel] && !self.known[*texel];
        let open: Vec<Vec<usize>> =
            projections.iter().map(|piece| piece.texels(width).filter(is_open).collect()).collect();
        let positions: Vec<DVec3> = (0..patch.positions.len() as u32).map(|vertex| patch.position(vertex)).collect();
        let of_patch = patch.triangles.iter().zip(self.map.labels.iter().map(|&label| usize::from(label)));
        let (triangles, pieces): (Vec<[u32; 3]>, Vec<usize>) =
            of_patch.filter(|(_, piece)| open[*piece].is_empty()).unzip();
        let (bvh, mut hint) = (TriangleBvh::new(&positions, &triangles), Hint::default());
        for (projection, texels) in projections.iter().zip(&open) {
            for &texel in texels.iter().filter(|&&texel| drawn.depth[texel].is_finite()) {
                let place = [texel % width, texel / width].map(|x| x as f64 + 0.5);
                let closest = bvh.closest(projection.point(place, f64::from(drawn.depth[texel])), &mut hint);
                let Some(&piece) = pieces.get(closest.triangle as usize) else { return };
                let [column, row] = texel_at(projections[piece].place(closest.point), self.map.size);
                let from = row as usize * width + column as usize;
                let values = self.values[from * self.stride..][..self.stride].to_vec();
                self.set(texel, &values);
            }
        }
        // Those beside these have no place on the patch.
        self.fill_pieces();
    }

    /// Appends the mean of those texels that have values, and the labels of the first one. Says whether there are any.
    fn add_mean(&self, texels: impl Iterator<Item = usize>, means: &mut Vec<f32>) -> bool {
        if let (4, []) = (self.stride, &self.labels[..]) {
            // As most texels are: four numbers are handled at once.
            let all = self.values.as_chunks::<4>().0;
            let add = |sum: [f32; 4], number: usize| std::array::from_fn(|k| sum[k] + all[number][k]);
            let (sum, known) = texels
                .filter(|&texel| self.known[texel])
                .fold(([0.0; 4], 0.0), |(sum, known), texel| (add(sum, texel), known + 1.0));
            if known > 0.0 {
                means.extend(sum.map(|sum| sum / known));
            }
            return known > 0.0;
        }
        let (first, mut known, mut one) = (means.len(), 0.0, None);
        means.resize(first + self.stride, 0.0);
        for texel in texels.filter(|&texel| self.known[texel]) {
            let values = &self.values[texel * self.stride..][..self.stride];
            means[first..].iter_mut().zip(values).for_each(|(sum, &value)| *sum += value);
            known += 1.0;
            one = one.or(Some(texel));
        }
        let Some(one) = one else {
            means.truncate(first);
            return false;
        };
        means[first..].iter_mut().for_each(|sum| *sum /= known);
        self.labels.iter().for_each(|&label| means[first + label] = self.values[one * self.stride + label]);
        true
    }

    fn set(&mut self, texel: usize, values: &[f32]) {
        self.values[texel * self.stride..][..self.stride].copy_from_slice(values);
        self.known[texel] = true;
    }
}
