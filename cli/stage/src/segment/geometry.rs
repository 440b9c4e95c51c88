//! Measures of triangles in normalised coordinates: the mesh becomes two units wide, so coordinates of any size neither
//! overflow nor underflow.

use glam::DVec3;
use lodpack_mesh::Mesh;

/// Maps input positions to about -1..1.
pub(super) struct Normaliser {
    centre: DVec3,
    scale: f64,
}

/// The measures of a triangle, in normalised coordinates.
#[derive(Clone, Copy, Default)]
pub(super) struct Facet {
    pub centroid: DVec3,
    /// Normal of the triangle, whose length is the area; zero for a degenerate triangle.
    pub area_vector: DVec3,
    pub area: f64,
    /// Square root of the area.
    pub size: f64,
}

impl Normaliser {
    pub fn new(mesh: &Mesh) -> Self {
        let [low, high] = mesh.bounds();
        // Halved first, because the difference of two huge coordinates could overflow.
        let half = high * 0.5 - low * 0.5;
        Self { centre: low * 0.5 + high * 0.5, scale: 1.0 / half.max_element().max(f64::MIN_POSITIVE) }
    }

    pub fn normalise(&self, position: DVec3) -> DVec3 {
        (position - self.centre) * self.scale
    }

    pub fn facet(&self, mesh: &Mesh, triangle: u32) -> Facet {
        let [a, b, c] = mesh.corners(triangle).map(|p| self.normalise(p));
        let area_vector = (b - a).cross(c - a) * 0.5;
        let area = area_vector.length();
        Facet { centroid: (a + b + c) * (1.0 / 3.0), area_vector, area, size: area.sqrt() }
    }

    /// Length of a half-edge, normalised.
    pub fn edge_length(&self, mesh: &Mesh, half_edge: u32) -> f64 {
        let t = mesh.triangles[half_edge as usize / 3];
        let k = half_edge as usize % 3;
        let (a, b) = (mesh.positions[t[k] as usize], mesh.positions[t[(k + 1) % 3] as usize]);
        self.normalise(a).distance(self.normalise(b))
    }
}

/// 1 - cos of the angle between two directions of any length: 0 (equal) to 2 (opposed); 0 if either is unknown.
pub(super) fn bend(a: DVec3, b: DVec3) -> f64 {
    bend_of(a.dot(b), (a.length_squared() * b.length_squared()).sqrt())
}

/// 1 - cos of the angle between the normals of two triangles.
pub(super) fn bend_between(a: &Facet, b: &Facet) -> f64 {
    bend_of(a.area_vector.dot(b.area_vector), a.area * b.area)
}

fn bend_of(dot: f64, lengths: f64) -> f64 {
    if lengths > 0.0 { (1.0 - dot / lengths).clamp(0.0, 2.0) } else { 0.0 }
}

/// How much of a crease a bend is: 0 below 26 degrees (scan noise), 1 from 60 degrees on.
pub(super) fn creaseness(bend: f64) -> f64 {
    ((bend - 0.1) * 2.5).clamp(0.0, 1.0)
}

/// Distance of two neighbours in units of the size of their triangles, clamped to a range that tolerates slivers.
pub(super) fn relative_distance(distance: f64, size_a: f64, size_b: f64) -> f64 {
    let size = size_a + size_b;
    if size > 0.0 { (2.0 * distance / size).clamp(0.05, 50.0) } else { 1.0 }
}
