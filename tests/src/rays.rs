//! Rays through generated scenes, by brute force: what the queries of the reader are compared with.

use glam::DVec3;

use crate::scene::Scene;

/// An object of the input, with y up.
pub struct Object {
    /// Of the scene.
    pub node: u32,
    /// In world space.
    pub triangles: Vec<[DVec3; 3]>,
    /// A box around them.
    pub bounds: [DVec3; 2],
}

/// What a ray met: how far away, and the node.
pub type Hit = Option<(f64, u32)>;

/// The objects of a scene in world space, as a GLB of it has them.
pub fn placed(scene: &Scene) -> Vec<Object> {
    let to_world = scene.in_world();
    let object = |(node, to): (usize, &glam::DAffine3)| {
        let shape = &scene.shapes[scene.nodes[node].shape? as usize];
        let place = |v: u32| {
            let p = to.transform_point3(shape.positions[v as usize]);
            DVec3::new(p.x, p.z, -p.y)
        };
        let triangles: Vec<[DVec3; 3]> = shape.triangles.iter().map(|corners| corners.map(place)).collect();
        let start = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let bounds = triangles.iter().flatten().fold(start, |[low, high], &p| [low.min(p), high.max(p)]);
        Some(Object { node: node as u32, triangles, bounds })
    };
    to_world.iter().enumerate().filter_map(object).collect()
}

/// How far away a ray meets a triangle, from either side (Möller and Trumbore 1997).
pub fn meets([a, b, c]: [DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let inverse = 1.0 / ab.dot(across);
    let from = origin - a;
    let u = from.dot(across) * inverse;
    let q = from.cross(ab);
    let v = direction.dot(q) * inverse;
    let distance = ac.dot(q) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance >= 0.0).then_some(distance)
}

fn enters([low, high]: [DVec3; 2], origin: DVec3, direction: DVec3) -> Option<f64> {
    let inverse = direction.recip();
    let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
    let (first, last) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
    (first <= last).then_some(first)
}

/// The first triangle of all objects that a ray meets.
pub fn brute<'a>(objects: impl IntoIterator<Item = &'a Object>, origin: DVec3, direction: DVec3) -> Hit {
    let mut best: Hit = None;
    for object in objects {
        let limit = best.map_or(f64::INFINITY, |(distance, _)| distance);
        if enters(object.bounds, origin, direction).is_none_or(|enters| enters > limit) {
            continue;
        }
        for &triangle in &object.triangles {
            if let Some(distance) = meets(triangle, origin, direction)
                && best.is_none_or(|(nearest, _)| distance < nearest)
            {
                best = Some((distance, object.node));
            }
        }
    }
    best
}
