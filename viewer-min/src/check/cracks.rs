//! Cracks: pixels where front and back faces do not cancel out.

use std::collections::HashMap;

use anyhow::Result;

use crate::{
    blocks::{Triangles, pair},
    camera::{Camera, middle_of},
    draw::{Look, Renderer},
    gpu::{Gpu, Targets},
    scene::Scene,
};

/// Triangles that close an open surface: from each edge on an arc that only one half-arc of the file uses to one point.
/// Where the surface ends in the file is known; an edge that is open anywhere else stays open.
pub fn caps(scene: &Scene) -> Triangles {
    let mut uses: HashMap<u32, u32> = HashMap::new();
    for half_arc in scene.roots.iter().flat_map(|root| root.loops.iter().flatten()) {
        *uses.entry(half_arc.arc).or_default() += 1;
    }
    let mut made = Triangles::default();
    made.vertices.push(pair(middle_of(scene.bounds).0.into()));
    for drawn in scene.surfaces().roots() {
        let surface = &drawn.surface;
        let is_corner = |vertex: &usize| matches!(surface.keys[*vertex], lodpack::BorderKey::Corner(_));
        let starts: Vec<usize> = (0..surface.keys.len()).filter(is_corner).chain([surface.keys.len()]).collect();
        let mut side = 0;
        for half_arcs in &scene.roots[surface.root as usize].loops {
            let first = starts[side];
            for (k, half_arc) in half_arcs.iter().enumerate() {
                let range = starts[side]..starts[side + 1];
                side += 1;
                if uses.get(&half_arc.arc).is_none_or(|&count| count > 1) {
                    continue;
                }
                let end = if k + 1 == half_arcs.len() { first } else { range.end };
                let base = made.vertices.len() as u32;
                let count = range.len() as u32;
                made.vertices.extend(range.chain([end]).map(|vertex| pair(surface.positions[vertex])));
                made.indices.extend((0..count).map(|edge| [base + edge + 1, base + edge, 0]));
            }
        }
    }
    made
}

/// Pixels where what a renderer draws, and the caps, do not cancel out.
pub fn uneven_pixels(gpu: &Gpu, targets: &Targets, renderers: [&Renderer; 2], camera: &Camera) -> Result<Vec<usize>> {
    for (renderer, is_first) in renderers.into_iter().zip([true, false]) {
        renderer.count_faces(targets, &Look::plain(*camera, targets.size), is_first);
    }
    let counts = gpu.read::<u8>(&targets.textures[3])?;
    Ok((0..counts.len()).filter(|&pixel| counts[pixel] != 0).collect())
}
