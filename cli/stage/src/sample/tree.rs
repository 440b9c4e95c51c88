//! The full quadtrees of a chart, with the error that each cell would have, and the surface points on which errors are
//! measured.

use glam::{DVec2, DVec3};
use lodpack::write::grid::{GridCell, MAX_DEPTH, UNIT};

use super::border::BorderCandidates;
use crate::chart::ChartMesh;
use lodpack_mesh::NONE;

/// A cell with at most this many points is not split: it would follow single vertices.
const MIN_POINTS: u32 = 3;

/// A point of the surface and the area for which it stands. Vertices and centroids of triangles, weighted 1 : 9 per
/// corner and centroid, integrate quadratic functions over each triangle exactly.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfacePoint {
    pub position: DVec3,
    /// Unit normal; zero where the surface has none.
    pub normal: DVec3,
    pub weight: f64,
    pub quad: u16,
    /// Coordinates in its quad, 0 to [`UNIT`].
    pub at: DVec2,
}

/// A possible cell. Its points are a range of [`CellTree::points`].
#[derive(Clone, Copy, Debug)]
pub(super) struct TreeNode {
    pub cell: GridCell,
    /// Index of the first of four children; [`NONE`] if the cell cannot be split.
    pub children: u32,
    /// Integral of the squared distance between the surface and the plane that fits it best.
    pub error: f64,
}

/// All cells of a chart that may be drawn. Parents come before children, and the first nodes are the quads.
#[derive(Clone, Debug, Default)]
pub struct CellTree {
    pub(super) nodes: Vec<TreeNode>,
    pub(super) points: Vec<SurfacePoint>,
    /// Area of the chart.
    pub(super) area: f64,
    /// Number of quads. There are none if a side lacks the sample at its middle.
    pub(super) side_count: usize,
}

impl CellTree {
    /// Measures all cells, down to those whose squared error is below `negligible_error` squared times their area.
    pub fn new(chart: &ChartMesh, uv: &[DVec2], negligible_error: f64) -> Self {
        let border = BorderCandidates::new(chart);
        let side_count = border.side_count();
        let mut tree = Self { side_count, ..Self::default() };
        if side_count < 3 {
            return tree;
        }
        tree.points = surface_points(chart, uv, side_count);
        tree.area = tree.points.iter().map(|p| p.weight).sum();
        if !border.has_all_middles() {
            return tree;
        }
        let (keys, order) = order_points(&tree.points);
        tree.points = order.iter().map(|&i| tree.points[i as usize]).collect();
        let moments = Moments::sums(&tree.points, chart.positions.first().copied().unwrap_or_default());
        let mut ranges: Vec<[u32; 2]> = vec![];
        let add = |nodes: &mut Vec<TreeNode>, ranges: &mut Vec<[u32; 2]>, cell, range: [u32; 2]| {
            let error = moments[range[1] as usize].minus(&moments[range[0] as usize]).squared_distance_to_plane();
            nodes.push(TreeNode { cell, children: NONE, error });
            ranges.push(range);
        };
        let find = |range: [u32; 2], key: u64| {
            range[0] + keys[range[0] as usize..range[1] as usize].partition_point(|&k| k < key) as u32
        };
        let all = [0, keys.len() as u32];
        for quad in 0..side_count {
            let range = [find(all, (quad as u64) << 32), find(all, (quad as u64 + 1) << 32)];
            add(&mut tree.nodes, &mut ranges, GridCell { quad: quad as u16, depth: 0, x: 0, y: 0 }, range);
        }
        let mut index = 0;
        while index < tree.nodes.len() {
            let (node, range) = (tree.nodes[index], ranges[index]);
            let cell = node.cell;
            let weight = moments[range[1] as usize].weight - moments[range[0] as usize].weight;
            let worth_splitting = range[1] - range[0] > MIN_POINTS
                && node.error > negligible_error * negligible_error * weight
                && cell.depth < MAX_DEPTH
                && border.can_split(cell);
            if worth_splitting {
                tree.nodes[index].children = tree.nodes.len() as u32;
                let shift = 2 * (15 - cell.depth as u32 - 1);
                let first = (cell.quad as u64) << 32 | interleave(cell.x as u32, cell.y as u32);
                let cuts: [u32; 5] = std::array::from_fn(|k| match k {
                    0 => range[0],
                    4 => range[1],
                    _ => find(range, first + ((k as u64) << shift)),
                });
                // Morton order is left, right, upper left, upper right, but children go around.
                for (child, k) in cell.children().into_iter().zip([0, 1, 3, 2]) {
                    add(&mut tree.nodes, &mut ranges, child, [cuts[k], cuts[k + 1]]);
                }
            }
            index += 1;
        }
        tree
    }

