//! Stretch: how much the map from the polygon back to the surface lengthens, and the weights that even it out.
//!
//! The L2 stretch of a triangle is the root mean square of the singular values of that affine map (Sander, Snyder,
//! Gortler and Hoppe, "Texture mapping progressive meshes", 2001, section 3). The reweighting follows Yoshizawa,
//! Belyaev and Seidel ("A fast and simple stretch-minimizing mesh parameterization", 2004), but divides by the stretch
//! of both ends, so that the weights stay symmetric. Then the matrix stays symmetric positive definite, and positive
//! weights keep the map a bijection.

use glam::{DVec2, DVec3};
use robust::{Coord, orient2d};

use super::{EmbedQuality, system::Edge};

/// A triangle is under-sampled if its share of the polygon is below this part of its share of the surface.
const UNDERSAMPLED_DENSITY: f64 = 1.0 / 16.0;

/// The contribution of one triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct TriangleStretch {
    /// Area on the surface.
    area: f64,
    /// Area in the polygon.
    plane_area: f64,
    /// Squared L2 stretch, not normalised.
    squared: f64,
}

/// The stretch of every triangle of a map.
pub(super) struct Stretch {
    pub triangles: Vec<TriangleStretch>,
    /// Sums over the triangles, in their order.
    area: f64,
    plane_area: f64,
    squared_times_area: f64,
    /// Triangles that are flipped or degenerate in the plane, decided exactly.
    pub flips: Vec<u32>,
}

/// Whether a triangle is counter-clockwise in the plane, decided exactly.
pub(super) fn is_positive(uv: &[DVec2], triangle: [u32; 3]) -> bool {
    let [a, b, c] = triangle.map(|v| Coord { x: uv[v as usize].x, y: uv[v as usize].y });
    orient2d(a, b, c) > 0.0
}

impl Stretch {
    pub fn measure(positions: &[DVec3], uv: &[DVec2], triangles: &[[u32; 3]]) -> Self {
        let mut stretch = Self {
            triangles: Vec::with_capacity(triangles.len()),
            area: 0.0,
            plane_area: 0.0,
            squared_times_area: 0.0,
            flips: Vec::new(),
        };
        for (i, &t) in triangles.iter().enumerate() {
            let [p, q, r] = t.map(|v| positions[v as usize]);
            let [a, b, c] = t.map(|v| uv[v as usize]);
            let (e, f) = (q - p, r - p);
            let (d, g) = (b - a, c - a);
            let area = 0.5 * e.cross(f).length();
            let mut double_area = d.perp_dot(g);
            if !is_positive(uv, t) {
                stretch.flips.push(i as u32);
            }
            // A flipped triangle has no stretch, so let it count as extremely crowded.
            double_area = double_area.max(1e-30);
            let along_u = (e * g.y - f * d.y) / double_area;
            let along_v = (f * d.x - e * g.x) / double_area;
            let squared = 0.5 * (along_u.length_squared() + along_v.length_squared());
            let triangle = TriangleStretch { area, plane_area: 0.5 * double_area, squared };
            stretch.area += area;
            stretch.plane_area += triangle.plane_area;
            stretch.squared_times_area += squared * area;
            stretch.triangles.push(triangle);
        }
        stretch
    }

    /// L2 stretch of the whole map: 1 for an isometry up to scale.
    pub fn total(&self) -> f64 {
        self.normalised(self.squared_times_area / self.area.max(f64::MIN_POSITIVE))
    }

    fn normalised(&self, squared: f64) -> f64 {
        (squared * self.plane_area / self.area.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Percentiles over the surface area, and the total.
    pub fn quality(&self) -> EmbedQuality {
        let mut sorted: Vec<(f64, f64)> =
            self.triangles.iter().filter(|t| t.area > 0.0).map(|t| (t.squared, t.area)).collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let percentile = |share: f64| {
            let mut below = 0.0;
            let nearest = sorted.iter().position(|&(_, area)| {
                below += area;
                below >= share * self.area
            });
            nearest.or(sorted.len().checked_sub(1)).map_or(1.0, |i| self.normalised(sorted[i].0))
        };
        let mean_density = self.plane_area / self.area.max(f64::MIN_POSITIVE);
        let undersampled = |t: &&TriangleStretch| t.plane_area < UNDERSAMPLED_DENSITY * mean_density * t.area;
        let undersampled_area: f64 = self.triangles.iter().filter(undersampled).fold(0.0, |sum, t| sum + t.area);
        EmbedQuality {
            stretch_total: self.total(),
            stretch_p50: percentile(0.5),
            stretch_p90: percentile(0.9),
            stretch_max: sorted.last().map_or(1.0, |&(squared, _)| self.normalised(squared)),
            undersampled_area: undersampled_area / self.area.max(f64::MIN_POSITIVE),
            flips_repaired: 0,
            residual: 0.0,
            conditioning: 1.0,
        }
    }

    /// Divides each weight by the square root of the stretch of its ends: crowded vertices get weaker springs and
    /// spread.
    pub fn reweight(&self, triangles: &[[u32; 3]], vertex_count: usize, edges: &[Edge], weights: &mut [f64]) {
        let mut sums = vec![(0.0, 0.0); vertex_count];
        for (t, s) in triangles.iter().zip(&self.triangles) {
            for &v in t {
                let sum = &mut sums[v as usize];
                sum.0 += s.area;
                sum.1 += s.area * s.squared;
            }
        }
        let scale = self.plane_area / self.area.max(f64::MIN_POSITIVE);
        // The fourth root of a vertex's mean squared stretch, which is the square root of its stretch.
        let root: Vec<f64> = sums
            .iter()
            .map(|&(area, sum)| (scale * sum / f64::max(area, 1e-300)).clamp(1e-16, 1e16).sqrt().sqrt())
            .collect();
        let mut largest = 0.0f64;
        for (edge, weight) in edges.iter().zip(weights.iter_mut()) {
            *weight /= root[edge.ends[0] as usize] * root[edge.ends[1] as usize];
            largest = largest.max(*weight);
        }
        // Bounded ratios keep the matrix well conditioned.
        for weight in weights {
            *weight = (*weight / largest).max(1e-9);
        }
    }
}
