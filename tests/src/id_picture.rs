//! Pictures that say for each pixel what is seen there and how near it is: orthographic, with a z-buffer.

use glam::DVec3;

use crate::raster::View;

/// Nothing is seen in a pixel.
pub const NOTHING: u32 = u32::MAX;

/// What is seen in each pixel of a square.
pub struct IdPicture {
    /// Pixels along a side.
    pub size: usize,
    /// Of each pixel, row after row from the top; [`NOTHING`] where nothing is.
    pub ids: Vec<u32>,
    /// Towards the eye, world units.
    pub depths: Vec<f64>,
}

impl IdPicture {
    /// Draws triangles, each with an id, from either side.
    pub fn of(view: &View, size: usize, triangles: impl IntoIterator<Item = ([DVec3; 3], u32)>) -> Self {
        let mut picture = Self { size, ids: vec![NOTHING; size * size], depths: vec![f64::NEG_INFINITY; size * size] };
        triangles.into_iter().for_each(|(corners, id)| picture.draw(view, corners, id));
        picture
    }

    fn draw(&mut self, view: &View, corners: [DVec3; 3], id: u32) {
        let middle = self.size as f64 / 2.0;
        let [a, b, c] = corners.map(|p| {
            let p = view.view_from_world * (p - view.centre);
            DVec3::new(middle + p.x * view.scale, middle - p.y * view.scale, p.z)
        });
        let cross = |p: DVec3, q: DVec3, x: f64, y: f64| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
        let area = cross(a, b, c.x, c.y);
        if area == 0.0 {
            return;
        }
        let pixels = |low: f64, high: f64| {
            let last = self.size as f64;
            (low - 0.5).ceil().clamp(0.0, last) as usize..((high - 0.5).floor() + 1.0).clamp(0.0, last) as usize
        };
        for row in pixels(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y)) {
            for column in pixels(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x)) {
                let (x, y) = (column as f64 + 0.5, row as f64 + 0.5);
                let weights = [cross(b, c, x, y), cross(c, a, x, y), cross(a, b, x, y)].map(|part| part / area);
                if weights.iter().any(|&weight| weight < 0.0) {
                    continue;
                }
                let depth = weights[0] * a.z + weights[1] * b.z + weights[2] * c.z;
                let pixel = row * self.size + column;
                if depth > self.depths[pixel] {
                    (self.depths[pixel], self.ids[pixel]) = (depth, id);
                }
            }
        }
    }

    /// The ray through the middle of a pixel, from outside of what is within `away`.
    pub fn ray(&self, view: &View, pixel: usize, away: f64) -> [DVec3; 2] {
        let middle = self.size as f64 / 2.0;
        let (x, y) = ((pixel % self.size) as f64 + 0.5, (pixel / self.size) as f64 + 0.5);
        let in_view = DVec3::new((x - middle) / view.scale, (middle - y) / view.scale, away);
        let world_from_view = view.view_from_world.transpose();
        [view.centre + world_from_view * in_view, world_from_view * DVec3::NEG_Z]
    }
}
