//! Sparse least squares over displacements of vertices: symmetric 3 x 3 blocks on vertices and edges, solved by
//! conjugate gradients.

use glam::DVec3;

/// A symmetric matrix: xx, yy, zz and yz, zx, xy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Symmetric {
    diagonal: DVec3,
    off: DVec3,
}

impl Symmetric {
    /// `across` n n^T + `within` (1 - n n^T), for a unit vector n.
    pub fn along(n: DVec3, across: f64, within: f64) -> Self {
        let s = across - within;
        Self { diagonal: s * n * n + DVec3::splat(within), off: s * DVec3::new(n.y * n.z, n.z * n.x, n.x * n.y) }
    }

    fn add_scaled(&mut self, other: &Self, factor: f64) {
        self.diagonal += factor * other.diagonal;
        self.off += factor * other.off;
    }

    /// The product with a vector.
    pub fn times(&self, v: DVec3) -> DVec3 {
        let o = self.off;
        self.diagonal * v + DVec3::new(o.z * v.y + o.y * v.z, o.z * v.x + o.x * v.z, o.y * v.x + o.x * v.y)
    }

    /// The inverse; if the matrix is nearly singular, the inverse of its diagonal.
    fn inverse(&self) -> Self {
        let (d, o) = (self.diagonal, self.off);
        let minors = DVec3::new(d.y * d.z - o.x * o.x, d.z * d.x - o.y * o.y, d.x * d.y - o.z * o.z);
        let others = DVec3::new(o.y * o.z - d.x * o.x, o.z * o.x - d.y * o.y, o.x * o.y - d.z * o.z);
        let determinant = d.x * minors.x + o.z * others.z + o.y * others.y;
        if determinant > 1e-12 * d.x * d.y * d.z {
            Self { diagonal: minors / determinant, off: others / determinant }
        } else {
            Self { diagonal: DVec3::ONE / d.max(DVec3::splat(f64::MIN_POSITIVE)), off: DVec3::ZERO }
        }
    }
}

/// The normal equations of a sum of squares.
#[derive(Clone, Debug, Default)]
pub struct System {
    diagonal: Vec<Symmetric>,
    right: Vec<DVec3>,
    /// First edge of each vertex, with the edge count at the end. An edge belongs to its smaller vertex.
    first: Vec<u32>,
    other: Vec<u32>,
    blocks: Vec<Symmetric>,
}

impl System {
    /// An empty system. Its terms may join the pairs in `pairs` whose vertices are below `vertex_count`.
    pub fn new(vertex_count: usize, pairs: impl Iterator<Item = [u32; 2]> + Clone) -> Self {
        let ordered = pairs.filter(|p| p[0] != p[1]).map(|p| [p[0].min(p[1]), p[0].max(p[1])]);
        let mut start = vec![0u32; vertex_count + 1];
        ordered.clone().for_each(|p| start[p[0] as usize + 1] += 1);
        for v in 0..vertex_count {
            start[v + 1] += start[v];
        }
        let mut slot = start.clone();
        let mut all = vec![0u32; start[vertex_count] as usize];
        ordered.for_each(|p| {
            all[slot[p[0] as usize] as usize] = p[1];
            slot[p[0] as usize] += 1;
        });
        let (mut first, mut other) = (vec![0u32], vec![]);
        for v in 0..vertex_count {
            let row = &mut all[start[v] as usize..start[v + 1] as usize];
            row.sort_unstable();
            let begin = other.len();
            for &mut w in row {
                if other.len() == begin || other.last() != Some(&w) {
                    other.push(w);
                }
            }
            first.push(other.len() as u32);
        }
        Self {
            diagonal: vec![Symmetric::default(); vertex_count],
            right: vec![DVec3::ZERO; vertex_count],
            blocks: vec![Symmetric::default(); other.len()],
            first,
            other,
        }
    }

    /// Adds (r - sum b_k x_k)^T G (r - sum b_k x_k). Vertices from the vertex count on are fixed: their x is zero.
    pub fn add(&mut self, vertices: [u32; 3], b: DVec3, g: &Symmetric, r: DVec3) {
        let force = g.times(r);
        let count = self.diagonal.len() as u32;
        for k in 0..3 {
            let v = vertices[k];
            if v >= count || b[k] == 0.0 {
                continue;
            }
            self.diagonal[v as usize].add_scaled(g, b[k] * b[k]);
            self.right[v as usize] += b[k] * force;
            for m in k + 1..3 {
                let w = vertices[m];
                if w < count && b[m] != 0.0 {
                    let (low, high) = (v.min(w), v.max(w));
                    let row = self.first[low as usize] as usize..self.first[low as usize + 1] as usize;
                    if let Some(index) = self.other[row.clone()].iter().position(|&o| o == high) {
                        self.blocks[row.start + index].add_scaled(g, b[k] * b[m]);
                    }
                }
            }
        }
    }

