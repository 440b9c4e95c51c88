//! Boxes around tiles, and what a globe hides.
#![expect(clippy::disallowed_methods, reason = "boxes choose what is drawn; no decoded position depends on them")]

use super::{
    grid::{CELLS, TileId},
    index::HeightsIndex,
    page::TileRecord,
    surface::Base,
};
use crate::{
    codec::vector::{add, cross, dot, scale, sub},
    select::OrientedBox,
};

/// Lines of a tile, a quarter of it apart.
const LINES: u64 = 4;

/// A box around a tile and all tiles below it, at any resolution. Drawn triangles lie between samples, and those of
/// tiles below lie as far from the finest ones of this tile as both errors say.
pub(crate) fn tile_box(index: &HeightsIndex, record: &TileRecord) -> OrientedBox {
    let (grid, surface, info) = (index.grid(), index.surface(), index.info());
    let TileId { depth, column, row } = record.id;
    let line = |axis: usize, tile: u64, k: u64| grid.line(axis, depth, tile * CELLS as u64 + k * CELLS as u64 / LINES);
    let columns = (0..=LINES).map(|k| line(0, column, k)).collect::<Vec<_>>();
    let rows = (0..=LINES).map(|k| line(1, row, k)).collect::<Vec<_>>();
    let heights = [record.lowest, record.highest].map(|steps| info.height(steps));
    let slack = 2.0 * record.finest_error();
    let ends = |axis: usize, lines: &[u64]| [0, LINES as usize].map(|k| surface.line(axis, lines[k]));
    let Base::Ellipsoid { axis, eccentricity } = surface.base else {
        let (x, y) = (ends(0, &columns), ends(1, &rows));
        // Rows go to the south.
        let [low, high] = [0, 1].map(|k| surface.position(x[k], y[1 - k], heights[k]));
        let (low, high) = (sub(low, [slack; 3]), add(high, [slack; 3]));
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        return OrientedBox { centre: scale(add(low, high), 0.5), axes, half: scale(sub(high, low), 0.5) };
    };
    let [x, y] = [(0, &columns), (1, &rows)].map(|(axis, lines)| {
        let lines: Vec<_> = lines.iter().map(|&at| surface.line(axis, at)).collect();
        lines
    });
    let middle = LINES as usize / 2;
    // A hundredth of the radius, so that the difference has digits enough.
    let lifted = heights[0] + 0.01 * axis / surface.height_scale;
    let unit = |v: [f64; 3]| Some(dot(v, v).sqrt()).filter(|&length| length > 0.0).map(|length| scale(v, 1.0 / length));
    let at = |height: f64| surface.position(x[middle], y[middle], height);
    let up = unit(sub(at(lifted), at(heights[0]))).unwrap_or([0.0, 0.0, 1.0]);
    let east = unit(cross([0.0, 0.0, 1.0], up)).unwrap_or([1.0, 0.0, 0.0]);
    let axes = [east, cross(up, east), up];
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for &row in &y {
        for &column in &x {
            for height in heights {
                let point = surface.position(column, row, height);
                for k in 0..3 {
                    let along = dot(axes[k], point);
                    (low[k], high[k]) = (low[k].min(along), high[k].max(along));
                }
            }
        }
    }
    // Between these lines, the surface leaves the hull of what is on them by at most an eighth of its second
    // derivatives times the squared distances of lines.
    let apart = |lines: &[u64], axis: usize| {
        let most = lines.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0);
        (most as f64 * surface.spacing[axis]).abs().to_radians()
    };
    let (across, along) = (apart(&columns, 0), apart(&rows, 1));
    let highest = heights[1].abs().max(heights[0].abs()) * surface.height_scale;
    let meridian = axis * (1.0 + 1.5 * eccentricity) / (1.0 - eccentricity).powf(1.5) + highest;
    // The widest parallel lies at a line, or near one.
    let widest = y.iter().map(|row| row.cosine().abs()).fold(0.0, f64::max) + along;
    let parallel = (axis / (1.0 - eccentricity).sqrt() + highest) * widest.min(1.0);
    let slack = slack + (meridian * along * along + parallel * across * across) / 8.0;
    let half = [0, 1, 2].map(|k| 0.5 * (high[k] - low[k]) + slack);
    let centre = (0..3).fold([0.0; 3], |centre, k| add(centre, scale(axes[k], 0.5 * (low[k] + high[k]))));
    OrientedBox { centre, axes, half }
}

/// The radius of a ball around the origin that the surface encloses; none if it is open, so that its far side can be
/// seen.
pub(crate) fn enclosed_ball(index: &HeightsIndex) -> Option<f64> {
    let (grid, surface) = (index.grid(), index.surface());
    let Base::Ellipsoid { axis, eccentricity } = surface.base else { return None };
    if !grid.wraps() || grid.poles() != [true; 2] {
        return None;
    }
    let mut least = axis * (1.0 - eccentricity).sqrt();
    let mut lowest = 0.0_f64;
    for id in grid.root_tiles() {
        let page = index.known_page(id)?;
        let record = &page.top()?.record;
        if record.is_partial {
            return None;
        }
        lowest = lowest.min(index.info().height(record.lowest) * surface.height_scale - 2.0 * record.finest_error());
    }
    least += lowest;
    (least > 0.0).then_some(least)
}

/// Whether a ball around the origin hides a box from a camera: all corners lie in its shadow, which is convex.
pub(crate) fn is_hidden(camera: [f64; 3], radius: f64, bounds: &OrientedBox) -> bool {
    // The squared length of a tangent from the camera.
    let tangent = dot(camera, camera) - radius * radius;
    tangent > 0.0
        && bounds.corners().all(|corner| {
            let way = sub(corner, camera);
            let towards = -dot(way, camera);
            towards > tangent && towards * towards > tangent * dot(way, way)
        })
}
