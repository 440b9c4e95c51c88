//! Triangles on the texels of a map.

use std::ops::Range;

use glam::Vec3A;
use lodpack::decode::texels::Map;

use super::lanes::set;
use super::projection::projections;
use super::{BakedPatch, Points};
use lodpack_mesh::NONE;

/// A point is moved by no more texels than patches are widened by.
const MAX_STEP: f32 = 1.5;
/// Up to this many columns, looking at each takes less time than finding which of them are inside.
const FEW_COLUMNS: usize = 8;
/// Depths that differ by less than this many texels are those of one sheet.
const SAME_SHEET: f32 = 2.0;

/// A patch as its map shows it.
#[derive(Clone, Debug, Default)]
pub(super) struct Drawn {
    /// For each texel the depth of the patch along the axis of the piece, in texels from the patch's origin; beside the
    /// patch that of the nearest texel of it, as far as images are read there. NaN elsewhere.
    pub depth: Vec<f32>,
    /// How the depth grows along a row and along a column, per texel.
    pub slope: Vec<[f32; 2]>,
    /// Whether the texel's centre lies in a triangle.
    pub is_covered: Vec<bool>,
    /// Whether a reader may interpolate with the texel.
    pub is_used: Vec<bool>,
    /// The area of the triangle in which the texel's centre lies; empty if colours jump nowhere.
    pub areas: Vec<u32>,
    /// Triangles that are hidden by others of their piece, ascending.
    pub hidden: Vec<u32>,
}

impl Drawn {
    /// Draws a patch, in place of what was drawn before.
    pub fn draw(&mut self, patch: &BakedPatch<'_>, map: &Map) {
        let count = map.size[0] as usize * map.size[1] as usize;
        self.depth.clear();
        self.depth.resize(count, f32::NAN);
        // Where there is no depth, the slope is not used.
        self.slope.resize(count, [0.0; 2]);
        self.areas.clear();
        if patch.areas.is_some() {
            self.areas.resize(count, NONE);
        }
        self.hidden.clear();
        let (projections, width) = (projections(patch, map), map.size[0] as usize);
        for (number, corners) in (0..).zip(patch.triangles) {
            let projection = &projections[usize::from(map.labels[number as usize])];
            let points = corners.map(|corner| patch.position(corner));
            let places = points.map(|point| projection.place(point));
            let depths = points.map(|point| projection.depth(point));
            let slope = slope(places, depths);
            let mut is_hidden = false;
            for_each_span(places, map.size, 0, |span| {
                let depth = span.values(depths);
                let (first, columns) = (span.row as usize * width, span.columns.clone());
                let texels = first + columns.start as usize..first + columns.end as usize;
                let known = self.depth[texels.clone()].iter_mut().zip(&mut self.slope[texels]);
                for (column, (before, slope_before)) in columns.zip(known) {
                    let at = depth.at(column) as f32;
                    if before.is_nan() {
                        (*before, *slope_before) = (at, slope);
                        if let Some(areas) = patch.areas {
                            self.areas[first + column as usize] = areas.of_triangles[number as usize];
                        }
                    } else if (*before - at).abs() > SAME_SHEET {
                        is_hidden = true;
                    }
                }
            });
            if is_hidden {
                self.hidden.push(number);
            }
        }
    }

    /// Finds which texels are used, after everything is drawn.
    pub fn complete(&mut self, patch: &BakedPatch<'_>, map: &Map) {
        has_depth(&self.depth, &mut self.is_covered);
        self.add_vertices(patch, map);
        self.widen(map);
    }

    /// Texels of vertices have a depth, even where triangles are smaller than texels.
    fn add_vertices(&mut self, patch: &BakedPatch<'_>, map: &Map) {
        let projections = projections(patch, map);
        for (corners, &label) in patch.triangles.iter().zip(&map.labels) {
            let projection = &projections[usize::from(label)];
            let points = corners.map(|corner| patch.position(corner));
            let places = points.map(|point| projection.place(point));
            let depths = points.map(|point| projection.depth(point));
            for (place, depth) in places.into_iter().zip(depths) {
                let [column, row] = texel_at(place, map.size);
                let texel = row as usize * map.size[0] as usize + column as usize;
                if self.depth[texel].is_nan() {
                    self.depth[texel] = depth as f32;
                    self.slope[texel] = slope(places, depths);
                }
            }
        }
    }

