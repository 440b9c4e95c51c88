//! Convex polygons in space: the parts into which triangles are divided.

use glam::DVec3;

/// The most corners of a polygon.
const CAPACITY: usize = 12;

/// A flat convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    corners: [DVec3; CAPACITY],
    count: usize,
}

impl Polygon {
    pub fn triangle([a, b, c]: [DVec3; 3]) -> Self {
        let mut polygon = Self::empty();
        [a, b, c].into_iter().for_each(|p| polygon.push(p));
        polygon
    }

    fn empty() -> Self {
        Self { corners: [DVec3::ZERO; CAPACITY], count: 0 }
    }

    fn push(&mut self, p: DVec3) {
        self.corners[self.count] = p;
        self.count += 1;
    }

    pub fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Whether it can be cut that often. Each cut adds at most one corner.
    pub fn can_be_cut(&self, times: usize) -> bool {
        self.count + times <= CAPACITY
    }

    /// A point of the polygon, and the radius of a ball around it that contains the polygon.
    pub fn ball(&self) -> (DVec3, f64) {
        let centre = self.corners().iter().sum::<DVec3>() / self.count as f64;
        let square = self.corners().iter().map(|p| p.distance_squared(centre)).fold(0.0, f64::max);
        (centre, square.sqrt() * (1.0 + 1e-12))
    }

    /// The part between two corners. If `last` is `count`, it stands for the first corner.
    fn run(&self, first: usize, last: usize) -> Self {
        let mut part = Self::empty();
        (first..=last).for_each(|i| part.push(self.corners[i % self.count]));
        part
    }

    /// The parts behind and in front of the plane through `point`; `None` for a part without extent. The parts share
    /// the points on the plane, bit for bit. A polygon that is in front of the plane by at most `slack`, relative to
    /// the length of `normal`, counts as behind it.
    pub fn cut(&self, point: DVec3, normal: DVec3, slack: f64) -> [Option<Self>; 2] {
        let mut heights = [0.0; CAPACITY];
        let (mut low, mut high) = (0.0f64, 0.0f64);
        for (height, &p) in heights.iter_mut().zip(self.corners()) {
            *height = (p - point).dot(normal);
            (low, high) = (low.min(*height), high.max(*height));
        }
        if high <= slack {
            return [Some(*self), None];
        }
        if low >= 0.0 {
            return [None, Some(*self)];
        }
        let mut parts = [Self::empty(); 2];
        for i in 0..self.count {
            let next = (i + 1) % self.count;
            let (a, b) = (heights[i], heights[next]);
            if a <= 0.0 {
                parts[0].push(self.corners[i]);
            }
            if a >= 0.0 {
                parts[1].push(self.corners[i]);
            }
            if a < 0.0 && b > 0.0 || a > 0.0 && b < 0.0 {
                let crossing = self.corners[i] + (self.corners[next] - self.corners[i]) * (a / (a - b));
                parts.iter_mut().for_each(|part| part.push(crossing));
            }
        }
        parts.map(Some)
    }

    /// Two parts, divided across the direction from the middle to the farthest corner; along a diagonal if there is no
    /// room for the corners of a cut.
    pub fn halves(&self) -> [Option<Self>; 2] {
        if !self.can_be_cut(1) {
            let middle = self.count / 2;
            return [self.run(0, middle), self.run(middle, self.count)].map(Some);
        }
        let (centre, _) = self.ball();
        let farther = |a: DVec3, b: DVec3| if b.length_squared() > a.length_squared() { b } else { a };
        let axis = self.corners().iter().map(|&p| p - centre).fold(DVec3::ZERO, farther);
        self.cut(centre, axis, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &Polygon) -> f64 {
        let c = polygon.corners();
        c.windows(2).map(|w| (w[0] - c[0]).cross(w[1] - c[0]).z * 0.5).sum()
    }

    #[test]
    fn parts_make_up_the_whole() {
        let whole = Polygon::triangle([DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 2.0]);
        let mut polygons = vec![whole];
        for i in 0..5 {
            let normal = DVec3::new(f64::from(i).sin(), f64::from(i).cos(), 0.0);
            polygons = polygons.iter().flat_map(|p| p.cut(DVec3::new(0.7, 0.6, 0.0), normal, 0.0)).flatten().collect();
            polygons = polygons.iter().flat_map(|p| p.halves()).flatten().collect();
        }
        assert!(polygons.len() > 100);
        assert!((polygons.iter().map(area).sum::<f64>() - 3.0).abs() < 1e-12);
        assert!(polygons.iter().all(|p| area(p) >= 0.0 && p.corners().len() <= CAPACITY));
    }

    #[test]
    fn polygons_with_the_most_corners_can_be_divided() {
        // All corners but one are so near to each other that a cut across the middle would leave that one alone.
        let mut whole = Polygon::empty();
        whole.push(DVec3::X * 100.0);
        for i in 1..CAPACITY as i32 {
            let angle = f64::from(i) / CAPACITY as f64 * std::f64::consts::TAU;
            whole.push(DVec3::new(angle.cos(), angle.sin(), 0.0));
        }
        let parts = whole.halves().map(|part| part.expect("a substantial part"));
        assert!(parts.iter().all(|part| area(part) > 0.0 && part.can_be_cut(1)));
        assert!((parts.iter().map(area).sum::<f64>() - area(&whole)).abs() < 1e-12);
    }

    #[test]
    fn a_plane_beside_a_polygon_leaves_it_whole() {
        let whole = Polygon::triangle([DVec3::ZERO, DVec3::X, DVec3::Y]);
        let [behind, before] = whole.cut(DVec3::X * 0.9, DVec3::X, 0.1);
        assert!(behind.is_some_and(|p| p.corners() == whole.corners()) && before.is_none());
        let [behind, before] = whole.cut(DVec3::ZERO, DVec3::X, 0.1);
        assert!(behind.is_none() && before.is_some());
        assert_eq!(whole.ball().0, (DVec3::X + DVec3::Y) / 3.0);
    }
}
