//! Values for texels that nothing was found for: those beside the patch, and those that no sample of the source fell on.

use std::collections::HashMap;

use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::lanes::set;
use super::projection::projections;
use super::raster::{Drawn, texel_at};
use super::values::{Kept, Sums};

/// How many pieces values pass through at most until they come to one without any.
const MAX_ROUNDS: usize = 16;

/// The means of all texels that are used, and those of their neighbours where nothing was found.
///
/// Neighbours are those in the same piece, since beside its rectangle lies that of another piece, which shows something else. A piece for which
/// nothing at all was found takes what the pieces beside it show at the vertices that both have.
pub(super) fn finished(mut sums: Sums<'_>, patch: &BakedPatch<'_>, map: &Map, drawn: &Drawn) -> Kept {
    sums.divide();
    let (stride, labels) = (sums.stride(), sums.labels());
    let Kept { sums: values, known } = sums.kept;
    let mut filling = Filling { map, is_used: &drawn.is_used, known, stride, labels, values };
    let mut rounds = 0;
    while !filling.fill_pieces() && rounds < MAX_ROUNDS && filling.cross(patch) {
        rounds += 1;
    }
    filling.fill_rest();
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

    /// Gives texels that are left the mean of everything.
    fn fill_rest(&mut self) {
        let open: Vec<usize> = (0..self.known.len()).filter(|&t| self.is_used[t] && !self.known[t]).collect();
        let mut mean = vec![];
        if !open.is_empty() && self.add_mean(0..self.known.len(), &mut mean) {
            open.into_iter().for_each(|texel| self.set(texel, &mean));
        }
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
