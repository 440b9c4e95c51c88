//! How far the input is from its images.

use glam::{DVec3, Vec3};

use super::image::GeometryImage;
use super::product::AtlasChart;
use crate::stage::embed::quad_coordinates;

/// Distances of vertices of charts from the images, each at the vertex's place in them, so that none is smaller than that from the surface.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Distances {
    pub largest: f64,
    squares: f64,
    count: u64,
}

impl Distances {
    /// Those of a chart from its images, which are bilinear between samples.
    pub fn of(chart: &AtlasChart, images: &[GeometryImage]) -> Self {
        let mut all = Self::default();
        for (&position, &uv) in chart.mesh.positions.iter().zip(&chart.embedding.uv) {
            let (quad, s, t) = quad_coordinates(images.len(), uv);
            let distance = bilinear(&images[quad], s, t).distance(position);
            all = all.plus(Self { largest: distance, squares: distance * distance, count: 1 });
        }
        all
    }

    pub fn plus(self, other: Self) -> Self {
        Self {
            largest: self.largest.max(other.largest),
            squares: self.squares + other.squares,
            count: self.count + other.count,
        }
    }

    pub fn rms(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

/// The position that an image has at (s, t).
fn bilinear(image: &GeometryImage, s: f64, t: f64) -> DVec3 {
    let [x, y] = [s, t].map(|share| share * image.last as f64);
    // The last cell ends with the last sample.
    let [column, row] = [x, y].map(|at| (at as usize).min(image.last - 1));
    let [right, down] = [x - column as f64, y - row as f64];
    let at = |column, row| Vec3::from_array(image.at((column, row))).as_dvec3();
    let above = at(column, row).lerp(at(column + 1, row), right);
    above.lerp(at(column, row + 1).lerp(at(column + 1, row + 1), right), down)
}
