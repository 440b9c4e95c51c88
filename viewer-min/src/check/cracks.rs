//! Cracks: pixels where front and back faces do not cancel out.

use std::collections::HashMap;

use anyhow::Result;

use crate::{
    blocks::{RECORD, Triangles, border_records},
    camera::{Camera, middle_of, pair},
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
        let arcs: Vec<u32> = surface.half_arcs().map(|half_arc| half_arc.arc).collect();
        for (record, k) in
            border_records(surface).chunks_exact(RECORD).flat_map(|record| [0, 1, 2].map(|k| (record, k)))
        {
            if arcs.get(record[3 + 3 * k] as usize).is_some_and(|arc| uses.get(arc) == Some(&1)) {
                let first = made.vertices.len() as u32;
                let ends = [record[(k + 1) % 3], record[k]];
                made.vertices.extend(ends.map(|vertex| pair(surface.positions[vertex as usize])));
                made.indices.push([first, first + 1, 0]);
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
