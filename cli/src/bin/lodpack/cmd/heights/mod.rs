//! What commands do with files of heights.

pub mod build;
pub mod extract;
pub mod ground;
pub mod info;
pub mod quantized;
pub mod raster;
pub mod verify;

use super::open::Source;
use lodpack::heights::Heights;

/// From where to where a grid reaches, for messages.
fn reach(file: &Heights<Source>) -> String {
    let (surface, cells) = (file.surface(), file.grid().cells());
    let ends = [0, 1].map(|axis| {
        // Rows behind a pole are the pole.
        let most = if surface.is_globe() && axis == 1 { 90.0 } else { f64::INFINITY };
        let [a, b] =
            [0, cells[axis]].map(|line| (surface.first[axis] + surface.spacing[axis] * line as f64).clamp(-most, most));
        [a.min(b), a.max(b)]
    });
    let unit = if surface.is_globe() { " degrees" } else { "" };
    let [[west, east], [south, north]] = ends;
    format!("from {west}, {south} to {east}, {north}{unit}")
}