    /// Texels beside the patch get the depth of their neighbours, twice: once for interpolation, once where finer
    /// borders reach.
    fn widen(&mut self, map: &Map) {
        let width = map.size[0] as usize;
        let (mut rows, mut has, mut is_open): (Vec<Vec<bool>>, _, _) = (vec![], vec![], vec![]);
        let mut beside: Vec<(usize, f32, [f32; 2])> = vec![];
        for piece in &map.pieces {
            let [[left, top], [right, bottom]] = piece.range().map(|corner| corner.map(|x| x as usize));
            let around = |x: usize, low: usize, high: usize| x.saturating_sub(1).max(low)..=(x + 1).min(high);
            rows.resize_with(bottom - top + 1, Vec::new);
            for _ in 0..2 {
                // Of each texel whether it or one beside it in its row has a depth.
                for (row, y) in rows.iter_mut().zip(top..=bottom) {
                    has_depth(&self.depth[y * width + left..=y * width + right], &mut has);
                    widened(&has, row);
                }
                for y in top..=bottom {
                    let first = y * width + left;
                    let depths = &self.depth[first..=y * width + right];
                    let [above, below] = [*around(y, top, bottom).start(), *around(y, top, bottom).end()];
                    let [above, own, below] = [above, y, below].map(|y| &rows[y - top]);
                    is_open.clear();
                    let near = above.iter().zip(own).zip(below).map(|((above, own), below)| above | own | below);
                    is_open.extend(depths.iter().zip(near).map(|(depth, near)| depth.is_nan() & near));
                    for x in set(&is_open).map(|x| left + x) {
                        let (mut sum, mut slopes, mut count) = (0.0, [0.0; 2], 0.0);
                        let columns = around(x, left, right);
                        for other in around(y, top, bottom).flat_map(|y| columns.clone().map(move |x| y * width + x)) {
                            if !self.depth[other].is_nan() {
                                (sum, count) = (sum + self.depth[other], count + 1.0);
                                (0..2).for_each(|k| slopes[k] += self.slope[other][k]);
                            }
                        }
                        beside.push((y * width + x, sum / count, slopes.map(|slope| slope / count)));
                    }
                }
                for (texel, depth, slope) in beside.drain(..) {
                    (self.depth[texel], self.slope[texel]) = (depth, slope);
                }
            }
        }
        has_depth(&self.depth, &mut self.is_used);
    }

    /// The point of the patch that is closest to a point of the source, as far as the patch is as flat there as at the
    /// texel of the point: so the source is shown where a viewer would look for it, whatever the axis. Points are a
    /// place and a depth. A point that is further away than `reach` along the axis stays where it is.
    #[inline]
    pub fn closest(&self, point: Vec3A, [column, row]: [u32; 2], width: usize, reach: f32) -> Vec3A {
        let texel = row as usize * width + column as usize;
        let [along, down] = self.slope[texel];
        let centre = [column as f32 + 0.5, row as f32 + 0.5];
        let away = point.z - (self.depth[texel] + along * (point.x - centre[0]) + down * (point.y - centre[1]));
        // Comparisons with NaN are false.
        if away.abs() <= reach {
            let step = away / (1.0 + along * along + down * down);
            let moved = Vec3A::new(along * step, down * step, -step);
            if moved.x.abs().max(moved.y.abs()) <= MAX_STEP { point + moved } else { point }
        } else {
            point
        }
    }
}

/// Notes of each texel whether it has a depth.
fn has_depth(depth: &[f32], result: &mut Vec<bool>) {
    result.clear();
    result.extend(depth.iter().map(|depth| !depth.is_nan()));
}

/// Spreads what is true of elements to both beside each.
fn widened(flags: &[bool], result: &mut Vec<bool>) {
    result.clear();
    result.extend_from_slice(flags);
    let from_second = flags.get(1..).unwrap_or_default();
    result.iter_mut().zip(from_second).for_each(|(to, from)| *to |= from);
    let after_first = result.get_mut(1..).unwrap_or_default();
    after_first.iter_mut().zip(flags).for_each(|(to, from)| *to |= from);
}

