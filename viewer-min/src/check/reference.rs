//! An independent answer: a rasteriser without a GPU, and distances to a mesh. Shares nothing with drawing.

use glam::DVec3;

use crate::camera::Camera;

/// Depths along the camera's axis at the middles of pixels; infinite for the background.
pub struct DepthMap {
    /// Width and height.
    pub size: [u32; 2],
    /// Row after row from the top.
    pub depths: Vec<f64>,
}

impl DepthMap {
    /// Draws triangles. Those that reach before the near plane are left out.
    pub fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]], camera: &Camera, size: [u32; 2]) -> Self {
        let [width, height] = size;
        let mut depths = vec![f64::INFINITY; width as usize * height as usize];
        let [right, up, forward] = camera.axes();
        let scale = camera.pixels_per_tangent(height);
        let middle = [f64::from(width) / 2.0, f64::from(height) / 2.0];
        let project = |&p: &[f64; 3]| {
            let offset = DVec3::from(p) - camera.position;
            let z = offset.dot(forward);
            [middle[0] + offset.dot(right) / z * scale, middle[1] - offset.dot(up) / z * scale, z]
        };
        let projected: Vec<[f64; 3]> = positions.iter().map(project).collect();
        for triangle in triangles {
            let [a, b, c] = triangle.map(|vertex| projected[vertex as usize]);
            if a[2].min(b[2]).min(c[2]) < camera.near {
                continue;
            }
            let span = |k: usize, limit: u32| {
                let (low, high) = (a[k].min(b[k]).min(c[k]), a[k].max(b[k]).max(c[k]));
                // Middles of pixels lie at halves.
                ((low - 0.5).ceil().max(0.0) as u32, (high - 0.5).floor().min(f64::from(limit) - 1.0))
            };
            let ((x0, x1), (y0, y1)) = (span(0, width), span(1, height));
            let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            if area == 0.0 || x1 < f64::from(x0) || y1 < f64::from(y0) {
                continue;
            }
            for y in y0..=y1 as u32 {
                for x in x0..=x1 as u32 {
                    let (px, py) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                    let edge =
                        |p: [f64; 3], q: [f64; 3]| ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) / area;
                    let (u, v, w) = (edge(b, c), edge(c, a), edge(a, b));
                    if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                        let depth = 1.0 / (u / a[2] + v / b[2] + w / c[2]);
                        let at = &mut depths[(y * width + x) as usize];
                        *at = at.min(depth);
                    }
                }
            }
        }
        Self { size, depths }
    }

    /// The point that a pixel shows at a depth.
    pub fn point(size: [u32; 2], camera: &Camera, pixel: usize, depth: f64) -> DVec3 {
        let [right, up, forward] = camera.axes();
        let (x, y) = (pixel as u32 % size[0], pixel as u32 / size[0]);
        let scale = depth / camera.pixels_per_tangent(size[1]);
        let across = (f64::from(x) + 0.5 - f64::from(size[0]) / 2.0) * scale;
        let down = (f64::from(y) + 0.5 - f64::from(size[1]) / 2.0) * scale;
        camera.position + right * across - up * down + forward * depth
    }
}

/// Triangles in a tree of boxes, to ask whether something is near.
pub struct Tree {
    triangles: Vec<([DVec3; 3], u32)>,
    /// Boxes by level: node k has children 2k+1 and 2k+2; leaves hold runs of triangles.
    boxes: Vec<[DVec3; 2]>,
    leaf_count: usize,
}

/// Triangles of a leaf, about.
const LEAF: usize = 4;

impl Tree {
    /// A tree over triangles; each keeps a label.
    pub fn new(positions: &[[f64; 3]], triangles: &[[u32; 3]], label: impl Fn(usize) -> u32) -> Self {
        let corners = |t: &[u32; 3]| t.map(|vertex| DVec3::from(positions[vertex as usize]));
        let mut triangles: Vec<([DVec3; 3], u32)> =
            triangles.iter().enumerate().map(|(number, t)| (corners(t), label(number))).collect();
        let leaf_count = triangles.len().div_ceil(LEAF).next_power_of_two().max(1);
        let mut boxes = vec![[DVec3::INFINITY, DVec3::NEG_INFINITY]; 2 * leaf_count - 1];
        arrange(&mut triangles, leaf_count, 0, &mut boxes);
        Self { triangles, boxes, leaf_count }
    }

