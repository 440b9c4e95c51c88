//! An independent reference: a rasteriser without a GPU, and distances to a mesh. Shares nothing with drawing.

use glam::DVec3;
use lodpack::View;
use rstar::{AABB, PointDistance, RTree, RTreeObject};

/// Draws triangles. Returns depths along the camera's axis at the middles of pixels, row after row from the top;
/// infinite for the background. Triangles that reach in front of the near plane are left out.
pub fn depth_map(positions: &[[f64; 3]], triangles: &[[u32; 3]], view: &View) -> Vec<f64> {
    let [width, height] = view.viewport;
    let mut depths = vec![f64::INFINITY; width as usize * height as usize];
    let ([right, up, forward], scale) = (view.axes().map(DVec3::from), view.pixels_per_tangent());
    let project = |&p: &[f64; 3]| {
        let offset = DVec3::from(p) - DVec3::from(view.position);
        let z = offset.dot(forward);
        let (x, y) = (offset.dot(right) / z * scale, offset.dot(up) / z * scale);
        DVec3::new(f64::from(width) / 2.0 + x, f64::from(height) / 2.0 - y, z)
    };
    let projected: Vec<DVec3> = positions.iter().map(project).collect();
    let twice_area = |[a, b, c]: [DVec3; 3]| (b - a).truncate().perp_dot((c - a).truncate());
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| projected[vertex as usize]);
        let (low, high, area) = (a.min(b).min(c), a.max(b).max(c), twice_area([a, b, c]));
        if low.z < view.near || area == 0.0 {
            continue;
        }
        // The middles of pixels are at halves.
        let (from, to) = ((low - 0.5).ceil(), (high + 0.5).floor());
        for y in from.y as u32..(to.y as u32).min(height) {
            for x in from.x as u32..(to.x as u32).min(width) {
                let pixel = DVec3::new(f64::from(x) + 0.5, f64::from(y) + 0.5, 0.0);
                let [u, v, w] = [[b, c, pixel], [c, a, pixel], [a, b, pixel]].map(|part| twice_area(part) / area);
                if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                    let at = &mut depths[(y * width + x) as usize];
                    *at = at.min(1.0 / (u / a.z + v / b.z + w / c.z));
                }
            }
        }
    }
    depths
}

/// The point that a pixel shows at a depth.
pub fn point(view: &View, pixel: usize, depth: f64) -> DVec3 {
    let ([right, up, forward], [width, height]) = (view.axes().map(DVec3::from), view.viewport);
    let (x, y) = (pixel as u32 % width, pixel as u32 / width);
    let scale = depth / view.pixels_per_tangent();
    let across = (f64::from(x) + 0.5 - f64::from(width) / 2.0) * scale;
    let down = (f64::from(y) + 0.5 - f64::from(height) / 2.0) * scale;
    DVec3::from(view.position) + right * across - up * down + forward * depth
}

/// A tree of boxes over triangles, which finds out whether something is near.
pub struct Tree(RTree<Triangle>);

struct Triangle {
    corners: [DVec3; 3],
    label: u32,
}

impl RTreeObject for Triangle {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        AABB::from_points(&self.corners.map(|corner| corner.to_array()))
    }
}

impl PointDistance for Triangle {
    fn distance_2(&self, &point: &[f64; 3]) -> f64 {
        let point = DVec3::from(point);
        (closest_point(self.corners, point) - point).length_squared()
    }
}

impl Tree {
    /// Builds a tree over triangles, each with a label.
    pub fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]], label: impl Fn(usize) -> u32) -> Self {
        let corners = |t: &[u32; 3]| t.map(|vertex| DVec3::from(positions[vertex as usize]));
        let labelled = triangles.iter().enumerate();
        Self(RTree::bulk_load(labelled.map(|(k, t)| Triangle { corners: corners(t), label: label(k) }).collect()))
    }

    /// Whether some triangle is within its own reach of a point.
    pub fn is_near(&self, point: DVec3, largest_reach: f64, reach: impl Fn(u32) -> f64) -> bool {
        let point = point.to_array();
        let mut candidates = self.0.locate_within_distance(point, largest_reach * largest_reach);
        candidates.any(|triangle| triangle.distance_2(&point) <= reach(triangle.label).powi(2))
    }
}

/// The point of a triangle nearest to `p`: its foot on the plane if that is inside, otherwise a point of an edge.
fn closest_point([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let edges = [(a, b), (b, c), (c, a)];
    let normal = (b - a).cross(c - a);
    let foot = p - normal * ((p - a).dot(normal) / normal.length_squared());
    // Never true for a triangle without area, whose foot is not a number.
    if edges.iter().all(|&(from, to)| (to - from).cross(foot - from).dot(normal) >= 0.0) {
        return foot;
    }
    let on_edge = |(from, to): (DVec3, DVec3)| {
        let along = to - from;
        from + along * ((p - from).dot(along) / along.length_squared()).clamp(0.0, 1.0)
    };
    // Nor is a point of an edge without length a number; it is not nearer than anything.
    let nearer = |x: DVec3, y: DVec3| if y.distance_squared(p) < x.distance_squared(p) { y } else { x };
    edges.map(on_edge).into_iter().fold(a, nearer)
}
