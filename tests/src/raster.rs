//! A small software rasteriser for pictures of meshes: orthographic, z-buffered, flat shaded.

use glam::{DMat3, DVec3};

/// A picture in 8-bit RGB, with its depth buffer.
pub struct Picture {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colours, row after row from the top.
    pub pixels: Vec<[u8; 3]>,
    depth: Vec<f64>,
}

/// How world positions map to pixels.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The world rotated such that x points right, y up and z towards the eye.
    pub view_from_world: DMat3,
    /// The world point in the middle of the panel.
    pub centre: DVec3,
    /// Pixels per unit.
    pub scale: f64,
}

impl View {
    /// Looks at a box from an azimuth and elevation (degrees, y up), filling a square of `size_px`.
    pub fn around(bounds: [DVec3; 2], azimuth: f64, elevation: f64, size_px: usize) -> Self {
        let view_from_world =
            DMat3::from_rotation_x(elevation.to_radians()) * DMat3::from_rotation_y(-azimuth.to_radians());
        let [low, high] = bounds;
        // The corners of the box, seen from here, decide the scale, so that nothing is cut off.
        let mut extent = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        let centre = (low + high) * 0.5;
        for i in 0..8 {
            let pick = |bit: usize, k: usize| if i >> bit & 1 == 0 { low[k] } else { high[k] };
            let p = view_from_world * (DVec3::new(pick(0, 0), pick(1, 1), pick(2, 2)) - centre);
            extent = [extent[0].min(p.x), extent[1].max(p.x), extent[2].min(p.y), extent[3].max(p.y)];
        }
        let largest = (extent[1] - extent[0]).max(extent[3] - extent[2]);
        Self { view_from_world, centre, scale: size_px as f64 * 0.96 / largest.max(1e-300) }
    }
}

impl Picture {
    /// A white picture.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, pixels: vec![[255; 3]; width * height], depth: vec![f64::NEG_INFINITY; width * height] }
    }

    /// Draws a triangle with a base colour, in a panel whose middle is at `middle` (pixels).
    pub fn triangle(&mut self, view: &View, middle: [f64; 2], corners: [DVec3; 3], colour: [f64; 3]) {
        let eye = corners.map(|p| view.view_from_world * (p - view.centre));
        let normal = (eye[1] - eye[0]).cross(eye[2] - eye[0]).normalize_or_zero();
        // A key light over the left shoulder and a weak fill light. Back faces are dark red, so that holes are visible.
        let light = DVec3::new(-0.4, 0.5, 0.77);
        let shade = 0.25 + 0.75 * normal.dot(light).max(0.0);
        let colour = if normal.z < 0.0 { [0.5, 0.05, 0.05] } else { colour.map(|c| c * shade) };
        let rgb = colour.map(|c| (c.clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0) as u8);
        let screen = eye.map(|p| [middle[0] + p.x * view.scale, middle[1] - p.y * view.scale]);
        let area = cross(screen[0], screen[1], screen[2]);
        if area == 0.0 {
            return;
        }
        let range = |k: usize, limit: usize| {
            let low = screen.iter().map(|p| p[k]).fold(f64::INFINITY, f64::min).floor().max(0.0) as usize;
            let high = screen.iter().map(|p| p[k]).fold(f64::NEG_INFINITY, f64::max).ceil().max(0.0) as usize;
            low..=high.min(limit - 1)
        };
        for y in range(1, self.height) {
            for x in range(0, self.width) {
                let p = [x as f64 + 0.5, y as f64 + 0.5];
                let weights = [
                    cross(screen[1], screen[2], p) / area,
                    cross(screen[2], screen[0], p) / area,
                    cross(screen[0], screen[1], p) / area,
                ];
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let z = weights[0] * eye[0].z + weights[1] * eye[1].z + weights[2] * eye[2].z;
                let at = y * self.width + x;
                if z > self.depth[at] {
                    self.depth[at] = z;
                    self.pixels[at] = rgb;
                }
            }
        }
    }

    /// The picture at half the size, each pixel the mean of four: smooth edges for pictures drawn at twice the size.
    pub fn halved(&self) -> Self {
        let mut half = Self::new(self.width / 2, self.height / 2);
        for y in 0..half.height {
            for x in 0..half.width {
                let at = |dx: usize, dy: usize| self.pixels[(2 * y + dy) * self.width + 2 * x + dx];
                let four = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
                half.pixels[y * half.width + x] =
                    [0, 1, 2].map(|k| (four.iter().map(|p| u32::from(p[k])).sum::<u32>() / 4) as u8);
            }
        }
        half
    }

    /// Writes the picture as PNG.
    ///
    /// # Errors
    ///
    /// Any error of the encoder or the file system.
    pub fn save(&self, path: &std::path::Path) -> Result<(), image::ImageError> {
        let bytes: Vec<u8> = self.pixels.iter().flatten().copied().collect();
        image::save_buffer(path, &bytes, self.width as u32, self.height as u32, image::ExtendedColorType::Rgb8)
    }
}

fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
