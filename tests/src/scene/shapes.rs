//! Surfaces of revolution, tubes and bars, all closed, with triangles that turn counterclockwise seen from outside.

use std::f64::consts::TAU;

use glam::DVec3;

use super::Shape;
use crate::parts::add_box_to;

impl Shape {
    /// An empty one.
    pub fn new(colour: usize) -> Self {
        Self { colour, ..Self::default() }
    }

    /// Adds what a loop of (radius, height) encloses, turned around the z axis. The loop turns counterclockwise with
    /// radii to the right and heights upward, and has radii above 0.
    pub fn revolve(&mut self, outline: &[[f64; 2]], sides: u32) {
        let rings: Vec<Vec<DVec3>> = outline.iter().map(|&[radius, z]| ring(sides, radius, z)).collect();
        self.join(&rings, true);
    }

    /// Adds a tube along a path, with flat ends.
    pub fn tube(&mut self, path: &[DVec3], radius: impl Fn(usize) -> f64, sides: u32) {
        let Some(direction) = path.get(1).map(|second| (*second - path[0]).normalize()) else { return };
        let mut beside = direction.any_orthonormal_vector();
        let rings: Vec<Vec<DVec3>> = (0..path.len())
            .map(|k| {
                let along = (path[(k + 1).min(path.len() - 1)] - path[k.saturating_sub(1)]).normalize();
                beside = (beside - along * beside.dot(along)).normalize();
                let other = along.cross(beside);
                let point = |at: DVec3| path[k] + (beside * at.x + other * at.y) * radius(k);
                ring(sides, 1.0, 0.0).into_iter().map(point).collect()
            })
            .collect();
        let first = self.join(&rings, false);
        let last = first + (path.len() as u32 - 1) * sides;
        for (start, centre, is_end) in [(first, path[0], false), (last, path[path.len() - 1], true)] {
            let middle = self.positions.len() as u32;
            self.positions.push(centre);
            self.triangles.extend((0..sides).map(|k| {
                let [a, b] = [start + k, start + (k + 1) % sides];
                if is_end { [a, b, middle] } else { [b, a, middle] }
            }));
        }
    }

    /// Adds a box with sides along the axes.
    pub fn cuboid(&mut self, low: DVec3, size: DVec3) {
        add_box_to(&mut self.positions, &mut self.triangles, low, size);
    }

    /// Moves what was added since the mesh had `first` vertices.
    pub fn move_since(&mut self, first: usize, by: impl Fn(DVec3) -> DVec3) {
        self.positions[first..].iter_mut().for_each(|position| *position = by(*position));
    }

    /// Joins rings of equal size, each to the next one, and the last one to the first if they are a loop. Returns the
    /// number of the first vertex.
    fn join(&mut self, rings: &[Vec<DVec3>], is_loop: bool) -> u32 {
        let (first, sides) = (self.positions.len() as u32, rings[0].len() as u32);
        self.positions.extend(rings.iter().flatten());
        let count = rings.len() as u32;
        for k in 0..if is_loop { count } else { count - 1 } {
            let [below, above] = [k, (k + 1) % count].map(|ring| first + ring * sides);
            self.triangles.extend((0..sides).flat_map(|i| {
                let j = (i + 1) % sides;
                [[below + i, below + j, above + j], [below + i, above + j, above + i]]
            }));
        }
        first
    }
}

fn ring(sides: u32, radius: f64, z: f64) -> Vec<DVec3> {
    let angles = (0..sides).map(|k| f64::from(k) / f64::from(sides) * TAU);
    angles.map(|angle| DVec3::new(radius * angle.cos(), radius * angle.sin(), z)).collect()
}

/// A pipe along z from 0.
pub fn pipe(radius: f64, length: f64, colour: usize) -> Shape {
    let (inner, mut shape) = (radius * 0.9, Shape::new(colour));
    shape.revolve(&[[inner, 0.0], [radius, 0.0], [radius, length], [inner, length]], 24);
    shape
}

/// A quarter or less of a ring, which begins at the origin along z and bends to x.
pub fn elbow(radius: f64, bend: f64, angle: f64, colour: usize) -> Shape {
    let steps = (angle * 8.0).ceil().max(2.0) as u32;
    let mut shape = Shape::new(colour);
    let path: Vec<DVec3> = (0..=steps)
        .map(|k| f64::from(k) / f64::from(steps) * angle)
        .map(|turned| DVec3::new(bend * (1.0 - turned.cos()), 0.0, bend * turned.sin()))
        .collect();
    shape.tube(&path, |_| radius, 24);
    shape
}

