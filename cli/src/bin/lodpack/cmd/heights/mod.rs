//! What commands do with files of heights.

pub mod build;
pub mod extract;
pub mod ground;
pub mod info;
pub mod quantized;
pub mod raster;
pub mod verify;

use super::open::Source;
use crate::output::{bytes, count};
use lodpack::heights::Heights;

/// What `build` and `info` say of the image over heights, given its texels, its components and its bytes of the file.
fn image_line(size: [u64; 2], components: u8, taken: u64) -> String {
    let ([width, height], opacity) = (size.map(count), if components == 4 { " with opacity" } else { "" });
    let bits = 8.0 * taken as f64 / (size[0] as f64 * size[1] as f64);
    format!("  image      {width} x {height} texels{opacity}, {} of the file, {bits:.2} bits per texel", bytes(taken))
}

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