/// How the depth of a triangle grows along both directions of the image; 0 if it has no area there.
fn slope([a, b, c]: [[f64; 2]; 3], depths: [f64; 3]) -> [f32; 2] {
    let ([x, y], [z, w]) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let (of_b, of_c) = (depths[1] - depths[0], depths[2] - depths[0]);
    let area = x * w - y * z;
    let slope = [(of_b * w - of_c * y) / area, (of_c * x - of_b * z) / area].map(|slope| slope as f32);
    if slope.iter().all(|slope| slope.is_finite()) { slope } else { [0.0; 2] }
}

/// Column and row of the texel in which a place lies.
pub(super) fn texel_at(place: [f64; 2], size: [u32; 2]) -> [u32; 2] {
    // The conversion saturates.
    [0, 1].map(|k| (place[k] as u32).min(size[k] - 1))
}

/// Centres of texels in a row, or of their quarters, that lie in a triangle.
pub(super) struct Span {
    pub row: u32,
    pub columns: Range<u32>,
    /// The weights of the triangle's corners in column 0, and what each column adds to them.
    first: [f64; 3],
    growth: [f64; 3],
}

impl Span {
    /// What the corners' values become along the row.
    pub fn values(&self, [a, b, c]: [f64; 3]) -> Along {
        let of = |weights: [f64; 3]| weights[0] * a + weights[1] * b + weights[2] * c;
        Along { first: of(self.first), growth: of(self.growth) }
    }

    /// The points of some columns.
    pub fn points(&self, columns: Range<u32>) -> Points {
        let first = [0, 1, 2].map(|k| self.first[k] + f64::from(columns.start) * self.growth[k]);
        Points { first, growth: self.growth, count: columns.len() as u32 }
    }
}

/// A value that grows by the same from column to column.
#[derive(Clone, Copy)]
pub(super) struct Along {
    first: f64,
    growth: f64,
}

impl Along {
    #[inline(always)]
    pub fn at(self, column: u32) -> f64 {
        self.first + f64::from(column) * self.growth
    }
}

/// Calls a function for the centres of texels that lie in a triangle, row by row; or, with `fineness` 1, for those of
/// their quarters, by their columns and rows. The triangle may have either winding.
pub(super) fn for_each_span(places: [[f64; 2]; 3], size: [u32; 2], fineness: u32, mut visit: impl FnMut(Span)) {
    let [a, b, c] = places;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (inverse, step) = (1.0 / area, 1.0 / f64::from(1_u32 << fineness));
    let range = |axis: usize| {
        let [low, high] = [a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis])];
        let count = f64::from(size[axis] << fineness);
        let first = (low / step - 0.5).ceil().clamp(0.0, count);
        let end = ((high / step - 0.5).floor() + 1.0).clamp(0.0, count);
        first as u32..end as u32
    };
    let columns = range(0);
    // Along a row each weight grows by the same.
    let growth = [b[1] - c[1], c[1] - a[1], a[1] - b[1]].map(|height| height * inverse * step);
    let shrink = growth.map(|growth| -1.0 / growth);
    for row in range(1) {
        let y = (f64::from(row) + 0.5) * step;
        let weight =
            |p: [f64; 2], q: [f64; 2]| ((p[0] - 0.5 * step) * (q[1] - y) - (p[1] - y) * (q[0] - 0.5 * step)) * inverse;
        let first = [weight(b, c), weight(c, a), weight(a, b)];
        let is_inside = |column: u32| (0..3).all(|k| first[k] + f64::from(column) * growth[k] >= 0.0);
        // Each weight is monotonous, so those inside are a range: one is computed, and corrected at both ends.
        let (mut low, mut high) = (f64::from(columns.start), f64::from(columns.end));
        if columns.len() > FEW_COLUMNS {
            for k in 0..3 {
                let root = first[k] * shrink[k];
                if growth[k] > 0.0 {
                    low = low.max(root);
                } else if growth[k] < 0.0 {
                    high = high.min(root);
                }
            }
        }
        // The conversions saturate.
        let (mut start, mut end) = (low as u32, (high as u32).saturating_add(2).min(columns.end));
        start = start.saturating_sub(1).max(columns.start);
        while start < end && !is_inside(start) {
            start += 1;
        }
        while start < end && !is_inside(end - 1) {
            end -= 1;
        }
        if start < end {
            visit(Span { row, columns: start..end, first, growth });
        }
    }
}