    /// Whether a triangle lies within its own reach of a point.
    pub fn is_near(&self, point: DVec3, largest_reach: f64, reach: impl Fn(u32) -> f64) -> bool {
        let mut stack = vec![(0, 0, self.triangles.len(), self.leaf_count)];
        while let Some((node, from, to, leaves)) = stack.pop() {
            let [low, high] = self.boxes[node];
            if (point.clamp(low, high.max(low)) - point).length() > largest_reach || from == to {
                continue;
            }
            if leaves == 1 {
                let is_hit = |(corners, label): &([DVec3; 3], u32)| {
                    (closest_point(*corners, point) - point).length() <= reach(*label)
                };
                if self.triangles[from..to].iter().any(is_hit) {
                    return true;
                }
                continue;
            }
            let middle = from + (to - from) / 2;
            let children = [(2 * node + 1, from, middle, leaves / 2), (2 * node + 2, middle, to, leaves / 2)];
            let away =
                |child: usize| (point.clamp(self.boxes[child][0], self.boxes[child][1]) - point).length_squared();
            let nearest_last = away(children[0].0) < away(children[1].0);
            stack.extend(if nearest_last { [children[1], children[0]] } else { children });
        }
        false
    }
}

/// Halves triangles at the median of the longest axis, down to the leaves; fills in boxes.
fn arrange(triangles: &mut [([DVec3; 3], u32)], leaves: usize, node: usize, boxes: &mut [[DVec3; 2]]) {
    let points = || triangles.iter().flat_map(|(corners, _)| corners);
    let low = points().fold(DVec3::INFINITY, |a, &b| a.min(b));
    let high = points().fold(DVec3::NEG_INFINITY, |a, &b| a.max(b));
    // An empty box lies nowhere, and is never near.
    boxes[node] = if triangles.is_empty() { [DVec3::MAX; 2] } else { [low, high] };
    if leaves == 1 {
        return;
    }
    let axis = (high - low).max_position();
    let key = |(corners, _): &([DVec3; 3], u32)| (corners[0] + corners[1] + corners[2])[axis];
    let middle = triangles.len() / 2;
    if middle > 0 {
        triangles.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)));
    }
    let (first, second) = triangles.split_at_mut(middle);
    arrange(first, leaves / 2, 2 * node + 1, boxes);
    arrange(second, leaves / 2, 2 * node + 2, boxes);
}

/// The point of a triangle that is nearest to `p` (Ericson, Real-Time Collision Detection, 5.1.5).
fn closest_point([a, b, c]: [DVec3; 3], p: DVec3) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return a + ab * (d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum > 0.0 { a + ab * (vb / sum) + ac * (vc / sum) } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pixel_shows_what_lies_there() {
        let positions = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 1.0]];
        let camera =
            Camera { position: DVec3::new(0.1, 0.0, 5.0), ..Camera::around([[-1.0; 3], [1.0; 3]], DVec3::Y, 0.0, 0.0) };
        let map = DepthMap::new(&positions, &[[0, 1, 2]], &camera, [64, 48]);
        let tree = Tree::new(&positions, &[[0, 1, 2]], |_| 7);
        let seen: Vec<usize> = (0..map.depths.len()).filter(|&i| map.depths[i].is_finite()).collect();
        assert!(seen.len() > 100 && seen.len() < 64 * 48 / 2);
        for pixel in seen {
            let point = DepthMap::point(map.size, &camera, pixel, map.depths[pixel]);
            assert!(tree.is_near(point, 1e-9, |label| if label == 7 { 1e-9 } else { 0.0 }));
            assert!(!tree.is_near(point + DVec3::Z, 0.5, |_| 0.5));
        }
    }

    #[test]
    fn the_tree_agrees_with_looking_at_every_triangle() {
        let mut state = 1_u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let positions: Vec<[f64; 3]> = (0..60).map(|_| [next(), next(), next()]).collect();
        let triangles: Vec<[u32; 3]> = (0..39).map(|k| [k, (k * 7 + 3) % 60, (k * 13 + 5) % 60]).collect();
        let tree = Tree::new(&positions, &triangles, |_| 0);
        for _ in 0..300 {
            let point = DVec3::new(next(), next(), next());
            let distance =
                |t: &[u32; 3]| (closest_point(t.map(|v| DVec3::from(positions[v as usize])), point) - point).length();
            let least = triangles.iter().map(distance).fold(f64::INFINITY, f64::min);
            assert!(
                tree.is_near(point, least * 1.001, |_| least * 1.001) && !tree.is_near(point, 1.0, |_| least * 0.999)
            );
        }
    }
}