    /// Multiplies the error of all cells that contain any of these points of the polygon, each cell once. Where a grid
    /// exceeded its tolerance, it is then split deeper at the same price.
    pub fn amplify(&mut self, points: &[DVec2], factor: f64) {
        let mut is_hit = vec![false; self.nodes.len()];
        for &point in points {
            let (quad, s, t) = crate::embed::quad_coordinates(self.side_count, point);
            let at = DVec2::new(s, t) * UNIT as f64;
            let mut index = quad;
            while let Some(node) = self.nodes.get(index) {
                is_hit[index] = true;
                if node.children == NONE {
                    break;
                }
                let half = node.cell.size() / 2;
                let right = at.x >= (node.cell.x as u32 + half) as f64;
                let upper = at.y >= (node.cell.y as u32 + half) as f64;
                // Children go around from the smallest coordinates.
                index = node.children as usize + if upper { 3 - right as usize } else { right as usize };
            }
        }
        for (node, _) in self.nodes.iter_mut().zip(is_hit).filter(|(_, hit)| *hit) {
            node.error *= factor;
        }
    }

    /// Area of the chart, in squared input units.
    pub fn area(&self) -> f64 {
        self.area
    }
}

/// The vertices and centroids of a chart with their quad coordinates.
pub(super) fn surface_points(chart: &ChartMesh, uv: &[DVec2], side_count: usize) -> Vec<SurfacePoint> {
    let mut weight = vec![0.0; chart.positions.len()];
    let mut normal = vec![DVec3::ZERO; chart.positions.len()];
    let mut points = Vec::with_capacity(chart.positions.len() + chart.triangles.len());
    let mut push = |position, normal: DVec3, weight, uv| {
        let (quad, s, t) = crate::embed::quad_coordinates(side_count, uv);
        let at = DVec2::new(s, t) * UNIT as f64;
        points.push(SurfacePoint { position, normal: normal.normalize_or_zero(), weight, quad: quad as u16, at });
    };
    for triangle in &chart.triangles {
        let [a, b, c] = triangle.map(|v| chart.positions[v as usize]);
        let cross = (b - a).cross(c - a);
        let area = 0.5 * cross.length();
        for &v in triangle {
            weight[v as usize] += area / 12.0;
            normal[v as usize] += cross;
        }
        let [ua, ub, uc] = triangle.map(|v| uv[v as usize]);
        push((a + b + c) / 3.0, cross, 0.75 * area, (ua + ub + uc) / 3.0);
    }
    for v in 0..chart.positions.len() {
        push(chart.positions[v], normal[v], weight[v], uv[v]);
    }
    points
}

/// Spreads the 15 low bits of both numbers to the even and the odd bits.
fn interleave(x: u32, y: u32) -> u64 {
    let spread = |v: u32| {
        let v = (v | v << 8) & 0x00ff_00ff;
        let v = (v | v << 4) & 0x0f0f_0f0f;
        let v = (v | v << 2) & 0x3333_3333;
        ((v | v << 1) & 0x5555_5555) as u64
    };
    spread(x) | spread(y) << 1
}