    /// Adds `weight` |x|^2 for every vertex.
    pub fn hold(&mut self, weight: f64) {
        for d in &mut self.diagonal {
            d.diagonal += weight;
        }
    }

    fn times(&self, x: &[DVec3], y: &mut [DVec3]) {
        for (y, (d, &x)) in y.iter_mut().zip(self.diagonal.iter().zip(x)) {
            *y = d.times(x);
        }
        for v in 0..x.len() {
            let mut sum = DVec3::ZERO;
            for e in self.first[v] as usize..self.first[v + 1] as usize {
                let w = self.other[e] as usize;
                sum += self.blocks[e].times(x[w]);
                y[w] += self.blocks[e].times(x[v]);
            }
            y[v] += sum;
        }
    }

    /// Minimises approximately, from zero, by conjugate gradients with the inverted vertex blocks as preconditioner.
    pub fn solve(&self, iterations: usize) -> Vec<DVec3> {
        let n = self.diagonal.len();
        let inverse: Vec<Symmetric> = self.diagonal.iter().map(Symmetric::inverse).collect();
        let mut x = vec![DVec3::ZERO; n];
        let mut r = self.right.clone();
        let mut p: Vec<DVec3> = inverse.iter().zip(&r).map(|(m, &r)| m.times(r)).collect();
        let mut ap = vec![DVec3::ZERO; n];
        let mut rz: f64 = r.iter().zip(&p).map(|(r, p)| r.dot(*p)).sum();
        let goal = rz * 1e-6;
        for _ in 0..iterations {
            if rz <= goal || rz <= 0.0 {
                break;
            }
            self.times(&p, &mut ap);
            let curvature: f64 = p.iter().zip(&ap).map(|(p, ap)| p.dot(*ap)).sum();
            if curvature <= 0.0 {
                break;
            }
            let step = rz / curvature;
            let mut next = 0.0;
            for v in 0..n {
                x[v] += step * p[v];
                r[v] -= step * ap[v];
                next += r[v].dot(inverse[v].times(r[v]));
            }
            let turn = next / rz;
            rz = next;
            for v in 0..n {
                p[v] = inverse[v].times(r[v]) + turn * p[v];
            }
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_system_is_solved_up_to_its_tolerance() {
        // Points on a plane, with vertex 3 fixed: the free vertices must move onto the targets that generated the
        // residuals.
        let target = [DVec3::new(1.0, 0.0, 2.0), DVec3::new(0.0, -1.0, 1.0), DVec3::new(0.5, 0.25, 0.0)];
        let triangles = [[0, 1, 2], [1, 3, 2], [0, 2, 3]];
        let pairs = triangles.iter().flat_map(|t: &[u32; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
        let mut system = System::new(3, pairs.filter(|p| p[0] < 3 && p[1] < 3));
        for (i, t) in triangles.iter().enumerate() {
            for j in 0..9 {
                let b = DVec3::new(0.2 + 0.05 * j as f64, 0.5 - 0.03 * (j * j % 7) as f64, 0.0);
                let b = DVec3::new(b.x, b.y, 1.0 - b.x - b.y);
                let r = (0..3).filter(|&k| t[k] < 3).map(|k| b[k] * target[t[k] as usize]).sum();
                let n = DVec3::new(i as f64 - 1.0, j as f64 - 4.0, 2.0).normalize();
                system.add(*t, b, &Symmetric::along(n, 1.0, 0.1), r);
            }
        }
        for (x, t) in system.solve(60).iter().zip(target) {
            assert!(x.distance(t) < 1e-2, "{x} {t}");
        }
    }

    #[test]
    fn inverses_multiply_to_the_identity() {
        let mut m = Symmetric::along(DVec3::new(1.0, 2.0, 3.0).normalize(), 5.0, 0.5);
        m.add_scaled(&Symmetric::along(DVec3::new(-2.0, 1.0, 0.3).normalize(), 2.0, 0.0), 1.0);
        for v in [DVec3::X, DVec3::Y, DVec3::Z] {
            assert!(m.times(m.inverse().times(v)).distance(v) < 1e-12);
        }
    }
}
