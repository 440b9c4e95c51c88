//! What lies beyond the last lines of a window: where a grid does not end with one of the lines that a window has, the
//! window's surface ends before it.

use glam::DVec3;
use lodpack::heights::{Heights, Surface};
use lodpack::{ReadAt, Result};

use super::window::RasterWindow;

/// A bound of the distance between what lies beyond the last column or row of a window and the surface of the window,
/// in units of space; 0 if the window ends where the grid does, or before. None if it is more than `most`.
///
/// # Errors
/// Those of reading the file.
pub(super) fn error_beyond<S: ReadAt>(file: &Heights<S>, window: &RasterWindow, most: f64) -> Result<Option<f64>> {
    let (grid, stride) = (file.grid(), window.stride);
    let cells = grid.cells();
    let first = window.first.map(|first| first * stride);
    let last = [0, 1].map(|axis| first[axis] + (window.size[axis] - 1) * stride);
    // The window reaches as far as its lines do, and the grid less than one of them further. What lies beyond the last
    // row before a pole is closed again when a file is built.
    let goes_on = [grid.wraps(), grid.poles()[1]];
    let is_beyond = [0, 1].map(|axis| !goes_on[axis] && last[axis] < cells[axis] && cells[axis] - last[axis] < stride);
    let surface = file.surface();
    let mut found = 0.0_f64;
    for axis in (0..2).filter(|&axis| is_beyond[axis]) {
        let other = 1 - axis;
        // The corner, too.
        let end = if is_beyond[other] { cells[other] } else { last[other] };
        // Far away, nothing has to be read.
        let across = [first[other], end].map(|along| {
            let [mut from, mut to] = [[along; 2]; 2];
            (from[axis], to[axis]) = (last[axis], cells[axis]);
            position(surface, from, 0.0).distance(position(surface, to, 0.0))
        });
        if across[0].min(across[1]) > most {
            return Ok(None);
        }
        let mut range = [0..0, 0..0];
        range[axis] = last[axis]..cells[axis] + 1;
        range[other] = first[other]..end + 1;
        let heights = file.window(range[0].clone(), range[1].clone())?;
        let width = range[0].end - range[0].start;
        let height = |line: [u64; 2]| {
            let at = (line[1] - range[1].start) * width + line[0] - range[0].start;
            heights.get(at as usize).copied().filter(|height| !height.is_nan())
        };
        let edge =
            Edge { surface, axis, line: last[axis], along: [first[other], last[other]], stride, height: &height };
        for beyond in last[axis] + 1..=cells[axis] {
            for along in first[other]..=end {
                let mut line = [along; 2];
                line[axis] = beyond;
                if let Some(own) = height(line) {
                    found = found.max(edge.distance(line, own));
                }
            }
        }
    }
    if found == 0.0 {
        return Ok(Some(0.0));
    }
    let found = found + file.info().sample_error * surface.height_scale;
    Ok((found <= most).then_some(found))
}

/// The last column or row of a window.
struct Edge<'a, H> {
    surface: &'a Surface,
    /// Across the edge.
    axis: usize,
    /// Its line in the grid.
    line: u64,
    /// The lines where it begins and ends.
    along: [u64; 2],
    stride: u64,
    height: &'a H,
}

impl<H: Fn([u64; 2]) -> Option<f64>> Edge<'_, H> {
    /// A bound of the distance of a sample from the edge: from the place beside it or, where the edge has no data
    /// there, from the nearest of its samples that has. Infinite if none has.
    fn distance(&self, line: [u64; 2], own: f64) -> f64 {
        let along = line[1 - self.axis].clamp(self.along[0], self.along[1]);
        let before = along - (along - self.along[0]) % self.stride;
        let share = (along - before) as f64 / self.stride as f64;
        let sample = |along: u64| (self.height)(self.place(along));
        let beside = match (sample(before), share) {
            (height, 0.0) => height,
            (Some(low), _) => sample(before + self.stride).map(|high| low + share * (high - low)),
            _ => None,
        };
        let from = position(self.surface, line, own);
        let to = |along: u64, height: f64| from.distance(position(self.surface, self.place(along), height));
        if let Some(height) = beside {
            return to(along, height);
        }
        let samples = (self.along[0]..=self.along[1]).step_by(self.stride as usize);
        samples.filter_map(|at| Some(to(at, sample(at)?))).fold(f64::INFINITY, f64::min)
    }

    fn place(&self, along: u64) -> [u64; 2] {
        let mut place = [along; 2];
        place[self.axis] = self.line;
        place
    }
}

/// Where a sample is at a height.
fn position(surface: &Surface, [column, row]: [u64; 2], height: f64) -> DVec3 {
    surface.position(surface.line(0, column), surface.line(1, row), height).into()
}