/// The points in quad and Morton order: keys and indices.
fn order_points(points: &[SurfacePoint]) -> (Vec<u64>, Vec<u32>) {
    let key = |p: &SurfacePoint| {
        let at = p.at.clamp(DVec2::ZERO, DVec2::splat((UNIT - 1) as f64));
        (p.quad as u64) << 32 | interleave(at.x as u32, at.y as u32)
    };
    let mut keyed: Vec<(u64, u32)> = points.iter().enumerate().map(|(i, p)| (key(p), i as u32)).collect();
    keyed.sort_unstable();
    keyed.into_iter().unzip()
}

/// Weighted sums of 1, p and p p^T, relative to a point of the chart.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f64,
    first: DVec3,
    /// xx, yy, zz and yz, zx, xy.
    square: DVec3,
    product: DVec3,
}

impl Moments {
    /// Sums over the first 0, 1, 2, ... points, so the sum over a range is a difference.
    fn sums(points: &[SurfacePoint], origin: DVec3) -> Vec<Self> {
        let mut sum = Self::default();
        let mut sums = vec![sum];
        sums.extend(points.iter().map(|point| {
            let p = point.position - origin;
            sum.weight += point.weight;
            sum.first += point.weight * p;
            sum.square += point.weight * p * p;
            sum.product += point.weight * DVec3::new(p.y * p.z, p.z * p.x, p.x * p.y);
            sum
        }));
        sums
    }

    fn minus(&self, other: &Self) -> Self {
        Self {
            weight: self.weight - other.weight,
            first: self.first - other.first,
            square: self.square - other.square,
            product: self.product - other.product,
        }
    }

    /// The smallest eigenvalue of the covariance, times the weight.
    fn squared_distance_to_plane(&self) -> f64 {
        if self.weight <= 0.0 {
            return 0.0;
        }
        let m = self.first / self.weight;
        let d = self.square - self.first * m;
        // Products of the mean: yz, zx, xy.
        let o = self.product - self.weight * DVec3::new(m.y * m.z, m.z * m.x, m.x * m.y);
        // Newton's method on the characteristic polynomial, started at zero, climbs to its smallest root without
        // overshooting.
        let c2 = d.x + d.y + d.z;
        let c1 = d.x * d.y + d.y * d.z + d.z * d.x - o.length_squared();
        let c0 = d.x * d.y * d.z + 2.0 * o.x * o.y * o.z - d.dot(o * o);
        let mut root = 0.0;
        for _ in 0..12 {
            let value = c0 - root * (c1 - root * (c2 - root));
            let slope = c1 - root * (2.0 * c2 - 3.0 * root);
            if value <= 0.0 || slope <= 0.0 {
                break;
            }
            root += value / slope;
        }
        root
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moments(points: &[[f64; 3]]) -> Moments {
        let point = |p: &[f64; 3]| SurfacePoint {
            position: DVec3::from(*p),
            normal: DVec3::ZERO,
            weight: 2.0,
            quad: 0,
            at: DVec2::ZERO,
        };
        let points: Vec<_> = points.iter().map(point).collect();
        *Moments::sums(&points, DVec3::new(0.5, 0.25, 0.125)).last().unwrap()
    }

    #[test]
    fn points_of_a_tilted_plane_have_no_distance_to_their_plane() {
        let plane: Vec<[f64; 3]> =
            (0..50).map(|i| (i as f64, (i * i % 17) as f64)).map(|(x, y)| [x, y, 2.0 * x - y]).collect();
        assert!(moments(&plane).squared_distance_to_plane() < 1e-9);
    }

    #[test]
    fn two_sheets_lie_half_their_distance_from_the_best_plane() {
        let sheets: Vec<[f64; 3]> =
            (0..200).map(|i| [(i / 2 % 10) as f64, (i / 20) as f64, if i % 2 == 0 { 0.5 } else { -0.5 }]).collect();
        assert!((moments(&sheets).squared_distance_to_plane() - 2.0 * 200.0 * 0.25).abs() < 1e-9);
    }

    #[test]
    fn morton_keys_order_cells_as_quadrants() {
        assert_eq!([interleave(0, 0), interleave(1, 0), interleave(0, 1), interleave(1, 1)], [0, 1, 2, 3]);
        assert_eq!(interleave(0x7fff, 0), 0x1555_5555);
    }
}