/// A ring with a collar, around z.
pub fn flange(radius: f64, thickness: f64) -> Shape {
    let (inner, outer, collar) = (radius * 0.9, radius * 1.7 + 0.02, radius * 1.15);
    let top = thickness * 2.5;
    let mut shape = Shape::new(0);
    let outline = [[inner, 0.0], [outer, 0.0], [outer, thickness], [collar, thickness], [collar, top], [inner, top]];
    shape.revolve(&outline, 32);
    shape
}

/// A bolt along z: a head with six sides, a washer and a shaft.
pub fn bolt(radius: f64, length: f64) -> Shape {
    let mut shape = Shape::new(1);
    let straight = |from: f64, to: f64| [DVec3::new(0.0, 0.0, from), DVec3::new(0.0, 0.0, to)];
    shape.tube(&straight(-length, 0.0), |_| radius, 12);
    shape.tube(&straight(0.05 * radius, 0.35 * radius), |_| 2.2 * radius, 16);
    shape.tube(&straight(0.4 * radius, 1.8 * radius), |_| 1.8 * radius, 6);
    shape
}

/// A valve along z with a wheel to the side of x.
pub fn valve(radius: f64, length: f64, wheel: f64) -> Shape {
    let mut shape = Shape::new(2);
    let bulge = |t: f64| radius * (1.0 + 0.9 * (t * std::f64::consts::PI).sin().powi(2));
    let outer = (0..=12).map(|k| f64::from(k) / 12.0).map(|t| [bulge(t), t * length]);
    let outline: Vec<[f64; 2]> = outer.chain([[radius * 0.8, length], [radius * 0.8, 0.0]]).collect();
    shape.revolve(&outline, 24);
    let middle = length / 2.0;
    let stem = [DVec3::new(radius, 0.0, middle), DVec3::new(radius + wheel, 0.0, middle)];
    shape.tube(&stem, |_| radius * 0.2, 12);
    let first = shape.positions.len();
    let around = (0..8).map(|k| f64::from(k) / 8.0 * TAU);
    let rim: Vec<[f64; 2]> =
        around.map(|angle| [wheel + 0.15 * radius * angle.cos(), 0.15 * radius * angle.sin()]).collect();
    shape.revolve(&rim, 24);
    shape.move_since(first, |p| DVec3::new(radius + wheel + p.z, p.y, middle - p.x));
    shape
}

/// A tray for cables along x: a floor, two sides, and rungs.
pub fn tray(length: f64, width: f64, height: f64) -> Shape {
    let mut shape = Shape::new(1);
    for y in [0.0, width] {
        shape.cuboid(DVec3::new(0.0, y, 0.0), DVec3::new(length, 0.003, height));
    }
    let count = (length / 0.3).ceil() as u32;
    for k in 0..count {
        let x = (f64::from(k) + 0.5) * length / f64::from(count);
        shape.cuboid(DVec3::new(x - 0.015, 0.004, 0.01), DVec3::new(0.03, width - 0.005, 0.004));
    }
    shape
}

/// A grating in a frame, on the plane of x and y.
pub fn grating(length: f64, width: f64, bars: u32) -> Shape {
    let mut shape = Shape::new(1);
    for y in [0.0, width - 0.005] {
        shape.cuboid(DVec3::new(0.0, y, 0.0), DVec3::new(length, 0.005, 0.03));
    }
    for k in 0..bars {
        let x = (f64::from(k) + 0.5) * length / f64::from(bars);
        shape.cuboid(DVec3::new(x - 0.002, 0.006, 0.001), DVec3::new(0.004, width - 0.012, 0.028));
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn volume(shape: &Shape) -> f64 {
        let corners = shape.triangles.iter().map(|corners| corners.map(|v| shape.positions[v as usize]));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    #[test]
    fn parts_are_closed_and_face_outward() {
        let parts = [
            pipe(0.1, 2.0, 0),
            elbow(0.1, 0.4, 1.5, 0),
            flange(0.1, 0.02),
            bolt(0.01, 0.05),
            valve(0.1, 0.5, 0.2),
            tray(3.0, 0.3, 0.06),
            grating(1.0, 0.6, 30),
        ];
        for part in parts {
            let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
            for [a, b, c] in &part.triangles {
                for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
                    *edges.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
                }
            }
            assert!(edges.values().all(|&sum| sum == 0));
            assert!(volume(&part) > 0.0);
        }
        let [pipe, ideal] =
            [volume(&pipe(0.1, 2.0, 0)), 2.0 * std::f64::consts::PI * (0.1_f64.powi(2) - 0.09_f64.powi(2))];
        assert!((pipe / ideal - 1.0).abs() < 0.02, "{pipe} {ideal}");
    }
}
