//! Triangles on the texels of a map.

use lodpack::decode::texels::Map;

use super::BakedPatch;
use super::projection::projections;

/// Depths that differ by less than this many texels are those of one sheet.
const SAME_SHEET: f32 = 2.0;

/// A patch as its map shows it.
#[derive(Clone, Debug, Default)]
pub(super) struct Drawn {
    /// For each texel the depth of the patch along the axis of the piece, in texels from the patch's origin; beside the patch that of the nearest texel of it, as
    /// far as images are read there. NaN elsewhere.
    pub depth: Vec<f32>,
    /// Whether the texel's centre lies in a triangle.
    pub is_covered: Vec<bool>,
    /// Whether a reader may interpolate with the texel.
    pub is_used: Vec<bool>,
    /// Triangles that are hidden by others of their piece, ascending.
    pub hidden: Vec<u32>,
}

impl Drawn {
    pub fn new(patch: &BakedPatch<'_>, map: &Map) -> Self {
        let mut this = Self { depth: vec![f32::NAN; map.size[0] as usize * map.size[1] as usize], ..Self::default() };
        let projections = projections(patch, map);
        for (number, corners) in (0..).zip(patch.triangles) {
            let projection = &projections[usize::from(map.labels[number as usize])];
            let points = corners.map(|corner| patch.position(corner));
            let places = points.map(|point| projection.place(point));
            let depths = points.map(|point| projection.depth(point));
            let mut is_hidden = false;
            for_each_sample(places, map.size, 1, |texel, weights| {
                let at = (weights[0] * depths[0] + weights[1] * depths[1] + weights[2] * depths[2]) as f32;
                let before = &mut this.depth[texel];
                if before.is_nan() {
                    *before = at;
                } else if (*before - at).abs() > SAME_SHEET {
                    is_hidden = true;
                }
            });
            if is_hidden {
                this.hidden.push(number);
            }
        }
        this
    }

    /// Finds which texels are used, after everything is drawn.
    pub fn complete(&mut self, patch: &BakedPatch<'_>, map: &Map) {
        self.is_covered = self.depth.iter().map(|depth| !depth.is_nan()).collect();
        self.add_vertices(patch, map);
        self.widen(map);
    }

    /// Texels of vertices have a depth, even where triangles are smaller than texels.
    fn add_vertices(&mut self, patch: &BakedPatch<'_>, map: &Map) {
        let projections = projections(patch, map);
        for (corners, &label) in patch.triangles.iter().zip(&map.labels) {
            let projection = &projections[usize::from(label)];
            for &corner in corners {
                let point = patch.position(corner);
                let texel = texel_at(projection.place(point), map.size);
                if self.depth[texel].is_nan() {
                    self.depth[texel] = projection.depth(point) as f32;
                }
            }
        }
    }

    /// Texels beside the patch get the depth of their neighbours, twice: once for interpolation, once where finer borders reach.
    fn widen(&mut self, map: &Map) {
        let rectangles: Vec<[usize; 4]> = map
            .pieces
            .iter()
            .map(|piece| {
                let [low, high] = piece.range();
                [low[0] as usize, low[1] as usize, high[0] as usize, high[1] as usize]
            })
            .collect();
        let width = map.size[0] as usize;
        for _ in 0..2 {
            let before = self.depth.clone();
            for &[left, top, right, bottom] in &rectangles {
                for y in top..=bottom {
                    for x in left..=right {
                        if !before[y * width + x].is_nan() {
                            continue;
                        }
                        let rows = y.saturating_sub(1).max(top)..=(y + 1).min(bottom);
                        let around = rows.flat_map(|y| {
                            (x.saturating_sub(1).max(left)..=(x + 1).min(right)).map(move |x| y * width + x)
                        });
                        let (mut sum, mut count) = (0.0, 0.0);
                        for depth in around.map(|texel| before[texel]).filter(|depth| !depth.is_nan()) {
                            (sum, count) = (sum + depth, count + 1.0);
                        }
                        if count > 0.0 {
                            self.depth[y * width + x] = sum / count;
                        }
                    }
                }
            }
        }
        self.is_used = self.depth.iter().map(|depth| !depth.is_nan()).collect();
    }
}

/// The texel in which a place lies.
pub(super) fn texel_at(place: [f64; 2], size: [u32; 2]) -> usize {
    // The conversion saturates.
    let [x, y] = [0, 1].map(|k| (place[k] as u32).min(size[k] - 1) as usize);
    y * size[0] as usize + x
}

/// Calls a function for each centre of `fineness` by `fineness` parts of a texel that lies in a triangle, with the number of the texel and the
/// weights of the corners. The triangle may have either winding.
pub(super) fn for_each_sample(
    places: [[f64; 2]; 3],
    size: [u32; 2],
    fineness: u32,
    mut visit: impl FnMut(usize, [f64; 3]),
) {
    let [a, b, c] = places;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let (inverse, step) = (1.0 / area, 1.0 / f64::from(fineness));
    let range = |axis: usize| {
        let [low, high] = [a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis])];
        let count = f64::from(size[axis] * fineness);
        let first = (low / step - 0.5).ceil().clamp(0.0, count);
        let end = ((high / step - 0.5).floor() + 1.0).clamp(0.0, count);
        first as u32..end as u32
    };
    let columns = range(0);
    // Along a row each weight grows by the same.
    let growth = [b[1] - c[1], c[1] - a[1], a[1] - b[1]].map(|height| height * inverse * step);
    for row in range(1) {
        let y = (f64::from(row) + 0.5) * step;
        let weight =
            |p: [f64; 2], q: [f64; 2]| ((p[0] - 0.5 * step) * (q[1] - y) - (p[1] - y) * (q[0] - 0.5 * step)) * inverse;
        let first = [weight(b, c), weight(c, a), weight(a, b)];
        let texels = (row / fineness) as usize * size[0] as usize;
        for column in columns.clone() {
            let weights = [0, 1, 2].map(|k| first[k] + f64::from(column) * growth[k]);
            if weights[0] >= 0.0 && weights[1] >= 0.0 && weights[2] >= 0.0 {
                visit(texels + (column / fineness) as usize, weights);
            }
        }
    }
}
